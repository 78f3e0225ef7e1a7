from __future__ import annotations

import numpy as np
import pytest

from tracker.ekf.lie_kernels import compose, exponential, retract, retraction_jacobian, right_jacobian
from tracker.geometry import Pose, exp_so3, log_so3

SIZES = [0.0, 1e-9, 1e-7, 1e-4, 9.9e-3, 1.01e-2, 0.3, 2.0, np.pi - 1e-7, np.pi]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def random_pose(rng: np.random.Generator) -> Pose:
    return Pose.exp(np.concatenate([rng.normal(size=3), rng.normal(size=3)]))


@pytest.mark.parametrize("size", SIZES)
def test_exponentials_agree_with_geometry(rng: np.random.Generator, size: float) -> None:
    phi = rng.normal(size=(4, 3))
    phi *= size / np.linalg.norm(phi, axis=1, keepdims=True)
    np.testing.assert_allclose(exponential(phi), [exp_so3(p) for p in phi], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-7, 1e-4, 9.9e-3, 1.01e-2, 0.3, 2.0, 3.1])
def test_the_right_jacobian_against_differences(rng: np.random.Generator, angle: float) -> None:
    step, phi = 1e-6, rng.normal(size=(10, 3))
    phi *= angle / np.linalg.norm(phi, axis=1, keepdims=True)
    for row, J in zip(phi, right_jacobian(phi), strict=True):
        R = exp_so3(row)
        columns = [(log_so3(R.T @ exp_so3(row + step * e)) - log_so3(R.T @ exp_so3(row - step * e))) / (2 * step) for e in np.eye(3)]
        np.testing.assert_allclose(J, np.stack(columns, axis=1), atol=1e-7)


def test_compose_moves_the_pose_and_its_error(rng: np.random.Generator) -> None:
    before, motion = random_pose(rng), random_pose(rng)
    R, t, F = compose(before.rotation, before.translation, motion)
    now = before @ motion
    np.testing.assert_allclose(R, now.rotation, atol=1e-12)
    np.testing.assert_allclose(t, now.translation, atol=1e-12)
    step = 1e-6
    for i, axis in enumerate(np.eye(6) * step):
        up, down = before @ Pose.exp(axis) @ motion, before @ Pose.exp(-axis) @ motion
        # The tangent is that of R³ × SO(3): differences of translation along the body's axes.
        difference = ((now.inverse() @ up).log() - (now.inverse() @ down).log()) / (2 * step)
        np.testing.assert_allclose(F[:, i], difference, atol=1e-8)


@pytest.mark.parametrize("size", SIZES)
def test_retraction_jacobian_against_differences(rng: np.random.Generator, size: float) -> None:
    T = random_pose(rng)
    direction = rng.normal(size=3)
    xi = np.concatenate([rng.normal(size=3), direction * size / np.linalg.norm(direction)])
    J = retraction_jacobian(xi[None])[0]
    here, step = T @ Pose.exp(xi), 1e-6
    for i, axis in enumerate(np.eye(6) * step):
        up, down = ((here.inverse() @ (T @ Pose.exp(xi + s * axis))).log() for s in (1, -1))
        np.testing.assert_allclose(J[:, i], (up - down) / (2 * step), atol=2e-6)


def test_retract_is_the_pose_product(rng: np.random.Generator) -> None:
    poses, xi = [random_pose(rng) for _ in range(5)], rng.normal(size=(5, 6))
    R, t = retract(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]), xi)
    for i, pose in enumerate(poses):
        want = pose @ Pose.exp(xi[i])
        np.testing.assert_allclose(R[i], want.rotation, atol=1e-12)
        np.testing.assert_allclose(t[i], want.translation, atol=1e-12)
