"""Trajectories of a team in the plane: the files of a UTIAS run (robots.csv, map.csv, run.json) and their scores.

robots.csv: time s, robot, x, y m, heading rad, and the covariance's upper triangle in the order x, y, heading. map.csv: subject, x, y m.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints, rotation_onto
from tracker.io.atomic import new_folder
from tracker.io.csv_tables import read_numbered_table
from tracker.io.json_files import read_json
from tracker.io.resume import program_version
from tracker.planar_slam.utias_files import UtiasDataset, UtiasRobot

SCHEMA = 1
ROBOTS = "timestamp,robot,tx,ty,heading,cxx,cxy,cxh,cyy,cyh,chh"
MAP = "subject,tx,ty"
UPPER = np.triu_indices(3)
GAP = 0.3  # s: longest gap over which truth is interpolated
NEAR = 0.011  # s: in longer gaps, largest distance to the nearest sample of the truth
STEP = 1.0  # s between the ends of a relative error


@dataclass(frozen=True, eq=False)
class PlanarTrajectories:
    """times (n,) s; robot → poses (n, 3) m, m, rad and covariances (n, 3, 3); landmarks: subject → (2,) m; run: data set and parameters."""

    times: Array
    poses: dict[int, Array]
    covariances: dict[int, Array]
    landmarks: dict[int, Array]
    run: dict[str, Any]


def write_trajectories(folder: Path, paths: PlanarTrajectories) -> None:
    """Write all files atomically to a folder that does not exist or is empty."""
    with new_folder(folder) as partial:
        blocks = [
            np.column_stack([paths.times, np.full(len(paths.times), robot), pose, paths.covariances[robot][:, UPPER[0], UPPER[1]]])
            for robot, pose in paths.poses.items()
        ]
        formats = ["%.3f", "%d", *["%.6f"] * 3, *["%.5e"] * 6]
        np.savetxt(partial / "robots.csv", np.concatenate(blocks), formats, ",", header=ROBOTS, comments="")
        rows = [[subject, *place] for subject, place in paths.landmarks.items()]
        np.savetxt(partial / "map.csv", np.array(rows).reshape(-1, 3), ["%d", "%.6f", "%.6f"], ",", header=MAP, comments="")
        text = json.dumps({"schema": SCHEMA, "pilsim": program_version(), "kind": "planar"} | paths.run, indent=1, sort_keys=True)
        (partial / "run.json").write_text(text + "\n", encoding="utf-8")


def read_trajectories(folder: Path) -> PlanarTrajectories:
    """Read a folder. Raises ValueError naming the file that is missing or wrong."""
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder")
    run = read_json(folder / "run.json")
    if not isinstance(run, dict) or run.get("schema") != SCHEMA or run.get("kind") != "planar":
        raise ValueError(f"{folder / 'run.json'}: not a run in the plane of version {SCHEMA}")
    (lines, rows), (_, places) = _table(folder / "robots.csv", ROBOTS, "robot"), _table(folder / "map.csv", MAP, "subject")
    robots = [int(n) for n in np.unique(rows[:, 1])]
    parts = {n: rows[rows[:, 1] == n] for n in robots}
    times = parts[robots[0]][:, 0] if robots else np.zeros(0)
    for n, part in parts.items():
        same = min(len(part), len(times))
        wrong = (part[:same, 0] != times[:same]) | (np.diff(times[:same], prepend=-np.inf) <= 0)
        if wrong.any() or len(part) != len(times):
            k = int(np.argmax(wrong)) if wrong.any() else same - 1
            fault = (
                f"robot {n} has time {part[k, 0]:.3f}" if wrong.any() else f"robot {n} has {len(part)} times, and robot {robots[0]} has {len(times)}"
            )
            raise ValueError(f"{folder / 'robots.csv'}:{lines[rows[:, 1] == n][k]}: {fault}, needs ascending times that all robots have")
    covariances = {}
    for n, part in parts.items():
        P = np.zeros((len(times), 3, 3))
        P[:, UPPER[0], UPPER[1]] = P[:, UPPER[1], UPPER[0]] = part[:, 5:]
        covariances[n] = P
    return PlanarTrajectories(times, {n: part[:, 2:5] for n, part in parts.items()}, covariances, {int(p[0]): p[1:] for p in places}, run)


def _table(path: Path, header: str, number: str) -> tuple[Ints, Array]:
    """Lines (n,) and rows (n, columns) of a table of finite numbers, whole in column `number`. Raises ValueError with file and line."""
    lines, table = read_numbered_table(path, dict.fromkeys(header.split(","), float) | {number: int})
    return np.array(lines, dtype=np.int64), np.column_stack(list(table.values())).astype(np.float64)


def true_poses(robot: UtiasRobot, times: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The truth (n, 3) at times (n,) s, and whether it is known there (n,): between samples at most GAP apart, or near a sample."""
    t = robot.truth[:, 0]
    turned = np.unwrap(robot.truth[:, 3])
    poses = np.stack([np.interp(times, t, column) for column in (robot.truth[:, 1], robot.truth[:, 2], turned)], axis=1)
    after = np.clip(np.searchsorted(t, times), 0, len(t) - 1)
    before = np.maximum(after - 1, 0)
    inside = (times >= t[0]) & (times <= t[-1]) & np.asarray(t[after] - t[before] <= GAP)
    near = np.minimum(np.abs(t[after] - times), np.abs(times - t[before])) <= NEAR
    return poses, inside | near


