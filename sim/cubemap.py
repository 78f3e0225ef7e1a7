"""From faces to the picture of any camera: tables made once, and the sampling of colour, range and what is seen.

A face is a perspective view. A camera whose field is narrow enough needs one; else the faces of a cube are taken, each cut to what the
camera sees through it, and those left out through which it sees nothing. The faces lie one above the other in an atlas, whose rows run
upwards in each face, as OpenGL hands them over. Every face is a little larger than what is needed, so that no interpolation reaches over its edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from tracker.cameras import Camera, Tsai
from tracker.geometry import Array, frozen

BORDER = 2
"""Texels of a face on each side beyond what is needed."""
DENSITY = 1.05
"""Texels along a pixel, where a face is coarsest: below 1 pixels would go unseen, above 1 what is sampled is smoother."""
NARROW = 1.2
"""The greatest tangent off the middle of a field that one face takes; a wider one is cheaper by the faces of a cube."""
STRIP = 1 << 16
"""Pixels that are worked on at once, so that a large picture's table takes little memory to make."""

CUBE = np.array(
    [
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, -1, 0], [-1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
    ],
    dtype=np.float64,
)
"""(6, 3, 3): of every face of a cube (ahead, left, behind, right, up, down) the directions forward, right and up in the camera's frame."""
CUBE.flags.writeable = False


@dataclass(frozen=True, eq=False)
class Face:
    """A perspective view, its place in the atlas from row `row` on.

    axes (3, 3): forward, right, up in the camera's frame; low, high (2,): tangents right and up of its edges; width, height: texels.
    """

    axes: Array
    low: Array
    high: Array
    width: int
    height: int
    row: int

    def __post_init__(self) -> None:
        for name, shape in (("axes", (3, 3)), ("low", (2,)), ("high", (2,))):
            object.__setattr__(self, name, frozen(getattr(self, name), shape, name))

    @property
    def planes(self) -> Array:
        """Inward unit normals (5, 3), camera frame, of the planes through the camera that bound what is seen: four, and behind.

        Behind adds nothing for points; what is large and lies behind may yet be before each of the four.
        """
        forward, right, up = self.axes
        sides = [right - self.low[0] * forward, self.high[0] * forward - right, up - self.low[1] * forward, self.high[1] * forward - up]
        return np.stack([*(side / np.linalg.norm(side) for side in sides), forward])


@dataclass(frozen=True, eq=False)
class FaceTable:
    """Where every pixel of a camera lies in the atlas of its faces. Every array is (H, W), read-only.

    x, y: texels, a texel's centre at whole numbers; nearest: the flat index of the nearest texel; stretch: range along the ray over
    planar depth. width, height: texels of the atlas. colour_maps: the same x, y in OpenCV's fixed point.
    """

    faces: tuple[Face, ...]
    width: int
    height: int
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    nearest: NDArray[np.int32]
    stretch: NDArray[np.float32]
    colour_maps: tuple[Any, Any]

    @staticmethod
    def make(camera: Camera, density: float = DENSITY) -> FaceTable:
        """The table of a camera; density: texels along a pixel, where they are fewest. Raises ValueError for one that is not in [0.25, 16]."""
        if not 0.25 <= density <= 16:
            raise ValueError(f"density is {density}, needs 0.25 to 16 texels a pixel")
        faces = _faces(camera, density)
        width, height = max(face.width for face in faces), sum(face.height for face in faces)
        axes = np.stack([face.axes for face in faces])
        scale = np.array([[face.width, face.height] / (face.high - face.low) for face in faces])
        offset = np.array([[0, face.row] - scale[k] * face.low - 0.5 for k, face in enumerate(faces)])
        shape = (camera.height, camera.width)
        x, y, stretch = (np.empty(shape, np.float32) for _ in range(3))
        for rows, bearings in _strips(camera):
            number = np.argmax(bearings @ axes[:, 0].T, axis=1)
            forward, right, up = (np.einsum("ni,ni->n", bearings, axes[number, k]) for k in range(3))
            x[rows] = (scale[number, 0] * right / forward + offset[number, 0]).reshape(-1, camera.width)
            y[rows] = (scale[number, 1] * up / forward + offset[number, 1]).reshape(-1, camera.width)
            stretch[rows] = (1 / forward).reshape(-1, camera.width)
        nearest = np.floor(y + 0.5).astype(np.int32) * width + np.floor(x + 0.5).astype(np.int32)
        maps = cv2.convertMaps(x, y, cv2.CV_16SC2)
        for array in (x, y, nearest, stretch, *maps):
            array.flags.writeable = False
        return FaceTable(faces, width, height, x, y, nearest, stretch, maps)

    def colour(self, atlas: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Atlas (height, width, 4) → picture (H, W, 3), bilinear."""
        sampled = cv2.remap(atlas, *self.colour_maps, interpolation=cv2.INTER_LINEAR)
        return np.asarray(cv2.cvtColor(sampled, cv2.COLOR_RGBA2RGB), dtype=np.uint8)

    def geometry(
        self, codes: NDArray[np.uint32], depth: NDArray[np.float32], limits: tuple[float, float]
    ) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
        """Atlas of codes and of depth (height, width) → codes (H, W) and range (H, W) m, inf where the code is 0.

        A code is one geom. Depth is OpenGL's, reversed: 1 at limits[0], 0 at limits[1] m, linear in the inverse of the planar depth, hence
        interpolated as it is, which is exact on planes, where the four neighbours are of one geom; the nearest elsewhere.
        """
        return _geometry(codes, depth, self.x, self.y, self.nearest, self.stretch, *inverse_depth(*limits))


def inverse_depth(near: float, far: float) -> tuple[float, float]:
    """Slope and offset with 1 / planar depth = slope · depth + offset, 1/m, where depth is 1 at `near` and 0 at `far`."""
    return (far - near) / (near * far), 1 / far


def _strips(camera: Camera, shift: tuple[float, float] = (0.0, 0.0)) -> Iterator[tuple[slice, Array]]:
    """Strips of rows and the bearings of their pixels' centres, shifted by a part of a pixel."""
    rows = max(1, STRIP // camera.width)
    # Tsai's pixels have their centres at whole numbers.
    half = 0.0 if isinstance(camera, Tsai) else 0.5
    for first in range(0, camera.height, rows):
        last = min(first + rows, camera.height)
        u, v = np.meshgrid(np.arange(camera.width) + half + shift[0], np.arange(first, last) + half + shift[1])
        yield slice(first, last), camera.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1))


