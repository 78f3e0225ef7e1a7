"""OpenCV's two camera models: the pinhole with radial and tangential distortion, and the fisheye. Pixel centres lie at whole numbers.

A radial distortion r ↦ r (1 + k₁ r² + k₂ r⁴ + …) grows up to its fold, where its derivative is 0. Beyond the fold two directions would share a pixel.
So directions beyond it have no pixel (NaN). Pixels beyond the image of the fold are blind: no direction projects to them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from tracker.geometry.arrays import Array, Mask
from tracker.geometry.camera_protocol import OPTICAL_FROM_CAMERA, check_size

DIRECTIONS = 90
"""Directions from the principal point in which the fold of a lens with tangential distortion is sought."""
BORDER_POINTS = 33
"""Points along each side of the image at which the fold is checked."""
FOCAL, PRINCIPAL, DISTORTION = (1e-3, 1e9), 1e9, 1e6
"""Bounds of fx and fy px, of |cx| and |cy| px, and of distortion numbers. No real lens comes near them; they keep powers finite."""
ITERATIONS = 100
"""Most Newton steps, bisections included. Near the fold a step only halves the error."""


@dataclass(frozen=True)
class LensCamera(ABC):
    """A camera behind a lens: u = fx x + cx, v = fy y + cy of distorted image coordinates x, y (focal length 1).

    fx, fy, cx, cy: px. The pixel (0, 0) is the centre of the first pixel.
    Raises ValueError for numbers out of the bounds above, and for a distortion of another length.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        for name in ("fx", "fy"):
            if not FOCAL[0] <= getattr(self, name) <= FOCAL[1]:
                raise ValueError(f"{name} is {getattr(self, name)} px, needs {FOCAL[0]:g} to {FOCAL[1]:g}")
        for name in ("cx", "cy"):
            if not abs(getattr(self, name)) <= PRINCIPAL:
                raise ValueError(f"{name} is {getattr(self, name)} px, needs at most {PRINCIPAL:g} in size")

    @property
    def pixel_centre(self) -> float:
        return 0.0

    @property
    def wraps(self) -> bool:
        return False

    @property
    def matrix(self) -> Array:
        """The camera matrix (3, 3), px."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @abstractmethod
    def _rays(self, plane: Array) -> tuple[Array, Mask]:
        """Distorted image coordinates (n, 2) → unit directions (n, 3) in the optical frame, and which have one (n,)."""

    @abstractmethod
    def _on_plane(self, optical: Array) -> tuple[Array, Mask]:
        """Directions (n, 3) in the optical frame → distorted image coordinates (n, 2), and which have some (n,)."""

    def bearings_from_pixels(self, pixels: ArrayLike) -> Array:
        return self._rays(self._plane_from_pixels(pixels))[0] @ OPTICAL_FROM_CAMERA

    def pixels_from_bearings(self, bearings: ArrayLike) -> tuple[Array, Mask]:
        plane, known = self._on_plane(np.asarray(bearings, dtype=np.float64) @ OPTICAL_FROM_CAMERA.T)
        pixels = plane * [self.fx, self.fy] + [self.cx, self.cy]
        pixels[~known] = np.nan
        with np.errstate(invalid="ignore"):
            inside = known & (pixels >= -0.5).all(axis=1) & (pixels <= np.array([self.width, self.height]) - 0.5).all(axis=1)
        return pixels, np.asarray(inside)

    def blind(self, pixels: ArrayLike) -> Mask:
        return ~self._rays(self._plane_from_pixels(pixels))[1]

    def _plane_from_pixels(self, pixels: ArrayLike) -> Array:
        return np.asarray((np.asarray(pixels, dtype=np.float64) - [self.cx, self.cy]) / [self.fx, self.fy])

    def _set_distortion(self, distortion: tuple[float, ...], names: tuple[str, ...]) -> None:
        values = tuple(float(k) for k in distortion)
        if len(values) != len(names) or not all(abs(k) <= DISTORTION for k in values):
            raise ValueError(f"distortion is {list(values)}, needs {len(names)} numbers of at most {DISTORTION:g} in size: {', '.join(names)}")
        object.__setattr__(self, "distortion", values)

    def _check_border(self, rim: Array, distortion: tuple[float, ...]) -> None:
        """Raises ValueError where the border of the image is blind. rim (n, 2): distorted image coordinates of the fold."""
        u, v = np.linspace(-0.5, self.width - 0.5, BORDER_POINTS), np.linspace(-0.5, self.height - 0.5, BORDER_POINTS)
        border = np.concatenate([np.column_stack([u, np.full_like(u, edge)]) for edge in (v[0], v[-1])])
        border = np.concatenate([border, *(np.column_stack([np.full_like(v, edge), v]) for edge in (u[0], u[-1]))])
        beyond = border[self.blind(border)]
        if len(beyond):
            away = np.hypot(*(beyond - [self.cx, self.cy]).T)
            worst, far = beyond[np.argmax(away)], float(away.max())
            direction, towards = rim / np.hypot(*rim.T)[:, None], self._plane_from_pixels(worst[None])[0]
            at = float(np.hypot(*(rim[np.argmax(direction @ towards)] * [self.fx, self.fy])))
            u0, v0 = np.clip(np.round(worst), 0, [self.width - 1, self.height - 1]).astype(int).tolist()
            raise ValueError(
                f"distortion {list(distortion)} folds within the image: {at:.0f} px from (cx, cy), while the pixel ({u0}, {v0})"
                f" is {far:.0f} px from it; needs a distortion that grows up to there"
            )


@dataclass(frozen=True)
class Pinhole(LensCamera):
    """OpenCV's pinhole camera with distortion k1, k2, p1, p2, k3.

    With x, y at focal length 1 and r² = x² + y²: x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), y' likewise with p1 and p2
    exchanged (OpenCV manual, "Camera Calibration and 3D Reconstruction"). The Jacobian of this map is symmetric. So the map is one to one on a
    disc where the Jacobian is positive definite: the disc of radius `fold`.
    Raises ValueError where the distortion folds within the image.
    """

    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set_distortion(self.distortion, ("k1", "k2", "p1", "p2", "k3"))
        if np.isfinite(self.fold):
            angle = np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False)
            self._check_border(self._distorted(self.fold * np.column_stack([np.cos(angle), np.sin(angle)])), self.distortion)

    @cached_property
    def fold(self) -> float:
        """Undistorted radius at focal length 1 beyond which the distortion is not one to one; inf where it always is."""
        k1, k2, p1, p2, k3 = self.distortion
        if not (p1 or p2):
            return fold_of((k1, k2, k3))
        radial, cross = Polynomial([1, 0, k1, 0, k2, 0, k3]), Polynomial([0, 0, 2 * k1, 0, 4 * k2, 0, 6 * k3])
        found = []
        for angle in np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False):
            c, s = float(np.cos(angle)), float(np.sin(angle))
            xx = radial + cross * (c * c) + Polynomial([0, 2 * p1 * s + 6 * p2 * c])
            yy = radial + cross * (s * s) + Polynomial([0, 6 * p1 * s + 2 * p2 * c])
            xy = cross * (c * s) + Polynomial([0, 2 * p1 * c + 2 * p2 * s])
            found.append(_first_root(xx * yy - xy * xy))
        return min(found)

    def _distorted(self, points: Array) -> Array:
        k1, k2, p1, p2, k3 = self.distortion
        x, y = points.T
        s = x * x + y * y
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        return np.column_stack([x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x), y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y])

    def _jacobian(self, points: Array) -> tuple[Array, Array, Array]:
        """The entries xx, xy = yx and yy (n,) of the Jacobian of _distorted."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = points.T
        s = x * x + y * y
        radial, cross = 1 + s * (k1 + s * (k2 + s * k3)), 2 * (k1 + s * (2 * k2 + s * 3 * k3))
        xx = radial + cross * x * x + 2 * p1 * y + 6 * p2 * x
        yy = radial + cross * y * y + 6 * p1 * y + 2 * p2 * x
        return xx, cross * x * y + 2 * p1 * x + 2 * p2 * y, yy

    def _undistorted(self, plane: Array) -> tuple[Array, Mask]:
        """Solve _distorted(points) = plane (n, 2) in the disc of the fold. Points beyond it are extrapolated, and marked False."""
        k1, k2, p1, p2, k3 = self.distortion
        length = np.hypot(plane[:, 0], plane[:, 1])
        radius, solved = grown_root((k1, k2, k3), length, self.fold)
        points = plane * np.where(length > 0, radius / np.where(length > 0, length, 1.0), 1.0)[:, None]
        if not (p1 or p2) or not len(plane):
            return points, solved
        return self._newton(points, plane)

    def _newton(self, points: Array, plane: Array) -> tuple[Array, Mask]:
        """Newton's method in two dimensions, with steps that are halved until the error falls, within the disc of the fold."""
        start, share = points, np.ones(len(points))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            points = self._within(points)
            error = plane - self._distorted(points)
            size, enough = np.hypot(*error.T), 1e-13 * (1 + np.hypot(*plane.T))
            for _ in range(ITERATIONS):
                xx, xy, yy = self._jacobian(points)
                determinant = np.where(np.abs(xx * yy - xy * xy) > 1e-12, xx * yy - xy * xy, 1e-12)
                step = np.column_stack([yy * error[:, 0] - xy * error[:, 1], xx * error[:, 1] - xy * error[:, 0]]) / determinant[:, None]
                new = self._within(points + share[:, None] * step)
                new_error = plane - self._distorted(new)
                better = np.hypot(*new_error.T) < size
                points, error = np.where(better[:, None], new, points), np.where(better[:, None], new_error, error)
                size, share = np.hypot(*error.T), np.where(better, np.minimum(2 * share, 1.0), share / 2)
                if not ((size > enough) & (share > 1e-12)).any():
                    break
        solved = np.asarray(size < 1e-10 * (1 + np.hypot(*plane.T)))
        return np.where(solved[:, None], points, start), solved

    def _within(self, points: Array) -> Array:
        """Points (n, 2), those beyond the fold moved onto it."""
        return np.asarray(points * np.minimum(1.0, self.fold / np.maximum(np.hypot(*points.T), 1e-300))[:, None])

    def _rays(self, plane: Array) -> tuple[Array, Mask]:
        points, solved = self._undistorted(plane)
        optical = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        return optical / np.linalg.norm(optical, axis=1, keepdims=True), solved

    def _on_plane(self, optical: Array) -> tuple[Array, Mask]:
        with np.errstate(invalid="ignore"):
            ahead = optical[:, 2] > 1e-9 * np.abs(optical[:, :2]).sum(axis=1)
        points = optical[:, :2] / np.where(ahead, optical[:, 2], 1.0)[:, None]
        with np.errstate(invalid="ignore"):
            known = ahead & (np.hypot(*points.T) <= self.fold)
        points[~known] = 0.0
        return self._distorted(points), np.asarray(known)


