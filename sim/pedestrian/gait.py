"""Gait: footfalls and swings of all people, computed from the motion of their bodies.

A stride is one cycle of the phase. The left foot swings in [0, SWING), the right foot half a cycle later. Both stand in between.
A standing foot does not move. A swinging foot moves to the footfall predicted for its touchdown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracker.geometry import Array, frozen, wrap

SWING = 0.4
"""Share of a stride in which a foot swings (Perry & Burnfield 2010, Gait Analysis: stance takes 60 %)."""
WALK_RATIO = 0.39
"""Step length over step rate, m s. It is nearly constant above 1 m/s (Sekiya & Nagasaki 1998: 0.0065 m/(steps/min);
Murakami & Otaka 2017 for the bound)."""
LANDING_LEAD = 0.21
"""Share of a stride by which a foot lands ahead of the body."""
HALF_WIDTH = 0.032
"""Half the step width as a share of stature."""
_SHORTEST_STEP = 0.25
_ADJUSTING_RATE = 0.9
"""Strides/s of a standing person who corrects the feet."""
_FASTEST_RATE = 1.9
"""Highest stride rate, strides/s."""
_HIP_ROTATION = 0.6
"""rad: largest rotation of a leg in the hip (35°; Roaas & Andersson 1982 measured 33° in and out)."""


Mask = NDArray[np.bool_]


class Terrain(Protocol):
    """Ground for walking: heights (n,) m at points (n, 2) m."""

    def height_at(self, points: ArrayLike) -> Array: ...


@dataclass(frozen=True, eq=False)
class Footing:
    """Footfalls of m people; left is 0, right is 1. The position of a foot is the ground point under its ankle when it stands flat.

    phase: (m,) in [0, 1). planted (m, 2, 2) m, planted_yaw (m, 2) rad: current footfall of a standing foot, next one of a swinging foot.
    lifted, lifted_yaw: the previous footfall.
    """

    phase: Array
    planted: Array
    planted_yaw: Array
    lifted: Array
    lifted_yaw: Array

    def __post_init__(self) -> None:
        m = len(self.phase)
        shapes = {"phase": (m,), "planted": (m, 2, 2), "planted_yaw": (m, 2), "lifted": (m, 2, 2), "lifted_yaw": (m, 2)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(getattr(self, name), shape, name))

    @property
    def foot_phase(self) -> Array:
        """(m, 2) in [0, 1): share of a stride since lift-off of each foot."""
        return _foot_phases(self.phase)

    @property
    def swing(self) -> Array:
        """(m, 2) in [0, 1): completed share of the swing of each foot, 0 if it stands."""
        own = _foot_phases(self.phase)
        return np.where(own < SWING, own / SWING, 0.0)

    @property
    def standing(self) -> Mask:
        """(m, 2) bool: whether each foot is on the ground."""
        return _foot_phases(self.phase) >= SWING


def stand(position: Array, heading: Array, stature: Array) -> Footing:
    """Feet side by side under position (m, 2) m with heading (m,) rad, for people of stature (m,) m."""
    foot_positions = _neutral_places(position, heading, stature)
    yaw = np.repeat(heading[:, None], 2, axis=1)
    return Footing(np.full(len(position), 0.45), foot_positions, yaw, foot_positions, yaw)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Motion of m bodies: position (m, 2) m, velocity (m, 2) m/s, heading (m,) rad, stature (m,) m."""

    position: Array
    velocity: Array
    heading: Array
    stature: Array


