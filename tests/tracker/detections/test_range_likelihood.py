"""Range likelihoods against people on rough ground and behind walls, whose boxes are made by rays, and the updates that use them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.ground_points import FusionParameters, GroundDetections, project_to_ground
from tracker.detections.range_likelihood import MIN_SIGMA, BoxEdges, RangeLikelihood, RangeLikelihoodParameters, RangePrior, infer_ranges
from tracker.geometry import Array, Pose, bearing_from_angles
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat, Grid
from tracker.gnn.ambiguous_range import AmbiguousUpdate, initiated_along_ray
from tracker.tracks.tracks import MotionParameters, Tracks, initiated, innovations, update
from tracker.types import Detections, Mount, Setup, Start

PARAMETERS = RangeLikelihoodParameters(foot_sigma=0.1, absent_share=0.1, top_sigma=0.0)
"""Parameters for exact maps and people who stand."""
NOISE = 0.003
"""rad, one sigma of an edge of a box."""


def grid(heights: Array) -> Grid:
    """From (-20, -20) m on, 0.2 m apart."""
    return Grid(heights, np.array([-20.0, -20.0]), 0.2)


def rough(rng: np.random.Generator) -> Array:
    """Hills of up to 0.6 m, some metres across."""
    x, y = np.meshgrid(np.linspace(-20, 20, 201), np.linspace(-20, 20, 201))
    waves = [
        rng.uniform(0.05, 0.2) * np.sin(rng.uniform(0.3, 0.9) * (x * np.cos(a) + y * np.sin(a)) + rng.uniform(0, 6)) for a in rng.uniform(0, 6, 4)
    ]
    return np.asarray(sum(waves))


def box(ground: Grid, tops: Grid, eye: Array, feet: Array, stature: float) -> tuple[float, float] | None:
    """Elevations of the lower and the upper edge of what is seen of a body, found by rays; None where less than 0.35 m of it is."""
    away = float(np.hypot(*(feet - eye)[:2]))
    azimuth = np.arctan2(feet[1] - eye[1], feet[0] - eye[0])
    up = np.linspace(0.0, stature, 400)
    elevation = np.arctan((feet[2] + up - eye[2]) / away)
    rays, origins = bearing_from_angles(np.full(400, azimuth), elevation), np.broadcast_to(eye, (400, 3))
    seen = np.ones(400, dtype=bool)
    for heights in (ground, tops):
        stop, stopped = heights.intersect(origins, rays, 60.0)
        seen &= ~(stopped & (np.hypot(*(stop - eye)[:, :2].T) < away - 0.05))
    if seen.sum() < 400 * 0.35 / stature or not seen[-1]:
        return None
    return float(elevation[seen.argmax()]), float(elevation[-1])


def ranges_of(ground: Grid | Flat, tops: Grid | Flat, eye: Array, azimuth: Array, edges: tuple[Array, Array], lying: float = 0.0) -> RangeLikelihood:
    n = len(azimuth)
    return infer_ranges((ground, tops), eye, BoxEdges(azimuth, np.zeros(n), *edges, np.full(n, NOISE**2), np.full(n, lying)), 0.0, PARAMETERS)


def test_distances_and_their_errors_are_consistent_on_rough_ground_and_behind_walls() -> None:
    """400 people in 20 worlds, more than one in ten with hidden feet: errors match their standard deviations."""
    rng, z, error, plain, hidden = np.random.default_rng(5), [], [], [], []
    for _ in range(20):
        heights = rough(rng)
        walls = heights.copy()
        for row, column in rng.integers(20, 180, (40, 2)):
            walls[row : row + rng.integers(1, 3), column : column + rng.integers(2, 12)] += rng.uniform(0.3, 1.0)
        ground, tops = grid(heights), grid(walls)
        eye = np.array([0.0, 0.0, float(ground.height_at(np.zeros((1, 2)))[0]) + 1.8])
        count = 0
        while count < 20:
            x, y = rng.uniform(-15, 15, 2)
            feet = np.array([x, y, float(ground.height_at(np.array([[x, y]]))[0])])
            away = float(np.hypot(x, y))
            edges = box(ground, tops, eye, feet, float(rng.normal(PARAMETERS.stature, PARAMETERS.stature_sigma)))
            if away < 2 or edges is None or float(tops.height_at(feet[None])[0]) > feet[2] + 0.01:
                continue
            count += 1
            low, high = edges[0] + rng.normal(0, NOISE), edges[1] + rng.normal(0, NOISE)
            found = ranges_of(ground, tops, eye, np.array([np.arctan2(y, x)]), (np.array([low]), np.array([high])))
            assert found.possible[0]
            z.append((found.mean[0] - away) / found.sigma[0])
            error.append(found.mean[0] - away)
            point, meets = ground.intersect(eye[None], bearing_from_angles(np.arctan2([y], [x]), np.array([low])), 60.0)
            plain.append(float(np.hypot(*point[0, :2])) - away if meets[0] else 20.0)
            hidden.append(found.feet_hidden[0])
    assert 0.6 < np.mean(np.square(z)) < 1.6
    assert np.mean(np.abs(z) < 3) > 0.97
    often = np.array(hidden) > 0.5
    assert 0.1 < often.mean() < 0.9
    # Where feet are hidden, the head and the world carry most of the information.
    assert np.sqrt(np.mean(np.square(error)[often])) < 0.5 * np.sqrt(np.mean(np.square(plain)[often]))
    assert np.sqrt(np.mean(np.square(error)[~often])) < 1.05 * np.sqrt(np.mean(np.square(plain)[~often]))


def test_probabilities_of_hidden_feet_are_calibrated() -> None:
    """Predicted probabilities match frequencies, for people at all distances along a line over a ridge."""
    heights = np.zeros((201, 201))
    heights[:, 135:138] = 0.5  # from 7 m ahead on
    ground, eye, rng = grid(heights), np.array([0.0, 0.0, 1.6]), np.random.default_rng(3)
    predicted, true = [], []
    for _ in range(3000):
        away = rng.uniform(2.0, 18.0)
        feet = np.array([away, 0.0, float(ground.height_at(np.array([[away, 0.0]]))[0])])
        edges = box(ground, ground, eye, feet, float(rng.normal(PARAMETERS.stature, PARAMETERS.stature_sigma)))
        if edges is not None:
            low, high = np.array(edges) + rng.normal(0, NOISE, 2)
            predicted.append(ranges_of(ground, ground, eye, np.zeros(1), (np.array([low]), np.array([high]))).feet_hidden[0])
            true.append(edges[0] > np.arctan((feet[2] - eye[2]) / away) + 1e-3)
    order, truth = np.digitize(predicted, [0.1, 0.3, 0.7, 0.9]), np.array(true)
    share = [truth[order == k].mean() for k in range(5) if (order == k).sum() > 20]
    means = [np.mean(np.array(predicted)[order == k]) for k in range(5) if (order == k).sum() > 20]
    assert len(share) >= 3
    np.testing.assert_allclose(share, means, atol=0.15)


def test_on_a_plane_the_distance_is_where_the_lower_edge_meets_the_ground() -> None:
    away = np.array([3.0, 8.0, 15.0])
    found = ranges_of(Flat(), Flat(), np.array([0.0, 0.0, 1.5]), np.array([0.1, 1.0, -2.0]), (np.arctan(-1.5 / away), np.arctan(0.22 / away)))
    np.testing.assert_allclose(found.mean, away, rtol=0.02)
    slanted = NOISE * (away**2 + 1.5**2) / 1.5  # of the distance, by the elevation
    np.testing.assert_allclose(found.sigma, np.hypot(slanted, 0.1), rtol=0.15)
    assert found.feet_hidden.max() < 1e-6
    # A box that fits no stature at any distance has no place.
    assert not ranges_of(Flat(), Flat(), np.array([0.0, 0.0, 1.5]), np.zeros(1), (np.array([0.2]), np.array([0.3]))).possible[0]


def test_standard_deviations_are_at_least_a_millimetre() -> None:
    """The edges leave a single grid point."""
    away, sharp = 8.0, RangeLikelihoodParameters(foot_sigma=0.0, head_sigma=1e-3, outlier_share=0.0, stature_sigma=1e-3)
    edges = BoxEdges(np.zeros(1), np.zeros(1), np.arctan([-1.5 / away]), np.arctan([0.22 / away]), np.full(1, 1e-4**2), np.zeros(1))
    assert infer_ranges((Flat(), Flat()), np.array([0.0, 0.0, 1.5]), edges, 0.0, sharp).sigma[0] >= MIN_SIGMA


def test_a_person_under_an_arch_is_possible_though_the_map_has_only_its_top() -> None:
    tops = np.zeros((201, 201))
    tops[:, 125:127] = 3.0  # 5 m ahead: what the grid takes for a wall
    found = ranges_of(Flat(), grid(tops), np.array([0.0, 0.0, 1.5]), np.zeros(1), (np.arctan([-1.5 / 8.0]), np.arctan([0.22 / 8.0])))
    assert found.mean[0] == pytest.approx(8.0, abs=0.2)


def test_the_posterior_is_that_of_two_measurements() -> None:
    found = ranges_of(Flat(), Flat(), np.array([0.0, 0.0, 1.5]), np.zeros(1), (np.arctan([-1.5 / 8.0]), np.arctan([0.22 / 8.0])))

    def posterior(away: float, variance: float) -> tuple[float, Array, Array]:
        usual = RangePrior(np.array([[away, PARAMETERS.stature]]), np.diag([variance, PARAMETERS.stature_sigma**2])[None])
        box = np.zeros(1, dtype=np.int64)
        (mean,), (covariance,) = found.posterior(box, usual)
        return float(found.density(box, usual)[0]), mean, covariance

    density, mean, covariance = posterior(8.6, 0.25)
    _, before, spread = posterior(8.0, 1e6)
    weight = 0.25 / (0.25 + spread[0, 0])
    assert mean[0] == pytest.approx(8.6 + weight * (before[0] - 8.6), abs=0.02)
    assert covariance[0, 0] == pytest.approx(0.25 * (1 - weight), rel=0.05)
    assert posterior(11.0, 0.25)[0] < 1e-3 * density


def one_box(tops: Grid, edges: tuple[float, float] = (-np.arctan(1.5 / 8.0), np.arctan(0.22 / 8.0)), up: float = 1.5) -> GroundDetections:
    """Somebody on a plane whose things are `tops`, seen from `up` m: 8 m ahead, or as the elevations of the box's edges are."""
    low, high = edges
    bearing, extent = bearing_from_angles(np.zeros(1), np.array([(low + high) / 2])), np.array([[0.06, high - low]])
    boxes = Detections(bearing, extent, np.full(1, 0.9), np.tile(NOISE**2 * np.eye(2), (1, 1, 1)), np.zeros((1, 0)))
    mount = Mount(Panorama(1024, 512), Pose(np.eye(3), np.array([0.0, 0.0, up])), "r")
    setup = Setup({"r": mount}, Flat(), {"r": Start(Pose.identity(), np.zeros((6, 6)))}, 1 / 6, occluders=tops)
    return project_to_ground(setup, "r", boxes, (Pose.identity(), np.zeros((6, 6))), FusionParameters())


