"""Updates of leaves by boxes of ambiguous range, against RangeLikelihood and against integrals over place and stature; boxes are made by rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from tests.tracker.detections.test_range_likelihood import NOISE, STATURES, box, grid
from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.ground_points import FusionParameters, GroundDetections, project_to_ground
from tracker.detections.occlusion import Bodies
from tracker.detections.range_likelihood import FOOT_SIGMA, OUTLIER_SHARE, STATURE_RANGE
from tracker.geometry import Array, Pose, bearing_from_angles
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat, Grid
from tracker.mht.box_update import update_child
from tracker.mht.branching_data import BoxTable, BranchingConstants, ChildHypotheses, Observation, ParentHypotheses, empty_children
from tracker.mht.range_update import correct_range, range_log_density
from tracker.mht.root_measurement import with_statures
from tracker.mht.track_trees import TrackHypotheses, initiated
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import MotionParameters
from tracker.types import Detections, Mount, Setup, Start

GATE, SPREAD = 4.0, 0.25
LIMITS = BranchingConstants(GATE, SPREAD, 1.2, 2.3, -5.0, -np.inf, 15.0, 8, 3)
LEVEL = np.zeros((201, 201))


def setup_of(tops: Grid, up: float) -> Setup:
    """A panorama `up` m over a plane with things on it."""
    mount = Mount(Panorama(1024, 512), Pose(np.eye(3), np.array([0.0, 0.0, up])), "r")
    return Setup({"r": mount}, Flat(), {"r": Start(Pose.identity(), np.zeros((6, 6)))}, 1 / 6, occluders=tops)


def one_box(tops: Grid, edges: tuple[float, float] = (-np.arctan(1.5 / 8.0), np.arctan(0.22 / 8.0)), up: float = 1.5) -> GroundDetections:
    """Somebody on a plane whose things are `tops`, seen from `up` m: 8 m ahead, or as the elevations of the box's edges are."""
    low, high = edges
    bearing, extent = bearing_from_angles(np.zeros(1), np.array([(low + high) / 2])), np.array([[0.06, high - low]])
    boxes = Detections(bearing, extent, np.full(1, 0.9), np.tile(NOISE**2 * np.eye(2), (1, 1, 1)), np.zeros((1, 0)))
    return project_to_ground(setup_of(tops, up), "r", boxes, (Pose.identity(), np.zeros((6, 6))), FusionParameters())


def behind_a_wall(rng: np.random.Generator, away: float, stature: float) -> GroundDetections | None:
    """A box of somebody `away` m ahead whose legs a wall hides, as a camera 0.8 m up has it."""
    tops = np.zeros((201, 201))
    tops[:, 125:127] = 0.6
    world, eye = grid(tops), np.array([0.0, 0.0, 0.8])
    edges = box(grid(np.zeros((201, 201))), world, eye, np.array([away, 0.0, 0.0]), stature)
    return None if edges is None else one_box(world, (edges[0] + rng.normal(0, NOISE), edges[1] + rng.normal(0, NOISE)), 0.8)


class State(NamedTuple):
    """Mean (5,) and covariance (5, 5) of a leaf: place m, velocity m/s, stature m."""

    x: Array
    P: Array


def leaf(x: float, y: float, stature: float = STATURES.mean, sigma: float = STATURES.sigma) -> State:
    P = np.diag([0.4, 0.3, 1.0, 1.0, sigma**2])
    P[0, 1] = P[1, 0] = 0.1
    P[0, 2] = P[2, 0] = 0.2
    P[1, 3] = P[3, 1] = 0.15
    return State(np.array([x, y, 0.5, -0.2, stature]), P)


def table_of(feet: GroundDetections) -> BoxTable:
    return BoxTable.of([feet], SensorModel(setup_of(grid(LEVEL), 1.5), MhtParameters()), 2.5)


def updated(state: State, feet: GroundDetections, limits: BranchingConstants = LIMITS) -> State:
    """The leaf after the ambiguous box 0."""
    x, P = state.x.copy(), state.P.copy()
    correct_range(x, P, 0, 0, table_of(feet), limits)
    return State(x, P)


def log_density(state: State, feet: GroundDetections) -> float:
    """Of the ambiguous box 0, a steradian."""
    return float(range_log_density(state.x, state.P, 0, 0, table_of(feet), LIMITS))


