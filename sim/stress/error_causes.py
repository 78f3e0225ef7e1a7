"""Why people were missed, imagined or mixed up: every mistake that the score counts, with one cause each.

Correspondences are those of the score itself (tracker/metrics/matching.py), so that the causes add up to its counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim.stress.footage import TrialData
from tracker.detections.ground_points import FusionParameters, project_to_ground
from tracker.geometry import Array, Ints, Pose
from tracker.metrics.evaluation import SEEN, who_counts
from tracker.metrics.matching import Comparison, Matches, MatchingFrame, compare, correspond, planar_distance, without_ignored
from tracker.sequence.results import Results
from tracker.types import Tick, View

MISSES = ("nobody saw it", "occluded", "detector missed", "not yet believed", "gated out", "pose error", "merged")
FALSE_POSITIVES = ("clutter", "duplicate", "coasting", "misplaced", "pose error")
SWITCHES = ("wrong association", "after occlusion", "after detector misses", "pose error", "new track")
CAUSES = {"misses": MISSES, "false positives": FALSE_POSITIVES, "switches": SWITCHES}

GATE = 1.0
"""m: a match lies within this (clearmot.score)."""
SHIFTED = 0.5
"""m by which every view that saw a person must misplace it for its robot's error to be the cause."""
NEARBY = 2.5
"""m: an estimate this near to somebody who is missed is that person, misplaced."""
RECENT = 2.0
"""s since which a track that was somebody's is still told of that person."""


