"""A camera as it is mounted: the views that are recorded of it, and for a dual fisheye its lenses and how they are stitched.

The frame of a rig is that of a camera: x forward, y left, z up. Its origin is the middle between two lenses.
A text names a camera: a model or a published camera, and options, as in `dual-fisheye:fov=200,baseline=0.02`.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from sim.cameras.stitching import Stitching
from tracker.geometry import Pose, rotation_z
from tracker.geometry.cameras import Camera, Cylinder, Fisheye, Panorama, Pinhole
from tracker.io.text_files import named_values

EQUIRECTANGULAR = "equirectangular"
OUTPUTS = ("both", "stitched", "raw")
"""What is recorded of a dual fisheye: the pictures of the lenses and the stitched panorama, or one kind."""
UNSET = math.nan

_SIZE = {"width": (UNSET, 32.0, 8192.0), "height": (UNSET, 32.0, 8192.0)}
_AIM = {"yaw": (0.0, -180.0, 180.0), "pitch": (0.0, -90.0, 90.0)}
_LENS = {"fx": (UNSET, 1.0, 1e5), "fy": (UNSET, 1.0, 1e5), "cx": (UNSET, -1e5, 1e5), "cy": (UNSET, -1e5, 1e5)}
_RADIAL = {f"k{i}": (0.0, -10.0, 10.0) for i in range(1, 5)}
OPTIONS: dict[str, dict[str, tuple[float, float, float]]] = {
    EQUIRECTANGULAR: {},
    "fisheye": {"fov": (190.0, 10.0, 360.0)} | _SIZE | _AIM | _LENS | _RADIAL,
    "pinhole": {"fov": (90.0, 10.0, 160.0)} | _SIZE | _AIM | _LENS | dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), (0.0, -10.0, 10.0)),
    "cylindrical": {"fov": (60.0, 10.0, 150.0), "width": _SIZE["width"]},
    "dual-fisheye": {
        "fov": (200.0, 180.0, 260.0),
        "baseline": (0.02, 0.0, 0.3),
        "distance": (3.0, 0.2, 1000.0),
        "feather": (5.0, 0.0, 60.0),
        "focal_error": (0.0, -10.0, 10.0),
        "width": _SIZE["width"],
        "lens": (UNSET, 32.0, 8192.0),
    }
    | _RADIAL,
}
"""Model → option → its default, lowest and highest value.

fov: degrees; of a fisheye the cone that it sees, of a pinhole from left to right, of a cylinder from top to bottom. width, height: px.
yaw, pitch: degrees, the direction of the optical axis, to the left and up. fx, fy, cx, cy: px, in place of fov.
k1 to k4, p1, p2: distortion as in OpenCV. baseline: m between the lenses. distance: m, at which stitching has no parallax.
feather: degrees over which the two pictures are blended. lens: px, side of a lens' picture.
focal_error: %, by which stitching overestimates the focal length of the lenses. A dual fisheye has the option output, too.
"""
WHOLE = ("width", "height", "lens")

PUBLISHED: dict[str, tuple[str, dict[str, float]]] = {
    "theta-sc": ("dual-fisheye", {"fov": 202.15558, "lens": 960, "baseline": 0.0179}),
    "tum-vi": (
        "fisheye",
        {
            "width": 512, "height": 512, "fov": 195.0, "fx": 190.97847715128717, "fy": 190.9733070521226, "cx": 254.93170605935475,
            "cy": 256.8974428996504, "k1": 0.0034823894022493434, "k2": 0.0007150348452162257, "k3": -0.0020532361418706202,
            "k4": 0.00020293673591811182,
        },
    ),
    "euroc": (
        "pinhole",
        {
            "width": 752, "height": 480, "fx": 458.654, "fy": 457.296, "cx": 367.215, "cy": 248.375, "k1": -0.28340811, "k2": 0.07395907,
            "p1": 0.00019359, "p2": 1.76187114e-05,
        },
    ),
}  # fmt: skip
"""Name → its model and options, in the units of OPTIONS.

