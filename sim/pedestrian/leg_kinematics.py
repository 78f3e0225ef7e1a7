"""Inverse kinematics of the legs: hip height over both feet, rise of the heels, positions of the knees.

A leg has two links from hip to ankle (law of cosines). The front foot carries the body. The heel of the rear foot rises as far as its leg needs.
Before touchdown the hips sink to the reach of the landing leg, so that the hip height has no jump.
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
"""Largest distance from hip to ankle, a share of the length of the leg."""
_RISE_AFTER_LIFT_OFF = 0.25
"""Largest rise of the hips in a swing above the limit of the leg that left the ground, a share of size."""
_DESCENT_BEFORE_LANDING = 0.08, 0.17
"""Margin of the hips above the limit of a landing leg: coefficients of the remaining swing and of its square, shares of size."""
_BLEND = 0.012
"""Difference between the limits of both legs within which they are blended, a share of size."""


def hip_height(size: Array, feet: Feet, footing: Footing, hips: Array) -> Array:
    """Hip height (m,) m of people of size (m,) m at which both nearly straight legs reach their feet. hips: (m, 2, 2) m in the plane.

    It is continuous: the limit of a swinging leg fades out after lift-off and fades in before touchdown.
    """
    upright = feet.toe[..., 2] + (ANKLE + _LARGEST_STRETCH * (THIGH + SHIN)) * size[:, None]
    # A raised heel extends the reach but does not lift the body.
    held = np.maximum(_highest_hips(size, feet.ankle, hips), np.minimum(_highest_hips(size, feet.rolled(feet.remaining_roll).ankle, hips), upright))
    left = 1 - footing.swing
    leaving = held + _RISE_AFTER_LIFT_OFF * size[:, None] * footing.swing
    coming = _highest_hips(size, feet.landing, hips) + size[:, None] * (_DESCENT_BEFORE_LANDING[0] * left + _DESCENT_BEFORE_LANDING[1] * left**2)
    a, b = np.where(footing.standing, held, np.minimum(leaving, coming)).T
    return np.minimum(a, b) - np.maximum(_BLEND * size - np.abs(a - b), 0.0) ** 2 / (4 * _BLEND * size)


def raise_heels(size: Array, hips: Array, feet: Feet) -> Feet:
    """The feet with heels raised as far as legs from hips (m, 2, 3) m need. Ankles that stay out of reach are moved within it."""
    leg = _LARGEST_STRETCH * (THIGH + SHIN) * size[:, None]
    arm, off = feet.ankle - feet.toe, hips - feet.toe
    y = feet.rotation[..., 1]
    across = np.einsum("...i,...i->...", arm, y)
    # |off − arm rotated by an angle|² = constant − 2 (p cos + q sin).
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
    """Knees (m, 2, 3) m, rotations of thighs and of shins (m, 2, 3, 3) for hips (m, 2, 3) m. The knees point forward."""
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
    """Greatest height (m, 2) m of hips at (m, 2, 2) m in the plane from which legs reach the ankles (m, 2, 3) m."""
    leg = _LARGEST_STRETCH * (THIGH + SHIN) * size[:, None]
    across = np.linalg.norm(hips - ankle[..., :2], axis=2)
    return ankle[..., 2] + np.sqrt(np.maximum(leg**2 - across**2, (0.4 * leg) ** 2))


def _perpendicular(direction: Array, axis: Array) -> Array:
    """Unit vector along the component of `direction` perpendicular to the unit `axis`."""
    rest = direction - np.einsum("...i,...i->...", direction, axis)[..., None] * axis
    return rest / np.maximum(np.linalg.norm(rest, axis=-1), 1e-9)[..., None]


def _limb_rotations(up: Array, front: Array) -> Array:
    """Rotations (..., 3, 3) with z along `up` and x towards `front`."""
    z = up / np.maximum(np.linalg.norm(up, axis=-1), 1e-9)[..., None]
    x = _perpendicular(front, z)
    return np.stack([x, np.cross(z, x), z], axis=-1)