@dataclass(frozen=True)
class Mistake:
    """frame; kind "miss", "false positive" or "switch"; cause; person, of the truth, or None; track, the id told, or None; position (3,) m."""

    frame: int
    kind: str
    cause: str
    person: int | None
    track: int | None
    position: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a frame: everybody (m,) and feet (m, 3) m; visible (m,), the largest share that a view that arrived shows; detected: who is
    in some box; shift: person → m by which all views that detected the person misplace it at least; match: person → track for those who count;
    near: all tracks (k,) and their places (k, 3) m; false: those of them that are false positives.
    """

    index: int
    person: Ints
    feet: Array
    visible: Array
    detected: frozenset[int]
    shift: dict[int, float]
    missed: frozenset[int]
    match: dict[int, int]
    track: Ints
    place: Array
    false: frozenset[int]


@dataclass(frozen=True, eq=False)
class TrialEvidence:
    """What is known of every frame of a run; period s."""

    frames: tuple[Known, ...]
    period: float


def gather(footage: TrialData, results: Results) -> TrialEvidence:
    """Truth, what was seen and what was told, frame by frame."""
    nobody = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    counts = who_counts(footage.truth, footage.setup.period)
    frames = [MatchingFrame(t.person_id, t.feet, *results.tracks.get(t.index, nobody), counts=c) for t, c in zip(footage.truth, counts, strict=True)]
    scored, matches = matched(frames)
    truths, tracks = _ids([f.truth_id for f in frames]), _ids([f.estimate_id for f in frames])
    out = []
    for k, (frame, pairing, (rows, columns)) in enumerate(zip(frames, scored.frames, matches, strict=True)):
        match = dict(zip(truths[pairing.truth[rows]].tolist(), tracks[pairing.estimate[columns]].tolist(), strict=True))
        tick = footage.ticks[k]
        seen_by = _detections(footage, tick, k)
        out.append(
            Known(
                index=footage.truth[k].index,
                person=frame.truth_id,
                feet=footage.truth[k].feet,
                visible=_visible(footage, tick, k),
                detected=frozenset(seen_by),
                shift=_shifts(footage, results, k, seen_by),
                missed=frozenset(truths[pairing.truth].tolist()) - set(match),
                match=match,
                track=frame.estimate_id,
                place=frame.estimate,
                false=frozenset(tracks[pairing.estimate].tolist()) - set(match.values()),
            )
        )
    return TrialEvidence(tuple(out), footage.setup.period)


def matched(frames: Sequence[MatchingFrame]) -> tuple[Comparison, Matches]:
    """Those who count, and which track stands for whom, as clearmot.score has it."""

    def similarity(distance: Array) -> Array:
        return np.maximum(0.0, 1 - distance / (2 * GATE))

    values = compare(frames, planar_distance)
    values = without_ignored(frames, values, correspond(values.mapped(similarity), 0.5))
    return values, correspond(values.mapped(similarity), 0.5)


def _ids(columns: list[Ints]) -> Ints:
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *columns]))


def _arrived(view: View, recorded: View) -> bool:
    """Whether a view reached the tracker with what it had."""
    told = len(view.detections) or view.sightings is not None or view.image is not None
    return bool(told) or (recorded.sightings is None and recorded.image is None)


def _visible(footage: TrialData, tick: Tick, k: int) -> Array:
    """(m,) the largest visible share of each person over the views that arrived."""
    visible = footage.truth[k].visible
    recorded = {view.camera: view for view in footage.recorded[k].views}
    there = {view.camera for view in tick.views if _arrived(view, recorded[view.camera])}
    columns = [c for c, camera in enumerate(footage.setup.mounts) if camera in there]
    return np.asarray(visible[:, columns].max(axis=1, initial=0.0))


def _detections(footage: TrialData, tick: Tick, k: int) -> dict[int, list[str]]:
    """Person → the cameras that have a box of the person."""
    out: dict[int, list[str]] = {}
    for view in tick.views:
        whose = footage.whose(view.detections) if footage.views[k] else _by_feet(footage, view, k)
        for person in whose[whose > 0].tolist():
            out.setdefault(person, []).append(view.camera)
    return out


def _by_feet(footage: TrialData, view: View, k: int) -> Ints:
    """Where boxes have no known owner (a real sequence before fixed cameras): who stands within GATE of where they meet the ground."""
    start, truth = footage.setup.starts[footage.setup.mounts[view.camera].robot], footage.truth[k]
    if start is None or not len(view.detections) or not len(truth.person_id):
        return np.zeros(len(view.detections), dtype=np.int64)
    feet = project_to_ground(footage.setup, view.camera, view.detections, (start.T_world_robot, start.covariance), FusionParameters())
    distance = planar_distance(feet.point, truth.feet)
    return np.where(feet.grounded & (distance.min(axis=1) < GATE), truth.person_id[distance.argmin(axis=1)], 0)


def _shifts(footage: TrialData, results: Results, k: int, seen_by: dict[int, list[str]]) -> dict[int, float]:
    truth, moved = footage.truth[k], dict[str, Pose]()
    for robot, poses in results.poses.items():
        estimate = poses[k] if k < len(poses) else None
        if estimate is not None and robot in truth.T_world_robot:
            moved[robot] = estimate @ truth.T_world_robot[robot].inverse()
    feet = dict(zip(truth.person_id.tolist(), truth.feet, strict=True))
    out = {}
    for person, cameras in seen_by.items():
        errors = [moved[r] for r in (footage.setup.mounts[c].robot for c in cameras) if r in moved]
        if person in feet and errors:
            out[person] = min(float(np.linalg.norm((T.apply(feet[person][None])[0] - feet[person])[:2])) for T in errors)
    return out


def mistakes(evidence: TrialEvidence) -> list[Mistake]:
    """All of them, frame by frame; as many of each kind as the score counts."""
    out: list[Mistake] = []
    owner: dict[int, tuple[int, int]] = {}  # track → person and frame of its last match
    last: dict[int, tuple[int, int]] = {}  # person → track and number of the frame of the last match
    for k, now in enumerate(evidence.frames):
        feet = dict(zip(now.person.tolist(), now.feet, strict=True))
        for person in sorted(now.missed):
            out.append(_mistake(now, "miss", _why_missed(now, person, person in last), (person, None), feet[person]))
        places = dict(zip(now.track.tolist(), now.place, strict=True))
        for track in sorted(now.false):
            cause = _why_false(now, places[track], owner.get(track), k - RECENT / evidence.period)
            out.append(_mistake(now, "false positive", cause, (None, track), places[track]))
        for person, track in sorted(now.match.items()):
            if person in last and last[person][0] != track:
                cause = _why_switched(evidence.frames[last[person][1] : k + 1], person, track, (last[person][0], owner.get(track)))
                out.append(_mistake(now, "switch", cause, (person, track), feet[person]))
        for person, track in now.match.items():
            owner[track], last[person] = (person, k), (track, k)
    return out


def _mistake(now: Known, kind: str, cause: str, who: tuple[int | None, int | None], place: Array) -> Mistake:
    x, y, *z = place.tolist()
    return Mistake(now.index, kind, cause, *who, (x, y, z[0] if z else 0.0))


def _why_missed(now: Known, person: int, known: bool) -> str:
    """known: whether the person was ever followed before."""
    row = int(np.flatnonzero(now.person == person)[0])
    if now.visible[row] <= 0:
        return "nobody saw it"
    if now.visible[row] < SEEN:
        return "occluded"
    if person not in now.detected:
        return "detector missed"
    if now.shift.get(person, 0.0) > SHIFTED:
        return "pose error"
    near = planar_distance(now.feet[row : row + 1], now.place)[0] < GATE if len(now.place) else np.zeros(0, dtype=bool)
    others = set(now.track[near].tolist()) - now.false
    return "merged" if others else "gated out" if known else "not yet believed"


def _why_false(now: Known, place: Array, owner: tuple[int, int] | None, since: float) -> str:
    distance = planar_distance(place[None], now.feet)[0] if len(now.feet) else np.zeros(0)
    nearest = int(np.argmin(distance)) if len(distance) else -1
    person = int(now.person[nearest]) if len(distance) else 0
    if len(distance) and distance[nearest] < GATE and person not in now.missed:
        return "duplicate"
    if len(distance) and distance[nearest] < NEARBY and person in now.missed:
        return "pose error" if now.shift.get(person, 0.0) > SHIFTED else "misplaced"
    if owner is not None and owner[1] >= since:
        return "pose error" if now.shift.get(owner[0], 0.0) > SHIFTED else "coasting"
    return "clutter"


def _why_switched(since: tuple[Known, ...], person: int, track: int, before: tuple[int, tuple[int, int] | None]) -> str:
    """since: the frames from the last match until now; before: the person's track then, and whose the new track was."""
    now, (old, owner) = since[-1], before
    if (owner is not None and owner[0] != person) or old in now.match.values():
        return "wrong association"
    if now.shift.get(person, 0.0) > SHIFTED:
        return "pose error"
    between = since[1:-1]
    seen = [float(f.visible[f.person == person].max(initial=0.0)) >= SEEN for f in between]
    if between and np.mean(seen) < 0.5:
        return "after occlusion"
    if between and np.mean([person in f.detected for f in between]) < 0.5:
        return "after detector misses"
    return "new track"


def counted(found: Sequence[Mistake]) -> dict[str, dict[str, int]]:
    """Kind → cause → how many; all causes are there."""
    kinds = {"misses": "miss", "false positives": "false positive", "switches": "switch"}
    is_of: Callable[[str, str], int] = lambda kind, cause: sum(m.kind == kind and m.cause == cause for m in found)  # noqa: E731
    return {name: {cause: is_of(kinds[name], cause) for cause in causes} for name, causes in CAUSES.items()}
