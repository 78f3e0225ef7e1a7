"""Array types, and the checks of shape, unit length and covariance that frozen values make."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def frozen(value: ArrayLike, shape: tuple[int | None, ...], name: str) -> Array:
    """A read-only float copy of `value`, checked against `shape` (None stands for any length) and for NaN.

    Raises ValueError with the name, the shape that came and the one that is needed.
    """
    array = np.array(value, dtype=np.float64)
    if array.ndim != len(shape) or any(want is not None and want != got for want, got in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{name} has shape {array.shape}, needs {tuple('n' if s is None else s for s in shape)}")
    if np.isnan(array).any():
        raise ValueError(f"{name} holds NaN")
    array.flags.writeable = False
    return array


Ints = NDArray[np.int64]

Image = NDArray[np.uint8]


def set_array(instance: object, name: str, shape: tuple[int | None, ...]) -> None:
    object.__setattr__(instance, name, frozen(getattr(instance, name), shape, name))


def set_ints(instance: object, name: str, n: int) -> None:
    array = np.array(getattr(instance, name), dtype=np.int64)
    if array.shape != (n,):
        raise ValueError(f"{name} has shape {array.shape}, needs ({n},)")
    array.flags.writeable = False
    object.__setattr__(instance, name, array)


def check_unit(bearing: Array, name: str) -> None:
    error = np.abs(np.linalg.norm(bearing, axis=1) - 1)
    if error.size and error.max() > 1e-6:
        raise ValueError(f"{name} has length {1 + error.max():.6g} off 1, needs unit directions")


def check_covariance(covariance: Array, name: str) -> None:
    """(n, n): symmetric and not negative, up to rounding; a direction that is known exactly is none of its faults."""
    scale = float(np.abs(covariance).max(initial=0.0))
    if not np.isfinite(scale) or np.abs(covariance - covariance.T).max(initial=0.0) > 1e-9 * scale:
        raise ValueError(f"{name} is not finite and symmetric")
    low = float(np.linalg.eigvalsh(covariance)[0])
    if low < -1e-9 * scale:
        raise ValueError(f"{name} has an eigenvalue of {low:.3g}, needs at least 0")


def check_covariances(covariance: Array, name: str) -> None:
    """(n, 2, 2): symmetric and positive, each."""
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    sound = np.isfinite(covariance).all(axis=(1, 2)) & (a > 0) & (a * c > b * b) & (np.abs(b - covariance[:, 1, 0]) <= 1e-9 * (a + c))
    if not sound.all():
        worst = int(np.argmin(sound))
        raise ValueError(f"{name} {worst} is {covariance[worst].tolist()}, needs a symmetric positive matrix")


Indices = NDArray[np.intp]

Mask = NDArray[np.bool_]

Floats = NDArray[np.float32]
