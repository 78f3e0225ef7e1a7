"""Unicycle kinematics of rovers: limited accelerations, collisions, poses on sloping ground, and energy.

The kernels are compiled and run on one thread in a fixed order.
"""

from __future__ import annotations

import math

import numpy as np

from sim.crowd.social_force import BODY_RADIUS
from sim.placement.config import SPEED, TRAVELLED, TURNED, YAW, YAW_RATE, X, Y
from sim.placement.map import PlacementMap, bilinear_at, height_on
from sim.placement.roadmap import is_free
from sim.robots.rover import HALF_WIDTH, SPRUNG_MASS, WHEEL_RADIUS, wheel_positions
from tracker.geometry import Array, Pose
from tracker.geometry.compilation import njit

CONTACT_DISTANCE = HALF_WIDTH + BODY_RADIUS
"""Distance between the centres of a rover and a person in contact, m."""

NEAR_MISS_DISTANCE = CONTACT_DISTANCE + 0.3
"""Distance of a moving rover from a person below which a near miss counts, m."""

MASS = SPRUNG_MASS + 4 * 1.5
"""Mass of a rover, kg."""

ROLLING_RESISTANCE, SCRUBBING_RESISTANCE = 0.05, 0.35
"""Resistance over weight: of rolling wheels, and of wheels that slide sideways while a skid-steered rover turns."""

WHEEL_ARM = 0.38
"""Distance from the centre of a rover to its wheels, m."""

GRAVITY = 9.81


@njit(cache=True)
def drive_step(team, command, people, space, limits):  # type: ignore[no-untyped-def]
    """The states (r, 7) of rovers a step later, and what stopped each (r,): 1 a person, 2 another rover, 3 the ground, 0 nothing.

    command (r, 2): desired forward speed m/s and yaw rate rad/s. people (p, 2): positions m. space: `Roadmap.grid`.
    limits: greatest changes of speed (m/s) and yaw rate (rad/s) in the step, and its time (s).
    """
    out, stopped = team.copy(), np.zeros(len(team), np.int64)
    for r in range(len(team)):
        for column, limit in ((SPEED, limits[0]), (YAW_RATE, limits[1])):
            desired = command[r, column - SPEED]
            # Braking is at most twice as strong as acceleration.
            brake = 2.0 if abs(desired) < abs(out[r, column]) else 1.0
            out[r, column] += min(max(desired - out[r, column], -brake * limit), brake * limit)
        turn = out[r, YAW_RATE] * limits[2]
        ahead = out[r, SPEED] * limits[2]
        yaw = out[r, YAW] + 0.5 * turn
        x, y = out[r, X] + ahead * math.cos(yaw), out[r, Y] + ahead * math.sin(yaw)
        if not is_free(space, x, y):
            # The rover slides along a wall, as one that steers slightly away would.
            if is_free(space, x, out[r, Y]):
                y = out[r, Y]
            elif is_free(space, out[r, X], y):
                x = out[r, X]
            else:
                stopped[r] = 3
        for q in range(len(team)):
            if q != r and _collides(out[r, X], out[r, Y], x, y, out[q, X], out[q, Y], 2 * HALF_WIDTH):
                stopped[r] = 2
        for p in range(len(people)):
            if _collides(out[r, X], out[r, Y], x, y, people[p, 0], people[p, 1], CONTACT_DISTANCE):
                stopped[r] = 1
        out[r, YAW] = (out[r, YAW] + turn + math.pi) % (2 * math.pi) - math.pi
        out[r, TURNED] += abs(turn)
        if stopped[r]:
            out[r, SPEED] = 0.0
        else:
            out[r, X], out[r, Y] = x, y
            out[r, TRAVELLED] += abs(ahead)
    return out, stopped


@njit(cache=True)
def near_misses(team, people):  # type: ignore[no-untyped-def]
    """The number of people (p, 2) m within NEAR_MISS_DISTANCE of a moving robot of team (r, 7)."""
    count = 0
    for p in range(len(people)):
        for r in range(len(team)):
            if abs(team[r, SPEED]) > 0.1 and (people[p, 0] - team[r, X]) ** 2 + (people[p, 1] - team[r, Y]) ** 2 < NEAR_MISS_DISTANCE**2:
                count += 1
                break
    return count


