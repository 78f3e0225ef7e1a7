"""Every field of a scenario as an option, without a value where the preset's shall stay."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any

from sim.commands.options import unset

_OWN = "the preset's"
Word = Annotated[str | None, unset("STR", _OWN)]
Whole = Annotated[int | None, unset("INT", _OWN)]
Number = Annotated[float | None, unset("FLOAT", _OWN)]


@dataclass(frozen=True)
class Settings:
    """What the preset says, changed."""

    world: Word = None
    """The place: `pilsim worlds` lists them."""
    difficulty: Number = None
    """Of the ground, from 0 (gentle) to 1."""
    seed: Whole = None
    """Of everything random."""
    robots: Whole = None
    """Rovers with a panoramic camera each."""
    people: Whole = None
    """Who walk about, in all."""
    at_once: Whole = None
    """How many of the people are there at once, coming and going; all throughout where it is 0."""
    children: Number = None
    """The share of people who are children."""
    frames: Whole = None
    """How many frames."""
    rate: Number = None
    """Frames a second."""
    width: Whole = None
    """Of a panorama in pixels; it is half as high. Images of fixed cameras are three quarters as wide."""
    camera_height: Number = None
    """Of the panoramic cameras over the ground, m."""
    timestep: Number = None
    """Of the physics, s."""
    exposure: Number = None
    """Sigma of a slow drift of the exposure, in stops."""
    image_noise: Number = None
    """Sigma of the noise of a pixel, in counts of 255."""
    misses: Number = None
    """The share of visible people whom the simulated detector misses."""
    clutter: Number = None
    """Mean number of its false detections a view and frame."""
    bearing_noise: Number = None
    """Sigma of the edge of a detection, rad."""
    min_visible: Number = None
    """The visible fraction of a body below which it is never detected."""

    def given(self) -> dict[str, Any]:
        """Name → value of what was given."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if value is not None}
