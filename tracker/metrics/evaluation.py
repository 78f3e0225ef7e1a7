"""A Sequence's truth beside Results: who counts, and all scores in one dictionary."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tracker.formats.motchallenge import read_mot15
from tracker.geometry import Mask, Pose
from tracker.metrics.clear_mot import score, score_boxes
from tracker.metrics.cramer_rao import surveyed
from tracker.metrics.matching import MatchingFrame
from tracker.metrics.trajectory import score_each, score_robots
from tracker.sequence.results import Results
from tracker.types import Sequence, Truth

SEEN = 0.2  # visible fraction from which a person has been seen
MEMORY = 9 / 7  # s: a person counts who was seen within this time (δ_a, 9 frames at 7 frames/s)


def who_counts(truth: tuple[Truth, ...], period: float) -> list[Mask]:
    """Per frame (m,): seen by some camera, at least the fraction SEEN, in this frame or within MEMORY before it."""
    memory = round(MEMORY / period)
    last: dict[int, int] = {}
    out = []
    for frame in truth:
        for person, visible in zip(frame.person_id.tolist(), frame.visible, strict=True):
            if visible.size and visible.max() >= SEEN:
                last[person] = frame.index
        out.append(np.array([frame.index - last.get(p, -memory - 1) <= memory for p in frame.person_id.tolist()], dtype=bool))
    return out


def evaluate(sequence: Sequence, results: Results) -> dict[str, Any]:
    """Scores as JSON values: `targets`, `everybody` (nobody ignored; the same where all were seen), `robots` (with `each`, a robot's own) and
    `dead_reckoning` or None.

    Raises ValueError where the sequence has no truth or the results are of another source or have fewer frames.
    """
    truth = sequence.truth
    if truth is None:
        raise ValueError("this source has no truth to score against (annotations/*-cropped.xml)")
    if results.run.get("provenance", sequence.provenance) != sequence.provenance:
        raise ValueError("these results were made from another source, or from other views or files of it")
    if results.frames < len(truth):
        raise ValueError(f"results have {results.frames} frames, the truth has {len(truth)}: made from another source?")
    nobody = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    counts = who_counts(truth, sequence.setup.period)

    def frames(by_count: bool) -> list[MatchingFrame]:
        return [
            MatchingFrame(t.person_id, t.feet, *results.tracks.get(t.index, nobody), counts=counts[k] if by_count else None)
            for k, t in enumerate(truth)
        ]

    out: dict[str, Any] = {"targets": score(frames(True)).to_dict(), "everybody": score(frames(False)).to_dict()}
    # The pose of a fixed camera is given: there is nothing to score in it.
    fixed = {robot for robot in sequence.setup.starts if sequence.setup.is_fixed(robot)}
    robots = {robot: [t.T_world_robot[robot] for t in truth] for robot in truth[0].T_world_robot if robot not in fixed} if truth else {}
    out["robots"] = out["dead_reckoning"] = None
    if robots:
        # A robot that was told no start may have found the team late, or never.
        late = set(results.run.get("unknown_start", ())) & set(robots) - set(results.poses)
        absent: dict[str, list[Pose | None]] = {robot: [None] * results.frames for robot in late}
        told = results.poses | absent
        each = {robot: score.to_dict() for robot, score in score_each(robots, told, results.covariances).items()}
        out["robots"] = score_robots(robots, told, results.covariances).to_dict() | {"each": each}
        out["dead_reckoning"] = score_robots(robots, dead_reckoning(sequence)).to_dict()
    return out


def efficiency(sequence: Sequence, results: Results) -> dict[str, float | None]:
    """bound_m, the Cramér-Rao bound of the robots' places (cramer_rao.surveyed says of what), and `efficiency`, ATE over it; None where there is no
    map, or a start was not told. It takes about as long as the filter did.
    """
    out: dict[str, float | None] = {"bound_m": None, "efficiency": None}
    if sequence.truth is None or results.survey is None or results.run.get("unknown_start"):
        return out
    bound = surveyed(sequence.setup, [t.T_world_robot for t in sequence.truth], sequence.ticks.odometry(), results.survey)
    if bound:
        moving = {robot: [t.T_world_robot[robot] for t in sequence.truth] for robot in results.poses if robot in sequence.truth[0].T_world_robot}
        out = {"bound_m": bound, "efficiency": score_robots(moving, results.poses).ate_m / bound}
    return out


def evaluate_files(truth: Path, result: Path, iou: float | None) -> dict[str, Any]:
    """Scores of one MOT15 file against another: boxes that overlap by `iou`, or places within 1 m where it is None.

    Rows of the truth with confidence 0 are people that do not count: as places they are ignored both ways. As boxes they count like all
    others, for so do the published scores of S2.L1. Raises ValueError where a row has no place and places are asked for.
    """
    true, given = read_mot15(truth), read_mot15(result)
    for path, rows in ((truth, true), (result, given)):
        if iou is None and not rows.positioned.all():
            raise ValueError(f"{path}: row {int(np.argmin(rows.positioned)) + 1} has no x, y, z; give --iou to compare boxes")
    by_frame = true.by_frame(), given.by_frame()
    none = np.zeros(0, dtype=np.int64)
    frames = []
    for number in sorted({*by_frame[0], *by_frame[1]}):
        t, e = by_frame[0].get(number, none), by_frame[1].get(number, none)
        if iou is not None:
            frames.append(MatchingFrame(true.id[t], true.box[t], given.id[e], given.box[e]))
        else:
            frames.append(MatchingFrame(true.id[t], true.position[t], given.id[e], given.position[e], counts=true.confidence[t] != 0))
    targets = (score(frames) if iou is None else score_boxes(frames, iou=iou)).to_dict()
    return {"targets": targets, "everybody": targets, "robots": None, "dead_reckoning": None}


def dead_reckoning(sequence: Sequence) -> dict[str, list[Pose | None]]:
    """The start poses carried on by odometry alone: what the robots would believe without looking."""
    poses = {robot: start.T_world_robot for robot, start in sequence.setup.starts.items() if start}
    out: dict[str, list[Pose | None]] = {robot: [] for robot in poses}
    for odometry in sequence.ticks.odometry():
        for robot in poses:
            if robot in odometry:
                poses[robot] = poses[robot] @ odometry[robot].T_before_now
            out[robot].append(poses[robot])
    return out


def table(scores: dict[str, Any]) -> str:
    """The scores for a person to read."""

    def number(value: float | int | None, digits: int = 3) -> str:
        return "–" if value is None else str(value) if isinstance(value, int) else f"{value:.{digits}f}"

    t = scores["targets"]
    lines = [
        "people   MOTA  IDF1  HOTA  MOTP      FP   FN  switches  fragments  MT/ML  truths",
        f"         {number(t['mota'])} {number(t['idf1'])} {number(t['hota'])} {number(t['motp_m'])} m {t['false_positives']:4d} {t['misses']:4d}"
        f"  {t['switches']:8d}  {t['fragments']:9d}  {t['mostly_tracked']}/{t['mostly_lost']}  {t['truths']:6d}",
    ]
    if scores["everybody"] != t:
        lines.append(f"         MOTA over everybody, seen or not: {number(scores['everybody']['mota'])}")
    if scores["robots"]:
        lines += _of_robots(scores["robots"], scores["dead_reckoning"], number)
    return "\n".join(lines)


def _of_robots(team: dict[str, Any], reckoned: dict[str, Any], number: Callable[..., str]) -> list[str]:
    """A line for the team, one a robot, and dead reckoning."""
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
    return [*out, f"{'':13}{number(reckoned['ate_m'])} m  by dead reckoning"]