def track(x: float, y: float, stature: float = PARAMETERS.stature, sigma: float = PARAMETERS.stature_sigma) -> Tracks:
    covariance = np.diag([0.4, 0.3, 1.0, 1.0, sigma**2])
    covariance[0, 1] = covariance[1, 0] = 0.1
    one: NDArray[np.int64] = np.ones(1, dtype=np.int64)
    return replace(Tracks.none(), tree=one, state=np.array([[x, y, 0.0, 0.0, stature]]), covariance=covariance[None])


def test_an_ambiguous_box_with_one_mode_updates_a_track_like_a_kalman_filter() -> None:
    motion, feet = MotionParameters(foot_spread=RangeLikelihoodParameters().foot_sigma), one_box(grid(np.zeros((201, 201))))
    start = track(7.6, 0.3)
    foot = innovations(start, feet, np.zeros((1, 2)), Flat(), motion)
    R = feet.covariance[0] + foot.H[0] @ foot.H[0].T * motion.foot_spread**2
    plain = update(start, 0, foot.residual[0, 0], foot.H[0], R)
    after = AmbiguousUpdate.of(start, feet, np.zeros(1, dtype=np.int64), np.zeros((1, 2)), motion.foot_spread).correct(start, 0, 0)
    np.testing.assert_allclose(after.state[0, :2], plain.state[0, :2], atol=0.05)
    np.testing.assert_allclose(after.covariance[0, :2, :2], plain.covariance[0, :2, :2], atol=0.02)