@dataclass(frozen=True)
class Fisheye(LensCamera):
    """OpenCV's fisheye camera with distortion k1, k2, k3, k4.

    A direction at θ rad from the axis is at θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) from (cx, cy), at focal length 1 (Kannala and Brandt 2006, eq. 6).
    The model holds for fields of more than 180°: θ goes up to π, or to the fold. OpenCV itself stops at 90°.
    Pixels beyond the fold are blind, such as the corners around the round image of the lens.
    field_of_view: rad, the angle of the cone that the lens sees; pixels outside of its round image are blind, too.
    Raises ValueError where the distortion folds within the image at less than 90° from the axis, and for a field of view outside (0, 2π].
    """

    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    field_of_view: float = 2 * np.pi

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.field_of_view <= 2 * np.pi:
            raise ValueError(f"field_of_view is {self.field_of_view} rad, needs more than 0 and at most 2π")
        self._set_distortion(self.distortion, ("k1", "k2", "k3", "k4"))
        if self.fold < np.pi / 2:
            radius, angle = _grown(self.distortion, np.array(self.fold)), np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False)
            self._check_border(radius * np.column_stack([np.cos(angle), np.sin(angle)]), self.distortion)

    @cached_property
    def fold(self) -> float:
        """Angle from the axis, rad, up to which directions have pixels: that of the fold, at most π."""
        return min(fold_of(self.distortion), float(np.pi))

    @property
    def farthest(self) -> float:
        """Angle from the axis, rad, up to which the lens sees: the smaller of `fold` and half the field of view."""
        return min(self.fold, self.field_of_view / 2)

    def _rays(self, plane: Array) -> tuple[Array, Mask]:
        length = np.hypot(plane[:, 0], plane[:, 1])
        angle, solved = grown_root(self.distortion, length, self.farthest)
        across = plane * np.where(length > 0, np.sin(angle) / np.where(length > 0, length, 1.0), 1.0)[:, None]
        return np.concatenate([across, np.cos(angle)[:, None]], axis=1), solved

    def _on_plane(self, optical: Array) -> tuple[Array, Mask]:
        length = np.hypot(optical[:, 0], optical[:, 1])
        angle = np.arctan2(length, optical[:, 2])
        with np.errstate(invalid="ignore"):
            # Straight behind, the direction from the centre is not defined.
            known = (angle <= self.farthest) & ((length > 0) | (optical[:, 2] > 0))
        radius = _grown(self.distortion, np.where(known, angle, 0.0))
        return optical[:, :2] * np.where(length > 0, radius / np.where(length > 0, length, 1.0), 0.0)[:, None], np.asarray(known)