theta-sc: Ricoh Theta SC. Equidistant lenses of 202.15558°, round images of radius 480 px in a video of 1920 x 1080, as measured at
https://monochrome.sutic.nu/2017/08/03/ricoh-theta-sc-lens-parameters.html. The distance of its lenses is not published.
The baseline is the thickness of a Theta V without its lenses, 17.9 mm (https://theta360.com/en/etc/technology.html).
tum-vi: left camera of the TUM VI data set, 512 x 512, with its calibration
(Schubert et al., The TUM VI Benchmark for Evaluating Visual-Inertial Odometry, IROS 2018; field of view of its lens: 195°).
euroc: left camera of the EuRoC data set, an MT9V034 with a global shutter, with the calibration of its sensor.yaml
(Burri et al., The EuRoC micro aerial vehicle datasets, IJRR 2016).
"""
LENSES = ("_front", "_back")
"""Suffixes of the names of the views of the two lenses."""


@dataclass(frozen=True)
class CameraSpecification:
    """A camera model with all its options, in the units of OPTIONS. output: of a dual fisheye, one of OUTPUTS.

    published_width: px, of a published calibration, which `width` scales; 0 without one.
    """

    model: str
    values: Mapping[str, float]
    output: str = OUTPUTS[0]
    published_width: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def size(self, name: str, default: int) -> int:
        """A number of pixels, or the default where it is not set."""
        value = self.values[name]
        return default if math.isnan(value) else int(value)


def parse_camera(text: str) -> CameraSpecification:
    """The camera that a text names.

    Raises ValueError for an unknown model or option, a value out of bounds, and options that do not go together.
    """
    name, _, options = text.partition(":")
    name = name.strip()
    known = (*OPTIONS, *PUBLISHED)
    if name not in known:
        near = difflib.get_close_matches(name, known, 1, 0.6)
        raise ValueError(f"camera is {name[:60]!r}{f' ({near[0]}?)' if near else ''}, needs one of {', '.join(known)}")
    model, preset = PUBLISHED.get(name, (name, {}))
    values = {option: default for option, (default, _, _) in OPTIONS[model].items()} | preset
    own = _options(options, model)
    output = own.pop("output", OUTPUTS[0])
    given = {option: _number(text, model, option) for option, text in own.items()}
    specification = CameraSpecification(model, values | given, output, int(preset.get("width", 0)))
    _check(specification, frozenset(given), preset)
    return specification


def _options(text: str, model: str) -> dict[str, str]:
    """Option → its text. Raises ValueError for unknown and repeated options."""
    known = [*OPTIONS[model], *(["output"] if model == "dual-fisheye" else [])]
    found = named_values(text, known, f"camera {model} has", f"NAME=VALUE of {', '.join(known) or 'no options'}")
    if found.get("output", OUTPUTS[0]) not in OUTPUTS:
        raise ValueError(f"camera {model} has output {found['output'][:40]!r}, needs one of {', '.join(OUTPUTS)}")
    return found


def _number(text: str, model: str, option: str) -> float:
    _, low, high = OPTIONS[model][option]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high or (option in WHOLE and value != int(value)):
        kind = "an even whole number" if option in WHOLE else "a number"
        why = " for stitching" if (model, option) == ("dual-fisheye", "fov") and value < low else ""
        raise ValueError(f"camera {model} has {option} {text[:40]!r}, needs {kind} in [{low:g}, {high:g}] {_unit(option)}{why}".rstrip())
    if option in WHOLE and value % 2:
        raise ValueError(f"camera {model} has {option} {text[:40]}, needs an even whole number of px")
    return value


def _unit(option: str) -> str:
    units = {"degrees": ("fov", "yaw", "pitch", "feather"), "m": ("baseline", "distance"), "px": (*WHOLE, "fx", "fy", "cx", "cy")}
    return next((unit for unit, names in units.items() if option in names), "")


def _check(specification: CameraSpecification, given: frozenset[str], preset: Mapping[str, float]) -> None:
    """Raises ValueError for options that do not go together. given: those that the text has."""
    values, model = specification.values, specification.model
    if preset and model != "dual-fisheye" and given - {"width", *_AIM}:
        raise ValueError(f"camera has a published calibration and {', '.join(sorted(given))}, needs none but width, {', '.join(_AIM)}")
    if {"fx", "fov"} <= given or ("fy" in given and "fx" not in given):
        raise ValueError(f"camera {model} has {', '.join(sorted(given))}, needs either fov, or fx with or without fy")
    if model == "dual-fisheye":
        widest = math.degrees(lens_angle(math.pi / 2 + math.radians(values["feather"] / 2), values["baseline"], values["distance"]))
        widest *= max(1 + values["focal_error"] / 100, 1)
        if widest > values["fov"] / 2 + 1e-9:
            raise ValueError(
                f"camera {model} has fov {values['fov']:g}, too narrow for feather {values['feather']:g}, baseline {values['baseline']:g}"
                f" and distance {values['distance']:g}; needs at least {2 * widest:.4g} degrees"
            )


def lens_angle(angle: float, baseline: float, distance: float) -> float:
    """Angle from a lens' axis, rad, of the point at `distance` m and `angle` rad from the axis, as seen from between the lenses."""
    return float(np.arctan2(distance * math.sin(angle), distance * math.cos(angle) - baseline / 2))


@dataclass(frozen=True, eq=False)
class RigView:
    """One picture of a rig. suffix: appended to the name of the rig. T_rig_view: pose of its camera in the rig."""

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
    """Width and height px, and the scale of a published calibration, whose aspect is that of its sensor."""
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
