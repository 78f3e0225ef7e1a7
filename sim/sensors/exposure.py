"""Camera model of exposure drift and pixel noise. Both are seeded and leave the truth of a view unchanged."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

TIME_CONSTANT = 3.0
"""s: time constant of the drift."""


class Exposure:
    """Exposure and noise of one view, frame by frame.

    stops: sigma of the exposure drift in stops (factors of two), a stationary Ornstein-Uhlenbeck process (Uhlenbeck & Ornstein 1930).
    noise: sigma of white noise in every pixel and channel, in counts of 255. period: s between frames.
    If both are 0, images pass unchanged and nothing is drawn from rng. Raises ValueError for a sigma below 0 or not finite.
    """

    def __init__(self, stops: float, noise: float, period: float, rng: np.random.Generator) -> None:
        for name, value in (("exposure", stops), ("image_noise", noise)):
            if not 0 <= value < math.inf:
                raise ValueError(f"{name} is {value}, needs 0 or more")
        self._stops, self._noise, self._rng = stops, noise, rng
        self._decay = math.exp(-period / TIME_CONSTANT)
        self._stops_now = rng.normal(0.0, stops) if stops else 0.0

    @property
    def is_off(self) -> bool:
        """Whether images pass unchanged."""
        return not self._stops and not self._noise

    def apply(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image (H, W, 3) of the next frame, with exposure and noise applied."""
        if self.is_off:
            return picture
        light = picture.astype(np.float32)
        if self._stops:
            light *= np.float32(2.0**self._stops_now)
            self._stops_now = self._decay * self._stops_now + math.sqrt(1 - self._decay**2) * self._rng.normal(0.0, self._stops)
        if self._noise:
            light += np.float32(self._noise) * self._rng.standard_normal(picture.shape, dtype=np.float32)
        return np.asarray(np.clip(np.rint(light), 0, 255), dtype=np.uint8)
