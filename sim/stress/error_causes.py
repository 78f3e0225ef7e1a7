"""Error diagnosis: each miss, false positive and identity switch that the score counts, with one cause each.

Matches are those of the score itself (tracker/metrics/clear_mot.py), so that the counts of causes add up to the counts of the score.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.stress.trial_data import TrialData
from tracker.detections.ground_points import FusionParameters, project_to_ground
from tracker.geometry import Array, Ints, Pose
from tracker.metrics.clear_mot import GATE, match_on_ground
from tracker.metrics.matching import planar_distance
from tracker.sequence.results import Results
from tracker.types import Tick, View
from tracker.types.truth import VISIBLE_FRACTION

MISSES = ("nobody saw it", "occluded", "detector missed", "not yet confirmed", "gated out", "pose error", "merged")
FALSE_POSITIVES = ("clutter", "duplicate", "coasting", "misplaced", "pose error")
SWITCHES = ("wrong association", "after occlusion", "after detector misses", "pose error", "new track")
CAUSES = {"misses": MISSES, "false positives": FALSE_POSITIVES, "switches": SWITCHES}

POSE_ERROR = 0.5
"""m: pose errors are the cause where they shift a person by more than this in each view that detected the person."""
MISPLACED = 2.5
"""m: a false positive nearer than this to a missed person is an estimate of that person."""
RECENT = 2.0
"""s: a track that was matched to a person within this time is still attributed to that person."""


@dataclass(frozen=True)
class Mistake:
    """One error that the score counts.

    kind: "miss", "false positive" or "switch". person: true id, or None. track: estimated id, or None. position: (3,) m.
    """

    frame: int
    kind: str
    cause: str
    person: int | None
    track: int | None
    position: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class FrameEvidence:
    """Truth, detections and tracks of one frame.

    person (m,) and feet (m, 3) m: all true persons. visible: (m,) the largest visible share of each over the views that reached the tracker.
    detected: persons with a box. shift: person → m, the least distance by which pose errors of the detecting robots shift the person.
    missed: persons who count and have no track. match: person → track, of those who count. track (k,) and place (k, 3) m: all tracks.
    false: the tracks that are false positives.
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
    """The evidence of all frames of a run; period s."""

    frames: tuple[FrameEvidence, ...]
    period: float


def gather_evidence(data: TrialData, results: Results) -> TrialEvidence:
    """Collect truth, detections and tracks of each frame."""
    frames = data.matching_frames(results)
    scored, matches = match_on_ground(frames)
    truths, tracks = _ids([f.truth_id for f in frames]), _ids([f.estimate_id for f in frames])
    recorded = frozenset(id(view.detections) for tick in data.recorded for view in tick.views)
    out = []
    for k, (frame, pairing, (rows, columns)) in enumerate(zip(frames, scored.frames, matches, strict=True)):
        match = dict(zip(truths[pairing.truth[rows]].tolist(), tracks[pairing.estimate[columns]].tolist(), strict=True))
        tick = data.ticks[k]
        seen_by = _cameras_by_person(data, tick, k)
        out.append(
            FrameEvidence(
                index=data.truth[k].index,
                person=frame.truth_id,
                feet=data.truth[k].feet,
                visible=_visible(data, tick, k, recorded),
                detected=frozenset(seen_by),
                shift=_shifts(data, results, k, seen_by),
                missed=frozenset(truths[pairing.truth].tolist()) - set(match),
                match=match,
                track=frame.estimate_id,
                place=frame.estimate,
                false=frozenset(tracks[pairing.estimate].tolist()) - set(match.values()),
            )
        )
    return TrialEvidence(tuple(out), data.setup.period)


def _ids(columns: list[Ints]) -> Ints:
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *columns]))


def _visible(data: TrialData, tick: Tick, k: int, recorded: frozenset[int]) -> Array:
    """(m,) the largest visible share of each person over the views that reached the tracker. recorded: `id` of the Detections of all views."""
    visible = data.truth[k].visible
    # A fault that drops a view puts new, empty detections in place of its own.
    there = {view.camera for view in tick.views if id(view.detections) in recorded}
    columns = [c for c, camera in enumerate(data.setup.mounts) if camera in there]
    return np.asarray(visible[:, columns].max(axis=1, initial=0.0))


def _cameras_by_person(data: TrialData, tick: Tick, k: int) -> dict[int, list[str]]:
    """Person → the cameras that have a box of the person."""
    out: dict[int, list[str]] = {}
    for view in tick.views:
        persons = data.true_persons(view.detections) if data.views[k] else _persons_by_distance(data, view, k)
        for person in persons[persons > 0].tolist():
            out.setdefault(person, []).append(view.camera)
    return out


