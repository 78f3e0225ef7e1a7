"""Cameras of every model with random parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tracker.geometry import Array
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole, Tsai

TRIES = 200


def _panorama(rng: np.random.Generator) -> Panorama:
    height = int(rng.integers(1, 2000))
    return Panorama(2 * height, height)


def _cylinder(rng: np.random.Generator) -> Cylinder:
    width, height = (int(n) for n in rng.integers([100, 10], [5000, 1500]))
    return Cylinder(width, height, height * rng.uniform(-0.2, 1.2), width / 6 * rng.uniform(0.5, 2))


def _lens(rng: np.random.Generator, focal: tuple[float, float]) -> tuple[int, int, float, float, float, float]:
    width, height = (int(n) for n in rng.integers([200, 150], [4000, 3000]))
    fx = width * rng.uniform(*focal)
    return width, height, fx, fx * rng.uniform(0.9, 1.1), width * rng.uniform(0.4, 0.6), height * rng.uniform(0.4, 0.6)


def _pinhole(rng: np.random.Generator) -> Pinhole:
    return Pinhole(*_lens(rng, (0.3, 2.0)), tuple(rng.normal(0.0, [0.2, 0.1, 0.005, 0.005, 0.05])))


def _fisheye(rng: np.random.Generator) -> Fisheye:
    # The shortest focal lengths put more than 180° into the image.
    return Fisheye(*_lens(rng, (0.15, 1.0)), tuple(rng.normal(0.0, [0.1, 0.02, 0.005, 0.001])))


def _tsai(rng: np.random.Generator) -> Tsai:
    width, height = (int(n) for n in rng.integers([200, 150], [2000, 1500]))
    pitch, focal = 5e-3, width * 5e-3 * rng.uniform(0.6, 2.0)
    kappa = rng.normal(0.0, 0.05) / (width * pitch) ** 2
    return Tsai(width, height, focal, kappa, width * rng.uniform(0.4, 0.6), height * rng.uniform(0.4, 0.6), rng.uniform(0.9, 1.1), pitch, pitch)


MAKERS: dict[str, Callable[[np.random.Generator], Camera]] = {
    "panorama": _panorama,
    "cylinder": _cylinder,
    "pinhole": _pinhole,
    "fisheye": _fisheye,
    "tsai": _tsai,
}


def random_camera(model: str, seed: int) -> Camera:
    """A camera of the model; parameters whose distortion folds within the image are drawn again."""
    rng = np.random.default_rng([seed, len(model)])
    for _ in range(TRIES):
        try:
            return MAKERS[model](rng)
        except ValueError as error:
            if "folds within the image" not in str(error):
                raise
    raise AssertionError(f"no {model} in {TRIES} draws")


def image_pixels(camera: Camera, seed: int, count: int = 400) -> Array:
    """Pixels (n, 2) all over the image, its corners among them, that are not blind."""
    low = camera.pixel_centre - 0.5
    u, v = (np.array([low, low + size]) for size in (camera.width, camera.height))
    corners = np.array([[a, b] for a in u for b in v])
    pixels = np.concatenate([corners, np.random.default_rng(seed).uniform([u[0], v[0]], [u[1], v[1]], (count, 2))])
    return pixels[~camera.blind(pixels)]