@njit(cache=True)
def _collides(x0, y0, x1, y1, ox, oy, contact):  # type: ignore[no-untyped-def]
    """Whether a step from (x0, y0) to (x1, y1) m approaches (ox, oy) and ends within `contact` m of it."""
    before, after = (x0 - ox) ** 2 + (y0 - oy) ** 2, (x1 - ox) ** 2 + (y1 - oy) ** 2
    return after < contact * contact and after < before


def poses(team: Array, place: PlacementMap) -> list[Pose]:
    """T_world_robot of rovers (r, 7), on the plane through the ground under their wheels."""
    corners = wheel_positions()[:, :2]
    out = []
    c, s = np.cos(team[:, YAW]), np.sin(team[:, YAW])
    R = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    under = team[:, None, :2] + np.einsum("rij,wj->rwi", R, corners)
    height = height_on(place.floor, under.reshape(-1, 2)).reshape(-1, 4)
    # The wheels form a rectangle: the differences between opposite sides give the slope of its plane.
    slope_ahead = (height[:, :2].mean(axis=1) - height[:, 2:].mean(axis=1)) / (corners[0, 0] - corners[2, 0])
    slope_left = (height[:, ::2].mean(axis=1) - height[:, 1::2].mean(axis=1)) / (corners[0, 1] - corners[1, 1])
    for k in range(len(team)):
        up = np.array([-slope_ahead[k] * c[k] + slope_left[k] * s[k], -slope_ahead[k] * s[k] - slope_left[k] * c[k], 1.0])
        up /= np.linalg.norm(up)
        x = np.array([c[k], s[k], 0.0]) - (c[k] * up[0] + s[k] * up[1]) * up
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(up, x), up], axis=1)
        out.append(Pose(axes, np.array([*team[k, :2], height[k].mean()]) + WHEEL_RADIUS * up))
    return out


@njit(cache=True)
def camera_kernel(team, heights, origin, spacing, mast):  # type: ignore[no-untyped-def]
    """Camera positions (r, 3) m of rovers (r, 7), `mast` m above the ground along the normal of the slope.

    The ground has heights (rows, columns) m, an origin (2,) m and a spacing, m.
    """
    out = np.empty((len(team), 3))
    for r in range(len(team)):
        x, y, c, s = team[r, X], team[r, Y], math.cos(team[r, YAW]), math.sin(team[r, YAW])
        front = bilinear_at(heights, origin, spacing, x + 0.25 * c, y + 0.25 * s)
        rear = bilinear_at(heights, origin, spacing, x - 0.25 * c, y - 0.25 * s)
        left = bilinear_at(heights, origin, spacing, x - 0.28 * s, y + 0.28 * c)
        right = bilinear_at(heights, origin, spacing, x + 0.28 * s, y - 0.28 * c)
        ahead, aside = (front - rear) / 0.5, (left - right) / 0.56
        up = 1.0 / math.sqrt(1.0 + ahead * ahead + aside * aside)
        out[r, 0] = x - mast * up * (ahead * c - aside * s)
        out[r, 1] = y - mast * up * (ahead * s + aside * c)
        out[r, 2] = 0.25 * (front + rear + left + right) + mast * up
    return out


@njit(cache=True)
def energy(before, after, climbed):  # type: ignore[no-untyped-def]
    """Energy in kJ that a team spent between two states (r, 7): rolling, scrubbing, and climbing by climbed (r,) m.

    Descending recovers no energy.
    """
    work = 0.0
    for r in range(len(after)):
        rolled, turned = after[r, TRAVELLED] - before[r, TRAVELLED], after[r, TURNED] - before[r, TURNED]
        work += ROLLING_RESISTANCE * rolled + SCRUBBING_RESISTANCE * WHEEL_ARM * turned + max(climbed[r], 0.0)
    return MASS * GRAVITY * work / 1000.0
