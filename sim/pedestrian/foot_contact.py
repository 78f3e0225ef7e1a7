"""Foot contact: rest of a stiff sole on uneven terrain, its roll over heel and toes, and its swing between footfalls."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.pedestrian import gait
from sim.pedestrian.gait import Footing, Terrain
from tracker.geometry import Array

HEEL, PIVOT, ANKLE = 0.040, 0.095, 0.039
"""Distances from the ankle to the heel, to the toe pivot and down to the sole, shares of stature (the foot is 0.152 long)."""
HALF_SOLE = 0.024
"""Half the width of the sole, a share of stature."""
_SOLE_POINTS = np.linspace(-HEEL, PIVOT, 9)
"""Sample points along the sole, from the ankle forward, shares of stature. The body's weight is over the middle one."""
_STEEPEST_SLOPE = 0.7
"""Tangent of the steepest slope of a standing sole along the foot; half of it across."""
_LARGEST_ROLL = 1.5
"""rad: bound of the roll angle, beyond that of any foot."""
_WALL_SLOPE = 50.0
"""Tangent that stands for a vertical slope."""
_CONTACT_GAP = 0.005
"""m: ground nearer to the sole than this supports it."""
_LARGEST_HEEL_RISE = 1.2
"""rad: largest rise of a heel before the toes leave the ground."""
_HEEL_RELEASE_START, _HEEL_RELEASE_END, _HEEL_RELEASE_SWING = 0.78, 0.95, 0.6
"""Foot phases at which the heel starts and ends to become free to rise; share of the next swing in which it is set back."""


@dataclass(frozen=True, eq=False)
class Feet:
    """Poses of the feet of m people, world frame; left is 0, right is 1.

    ankle (m, 2, 3) m, rotation (m, 2, 3, 3). toe (m, 2, 3) m: pivot in front. remaining_roll (m, 2) rad: how much farther the heel may rise.
    landing (m, 2, 3) m: position of the ankle at touchdown, less the displacement of the body until then.
    """

    ankle: Array
    rotation: Array
    toe: Array
    remaining_roll: Array
    landing: Array

    def rolled(self, angle: Array) -> Feet:
        """The feet with the heels raised: rotated about the toes by angle (m, 2) rad."""
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        x, y, z = np.moveaxis(self.rotation, -1, 0)
        arm = self.ankle - self.toe
        across = np.einsum("...i,...i->...", arm, y)[..., None] * y
        ankle = self.toe + across + c * (arm - across) + s * np.cross(y, arm)
        return replace(self, ankle=ankle, rotation=np.stack([c * x - s * z, y, c * z + s * x], axis=-1), remaining_roll=self.remaining_roll - angle)


def foot_poses(size: Array, footing: Footing, position: Array, heading: Array, ground: Terrain) -> Feet:
    """Poses of the feet of m people of size (m,) m, with bodies at position (m, 2) m and heading (m,) rad.

    A foot stands on the ground or swings between two footfalls. It rolls over the heel at touchdown and over the toes at push-off.
    """
    place, yaw = gait.foot_positions(footing)
    here, landing, leaving = (
        sole_contact(p, y, size, ground) for p, y in ((place, yaw), (footing.planted, footing.planted_yaw), (footing.lifted, footing.lifted_yaw))
    )
    share = (footing.swing**2 * (3 - 2 * footing.swing))[..., None]
    moving = ~footing.standing[..., None]
    # The swing is an arc over the line between footfalls, and never below the ground.
    sole = np.where(moving, leaving + share * (landing - leaving), here)
    arc = gait.foot_lift(footing, size)[..., None]
    sink = np.maximum((here - sole)[..., :2].max(axis=-1, keepdims=True) + 0.3 * arc, 0.0) * moving
    sole = sole + np.maximum(arc, np.minimum(sink, 0.5)) * np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    behind = _roll_angles(footing, place, position, heading, size)
    rolls = np.clip(behind, -sole[..., 5], sole[..., 6])
    ankle, rotation, toe = _ankle_poses(place, yaw, sole, rolls, size)
    drop = _gap_below(ankle, rotation, footing.standing, size, ground)
    ankle[..., 2], toe[..., 2] = ankle[..., 2] - drop, toe[..., 2] - drop
    # A heel rises only once the body has moved past the toes.
    over = np.einsum("mfi,mfi->mf", position[:, None] - place, np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)) / size[:, None]
    remaining_roll = (
        _heel_freedom(footing) * np.clip(0.5 + 5 * over, 0.0, 1.0) * np.maximum(np.minimum(_LARGEST_HEEL_RISE, sole[..., 6]) - rolls, 0.0)
    )
    return Feet(ankle, rotation, toe, remaining_roll, _landing(footing, landing, position, heading, size))


