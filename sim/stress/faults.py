"""Fault injection: view dropout, clock skew, wheel slip, a kidnapped robot, and poor knowledge of the terrain.

Faults change recorded ticks and the setup, so that the same run can be tracked with and without them.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tracker.geometry import Pose
from tracker.geometry.ground import Flat, Grid, Ground
from tracker.types import Detections, Setup, Tick, View

KNOWLEDGE = ("exact", "coarse", "flat", "none")
COARSE = 2.0
"""Grid spacing of a coarsely known terrain, m."""
DROPOUT_TICKS = 5
"""Mean number of consecutive ticks without a view."""


@dataclass(frozen=True)
class Faults:
    """The faults of a case.

    dropout: the share of ticks without a view, in runs of DROPOUT_TICKS on average. skew: delay of every second robot, ticks. slip: standard
    deviation of a robot's constant odometry error, as a share of the distance; half of it is added anew at each tick. kidnapped: time for which the
    first robot is carried in mid-run, s; its cameras see nothing and its wheels stand still.

    terrain: the knowledge of the ground. "exact"; "coarse", heights every 2 m without occluders; "flat", the mean height of starts; "none", z = 0.
    """

    dropout: float = 0.0
    skew: int = 0
    slip: float = 0.0
    kidnapped: float = 0.0
    terrain: str = "exact"

    def __post_init__(self) -> None:
        for name, high in (("dropout", 1.0), ("skew", 100), ("slip", 10.0), ("kidnapped", 1e6)):
            if not 0 <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name)}, needs 0 to {high:g}")
        if self.terrain not in KNOWLEDGE:
            raise ValueError(f"terrain is {self.terrain!r}, needs one of {', '.join(KNOWLEDGE)}")

    def to_dict(self) -> dict[str, Any]:
        """The fields that differ from their defaults."""
        none = asdict(Faults())
        return {name: value for name, value in asdict(self).items() if value != none[name]}

    def degraded_setup(self, setup: Setup) -> Setup:
        """The setup that the tracker gets."""
        if self.terrain == "exact":
            return setup
        return replace(setup, ground=_known_ground(setup, self.terrain), occluders=None)

    def degraded_ticks(self, setup: Setup, ticks: Sequence[Tick], seed: int) -> list[Tick]:
        """The ticks that the tracker gets. Each fault has random streams of its own."""
        out = list(ticks)
        if self.skew:
            out = _delay(setup, out, self.skew)
        if self.slip:
            out = _add_slip(setup, out, self.slip, seed)
        if self.dropout:
            out = _drop_views(setup, out, self.dropout, seed)
        if self.kidnapped:
            out = _kidnap(setup, out, round(self.kidnapped / setup.period))
        return out


def _stream(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def _known_ground(setup: Setup, terrain: str) -> Ground:
    ground = setup.ground
    if terrain == "coarse" and isinstance(ground, Grid):
        rows, columns = ground.heights.shape
        wide = np.array([columns - 1, rows - 1]) * ground.spacing
        x, y = (np.arange(max(2, int(np.ceil(w / COARSE)) + 1)) * COARSE + low for w, low in zip(wide, ground.origin, strict=True))
        places = np.stack(np.meshgrid(x, y), axis=-1)
        return Grid(ground.height_at(places.reshape(-1, 2)).reshape(len(y), len(x)), ground.origin, COARSE)
    if terrain == "flat":
        places = np.array([start.T_world_robot.translation for start in setup.starts.values() if start is not None]).reshape(-1, 3)
        return Flat(float(ground.height_at(places).mean()) if len(places) else 0.0)
    return Flat(0.0)


def _blind(view: View) -> View:
    """The view with its odometry only."""
    return View(view.camera, Detections.none(), odometry=view.odometry)


def _delay(setup: Setup, ticks: list[Tick], by: int) -> list[Tick]:
    """Views of every second robot from `by` ticks before; the first ticks repeat the first view."""
    robots = list(setup.starts)
    out = []
    for k, tick in enumerate(ticks):
        views = []
        for view in tick.views:
            late = robots.index(setup.mounts[view.camera].robot) % 2
            before = ticks[max(k - by * late, 0)]
            views.append(next((v for v in before.views if v.camera == view.camera), _blind(view)))
        out.append(replace(tick, views=tuple(views)))
    return out


def _add_slip(setup: Setup, ticks: list[Tick], slip: float, seed: int) -> list[Tick]:
    streams = {robot: _stream(seed, f"{robot}/slip") for robot in setup.starts}
    constant = {robot: rng.normal(0.0, slip) for robot, rng in streams.items()}

    def worse(view: View) -> View:
        if view.odometry is None:
            return view
        robot = setup.mounts[view.camera].robot
        share = 1.0 + constant[robot] + streams[robot].normal(0.0, slip / 2)
        motion = view.odometry.T_before_now
        return replace(view, odometry=replace(view.odometry, T_before_now=Pose(motion.rotation, motion.translation * share)))

    return [replace(tick, views=tuple(worse(view) for view in tick.views)) for tick in ticks]


def _drop_views(setup: Setup, ticks: list[Tick], share: float, seed: int) -> list[Tick]:
    """Dropout as a Markov chain of two states. Views are absent for DROPOUT_TICKS on average, and for `share` of all ticks."""
    away = {}
    for camera in setup.mounts:
        draws = _stream(seed, f"{camera}/dropout").random(len(ticks) + 1)
        gone, absent = bool(draws[0] < share), []
        for draw in draws[1:]:
            absent.append(gone)
            gone = bool(draw >= 1 / DROPOUT_TICKS) if gone else bool(draw < share / max(1e-9, 1 - share) / DROPOUT_TICKS)
        away[camera] = absent
    return [replace(tick, views=tuple(_blind(v) if away[v.camera][k] else v for v in tick.views)) for k, tick in enumerate(ticks)]


def _kidnap(setup: Setup, ticks: list[Tick], length: int) -> list[Tick]:
    """From the middle of the run on, the odometry of the first robot is zero for `length` ticks, and its cameras see nothing."""
    robot, first = next(iter(setup.starts)), len(ticks) // 2

    def still(view: View) -> View:
        if setup.mounts[view.camera].robot != robot or view.odometry is None:
            return view
        return replace(_blind(view), odometry=replace(view.odometry, T_before_now=Pose.identity()))

    return [replace(t, views=tuple(still(v) for v in t.views)) if first <= k < first + length else t for k, t in enumerate(ticks)]
