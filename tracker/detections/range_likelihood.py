"""Where along its line of sight somebody stands whom a box shows, on ground and among things that are known.

At a given distance a person shows from the head down to the feet, or down to what rises before them where that reaches higher. So a box speaks for
every distance at which its lower edge is the one or the other and at which somebody of usual stature fills it: where its lower edge meets the
ground, but also just behind the wall, the ridge or the brow of the hill that it may end at. `standpoints` says how likely each distance is;
`Standpoints.meet` what that makes of somebody who is expected about a place, and who is so tall as far as that is known: who is known to be tall
stands farther away than somebody short who fills the same box.

Densities over distance are sums over a fixed row of places (a point-mass filter: Bucy & Senne 1971), so that one with two peaks stays one with two.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tracker.detections.walkable_prior import FootingParameters, WalkablePrior
from tracker.geometry import Array, Mask
from tracker.geometry.ground import Ground

NEAREST, FARTHEST, PLACES = 1.0, 60.0, 272
"""The distances that are looked at: from, to (m) and how many, each a share farther than the last."""

FINER = 3
"""What rises before somebody is looked for at so many places for each of those, so that thin walls are not stepped over."""

LEAST = 1e-3
"""m, standard deviation of a distance, at least."""

LEGS = np.array([-0.5, 0.0, 0.5])
"""In half widths of a box: where legs may show beside what hides them."""

MARGIN = 0.3
"""m, what stands nearer than this before somebody hides nothing: places and maps have errors."""


@dataclass(frozen=True)
class StandpointParameters:
    """What is assumed of people and maps. `strange` is what keeps children and people on stairs possible, `gone` arches and open doors, of which the
    map of things knows only the top."""

    stature: float = 1.72  # m, how tall people are, mean ...
    stature_sigma: float = 0.12  # ... and standard deviation
    nod: float = 0.03  # m, the upper edge strays this far from the stature over the ground under the body: people nod, bounce and wear hats
    strange: float = 0.05  # share of those who look as tall as anybody: so much (m)
    tall: tuple[float, float] = (1.2, 2.3)
    stray: float = 0.15  # m, the lowest point of a walking body strays this far from the ground under its middle
    hidden: float = 1.4  # m over the feet up to which something may reach before somebody of whom there is a box
    gone: float = 0.4  # how often things that should hide the feet do not, where there is a box
    rough: float = 0.06  # m, tops of things stray this far from those of the map
    footing: FootingParameters = field(default_factory=FootingParameters)


class Edges(NamedTuple):
    """Boxes (n,): azimuth and half the width, elevation of lower and upper edge (rad), variance of an elevation (rad²), and the share of such boxes
    that end higher than what can be seen of the body, for reasons that no map knows."""

    azimuth: Array
    half: Array
    low: Array
    high: Array
    variance: Array
    lying: Array


class Expected(NamedTuple):
    """People (m,) before a box is seen: mean (m, 2) m and covariance (m, 2, 2) m² of how far they are along its line of sight over the plane, and of
    their stature."""

    mean: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class RangeLikelihood:
    """far (k,) m: the distances over the plane; step (k,) m: how much of the line each stands for. edge (n, k): density of each box's lower edge, a
    radian; height (n, k) m: how tall it is there, and error (n, k) m: how surely. mean, sigma (n,) m: where the person is, before anything else is
    known; hidden (n,): how likely the feet are out of sight; possible (n,): whether there is any place at all.
    """

    far: Array
    step: Array
    edge: Array
    height: Array
    error: Array
    mean: Array
    sigma: Array
    hidden: Array
    possible: Mask
    parameters: StandpointParameters

    def select(self, rows: Mask) -> RangeLikelihood:
        """Of the boxes in `rows` (n,)."""
        return replace(self, **{name: getattr(self, name)[rows] for name in ("edge", "height", "error", "mean", "sigma", "hidden", "possible")})

    def density(self, rows: NDArray[np.int64], expected: Expected) -> Array:
        """Of boxes `rows` (m,) of people as they are expected, a radian, times how usual the upper edge is beside the most usual of all people's."""
        return _normal(self._weigh(rows, *self._prior(expected))[0], self.step)[0]

    def meet(self, rows: NDArray[np.int64], expected: Expected) -> tuple[Array, Array]:
        """Boxes `rows` (m,) of people as they are expected: mean (m, 2) and covariance (m, 2, 2) of distance and stature afterwards.

        Nothing is known better than the places lie apart. Where the density is 0 so are mean and covariance.
        """
        return self._moments(rows, *self._prior(expected))

    def start(self, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        """The same where nothing is known but the boxes."""
        q, anywhere = self.parameters, np.ones((len(rows), len(self.far)))
        return self._moments(rows, anywhere, np.full(anywhere.shape, q.stature), np.full(anywhere.shape, q.stature_sigma**2))

    def _prior(self, expected: Expected) -> tuple[Array, Array, Array]:
        """Density (m, k) of the distances, and mean (m, k) m and variance (m, k) m² of the stature at each."""
        P, (away, stature) = expected.covariance[..., None], expected.mean.T[..., None]
        variance = np.maximum(P[:, 0, 0], np.interp(away, self.far, self.step) ** 2)
        taller = P[:, 0, 1] / variance
        return _bell(self.far - away, variance), stature + taller * (self.far - away), P[:, 1, 1] - taller * P[:, 0, 1]

    def _weigh(self, rows: NDArray[np.int64], prior: Array, stature: Array, spread: Array) -> tuple[Array, Array]:
        """What is as `_prior` has it, with the boxes: density (m, k), and the gain (m, k) by which their heights correct the stature."""
        height, total = self.height[rows], spread + self.error[rows] ** 2
        usual, tall = _fitting(height - stature, total, height, self.parameters)
        return prior * self.edge[rows] * tall, usual / np.maximum(tall, 1e-300) * spread / total

    def _moments(self, rows: NDArray[np.int64], prior: Array, stature: Array, spread: Array) -> tuple[Array, Array]:
        """As `meet`, of what is as `_prior` has it."""
        weight, gain = self._weigh(rows, prior, stature, spread)
        _, share = _normal(weight, self.step)
        after = stature + gain * (self.height[rows] - stature)
        mean = np.stack([share @ self.far, (share * after).sum(axis=1)], axis=1)
        apart = np.stack([self.far - mean[:, :1], after - mean[:, 1:]], axis=1)
        covariance = np.einsum("mk,mik,mjk->mij", share, apart, apart)
        covariance[:, 1, 1] += (share * (1 - gain) * spread).sum(axis=1)
        # Where but one of the places is left.
        covariance[:, 0, 0] = np.maximum(covariance[:, 0, 0], LEAST**2)
        return mean, covariance


def standpoints(world: tuple[Ground, Ground], origin: Array, edges: Edges, ahead: float, q: StandpointParameters) -> RangeLikelihood:
    """Of boxes seen from `origin` (3,) m; world: the ground, and the tops of what stands on it; ahead m: how much nearer than the middle of a body
    its soles end."""
    far = np.geomspace(NEAREST, FARTHEST, PLACES)
    step = far * np.log(far[1] / far[0])
    fine = np.geomspace(NEAREST, FARTHEST, FINER * (PLACES - 1) + 1)
    azimuth = edges.azimuth[:, None] + LEGS * edges.half[:, None]
    places = origin[:2] + fine[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)[:, :, None, :]
    rising = [g.height_at(places.reshape(-1, 2)).reshape(places.shape[:3]) - origin[2] for g in world]
    middle = len(LEGS) // 2
    level = rising[0][:, middle, ::FINER]
    error = np.sqrt(edges.variance)[:, None]

    height, unsure = far * np.tan(edges.high)[:, None] - level, np.hypot(error * far, q.nod)
    feet, body = np.arctan(level / (far - ahead)), np.arctan(q.hidden / far)
    # While walking the lowest point of a body is the ground's a little before or behind it.
    stray = q.stray * np.abs(np.gradient(feet, axis=1) / step)
    rough = np.hypot(error, q.rough / far)
    total, covered = np.zeros(level.shape), np.zeros(level.shape)
    for heights, share in zip(rising, (q.gone, 1 - q.gone), strict=True):
        # A box ends at the lowest that shows, between or beside what hides the rest.
        before = np.arctan(_steepest(heights / fine, fine)[..., ::FINER].min(axis=1))
        edge, hides = np.maximum(feet, before), before > feet
        above, blur = edges.low[:, None] - edge, np.where(hides, rough, np.hypot(error, stray))
        here = np.exp(-0.5 * (above / blur) ** 2) / (blur * np.sqrt(2 * np.pi))
        lying = edges.lying[:, None]
        seen = (1 - lying) * here + lying * ((above > 0) & (above < body)) / body
        seen = share * seen * ((edge - feet < body) & (edge < edges.high[:, None]))
        total, covered = total + seen, covered + seen * hides
    if footing := WalkablePrior.of(*world, q.footing):
        likely = footing.at(places[:, middle, ::FINER])
        total, covered = total * likely, covered * likely
    _, tall = _fitting(height - q.stature, q.stature_sigma**2 + unsure**2, height, q)
    density, weight = _normal(total * tall, step)
    mean = weight @ far
    sigma = np.sqrt(np.maximum((weight * (far - mean[:, None]) ** 2).sum(axis=1), LEAST**2))
    hidden = (covered * tall) @ step / np.maximum(density, 1e-12)
    return RangeLikelihood(far, step, total, height, unsure, mean, sigma, hidden, density > 1e-9, q)


def _bell(x: Array, variance: Array) -> Array:
    return np.asarray(np.exp(-0.5 * x**2 / variance) / np.sqrt(2 * np.pi * variance))


def _fitting(above: Array, variance: Array, height: Array, q: StandpointParameters) -> tuple[Array, Array]:
    """How usual boxes are that are `above` m taller than expected, beside the most usual of all people's; and the same with those who are as tall as
    anybody."""
    usual = (1 - q.strange) * _bell(above, variance) * q.stature_sigma * np.sqrt(2 * np.pi)
    return usual, usual + q.strange * ((height > q.tall[0]) & (height < q.tall[1]))


def _steepest(slope: Array, far: Array) -> Array:
    """(..., k) the highest slope of a line of sight to anything before each place."""
    highest = np.maximum.accumulate(slope, axis=-1)
    last = np.searchsorted(far, far - MARGIN) - 1
    return np.where(last >= 0, highest[..., np.maximum(last, 0)], -np.inf)


def _normal(weight: Array, step: Array) -> tuple[Array, Array]:
    """Sums (m,) of densities (m, k) over distances, and what share of it (m, k) each distance has, 0 where the sum is."""
    share = weight * step
    total = share.sum(axis=1)
    return total, share / np.maximum(total, 1e-300)[:, None]
