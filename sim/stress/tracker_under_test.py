"""The tracker under test: pilsim's own with options, a function by its name, or tracks that were made elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tracker.geometry import Pose
from tracker.io.mot15 import place_of_row, read_mot15
from tracker.options import load_function, parameters_from
from tracker.pipeline import track
from tracker.sequence.results import Results
from tracker.types import Estimate, Setup, Tick

TrackFunction = Callable[..., Iterable[Estimate]]
"""A function of a setup, its ticks, and keyword arguments, which are parameters that `pilsim tune` may choose."""
PARAMETERS = "parameters"
"""The option with values by name: fields of pilsim's own tracker by path, or keyword arguments of a function."""


@dataclass(frozen=True)
class TrackerUnderTest:
    """One of three kinds of trackers. Raises ValueError where kinds are mixed, and for unknown options.

    function: module:function of a function like tracker.pipeline.track, or "" for pilsim's own. options: of pilsim's own, by the names of
    `pilsim track`; a function has PARAMETERS alone. results: a folder of tracks made elsewhere, ID/SEED.txt in MOT15 with x, y, z, or "".
    """

    function: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    results: str = ""

    def __post_init__(self) -> None:
        if self.function and self.results:
            raise ValueError("--tracker and --results exclude each other")
        if others := [name for name in self.options if self.results or (self.function and name != PARAMETERS)]:
            raise ValueError(f"options {', '.join(others)} are of the default tracker, not of {self.name}")
        if not self.function:
            parameters_from(self.options)

    @property
    def name(self) -> str:
        """Its name in the results."""
        return self.function or (Path(self.results).name if self.results else "default")

    def with_options(self, options: dict[str, Any]) -> TrackerUnderTest:
        """The tracker with the options of a case, which override its own. Only pilsim's own tracker has options."""
        return self if self.function or self.results else replace(self, options=self.options | options)

    @property
    def solves_graphs(self) -> bool:
        """Whether it selects tracks by maximum weight cliques."""
        return not self.function and not self.results

    def results_of(self, setup: Setup, ticks: list[Tick], run: str, graphs: Path | None = None) -> Results:
        """Track the ticks. run: ID/SEED of the case. graphs: folder for the graphs that it solves.

        Raises the errors of the tracker, and ValueError where its estimates are not valid.
        """
        if self.results:
            return _read_tracks(Path(self.results) / f"{run}.txt", len(ticks))
        return Results.of(self.estimates(setup, ticks, graphs), {})

    def estimates(self, setup: Setup, ticks: list[Tick], graphs: Path | None = None) -> list[Estimate]:
        """As `results_of`, one Estimate a tick. Not for tracks that were made elsewhere."""
        if self.function:
            return check_estimates(self.name, load_tracker(self.function)(setup, ticks, **self.options.get(PARAMETERS, {})), setup, ticks)
        parameters = parameters_from(self.options)
        if graphs is not None:
            parameters = replace(parameters, graphs=graphs)
        return check_estimates(self.name, track(setup, ticks, parameters), setup, ticks)


def load_tracker(function: str) -> TrackFunction:
    """Import module:function. Raises ValueError as load_function."""
    imported: TrackFunction = load_function(function, "--tracker")
    return imported


def check_estimates(name: str, estimates: Iterable[Estimate], setup: Setup, ticks: list[Tick]) -> list[Estimate]:
    """The estimates, one a tick. Raises ValueError naming the frame where an estimate is missing or not valid."""
    out: list[Estimate] = []
    for estimate in estimates:
        if len(out) == len(ticks):
            raise ValueError(f"tracker {name} gave more than {len(ticks)} estimates, needs one a frame")
        index = ticks[len(out)].index
        if not isinstance(estimate, Estimate):
            raise ValueError(f"tracker {name} gave a {type(estimate).__name__} for frame {index}, needs an Estimate")
        if estimate.index != index:
            raise ValueError(f"tracker {name} gave frame {estimate.index}, needs frame {index} next")
        if len(np.unique(estimate.target_id)) != len(estimate.target_id):
            raise ValueError(f"tracker {name} gave a target twice in frame {index}")
        for robot in setup.starts:
            covariance = estimate.robot_covariance.get(robot)
            if not isinstance(estimate.T_world_robot.get(robot), Pose) or covariance is None or np.shape(covariance) != (6, 6):
                raise ValueError(f"tracker {name} gave no pose and covariance (6, 6) of {robot} in frame {index}")
        out.append(estimate)
    if len(out) < len(ticks):
        raise ValueError(f"tracker {name} gave {len(out)} estimates, needs {len(ticks)}")
    return out


def _read_tracks(path: Path, frames: int) -> Results:
    """Read tracks that were made elsewhere. Raises ValueError for rows without positions, and for frames beyond the run."""
    rows = read_mot15(path, tracks=True)
    if not rows.has_position.all():
        raise ValueError(f"{place_of_row(path, int(np.argmin(rows.has_position)))}: has no x, y, z")
    if len(rows) and rows.frame.max() > frames:
        raise ValueError(f"{path}: frame is {rows.frame.max()}, needs at most {frames}")
    tracks = {frame - 1: (rows.id[k], rows.position[k]) for frame, k in rows.by_frame().items()}
    return Results(frames, tracks, {}, {}, run={})
