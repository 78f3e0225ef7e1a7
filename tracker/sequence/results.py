"""The results of tracking in a folder, as `track` writes them; writer and reader.

tracks.txt holds the targets (MOT15, 3-D), robots.csv the robots, run.json what was tracked and how. With a landmark map there are two more files:
map.csv holds the landmarks (final is 1 for those in the map after the last tick), and sightings.csv the landmarks that each robot observed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array, Ints, Pose, quaternion_from_rotation, rotation_from_quaternion
from tracker.io.atomic import new_folder
from tracker.io.csv_tables import read_numbered_table, read_table, write_table
from tracker.io.json_files import read_json
from tracker.io.mot15 import place_of_row, read_mot15, rows_from_tracks, write_mot15
from tracker.io.resume import program_version
from tracker.sequence.schema import POSE, UPPER_TRIANGLE
from tracker.types import Estimate, LandmarkHistory

SCHEMA = 1
RUN = "run.json"
MAX_FRAMES = 1_000_000
MAX_ENTRIES = 1 << 25
"""Frames times robots: each entry takes 16 bytes, with or without an estimate."""
MAP = {"landmark": int, "final": int, "tx": float, "ty": float, "tz": float}
SIGHTINGS = {"frame": int, "robot": str, "landmark": int}
ROBOTS = {"frame": int, "robot": str} | dict.fromkeys(POSE, float) | {f"c{i}{j}": float for i, j in UPPER_TRIANGLE}


@dataclass(frozen=True, eq=False)
class Results:
    """The result of a run over a number of frames.

    tracks: frame → ids (k,) and positions (k, 3) m. poses, covariances: moving robot → one entry per frame, None without an estimate.
    run: what was tracked and how, as JSON values. landmark_history: None where the run has no landmarks.
    """

    frames: int
    tracks: dict[int, tuple[Ints, Array]]
    poses: dict[str, list[Pose | None]]
    covariances: dict[str, list[Array | None]]
    run: dict[str, Any]
    landmark_history: LandmarkHistory | None = None

    @staticmethod
    def of(estimates: Iterable[Estimate], run: dict[str, Any]) -> Results:
        """Collect estimates of consecutive frames. Robots whose covariance is always zero are fixed cameras and are left out.

        The counters of the last estimate are added to the run.
        """
        listed = list(estimates)
        robots = {r for e in listed for r, P in e.robot_covariance.items() if P.any()}
        names = [r for r in dict.fromkeys(r for e in listed for r in e.T_world_robot) if r in robots]
        return Results(
            len(listed),
            {e.index: (e.target_id, e.position) for e in listed},
            {r: [e.T_world_robot.get(r) for e in listed] for r in names},
            {r: [e.robot_covariance.get(r) for e in listed] for r in names},
            run | ({"counters": listed[-1].counters} if listed and listed[-1].counters else {}),
            landmark_history_of(listed),
        )


def landmark_history_of(estimates: list[Estimate]) -> LandmarkHistory | None:
    """The landmarks of all estimates; None where an estimate has no map, or there is no landmark."""
    snapshots = [e.map_snapshot for e in estimates if e.map_snapshot is not None]
    history = LandmarkHistory.of(snapshots) if len(snapshots) == len(estimates) else None
    return history if history is not None and history.positions else None


def write_results(folder: Path, results: Results) -> None:
    """Write all files atomically. Raises ValueError where `folder` exists and is not empty."""
    with new_folder(folder) as partial:
        write_mot15(partial / "tracks.txt", rows_from_tracks({k + 1: track for k, track in results.tracks.items()}))
        rows = [
            [k, robot, *pose.translation, *quaternion_from_rotation(pose.rotation), *(P[i, j] for i, j in UPPER_TRIANGLE)]
            for robot in results.poses
            for k, (pose, P) in enumerate(zip(results.poses[robot], results.covariances[robot], strict=True))
            if pose is not None and P is not None
        ]
        write_table(partial / "robots.csv", list(ROBOTS), rows)
        if results.landmark_history is not None:
            _write_landmarks(partial, results.landmark_history)
        text = json.dumps({"schema": SCHEMA, "pilsim": program_version(), "frames": results.frames} | results.run, indent=1, sort_keys=True)
        (partial / RUN).write_text(text + "\n", encoding="utf-8")


def _write_landmarks(folder: Path, history: LandmarkHistory) -> None:
    final = set(history.final.tolist())
    write_table(folder / "map.csv", list(MAP), [[n, int(n in final), *position] for n, position in history.positions.items()])
    sighted = [[k, robot, n] for k, by_robot in enumerate(history.sighted) for robot, ids in by_robot.items() for n in ids.tolist()]
    write_table(folder / "sightings.csv", list(SIGHTINGS), sighted)


def read_results(folder: Path) -> Results:
    """Read the results in a folder. Raises ValueError with file and line or field for missing or invalid content."""
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder")
    run = read_json(folder / RUN)
    if not isinstance(run, dict) or run.get("schema") != SCHEMA or not isinstance(run.get("frames"), int) or not 0 <= run["frames"] <= MAX_FRAMES:
        raise ValueError(f"{folder / RUN}: schema or frames is missing or not of version {SCHEMA}")
    frames = int(run["frames"])
    rows = read_mot15(folder / "tracks.txt", tracks=True)
    if not rows.has_position.all():
        raise ValueError(f"{place_of_row(folder / 'tracks.txt', int(np.argmin(rows.has_position)))}: has no x, y, z")
    if len(rows) and rows.frame.max() > frames:
        where = place_of_row(folder / "tracks.txt", int(np.argmax(rows.frame)))
        raise ValueError(f"{where}: frame is {rows.frame.max()}, needs at most {frames}, the frames of {RUN}")
    tracks = {frame - 1: (rows.id[k], rows.position[k]) for frame, k in rows.by_frame().items()}
    return Results(frames, tracks, *_read_robots(folder / "robots.csv", frames), run, _read_landmarks(folder, frames))


def _read_robots(path: Path, frames: int) -> tuple[dict[str, list[Pose | None]], dict[str, list[Array | None]]]:
    """Poses and covariances of robots.csv: robot → one entry per frame."""
    lines, table = read_numbered_table(path, ROBOTS)
    poses: dict[str, list[Pose | None]] = {}
    covariances: dict[str, list[Array | None]] = {}
    for line, values in zip(lines, zip(*table.values(), strict=True), strict=True):
        row = dict(zip(table, values, strict=True))
        k, robot = int(row["frame"]), str(row["robot"])
        if not 0 <= k < frames:
            raise ValueError(f"{path}:{line}: frame is {k}, needs 0 to {frames - 1}")
        if robot not in poses:
            if frames * (len(poses) + 1) > MAX_ENTRIES:
                raise ValueError(f"{path}:{line}: {len(poses) + 1} robots in {frames} frames, needs at most {MAX_ENTRIES} entries")
            poses[robot], covariances[robot] = [None] * frames, [None] * frames
        if poses[robot][k] is not None:
            raise ValueError(f"{path}:{line}: frame {k} has robot {robot[:40]} twice")
        pose, P = [row[c] for c in POSE], np.zeros((6, 6))
        for i, j in UPPER_TRIANGLE:
            P[i, j] = P[j, i] = row[f"c{i}{j}"]
        try:
            poses[robot][k] = Pose(rotation_from_quaternion(pose[3:]), np.array(pose[:3]))
        except ValueError as error:
            raise ValueError(f"{path}:{line}: {error}") from None
        covariances[robot][k] = P
    return poses, covariances


def _read_landmarks(folder: Path, frames: int) -> LandmarkHistory | None:
    if not (folder / "map.csv").exists():
        return None
    table, (lines, seen) = read_table(folder / "map.csv", MAP), read_numbered_table(folder / "sightings.csv", SIGHTINGS)
    positions = dict(zip(table["landmark"].tolist(), np.column_stack([table[c] for c in ("tx", "ty", "tz")]), strict=True))
    listed: list[dict[str, list[int]]] = [{} for _ in range(frames)]
    for line, k, robot, n in zip(lines, *(seen[c].tolist() for c in SIGHTINGS), strict=True):
        if not 0 <= k < frames or n not in positions:
            raise ValueError(f"{folder / 'sightings.csv'}:{line}: landmark {n} in frame {k}, needs one of map.csv and frames from 0 to {frames - 1}")
        listed[k].setdefault(robot, []).append(n)
    sighted = tuple({robot: np.array(ids, dtype=np.int64) for robot, ids in by.items()} for by in listed)
    return LandmarkHistory(positions, table["landmark"][table["final"] == 1], sighted)
