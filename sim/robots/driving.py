"""Driver of a rover: shortest routes from goal to goal, path tracking, and avoidance of people and other robots.

Path tracking is pure pursuit (Coulter 1992, Implementation of the Pure Pursuit Path Tracking Algorithm).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import ndimage

from sim.robots.rover import FOOTPRINT_RADIUS
from tracker.geometry import Array, frozen, wrap
from tracker.geometry.compilation import njit
from worlds.terrain.free_space import FreeSpace

TOP_SPEED, TOP_YAW_RATE = 0.7, 0.8
"""m/s and rad/s."""
ACCELERATION, YAW_ACCELERATION = 0.6, 1.6
"""m/s² and rad/s²: small enough for the mast."""
LOOKAHEAD = 0.6
"""m: distance along the route to the point that is pursued."""
ARRIVED = 0.5
STOPPING_GAP = 0.1
"""m: gap to others at which a rover has stopped, beyond its footprint."""
_CLEAR_LANE = 0.5
"""m: free length that a lane must have."""
TURNING_ROOM = 0.2
"""m: difference between the half width of free space for wheels and the radius of the circle in which a rover turns."""
HALF_LANE = 0.37
"""m: half width of the lane that a rover needs, with a margin."""
PATIENCE, RETREAT = 1.2, 1.4
"""s without progress before a rover replans or reverses; s of reversing."""
REQUEST_DELAY = 0.5
"""s without progress after which a rover requests way from people."""
REPLANNING_RANGE = 4.0
"""m: range of the others that a new route avoids."""
TURN_IN_PLACE_RATE = 0.7
"""rad/s: yaw rate of a rover that turns in place."""
SHUNTING_SPEED = 0.3
"""m/s: speed of a robot with steered wheels that turns by driving back and forth."""
_DETOURS = np.array([0.3, -0.3, 0.6, -0.6, 0.9, -0.9, 1.2, -1.2, 1.5, -1.5])
"""rad: deviations from the wanted heading, in the order in which they are tried."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a rover: position (2,) m, yaw rad, forward speed m/s, yaw_rate rad/s."""

    position: Array
    yaw: float
    speed: float
    yaw_rate: float


@dataclass(frozen=True, eq=False)
class Traffic:
    """Other robots and people: position (k, 2) m, radius (k,) m."""

    position: Array
    radius: Array


@dataclass(frozen=True, eq=False)
class Route:
    """A polyline: points (k, 2) m, and marks (k,) m, their distance along it."""

    points: Array
    marks: Array

    @staticmethod
    def through(points: Array) -> Route:
        """The route through points (k, 2) m."""
        marks = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        return Route(frozen(points, (None, 2), "route"), frozen(marks, (len(points),), "marks"))


@dataclass(frozen=True, eq=False)
class DriveState:
    """State of the driver of one rover.

    route, passed: current route, and m of it already driven. visit: number of goals passed. speed m/s, yaw_rate rad/s: current command.
    stuck: s without progress. retreat: s left to reverse. turn_side: turn while reversing, 1 to the left, −1 to the right.
    direction: 1 for driving forwards, −1 backwards.
    requested_velocity (2,) m/s: how it would move if people gave way; 0 for no request.
    attempts: how often it has been stuck since it last drove freely.
    """

    route: Route
    passed: float
    visit: int
    speed: float
    yaw_rate: float
    stuck: float
    retreat: float
    turn_side: float = 1.0
    direction: float = 1.0
    requested_velocity: tuple[float, float] = (0.0, 0.0)
    attempts: int = 0