def test_a_track_behind_a_wall_keeps_its_distance() -> None:
    # The wall's top, 5 m ahead, is in line with the box's lower edge: the person is 5.2 m away or more, by the head.
    tops = np.zeros((201, 201))
    tops[:, 125] = 1.5 * (1 - 5.0 / 8.0)
    feet = one_box(grid(tops))
    assert feet.ambiguous[0]
    start = track(6.2, 0.4)
    after = AmbiguousUpdate.of(start, feet, np.zeros(1, dtype=np.int64), np.zeros((1, 2)), 0.25).correct(start, 0, 0)
    assert abs(after.state[0, 1]) < 0.15
    assert 5.8 < after.state[0, 0] < 7.0
    assert after.covariance[0, 0, 0] < start.covariance[0, 0, 0]


def test_tracks_outside_the_gate_have_no_density() -> None:
    feet = one_box(grid(np.zeros((201, 201))))
    box = np.zeros(1, dtype=np.int64)
    here, beside, beyond, behind = (
        AmbiguousUpdate.of(track(x, y), feet, box, np.zeros((1, 2)), 0.25).density(4.0)[0, 0]
        for x, y in ((8.0, 0.0), (8.0, 5.0), (16.0, 0.0), (-8.0, 0.0))
    )
    assert np.isfinite(here)
    assert beside == beyond == behind == -np.inf


