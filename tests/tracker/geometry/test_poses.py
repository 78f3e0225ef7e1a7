"""Rigid motions, angles and directions: laws at random points, near and at singularities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from tracker.geometry import (
    Array,
    Pose,
    angles_from_bearing,
    bearing_from_angles,
    exp_so3,
    frozen,
    log_so3,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_z,
    skew,
    tangent_basis,
    wrap,
)

# Angles of rotation: ordinary, near 0, at the ends of the series, near π and at π.
ANGLES = [0.0, 1e-300, 1e-16, 1e-9, 1e-7, 9.9e-6, 1.01e-5, 9.9e-5, 1.01e-4, 0.1, 1.0, 2.0, 3.0, np.pi - 1e-4, np.pi - 1e-7, np.pi - 1e-9]


def axes(seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    found = np.concatenate([np.eye(3), -np.eye(3), rng.normal(0, 1, (20, 3)), [[1.0, 1, 0], [1, 1e-9, 0]]])
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def poses(n: int = 30, seed: int = 1) -> list[Pose]:
    rng = np.random.default_rng(seed)
    return [Pose.exp(rng.normal(0, 1.5, 6)) for _ in range(n)]


# --- angles -----------------------------------------------------------------------------------------------------------------------


@given(st.floats(-1e6, 1e6))
def test_wrap_keeps_the_direction_and_the_range(angle: float) -> None:
    w = float(wrap(angle))
    assert -math.pi < w <= math.pi
    assert math.isclose(math.cos(w), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(w), math.sin(angle), abs_tol=1e-9)
    if abs(angle) < 3:
        assert math.isclose(w, angle, abs_tol=1e-15)


def test_wrap_at_its_ends() -> None:
    just_above = np.nextafter(np.pi, 4)
    ends = np.array([np.pi, -np.pi, 3 * np.pi, just_above, -just_above, 0.0, 2 * np.pi])
    w = wrap(ends)
    assert ((w > -np.pi) & (w <= np.pi)).all()
    assert_allclose(np.abs(w[:5]), np.pi)
    assert_allclose(w[[0, 1]], np.pi)
    assert wrap(np.zeros((2, 3))).shape == (2, 3)


@given(st.floats(-math.pi, math.pi, exclude_min=True), st.floats(-1.57, 1.57))
def test_angles_and_bearings_are_inverse(azimuth: float, elevation: float) -> None:
    b = bearing_from_angles(azimuth, elevation)
    assert math.isclose(float(np.linalg.norm(b)), 1, abs_tol=1e-12)
    a, e = angles_from_bearing(5 * b)
    assert abs(wrap(a - azimuth)) < 1e-9 / math.cos(elevation)
    assert math.isclose(float(e), elevation, abs_tol=1e-9)


# --- rotations --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_and_log_are_inverse(angle: float) -> None:
    for axis in axes():
        R = exp_so3(angle * axis)
        assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        assert_allclose(R, Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-14)
        assert_allclose(log_so3(R), angle * axis, atol=1e-12)


def test_log_at_pi_is_one_of_two_vectors() -> None:
    for axis in axes():
        v = log_so3(2 * np.outer(axis, axis) - np.eye(3))
        assert_allclose(np.linalg.norm(v), np.pi, atol=1e-7)
        assert_allclose(np.abs(v @ axis), np.pi, atol=1e-7)


def test_quaternions_are_wxyz_and_inverse() -> None:
    for angle in (*ANGLES, np.pi):
        for axis in axes():
            R = Rotation.from_rotvec(angle * axis).as_matrix()
            q = quaternion_from_rotation(R)
            assert q[0] >= 0
            assert_allclose(np.linalg.norm(q), 1)
            assert_allclose(rotation_from_quaternion(q), R, atol=1e-12)
            assert_allclose(rotation_from_quaternion(-3 * q), R, atol=1e-12)
    assert_allclose(quaternion_from_rotation(rotation_z(np.pi / 2)), [math.sqrt(0.5), 0, 0, math.sqrt(0.5)])
    with pytest.raises(ValueError, match="quaternion has length 0"):
        rotation_from_quaternion(np.zeros(4))
    with pytest.raises(ValueError, match="quaternion has length nan"):
        rotation_from_quaternion([np.nan, 0, 0, 1])


def test_skew_is_the_cross_product() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.normal(0, 1, (2, 5, 3))
    assert_allclose(np.einsum("nij,nj->ni", skew(a), b), np.cross(a, b), atol=1e-15)
    assert_allclose(skew(a[0]), skew(a)[0])


# --- poses ------------------------------------------------------------------------------------------------------------------------


def test_poses_are_a_group() -> None:
    some = poses()
    x = np.random.default_rng(3).normal(0, 2, (4, 3))
    for A, B, C in zip(some, some[1:], some[2:], strict=False):
        assert_allclose((A @ B).apply(x), A.apply(B.apply(x)), atol=1e-12)
        assert_allclose(((A @ B) @ C).apply(x), (A @ (B @ C)).apply(x), atol=1e-12)
        assert_allclose((A @ A.inverse()).apply(x), x, atol=1e-12)
        assert_allclose((A.inverse() @ A).apply(x[0]), x[0], atol=1e-12)
        assert_allclose((A @ Pose.identity()).apply(x), A.apply(x), atol=1e-12)


@pytest.mark.parametrize("angle", ANGLES)
def test_pose_exp_and_log_are_inverse(angle: float) -> None:
    for axis in axes():
        xi = np.concatenate([[3.0, -2, 0.1], angle * axis])
        assert_allclose(Pose.exp(xi).log(), xi, atol=1e-12)
        T = Pose.planar(1, 2, 0.5, 3)
        assert_allclose((T.inverse() @ (T @ Pose.exp(xi))).log(), xi, atol=1e-7 if angle > 3.1 else 1e-12)


def test_many_products_stay_rotations() -> None:
    T, step = Pose.identity(), Pose.exp([0.01, 0, 0, 0.03, -0.02, 0.05])
    for _ in range(20000):
        T = T @ step
    assert_allclose(T.rotation @ T.rotation.T, np.eye(3), atol=1e-14)


def test_poses_are_checked_and_read_only() -> None:
    for rotation, text in (
        (np.eye(2), "rotation has shape"),
        (np.full((3, 3), np.nan), "rotation holds NaN"),
        (2 * np.eye(3), "differs from a rotation"),
        (np.diag([1.0, 1, -1]), "determinant"),
    ):
        with pytest.raises(ValueError, match=text):
            Pose(rotation, np.zeros(3))
    with pytest.raises(ValueError, match="translation holds NaN"):
        Pose(np.eye(3), [0, np.nan, 0])
    with pytest.raises(ValueError, match="translation has shape"):
        Pose(np.eye(3), np.zeros((1, 3)))
    T = Pose.identity()
    with pytest.raises(ValueError, match="read-only"):
        T.translation[0] = 1


def test_frozen_copies_and_checks() -> None:
    source = np.zeros((2, 3))
    copy = frozen(source, (None, 3), "points")
    source[0, 0] = 7
    assert copy[0, 0] == 0
    assert frozen([1, 2], (2,), "pair").dtype == np.float64
    with pytest.raises(ValueError, match=r"points has shape \(2, 3\), needs \('n', 2\)"):
        frozen(source, (None, 2), "points")


# --- directions -------------------------------------------------------------------------------------------------------------------


def test_tangent_bases_are_orthonormal_and_point_the_right_way() -> None:
    b = axes(4)
    basis = tangent_basis(b)
    full = np.concatenate([b[:, None], basis], axis=1)
    assert_allclose(full @ full.transpose(0, 2, 1), np.broadcast_to(np.eye(3), full.shape), atol=1e-12)
    assert_allclose(np.linalg.det(full), 1)
    azimuth, elevation, step = 0.7, 0.4, 1e-6
    across, up = tangent_basis(bearing_from_angles(azimuth, elevation))
    along = (bearing_from_angles(azimuth + step, elevation) - bearing_from_angles(azimuth - step, elevation)) / (2 * step)
    assert_allclose(across * math.cos(elevation), along, atol=1e-9)
    assert_allclose(up, (bearing_from_angles(azimuth, elevation + step) - bearing_from_angles(azimuth, elevation - step)) / (2 * step), atol=1e-9)
    assert tangent_basis([0.0, 0, 1])[0] @ [0, 1, 0] == 1
