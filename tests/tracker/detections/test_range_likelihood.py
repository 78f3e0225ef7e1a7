"""Range likelihoods against people on rough ground and behind walls, whose boxes are made by rays."""

from __future__ import annotations

import numpy as np
import pytest

from tracker.detections import range_likelihood
from tracker.detections.range_likelihood import BoxEdges, RangeLikelihood, Statures, infer_ranges
from tracker.geometry import Array, bearing_from_angles
from tracker.geometry.ground import Flat, Grid

STATURES = Statures(1.72, 0.12)
NOISE = 0.003
"""rad, one sigma of an edge of a box."""


@pytest.fixture(autouse=True)
def _exact_maps_and_people_who_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"FOOT_SIGMA": 0.1, "ABSENT_SHARE": 0.1, "TOP_SIGMA": 0.0}.items():
        monkeypatch.setattr(range_likelihood, name, value)


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


def ranges_of(
    ground: Grid | Flat, tops: Grid | Flat, eye: Array, azimuth: Array, edges: tuple[Array, Array], border: float = -np.pi / 2
) -> RangeLikelihood:
    n = len(azimuth)
    boxes = BoxEdges(azimuth, np.zeros(n), *edges, np.full(n, NOISE**2), np.zeros(n), np.full(n, border))
    return infer_ranges((ground, tops), eye, boxes, 0.0, STATURES)


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
            edges = box(ground, tops, eye, feet, float(rng.normal(*STATURES)))
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
        edges = box(ground, ground, eye, feet, float(rng.normal(*STATURES)))
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


def test_a_person_under_an_arch_is_possible_though_the_map_has_only_its_top() -> None:
    tops = np.zeros((201, 201))
    tops[:, 125:127] = 3.0  # 5 m ahead: what the grid takes for a wall
    found = ranges_of(Flat(), grid(tops), np.array([0.0, 0.0, 1.5]), np.zeros(1), (np.arctan([-1.5 / 8.0]), np.arctan([0.22 / 8.0])))
    assert found.mean[0] == pytest.approx(8.0, abs=0.2)


def test_distances_of_people_whose_feet_are_below_the_image_are_consistent() -> None:
    """The head and usual statures tell the distance. Feet below the edge of the image are as hidden as those behind a wall."""
    rng, eye, border, z = np.random.default_rng(1), np.array([0.0, 0.0, 2.4]), -0.5, []
    nearest = eye[2] / np.tan(-border)
    for _ in range(200):
        away, stature = rng.uniform(0.6 * nearest, 0.95 * nearest), rng.normal(*STATURES)
        high = np.arctan((stature - eye[2]) / away) + rng.normal(0, NOISE)
        found = ranges_of(Flat(), Flat(), eye, np.zeros(1), (np.array([border]), np.array([high])), border)
        assert found.feet_hidden[0] > 0.5
        z.append((found.mean[0] - away) / found.sigma[0])
    assert 0.4 < np.mean(np.square(z)) < 1.6
