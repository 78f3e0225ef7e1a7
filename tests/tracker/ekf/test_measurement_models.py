from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tracker.ekf.measurement_models import CameraPose, gravity, intersect, jacobians, predict, residual, triangulate
from tracker.geometry import Pose, bearing_from_angles, exp_so3, log_so3, tangent_basis


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def random_camera(rng: np.random.Generator, tilt: float = 0.3) -> CameraPose:
    body = Pose.exp(np.concatenate([rng.normal(size=3), rng.normal(size=3)]))
    mount = Pose.exp(np.concatenate([0.3 * rng.normal(size=3), 0.5 * rng.normal(size=3)]))
    return CameraPose(body.rotation, body.translation, mount.rotation, mount.translation, tilt * rng.normal(size=3))


def moved(s: CameraPose, xi: np.ndarray) -> CameraPose:
    body = Pose(s.body_rotation, s.body_translation) @ Pose.exp(xi)
    return replace(s, body_rotation=body.rotation, body_translation=body.translation)


def with_correction(s: CameraPose, delta: np.ndarray) -> CameraPose:
    return replace(s, correction=log_so3(exp_so3(s.correction) @ exp_so3(delta)))


def test_a_camera_pose_is_the_product_of_its_frames(rng: np.random.Generator) -> None:
    s = random_camera(rng)
    body, mount = Pose(s.body_rotation, s.body_translation), Pose(s.mount_rotation, s.mount_translation)
    offset = Pose(mount.rotation.T @ exp_so3(s.correction) @ mount.rotation, np.zeros(3))
    camera, points = body @ mount @ offset, rng.normal(size=(6, 3))
    np.testing.assert_allclose(s.points(points), camera.inverse().apply(points), atol=1e-12)
    np.testing.assert_allclose(s.origin, camera.translation, atol=1e-12)


def residual_at(predicted: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """The residual of the direction at the rotation `turn` (2,) from the predicted one."""
    axis = np.cross(predicted, turn @ tangent_basis(predicted))
    return residual(exp_so3(axis) @ predicted, predicted)


@pytest.mark.parametrize("elevation", [0.0, 0.7, np.pi / 2 - 1e-7, np.pi / 2, -np.pi / 2 + 1e-9])
@pytest.mark.parametrize("azimuth", [0.0, np.pi, -np.pi + 1e-9, 2.0])
@pytest.mark.parametrize("turn", [(0.0, 0.0), (1e-9, 0.0), (1e-3, -2e-3), (0.8, 0.6), (3.0, 0.5)])
def test_residual_is_the_rotation_in_all_directions(azimuth: float, elevation: float, turn: tuple[float, float]) -> None:
    predicted = bearing_from_angles(azimuth, elevation)
    np.testing.assert_allclose(residual_at(predicted, np.array(turn)), turn, atol=1e-8)


DIRECTIONS = [(0.4, 0.1), (np.pi, -0.2), (1.0, np.pi / 2 - 1e-7), (-2.0, -np.pi / 2 + 1e-4), (3.0, 1.2)]


@pytest.mark.parametrize("angles", DIRECTIONS)
@pytest.mark.parametrize("distance", [0.3, 5.0, 1000.0])
@pytest.mark.parametrize("tilt", [0.0, 1e-8, 0.3])
def test_jacobians_against_differences(rng: np.random.Generator, angles: tuple[float, float], distance: float, tilt: float) -> None:
    s = random_camera(rng, tilt)
    landmark = s.origin + distance * s.rotation @ bearing_from_angles(*angles)
    here = predict(s, landmark[None])[0][0]
    H_body, H_point, H_correction = (H[0] for H in jacobians(s, landmark[None]))

    def difference(f: object, n: int, step: float) -> np.ndarray:
        columns = [(residual(f(+d), here) - residual(f(-d), here)) / (2 * step) for d in np.eye(n) * step]  # type: ignore[operator]
        return np.stack(columns, axis=1)

    step = 1e-6 * min(distance, 1.0)
    np.testing.assert_allclose(H_body, difference(lambda d: predict(moved(s, d), landmark[None])[0][0], 6, step), atol=1e-7 / min(distance, 1))
    np.testing.assert_allclose(H_point, difference(lambda d: predict(s, landmark[None] + d)[0][0], 3, step), atol=1e-7 / min(distance, 1))
    np.testing.assert_allclose(H_correction, difference(lambda d: predict(with_correction(s, d), landmark[None])[0][0], 3, step), atol=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 1e-8, 0.5, np.pi / 2])