def _faces(camera: Camera, density: float) -> tuple[Face, ...]:
    """One face, or those of the cube through which the camera sees, one above the other."""
    mean = np.sum([bearings.sum(axis=0) for _, bearings in _strips(camera)], axis=0) / (camera.width * camera.height)
    for axes in [*([_around(mean)[None]] if np.linalg.norm(mean) > 0.3 else []), CUBE]:
        low, high, pitch = _bounds(camera, axes)
        if len(axes) > 1 or max(-low.min(), high.max()) < NARROW:
            break
    faces: list[Face] = []
    for k in np.flatnonzero(np.isfinite(pitch)):
        bounds = np.array([low[k], high[k]])
        if len(axes) > 1:
            # A face of the cube that is needed almost whole is taken whole: then its texels lie in it as in the others.
            bounds = np.where(np.abs(np.abs(bounds) - 1) < 0.05, np.sign(bounds), bounds)
        scale = density / pitch[k]
        middle, half = (bounds[0] + bounds[1]) / 2, np.ceil(np.round((bounds[1] - bounds[0]) * scale / 2, 6)) + BORDER
        row = faces[-1].row + faces[-1].height if faces else 0
        faces.append(Face(axes[k], middle - half / scale, middle + half / scale, int(2 * half[0]), int(2 * half[1]), row))
    return tuple(faces)


def _around(mean: Array) -> Array:
    """Axes (3, 3) of a face that looks along `mean`, upright as the camera is."""
    forward = mean / np.linalg.norm(mean)
    right = np.cross(forward, [0.0, 0.0, 1.0] if abs(forward[2]) < 0.99 else [1.0, 0.0, 0.0])
    right = right / np.linalg.norm(right)
    return np.stack([forward, right, np.cross(right, forward)])


def _bounds(camera: Camera, axes: Array) -> tuple[Array, Array, Array]:
    """Per face the least and greatest tangents (n, 2) of pixels' corners in it, and the finest pixel (n,) as a tangent; inf where no pixel is."""
    low, high, pitch = np.full((len(axes), 2), np.inf), np.full((len(axes), 2), -np.inf), np.full(len(axes), np.inf)
    shifted = [_strips(camera, shift) for shift in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5))]
    for (_, bearings), (_, beside), (_, below) in zip(*shifted, strict=True):
        number = np.argmax(bearings @ axes[:, 0].T, axis=1)
        for k in np.unique(number):
            mine = number == k
            at, across, along = (_tangents(ways[mine], axes[k]) for ways in (bearings, beside, below))
            step = np.maximum(np.linalg.norm(across - at, axis=1), np.linalg.norm(along - at, axis=1))
            reach = np.abs(across - at) + np.abs(along - at)
            low[k], high[k] = np.minimum(low[k], (at - reach).min(axis=0)), np.maximum(high[k], (at + reach).max(axis=0))
            pitch[k] = min(pitch[k], 2 * float(step.min()))
    return low, high, pitch


def _tangents(bearings: Array, axes: Array) -> Array:
    ways = bearings @ axes.T
    return np.asarray(ways[:, 1:] / np.maximum(ways[:, :1], 1e-3))


@numba.njit(cache=True)
def _geometry(codes, depth, x, y, nearest, stretch, slope, offset):  # type: ignore[no-untyped-def]
    height, width = x.shape
    seen = np.empty((height, width), np.uint32)
    distance = np.empty((height, width), np.float32)
    flat, deep, pitch = codes.ravel(), depth.ravel(), codes.shape[1]
    slope, offset = np.float32(slope), np.float32(offset)
    for i in range(height):
        for j in range(width):
            at = nearest[i, j]
            code = flat[at]
            seen[i, j] = code
            if code == 0:
                distance[i, j] = np.inf
                continue
            x0, y0 = int(x[i, j]), int(y[i, j])
            first = y0 * pitch + x0
            inverse = deep[at]
            if flat[first] == code and flat[first + 1] == code and flat[first + pitch] == code and flat[first + pitch + 1] == code:
                a, b = x[i, j] - np.float32(x0), y[i, j] - np.float32(y0)
                bottom = deep[first] + a * (deep[first + 1] - deep[first])
                top = deep[first + pitch] + a * (deep[first + pitch + 1] - deep[first + pitch])
                inverse = bottom + b * (top - bottom)
            distance[i, j] = stretch[i, j] / (slope * inverse + offset)
    return seen, distance
