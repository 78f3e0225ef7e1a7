"""All scores of Results against the truth of a Sequence, and the choice of the people that are evaluated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tracker.formats.aicity.files import CLASSES, PERSON, read_ground_truth, read_results
from tracker.formats.aicity.person_boxes import boxes_of_tracks
from tracker.geometry import Array, Ints, Mask, Pose
from tracker.io.mot15 import DISTRACTORS, PEDESTRIAN, place_of_row, read_mot15, read_mot_truth
from tracker.metrics.boxes_3d import BOX, hota_3d
from tracker.metrics.clear_mot import score, score_boxes
from tracker.metrics.ground_detection import score_ground_detections
from tracker.metrics.hota import HotaSums
from tracker.metrics.matching import MatchingFrame
from tracker.metrics.trajectory import score_each, score_robots
from tracker.sequence.results import Results
from tracker.slam.cramer_rao import bound_of_map
from tracker.types import Sequence
from tracker.types.sequence import dead_reckoning
from tracker.types.truth import evaluated_people

PETS = "PETS 2009"
GRID_TRUTH = "annotations_positions"
"""Name of the truth of WILDTRACK, MultiviewX and GMVD in a provenance. These are scored as detections too, by the rules of their evaluation kit."""
TRUTH_FILES = "truth.txt (PETS 2009: annotations/*-cropped.xml; WILDTRACK: annotations_positions/; JRDB: labels_3d/; AI City: ground_truth.json)"
Tracks = dict[int, tuple[Ints, Array]]


def evaluate(sequence: Sequence, results: Results, area: Array | None = None) -> dict[str, Any]:
    """Scores as JSON values: `targets`, `everybody` (no person ignored), `robots` (with `each`, by robot) and `dead_reckoning`, or None.

    Recordings other than PETS 2009 have `hota_3d` too, on boxes of people (boxes_3d), and WILDTRACK, MultiviewX and GMVD `ground_detection`.
    area: (2, 2) m or None, as MatchingFrame.within; with it there is no `ground_detection`, whose kit scores everybody.
    Raises ValueError if the sequence has no truth, or if the results belong to another source or have fewer frames.
    """
    truth = sequence.truth
    if truth is None:
        raise ValueError(f"this source has no truth to score against, needs {TRUTH_FILES}")
    if results.run.get("provenance", sequence.provenance) != sequence.provenance:
        raise ValueError("these results were made from another source, or from other views or files of it")
    if results.frames < len(truth):
        raise ValueError(f"results have {results.frames} frames, the truth has {len(truth)}: made from another source?")
    counts = evaluated_people(truth, sequence.setup.period)
    people: Tracks = {t.index: (t.person_id, t.feet) for t in truth}
    everybody = matching_frames(people, results.tracks, None, area)
    seen = matching_frames(people, results.tracks, counts, area)
    out: dict[str, Any] = {"targets": score(seen).to_dict(), "everybody": score(everybody).to_dict()}
    out |= _scores_of_kits(sequence.provenance, people, results.tracks, counts, area)
    # The pose of a fixed camera is given and not scored.
    fixed = {robot for robot in sequence.setup.starts if sequence.setup.is_fixed(robot)}
    robots = {robot: [t.T_world_robot[robot] for t in truth] for robot in truth[0].T_world_robot if robot not in fixed} if truth else {}
    out["robots"] = out["dead_reckoning"] = None
    if robots:
        # A robot with an unknown start may join the team late, or never.
        never_found = set(results.run.get("unknown_start", ())) & set(robots) - set(results.poses)
        absent: dict[str, list[Pose | None]] = {robot: [None] * results.frames for robot in never_found}
        estimated = results.poses | absent
        each = {robot: score.to_dict() for robot, score in score_each(robots, estimated, results.covariances).items()}
        out["robots"] = score_robots(robots, estimated, results.covariances).to_dict() | {"each": each}
        out["dead_reckoning"] = score_robots(robots, dead_reckoning(sequence)).to_dict()
    return out


def matching_frames(truth: Tracks, tracks: Tracks, counts: list[Mask] | None = None, area: Array | None = None) -> list[MatchingFrame]:
    """A MatchingFrame for each frame of `truth`, in its order. A frame that is not in `tracks` has no estimates.

    counts: of each frame, as MatchingFrame's. area: (2, 2) m or None, as MatchingFrame.within.
    """
    none = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    frames = [MatchingFrame(*truth[k], *tracks.get(k, none), counts=None if counts is None else counts[n]) for n, k in enumerate(truth)]
    return frames if area is None else [frame.within(area) for frame in frames]


def _scores_of_kits(provenance: dict[str, Any], truth: Tracks, tracks: Tracks, counts: list[Mask], area: Array | None) -> dict[str, Any]:
    """The additional scores of some kinds of sources: `hota_3d`, `ground_detection`."""
    if provenance.get("source", PETS) == PETS:
        return {}
    # The yaw of an estimate comes only from its past, so that an online tracker stays online.
    boxes = boxes_of_tracks(truth), boxes_of_tracks(tracks, online=True)
    out: dict[str, Any] = {"hota_3d": hota_values(hota_3d(matching_frames(*boxes, counts, area)))}
    if GRID_TRUTH in provenance.get("files", {}) and area is None:
        out["ground_detection"] = score_ground_detections(matching_frames(truth, tracks))
    return out


def hota_values(sums: HotaSums) -> dict[str, float | None]:
    """HOTA, DetA and AssA, each the mean over α, as JSON values; None where undefined."""
    values = {"hota": sums.hota, "deta": float(sums.deta.mean()), "assa": float(sums.assa.mean())}
    return {name: None if np.isnan(value) else value for name, value in values.items()}


def efficiency(sequence: Sequence, results: Results) -> dict[str, float | None]:
    """bound_m, the Cramér-Rao bound of the robots' positions (cramer_rao.bound_of_map), and `efficiency`, ATE over it.

    None without a map, or with an unknown start. The computation takes about as long as the filter.
    """
    out: dict[str, float | None] = {"bound_m": None, "efficiency": None}
    if sequence.truth is None or results.landmark_history is None or results.run.get("unknown_start"):
        return out
    bound = bound_of_map(sequence.setup, [t.T_world_robot for t in sequence.truth], sequence.ticks.odometry(), results.landmark_history)
    if bound:
        moving = {robot: [t.T_world_robot[robot] for t in sequence.truth] for robot in results.poses if robot in sequence.truth[0].T_world_robot}
        out = {"bound_m": bound, "efficiency": score_robots(moving, results.poses).ate_m / bound}
    return out


Flagged = Literal["removed", "ignored", "counted"]
"""Truth rows flagged 0 are removed (estimates on them are false, TrackEval's rule), ignored with the estimates on them, or counted like others."""


def evaluate_files(truth: Path, result: Path, iou: float | None, area: Array | None = None, flagged: Flagged | None = None) -> dict[str, Any]:
    """Scores of one MOT15 file against another: boxes that overlap by `iou`, or positions within 1 m if it is None.

    A truth that is the ground_truth.json of AI City is compared with a result file of that challenge, as evaluate_aicity.
    A truth of boxes may be of MOT16 to MOT20, with nine columns. Then pedestrians are evaluated, and distractors ignored with the estimates on them.
    flagged: for rows with confidence 0; None is `removed` for boxes, and `ignored` for positions.
    area: (2, 2) m or None, as MatchingFrame.within.
    Raises ValueError if positions are needed and a row has none, and for an area of boxes.
    """
    if truth.suffix == ".json":
        if iou is not None:
            raise ValueError(f"{truth}: --iou is for boxes in images, and this is the truth of a scene in 3-D")
        return evaluate_aicity(truth, result, area)
    if iou is not None and area is not None:
        raise ValueError("--area is a part of the ground in metres, and --iou compares boxes in images; give one of them")
    (true, kind), estimated = read_mot_truth(truth), read_mot15(result, tracks=True)
    flagged = flagged or ("ignored" if iou is None else "removed")
    evaluated = (kind == PEDESTRIAN) & ((flagged == "counted") | (true.confidence != 0))
    kept = evaluated | np.isin(kind, DISTRACTORS) | (flagged == "ignored")
    for path, rows in ((truth, true), (result, estimated)):
        if iou is None and not rows.has_position.all():
            raise ValueError(f"{place_of_row(path, int(np.argmin(rows.has_position)))}: has no x, y, z; give --iou to compare boxes")
    by_frame = true.by_frame(), estimated.by_frame()
    none = np.zeros(0, dtype=np.int64)
    frames = []
    for number in sorted({*by_frame[0], *by_frame[1]}):
        t, e = by_frame[0].get(number, none), by_frame[1].get(number, none)
        t = t[kept[t]]
        one, other = (true.box[t], estimated.box[e]) if iou is not None else (true.position[t], estimated.position[e])
        frames.append(MatchingFrame(true.id[t], one, estimated.id[e], other, counts=evaluated[t]))
    targets = (score(frames if area is None else [frame.within(area) for frame in frames]) if iou is None else score_boxes(frames, iou=iou)).to_dict()
    return {"targets": targets, "everybody": targets, "robots": None, "dead_reckoning": None}


def evaluate_aicity(truth: Path, result: Path, area: Array | None = None) -> dict[str, Any]:
    """Scores of a result file of AI City against ground_truth.json: `targets` on the ground, `hota_3d` on the boxes of both files.

    Only people are scored: the rows of class 0 (Person), and the objects of that name. Frames are those of the truth.
    area: (2, 2) m or None, as MatchingFrame.within.
    Raises ValueError as both readers, for rows of several scenes, and for a row in a frame that the truth lacks.
    """
    true: Tracks = {}
    for frame, objects in read_ground_truth(truth).items():
        here = [one for one in objects if one.kind == PERSON]
        boxes = np.array([[*one.centre, *one.size, one.rotation[2]] for one in here]).reshape(-1, BOX)
        true[frame] = np.array([one.id for one in here], dtype=np.int64), boxes
    rows = read_results(result)
    scenes = np.unique(rows.scene).tolist()
    if len(scenes) > 1:
        raise ValueError(f"{result}: scene_id is {scenes[0]} and {scenes[1]}, needs one scene, that of {truth.name}")
    if len(rows) and (unknown := sorted(set(rows.frame.tolist()) - set(true))):
        raise ValueError(f"{result}: frame_id is {unknown[0]}, needs a frame of {truth.name}, which has {len(true)}")
    chosen = np.flatnonzero(rows.category == CLASSES.index(PERSON))
    chosen = chosen[np.argsort(rows.frame[chosen], kind="stable")]
    found, first = np.unique(rows.frame[chosen], return_index=True)
    parts = np.split(chosen, first[1:])[: len(found)]
    estimated: Tracks = {k: (rows.id[part], rows.boxes[part]) for k, part in zip(found.tolist(), parts, strict=True)}
    frames = matching_frames(true, estimated, None, area)
    targets = score(frames).to_dict()
    return {"targets": targets, "everybody": targets, "robots": None, "dead_reckoning": None, "hota_3d": hota_values(hota_3d(frames))}


def table(scores: dict[str, Any]) -> str:
    """The scores as text."""

    def number(value: float | int | None, digits: int = 3) -> str:
        return "–" if value is None else str(value) if isinstance(value, int) else f"{value:.{digits}f}"

    t = scores["targets"]
    lines = [
        "people   MOTA  IDF1  HOTA  MOTP      FP   FN  switches  fragments  MT/ML  truths",
        f"         {number(t['mota'])} {number(t['idf1'])} {number(t['hota'])} {number(t['motp_m'])} m {t['false_positives']:4d} {t['misses']:4d}"
        f"  {t['switches']:8d}  {t['fragments']:9d}  {t['mostly_tracked']}/{t['mostly_lost']}  {t['truths']:6d}",
    ]
    if "area" in scores:
        (x0, y0), (x1, y1) = scores["area"]
        lines.append(f"         for x from {x0:g} to {x1:g} m and y from {y0:g} to {y1:g} m alone")
    if scores["everybody"] != t:
        lines.append(f"         MOTA over everybody, seen or not: {number(scores['everybody']['mota'])}")
    if "hota_3d" in scores:
        h = scores["hota_3d"]
        lines.append(f"         HOTA in 3-D {number(h['hota'])} (overlap of boxes; detection {number(h['deta'])}, association {number(h['assa'])})")
    if "ground_detection" in scores:
        d = scores["ground_detection"]
        cells = ", ".join(f"{name} {number(d[key])}" for name, key in (("MODP", "modp"), ("precision", "precision"), ("recall", "recall")))
        lines.append(f"         as detections within 0.5 m: MODA {number(d['moda'])}, {cells}")
    if scores["robots"]:
        lines += _robot_lines(scores["robots"], scores["dead_reckoning"], number)
    return "\n".join(lines)


def _robot_lines(team: dict[str, Any], dead_reckoned: dict[str, Any], number: Callable[..., str]) -> list[str]:
    """A line for the team, one for each robot, and one for dead reckoning."""
    metres = ("ate_m", "ate_aligned_m", "ate_yaw_m", "rpe_m", "rpe_between_m", "way_m")
    out = [f"{'robots':13}ATE      aligned  by yaw   RPE      between  way      ATE/way  NEES/dof"]
    for name, r in [("", team), *sorted(team["each"].items())]:
        cells = [f"{number(r[m])} m" if r[m] is not None else "–" for m in metres]
        cells.append("–" if r["ate_share"] is None else f"{r['ate_share']:.2%}")
        out.append(f"{name[:12]:13}" + "".join(f"{cell:9}" for cell in cells) + number(r["nees_per_dof"], 2))
    band = f" ({team['nees_low']:.2f} to {team['nees_high']:.2f} in 95 % of honest runs)" if team["nees_low"] is not None else ""
    out[1] += band
    if team.get("efficiency"):
        out.append(f"{'':13}{number(team['bound_m'])} m  Cramér-Rao bound of the same sightings; ATE over it (efficiency) {team['efficiency']:.2f}")
    return [*out, f"{'':13}{number(dead_reckoned['ate_m'])} m  by dead reckoning"]