def ambiguous_boxes(rng: np.random.Generator, count: int) -> list[GroundDetections]:
    """Boxes of people whose legs a wall hides."""
    out: list[GroundDetections] = []
    while len(out) < count:
        feet = behind_a_wall(rng, rng.uniform(6.0, 11.0), rng.normal(*STATURES))
        if feet is not None and feet.ambiguous[0]:
            out.append(feet)
    return out


def near(rng: np.random.Generator, feet: GroundDetections) -> State:
    """A leaf near the place of box 0."""
    x, y = feet.point[0, :2] + rng.normal(0, 0.5, 2)
    return leaf(x, y, rng.normal(STATURES.mean, 0.05), rng.uniform(0.03, 0.12))


def across(state: State, feet: GroundDetections) -> tuple[float, float, State]:
    """Cross-range m of a leaf from the line of sight of box 0, its variance m², and the leaf after the Kalman update by it."""
    u = feet.direction[0, :2] / np.hypot(*feet.direction[0, :2])
    H = np.array([-u[1], u[0], 0.0, 0.0, 0.0])
    cross, distance = H[:2] @ (state.x[:2] - feet.origin[:2]), u @ (state.x[:2] - feet.origin[:2])
    S = H @ state.P @ H + feet.covariance[0, 0, 0] * distance**2 + SPREAD**2
    K = state.P @ H / S
    return cross, S, State(state.x - K * cross, state.P - np.outer(K, K) * S)


