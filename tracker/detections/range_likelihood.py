"""Likelihood of the distance of a person from a box, on ground and among objects that are known.

At a given distance a person is visible from the head down to the feet, or down to the top of an occluder in front. So a box supports each distance
at which its lower edge is at either of these, and its height is a usual stature. One such place is where the lower edge meets the ground. Others are
just behind a wall, a ridge or the brow of a hill at which the box may end. `infer_ranges` gives the likelihood of each distance.
mht/range_update.py combines it with a predicted distance and stature: of two people in equal boxes the taller one is farther away.

Densities over distance are sums over fixed grid points (point-mass filter: Bucy & Senne 1971), so that they may have several modes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracker.detections.walkable_prior import WalkablePrior
from tracker.geometry import Array, Mask
from tracker.geometry.ground import Ground

NEAREST, FARTHEST, COUNT = 1.0, 60.0, 272
"""The grid of distances: first, last (m) and their number; the spacing is geometric."""

REFINEMENT = 3
"""Samples of occluders per grid point, so that thin walls are not missed."""

DISTANCE = np.geomspace(NEAREST, FARTHEST, COUNT)
STEP = DISTANCE * np.log(DISTANCE[1] / DISTANCE[0])
FINE = np.geomspace(NEAREST, FARTHEST, REFINEMENT * (COUNT - 1) + 1)
"""m: the grid of distances, their spacing, and the distances at which occluders are sampled."""

MIN_SIGMA = 1e-3
"""m, least standard deviation of a distance."""

LEG_COLUMNS = np.array([-0.5, 0.0, 0.5])
"""Columns of a box, in half widths, at which legs may be visible beside an occluder."""

MARGIN = 0.3
"""m, an object less than this in front of a person hides nothing: places and maps have errors."""


HEAD_SIGMA = 0.03
"""m, standard deviation of the upper edge from the stature: people nod, bounce and wear hats."""

OUTLIER_SHARE, STATURE_RANGE = 0.05, (1.2, 2.3)
"""Share of people whose apparent stature is uniform over the range, m: children and people on stairs stay possible."""

FOOT_SIGMA = 0.15
"""m, standard deviation of the lowest point of a walking body from the ground under its middle."""

MAX_OCCLUSION = 1.4
"""m over the feet, greatest height of an occluder in front of a person who is detected."""

ABSENT_SHARE = 0.4
"""Probability that an object of the map hides nothing, where there is a box: a map of tops does not show arches and open doors."""

TOP_SIGMA = 0.06
"""m, standard deviation of tops in the map."""


class Statures(NamedTuple):
    """Mean and standard deviation, m, of the statures of people."""

    mean: float
    sigma: float


class BoxEdges(NamedTuple):
    """The edges of n boxes: azimuth and half_width, elevation of lower and upper edge (n,) rad; variance (n,) rad² of an elevation.

    feet_hidden (n,): probability that a box ends above the lowest visible point of the body, for reasons that no map shows.
    border (n,) rad: elevation of the edge of the image, where the box ends there, −π/2 elsewhere.
    """

    azimuth: Array
    half_width: Array
    low: Array
    high: Array
    variance: Array
    feet_hidden: Array
    border: Array


@dataclass(frozen=True, eq=False)
class RangeLikelihood:
    """Likelihoods of n boxes on a grid of k horizontal distances.

    distance (k,) m and step (k,) m: the grid points, and the length for which each stands. edge (n, k): density of each box's lower edge, per radian;
    height (n, k) m: height of the box there, error (n, k) m: its standard deviation.
    mean, sigma (n,) m: of the distance by the box alone; feet_hidden (n,): probability; possible (n,): whether any distance is.
    """

    distance: Array
    step: Array
    edge: Array
    height: Array
    error: Array
    mean: Array
    sigma: Array
    feet_hidden: Array
    possible: Mask
    statures: Statures

    def select(self, rows: Mask) -> RangeLikelihood:
        """The likelihoods of the boxes in `rows` (n,)."""
        return replace(self, **{name: getattr(self, name)[rows] for name in ("edge", "height", "error", "mean", "sigma", "feet_hidden", "possible")})

    def spread_to(self, rows: Mask) -> RangeLikelihood:
        """The likelihoods as those of the boxes in `rows` (n,) of a longer list, the others being impossible."""
        out: dict[str, Any] = {}
        for name in ("edge", "height", "error", "mean", "sigma", "feet_hidden", "possible"):
            column = getattr(self, name)
            out[name] = np.zeros((len(rows), *column.shape[1:]), dtype=column.dtype)
            out[name][rows] = column
        return replace(self, **out)

    def initial(self, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        """Mean (m, 2) m and covariance (m, 2, 2) m² of distance and stature, given boxes `rows` (m,), for people in general at any distance.

        The spacing of the grid bounds the covariance. Where the density is 0, so are mean and covariance.
        """
        usual, height = self.statures, self.height[rows]
        spread, total = usual.sigma**2, usual.sigma**2 + self.error[rows] ** 2
        inlier, likelihood = _height_likelihood(height - usual.mean, total, height, usual)
        _, share = _normalized(self.edge[rows] * likelihood, self.step)
        # The height of a box corrects the stature.
        gain = inlier / np.maximum(likelihood, 1e-300) * spread / total
        after = usual.mean + gain * (height - usual.mean)
        mean = np.stack([share @ self.distance, (share * after).sum(axis=1)], axis=1)
        apart = np.stack([self.distance - mean[:, :1], after - mean[:, 1:]], axis=1)
        covariance = np.einsum("mk,mik,mjk->mij", share, apart, apart)
        covariance[:, 1, 1] += (share * (1 - gain) * spread).sum(axis=1)
        # A single grid point has no variance.
        covariance[:, 0, 0] = np.maximum(covariance[:, 0, 0], MIN_SIGMA**2)
        return mean, covariance


def infer_ranges(world: tuple[Ground, Ground], origin: Array, edges: BoxEdges, ahead: float, statures: Statures) -> RangeLikelihood:
    """Range likelihoods of boxes seen from `origin` (3,) m.

    world: the ground, and the tops of the objects on it; ahead m: distance of the point where soles end before the middle of the body.
    """
    azimuth = edges.azimuth[:, None] + LEG_COLUMNS * edges.half_width[:, None]
    places = origin[:2] + FINE[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)[:, :, None, :]
    grounds = world if world[0] is not world[1] else world[:1]
    profiles = [g.height_at(places.reshape(-1, 2)).reshape(places.shape[:3]) - origin[2] for g in grounds]
    middle = len(LEG_COLUMNS) // 2
    level = profiles[0][:, middle, ::REFINEMENT]
    sigma = np.sqrt(edges.variance)[:, None]

    height, error = DISTANCE * np.tan(edges.high)[:, None] - level, np.hypot(sigma * DISTANCE, HEAD_SIGMA)
    total, covered = _edge_density(profiles, edges, ahead)
    if walkable := WalkablePrior.of(*world):
        prior = walkable.at(places[:, middle, ::REFINEMENT])
        total, covered = total * prior, covered * prior
    _, likelihood = _height_likelihood(height - statures.mean, statures.sigma**2 + error**2, height, statures)
    density, weight = _normalized(total * likelihood, STEP)
    mean = weight @ DISTANCE
    spread = np.sqrt(np.maximum((weight * (DISTANCE - mean[:, None]) ** 2).sum(axis=1), MIN_SIGMA**2))
    feet_hidden = (covered * likelihood) @ STEP / np.maximum(density, 1e-12)
    return RangeLikelihood(DISTANCE, STEP, total, height, error, mean, spread, feet_hidden, density > 1e-9, statures)


def _edge_density(profiles: list[Array], edges: BoxEdges, ahead: float) -> tuple[Array, Array]:
    """Density (n, k) of the boxes' lower edges at each distance, per radian, and the part of it with hidden feet.

    profiles: heights (n, columns, fine) m over the eye, of the ground, and of tops where they are not the ground.
    """
    level, sigma = profiles[0][:, len(LEG_COLUMNS) // 2, ::REFINEMENT], np.sqrt(edges.variance)[:, None]
    feet, body = np.arctan(level / (DISTANCE - ahead)), np.arctan(MAX_OCCLUSION / DISTANCE)
    # The lowest point of a walking body is on the ground a little in front of or behind it.
    stray = FOOT_SIGMA * np.abs(np.gradient(feet, axis=1) / STEP)
    rough = np.hypot(sigma, TOP_SIGMA / DISTANCE)
    found = []
    for heights in profiles:
        # A box ends at the lowest visible point, between or beside the occluders, or at the edge of the image.
        before = np.arctan(_steepest(heights / FINE, FINE)[..., ::REFINEMENT].min(axis=1))
        before = np.maximum(before, edges.border[:, None])
        edge, hides = np.maximum(feet, before), before > feet
        above, blur = edges.low[:, None] - edge, np.where(hides, rough, np.hypot(sigma, stray))
        here = np.exp(-0.5 * (above / blur) ** 2) / (blur * np.sqrt(2 * np.pi))
        feet_hidden = edges.feet_hidden[:, None]
        seen = (1 - feet_hidden) * here + feet_hidden * ((above > 0) & (above < body)) / body
        found.append((seen, hides, (edge - feet < body) & (edge < edges.high[:, None])))
    total, covered = np.zeros(level.shape), np.zeros(level.shape)
    for (seen, hides, possible), share in zip((found[0], found[-1]), (ABSENT_SHARE, 1 - ABSENT_SHARE), strict=True):
        density = share * seen * possible
        total, covered = total + density, covered + density * hides
    return total, covered


def _normal_density(x: Array, variance: Array) -> Array:
    return np.asarray(np.exp(-0.5 * x**2 / variance) / np.sqrt(2 * np.pi * variance))


def _height_likelihood(above: Array, variance: Array, height: Array, statures: Statures) -> tuple[Array, Array]:
    """Likelihood of boxes `above` m taller than predicted, relative to the mode of the population, without and with outliers of the stature."""
    inlier = (1 - OUTLIER_SHARE) * _normal_density(above, variance) * statures.sigma * np.sqrt(2 * np.pi)
    return inlier, inlier + OUTLIER_SHARE * ((height > STATURE_RANGE[0]) & (height < STATURE_RANGE[1]))


def _steepest(slope: Array, distance: Array) -> Array:
    """Greatest slope (..., k) of a line of sight to anything nearer than each distance (k,) m by more than MARGIN."""
    highest = np.maximum.accumulate(slope, axis=-1)
    last = np.searchsorted(distance, distance - MARGIN) - 1
    return np.where(last >= 0, highest[..., np.maximum(last, 0)], -np.inf)


def _normalized(weight: Array, step: Array) -> tuple[Array, Array]:
    """Integrals (m,) of densities (m, k) over the distances, and the probability (m, k) of each distance, 0 where the integral is."""
    share = weight * step
    total = share.sum(axis=1)
    return total, share / np.maximum(total, 1e-300)[:, None]