def behind_a_wall(rng: np.random.Generator, away: float, stature: float) -> GroundDetections | None:
    """A box of somebody `away` m ahead whose legs a wall hides, as a camera 0.8 m up has it."""
    tops = np.zeros((201, 201))
    tops[:, 125:127] = 0.6
    world, eye = grid(tops), np.array([0.0, 0.0, 0.8])
    edges = box(grid(np.zeros((201, 201))), world, eye, np.array([away, 0.0, 0.0]), stature)
    return None if edges is None else one_box(world, (edges[0] + rng.normal(0, NOISE), edges[1] + rng.normal(0, NOISE)), 0.8)


def test_many_boxes_of_one_person_stay_consistent_in_distance_and_stature() -> None:
    """A wall hides the legs, so that the distance follows from the head and errs with the stature.

    The errors of distance and stature match their covariance after any number of boxes, and are correlated.
    """
    rng, nees, distance, once = np.random.default_rng(7), [], [], []
    while len(nees) < 150:
        away, stature = rng.uniform(6.0, 11.0), rng.normal(PARAMETERS.stature, PARAMETERS.stature_sigma)
        seen = [feet for _ in range(12) if (feet := behind_a_wall(rng, away, stature)) is not None and feet.ambiguous[0]]
        if len(seen) < 12 or not PARAMETERS.stature_range[0] < stature < PARAMETERS.stature_range[1]:
            continue
        first, motion = seen[0], MotionParameters(start_speed=0.01)
        group = CrossViewGroup(((0, 0),), first.point[0, :2], first.spread[0])
        walker = initiated_along_ray(initiated(1, [group], motion, (PARAMETERS.stature, PARAMETERS.stature_sigma)), 0, first, 0)
        for feet in seen[1:]:
            walker = AmbiguousUpdate.of(walker, feet, np.zeros(1, dtype=np.int64), np.zeros((1, 2)), motion.foot_spread).correct(walker, 0, 0)
        rows = [0, 4]
        error, P = walker.state[0, rows] - [away, stature], walker.covariance[0][np.ix_(rows, rows)]
        nees.append(error @ np.linalg.solve(P, error))
        distance.append(error[0] / np.sqrt(P[0, 0]))
        once.append(P[0, 0] / first.spread[0, 0, 0])
        assert P[0, 1] > 0.5 * np.sqrt(P[0, 0] * P[1, 1])
    assert 1.0 < np.mean(nees) < 4.0
    assert np.mean(np.square(distance)) < 1.8
    assert np.mean(once) > 0.3


def test_a_tall_person_is_farther_away_than_a_short_one_in_the_same_box() -> None:
    feet = behind_a_wall(np.random.default_rng(1), 8.0, 1.75)
    assert feet is not None
    places = []
    for stature in (1.55, 1.75, 1.95):
        start = track(8.0, 0.0, stature, 0.03)
        ambiguous = AmbiguousUpdate.of(start, feet, np.zeros(1, dtype=np.int64), np.zeros((1, 2)), 0.25)
        places.append((ambiguous.correct(start, 0, 0).state[0, 0], ambiguous.density(4.0)[0, 0]))
    (near, less), (right, most), (far, least) = places
    assert near < right - 0.2 < right + 0.2 < far
    assert right == pytest.approx(8.0, abs=0.4)
    assert most > max(less, least)