def _gap_below(ankle: Array, rotation: Array, standing: NDArray[np.bool_], size: Array, ground: Terrain) -> Array:
    """Smallest gap (m, 2) m between standing soles and the ground; 0 for swinging feet.

    It is above 0 at edges, because `sole_contact` neglects that a tilted sole covers less ground.
    """
    sole = np.stack([*np.meshgrid(_SOLE_POINTS, np.array([-1.0, 0.0, 1.0]) * HALF_SOLE), np.full((3, len(_SOLE_POINTS)), -ANKLE)], axis=-1).reshape(
        -1, 3
    )
    scale = np.broadcast_to(size[:, None], standing.shape)[standing]
    points = ankle[standing][:, None] + np.einsum("kij,pj->kpi", rotation[standing], sole) * scale[:, None, None]
    gap = (points[..., 2] - ground.height_at(points[..., :2].reshape(-1, 2)).reshape(points.shape[:-1])).min(axis=1, initial=np.inf)
    out = np.zeros(standing.shape)
    out[standing] = np.maximum(gap, 0.0)
    return out


def _ankle_poses(place: Array, yaw: Array, sole: Array, rolls: Array, size: Array) -> tuple[Array, Array, Array]:
    """Ankles (m, 2, 3) m, rotations (m, 2, 3, 3) and front pivots (m, 2, 3) m of feet at place (m, 2, 2) m.

    sole: (m, 2, 7) from `sole_contact`. rolls (m, 2): rad about the toes (above 0) or the heel (below 0).
    """
    slope = -np.arctan2(sole[..., 1] - sole[..., 0], (HEEL + PIVOT) * size[:, None])
    forward = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    heel = np.concatenate([place, sole[..., :1]], axis=-1) - forward * (HEEL * size)[:, None, None]
    flat, turned = rotation_matrices(yaw, slope, sole[..., 2]), rotation_matrices(yaw, slope + rolls, sole[..., 2])
    over = np.where(rolls > 0, sole[..., 4], sole[..., 3])[..., None]
    pivot = heel + flat[..., 0] * (over + HEEL) * size[:, None, None]
    toe = heel + flat[..., 0] * (sole[..., 4, None] + HEEL) * size[:, None, None]
    return pivot + (turned[..., 2] * ANKLE - turned[..., 0] * over) * size[:, None, None], turned, toe


def _landing(footing: Footing, sole: Array, position: Array, heading: Array, size: Array) -> Array:
    """Feet.landing of feet with contact sole (m, 2, 7) after touchdown."""
    displacement = gait.displacement_to_landing(footing, position, heading, size)
    ahead = np.einsum("mfi,mi->mf", position[:, None] + displacement - footing.planted, _forward(heading)) / size[:, None]
    rolls = np.clip(_roll_angle(ahead), -sole[..., 5], sole[..., 6])
    ankle, _, _ = _ankle_poses(footing.planted, footing.planted_yaw, sole, rolls, size)
    return ankle - np.concatenate([displacement, np.zeros_like(displacement[..., :1])], axis=-1)


def _heel_freedom(footing: Footing) -> Array:
    """(m, 2) in [0, 1]: share of the rise that a heel may take. It is 1 while the other foot carries the body."""
    rising = np.clip((footing.foot_phase - _HEEL_RELEASE_START) / (_HEEL_RELEASE_END - _HEEL_RELEASE_START), 0.0, 1.0)
    falling = np.clip(1 - footing.swing / _HEEL_RELEASE_SWING, 0.0, 1.0)
    share = np.where(footing.standing, rising, falling)
    return share**2 * (3 - 2 * share)


