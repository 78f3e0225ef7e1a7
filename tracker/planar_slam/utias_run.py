"""A run of the planar filter on a UTIAS data set into a folder, and its scores."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Array
from tracker.io.atomic import write_or_rescue
from tracker.io.resume import check_same, checksums, holds_run, json_value, same_or_new
from tracker.planar_slam.event_schedule import FilterInput, PlanarParameters, filter_input, run_filter
from tracker.planar_slam.filter import INFLATED, MATCHED, OUTLIER, ROBOT, SCAN, STARTED
from tracker.planar_slam.motion_model import Sensors
from tracker.planar_slam.trajectories import PlanarTrajectories, read_trajectories, score_trajectories, write_trajectories
from tracker.planar_slam.utias_files import UtiasDataset, read_utias
from tracker.sequence.results import RUN


def track_utias(source: Path, folder: Path, known_map: bool, parameters: PlanarParameters | None = None) -> PlanarTrajectories:
    """Track the data set in `source` and write the trajectories to `folder`, or read them if the same run is there.

    Raises ValueError if the data set is damaged, the filter diverges, `folder` holds another run, or another process writes into it.
    Raises Kept where the trajectories cannot be written there, with the place where they are instead.
    """
    parameters, sensors = parameters or PlanarParameters(), Sensors()
    described = {"map": "known" if known_map else "unknown", "parameters": parameters, "sensors": sensors, "provenance": _checksums(source)}
    run = json_value(described)
    return same_or_new(folder, lambda: _same_run(folder, run), lambda: _new_run(source, folder, run, parameters))


def _same_run(folder: Path, run: dict[str, Any]) -> PlanarTrajectories | None:
    """The trajectories of the same run in a folder; None where it holds none. Raises ValueError where it holds another one."""
    if not holds_run(folder, RUN):
        return None
    there = read_trajectories(folder)
    check_same(folder, there.run, run)
    return there


def _new_run(source: Path, folder: Path, run: dict[str, Any], parameters: PlanarParameters) -> PlanarTrajectories:
    """Track the data set and write the trajectories into a folder without content."""
    known_map = run["map"] == "known"
    team = read_utias(source)
    out = _filter_input(source, team, known_map, parameters.correction)
    path, spread = run_filter(out.state, parameters.settings(), out.schedule)
    counters = {"matched": MATCHED, "outlier": OUTLIER, "reopened": INFLATED, "landmark started": STARTED}
    counted = {name: int(out.state.counts[k]) for name, k in counters.items()} | out.unused
    paths = _paths(out, path, spread, run | {"counters": counted, "mended": [*team.repairs, *out.left_out], "corrections": _corrections(out)})
    write_or_rescue(folder, lambda place: write_trajectories(place, paths))
    return paths


def evaluate_trajectories(source: Path, folder: Path) -> dict[str, Any]:
    """The scores as JSON values: robots, and dead_reckoning, which is integrated odometry with the same motion model.

    Raises ValueError if the results belong to another data set.
    """
    paths, team = read_trajectories(folder), read_utias(source)
    if paths.run.get("provenance") != _checksums(source):
        raise ValueError(f"{folder}, scored against {source}: these results were made from another source, or from other files of it")
    out = _filter_input(source, team, False, False)
    without_scans = out.schedule.kind != SCAN
    schedule = out.schedule._replace(**{name: getattr(out.schedule, name)[without_scans] for name in ("kind", "robot", "item", "time")})
    path, spread = run_filter(out.state, PlanarParameters().settings(), schedule)
    alone = score_trajectories(team, _paths(out, path, spread, {}))
    return {"targets": None, "everybody": None, "robots": score_trajectories(team, paths), "dead_reckoning": {"ate_m": alone["ate_m"]}}


def _filter_input(source: Path, team: UtiasDataset, known_map: bool, correction: bool) -> FilterInput:
    """As filter_input, with the path in errors."""
    try:
        return filter_input(team, Sensors(), known_map, correction)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def _paths(out: FilterInput, path: Array, spread: Array, run: dict[str, Any]) -> PlanarTrajectories:
    first = ROBOT * len(out.robots)
    found = {s: out.state.mean[first + 2 * k : first + 2 * k + 2] for k, s in enumerate(out.subjects) if out.state.initialized[k]}
    poses, covariances = ({n: table[:, i] for i, n in enumerate(out.robots)} for table in (path, spread))
    return PlanarTrajectories(out.times, poses, covariances, found, run)


def _corrections(out: FilterInput) -> dict[str, dict[str, float]]:
    """The final estimates of each robot's correction factor and scale errors."""
    names = ("bearing_rad", "range_m", "range_share", "speed_share", "turn_share")
    values = out.state.mean[: ROBOT * len(out.robots)].reshape(-1, ROBOT)[:, 3:]
    return {str(n): dict(zip(names, np.round(row, 5).tolist(), strict=True)) for n, row in zip(out.robots, values, strict=True)}


def _checksums(source: Path) -> dict[str, str]:
    return checksums(source, sorted(source.glob("*.dat")))
