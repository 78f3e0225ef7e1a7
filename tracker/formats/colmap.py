"""Models of COLMAP: cameras, images with poses, and points, as text and as binary files (colmap.github.io/format.html).

COLMAP's pixels count from the image's corner: the first pixel's centre is (0.5, 0.5).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tracker.geometry import Array, Pose, quaternion_from_rotation
from tracker.io.atomic import write_text

MODELS = {"PINHOLE": (1, 4), "OPENCV": (4, 8), "OPENCV_FISHEYE": (5, 8), "FULL_OPENCV": (6, 12)}
"""Name of a model → its number in binary files, and how many parameters it has."""


@dataclass(frozen=True)
class ColmapCamera:
    """A camera: model of MODELS, size px, and parameters fx, fy, cx, cy px and distortion. Raises ValueError for another count of them."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]

    def __post_init__(self) -> None:
        count = MODELS[self.model][1]
        if len(self.parameters) != count:
            raise ValueError(f"camera has {len(self.parameters)} parameters, {self.model} needs {count}")


@dataclass(frozen=True, eq=False)
class ColmapImage:
    """An image: name below the folder of images, number of its camera from 1, and T_optical_world (x right, y down, z ahead).

    Raises ValueError for a name with a blank, which ends a name in COLMAP's text files.
    """

    name: str
    camera: int
    T_optical_world: Pose

    def __post_init__(self) -> None:
        if len(self.name.split()) != 1:
            raise ValueError(f"name of an image is {self.name!r}, needs one without blanks for COLMAP")

    @property
    def numbers(self) -> list[float]:
        """Quaternion w, x, y, z and translation m."""
        return [*quaternion_from_rotation(self.T_optical_world.rotation).tolist(), *self.T_optical_world.translation.tolist()]


@dataclass(frozen=True, eq=False)
class ColmapModel:
    """cameras and images, numbered from 1 in their order; points (n, 3) m, of the color (r, g, b) 0 to 255, without observations."""

    cameras: Sequence[ColmapCamera]
    images: Sequence[ColmapImage]
    points: Array
    color: tuple[int, int, int]

    def write(self, folder: Path) -> None:
        """Write cameras, images and points3D as .txt and as .bin. Reading gives the same float64."""
        write_text(folder / "cameras.txt", "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n" + "".join(self._camera_lines()))
        write_text(folder / "images.txt", "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]\n" + "".join(self._image_lines()))
        write_text(folder / "points3D.txt", "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n" + "".join(self._point_lines()))
        (folder / "cameras.bin").write_bytes(self._cameras_binary())
        (folder / "images.bin").write_bytes(self._images_binary())
        (folder / "points3D.bin").write_bytes(self._points_binary())

    def _camera_lines(self) -> list[str]:
        return [f"{k} {c.model} {c.width} {c.height} {_text(c.parameters)}\n" for k, c in enumerate(self.cameras, 1)]

    def _image_lines(self) -> list[str]:
        # The second line of an image lists its points: none.
        return [f"{k} {_text(image.numbers)} {image.camera} {image.name}\n\n" for k, image in enumerate(self.images, 1)]

    def _point_lines(self) -> list[str]:
        color = " ".join(map(str, self.color))
        return [f"{k} {_text(point)} {color} 0\n" for k, point in enumerate(self.points.tolist(), 1)]

    def _cameras_binary(self) -> bytes:
        parts = [struct.pack("<Q", len(self.cameras))]
        for k, c in enumerate(self.cameras, 1):
            number, count = MODELS[c.model]
            parts.append(struct.pack(f"<IiQQ{count}d", k, number, c.width, c.height, *c.parameters))
        return b"".join(parts)

    def _images_binary(self) -> bytes:
        parts = [struct.pack("<Q", len(self.images))]
        for k, image in enumerate(self.images, 1):
            parts.append(struct.pack("<I7dI", k, *image.numbers, image.camera) + image.name.encode() + b"\0" + struct.pack("<Q", 0))
        return b"".join(parts)

    def _points_binary(self) -> bytes:
        parts = [struct.pack("<Q", len(self.points))]
        parts += [struct.pack("<Q3d3BdQ", k, *point, *self.color, 0.0, 0) for k, point in enumerate(self.points.tolist(), 1)]
        return b"".join(parts)


def _text(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(x) + 0.0) for x in numbers)
