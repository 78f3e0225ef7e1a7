"""How a rover drives by itself: from goal to goal on shortest ways, giving way to people and to other robots.

Following a way: pure pursuit (Coulter 1992, Implementation of the Pure Pursuit Path Tracking Algorithm).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from sim.rover import FOOTPRINT_RADIUS
from tracker.geometry import Array, frozen, wrap
from worlds.walkable import Walkable

TOP_SPEED, TOP_YAW_RATE = 0.7, 0.8
"""m/s and rad/s."""
ACCELERATION, YAW_ACCELERATION = 0.6, 1.6
"""m/s² and rad/s²: gentle enough for the mast."""
LOOKAHEAD = 0.6
"""m along the way to the point that is aimed at."""
ARRIVED = 0.5
TURNING_ROOM = 0.2
"""m between the half width for which wheels are free and the circle that a rover turns in."""
HALF_LANE = 0.37
"""m: half the width of what the rover sweeps ahead, with some room."""
PATIENCE, RETREAT = 2.0, 1.6
"""s without getting on before it backs up, s of backing up."""
_DETOURS = np.array([0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2])
"""rad off the wanted heading, in the order in which they are tried."""


@dataclass(frozen=True, eq=False)
class Motion:
    """How a rover moves now: position (2,) m, yaw rad, speed m/s ahead, yaw_rate rad/s."""

    position: Array
    yaw: float
    speed: float
    yaw_rate: float


@dataclass(frozen=True, eq=False)
class Traffic:
    """Who else is about: position (k, 2) m, radius (k,) m."""

    position: Array
    radius: Array


@dataclass(frozen=True, eq=False)
class Drive:
    """The plan of one rover: route (k, 2) m, passed m of it; visit, how many goals are behind it; the command speed m/s and yaw_rate rad/s that
    it follows; stuck s, retreat s still to back up."""

    route: Array
    passed: float
    visit: int
    speed: float
    yaw_rate: float
    stuck: float
    retreat: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "route", frozen(self.route, (None, 2), "route"))


@dataclass(frozen=True, eq=False)
class Driver:
    """Where one rover may go, wheels, and wants to, goals (g, 2) m, one after the other and again."""

    wheels: Walkable
    goals: Array

    def start(self, position: Array) -> Drive:
        return Drive(self._route(position, 0), 0.0, 0, 0.0, 0.0, 0.0, 0.0)

    def step(self, drive: Drive, motion: Motion, traffic: Traffic, dt: float) -> Drive:
        """The plan `dt` s later; its speed and yaw_rate are what the wheels are to do now."""
        if np.hypot(*(drive.route[-1] - motion.position)) < ARRIVED:
            drive = self._next(drive, motion)
        if drive.retreat > 0:
            return self._retreat(drive, motion, traffic, dt)
        drive = replace(drive, passed=_passed(drive.route, drive.passed, motion.position))
        aim = _along(drive.route, np.array([drive.passed + LOOKAHEAD]))[0]
        distance = max(float(np.hypot(*(aim - motion.position))), 0.2)
        error = float(wrap(self._way_round(motion, math.atan2(*(aim - motion.position)[::-1]), traffic) - motion.yaw))
        speed = TOP_SPEED * max(math.cos(error), 0.0) ** 2 if abs(error) < 1.0 else 0.0
        free = min(speed, _free_speed(motion, traffic, 1.0))
        turn = 2 * free * math.sin(error) / distance if speed else math.copysign(0.6, error)
        drive = _towards(drive, free, float(np.clip(turn, -TOP_YAW_RATE, TOP_YAW_RATE)), dt)
        waits = min(free, abs(motion.speed)) < 0.25 * speed if speed else abs(motion.yaw_rate) < 0.1
        stuck = drive.stuck + dt if waits else max(drive.stuck - dt, 0.0)
        if stuck > PATIENCE:
            return replace(drive, stuck=0.0, retreat=RETREAT)
        return replace(drive, stuck=stuck)

    def _way_round(self, motion: Motion, wanted: float, traffic: Traffic) -> float:
        """The heading nearest to the wanted one that is clear of others for a while and stays in the room; the wanted one where none is."""
        headings = wanted + _DETOURS
        ahead = np.column_stack([np.cos(headings), np.sin(headings)])
        clear = _gap(motion.position, headings, traffic) > 0.8
        for reach in (0.5, 1.0):
            clear[1:] &= self.wheels.free_at(motion.position + reach * ahead[1:])
        return float(headings[int(np.argmax(clear))])

    def _retreat(self, drive: Drive, motion: Motion, traffic: Traffic, dt: float) -> Drive:
        """Back up with a turn, as far as there is room, then go elsewhere."""
        behind = motion.position - 0.4 * np.array([math.cos(motion.yaw), math.sin(motion.yaw)])
        room = self.wheels.clearance_at(behind[None])[0] > min(0.0, self.wheels.clearance_at(motion.position[None])[0])
        speed = -min(0.3, _free_speed(motion, traffic, -1.0)) if room else 0.0
        drive = _towards(drive, speed, 0.5 if drive.visit % 2 else -0.5, dt)
        left = drive.retreat - dt
        return self._next(replace(drive, retreat=0.0), motion) if left <= 0 else replace(drive, retreat=left)

    def _next(self, drive: Drive, motion: Motion) -> Drive:
        return replace(drive, route=self._route(motion.position, drive.visit + 1), passed=0.0, visit=drive.visit + 1)

    def _route(self, position: Array, visit: int) -> Array:
        start = position
        if not self.wheels.free_at(position[None])[0]:
            i, j = np.nonzero(self.wheels.free)
            nodes = self.wheels.origin + self.wheels.spacing * np.stack([j, i], axis=1)
            start = nodes[int(np.argmin(((nodes - position) ** 2).sum(axis=1)))]
        return self.wheels.route(start, self.goals[visit % len(self.goals)])


def make_driver(room: Walkable, rng: np.random.Generator) -> Driver:
    """A driver with eight goals of its own in this room. Raises ValueError where nothing is free."""
    return Driver(room, np.concatenate([room.sample(rng, 1, 0.1, 0.0) for _ in range(8)]))


def room_to_turn(wheels: Walkable) -> Walkable:
    """The part of free space, in one piece, in which a rover can turn on the spot: up to TURNING_ROOM m off its border.

    Where that would cost more than half of the area, as in a world of narrow passages, the room is taken less wide.
    """
    for margin in (TURNING_ROOM, 0.5 * TURNING_ROOM):
        labels, count = ndimage.label(wheels.clearance > margin)
        if count:
            largest = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
            if largest.sum() > 0.5 * wheels.free.sum():
                return Walkable(largest, wheels.origin, wheels.spacing)
    return wheels


def _towards(drive: Drive, speed: float, yaw_rate: float, dt: float) -> Drive:
    """The command moved towards this one as far as the accelerations allow; braking may be twice as hard."""
    brake = 2.0 if abs(speed) < abs(drive.speed) else 1.0
    dv, dw = brake * ACCELERATION * dt, YAW_ACCELERATION * dt
    return replace(
        drive,
        speed=drive.speed + float(np.clip(speed - drive.speed, -dv, dv)),
        yaw_rate=drive.yaw_rate + float(np.clip(yaw_rate - drive.yaw_rate, -dw, dw)),
    )


def _free_speed(motion: Motion, traffic: Traffic, direction: float) -> float:
    """m/s that leaves time to stop before whoever is in the lane, ahead (direction 1) or behind (−1)."""
    yaw = motion.yaw if direction > 0 else motion.yaw + math.pi
    return float(np.clip(0.8 * (_gap(motion.position, np.array([yaw]), traffic)[0] - 0.25), 0.0, TOP_SPEED))


def _gap(position: Array, headings: Array, traffic: Traffic) -> Array:
    """(k,) m before a rover at position (2,) m reaches somebody when it goes towards headings (k,) rad; inf where nobody is in the lane."""
    relative = traffic.position - position
    ahead = np.cos(headings)[:, None] * relative[:, 0] + np.sin(headings)[:, None] * relative[:, 1]
    aside = np.abs(np.cos(headings)[:, None] * relative[:, 1] - np.sin(headings)[:, None] * relative[:, 0])
    in_lane = (ahead > 0) & (aside < HALF_LANE + traffic.radius)
    return np.where(in_lane, ahead - traffic.radius - FOOTPRINT_RADIUS, np.inf).min(axis=1, initial=np.inf)


def _passed(route: Array, passed: float, position: Array) -> float:
    """m of the route passed: the nearest place within the next metre and a half, never backwards."""
    steps = passed + np.linspace(0.0, 1.5, 31)
    nearest = int(np.argmin(((_along(route, steps) - position) ** 2).sum(axis=1)))
    return float(min(steps[nearest], np.hypot(*np.diff(route, axis=0).T).sum()))


def _along(route: Array, passed: Array) -> Array:
    """The places (n, 2) m after `passed` (n,) m of the route; its end beyond."""
    marks = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))])
    return np.column_stack([np.interp(passed, marks, route[:, 0]), np.interp(passed, marks, route[:, 1])])
