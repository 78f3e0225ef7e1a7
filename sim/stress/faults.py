"""What goes wrong between the sensors and the tracker: views that drop out, late clocks, slipping wheels, a robot carried away, a terrain that is
not well known. Applied to what was recorded, so that the same run can be tracked with and without.
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
"""m between the known heights of a coarsely known terrain."""
SPELL = 5
"""Ticks that a view stays away, on average."""


@dataclass(frozen=True)
class Faults:
    """dropout: share of ticks at which a view is away, in spells; skew: ticks by which every second robot is late; slip: standard deviation of a
    robot's lasting error of odometry, as a share of the way (and half of it anew at each tick); kidnapped s: the first robot is carried for so
    long in mid-run, blind, while its wheels stand still; terrain: what is known of it: exact; coarse, heights every 2 m and nothing of what stands
    there; flat, the mean height of the starts; none, z = 0.
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
        """What differs from no trouble at all."""
        none = asdict(Faults())
        return {name: value for name, value in asdict(self).items() if value != none[name]}

    def told(self, setup: Setup) -> Setup:
        """The setup as the tracker is told it."""
        if self.terrain == "exact":
            return setup
        return replace(setup, ground=_known(setup, self.terrain), occluders=None)

    def sent(self, setup: Setup, ticks: Sequence[Tick], seed: int) -> list[Tick]:
        """The ticks as they reach the tracker; draws of one trouble do not move those of another."""
        out = list(ticks)
        if self.skew:
            out = _late(setup, out, self.skew)
        if self.slip:
            out = _slipping(setup, out, self.slip, seed)
        if self.dropout:
            out = _dropping(setup, out, self.dropout, seed)
        if self.kidnapped:
            out = _carried(setup, out, round(self.kidnapped / setup.period))
        return out


def _stream(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def _known(setup: Setup, terrain: str) -> Ground:
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
    """The view with nothing in it but its odometry."""
    return View(view.camera, Detections.none(), odometry=view.odometry)


def _late(setup: Setup, ticks: list[Tick], by: int) -> list[Tick]:
    """Views of every second robot as they were `by` ticks before, at the first ticks as at the first of all."""
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


def _slipping(setup: Setup, ticks: list[Tick], slip: float, seed: int) -> list[Tick]:
    streams = {robot: _stream(seed, f"{robot}/slip") for robot in setup.starts}
    lasting = {robot: rng.normal(0.0, slip) for robot, rng in streams.items()}

    def worse(view: View) -> View:
        if view.odometry is None:
            return view
        robot = setup.mounts[view.camera].robot
        share = 1.0 + lasting[robot] + streams[robot].normal(0.0, slip / 2)
        motion = view.odometry.T_before_now
        return replace(view, odometry=replace(view.odometry, T_before_now=Pose(motion.rotation, motion.translation * share)))

    return [replace(tick, views=tuple(worse(view) for view in tick.views)) for tick in ticks]


def _dropping(setup: Setup, ticks: list[Tick], share: float, seed: int) -> list[Tick]:
    """Spells of SPELL ticks on average, as a chain of two states whose share of absence is `share`."""
    away = {}
    for camera in setup.mounts:
        draws = _stream(seed, f"{camera}/dropout").random(len(ticks) + 1)
        gone, spells = bool(draws[0] < share), []
        for draw in draws[1:]:
            spells.append(gone)
            gone = bool(draw >= 1 / SPELL) if gone else bool(draw < share / max(1e-9, 1 - share) / SPELL)
        away[camera] = spells
    return [replace(tick, views=tuple(_blind(v) if away[v.camera][k] else v for v in tick.views)) for k, tick in enumerate(ticks)]


def _carried(setup: Setup, ticks: list[Tick], length: int) -> list[Tick]:
    """From the middle of the run on the first robot's odometry says for `length` ticks that it stands, and its cameras see nothing."""
    robot, first = next(iter(setup.starts)), len(ticks) // 2

    def still(view: View) -> View:
        if setup.mounts[view.camera].robot != robot or view.odometry is None:
            return view
        return replace(_blind(view), odometry=replace(view.odometry, T_before_now=Pose.identity()))

    return [replace(t, views=tuple(still(v) for v in t.views)) if first <= k < first + length else t for k, t in enumerate(ticks)]
