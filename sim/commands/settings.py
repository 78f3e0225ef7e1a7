"""Every field of a scenario as an option, without a value where the preset's shall stay."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Settings:
    """What the preset says, changed."""

    world: str | None = None
    """The place: `pilsim worlds` lists them."""
    difficulty: float | None = None
    """Of the ground, from 0 (gentle) to 1."""
    seed: int | None = None
    """Of everything random."""
    robots: int | None = None
    """Rovers with a panoramic camera each."""
    people: int | None = None
    """Who walk about, in all."""
    at_once: int | None = None
    """How many of the people are there at once, coming and going; all throughout where it is 0."""
    children: float | None = None
    """The share of people who are children."""
    frames: int | None = None
    """How many frames."""
    rate: float | None = None
    """Frames a second."""
    width: int | None = None
    """Of a panorama in pixels; it is half as high. Images of fixed cameras are three quarters as wide."""
    camera_height: float | None = None
    """Of the panoramic cameras over the ground, m."""
    timestep: float | None = None
    """Of the physics, s."""
    exposure: float | None = None
    """Sigma of a slow drift of the exposure, in stops."""
    image_noise: float | None = None
    """Sigma of the noise of a pixel, in counts of 255."""
    misses: float | None = None
    """The share of visible people whom the simulated detector misses."""
    clutter: float | None = None
    """Mean number of its false detections a view and frame."""
    bearing_noise: float | None = None
    """Sigma of the edge of a detection, rad."""
    min_visible: float | None = None
    """The visible fraction of a body below which it is never detected."""

    def given(self) -> dict[str, Any]:
        """Name → value of what was given."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if value is not None}