def sole_contact(place: Array, yaw: Array, size: Array, ground: Terrain) -> Array:
    """Rest (m, 2, 7) of stiff soles at place (m, 2, 2) m with yaw (m, 2) rad, for people of size (m,) m.

    Columns 0 and 1: height under heel and under toe, m. Column 2: tilt to the left, rad.
    Columns 3 and 4: rear and front support, from the ankle forward, shares of size.
    Columns 5 and 6: rotation about the rear support until the heel touches, about the front support until the toe touches, rad.
    The sole touches the ground on both sides of its middle, or at its middle alone. No ground penetrates it, up to the steepest slope.
    """
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    left = np.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    sides = np.array([1.0, 0.0, -1.0]) * HALF_SOLE
    offset = _SOLE_POINTS[:, None, None] * forward[..., None, None, :] + sides[:, None] * left[..., None, None, :]
    points = place[..., None, None, :] + offset * size[:, None, None, None, None]
    height = ground.height_at(points.reshape(-1, 2)).reshape(points.shape[:-1]) / size[:, None, None, None]
    lean = np.clip((height[..., 0] - height[..., 2]).mean(axis=-1) / (2 * HALF_SOLE), -_STEEPEST_SLOPE / 2, _STEEPEST_SLOPE / 2)
    under = (height - lean[..., None, None] * sides).max(axis=-1)
    half = len(_SOLE_POINTS) // 2
    along = _SOLE_POINTS - _SOLE_POINTS[half]
    behind, before = along[:half], along[half + 1 :]
    line = (under[..., :half, None] * before - under[..., None, half + 1 :] * behind[:, None]) / (before - behind[:, None])
    level = np.maximum(under[..., half], line.max(axis=(-1, -2)))[..., None]
    low, high = ((under[..., half + 1 :] - level) / before).max(axis=-1), ((under[..., :half] - level) / behind).min(axis=-1)
    slope = np.clip(
        np.clip((under[..., -1] - under[..., 0]) / (along[-1] - along[0]), low, np.maximum(low, high)), -_STEEPEST_SLOPE, _STEEPEST_SLOPE
    )[..., None]
    level = (under - slope * along).max(axis=-1, keepdims=True)
    gap = level + slope * along - under
    touches = gap * size[:, None, None] < _CONTACT_GAP
    back = np.where(touches, _SOLE_POINTS, np.inf).min(axis=-1)
    front = np.where(touches, _SOLE_POINTS, -np.inf).max(axis=-1)
    far = back[..., None] - _SOLE_POINTS, _SOLE_POINTS - front[..., None]
    up, down = (np.where(away > 0, gap / np.maximum(away, 1e-9), _WALL_SLOPE).min(axis=-1) for away in far)
    lies = slope[..., 0]
    up, down = np.arctan(lies + up) - np.arctan(lies), np.arctan(lies) - np.arctan(lies - down)
    heel, toe = ((level + slope * along[k])[..., 0] * size[:, None] for k in (0, -1))
    return np.stack([heel, toe, np.arctan(lean), back, front, np.minimum(up, _LARGEST_ROLL), np.minimum(down, _LARGEST_ROLL)], axis=-1)


def rotation_matrices(yaw: Array, pitch: Array, roll: Array) -> Array:
    """Rotations (..., 3, 3) by yaw, pitch (positive is nose down) and roll about the rotated axes, rad."""
    cy, sy, cp, sp, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


def _forward(heading: Array) -> Array:
    return np.stack([np.cos(heading), np.sin(heading)], axis=1)


def _roll_angles(footing: Footing, place: Array, position: Array, heading: Array, size: Array) -> Array:
    """(m, 2) rad: above 0 with the toes down (the foot is behind the body), below 0 with the toes up (the foot is ahead)."""

    def of(foot_poses: Array) -> Array:
        return _roll_angle(np.einsum("mfi,mi->mf", position[:, None] - foot_poses, _forward(heading)) / size[:, None])

    share = footing.swing**2 * (3 - 2 * footing.swing)
    return np.where(footing.standing, of(footing.planted), (1 - share) * of(footing.lifted) + share * of(place))


def _roll_angle(ahead: Array) -> Array:
    """Roll angle, rad, of a foot that the body is `ahead` of by that share of size."""
    down, up = np.clip((ahead - 0.09) / 0.22, 0.0, 1.0), np.clip((-ahead - 0.08) / 0.10, 0.0, 1.0)
    return 0.95 * down**1.5 - 0.33 * up