def select_rows(rows: Mask, footing: Footing, otherwise: Footing) -> Footing:
    """`footing` where rows (m,) is true, `otherwise` elsewhere."""
    pairs = ((getattr(footing, f.name), getattr(otherwise, f.name)) for f in fields(Footing))
    return Footing(*(np.where(rows.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))


def walk(footing: Footing, bodies: Bodies, dt: float) -> Footing:
    """The footing `dt` s later, when the bodies have reached the state `bodies`.

    The phase advances with the distance walked. A standing person first corrects a foot that swings, is far off or is turned away.
    A foot that is far behind the body hastens the next step.
    """
    rate = _stride_rate(footing, bodies)
    phase = np.mod(footing.phase + rate * dt, 1.0)
    before, own = _foot_phases(footing.phase), _foot_phases(phase)
    leaving = (own < SWING) & (before >= SWING)
    lifted = np.where(leaving[..., None], footing.planted, footing.lifted)
    lifted_yaw = np.where(leaving, footing.planted_yaw, footing.lifted_yaw)
    # Predicted body position at touchdown, plus the lead of the foot.
    safe = np.maximum(rate, 1e-6)[:, None]
    wait = np.clip((SWING - own) / safe, 0.0, 0.6) + LANDING_LEAD / safe * (rate[:, None] > 0)
    target = _neutral_places(bodies.position, bodies.heading, bodies.stature) + bodies.velocity[:, None] * wait[..., None]
    swinging = own < SWING
    planted = np.where(swinging[..., None], target, footing.planted)
    planted_yaw = np.where(swinging, _foot_yaw(bodies)[:, None], footing.planted_yaw)
    return replace(footing, phase=phase, planted=planted, planted_yaw=planted_yaw, lifted=lifted, lifted_yaw=lifted_yaw)


def foot_positions(footing: Footing) -> tuple[Array, Array]:
    """Current positions (m, 2, 2) m in the plane and yaws (m, 2) rad of the feet."""
    # The smoothstep function 3 s² − 2 s³.
    share = footing.swing * footing.swing * (3 - 2 * footing.swing)
    moving = ~footing.standing
    place = np.where(moving[..., None], footing.lifted + share[..., None] * (footing.planted - footing.lifted), footing.planted)
    turn = wrap(footing.planted_yaw - footing.lifted_yaw)
    return place, np.where(moving, footing.lifted_yaw + share * turn, footing.planted_yaw)


def displacement_to_landing(footing: Footing, position: Array, heading: Array, stature: Array) -> Array:
    """Displacement (m, 2, 2) m of the body until touchdown of each swinging foot, as predicted by `walk`; 0 for standing feet."""
    left = SWING - footing.foot_phase
    share = np.where(footing.standing, 0.0, left / (left + LANDING_LEAD))
    return share[..., None] * (footing.planted - _neutral_places(position, heading, stature))


def _stride_rate(footing: Footing, bodies: Bodies) -> Array:
    """Strides/s (m,)."""
    speed = np.hypot(*bodies.velocity.T)
    size = bodies.stature / 1.75
    step = np.maximum(np.sqrt(WALK_RATIO * speed), _SHORTEST_STEP) * np.sqrt(size)
    offset = np.linalg.norm(footing.planted - _neutral_places(bodies.position, bodies.heading, bodies.stature), axis=2)
    turned = np.abs(wrap(footing.planted_yaw - bodies.heading[:, None]))
    unsettled = ~footing.standing.all(axis=1) | (offset.max(axis=1) > 0.08) | (turned.max(axis=1) > 0.4)
    # A person who stops in mid-stride draws the far foot up at once.
    adjusting = _ADJUSTING_RATE + np.clip(4 * (offset.max(axis=1) - 0.15), 0.0, 0.7)
    rate = np.maximum(speed / (2 * step), adjusting * unsettled * np.clip((0.4 - speed) / 0.3, 0.0, 1.0))
    # A foot falls behind by (1 − SWING − LANDING_LEAD) of a stride in steady gait. More than that, as after braking or a push, hastens
    # the next step. So does a body that turns away from the feet: people turn in short steps.
    behind = np.where(footing.standing, offset, 0.0).max(axis=1) / ((1 - SWING - LANDING_LEAD) * 2 * step)
    askew = np.where(footing.standing, turned, 0.0).max(axis=1)
    hurried = rate * (1 + np.clip(np.maximum(3 * (behind - 1.1), 2.5 * (askew - 0.4)), 0.0, 2.5))
    return np.maximum(rate, np.minimum(hurried, _FASTEST_RATE))


def _foot_yaw(bodies: Bodies) -> Array:
    """Yaw (m,) rad of the next footfalls: the heading, rotated towards the direction of motion within the range of the hip."""
    vx, vy = bodies.velocity.T
    turn = wrap(np.arctan2(vy, vx) - bodies.heading)
    return bodies.heading + np.clip(turn, -_HIP_ROTATION, _HIP_ROTATION) * np.clip(np.hypot(vx, vy) / 0.3 - 0.5, 0.0, 1.0)


def _foot_phases(phase: Array) -> Array:
    """Phase (m,) → phase of each foot since lift-off (m, 2)."""
    return np.mod(phase[:, None] + np.array([0.0, 0.5]), 1.0)


def _neutral_places(position: Array, heading: Array, stature: Array) -> Array:
    """Positions (m, 2, 2) m of feet side by side under the bodies."""
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1) * (HALF_WIDTH * stature)[:, None]
    return position[:, None] + left[:, None] * np.array([1.0, -1.0])[:, None]


def foot_lift(footing: Footing, stature: Array) -> Array:
    """Height (m, 2) m of the swinging feet above the line between their footfalls."""
    return 0.035 * stature[:, None] * np.sin(math.pi * footing.swing) * ~footing.standing
