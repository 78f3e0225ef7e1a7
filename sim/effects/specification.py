"""The effects of a scenario as a text, `vignette=1.5,readout=0.02`: names, units and bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tracker.io.text_files import named_values

BOUNDS: dict[str, tuple[float, float, str]] = {
    "readout": (1e-4, 1.0, "s"),
    "shutter": (1e-4, 1.0, "s"),
    "subframes": (3, 33, "images, an odd number"),
    "drops": (1, 100, "drops, a whole number"),
    "dust": (1, 500, "specks, a whole number"),
    "chromatic": (-10.0, 10.0, "px"),
    "defocus": (0.1, 20.0, "px"),
    "vignette": (0.01, 6.0, "stops"),
    "seam": (-4.0, 4.0, "stops"),
    "gain": (0.0, 48.0, "dB"),
    "halos": (0.01, 4.0, "of the detail"),
    "jpeg": (1, 100, "of quality, a whole number"),
    "mount_angle": (0.001, 30.0, "degrees"),
    "mount_shift": (0.0001, 1.0, "m"),
}
"""Name → lowest and highest value, and unit, in the order in which the effects act; the last two are errors of the calibration."""
WHOLE = ("subframes", "drops", "dust", "jpeg")
DEFAULT_SUBFRAMES = 5


@dataclass(frozen=True)
class Effects:
    """Values of the effects; None is off.

    readout: s from the first row to the last (rolling shutter). shutter: s of exposure (motion blur); subframes: images that are averaged.
    drops, dust: number on each lens. chromatic: px between red and green, and green and blue, at the border of the field.
    defocus: px, radius of the circle of confusion. vignette: stops of light lost at the border of the field.
    seam: stops by which the forward lens of a dual fisheye is brighter than the backward one. gain: dB of the sensor, which makes noise.
    halos: of unsharp masking, as a share of the detail. jpeg: quality.
    mount_angle: degrees, mount_shift: m by which the calibration of each camera's mount is off.
    Raises ValueError for a value out of BOUNDS, and for effects that do not go together.
    """

    readout: float | None = None
    shutter: float | None = None
    subframes: float | None = None
    drops: float | None = None
    dust: float | None = None
    chromatic: float | None = None
    defocus: float | None = None
    vignette: float | None = None
    seam: float | None = None
    gain: float | None = None
    halos: float | None = None
    jpeg: float | None = None
    mount_angle: float | None = None
    mount_shift: float | None = None

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


def parse_effects(text: str) -> Effects:
    """The effects of a text. Raises ValueError for unknown, repeated and invalid ones."""
    values: dict[str, float] = {}
    for name, number in named_values(text, BOUNDS, "effect has", f"NAME=VALUE with a name of {', '.join(BOUNDS)}").items():
        try:
            values[name] = float(number)
        except ValueError:
            raise ValueError(f"effect {name} is {number[:40]!r}, needs a number") from None
        if not math.isfinite(values[name]):
            raise ValueError(f"effect {name} is {number[:40]!r}, needs a finite number")
    return Effects(**values)
