"""Replay of given paths of people, such as annotated ones, with the interface of a crowd.

Annotated positions have errors of centimetres from frame to frame. A Savitzky–Golay filter smooths them
(Savitzky and Golay 1964; a parabola over WINDOW s). A cubic spline then gives position and velocity at any time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.crowd.crowd import COLUMNS, CrowdState, Obstacles
from sim.crowd.social_force import GOAL, HEADING, PRESENT, TURN_RATE, VX, X
from tracker.geometry import Array, frozen, wrap
from worlds.terrain.free_space import FEET, FreeSpace

WINDOW = 1.2
"""s: about one stride, and short compared with a turn."""
TURNING_SPEED = 0.3
"""m/s: the heading of slower people stays constant."""


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths of m people: ids (m,), times (frames,) s at even steps, position (m, frames, 2) m, NaN while absent; stature (m,) m or None.

    Raises ValueError for inconsistent shapes, ids that are below 1 or repeated, uneven times, and people without any position.
    """

    ids: NDArray[np.int64]
    times: Array
    position: Array
    stature: Array | None = None

    def __post_init__(self) -> None:
        ids, position = np.array(self.ids, dtype=np.int64), np.array(self.position, dtype=np.float64)
        times = frozen(self.times, (None,), "times")
        if ids.ndim != 1 or position.shape != (len(ids), len(times), 2) or not len(times):
            raise ValueError(f"position has shape {position.shape}, needs ({len(ids)}, {len(times)}, 2) by ids and times, and one time at least")
        if len(np.unique(ids)) < len(ids) or ids.min(initial=1) < 1:
            raise ValueError(f"ids are {ids.tolist()}, need to be different and at least 1")
        if np.isinf(position).any():
            raise ValueError("position holds infinite values, needs finite ones, and NaN where a person is absent")
        steps = np.diff(times)
        if len(steps) and (steps.min() <= 0 or np.ptp(steps) > 1e-6):
            raise ValueError(f"times step by {steps.min():g} to {steps.max():g} s, need one step above 0")
        never = np.asarray(np.isnan(position).any(axis=2)).all(axis=1)
        if never.any():
            raise ValueError(f"person {ids[np.argmax(never)]} has no position in any of {len(times)} frames, needs one")
        position.flags.writeable = ids.flags.writeable = False
        for name, value in (("ids", ids), ("times", times), ("position", position)):
            object.__setattr__(self, name, value)
        if self.stature is not None:
            object.__setattr__(self, "stature", frozen(self.stature, (len(ids),), "stature"))


@dataclass(frozen=True, eq=False)
class _Walk:
    """A segment of a path without gaps: row of its person, first and last time s, spline of the position, None for a single frame."""

    row: int
    first: float
    last: float
    place: Array
    spline: CubicSpline | None

    def at(self, time: float) -> tuple[Array, Array]:
        """Position (2,) m and velocity (2,) m/s."""
        if self.spline is None:
            return self.place[0], np.zeros(2)
        t = min(max(time, self.first), self.last)
        return self.spline(t), self.spline(t, 1)


@dataclass(frozen=True, eq=False)
class Replay:
    """Paths in a world, with the interface of a crowd. People keep to their paths, so that robots have to give way.

    Raises ValueError that names person, frame, time and position where a path leaves the world or enters a wall or an obstacle.
    """

    paths: Paths
    free_space: FreeSpace

    def __post_init__(self) -> None:
        position = self.paths.position
        rows, frames = np.nonzero(~np.isnan(position).any(axis=2))
        places = position[rows, frames]
        size = np.array(self.free_space.free.shape[::-1]) - 1
        beyond = np.maximum(self.free_space.origin - places, places - self.free_space.origin - self.free_space.spacing * size).max(
            axis=1, initial=-np.inf
        )
        outside = beyond > 0
        # Free space is eroded by the half width of a body.
        walled = self.free_space.clearance_at(places) < -FEET.half_width
        if (outside | walled).any():
            k = int(np.argmax(outside | walled))
            fault = "is outside the world" if outside[k] else "is inside a wall or an obstacle"
            x, y = places[k]
            who, time = self.paths.ids[rows[k]], self.paths.times[frames[k]]
            raise ValueError(f"person {who} at frame {frames[k]} ({time:.2f} s) {fault}: ({x:.2f}, {y:.2f}) m, needs free ground")

    def start(self) -> CrowdState:
        """State at the first time, with people facing their first direction of motion."""
        body = np.zeros((len(self.paths.ids), COLUMNS))
        for walk in reversed(self._walks):
            body[walk.row, X : X + 2] = walk.at(walk.first)[0]
            body[walk.row, HEADING] = _facing(walk)
        return self._moved(body, float(self.paths.times[0]))

    def step(self, state: CrowdState, obstacles: Obstacles, dt: float) -> CrowdState:
        """The state `dt` s later. Obstacles have no effect."""
        time = state.time + dt
        moved = self._moved(state.body.copy(), time).body.copy()
        speed = np.hypot(moved[:, VX], moved[:, VX + 1])
        towards = np.where(speed > TURNING_SPEED, np.arctan2(moved[:, VX + 1], moved[:, VX]), moved[:, HEADING])
        turn = np.clip(wrap(towards - moved[:, HEADING]), -TURN_RATE * dt, TURN_RATE * dt)
        moved[:, HEADING] = np.where(state.present, wrap(moved[:, HEADING] + turn), moved[:, HEADING])
        return CrowdState(moved, time, state.entered)

    def _moved(self, body: Array, time: float) -> CrowdState:
        """All people at their positions at `time` s. New people face their first direction of motion."""
        present = body[:, PRESENT] > 0
        body[:, PRESENT] = body[:, VX] = body[:, VX + 1] = body[:, GOAL] = 0.0
        for walk in self._walks:
            if walk.first - 1e-6 <= time <= walk.last + 1e-6:
                body[walk.row, X : X + 2], body[walk.row, VX : VX + 2] = walk.at(time)
                body[walk.row, PRESENT] = 1.0
                if not present[walk.row]:
                    body[walk.row, HEADING] = _facing(walk)
        return CrowdState(body, time, len(body))

    @cached_property
    def _walks(self) -> list[_Walk]:
        """All segments of the paths, by person and time."""
        times, walks = self.paths.times, []
        for row, path in enumerate(self.paths.position):
            seen = np.flatnonzero(np.isfinite(path).all(axis=1))
            for frames in np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1):
                place = _smoothed(path[frames], times)
                spline = CubicSpline(times[frames], place) if len(frames) > 1 else None
                walks.append(_Walk(row, float(times[frames[0]]), float(times[frames[-1]]), place, spline))
        return walks


def _smoothed(place: Array, times: Array) -> Array:
    """Smoothed positions (n, 2) m. One parabola fits a path that is shorter than WINDOW. Fits to fewer than five frames are omitted."""
    n = len(place)
    step = times[1] - times[0] if len(times) > 1 else 1.0
    window = min(2 * round(WINDOW / step / 2) + 1, n - 1 + n % 2)
    if window < 4:
        return place
    # This import takes a second, which crowds without replay are spared.
    from scipy.signal import savgol_filter

    return np.asarray(savgol_filter(place, window, 2, axis=0))


def _facing(walk: _Walk) -> float:
    """rad: first direction of motion faster than TURNING_SPEED; 0 if there is none."""
    for time in np.linspace(walk.first, walk.last, 32):
        vx, vy = walk.at(float(time))[1]
        if np.hypot(vx, vy) > TURNING_SPEED:
            return float(np.arctan2(vy, vx))
    return 0.0
