"""Background subtraction for a fixed camera, with the boxes of a person detector as a guide.

Each pixel is one normal distribution of colours that adapts over time (Wren et al. 1997, Pfinder). A pixel that is only darker, of the same hue, is
a shadow (Horprasert et al. 1999). OpenCV's background models adapt all pixels alike. Here a pixel is unknown until its colour is stable for a
while without a box on it. So people at the start of a sequence do not become background. Pixels under recent boxes adapt very slowly, so that
people who stand still do not become background either.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Floats, Mask
from tracker.geometry.compilation import njit

THRESHOLD = 3.0
"""Standard deviations from which a pixel is foreground."""
MIN_NOISE, MAX_NOISE = 5.5, 30.0
"""Least and greatest standard deviation of a pixel, over its three colours, levels of 255."""
SHADOW, SHADOW_COLOUR = (0.55, 0.97), 8.0
"""Least and greatest brightness of a shadow, as a share of the background's; greatest other change of colour, levels of 255."""
STABLE, MEMORY = 1.5, 8.5
"""s for which a pixel must be stable to become known; time constant of the background, s."""
PERSON_MEMORY = 10.0
"""s after the last box on a pixel for which its foreground counts as a person."""
ABSORB_PERSON, ABSORB_OBJECT = 200.0, 5.0
"""s, time constants with which such foreground and other foreground become background."""
SCENE_CHANGE = 0.4
"""Share of foreground pixels above which the model starts anew: the light or the scene has changed."""


@dataclass(eq=False)
class _Scene:
    """State of each pixel (H, W): colour, variance, known; stable: periods without a change; since_box: periods since the last box on it."""

    colour: Floats
    variance: Floats
    known: Mask
    stable: Array
    since_box: Array


class BackgroundModel:
    """Background model of one camera; causal: its state depends on the images and boxes so far."""

    def __init__(self, period: float) -> None:
        """period: usual s from image to image."""
        self.period = period
        self._scene: _Scene | None = None
        self._seen = 0

    def step(self, image: NDArray[np.uint8], people: Mask, elapsed: float | None = None) -> tuple[Mask, Mask]:
        """Foreground (H, W) and unknown pixels (H, W) of an image (H, W, 3); people (H, W): pixels within boxes of people.

        elapsed: s since the image before, the period by default. An image of another size starts the model anew.
        """
        elapsed = self.period if elapsed is None else elapsed
        now = cv2.GaussianBlur(image, (3, 3), 0).astype(np.float32)
        s, none = self._scene, np.zeros(people.shape, dtype=np.bool_)
        if s is not None and s.known.shape == people.shape:
            differs, shadow = _subtract(now, s.colour, s.variance, s.known, np.array([THRESHOLD**2, *SHADOW, SHADOW_COLOUR**2]))
            if differs.sum() <= SCENE_CHANGE * max(s.known.sum(), 1):
                self._seen += 1
                scene = s.colour, s.variance, s.known, s.stable, s.since_box
                _adapt(now, scene, (differs, people), self._rates(elapsed), self._limits(elapsed))
                body = cv2.medianBlur((differs & ~shadow).astype(np.uint8), 3) > 0
                return np.asarray(body), ~s.known
        known, ages = none.copy(), np.zeros(people.shape)
        self._scene = _Scene(now, np.full(people.shape, 2 * MIN_NOISE**2, np.float32), known, ages, ages + round(PERSON_MEMORY / self.period) + 1)
        self._seen = 0
        return none, ~none

    def _rates(self, elapsed: float) -> Array:
        """Adaptation rates (3,) of background pixels, of foreground pixels under recent boxes, and of other foreground pixels, after `elapsed` s."""
        rates = elapsed / np.array([MEMORY, ABSORB_PERSON, ABSORB_OBJECT])
        return np.minimum(np.maximum(rates, [1 / (self._seen + 1), 0.0, 0.0]), 1.0)

    def _limits(self, elapsed: float) -> Array:
        """Limits (6,): least and greatest variance, and squared change of a stable pixel.

        Then periods until a pixel is known, for which boxes are recent, and since the image before.
        """
        noise = MIN_NOISE**2, MAX_NOISE**2, 2 * (THRESHOLD * MIN_NOISE) ** 2
        return np.array([*noise, STABLE / self.period, PERSON_MEMORY / self.period, elapsed / self.period])


@njit(cache=True)
def _subtract(now: Floats, colour: Floats, variance: Floats, known: Mask, limits: Array) -> tuple[Mask, Mask]:
    """Pixels (H, W) that differ from the background, and those of them that may be shadows; limits (4,): see `step`."""
    differs, shadow = np.zeros(known.shape, np.bool_), np.zeros(known.shape, np.bool_)
    for i in range(known.shape[0]):
        for j in range(known.shape[1]):
            if not known[i, j]:
                continue
            apart, dot, square = 0.0, 0.0, 1e-3
            for c in range(3):
                a, b = now[i, j, c], colour[i, j, c]
                apart += (a - b) ** 2
                dot += a * b
                square += b * b
            if apart <= limits[0] * variance[i, j]:
                continue
            differs[i, j] = True
            dim, rest = dot / square, 0.0
            for c in range(3):
                rest += (now[i, j, c] - dim * colour[i, j, c]) ** 2
            shadow[i, j] = limits[1] < dim < limits[2] and rest < limits[3]
    return differs, shadow


@njit(cache=True)
def _adapt(now: Floats, scene: tuple[Floats, Floats, Mask, Array, Array], seen: tuple[Mask, Mask], rates: Array, limits: Array) -> None:
    """Adapt the scene in place; seen: pixels that differ, and pixels within boxes of people."""
    (colour, variance, known, stable, since_box), (differs, people), periods = scene, seen, limits[5]
    for i in range(known.shape[0]):
        for j in range(known.shape[1]):
            since_box[i, j] = 0.0 if people[i, j] else since_box[i, j] + periods
            apart = 0.0
            for c in range(3):
                apart += (now[i, j, c] - colour[i, j, c]) ** 2
            if not known[i, j]:
                stable[i, j] = 0.0 if people[i, j] or apart > limits[2] else stable[i, j] + periods
                known[i, j] = stable[i, j] >= limits[3]
                rate = periods / (stable[i, j] + periods)
            elif people[i, j]:
                continue
            else:
                rate = rates[0] if not differs[i, j] else rates[1] if since_box[i, j] <= limits[4] else rates[2]
                # A single change of colour is little evidence about the noise.
                new = (1 - rate) * variance[i, j] + rate * min(apart, 2 * limits[1])
                variance[i, j] = min(max(new, limits[0]), limits[1])
            for c in range(3):
                colour[i, j, c] += rate * (now[i, j, c] - colour[i, j, c])
