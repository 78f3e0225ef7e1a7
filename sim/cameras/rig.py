"""A camera as it is mounted: the views that are recorded of it, and for a dual fisheye its lenses and how they are stitched.

The frame of a rig is that of a camera: x forward, y left, z up. Its origin is the middle between two lenses.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.cameras.specification import EQUIRECTANGULAR, CameraSpecification, parse_camera
from sim.cameras.stitching import Stitching
from tracker.geometry import Pose, rotation_z
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole

LENSES = ("_front", "_back")
"""What the names of the views of the two lenses end with."""


@dataclass(frozen=True, eq=False)
class RigView:
    """One picture of a rig. suffix: what its name has beyond that of the rig. T_rig_view: where it is."""

    suffix: str
    camera: Camera
    T_rig_view: Pose


@dataclass(frozen=True, eq=False)
class Rig:
    """A camera model of a scenario.

    lenses: the pictures that real sensors take, one or two. stitching: of two lenses, else None.
    views: what is recorded; the stitched panorama has no suffix.
    """

    lenses: tuple[RigView, ...]
    views: tuple[RigView, ...]
    stitching: Stitching | None = None

    @staticmethod
    def of(text: str, width: int) -> Rig:
        """The rig of a camera's text, "" for a panorama. width: px, of a panorama of the scenario.

        Raises ValueError as `parse_camera`, and for a distortion that folds within the image.
        """
        specification = parse_camera(text or EQUIRECTANGULAR)
        if specification.model == "dual-fisheye":
            return _dual(specification, width)
        camera: Camera = _SINGLE[specification.model](specification, width)
        aim = _aim(specification) if "yaw" in specification.values else Pose.identity()
        views = (RigView("", camera, aim),)
        return Rig(views, views)


def _aim(specification: CameraSpecification) -> Pose:
    yaw, pitch = (math.radians(specification.values[name]) for name in ("yaw", "pitch"))
    return Pose(rotation_z(yaw), np.zeros(3)) @ Pose.exp(np.array([0.0, 0.0, 0.0, 0.0, -pitch, 0.0]))


def _panorama(specification: CameraSpecification, width: int) -> Panorama:
    return Panorama(width, width // 2)


def _cylinder(specification: CameraSpecification, width: int) -> Cylinder:
    width = specification.size("width", width)
    focal = width / (2 * math.pi)
    height = max(2 * round(focal * math.tan(math.radians(specification.values["fov"]) / 2)), 2)
    return Cylinder(width, height, height / 2, focal)


def _fisheye(specification: CameraSpecification, width: int) -> Fisheye:
    width, height, scale = _size(specification, 2 * (width // 4), 1.0)
    distortion = tuple(specification.values[f"k{i}"] for i in range(1, 5))
    half = math.radians(specification.values["fov"]) / 2
    square = half * half
    radius = half * (1 + square * (distortion[0] + square * (distortion[1] + square * (distortion[2] + square * distortion[3]))))
    focal = min(width, height) / 2 / radius if radius > 0 else math.nan
    lens = Fisheye(width, height, *_intrinsics(specification, (width, height), focal, scale), distortion, 2 * half)
    if lens.fold < half:
        raise ValueError(f"camera fisheye has a distortion that folds at {math.degrees(lens.fold):.1f}° from the axis, needs at least fov / 2")
    return lens


def _pinhole(specification: CameraSpecification, width: int) -> Pinhole:
    width, height, scale = _size(specification, 2 * round(0.375 * width), 0.75)
    focal = width / 2 / math.tan(math.radians(specification.values["fov"]) / 2)
    distortion = tuple(specification.values[name] for name in ("k1", "k2", "p1", "p2", "k3"))
    return Pinhole(width, height, *_intrinsics(specification, (width, height), focal, scale), distortion)


def _size(specification: CameraSpecification, width: int, aspect: float) -> tuple[int, int, float]:
    """Width and height px, and the scale of a published calibration, whose own size has the aspect of its sensor."""
    if specification.published_width:
        chosen = specification.size("width", width)
        scale = chosen / specification.published_width
        return chosen, round(specification.values["height"] * scale), scale
    width = specification.size("width", width)
    return width, specification.size("height", 2 * round(width * aspect / 2)), 1.0


def _intrinsics(specification: CameraSpecification, size: tuple[int, int], focal: float, scale: float) -> tuple[float, float, float, float]:
    """fx, fy, cx and cy px: those that are set, scaled, or `focal` and the middle of the image."""
    fx, fy, cx, cy = (specification.values[name] for name in ("fx", "fy", "cx", "cy"))
    fx = focal if math.isnan(fx) else fx * scale
    fy = fx if math.isnan(fy) else fy * scale
    # The middle of the first pixel is (0, 0).
    cx, cy = ((n - 1) / 2 if math.isnan(c) else scale * (c + 0.5) - 0.5 for n, c in zip(size, (cx, cy), strict=True))
    return fx, fy, cx, cy


def _dual(specification: CameraSpecification, width: int) -> Rig:
    values = specification.values
    width = specification.size("width", width)
    side = specification.size("lens", 2 * (width // 4))
    options = {name: value for name, value in values.items() if name in ("fov", "k1", "k2", "k3", "k4")}
    lens = _fisheye(CameraSpecification("fisheye", _NONE | options | {"width": float(side), "height": float(side)}), side)
    half = values["baseline"] / 2
    back = Pose(np.diag([-1.0, -1.0, 1.0]), np.array([-half, 0.0, 0.0]))
    lenses = tuple(RigView(s, lens, T) for s, T in zip(LENSES, (Pose(np.eye(3), np.array([half, 0.0, 0.0])), back), strict=True))
    panorama = Panorama(width, width // 2)
    scale = 1 + values["focal_error"] / 100
    believed = dataclasses.replace(lens, fx=scale * lens.fx, fy=scale * lens.fy) if values["focal_error"] else None
    stitching = Stitching(panorama, lens, (lenses[0].T_rig_view, back), values["distance"], math.radians(values["feather"]), believed)
    stitched = RigView("", panorama, Pose.identity())
    views = {"both": (stitched, *lenses), "stitched": (stitched,), "raw": lenses}[specification.output]
    return Rig(lenses, views, stitching)


_NONE = {"fx": math.nan, "fy": math.nan, "cx": math.nan, "cy": math.nan}
_SINGLE: dict[str, Callable[[CameraSpecification, int], Camera]] = {
    EQUIRECTANGULAR: _panorama,
    "cylindrical": _cylinder,
    "fisheye": _fisheye,
    "pinhole": _pinhole,
}
