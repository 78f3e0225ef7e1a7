"""Array types, and the checks of shape, unit length and covariance that the frozen values make."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Image = NDArray[np.uint8]
Indices = NDArray[np.intp]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def frozen(value: ArrayLike, shape: tuple[int | None, ...], name: str) -> Array:
    """A read-only float copy of `value`, checked against `shape` (None stands for any length) and for NaN.

    Raises ValueError with the name, the shape of `value` and the shape that is needed.
    """
    array = np.array(value, dtype=np.float64)
    if array.ndim != len(shape) or any(want is not None and want != got for want, got in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name} has shape {array.shape}, needs {tuple('n' if s is None else s for s in shape)}")
    if np.isnan(array).any():
        raise ValueError(f"{name} holds NaN")
    array.flags.writeable = False
    return array


def frozen_ints(value: ArrayLike, shape: tuple[int, ...], name: str) -> Ints:
    """A read-only integer copy of `value`. Raises ValueError with the name for another shape."""
    array = np.array(value, dtype=np.int64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, needs {shape}")
    array.flags.writeable = False
    return array


def set_array(instance: object, name: str, shape: tuple[int | None, ...]) -> None:
    """Replace a field of a frozen dataclass by its `frozen` copy."""
    object.__setattr__(instance, name, frozen(getattr(instance, name), shape, name))


def set_ints(instance: object, name: str, shape: tuple[int, ...]) -> None:
    """Replace a field of a frozen dataclass by its `frozen_ints` copy."""
    object.__setattr__(instance, name, frozen_ints(getattr(instance, name), shape, name))


def check_unit(bearing: Array, name: str) -> None:
    """Raises ValueError where a row of `bearing` (n, 3) differs from length 1 by more than 1e-6."""
    length = np.linalg.norm(bearing, axis=1)
    error = np.abs(length - 1)
    if error.size and error.max() > 1e-6:
        raise ValueError(f"{name} has length {length[np.argmax(error)]:.9g}, needs 1")


def check_covariance(covariance: Array, name: str) -> None:
    """Raises ValueError where `covariance` (n, n) is not symmetric and positive semidefinite, up to rounding. Zero variances are allowed."""
    scale = float(np.abs(covariance).max(initial=0.0))
    if not np.isfinite(scale) or np.abs(covariance - covariance.T).max(initial=0.0) > 1e-9 * scale:
        raise ValueError(f"{name} is not finite and symmetric")
    low = float(np.linalg.eigvalsh(covariance)[0])
    if low < -1e-9 * scale:
        raise ValueError(f"{name} has an eigenvalue of {low:.3g}, needs at least 0")


def check_covariances(covariance: Array, name: str) -> None:
    """Raises ValueError where one of the matrices (n, 2, 2) is not symmetric and positive definite."""
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    sound = np.isfinite(covariance).all(axis=(1, 2)) & (a > 0) & (a * c > b * b) & (np.abs(b - covariance[:, 1, 0]) <= 1e-9 * (a + c))
    if not sound.all():
        worst = int(np.argmin(sound))
        raise ValueError(f"{name} {worst} is {covariance[worst].tolist()}, needs a symmetric positive matrix")
