"""From the six faces of a cube to one equirectangular panorama: tables made once, and the sampling of range and instances.

The faces lie one above the other in an atlas (6 F, F) whose rows run upwards in each face, as OpenGL hands them over: face k takes
the rows k F to (k + 1) F. Every face is a little wider than 90°, so that no interpolation ever reaches over its edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from tracker.cameras import Panorama
from tracker.geometry import Array

BORDER = 2
"""Texels of a face on each side beyond its 90°."""
SMALLEST_FACE = 16

FACES = np.array(
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
"""(6, 3, 3): of every face (ahead, left, behind, right, up, down) the directions forward, right and up in the camera's frame."""
FACES.flags.writeable = False


def half_tangent(face: int) -> float:
    """The tangent of half the angle of view of a face of `face` texels: 1 for its 90°, and the border."""
    return face / (face - 2 * BORDER)


@dataclass(frozen=True, eq=False)
class CubeTable:
    """Where every pixel of a panorama lies in the atlas. Every array is (H, W), read-only.

    x, y: texels, a texel's centre at whole numbers; nearest: the flat index of the nearest texel; stretch: range along the ray over
    planar depth. colour_maps: the same x, y in OpenCV's fixed point.
    """

    face: int
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    nearest: NDArray[np.int32]
    stretch: NDArray[np.float32]
    colour_maps: tuple[Any, Any]

    @staticmethod
    def make(camera: Panorama, face: int) -> CubeTable:
        """The table of a panorama from faces of face x face texels. Raises ValueError for a face that is too small."""
        if face < SMALLEST_FACE:
            raise ValueError(f"face is {face} px, needs at least {SMALLEST_FACE}")
        u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        bearings = camera.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1))
        number = np.argmax(bearings @ FACES[:, 0].T, axis=1)
        forward, right, up = (np.einsum("ni,ni->n", bearings, FACES[number, k]) for k in range(3))
        scale = face / (2 * half_tangent(face))
        shape = (camera.height, camera.width)
        x = (scale * right / forward + (face - 1) / 2).astype(np.float32).reshape(shape)
        y = (scale * up / forward + (face - 1) / 2 + number * face).astype(np.float32).reshape(shape)
        nearest = np.floor(y + 0.5).astype(np.int32) * face + np.floor(x + 0.5).astype(np.int32)
        stretch = (1 / forward).astype(np.float32).reshape(shape)
        maps = cv2.convertMaps(x, y, cv2.CV_16SC2)
        for array in (x, y, nearest, stretch, *maps):
            array.flags.writeable = False
        return CubeTable(face, x, y, nearest, stretch, maps)

    def colour(self, atlas: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Atlas (6 F, F, 3) → panorama (H, W, 3), bilinear."""
        return np.asarray(cv2.remap(atlas, *self.colour_maps, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)

    def geometry(
        self, codes: NDArray[np.uint8], depth: NDArray[np.float32], instance_of_code: NDArray[np.uint16], near: float, far: float
    ) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
        """Atlas of codes (6 F, F, 3) and of depth (6 F, F) → instances (H, W) and range (H, W) m, inf where the code is 0.

        A code is one geom, red its lowest byte. Depth is OpenGL's, reversed: 1 at `near`, 0 at `far` m, linear in the inverse of the
        planar depth, hence interpolated as it is, which is exact on planes, where the four neighbours are of one geom; the nearest elsewhere.
        """
        line = inverse_depth(near, far)
        return _geometry(codes, depth, instance_of_code, self.x, self.y, self.nearest, self.stretch, *line)


def inverse_depth(near: float, far: float) -> tuple[float, float]:
    """Slope and offset with 1 / planar depth = slope · depth + offset, 1/m.

    They come from the projection matrix as OpenGL has it, in single precision: its rounding, and not that of the depth buffer, would
    else be the greatest error, 3e-4 at 160 m (MuJoCo's own renderer does likewise).
    """
    n, f = np.float32(near), np.float32(far)
    flat, steep = -(f + n) / (f - n), np.float32(-2) * f * n / (f - n)
    half = np.float32(-0.5)
    return 1 / float(half * steep), float(half * flat + half) / float(half * steep)


@numba.njit(cache=True)
def _geometry(codes, depth, instance_of_code, x, y, nearest, stretch, slope, offset):  # type: ignore[no-untyped-def]
    (height, width), face = x.shape, codes.shape[1]
    instances = np.empty((height, width), np.uint16)
    distance = np.empty((height, width), np.float32)
    for i in range(height):
        for j in range(width):
            x0, y0 = int(np.floor(x[i, j])), int(np.floor(y[i, j]))
            a, b = x[i, j] - x0, y[i, j] - y0
            yn, xn = divmod(nearest[i, j], face)
            red, green, blue = codes[yn, xn, 0], codes[yn, xn, 1], codes[yn, xn, 2]
            code = red + 256 * green + 65536 * blue
            if code == 0:
                instances[i, j], distance[i, j] = 0, np.inf
                continue
            instances[i, j] = instance_of_code[code]
            inverse = depth[yn, xn]
            same = True
            for m in range(2):
                for n in range(2):
                    c = codes[y0 + m, x0 + n]
                    same = same and c[0] == red and c[1] == green and c[2] == blue
            if same:
                d00, d01, d10, d11 = depth[y0, x0], depth[y0, x0 + 1], depth[y0 + 1, x0], depth[y0 + 1, x0 + 1]
                inverse = (1 - b) * ((1 - a) * d00 + a * d01) + b * ((1 - a) * d10 + a * d11)
            distance[i, j] = stretch[i, j] / (slope * inverse + offset)
    return instances, distance


def frustum_planes(face: int) -> Array:
    """Inward unit normals (6, 5, 3), camera frame, of the planes through the camera that bound what a face sees: four, and behind.

    Behind adds nothing for points; what is large and lies behind may yet be before each of the four.
    """
    t = half_tangent(face)
    forward, right, up = FACES[:, 0], FACES[:, 1], FACES[:, 2]
    sides = [t * forward + right, t * forward - right, t * forward + up, t * forward - up]
    return np.stack([*(side / np.sqrt(1 + t * t) for side in sides), forward], axis=1)