def _persons_by_distance(data: TrialData, view: View, k: int) -> Ints:
    """(n,) the person nearest to the ground point of each box, 0 beyond GATE.

    For real sequences of fixed cameras, whose boxes have no known persons.
    """
    start, truth = data.setup.starts[data.setup.mounts[view.camera].robot], data.truth[k]
    if start is None or not len(view.detections) or not len(truth.person_id):
        return np.zeros(len(view.detections), dtype=np.int64)
    fusion = FusionParameters().over(data.setup)
    ground = project_to_ground(data.setup, view.camera, view.detections, (start.T_world_robot, start.covariance), fusion)
    distance = planar_distance(ground.point, truth.feet)
    return np.where(ground.grounded & (distance.min(axis=1) < GATE), truth.person_id[distance.argmin(axis=1)], 0)


def _shifts(data: TrialData, results: Results, k: int, seen_by: dict[int, list[str]]) -> dict[int, float]:
    """Person → m, the least distance by which pose errors of the robots that detected the person shift the person."""
    truth, moved = data.truth[k], dict[str, Pose]()
    for robot, poses in results.poses.items():
        estimate = poses[k] if k < len(poses) else None
        if estimate is not None and robot in truth.T_world_robot:
            moved[robot] = estimate @ truth.T_world_robot[robot].inverse()
    feet = dict(zip(truth.person_id.tolist(), truth.feet, strict=True))
    out = {}
    for person, cameras in seen_by.items():
        errors = [moved[r] for r in (data.setup.mounts[c].robot for c in cameras) if r in moved]
        if person in feet and errors:
            out[person] = min(float(np.linalg.norm((T.apply(feet[person][None])[0] - feet[person])[:2])) for T in errors)
    return out


def find_mistakes(evidence: TrialEvidence) -> list[Mistake]:
    """All errors, frame by frame; as many of each kind as the score counts."""
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
                cause = _why_switched(evidence.frames[last[person][1] : k + 1], person, last[person][0], owner.get(track))
                out.append(_mistake(now, "switch", cause, (person, track), feet[person]))
        for person, track in now.match.items():
            owner[track], last[person] = (person, k), (track, k)
    return out


def _mistake(now: FrameEvidence, kind: str, cause: str, who: tuple[int | None, int | None], place: Array) -> Mistake:
    x, y, *z = place.tolist()
    return Mistake(now.index, kind, cause, *who, (x, y, z[0] if z else 0.0))


def _why_missed(now: FrameEvidence, person: int, known: bool) -> str:
    """known: whether the person was tracked before."""
    row = int(np.flatnonzero(now.person == person)[0])
    if now.visible[row] <= 0:
        return "nobody saw it"
    if now.visible[row] < VISIBLE_FRACTION:
        return "occluded"
    if person not in now.detected:
        return "detector missed"
    if now.shift.get(person, 0.0) > POSE_ERROR:
        return "pose error"
    near = planar_distance(now.feet[row : row + 1], now.place)[0] < GATE if len(now.place) else np.zeros(0, dtype=bool)
    others = set(now.track[near].tolist()) - now.false
    return "merged" if others else "gated out" if known else "not yet confirmed"


def _why_false(now: FrameEvidence, place: Array, owner: tuple[int, int] | None, since: float) -> str:
    distance = planar_distance(place[None], now.feet)[0] if len(now.feet) else np.zeros(0)
    nearest = int(np.argmin(distance)) if len(distance) else -1
    person = int(now.person[nearest]) if len(distance) else 0
    if len(distance) and distance[nearest] < GATE and person not in now.missed:
        return "duplicate"
    if len(distance) and distance[nearest] < MISPLACED and person in now.missed:
        return "pose error" if now.shift.get(person, 0.0) > POSE_ERROR else "misplaced"
    if owner is not None and owner[1] >= since:
        return "pose error" if now.shift.get(owner[0], 0.0) > POSE_ERROR else "coasting"
    return "clutter"


def _why_switched(since: tuple[FrameEvidence, ...], person: int, old: int, owner: tuple[int, int] | None) -> str:
    """since: the frames from the last match of the person until now. old: the track of that match.

    owner: person and frame of the last match of the new track.
    """
    now = since[-1]
    if (owner is not None and owner[0] != person) or old in now.match.values():
        return "wrong association"
    if now.shift.get(person, 0.0) > POSE_ERROR:
        return "pose error"
    between = since[1:-1]
    seen = [float(f.visible[f.person == person].max(initial=0.0)) >= VISIBLE_FRACTION for f in between]
    if between and np.mean(seen) < 0.5:
        return "after occlusion"
    if between and np.mean([person in f.detected for f in between]) < 0.5:
        return "after detector misses"
    return "new track"


def count_causes(found: Sequence[Mistake]) -> dict[str, dict[str, int]]:
    """Kind → cause → count; causes that do not occur count 0."""
    counts = Counter((m.kind, m.cause) for m in found)
    kinds = {"misses": "miss", "false positives": "false positive", "switches": "switch"}
    return {name: {cause: counts[kinds[name], cause] for cause in causes} for name, causes in CAUSES.items()}