def test_gravity_against_differences(rng: np.random.Generator, tilt: float) -> None:
    R = exp_so3([0, 0, 1.0]) @ exp_so3([tilt, 0, 0]) @ exp_so3([0, 0, -2.0])
    r, H = gravity(R, R[2])
    np.testing.assert_allclose(r, 0, atol=1e-12)
    step = 1e-6
    for i, axis in enumerate(np.eye(3) * step):
        up, down = ((R @ exp_so3(s * axis))[2] for s in (1, -1))
        np.testing.assert_allclose(H[:, 3 + i], (residual(up, R[2]) - residual(down, R[2])) / (2 * step), atol=1e-8)
    assert not H[:, :3].any()


def test_intersect_many_bundles(rng: np.random.Generator) -> None:
    points, origins = rng.normal(size=(7, 3)) * 5, rng.normal(size=(7, 3, 3))
    rays = points[:, None] - origins
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    found, ahead = intersect(origins, rays)
    np.testing.assert_allclose(found, points, atol=1e-9)
    assert ahead.all()
    assert not intersect(origins, -rays)[1].any()
    assert not intersect(origins, np.tile([1.0, 0, 0], (7, 3, 1)))[1].any()


def rows(cameras: list[CameraPose]) -> CameraPose:
    s = cameras[0]
    return replace(s, body_rotation=np.stack([t.body_rotation for t in cameras]), body_translation=np.stack([t.body_translation for t in cameras]))


def test_camera_poses_in_rows_equal_single_ones(rng: np.random.Generator) -> None:
    first, landmarks = random_camera(rng), rng.normal(size=(4, 3)) * 5
    cameras = [moved(first, rng.normal(size=6)) for _ in range(4)]
    together = jacobians(rows(cameras), landmarks)
    for i, s in enumerate(cameras):
        np.testing.assert_allclose(predict(rows(cameras), landmarks)[0][i], predict(s, landmarks[i : i + 1])[0][0], atol=1e-12)
        for H, single in zip(together, jacobians(s, landmarks[i : i + 1]), strict=True):
            np.testing.assert_allclose(H[i], single[0], atol=1e-12)


def bundle(rng: np.random.Generator, k: int, sigma: float) -> tuple[list[CameraPose], np.ndarray, np.ndarray, np.ndarray]:
    """k cameras along a path of 1 m, a point 5 m away, and its bearings with noise."""
    correction = 0.02 * rng.normal(size=3)
    point, cameras = np.array([1.0, 5.0, 1.0]), []
    for i in range(k):
        body = Pose.exp(np.concatenate([[i / (k - 1), 0, 0], 0.1 * rng.normal(size=3)]))
        cameras.append(CameraPose(body.rotation, body.translation, np.eye(3), np.array([0.1, 0.0, 0.4]), correction))
    exact = np.stack([predict(s, point[None])[0][0] for s in cameras])
    noisy = exact + (rng.normal(size=(k, 1, 2)) * sigma @ tangent_basis(exact))[:, 0]
    return cameras, noisy / np.linalg.norm(noisy, axis=1, keepdims=True), np.tile(np.eye(2) * max(sigma, 1e-3) ** 2, (k, 1, 1)), point


@pytest.mark.parametrize("k", [2, 3, 5])
def test_triangulation_recovers_the_point_and_its_jacobians(rng: np.random.Generator, k: int) -> None:
    cameras, bearings, covariances, point = bundle(rng, k, 0.0)
    found = triangulate(rows(cameras), bearings, covariances, point + 0.01)
    np.testing.assert_allclose(found.point, point, atol=1e-6)
    step = 1e-5
    for i in range(k):
        for axis in range(6):
            d = np.eye(6)[axis] * step
            shifted = ([moved(s, sign * d) if j == i else s for j, s in enumerate(cameras)] for sign in (1, -1))
            up, down = (triangulate(rows(one), bearings, covariances, point) for one in shifted)
            np.testing.assert_allclose(found.G_body[:, i, axis], (up.point - down.point) / (2 * step), atol=1e-3)
            # The misfit falls as the poses rise towards the truth: residual = measured − predicted.
            np.testing.assert_allclose(found.misfit_body[:, i, axis] ** 2, ((down.misfit - up.misfit) / (2 * step)) ** 2, atol=2.0, rtol=1e-2)
    for axis in range(3):
        d = np.eye(3)[axis] * step
        up, down = (triangulate(rows([with_correction(s, sign * d) for s in cameras]), bearings, covariances, point) for sign in (1, -1))
        np.testing.assert_allclose(found.G_correction[:, axis], (up.point - down.point) / (2 * step), atol=1e-3)


def test_triangulation_has_a_consistent_covariance_and_misfit() -> None:
    errors, misfits = [], []
    for seed in range(300):
        cameras, bearings, covariances, point = bundle(np.random.default_rng(seed), 3, 0.002)
        found = triangulate(rows(cameras), bearings, covariances, point + 0.1)
        e = found.point - point
        errors.append(e @ np.linalg.solve(found.noise_covariance, e) / 3)
        misfits.append(found.misfit @ found.misfit / 3)
    assert np.mean(errors) == pytest.approx(1.0, abs=0.15)
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.15)