def fold_of(coefficients: tuple[float, ...]) -> float:
    """The least r > 0 at which r (1 + k₁ r² + k₂ r⁴ + …) has derivative 0; inf where it always grows."""
    return float(np.sqrt(_first_root(Polynomial([1.0, *((2 * i + 3) * k for i, k in enumerate(coefficients))]))))


def grown_root(coefficients: tuple[float, ...], value: Array, fold: float) -> tuple[Array, Mask]:
    """Solve r (1 + k₁ r² + k₂ r⁴ + …) = value (n,) ≥ 0 for r in [0, fold], by Newton's method with bisection where it leaves its bracket.

    Where value exceeds that of the fold, r continues from the fold with slope 1, and the mask is False.
    """
    if not any(coefficients) and not np.isfinite(fold):
        return value.copy(), np.ones(len(value), dtype=np.bool_)
    top = float(_grown(coefficients, np.array(fold))) if np.isfinite(fold) else np.inf
    target, solved = np.minimum(value, top), value <= top
    low, high = np.zeros(len(value)), np.full(len(value), min(fold, 1.0))
    while (short := (_grown(coefficients, high) < target) & (high < fold)).any():
        low, high = np.where(short, high, low), np.where(short, np.minimum(2 * high, fold), high)
    root = np.clip(target, low, high)
    for _ in range(ITERATIONS):
        error = _grown(coefficients, root) - target
        low, high = np.where(error < 0, root, low), np.where(error > 0, root, high)
        slope = _slope(coefficients, root)
        new = root - error / np.where(slope > 1e-12, slope, 1e-12)
        new = np.where((new < low) | (new > high), (low + high) / 2, new)
        new = np.where(error == 0, root, new)
        settled = np.abs(new - root) <= 4e-16 * (1 + root)
        root = new
        if settled.all():
            break
    return np.where(solved, root, fold + value - target), np.asarray(solved)


def _grown(coefficients: tuple[float, ...], r: Array) -> Array:
    s, total = r * r, np.zeros_like(r)
    for k in reversed(coefficients):
        total = (total + k) * s
    return np.asarray(r * (1 + total))


def _slope(coefficients: tuple[float, ...], r: Array) -> Array:
    s, total = r * r, np.zeros_like(r)
    for i in range(len(coefficients) - 1, -1, -1):
        total = (total + (2 * i + 3) * coefficients[i]) * s
    return np.asarray(1 + total)


def _first_root(polynomial: Polynomial) -> float:
    """The least positive root of a polynomial, inf where it has none."""
    roots = polynomial.trim(1e-30).roots()
    real = roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0)]
    return float(real.min()) if len(real) else np.inf
