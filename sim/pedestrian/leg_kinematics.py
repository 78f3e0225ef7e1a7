"""Legs: how high the hips are over both feet, how far heels rise for it, and where knees and shins are.

A leg is two links from hip to ankle (law of cosines). The foot in front carries the body; the heel of the one behind rises as much as its leg
needs. Before a foot lands, the hips sink to where its leg will reach, so that nobody drops onto it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.pedestrian.foot_contact import ANKLE, Feet
from sim.pedestrian.gait import Footing
from tracker.geometry import Array

THIGH, SHIN = 0.245, 0.246
"""Hip to knee, knee to ankle; shares of stature (Drillis & Contini 1966, in Winter 2009, fig. 4.1)."""
_LARGEST_STRETCH = 0.996
"""The share of its length to which a leg is stretched."""
_RISE_AFTER_LIFT_OFF = 0.25
"""Shares of size by which the hips rise in a swing at most, over what the leg behind let them."""
_DESCENT_BEFORE_LANDING = 0.08, 0.17
"""Shares of size by which hips are higher than a landing leg lets them at most, to the first and the second power of what is left of the swing."""
_BLEND = 0.012
"""Share of size within which one leg takes over from the other."""


def hip_height(size: Array, feet: Feet, footing: Footing, hips: Array) -> Array:
    """(m,) m: the height at which both legs of people of size (m,) m reach their feet from hips over (m, 2, 2) m, hardly bent.

    It has no jumps: a foot in the air holds the body down less and less after it has left the ground, and more and more before it lands.
    """
    upright = feet.toe[..., 2] + (ANKLE + _LARGEST_STRETCH * (THIGH + SHIN)) * size[:, None]
    # A heel rises to let the body go on, not to lift it.
    held = np.maximum(_highest_hips(size, feet.ankle, hips), np.minimum(_highest_hips(size, feet.rolled(feet.remaining_roll).ankle, hips), upright))
    left = 1 - footing.swing
    leaving = held + _RISE_AFTER_LIFT_OFF * size[:, None] * footing.swing
    coming = _highest_hips(size, feet.landing, hips) + size[:, None] * (_DESCENT_BEFORE_LANDING[0] * left + _DESCENT_BEFORE_LANDING[1] * left**2)
    a, b = np.where(footing.standing, held, np.minimum(leaving, coming)).T
    return np.minimum(a, b) - np.maximum(_BLEND * size - np.abs(a - b), 0.0) ** 2 / (4 * _BLEND * size)


def raise_heels(size: Array, hips: Array, feet: Feet) -> Feet:
    """The feet with heels as high as legs from hips (m, 2, 3) m need; ankles that they do not reach even so are drawn up."""
    leg = _LARGEST_STRETCH * (THIGH + SHIN) * size[:, None]
    arm, off = feet.ankle - feet.toe, hips - feet.toe
    y = feet.rotation[..., 1]
    across = np.einsum("...i,...i->...", arm, y)
    # |off − arm rolled by an angle|² = constant − 2 (p cos + q sin).
    constant = (off**2).sum(-1) + (arm**2).sum(-1) - 2 * across * np.einsum("...i,...i->...", off, y)
    p = np.einsum("...i,...i->...", off, arm) - across * np.einsum("...i,...i->...", off, y)
    q = np.einsum("...i,...i->...", off, np.cross(y, arm))
    cosine = np.clip((constant - leg**2) / (2 * np.maximum(np.hypot(p, q), 1e-9)), -1.0, 1.0)
    angle = np.arctan2(q, p) - np.arccos(cosine)
    feet = feet.rolled(np.clip(np.where(angle < -np.pi, angle + 2 * np.pi, angle), 0.0, feet.remaining_roll))
    down = feet.ankle - hips
    share = np.minimum(1.0, 0.999 * (THIGH + SHIN) * size[:, None] / np.linalg.norm(down, axis=2))
    return replace(feet, ankle=hips + share[..., None] * down)


def solve_knees(size: Array, hips: Array, feet: Feet) -> tuple[Array, Array, Array]:
    """Knees (m, 2, 3) m, rotations of thighs and shins (m, 2, 3, 3): two links, the knee to the front, between hips (m, 2, 3) m and feet."""
    thigh, shin = THIGH * size[:, None], SHIN * size[:, None]
    down = feet.ankle - hips
    length = np.linalg.norm(down, axis=2)
    along = down / length[..., None]
    front = _perpendicular(feet.rotation[..., 0], along)
    reach = np.minimum(length, 0.9995 * (thigh + shin))
    cosine = np.clip((thigh**2 + reach**2 - shin**2) / (2 * thigh * reach), -1.0, 1.0)
    knees = hips + thigh[..., None] * (cosine[..., None] * along + np.sqrt(1 - cosine**2)[..., None] * front)
    return knees, _limb_rotations(hips - knees, front), _limb_rotations(knees - feet.ankle, front)


def _highest_hips(size: Array, ankle: Array, hips: Array) -> Array:
    """(m, 2) m: the height over which hips over (m, 2, 2) m do not get away from ankles (m, 2, 3) m."""
    leg = _LARGEST_STRETCH * (THIGH + SHIN) * size[:, None]
    across = np.linalg.norm(hips - ankle[..., :2], axis=2)
    return ankle[..., 2] + np.sqrt(np.maximum(leg**2 - across**2, (0.4 * leg) ** 2))


def _perpendicular(direction: Array, axis: Array) -> Array:
    """The part of `direction` across the unit `axis`, of length 1."""
    rest = direction - np.einsum("...i,...i->...", direction, axis)[..., None] * axis
    return rest / np.maximum(np.linalg.norm(rest, axis=-1), 1e-9)[..., None]


def _limb_rotations(up: Array, front: Array) -> Array:
    """Rotations (..., 3, 3) with z along `up` and x towards `front`."""
    z = up / np.maximum(np.linalg.norm(up, axis=-1), 1e-9)[..., None]
    x = _perpendicular(front, z)
    return np.stack([x, np.cross(z, x), z], axis=-1)
