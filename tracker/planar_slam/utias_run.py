"""A whole UTIAS set through the planar filter: track it into a folder, and score what lies there."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from tracker.formats.utias import read_team
from tracker.geometry import Array
from tracker.io.resume import check_same, holds, json_value
from tracker.planar_slam.event_schedule import FilterInput, PlanarParameters, filter_input, run_filter
from tracker.planar_slam.filter import MATCHED, OUTLIER, REOPENED, ROBOT, SCAN, STARTED
from tracker.planar_slam.motion_model import Sensors
from tracker.planar_slam.trajectories import Paths, read_paths, score_paths, write_paths
from tracker.sequence.results import RUN


def track_utias(source: Path, folder: Path, known_map: bool, parameters: PlanarParameters | None = None) -> Paths:
    """Track the set in `source` and write its paths to `folder`, or read them where the same run is there already.

    Raises ValueError where the set is damaged, the filter diverges, or `folder` holds another run.
    """
    parameters, sensors = parameters or PlanarParameters(), Sensors()
    told = {"map": "known" if known_map else "unknown", "parameters": parameters, "sensors": sensors, "provenance": _sums(source)}
    run = json_value(told)
    if holds(folder, RUN):
        there = read_paths(folder)
        check_same(folder, there.run, run)
        return there
    team = read_team(source)
    out = filter_input(team, sensors, known_map, parameters.correction)
    path, spread = run_filter(out.state, parameters.rule(), out.course)
    counters = {"matched": MATCHED, "outlier": OUTLIER, "reopened": REOPENED, "landmark started": STARTED}
    counted = {name: int(out.state.tally[k]) for name, k in counters.items()} | out.unused
    paths = _paths(out, path, spread, run | {"counters": counted, "mended": list(team.mended), "corrections": _corrections(out)})
    write_paths(folder, paths)
    return paths


def evaluate_paths(source: Path, folder: Path) -> dict[str, Any]:
    """The scores as JSON values: robots, and dead_reckoning, which is the odometry by the same sensor model alone."""
    paths, team = read_paths(folder), read_team(source)
    if paths.run.get("provenance") != _sums(source):
        raise ValueError("these results were made from another source, or from other files of it")
    out = filter_input(team, Sensors(), False, False)
    blind = out.course.kind != SCAN
    course = out.course._replace(**{name: getattr(out.course, name)[blind] for name in ("kind", "robot", "item", "time")})
    path, spread = run_filter(out.state, PlanarParameters().rule(), course)
    alone = score_paths(team, _paths(out, path, spread, {}))
    return {"targets": None, "everybody": None, "robots": score_paths(team, paths), "dead_reckoning": {"ate_m": alone["ate_m"]}}


def _paths(out: FilterInput, path: Array, spread: Array, run: dict[str, Any]) -> Paths:
    first = ROBOT * len(out.robots)
    found = {s: out.state.mean[first + 2 * k : first + 2 * k + 2] for k, s in enumerate(out.subjects) if out.state.known[k]}
    poses, covariances = ({n: table[:, i] for i, n in enumerate(out.robots)} for table in (path, spread))
    return Paths(out.times, poses, covariances, found, run)


def _corrections(out: FilterInput) -> dict[str, dict[str, float]]:
    """What was found out about each robot's sensors, at the end."""
    names = ("bearing_rad", "range_m", "range_share", "speed_share", "turn_share")
    values = out.state.mean[: ROBOT * len(out.robots)].reshape(-1, ROBOT)[:, 3:]
    return {str(n): dict(zip(names, np.round(row, 5).tolist(), strict=True)) for n, row in zip(out.robots, values, strict=True)}


def _sums(source: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(source.glob("*.dat"))}