def test_the_compiled_update_is_the_integral_over_place_and_stature() -> None:
    """Moments and density by sums over a dense grid of distance, cross-range and stature; velocities follow by their regression on these."""
    rng = np.random.default_rng(1)
    for feet in ambiguous_boxes(rng, 6):
        before, ranges = near(rng, feet), feet.ranges
        assert ranges is not None
        usual = ranges.statures
        u = feet.direction[0, :2] / np.hypot(*feet.direction[0, :2])
        A = np.zeros((3, 5))
        A[0, :2], A[1, :2], A[2, 4] = u, (-u[1], u[0]), 1.0
        mean, P = A @ before.x - [*(A[:2, :2] @ feet.origin[:2]), 0.0], A @ before.P @ A.T
        axes = [np.linspace(m - 6 * s, m + 6 * s, n) for m, s, n in zip(mean, np.sqrt(np.diag(P)), (241, 61, 81), strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        cell = np.prod([a[1] - a[0] for a in axes])
        apart = points - mean
        prior = np.exp(-0.5 * np.einsum("...i,ij,...j->...", apart, np.linalg.inv(P), apart)) / np.sqrt((2 * np.pi) ** 3 * np.linalg.det(P))
        columns = (np.interp(axes[0], ranges.distance, c[0], left=0.0, right=0.0) for c in (ranges.edge, ranges.height, ranges.error))
        edge, height, error = (c[:, None, None] for c in columns)
        error = np.maximum(error, 1e-6)
        inlier = np.exp(-0.5 * ((height - points[..., 2]) / error) ** 2) / error * usual.sigma
        stature = (1 - OUTLIER_SHARE) * inlier + OUTLIER_SHARE * ((height > STATURE_RANGE[0]) & (height < STATURE_RANGE[1]))
        away = u @ (before.x[:2] - feet.origin[:2])
        R = feet.covariance[0, 0, 0] * away**2 + SPREAD**2
        weight = prior * np.exp(-0.5 * points[..., 1] ** 2 / R) / np.sqrt(2 * np.pi * R) * edge * stature * cell
        total = weight.sum()
        then = np.einsum("ijk,ijkl->l", weight, points) / total
        covariance = np.einsum("ijk,ijkl,ijkm->lm", weight, points - then, points - then) / total
        G = np.linalg.solve(P, A @ before.P).T
        after = updated(before, feet)
        np.testing.assert_allclose(after.x, before.x + G @ (then - mean), atol=0.02)
        np.testing.assert_allclose(after.P, before.P + G @ (covariance - P) @ G.T, atol=0.02)
        assert log_density(before, feet) == pytest.approx(np.log(away * total), abs=0.05)


def test_an_ambiguous_box_with_one_mode_updates_a_leaf_like_a_kalman_filter() -> None:
    feet, start = one_box(grid(LEVEL)), leaf(7.6, 0.3)
    # The same box, its lower edge taken for feet.
    table = table_of(feet)._replace(stature=np.zeros(1, dtype=bool), ambiguous=np.full(1, -1))
    level, one, missed = (np.zeros(1), np.zeros((1, 2))), np.ones(1, dtype=np.int64), np.zeros((1, 1))
    parents = ParentHypotheses(start.x[None], start.P[None], *level, missed, np.zeros(1, dtype=bool), one, np.zeros((1, 1)))
    child = ChildHypotheses(*empty_children(1, 1))
    child.state[:], child.covariance[:] = start.x, start.P
    # Along the line of sight the range likelihood has its own deviation of the feet.
    limits = LIMITS._replace(foot_spread=FOOT_SIGMA)
    update_child(0, 0, 0, 0, parents, table, limits, child)
    after = updated(start, feet, limits)
    np.testing.assert_allclose(after.x[:2], child.state[0, :2], atol=0.05)
    np.testing.assert_allclose(after.P[:2, :2], child.covariance[0, :2, :2], atol=0.02)


def test_a_leaf_behind_a_wall_keeps_its_distance() -> None:
    # The wall's top, 5 m ahead, is in line with the box's lower edge: the person is 5.2 m away or more, by the head.
    tops = LEVEL.copy()
    tops[:, 125] = 1.5 * (1 - 5.0 / 8.0)
    feet = one_box(grid(tops))
    assert feet.ambiguous[0]
    start = leaf(6.2, 0.4)
    after = updated(start, feet)
    assert abs(after.x[1]) < 0.15
    assert 5.8 < after.x[0] < 7.0
    assert after.P[0, 0] < start.P[0, 0]


def test_leaves_outside_the_gate_have_no_density() -> None:
    feet = one_box(grid(LEVEL))
    here, beside, beyond, behind = (log_density(leaf(x, y), feet) for x, y in ((8.0, 0.0), (8.0, 5.0), (16.0, 0.0), (-8.0, 0.0)))
    assert np.isfinite(here)
    assert beside == beyond == behind == -np.inf


def root(feet: GroundDetections) -> TrackHypotheses:
    """A root from the ambiguous box 0 alone, of nearly known velocity."""
    people, group = STATURES, CrossViewGroup(((0, 0),), feet.point[0, :2], feet.spread[0])
    new = initiated(1, [group], MotionParameters(start_speed=0.01), people, (1, 0, 0))
    nobody, none = np.arange(0), np.zeros((1, 1))
    bodies = Bodies(new.state[:, :2], new.tree, nobody, setup_of(grid(LEVEL), 1.5), lambda camera, cover: np.ones(len(cover)))
    with_statures(new, [group], Observation([feet], [], table_of(feet), LIMITS, new, nobody, bodies, none, none, np.ones(1)), Flat())
    return new


@pytest.mark.soak
def test_many_boxes_of_one_person_stay_consistent_in_distance_and_stature() -> None:
    """A wall hides the legs, so that the distance follows from the head and errs with the stature.

    The errors of distance and stature match their covariance after any number of boxes, and are correlated.
    """
    rng, nees, distance, once = np.random.default_rng(7), [], [], []
    while len(nees) < 150:
        away, stature = rng.uniform(6.0, 11.0), rng.normal(*STATURES)
        seen = [feet for _ in range(12) if (feet := behind_a_wall(rng, away, stature)) is not None and feet.ambiguous[0]]
        if len(seen) < 12 or not STATURE_RANGE[0] < stature < STATURE_RANGE[1]:
            continue
        first = root(seen[0])
        walker = State(first.state[0], first.covariance[0])
        for feet in seen[1:]:
            walker = updated(walker, feet)
        rows = [0, 4]
        error, P = walker.x[rows] - [away, stature], walker.P[np.ix_(rows, rows)]
        nees.append(error @ np.linalg.solve(P, error))
        distance.append(error[0] / np.sqrt(P[0, 0]))
        once.append(P[0, 0] / seen[0].spread[0, 0, 0])
        assert P[0, 1] > 0.5 * np.sqrt(P[0, 0] * P[1, 1])
    assert 1.0 < np.mean(nees) < 4.0
    assert np.mean(np.square(distance)) < 1.8
    assert np.mean(once) > 0.3


def test_a_tall_person_is_farther_away_than_a_short_one_in_the_same_box() -> None:
    feet = behind_a_wall(np.random.default_rng(1), 8.0, 1.75)
    assert feet is not None
    places = []
    for stature in (1.55, 1.75, 1.95):
        start = leaf(8.0, 0.0, stature, 0.03)
        places.append((updated(start, feet).x[0], log_density(start, feet)))
    (short, less), (right, most), (far, least) = places
    assert short < right - 0.2 < right + 0.2 < far
    assert right == pytest.approx(8.0, abs=0.4)
    assert most > max(less, least)
