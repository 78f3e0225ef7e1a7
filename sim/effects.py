"""Errors of real cameras, each off by default: parsing of texts such as `vignette=1.5,readout=0.02`, and the effects on images.

Effects of lens, sensor and compression act in the order in which light and data pass them:
1. `drops` and 2. dust on the lens; 3. `chromatic_shift`, 4. `defocus` and 5. `vignette` of the lens; 6. the exposure of the sensor;
7. `gain_noise` of the sensor; 8. `halos` of sharpening; 9. `jpeg`. Effects 1 to 7 act on linear light (H, W, 3) float32, 0 to 1, the others on
counts (H, W, 3) uint8. Linear light and counts are related by the sRGB curve (IEC 61966-2-1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, get_type_hints

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry.cameras import Camera
from tracker.io.text_files import named_values

WHOLE = ("subframes", "drops", "dust", "jpeg")
DEFAULT_SUBFRAMES = 5
Light = NDArray[np.float32]
Counts = NDArray[np.uint8]

FULL_WELL, READ_NOISE = 8000.0, 3.0
"""Electrons of a pixel at count 255 and gain 0 dB, and sigma of the read noise in electrons: orders of magnitude of small CMOS pixels."""
HALO_RADIUS = 1.5
"""px: sigma of the Gaussian of unsharp masking."""
DUST_RADIUS, DUST_OPACITY = (0.004, 0.02), (0.2, 0.7)
"""Ranges of radius, as a share of the image's height, and opacity of a speck."""
DROP_RADIUS = (0.02, 0.06)
"""Range of the radius of a drop, as a share of the image's height."""
DROP_SCALE = 4.0
"""A drop shows its surroundings upside down and smaller by this factor."""

_ENCODED = np.arange(256) / 255
_LINEAR = np.where(_ENCODED <= 0.04045, _ENCODED / 12.92, ((_ENCODED + 0.055) / 1.055) ** 2.4).astype(np.float32)
_LEVELS = np.arange(1 << 16) / ((1 << 16) - 1)
_COUNTS = np.rint(255 * np.where(_LEVELS <= 0.0031308, 12.92 * _LEVELS, 1.055 * _LEVELS ** (1 / 2.4) - 0.055)).astype(np.uint8)


@dataclass(frozen=True)
class Effects:
    """Values of the effects; None is off.

    readout: s from the first row to the last (rolling shutter). shutter: s of exposure (motion blur); subframes: images that are averaged.
    drops, dust: number on each lens. chromatic: px between red and green, and green and blue, at the border of the field.
    defocus: px, radius of the circle of confusion. vignette: stops of light lost at the border of the field.
    seam: stops by which the forward lens of a dual fisheye is brighter than the backward one. gain: dB of the sensor, which makes noise.
    halos: strength of unsharp masking, as a share of the detail. jpeg: quality.
    mount_angle: degrees, mount_shift: m by which the calibration of each camera's mount is off.
    Raises ValueError for a value out of BOUNDS, and for subframes without shutter.
    """

    readout: Annotated[float | None, (1e-4, 1.0, "s")] = None
    shutter: Annotated[float | None, (1e-4, 1.0, "s")] = None
    subframes: Annotated[float | None, (3, 33, "images, an odd number")] = None
    drops: Annotated[float | None, (1, 100, "drops, a whole number")] = None
    dust: Annotated[float | None, (1, 500, "specks, a whole number")] = None
    chromatic: Annotated[float | None, (-10.0, 10.0, "px")] = None
    defocus: Annotated[float | None, (0.1, 20.0, "px")] = None
    vignette: Annotated[float | None, (0.01, 6.0, "stops")] = None
    seam: Annotated[float | None, (-4.0, 4.0, "stops")] = None
    gain: Annotated[float | None, (0.0, 48.0, "dB")] = None
    halos: Annotated[float | None, (0.01, 4.0, "of the detail")] = None
    jpeg: Annotated[float | None, (1, 100, "of quality, a whole number")] = None
    mount_angle: Annotated[float | None, (0.001, 30.0, "degrees")] = None
    mount_shift: Annotated[float | None, (0.0001, 1.0, "m")] = None

    def __post_init__(self) -> None:
        for name, value in self.given().items():
            low, high, unit = BOUNDS[name]
            whole = name in WHOLE and (value != math.floor(value) or (name == "subframes" and value % 2 == 0))
            if not low <= value <= high or whole or (value == 0 and low < 0):
                bound = f"{low:g} to {high:g} {unit}" + (", but not 0" if low < 0 else "")
                raise ValueError(f"effect {name} is {value:g}, needs {bound}")
        if self.subframes is not None and self.shutter is None:
            raise ValueError("effect subframes needs the effect shutter beside it")

    def given(self) -> dict[str, float]:
        """Name → value of the effects that are on, in the order in which they act."""
        return {name: value for name in BOUNDS if (value := getattr(self, name)) is not None}

    @property
    def averaged(self) -> int:
        """Images that are averaged for one exposure."""
        return 1 if self.shutter is None else int(self.subframes or DEFAULT_SUBFRAMES)

    @property
    def moves(self) -> bool:
        """Whether an image shows the scene at more than one time."""
        return self.readout is not None or self.shutter is not None

    def check_period(self, period: float) -> None:
        """Raises ValueError where reading a frame out takes longer than `period` s, the time between frames."""
        if (self.readout or 0.0) + (self.shutter or 0.0) > period:
            named = " and ".join(f"{name} {value:g} s" for name, value in self.given().items() if name in ("readout", "shutter"))
            raise ValueError(f"effects have {named}, longer than a frame; need at most {period:.4g} s together")


