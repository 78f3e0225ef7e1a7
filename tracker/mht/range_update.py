"""Update of a leaf by a box of ambiguous range, which gives a direction and a likelihood of the distance (detections/range_likelihood.py), compiled.

Across the line of sight the update is that of a Kalman filter. Along it, the predicted distribution of distance and stature is multiplied by the
likelihood on a grid. The leaf keeps the mean and covariance of the product (assumed density filtering: Maybeck 1982, Stochastic models 2).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tracker.detections.range_likelihood import MIN_SIGMA, NEAREST
from tracker.geometry import Array
from tracker.geometry.compilation import njit

MIN_DENSITY = 0.01
"""Least density, per radian, of a box in the gate of a leaf."""

REACH = 6.0
"""Standard deviations of the predicted distance over which the grid is summed."""


@njit(cache=True)
def head_log_ratio(above: float, spread: float, height: float, noise: float, people: Array) -> float:
    """Log-likelihood ratio of the height of a box: for a stature that it exceeds by `above` ± √spread m, over people in general."""
    outlier = people[2] / (people[4] - people[3])
    usual, wide = height - people[0], people[1] ** 2 + noise
    track = (1 - people[2]) * math.exp(-0.5 * above * above / spread) / math.sqrt(6.28318531 * spread) + outlier
    anybody = (1 - people[2]) * math.exp(-0.5 * usual * usual / wide) / math.sqrt(6.28318531 * wide) + outlier
    return math.log(track / anybody)


@njit(cache=True)
def _across(x: Array, P: Array, v: int, d: int, boxes: Any, spread: float, out: Array) -> None:
    """The place of x along and across the line of sight of box d of view v.

    out[0:2] unit vector along; [2] cross-range m and [3] its variance m², of box and leaf together. [4:6] distance and stature m after the update
    across the line of sight, and [6:9] their covariance m², entries 00, 01, 11; [9] distance m before it.
    """
    direction, origin = boxes.direction[d], boxes.origin[v]
    level = math.hypot(direction[0], direction[1])
    ux, uy = direction[0] / level, direction[1] / level
    wx, wy = -uy, ux
    later, bias = boxes.later[v], boxes.bias[v]
    x0, x1 = x[0] + later * x[2], x[1] + later * x[3]
    bx, by = x0 - boxes.centre[0], x1 - boxes.centre[1]
    px = x0 + bias[0] + bias[2] * bx + bias[3] * by - origin[0]
    py = x1 + bias[1] + bias[4] * bx + bias[5] * by - origin[1]
    distance, cross = px * ux + py * uy, px * wx + py * wy
    c0, c1, c4 = P[0, 0] * wx + P[0, 1] * wy, P[1, 0] * wx + P[1, 1] * wy, P[4, 0] * wx + P[4, 1] * wy
    variance = c0 * wx + c1 * wy + boxes.covariance[d, 0, 0] * distance * distance + spread * spread
    s0, s1 = c0 * ux + c1 * uy, c4
    out[0], out[1], out[2], out[3] = ux, uy, cross, variance
    out[4], out[5] = distance - s0 * cross / variance, x[4] - s1 * cross / variance
    out[6] = ux * ux * P[0, 0] + 2 * ux * uy * P[0, 1] + uy * uy * P[1, 1] - s0 * s0 / variance
    out[7] = ux * P[0, 4] + uy * P[1, 4] - s0 * s1 / variance
    out[8] = P[4, 4] - s1 * s1 / variance
    out[9] = distance


@njit(cache=True)
def _posterior(row: int, prior: Array, ranges: Any, out: Array) -> float:
    """Density, per radian, of the ambiguous box `row` for a person of distance and stature prior[0:2] m with covariance prior[2:5] m².

    out[0:2] mean of distance and stature m, out[2:5] their covariance m² given the box, entries 00, 01, 11; not set where the density is 0.
    """
    grid, people = ranges.distance, ranges.people
    mean, stature, last = prior[0], prior[1], len(grid) - 1
    growth = math.log(grid[1] / grid[0])
    place = math.log(max(mean, grid[0]) / grid[0]) / growth
    near = min(int(place), last - 1)
    share = min(place - near, 1.0)
    pitch = (1 - share) * ranges.step[near] + share * ranges.step[near + 1]
    variance = max(prior[2], pitch * pitch)
    slope = prior[3] / variance
    spread, sigma = max(prior[4] - slope * prior[3], 1e-9), math.sqrt(variance)
    first = int(max(math.log(max(mean - REACH * sigma, grid[0]) / grid[0]) / growth, 0.0))
    end = min(int(math.log(max(mean + REACH * sigma, grid[0]) / grid[0]) / growth) + 2, last + 1)
    s, s0, s1, s00, s01, s11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(first, end):
        if ranges.edge[row, k] <= 0.0:
            continue
        away, height = grid[k] - mean, ranges.height[row, k]
        expected, total = slope * away, spread + ranges.error[row, k] ** 2
        above = height - stature - expected
        inlier = (1 - people[2]) * math.exp(-0.5 * above * above / total) / math.sqrt(total) * people[1]
        likelihood = inlier + (people[2] if people[3] < height < people[4] else 0.0)
        w = math.exp(-0.5 * away * away / variance) / math.sqrt(6.28318531 * variance) * ranges.edge[row, k] * likelihood * ranges.step[k]
        if w <= 0.0:
            continue
        gain = inlier / likelihood * spread / total
        taller = expected + gain * above
        s += w
        s0 += w * away
        s1 += w * taller
        s00 += w * away * away
        s01 += w * away * taller
        s11 += w * (taller * taller + (1 - gain) * spread)
    if s > 0.0:
        m0, m1 = s0 / s, s1 / s
        out[0], out[1] = mean + m0, stature + m1
        out[2], out[3], out[4] = max(s00 / s - m0 * m0, MIN_SIGMA**2), s01 / s - m0 * m1, s11 / s - m1 * m1
    return s


@njit(cache=True)
def range_log_density(x: Array, P: Array, v: int, d: int, boxes: Any, limits: Any) -> float:
    """Log density, per steradian, of the ambiguous box d of view v for the leaf x, P; −inf outside the gate."""
    line, after = np.empty(10), np.empty(5)
    _across(x, P, v, d, boxes, limits.foot_spread, line)
    square = line[2] * line[2]
    if square >= limits.gate**2 * line[3] or line[9] <= NEAREST / 2:
        return -np.inf
    density = _posterior(boxes.ambiguous[d], line[4:9], boxes.ranges, after)
    if density <= MIN_DENSITY:
        return -np.inf
    return math.log(line[9]) - 0.5 * (square / line[3] + math.log(6.28318531 * line[3])) + math.log(density)


@njit(cache=True)
def correct_range(x: Array, P: Array, v: int, d: int, boxes: Any, limits: Any) -> None:
    """Update x, P in place by the ambiguous box d of view v."""
    line, after = np.empty(10), np.empty(5)
    _across(x, P, v, d, boxes, limits.foot_spread, line)
    if _posterior(boxes.ambiguous[d], line[4:9], boxes.ranges, after) <= 0.0:
        return
    ux, uy, p = line[0], line[1], np.empty(5)
    for i in range(5):
        p[i] = -P[i, 0] * uy + P[i, 1] * ux
    for i in range(5):
        x[i] -= p[i] / line[3] * line[2]
        for j in range(5):
            P[i, j] -= p[i] * p[j] / line[3]
    set_marginal(x, P, line, after)


@njit(cache=True)
def set_marginal(x: Array, P: Array, line: Array, after: Array) -> None:
    """Give x, P, in place, the mean and covariance `after` of distance along line[0:2] and stature, in place of those in line[4:9].

    The other components change by their regression on distance and stature, as in a smoother.
    """
    a, b, c = line[6], line[7], line[8]
    det = max(a * c - b * b, 1e-12)
    G = np.empty((5, 2))
    for i in range(5):
        q0, q1 = P[i, 0] * line[0] + P[i, 1] * line[1], P[i, 4]
        G[i, 0], G[i, 1] = (c * q0 - b * q1) / det, (a * q1 - b * q0) / det
    d0, d1 = after[0] - line[4], after[1] - line[5]
    e00, e01, e11 = after[2] - a, after[3] - b, after[4] - c
    for i in range(5):
        x[i] += G[i, 0] * d0 + G[i, 1] * d1
        for j in range(5):
            P[i, j] += G[i, 0] * (e00 * G[j, 0] + e01 * G[j, 1]) + G[i, 1] * (e01 * G[j, 0] + e11 * G[j, 1])