class Pilot(Protocol):
    """The driver of a rover: a Driver with its own goals, or another source of commands."""

    def start(self, position: Array) -> DriveState:
        """State for a rover at rest at position (2,) m."""
        ...

    def step(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        """The state `dt` s later."""
        ...


@dataclass(frozen=True, eq=False)
class Driver:
    """A driver in the free space `wheels` with goals (g, 2) m, which are repeated cyclically. top_speed: m/s.

    turning_radius: m, least radius of a robot with steered wheels; 0 for a robot that turns in place.
    """

    wheels: FreeSpace
    goals: Array
    top_speed: float = TOP_SPEED
    turning_radius: float = 0.0

    def start(self, position: Array) -> DriveState:
        return DriveState(self._route(position, 0), 0.0, 0, 0.0, 0.0, 0.0, 0.0)

    def step(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        """The state `dt` s later; its speed and yaw_rate are the command for the wheels."""
        if math.dist(drive.route.points[-1], motion.position) < ARRIVED:
            drive = self._to_next_goal(drive, motion)
        if drive.retreat > 0:
            return self._retreat(drive, motion, traffic, dt)
        passed, x, y = _progress(drive.route.points, drive.route.marks, drive.passed, motion.position)
        drive = replace(drive, passed=passed)
        aim = np.array([x, y])
        distance = max(math.dist(aim, motion.position), 0.2)
        straight = math.atan2(*(aim - motion.position)[::-1])
        wanted = self._detour_heading(motion, straight, traffic)
        direction = _driving_direction(drive, motion, wanted)
        error = float(wrap(wanted - motion.yaw + (math.pi if direction < 0 else 0.0)))
        speed = self.top_speed * max(math.cos(error), 0.0) ** 2 if abs(error) < 1.0 else 0.0
        free = min(speed, _free_speed(motion, traffic, direction, self.top_speed))
        # A rover that cannot drive on at its heading turns in place.
        turns = not speed or (free < 0.1 and abs(error) > 0.15)
        turn = math.copysign(TURN_IN_PLACE_RATE, error) if turns else 2 * free * math.sin(error) / distance
        ahead = direction * free
        if turns and self.turning_radius:
            ahead = self._shunting_speed(drive, motion, traffic)
            turn = math.copysign(abs(ahead) / self.turning_radius, error)
        drive = accelerated(replace(drive, direction=direction), ahead, float(np.clip(turn, -TOP_YAW_RATE, TOP_YAW_RATE)), dt)
        waits = abs(motion.yaw_rate) < 0.1 if turns else min(free, abs(motion.speed)) < 0.25 * speed
        drive = replace(drive, stuck=drive.stuck + dt if waits else max(drive.stuck - dt, 0.0))
        headings = np.array([straight, wanted, motion.yaw if direction > 0 else motion.yaw + math.pi])
        blocked = _free_distance(motion.position, headings, traffic.position, traffic.radius).min() < _CLEAR_LANE + 0.2
        requesting = blocked and drive.stuck > REQUEST_DELAY
        asked = (self.top_speed * math.cos(straight), self.top_speed * math.sin(straight))
        drive = replace(drive, requested_velocity=asked if requesting else (0.0, 0.0))
        if drive.stuck <= PATIENCE:
            return replace(drive, attempts=0) if abs(motion.speed) > 0.5 * self.top_speed else drive
        # Alternate: two rovers that only replan, or only reverse, would block each other for ever.
        around = self._replan(drive, motion, traffic) if blocked and drive.attempts % 2 == 0 else None
        if around is not None:
            return around
        return replace(drive, stuck=0.0, attempts=drive.attempts + 1, retreat=RETREAT, turn_side=self._wider_side(motion))

    def _shunting_speed(self, drive: DriveState, motion: Motion, traffic: Traffic) -> float:
        """Speed, m/s, of a robot that cannot turn in place: back and forth with its wheels turned, in the other direction where there is no room."""
        sense = -1.0 if drive.speed < 0 else 1.0
        for way in (sense, -sense):
            there = motion.position + 0.4 * way * np.array([math.cos(motion.yaw), math.sin(motion.yaw)])
            if self.wheels.free_at(there[None])[0] and _free_speed(motion, traffic, way, SHUNTING_SPEED) > 0.5 * SHUNTING_SPEED:
                return way * SHUNTING_SPEED
        return 0.0

    def _detour_heading(self, motion: Motion, wanted: float, traffic: Traffic) -> float:
        """The free heading nearest to the wanted heading: clear of others, within free space for 1 m. The wanted heading if none is free."""
        if _free_distance(motion.position, np.array([wanted]), traffic.position, traffic.radius)[0] > _CLEAR_LANE:
            return wanted
        headings = wanted + _DETOURS
        ahead = np.column_stack([np.cos(headings), np.sin(headings)])
        clear = _free_distance(motion.position, headings, traffic.position, traffic.radius) > _CLEAR_LANE
        for reach in (0.5, 1.0):
            clear &= self.wheels.free_at(motion.position + reach * ahead)
        return float(headings[int(np.argmax(clear))]) if clear.any() else wanted

    def _replan(self, drive: DriveState, motion: Motion, traffic: Traffic) -> DriveState | None:
        """A route to the current goal, or to the next reachable goal, around all others nearby, as if they stood still.

        None if no goal is reachable.
        """
        i, j = np.indices(self.wheels.free.shape)
        nodes = self.wheels.origin + self.wheels.spacing * np.stack([j, i], axis=-1)
        free = self.wheels.free.copy()
        for place, radius in zip(traffic.position, traffic.radius, strict=True):
            if math.dist(place, motion.position) < REPLANNING_RANGE:
                free &= np.hypot(*np.moveaxis(nodes - place, -1, 0)) > radius + HALF_LANE
        start = self._nearest_free(motion.position)
        free |= self.wheels.free & (np.hypot(*np.moveaxis(nodes - start, -1, 0)) < 0.25)
        labels = ndimage.label(free)[0]
        j, i = np.rint((start - self.wheels.origin) / self.wheels.spacing).astype(np.int64)
        room = FreeSpace(labels == labels[i, j], self.wheels.origin, self.wheels.spacing)
        for visit in range(drive.visit, drive.visit + len(self.goals)):
            goal = self.goals[visit % len(self.goals)]
            if room.free_at(goal[None])[0] and math.dist(goal, start) > ARRIVED:
                route = Route.through(room.route(start, goal))
                return replace(drive, route=route, passed=0.0, visit=visit, stuck=0.0, attempts=drive.attempts + 1)
        return None

    def _wider_side(self, motion: Motion) -> float:
        """1 if there is more clearance to the left of the rover than to the right, else −1."""
        left = np.array([-math.sin(motion.yaw), math.cos(motion.yaw)])
        room = self.wheels.clearance_at(motion.position + np.array([[0.5], [-0.5]]) * left)
        return 1.0 if room[0] > room[1] else -1.0

    def _retreat(self, drive: DriveState, motion: Motion, traffic: Traffic, dt: float) -> DriveState:
        """Reverse with a turn as far as there is space, then go to the next goal."""
        behind = motion.position - 0.4 * drive.direction * np.array([math.cos(motion.yaw), math.sin(motion.yaw)])
        room = self.wheels.clearance_at(behind[None])[0] > min(0.0, self.wheels.clearance_at(motion.position[None])[0])
        speed = -drive.direction * min(0.3, _free_speed(motion, traffic, -drive.direction, self.top_speed)) if room else 0.0
        drive = accelerated(drive, speed, 0.6 * drive.turn_side, dt)
        left = drive.retreat - dt
        return self._to_next_goal(replace(drive, retreat=0.0), motion) if left <= 0 else replace(drive, retreat=left)

    def _to_next_goal(self, drive: DriveState, motion: Motion) -> DriveState:
        return replace(drive, route=self._route(motion.position, drive.visit + 1), passed=0.0, visit=drive.visit + 1)

    def _route(self, position: Array, visit: int) -> Route:
        return Route.through(self.wheels.route(self._nearest_free(position), self.goals[visit % len(self.goals)]))

    def _nearest_free(self, position: Array) -> Array:
        """position (2,) m, or the nearest free grid point."""
        if self.wheels.free_at(position[None])[0]:
            return position
        nodes = self.wheels.points(self.wheels.free)
        return nodes[int(np.argmin(((nodes - position) ** 2).sum(axis=1)))]


def make_driver(room: FreeSpace, rng: np.random.Generator, top_speed: float = TOP_SPEED, turning_radius: float = 0.0) -> Driver:
    """A driver with eight random goals in this free space; other arguments as in Driver. Raises ValueError if nothing is free."""
    return Driver(room, np.concatenate([room.sample(rng, 1, 0.1, 0.0) for _ in range(8)]), top_speed, turning_radius)


def turning_space(wheels: FreeSpace) -> FreeSpace:
    """The largest connected part of free space in which a rover can turn in place: at least TURNING_ROOM m from its border.

    The margin is halved, then dropped, where less than half of the area would be left, as in a world of narrow passages.
    """
    for margin in (TURNING_ROOM, 0.5 * TURNING_ROOM):
        labels, count = ndimage.label(wheels.clearance > margin)
        if count:
            largest = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
            if largest.sum() > 0.5 * wheels.free.sum():
                return FreeSpace(largest, wheels.origin, wheels.spacing)
    return wheels


def _driving_direction(drive: DriveState, motion: Motion, wanted: float) -> float:
    """1 to drive forwards, −1 to drive backwards, for the smaller rotation to a heading. The current direction is kept up to 110°."""
    ahead = abs(float(wrap(wanted - motion.yaw - (math.pi if drive.direction < 0 else 0.0))))
    return drive.direction if ahead < 1.9 else -drive.direction


def accelerated(drive: DriveState, speed: float, yaw_rate: float, dt: float) -> DriveState:
    """The command, changed towards `speed` and `yaw_rate` within the limits of acceleration. Braking may be twice as hard."""
    brake = 2.0 if abs(speed) < abs(drive.speed) else 1.0
    dv, dw = brake * ACCELERATION * dt, YAW_ACCELERATION * dt
    return replace(
        drive,
        speed=drive.speed + float(np.clip(speed - drive.speed, -dv, dv)),
        yaw_rate=drive.yaw_rate + float(np.clip(yaw_rate - drive.yaw_rate, -dw, dw)),
    )


def _free_speed(motion: Motion, traffic: Traffic, direction: float, most: float) -> float:
    """Speed, m/s, at which the rover can stop before others in its lane, ahead (direction 1) or behind (−1); at most `most`."""
    yaw = motion.yaw if direction > 0 else motion.yaw + math.pi
    gap = _free_distance(motion.position, np.array([yaw]), traffic.position, traffic.radius)[0]
    return min(max(0.8 * (float(gap) - STOPPING_GAP), 0.0), most)


@njit(cache=True)
def _free_distance(position: Array, headings: Array, others: Array, radius: Array) -> Array:
    """Free distances (k,) m of a rover at position (2,) m along headings (k,) rad; inf for an empty lane.

    others (m, 2) m, radius (m,) m: discs to avoid.
    """
    out = np.full(len(headings), np.inf)
    for k in range(len(headings)):
        c, s = math.cos(headings[k]), math.sin(headings[k])
        for j in range(len(others)):
            x, y = others[j, 0] - position[0], others[j, 1] - position[1]
            ahead, aside = c * x + s * y, abs(c * y - s * x)
            if ahead > 0 and aside < HALF_LANE + radius[j]:
                out[k] = min(out[k], ahead - radius[j] - FOOTPRINT_RADIUS)
    return out


@njit(cache=True)
def _progress(points: Array, marks: Array, passed: float, position: Array) -> tuple[float, float, float]:
    """Distance along a route, m, and the pursued point x, y m, LOOKAHEAD farther along.

    The nearest point of the next 1.5 m of the route counts, so that the distance never decreases.
    """
    best, found = np.inf, passed
    for k in range(len(points) - 1):
        low, high = max(marks[k], passed), min(marks[k + 1], passed + 1.5)
        length = marks[k + 1] - marks[k]
        if low > high or length <= 0:
            continue
        dx, dy = (points[k + 1, 0] - points[k, 0]) / length, (points[k + 1, 1] - points[k, 1]) / length
        along = marks[k] + (position[0] - points[k, 0]) * dx + (position[1] - points[k, 1]) * dy
        along = min(max(along, low), high)
        x, y = points[k, 0] + (along - marks[k]) * dx - position[0], points[k, 1] + (along - marks[k]) * dy - position[1]
        if x * x + y * y < best - 1e-12:
            best, found = x * x + y * y, along
    aim = min(found + LOOKAHEAD, marks[-1])
    return found, np.interp(aim, marks, points[:, 0]), np.interp(aim, marks, points[:, 1])