BOUNDS: dict[str, tuple[float, float, str]] = {name: hint.__metadata__[0] for name, hint in get_type_hints(Effects, include_extras=True).items()}
"""Name → lowest and highest value, and unit, in the order in which the effects act; the last two are errors of the calibration."""


def parse_effects(text: str) -> Effects:
    """Parse the effects of a text. Raises ValueError for unknown, repeated and invalid effects."""
    values: dict[str, float] = {}
    for name, number in named_values(text, BOUNDS, "effect has", f"NAME=VALUE with a name of {', '.join(BOUNDS)}").items():
        try:
            values[name] = float(number)
        except ValueError:
            raise ValueError(f"effect {name} is {number[:40]!r}, needs a number") from None
        if not math.isfinite(values[name]):
            raise ValueError(f"effect {name} is {number[:40]!r}, needs a finite number")
    return Effects(**values)


@dataclass(frozen=True)
class Spot:
    """A speck or a drop on a lens: middle and radius px from the image's corner; opacity from 0 to 1."""

    effect: str
    u: float
    v: float
    radius: float
    opacity: float


class OpticalField:
    """The relative field angle of each pixel: angle from the optical axis over the largest angle in the image.

    A panoramic camera counts as two lenses, forward and backward, whose fields end at 90° from their axes.
    radius (H, W): from 0 on the axis to 1 at the border of the field.
    """

    def __init__(self, camera: Camera) -> None:
        self.wraps = camera.wraps
        u, v = np.meshgrid(np.arange(camera.width) + camera.pixel_centre, np.arange(camera.height) + camera.pixel_centre)
        pixels = np.stack([u.ravel(), v.ravel()], axis=1)
        ahead = np.clip(camera.bearings_from_pixels(pixels)[:, 0], -1.0, 1.0)
        angle = np.arccos(np.abs(ahead) if camera.wraps else ahead)
        blind = camera.blind(pixels)
        farthest = np.pi / 2 if camera.wraps else float(angle[~blind].max())
        self.radius: NDArray[np.float32] = np.minimum(angle / farthest, 1.0).astype(np.float32).reshape(camera.height, camera.width)

    @cached_property
    def _outward(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Column and row components (H, W) px of a shift away from the axis, which is 1 px at the border of the field."""
        radius = np.pad(self.radius, ((1, 1), (1, 1)), "edge")
        if self.wraps:
            radius[:, 0], radius[:, -1] = radius[:, -2], radius[:, 1]
        across, down = radius[1:-1, 2:] - radius[1:-1, :-2], radius[2:, 1:-1] - radius[:-2, 1:-1]
        length = np.maximum(np.hypot(across, down), np.float32(1e-12))
        return self.radius * across / length, self.radius * down / length

    def shifted(self, image: NDArray[np.float32], shift: float) -> NDArray[np.float32]:
        """An image (H, W) whose content lies farther from the axis, by `shift` px at the border of the field and less towards the axis."""
        height, width = image.shape
        v, u = np.mgrid[:height, :width].astype(np.float32)
        across, down = self._outward
        u, v = u - np.float32(shift) * across, v - np.float32(shift) * down
        if self.wraps:
            pad = int(np.ceil(abs(shift))) + 1
            image, u = np.concatenate([image[:, -pad:], image, image[:, :pad]], axis=1), u + np.float32(pad)
        return np.asarray(cv2.remap(image, u, v, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)


def linear_light(counts: Counts) -> Light:
    """Linear light of counts."""
    return np.asarray(cv2.LUT(counts, _LINEAR), dtype=np.float32)


def counts_of(light: Light) -> Counts:
    """Counts of linear light, clipped."""
    return _COUNTS.take(np.clip(light * np.float32(65535) + np.float32(0.5), 0, 65535).astype(np.uint16))


def drops(light: Light, spots: list[Spot], wraps: bool) -> Light:
    """Drops of water: each shows a blurred, smaller image of its surroundings upside down."""
    height, width = light.shape[:2]
    out = light.copy()
    for spot in spots:
        reach = int(np.ceil(spot.radius))
        v, u = np.mgrid[int(spot.v) - reach : int(spot.v) + reach + 1, int(spot.u) - reach : int(spot.u) + reach + 1]
        inside = (v >= 0) & (v < height) & (wraps | ((u >= 0) & (u < width)))
        away = np.stack([u + 0.5 - spot.u, v + 0.5 - spot.v])
        share = np.clip(spot.radius - np.hypot(*away), 0, 1) * inside
        at = np.array([spot.u, spot.v])[:, None, None] - DROP_SCALE * away - 0.5
        at[0] = np.mod(at[0], width) if wraps else at[0]
        columns_at, rows_at = at.astype(np.float32)
        seen = cv2.remap(light, columns_at, rows_at, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        seen = cv2.GaussianBlur(seen, (0, 0), max(spot.radius / 8, 0.5))
        rows, columns = np.clip(v, 0, height - 1), u % width if wraps else np.clip(u, 0, width - 1)
        now = out[rows, columns]
        mixed = now + (share * spot.opacity)[..., None].astype(np.float32) * (seen - now)
        out[rows[inside], columns[inside]] = mixed[inside]
    return out


def dust_transmission(shape: tuple[int, int], spots: list[Spot], wraps: bool) -> Light:
    """Share (H, W, 1) of the light that passes specks. They are out of focus: opacity falls from the middle to the border as a cosine."""
    height, width = shape
    out = np.ones(shape, np.float32)
    v, u = np.mgrid[:height, :width].astype(np.float32) + np.float32(0.5)
    for spot in spots:
        first, last = max(int(spot.v - spot.radius), 0), min(int(spot.v + spot.radius) + 2, height)
        across = np.abs(u[first:last] - spot.u)
        across = np.minimum(across, width - across) if wraps else across
        near = np.minimum(np.hypot(across, v[first:last] - spot.v) / spot.radius, 1)
        out[first:last] *= (1 - spot.opacity * (1 + np.cos(np.pi * near)) / 2).astype(np.float32)
    return out[..., None]


def chromatic_shift(light: Light, field: OpticalField, shift: float) -> Light:
    """Lateral chromatic aberration: red lies `shift` px farther from the axis than green at the border of the field, blue nearer.

    The shift grows with the distance from the axis.
    """
    out = light.copy()
    for channel, sign in ((0, 1.0), (2, -1.0)):
        out[..., channel] = field.shifted(np.ascontiguousarray(light[..., channel]), sign * shift)
    return out


def defocus(light: Light, radius: float, wraps: bool) -> Light:
    """Blur by a disc, the circle of confusion. radius: px."""
    reach, fine = int(np.ceil(radius + 0.5)), 8
    axis = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    disc = (np.hypot(*np.meshgrid(axis, axis)) <= radius).astype(np.float32)
    kernel = disc.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).mean(axis=(1, 3))
    return _padded(light, reach, wraps, lambda image: cv2.filter2D(image, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE))


def vignette(light: Light, field: OpticalField, stops: float) -> Light:
    """Light lost towards the border of the field: `stops` there, growing with the square of the distance from the axis."""
    return light * np.exp2(np.float32(-stops) * field.radius**2)[..., None]


def gain_noise(light: Light, gain: float, rng: np.random.Generator) -> Light:
    """Noise of a sensor at a gain of `gain` dB: shot noise of the electrons and read noise (linear model of EMVA 1288)."""
    per_electron = 10 ** (gain / 20) / FULL_WELL
    sigma = np.sqrt(np.maximum(light, 0) * np.float32(per_electron) + np.float32((READ_NOISE * per_electron) ** 2))
    return light + sigma * rng.standard_normal(light.shape, dtype=np.float32)


def halos(counts: Counts, amount: float, wraps: bool) -> Counts:
    """Unsharp masking: adds `amount` times the detail, which is the image less its Gaussian blur."""
    image = counts.astype(np.float32)
    smooth = _padded(image, int(4 * HALO_RADIUS), wraps, lambda one: cv2.GaussianBlur(one, (0, 0), HALO_RADIUS, borderType=cv2.BORDER_REPLICATE))
    return np.asarray(np.clip(np.rint(image + np.float32(amount) * (image - smooth)), 0, 255), dtype=np.uint8)


def jpeg(counts: Counts, quality: int) -> Counts:
    """The image after JPEG compression of a quality from 1 to 100."""
    _, data = cv2.imencode(".jpg", counts[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.ascontiguousarray(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1], dtype=np.uint8)


class ImageEffects:
    """The effects on the images of one lens or one recorded view, frame by frame.

    camera: model of the images. stops: change of the exposure. rng: draws specks and drops once, and noise for every image.
    Equal arguments give equal images. spots: specks and drops on the lens.
    """

    def __init__(self, effects: Effects, camera: Camera, rng: np.random.Generator, stops: float = 0.0) -> None:
        self.effects, self._camera, self.stops = effects, camera, stops
        spot_rng, self._rng = rng.spawn(2)
        self._field = OpticalField(camera) if effects.chromatic or effects.vignette else None
        self._seen = _seen(camera) if effects.drops or effects.dust else None
        self._drops = list(_drawn_spots("drops", int(effects.drops or 0), self._seen, spot_rng))
        specks = list(_drawn_spots("dust", int(effects.dust or 0), self._seen, spot_rng))
        self._transmission = dust_transmission((camera.height, camera.width), specks, camera.wraps) if specks else None
        self.spots = (*self._drops, *specks)

    def captured(self, counts: Counts) -> Counts:
        """The image (H, W, 3) as the sensor captures it: effects 1 to 7."""
        e, camera = self.effects, self._camera
        if not (self._drops or self._transmission is not None or self.stops) and {e.chromatic, e.defocus, e.vignette, e.gain} == {None}:
            return counts
        light = linear_light(counts)
        if self._drops:
            light = drops(light, self._drops, camera.wraps) * np.asarray(self._seen)[..., None]
        if self._transmission is not None:
            light = light * self._transmission
        if e.chromatic is not None and self._field is not None:
            light = chromatic_shift(light, self._field, e.chromatic)
        if e.defocus is not None:
            light = defocus(light, e.defocus, camera.wraps)
        if e.vignette is not None and self._field is not None:
            light = vignette(light, self._field, e.vignette)
        if self.stops:
            light = light * np.float32(2.0**self.stops)
        if e.gain is not None:
            light = gain_noise(light, e.gain, self._rng)
        return counts_of(light)

    def processed(self, counts: Counts) -> Counts:
        """The captured image (H, W, 3) after the camera's processing: effects 8 and 9."""
        if self.effects.halos is not None:
            counts = halos(counts, self.effects.halos, self._camera.wraps)
        return counts if self.effects.jpeg is None else jpeg(counts, int(self.effects.jpeg))


def averaged(images: list[Counts]) -> Counts:
    """The mean of images (H, W, 3) in linear light: one exposure of a scene that moves."""
    return counts_of(np.mean([linear_light(image) for image in images], axis=0, dtype=np.float32))


def _seen(camera: Camera) -> NDArray[np.bool_]:
    """Mask (H, W) of the pixels that the lens illuminates."""
    u, v = np.meshgrid(np.arange(camera.width) + camera.pixel_centre, np.arange(camera.height) + camera.pixel_centre)
    return np.asarray(~camera.blind(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(camera.height, camera.width))


def _drawn_spots(effect: str, count: int, seen: NDArray[np.bool_] | None, rng: np.random.Generator) -> Iterator[Spot]:
    """Spots at random pixels of the mask `seen` (H, W)."""
    if seen is None or not count:
        return
    rows, columns = np.nonzero(seen)
    low, high = DUST_RADIUS if effect == "dust" else DROP_RADIUS
    for _ in range(count):
        place, radius, opacity = rng.random(3)
        k = int(place * len(rows))
        opacity = DUST_OPACITY[0] + opacity * (DUST_OPACITY[1] - DUST_OPACITY[0]) if effect == "dust" else 0.9
        size = max((low + radius * (high - low)) * seen.shape[0], 1.0)
        yield Spot(effect, columns[k] + 0.5, rows[k] + 0.5, size, opacity)


def _padded(image: NDArray[np.float32], reach: int, wraps: bool, function: Callable[[NDArray[np.float32]], Any]) -> NDArray[np.float32]:
    """`function` of an image. A panorama is padded by `reach` columns over its seam first."""
    if not wraps:
        return np.asarray(function(image), dtype=np.float32)
    wide = np.concatenate([image[:, -reach:], image, image[:, :reach]], axis=1)
    return np.asarray(function(wide)[:, reach:-reach], dtype=np.float32)