def score_trajectories(team: UtiasDataset, paths: PlanarTrajectories) -> dict[str, float | None]:
    """Scores against the truth of the data set, None where undefined.

    ate_m: mean over robots of the RMSE of position without alignment. ate_aligned_m: after one rigid motion of the whole team. rpe_m: RMSE of
    the translation in STEP, in the robot's own frame. nees_per_dof: over x, y, heading. map_m, map_aligned_m: RMSE of the landmarks, as they are
    and after a rigid motion of the map. Raises ValueError if a robot of the data set has no trajectory.
    """
    errors, true, given, relative, consistency = [], [], [], [], []
    ahead = max(1, round(STEP / float(np.median(np.diff(paths.times))))) if len(paths.times) > 1 else 1
    for number, robot in team.robots.items():
        if number not in paths.poses:
            raise ValueError(f"robot {number} is in the set, needs a path in robots.csv")
        truth, known = true_poses(robot, paths.times)
        error = paths.poses[number] - truth
        error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
        if known.any():
            errors.append(error[known])
            true.append(truth[known, :2])
            given.append(paths.poses[number][known, :2])
            consistency.append(_nees(error[known], paths.covariances[number][known]))
        # Rows on both sides of a gap are further apart in time.
        both = known[ahead:] & known[:-ahead] & (np.abs(paths.times[ahead:] - paths.times[:-ahead] - STEP) < STEP / 2)
        relative.append((_went(paths.poses[number], ahead) - _went(truth, ahead))[both])
    out: dict[str, float | None] = dict.fromkeys(("ate_m", "ate_aligned_m", "rpe_m", "nees_per_dof", "map_m", "map_aligned_m"))
    if errors:
        moved = _aligned(np.concatenate(given), np.concatenate(true))
        pieces = np.split(moved, np.cumsum([len(t) for t in true])[:-1])
        out["ate_m"] = float(np.mean([_rms(e[:, :2]) for e in errors]))
        out["ate_aligned_m"] = float(np.mean([_rms(p - t) for p, t in zip(pieces, true, strict=True)]))
        out["nees_per_dof"] = float(np.concatenate(consistency).mean())
    if sum(map(len, relative)):
        out["rpe_m"] = _rms(np.concatenate(relative))
    if found := [s for s in paths.landmarks if s in team.landmarks]:
        place, wanted = (np.array([table[s] for s in found]) for table in (paths.landmarks, team.landmarks))
        out["map_m"], out["map_aligned_m"] = _rms(place - wanted), _rms(_aligned(place, wanted) - wanted)
    return out


def _went(poses: Array, ahead: int) -> Array:
    """Poses (n, 3) → translation to the pose `ahead` rows later, in the own frame, (n − ahead, 2)."""
    d, c, s = poses[ahead:, :2] - poses[:-ahead, :2], np.cos(poses[:-ahead, 2]), np.sin(poses[:-ahead, 2])
    return np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]], axis=1)


def _nees(error: Array, P: Array) -> Array:
    sure = np.linalg.det(P) > 0
    x: Array = np.einsum("ni,ni->n", error[sure], np.linalg.solve(P[sure], error[sure, :, None])[..., 0]) / 3
    return x


def _rms(rows: Array) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def _aligned(points: Array, onto: Array) -> Array:
    """points (n, 2) after the rigid motion that brings them nearest to `onto` (Umeyama 1991, scale 1)."""
    return (points - points.mean(axis=0)) @ rotation_onto(points, onto).T + onto.mean(axis=0)


def table(scores: dict[str, dict[str, float | None] | None]) -> str:
    """The scores as text."""

    def number(value: float | None, unit: str = " m") -> str:
        return "–" if value is None else f"{value:.3f}{unit}"

    robots, odometry = scores["robots"] or {}, scores["dead_reckoning"] or {}
    names = ("ate_m", "ate_aligned_m", "rpe_m", "map_m", "map_aligned_m")
    cells = [number(robots.get(name)).ljust(9) for name in names] + [number(robots.get("nees_per_dof"), "")]
    head = [text.ljust(9) for text in ("ATE", "aligned", "RPE 1 s", "map", "aligned")] + ["NEES/dof"]
    return f"robots   {'  '.join(head)}\n         {'  '.join(cells)}\n         {number(odometry.get('ate_m'))} ATE by dead reckoning"
