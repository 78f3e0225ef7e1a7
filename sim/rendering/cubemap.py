"""Cube map: perspective faces for any camera, a lookup table from its pixels to texels of the faces, and its sampling.

A face is a perspective view. A camera with a narrow field of view needs one face. Other cameras use the faces of a cube.
Each face is cropped to the part that the camera sees, and unseen faces are left out.
The faces are stacked in an atlas, whose rows run upwards as OpenGL reads them.
Every face has a border, so that no interpolation crosses its edge.

Beyond the fold of a lens (Tsai model with κ1 < 0) the calibration gives a pixel the direction of another pixel nearer to the centre.
A real lens shows something else there. Such pixels are blind: black, without instance and class, at range inf.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Mask, frozen
from tracker.geometry.cameras import Camera, Pinhole, Tsai
from tracker.geometry.compilation import njit

UNIFORM = np.uint32(1 << 31)
"""Bit that marks a texel whose right, upper and upper right neighbours have the same code."""
BORDER = 2
"""Texels that a face has on each side beyond what the camera sees."""
NARROW = 1.2
"""Largest tangent from the centre of a field of view that one face covers. The faces of a cube are cheaper for a wider field."""
LARGEST_BLIND_SHARE = 0.5
"""Share of the image. A calibration of a pinhole that leaves more of it blind was not made for this image size."""
BLIND_ROWS = 2
"""Empty rows of an atlas that blind pixels point to. Bilinear interpolation needs two."""
STRIP = 1 << 16
"""Pixels that are processed at once; it bounds the memory that building a table takes."""

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
"""(6, 3, 3): directions forward, right and up of the faces ahead, left, behind, right, up and down, camera frame."""
CUBE.flags.writeable = False


@dataclass(frozen=True, eq=False)
class Atlas:
    """All rendered faces: colour (height, width, 4); codes, depth (height, width)."""

    colour: NDArray[np.uint8]
    codes: NDArray[np.uint32]
    depth: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """The image of one camera: colour (H, W, 3) RGB; instances (H, W), 0 for the background; range (H, W) m along the ray, inf for no hit.

    classes (H, W): classes of worlds.semantics, 0 for no hit, and everywhere if the renderer does not know them.
    """

    colour: NDArray[np.uint8]
    instances: NDArray[np.uint16]
    range: NDArray[np.float32]
    classes: NDArray[np.uint8]


def inverse_depth(near: float, far: float) -> tuple[float, float]:
    """Slope and offset, 1/m, of 1 / planar depth = slope · depth + offset, where depth is 1 at `near` and 0 at `far`."""
    return (far - near) / (near * far), 1 / far


def values_and_ranges(
    atlas: Atlas,
    table: tuple[NDArray[np.uint32], NDArray[np.uint16], NDArray[np.float32]],
    limits: tuple[float, float],
    lookups: tuple[NDArray[np.uint16], NDArray[np.uint8]],
) -> tuple[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.float32]]:
    """Instances and classes of the nearest texel's code, and range in m (inf where the code is 0), of every pixel (H, W).

    table: first, fraction and range_per_depth of a FaceTable. limits: near and far plane, m. lookups (codes,): instance and class of a code.
    Depth is interpolated bilinearly where the four neighbours have one code, which is exact on planes. Elsewhere the nearest texel counts.
    """
    tags, shape = np.empty(atlas.codes.shape, np.uint32), table[0].shape
    _mark_uniform(atlas.codes, tags)
    instances, classes = np.empty(shape, np.uint16), np.empty(shape, np.uint8)
    inverse = np.array(inverse_depth(*limits), np.float32)
    return instances, classes, _sampled((tags, atlas.depth), table, inverse, lookups, (instances, classes))


@njit(cache=True)
def _mark_uniform(codes, out):  # type: ignore[no-untyped-def]
    """Write the codes (height, width) into `out`, with UNIFORM set where the right, upper and upper right neighbours share the code."""
    flat, tags, pitch = codes.ravel(), out.ravel(), codes.shape[1]
    for k in range(flat.size - pitch - 1):
        code = flat[k]
        other = (flat[k + 1] ^ code) | (flat[k + pitch] ^ code) | (flat[k + pitch + 1] ^ code)
        tags[k] = code | (UNIFORM if other == 0 else np.uint32(0))
    # The last texels have no such neighbours.
    for k in range(max(flat.size - pitch - 1, 0), flat.size):
        tags[k] = flat[k]


@njit(cache=True, error_model="numpy")
def _sampled(atlas, table, inverse, lookups, values):  # type: ignore[no-untyped-def]
    """Fill in the values of the pixels (H, W) and return their range (H, W). Unsigned indices skip numba's test for negative ones."""
    tags, depth = atlas[0].ravel(), atlas[1].ravel()
    first, fraction, range_per_depth = table
    pitch, one, half = np.uint64(atlas[0].shape[1]), np.uint64(1), np.uint32(15)
    height, width = first.shape
    distance = np.empty((height, width), np.float32)
    slope, offset, whole = inverse[0], inverse[1], np.float32(1 / 65536)
    for i in range(height):
        for j in range(width):
            at, a, b = np.uint64(first[i, j]), np.uint32(fraction[i, j, 0]), np.uint32(fraction[i, j, 1])
            code = tags[at]
            if code > UNIFORM:
                c, e = depth[at], depth[at + pitch]
                across = whole * np.float32(a)
                bottom, top = c + across * (depth[at + one] - c), e + across * (depth[at + pitch + one] - e)
                deep = bottom + whole * np.float32(b) * (top - bottom)
            else:
                near = at + np.uint64(a >> half) + pitch * np.uint64(b >> half)
                code, deep = tags[near], depth[near]
            code &= ~UNIFORM
            values[0][i, j] = lookups[0][np.uint64(code)]
            values[1][i, j] = lookups[1][np.uint64(code)]
            distance[i, j] = range_per_depth[i, j] / (slope * deep + offset) if code else np.float32(np.inf)
    return distance


