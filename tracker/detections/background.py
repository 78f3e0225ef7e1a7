"""What a camera that stands still sees when nobody is there, and where an image differs from that.

Each pixel is a normal distribution of colours that is followed over time (Wren et al. 1997, Pfinder); what is only darker, of the same hue, is a
shadow (Horprasert et al. 1999). OpenCV's models of a background learn all pixels alike. Here a pixel is unknown until it was still for a while
without a box on it, so that who is there at the start is not taken for a part of the scene; and where a detector found somebody of late it
learns hardly at all, so that who stands still is not, either.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker.geometry import Array, Floats, Mask

Ages = NDArray[np.int64]


@dataclass(frozen=True)
class BackdropParameters:
    """Times in s, colours in levels of 255."""

    apart: float = 3.0  # standard deviations from which a pixel differs
    noise: float = 5.5  # of a pixel, over its three colours, at least ...
    most_noise: float = 30.0  # ... and at most
    shadow: tuple[float, float] = (0.55, 0.97)  # brightness of a shadow, of what it falls on ...
    hue: float = 8.0  # ... and how much else of the colour may change
    still: float = 1.5  # for which a pixel must stay as it is to be known
    memory: float = 8.5  # for which the scene is remembered
    found: float = 10.0  # after the last box on it for which what differs is held for a person ...
    held: float = 200.0  # ... and within which such a one becomes a part of the scene all the same, ...
    absorbed: float = 5.0  # ... and anything else
    sudden: float = 0.4  # share of the pixels that differ at once from which it is another scene, or the light


@dataclass(eq=False)
class _Scene:
    """Of each pixel (H, W): colour, variance, whether it is known; ticks for which it has been still, and since the last box on it."""

    colour: Floats
    variance: Floats
    known: Mask
    still: Ages
    alone: Ages


class BackgroundModel:
    """State after an image depends on the images and boxes up to it alone."""

    def __init__(self, period: float, parameters: BackdropParameters | None = None) -> None:
        """period: s from image to image."""
        self.period, self.parameters = period, parameters or BackdropParameters()
        self._scene: _Scene | None = None
        self._seen = 0

    def step(self, image: NDArray[np.uint8], people: Mask) -> tuple[Mask, Mask]:
        """Take an image (H, W, 3) and where boxes hold people (H, W). Which pixels differ from the backdrop, and of which it is not known."""
        p = self.parameters
        now = cv2.GaussianBlur(image, (3, 3), 0).astype(np.float32)
        s, nothing = self._scene, np.zeros(people.shape, dtype=np.bool_)
        if s is not None and s.known.shape == people.shape:
            differs, shadow = _compared(now, s.colour, s.variance, s.known, np.array([p.apart**2, *p.shadow, p.hue**2]))
            if differs.sum() <= p.sudden * max(s.known.sum(), 1):
                self._seen += 1
                _learnt(now, (s.colour, s.variance, s.known, s.still, s.alone), (differs, people), self._rates(), self._limits())
                body = cv2.medianBlur((differs & ~shadow).astype(np.uint8), 3) > 0
                return np.asarray(body), ~s.known
        unknown, ages = nothing.copy(), np.zeros(people.shape, dtype=np.int64)
        self._scene = _Scene(now, np.full(people.shape, 2 * p.noise**2, np.float32), unknown, ages, ages + round(p.found / self.period) + 1)
        self._seen = 0
        return nothing, ~nothing

    def _rates(self) -> Array:
        """(3,) shares by which a pixel follows: one that does not differ, one that does where somebody was found of late, and elsewhere."""
        p = self.parameters
        rates = self.period / np.array([p.memory, p.held, p.absorbed])
        return np.minimum(np.maximum(rates, [1 / (self._seen + 1), 0.0, 0.0]), 1.0)

    def _limits(self) -> Array:
        """(5,): least and greatest variance, square of a difference up to which a pixel is still, ticks after which it is known, and for which it is
        held."""
        p = self.parameters
        return np.array([p.noise**2, p.most_noise**2, 2 * (p.apart * p.noise) ** 2, p.still / self.period, p.found / self.period])


@njit(cache=True)
def _compared(now: Floats, colour: Floats, variance: Floats, known: Mask, limits: Array) -> tuple[Mask, Mask]:
    """Which pixels differ from what is known of them, and which of them may be shadows."""
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
def _learnt(now: Floats, scene: tuple[Floats, Floats, Mask, Ages, Ages], seen: tuple[Mask, Mask], rates: Array, limits: Array) -> None:
    """Move the scene, in place; seen: which pixels differ, and where people are."""
    (colour, variance, known, still, alone), (differs, people) = scene, seen
    for i in range(known.shape[0]):
        for j in range(known.shape[1]):
            alone[i, j] = 0 if people[i, j] else alone[i, j] + 1
            apart = 0.0
            for c in range(3):
                apart += (now[i, j, c] - colour[i, j, c]) ** 2
            if not known[i, j]:
                still[i, j] = 0 if people[i, j] or apart > limits[2] else still[i, j] + 1
                known[i, j] = still[i, j] >= limits[3]
                rate = 1 / (still[i, j] + 1)
            elif people[i, j]:
                continue
            else:
                rate = rates[0] if not differs[i, j] else rates[1] if alone[i, j] <= limits[4] else rates[2]
                # One step of something else says little of the noise.
                new = (1 - rate) * variance[i, j] + rate * min(apart, 2 * limits[1])
                variance[i, j] = min(max(new, limits[0]), limits[1])
            for c in range(3):
                colour[i, j, c] += rate * (now[i, j, c] - colour[i, j, c])
