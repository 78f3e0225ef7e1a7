"""Tables of the compiled branching: leaves, boxes, bounds and children."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Bodies, Viewpoint
from tracker.detections.range_likelihood import HEAD_SIGMA, OUTLIER_SHARE, STATURE_RANGE, Statures
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit
from tracker.geometry.ground import Ground
from tracker.mht.track_trees import TrackHypotheses
from tracker.tracks.sensor_model import SensorModel

SLOPE_REACH = 0.3
"""m to each side over which slopes are averaged: smaller steps of the ground are below the error of a place."""


class ParentHypotheses(NamedTuple):
    """The n leaves of all track trees, predicted to a tick.

    state (n, 5) m, m/s, m; covariance (n, 5, 5); z (n,) m and slope (n, 2) of the ground there. missed (n, V): log-likelihood of a missed detection
    in each view. deleted (n,): a deleted track, which takes no box. tree (n,): its id.
    links (n, D): log-likelihood ratio of each box for each leaf from images.
    """

    state: Array
    covariance: Array
    z: Array
    slope: Array
    missed: Array
    deleted: Mask
    tree: Ints
    links: Array

    @staticmethod
    def of(leaves: TrackHypotheses, ground: Ground, missed: Array, links: Array) -> ParentHypotheses:
        """Predicted leaves with the ground under them."""
        place = leaves.state[:, :2]
        around = [np.array([SLOPE_REACH, 0.0]), np.array([0.0, SLOPE_REACH])]
        slope = np.stack([(ground.height_at(place + e) - ground.height_at(place - e)) / (2 * SLOPE_REACH) for e in around], axis=1)
        return ParentHypotheses(leaves.state, leaves.covariance, ground.height_at(place), slope, missed, leaves.deleted, leaves.tree, links)


class RangeTable(NamedTuple):
    """The range likelihoods of A ambiguous boxes on one grid of k distances, as in RangeLikelihood.

    distance, step (k,) m; edge (A, k) per radian, height (A, k) m, error (A, k) m.
    people (5,): mean and standard deviation of statures m, share of outliers, least and greatest stature m of outliers; head_sigma m.
    """

    distance: Array
    step: Array
    edge: Array
    height: Array
    error: Array
    people: Array
    head_sigma: float

    @staticmethod
    def of(views: list[GroundDetections], statures: Statures) -> RangeTable:
        """The ambiguous boxes of all views, in their order."""
        people = np.array([*statures, OUTLIER_SHARE, *STATURE_RANGE])
        known = [(f.ranges, f.ambiguous) for f in views if f.ranges is not None]
        if not known:
            none = np.zeros((0, 0))
            return RangeTable(np.zeros(0), np.zeros(0), none, none, none, people, HEAD_SIGMA)
        edge, height, error = (np.concatenate([getattr(r, name)[rows] for r, rows in known]) for name in ("edge", "height", "error"))
        return RangeTable(known[0][0].distance, known[0][0].step, edge, height, error, people, HEAD_SIGMA)


class BoxTable(NamedTuple):
    """The D boxes of all V views in one table; those of view v are rows start[v] to start[v + 1].

    Of the views: origin (V, 3) m; later (V,) s after the tick; bias (V, 6), the registration bias about `centre` (2,) m as in RegistrationBias.of.
    Of the boxes: direction (D, 3) to the feet and covariance (D, 2, 2) rad²; feet_hidden (D,): probability that the box ends above the feet.
    head_slope (D,): tangent of the elevation of the upper edge.
    detection_ratio (D,): log of the detection rate over the density of false boxes per steradian. existence_ratio (D,): log-likelihood ratio of a
    person over clutter, whatever the direction.
    weakness (D,): by how much existence_ratio is less than that of the most confident box of the view at this tick.
    cut (D,): the lower edge is at the image's edge; stature (D,): the upper edge measures statures; ambiguous (D,): row of `ranges`, or −1.
    """

    origin: Array
    later: Array
    bias: Array
    centre: Array
    start: Ints
    direction: Array
    covariance: Array
    feet_hidden: Array
    head_slope: Array
    detection_ratio: Array
    existence_ratio: Array
    weakness: Array
    cut: Mask
    stature: Mask
    ambiguous: Ints
    ranges: RangeTable

    @staticmethod
    def of(views: list[GroundDetections], sensors: SensorModel, clutter: float) -> BoxTable:
        """clutter: least density of false boxes of a view, per steradian."""
        q = sensors.parameters

        def column(name: str, shape: tuple[int, ...]) -> Array:
            return np.concatenate([np.zeros((0, *shape)), *(getattr(f, name) for f in views)])

        start = np.cumsum([0, *(len(f) for f in views)])
        bias = np.array([sensors.registration_bias.of(f.camera) for f in views]).reshape(-1, 6)
        origin, later = np.array([f.origin for f in views]).reshape(-1, 3), np.array([f.later for f in views])
        most = [np.log(sensors.detection(f.camera) / clutter) for f in views]
        on_ground = [sensors.log_ratio(f) for f in views]
        seen = [np.minimum(r - sensors.log_ground(f), m) for r, f, m in zip(on_ground, views, most, strict=True)]
        ratio, existence = np.concatenate([np.zeros(0), *seen]), np.concatenate([np.zeros(0), *on_ground])
        weakness = np.concatenate([np.zeros(0), *(r.max(initial=-np.inf) - r for r in on_ground)])
        ambiguous, known = column("ambiguous", ()) > 0, np.repeat([f.known for f in views], np.diff(start))
        return BoxTable(
            origin, later, bias, sensors.registration_bias.centre, start, column("direction", (3,)), column("covariance", (2, 2)),
            column("feet_hidden", ()), np.tan(column("head_elevation", ())), ratio, existence, weakness,
            column("cut", ()) > 0, known.astype(bool), np.where(ambiguous, np.cumsum(ambiguous) - 1, -1), RangeTable.of(views, q.fusion.statures),
        )  # fmt: skip


class BranchingConstants(NamedTuple):
    """Bounds on the children of a leaf.

    gate: standard deviations; foot_spread m; min_height, max_height m of a person. missed_by_all: least log-likelihood of missed detections in all
    views at once. margin: log-likelihood by which a child may be worse than the best one.
    least_fit: least log-likelihood ratio of a box for a leaf, computed with the highest confidence of the view.
    beam_width, max_children: numbers of partial children and of children that are kept.
    """

    gate: float
    foot_spread: float
    min_height: float
    max_height: float
    missed_by_all: float
    margin: float
    least_fit: float
    beam_width: int
    max_children: int


@dataclass(frozen=True, eq=False)
class Observation:
    """The V views of a tick with their viewpoints and all their boxes in one table, and the n leaves that are predicted to it.

    limits: bounds on the children. active (a,): rows of the leaves in the last global hypothesis that are not deleted. bodies: people at the
    places of the leaves, of whom the active ones may occlude others. expected (n, V): detection rate of a leaf in a view, relative to people
    in full view. missed (n, V): log-likelihood of a missed detection. Its sum over a revisit is the same for synchronous and staggered cameras.
    chance (n,): probability that some view detects the person of a leaf.
    """

    views: list[GroundDetections]
    cameras: list[Viewpoint]
    table: BoxTable
    limits: BranchingConstants
    leaves: TrackHypotheses
    active: Ints
    bodies: Bodies
    expected: Array
    missed: Array
    chance: Array


class ChildHypotheses(NamedTuple):
    """m children, grouped by parent, the best first and the one without any box last.

    parent (m,): row of the leaf; box (m, V): rows of BoxTable or −1. increment (m,) of the track score, of which missed (m,) comes from views
    without a box; state (m, 5), covariance (m, 5, 5). residual (m, V, 2) rad, H and S (m, V, 2, 2): innovations, NaN without visible feet.
    """

    parent: Ints
    box: Ints
    increment: Array
    missed: Array
    state: Array
    covariance: Array
    residual: Array
    H: Array
    S: Array


@njit(cache=True)
def empty_children(m: int, V: int) -> Any:
    """The columns of m ChildHypotheses for V views, without any box."""
    return (
        np.zeros(m, np.int64), np.full((m, V), -1, np.int64), np.zeros(m), np.zeros(m), np.zeros((m, 5)), np.zeros((m, 5, 5)),
        np.full((m, V, 2), np.nan), np.zeros((m, V, 2, 2)), np.zeros((m, V, 2, 2)),
    )  # fmt: skip