@dataclass(frozen=True, eq=False)
class Face:
    """A perspective view, stored in the atlas from row `row` on.

    axes (3, 3): forward, right, up, camera frame. low, high (2,): tangents of its edges to the right and up. width, height: texels.
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
    def resolution(self) -> float:
        """Texels per radian at the centre."""
        return float((np.array([self.width, self.height]) / (self.high - self.low)).max())

    @property
    def planes(self) -> Array:
        """Inward unit normals (5, 3) of the planes through the camera that bound the view, camera frame: four sides and the rear.

        The rear plane culls large boxes behind the camera that intersect all four side planes.
        """
        forward, right, up = self.axes
        sides = [right - self.low[0] * forward, self.high[0] * forward - right, up - self.low[1] * forward, self.high[1] * forward - up]
        return np.stack([*(side / np.linalg.norm(side) for side in sides), forward])


@dataclass(frozen=True, eq=False)
class FaceTable:
    """Lookup table from the pixels of a camera to texels of its faces. Every array is (H, W), read-only.

    first: flat index of the texel to the lower left; texel centres are at whole numbers.
    fraction (H, W, 2): offset of the pixel from that texel, to the right and up, in 65536ths of a texel.
    nearest: flat index of the nearest texel. range_per_depth: range along the ray divided by planar depth.
    width, height: texels of the atlas. colour_maps: the same positions in OpenCV's fixed-point format.
    Blind pixels point to empty rows at the end of the atlas, which exist only if there are blind pixels.
    """

    faces: tuple[Face, ...]
    width: int
    height: int
    first: NDArray[np.uint32]
    fraction: NDArray[np.uint16]
    nearest: NDArray[np.int32]
    range_per_depth: NDArray[np.float32]
    colour_maps: tuple[Any, Any]

    @staticmethod
    def make(camera: Camera) -> FaceTable:
        """The table of a camera. The finest pixel of a face spans one texel, and coarser pixels span more.

        Raises ValueError if more than LARGEST_BLIND_SHARE of a pinhole's image is blind.
        """
        faces = _faces(camera)
        width, drawn = max(face.width for face in faces), sum(face.height for face in faces)
        height = drawn + BLIND_ROWS * any(blind.any() for _, _, blind in _strips(camera))
        axes = np.stack([face.axes for face in faces])
        scale = np.array([[face.width, face.height] / (face.high - face.low) for face in faces])
        offset = np.array([[0, face.row] - scale[k] * face.low - 0.5 for k, face in enumerate(faces)])
        shape = (camera.height, camera.width)
        first, fraction, nearest = np.empty(shape, np.uint32), np.empty((*shape, 2), np.uint16), np.empty(shape, np.int32)
        range_per_depth = np.empty(shape, np.float32)
        for rows, bearings, blind in _strips(camera):
            number = np.argmax(bearings @ axes[:, 0].T, axis=1)
            forward, right, up = (np.einsum("ni,ni->n", bearings, axes[number, k]) for k in range(3))
            at = scale[number] * np.stack([right, up], axis=1) / forward[:, None] + offset[number]
            at[blind] = 0, drawn
            fixed = np.floor(65536 * at + 0.5).astype(np.int64).reshape(-1, camera.width, 2)
            first[rows] = (fixed >> 16) @ [1, width]
            nearest[rows] = ((fixed + 32768) >> 16) @ [1, width]
            fraction[rows] = fixed & 65535
            range_per_depth[rows] = (1 / forward).reshape(-1, camera.width)
        x, y = (whole + fraction[..., k] / np.float32(65536) for k, whole in enumerate((first % width, first // width)))
        maps = cv2.convertMaps(x.astype(np.float32), y.astype(np.float32), cv2.CV_16SC2)
        for array in (first, fraction, nearest, range_per_depth, *maps):
            array.flags.writeable = False
        return FaceTable(faces, width, height, first, fraction, nearest, range_per_depth, maps)

    def sample(self, atlas: Atlas, limits: tuple[float, float], lookups: tuple[NDArray[np.uint16], NDArray[np.uint8]]) -> RenderedImage:
        """Sample the atlas: bilinear colour, range (inf where the code is 0), and by lookups (codes,) instance and class at the nearest texel.

        A code stands for one geom. Depth is reversed: 1 at limits[0] m, 0 at limits[1] m.
        It is linear in the inverse planar depth, so that its bilinear interpolation is exact on planes.
        It is interpolated where the four neighbours belong to one geom; elsewhere the nearest texel counts.
        """
        instances, classes, distance = values_and_ranges(atlas, (self.first, self.fraction, self.range_per_depth), limits, lookups)
        colour = cv2.cvtColor(cv2.remap(atlas.colour, *self.colour_maps, interpolation=cv2.INTER_LINEAR), cv2.COLOR_RGBA2RGB)
        return RenderedImage(np.asarray(colour, dtype=np.uint8), instances, distance, classes)


def _strips(camera: Camera, shift: tuple[float, float] = (0.0, 0.0)) -> Iterator[tuple[slice, Array, Mask]]:
    """Strips of rows, the bearings of their pixel centres, shifted by a fraction of a pixel, and which pixels are blind."""
    rows = max(1, STRIP // camera.width)
    half = camera.pixel_centre
    for first in range(0, camera.height, rows):
        last = min(first + rows, camera.height)
        u, v = np.meshgrid(np.arange(camera.width) + half, np.arange(first, last) + half)
        pixels = np.stack([u.ravel(), v.ravel()], axis=1)
        yield slice(first, last), camera.bearings_from_pixels(pixels + shift), camera.blind(pixels)


def _faces(camera: Camera) -> tuple[Face, ...]:
    """One face, or the visible faces of the cube, stacked."""
    count = camera.width * camera.height
    unseen = sum(int(blind.sum()) for _, _, blind in _strips(camera)) / count
    if unseen > LARGEST_BLIND_SHARE and isinstance(camera, Tsai | Pinhole):
        raise ValueError(f"{unseen:.0%} of the pixels of {camera} lie past the fold of its lens, needs {LARGEST_BLIND_SHARE:.0%} at most")
    mean = np.sum([bearings[~blind].sum(axis=0) for _, bearings, blind in _strips(camera)], axis=0) / ((1 - unseen) * count)
    for axes in [*([_axes_along(mean)[None]] if np.linalg.norm(mean) > 0.3 else []), CUBE]:
        low, high, pitch = _bounds(camera, axes)
        if len(axes) > 1 or max(-low.min(), high.max()) < NARROW:
            break
    faces: list[Face] = []
    for k in np.flatnonzero(np.isfinite(pitch[:, 0])):
        bounds = np.array([low[k], high[k]])
        if len(axes) > 1:
            # A cube face that is nearly whole becomes whole, so that all faces have the same texel grid.
            bounds = np.where(np.abs(np.abs(bounds) - 1) < 0.05, np.sign(bounds), bounds)
        scale = 1 / pitch[k]
        middle, half = (bounds[0] + bounds[1]) / 2, np.ceil(np.round((bounds[1] - bounds[0]) * scale / 2, 6)) + BORDER
        row = faces[-1].row + faces[-1].height if faces else 0
        faces.append(Face(axes[k], middle - half / scale, middle + half / scale, int(2 * half[0]), int(2 * half[1]), row))
    return tuple(faces)


def _axes_along(mean: Array) -> Array:
    """Axes (3, 3) of a face along `mean`, upright as the camera is."""
    forward = mean / np.linalg.norm(mean)
    right = np.cross(forward, [0.0, 0.0, 1.0] if abs(forward[2]) < 0.99 else [1.0, 0.0, 0.0])
    right = right / np.linalg.norm(right)
    return np.stack([forward, right, np.cross(right, forward)])


def _bounds(camera: Camera, axes: Array) -> tuple[Array, Array, Array]:
    """Per face the lowest and highest tangents (n, 2) of pixel corners, and the size (n, 2) of its finest pixel; inf without pixels.

    Texels are square, or have the aspect ratio of the camera's pixels if one face is enough.
    The finest pixel is the one whose longer side is shortest, since pixels near the pole of a panorama are needlessly narrow.
    """
    aspect = np.array([camera.dpx / camera.sx, camera.dpy]) / camera.dpy if len(axes) == 1 and isinstance(camera, Tsai) else np.ones(2)
    low, high, pitch = np.full((len(axes), 2), np.inf), np.full((len(axes), 2), -np.inf), np.full((len(axes), 2), np.inf)
    shifted = [_strips(camera, shift) for shift in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5))]
    for (_, bearings, blind), (_, beside, _), (_, below, _) in zip(*shifted, strict=True):
        number = np.where(blind, -1, np.argmax(bearings @ axes[:, 0].T, axis=1))
        for k in np.unique(number[~blind]):
            mine = number == k
            at, across, along = (_tangents(components[mine], axes[k]) for components in (bearings, beside, below))
            step = np.stack([np.linalg.norm(across - at, axis=1), np.linalg.norm(along - at, axis=1)], axis=1)
            reach = np.abs(across - at) + np.abs(along - at)
            low[k], high[k] = np.minimum(low[k], (at - reach).min(axis=0)), np.maximum(high[k], (at + reach).max(axis=0))
            pitch[k] = np.minimum(pitch[k], 2 * aspect * (step / aspect).max(axis=1).min())
    return low, high, pitch


def _tangents(bearings: Array, axes: Array) -> Array:
    components = bearings @ axes.T
    return np.asarray(components[:, 1:] / np.maximum(components[:, :1], 1e-3))
