"""Shoes on the ground: how a stiff sole rests on uneven terrain, rolls over heel and toes, and swings from footfall to footfall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.pedestrian import gait
from sim.pedestrian.gait import Footing, Terrain
from tracker.geometry import Array

HEEL, PIVOT, ANKLE = 0.040, 0.095, 0.039
"""Shares of stature: from the ankle back to the heel, forward to where the shoe rolls off, down to the sole (the foot is 0.152 long)."""
HALF_SOLE = 0.024
"""Half the width of the sole, a share of stature."""
_SOLE_POINTS = np.linspace(-HEEL, PIVOT, 9)
"""Where the ground under a sole is felt, from the ankle forward; the body's weight is over the middle one."""
_STEEPEST_SLOPE = 0.7
"""Tangent of the steepest that a foot stands, to the front or to a side by half of it."""
_LARGEST_ROLL = 1.5
"""rad: more than any foot rolls."""
_WALL_SLOPE = 50.0
"""Tangent of a slope as steep as a wall."""
_CONTACT_GAP = 0.005
"""m: what is nearer to the sole than this carries it."""
_LARGEST_HEEL_RISE = 1.2
"""rad that a heel rises at most before the toes leave the ground."""
_HEEL_RELEASE_START, _HEEL_RELEASE_END, _HEEL_RELEASE_SWING = 0.78, 0.95, 0.6
"""Shares of a stride since a foot left the ground at which its heel begins to be free to rise, and is; share of the next swing that ends it."""


@dataclass(frozen=True, eq=False)
class Feet:
    """ankle (m, 2, 3) m and rotation (m, 2, 3, 3) of the shoes, world frame; left is 0, right is 1.

    toe (m, 2, 3) m: what they roll over in front, and by how much more they can, further (m, 2) rad. landing (m, 2, 3) m: where the ankle is
    once the foot stands, seen from the hip as it will be then: the body's way until then is taken off.
    """

    ankle: Array
    rotation: Array
    toe: Array
    remaining_roll: Array
    landing: Array

    def rolled(self, angle: Array) -> Feet:
        """The feet with the heels higher, rolled over the toes by angle (m, 2) rad more."""
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        x, y, z = np.moveaxis(self.rotation, -1, 0)
        arm = self.ankle - self.toe
        across = np.einsum("...i,...i->...", arm, y)[..., None] * y
        ankle = self.toe + across + c * (arm - across) + s * np.cross(y, arm)
        return replace(self, ankle=ankle, rotation=np.stack([c * x - s * z, y, c * z + s * x], axis=-1), remaining_roll=self.remaining_roll - angle)


def foot_poses(size: Array, footing: Footing, position: Array, heading: Array, ground: Terrain) -> Feet:
    """The shoes of m people of size (m,) m, over position (m, 2) m, on the ground or in the air between two footfalls.

    They roll over the heel when they land and over the toes when they leave.
    """
    place, yaw = gait.foot_positions(footing)
    here, landing, leaving = (
        sole_contact(p, y, size, ground) for p, y in ((place, yaw), (footing.planted, footing.planted_yaw), (footing.lifted, footing.lifted_yaw))
    )
    share = (footing.swing**2 * (3 - 2 * footing.swing))[..., None]
    moving = ~footing.standing[..., None]
    # On the ground, or on the line between footfalls, but never below the ground.
    sole = np.where(moving, leaving + share * (landing - leaving), here)
    arc = gait.foot_lift(footing, size)[..., None]
    sink = np.maximum((here - sole)[..., :2].max(axis=-1, keepdims=True) + 0.3 * arc, 0.0) * moving
    sole = sole + np.maximum(arc, np.minimum(sink, 0.5)) * np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    behind = _roll_angles(footing, place, position, heading, size)
    rolls = np.clip(behind, -sole[..., 5], sole[..., 6])
    ankle, rotation, toe = _ankle_poses(place, yaw, sole, rolls, size)
    drop = _gap_below(ankle, rotation, footing.standing, size, ground)
    ankle[..., 2], toe[..., 2] = ankle[..., 2] - drop, toe[..., 2] - drop
    # A heel rises when the body has gone on over the toes, not when the foot is in front of it.
    over = np.einsum("mfi,mfi->mf", position[:, None] - place, np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)) / size[:, None]
    remaining_roll = _heel_freedom(footing) * np.clip(0.5 + 5 * over, 0.0, 1.0) * np.maximum(np.minimum(_LARGEST_HEEL_RISE, sole[..., 6]) - rolls, 0.0)
    return Feet(ankle, rotation, toe, remaining_roll, _landing(footing, landing, position, heading, size))


def _gap_below(ankle: Array, rotation: Array, standing: NDArray[np.bool_], size: Array, ground: Terrain) -> Array:
    """(m, 2) m between the soles of feet that stand and the ground, where that is least: not quite nothing at an edge, since a steep sole is shorter
    seen from above than the one whose rest was found; nothing for feet in the air."""
    sole = np.stack([*np.meshgrid(_SOLE_POINTS, np.array([-1.0, 0.0, 1.0]) * HALF_SOLE), np.full((3, len(_SOLE_POINTS)), -ANKLE)], axis=-1).reshape(-1, 3)
    scale = np.broadcast_to(size[:, None], standing.shape)[standing]
    points = ankle[standing][:, None] + np.einsum("kij,pj->kpi", rotation[standing], sole) * scale[:, None, None]
    gap = (points[..., 2] - ground.height_at(points[..., :2].reshape(-1, 2)).reshape(points.shape[:-1])).min(axis=1, initial=np.inf)
    out = np.zeros(standing.shape)
    out[standing] = np.maximum(gap, 0.0)
    return out


def _ankle_poses(place: Array, yaw: Array, sole: Array, rolls: Array, size: Array) -> tuple[Array, Array, Array]:
    """Ankles (m, 2, 3) m, rotations (m, 2, 3, 3) and front pivots (m, 2, 3) m of shoes at place (m, 2, 2) m that lie as sole (m, 2, 7) has it and
    have rolled by rolls (m, 2) rad over toes or heel."""
    slope = -np.arctan2(sole[..., 1] - sole[..., 0], (HEEL + PIVOT) * size[:, None])
    forward = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    heel = np.concatenate([place, sole[..., :1]], axis=-1) - forward * (HEEL * size)[:, None, None]
    flat, turned = rotation_matrices(yaw, slope, sole[..., 2]), rotation_matrices(yaw, slope + rolls, sole[..., 2])
    over = np.where(rolls > 0, sole[..., 4], sole[..., 3])[..., None]
    pivot = heel + flat[..., 0] * (over + HEEL) * size[:, None, None]
    toe = heel + flat[..., 0] * (sole[..., 4, None] + HEEL) * size[:, None, None]
    return pivot + (turned[..., 2] * ANKLE - turned[..., 0] * over) * size[:, None, None], turned, toe


def _landing(footing: Footing, sole: Array, position: Array, heading: Array, size: Array) -> Array:
    """Feet.landing of feet that will lie as sole (m, 2, 7) has it."""
    way = gait.displacement_to_landing(footing, position, heading, size)
    ahead = np.einsum("mfi,mi->mf", position[:, None] + way - footing.planted, _forward(heading)) / size[:, None]
    rolls = np.clip(_roll_angle(ahead), -sole[..., 5], sole[..., 6])
    ankle, _, _ = _ankle_poses(footing.planted, footing.planted_yaw, sole, rolls, size)
    return ankle - np.concatenate([way, np.zeros_like(way[..., :1])], axis=-1)


def _heel_freedom(footing: Footing) -> Array:
    """(m, 2) in [0, 1]: how free a heel is to rise, as much as the leg needs: wholly when the other foot carries the body."""
    rising = np.clip((footing.foot_phase - _HEEL_RELEASE_START) / (_HEEL_RELEASE_END - _HEEL_RELEASE_START), 0.0, 1.0)
    falling = np.clip(1 - footing.swing / _HEEL_RELEASE_SWING, 0.0, 1.0)
    share = np.where(footing.standing, rising, falling)
    return share**2 * (3 - 2 * share)


def sole_contact(place: Array, yaw: Array, size: Array, ground: Terrain) -> Array:
    """(m, 2, 7): how a stiff sole rests where feet (m, 2, 2) m stand: its height m under heel and toe, its tilt to the left rad, how far before the
    ankle it is carried behind and in front, shares of size, and by how much it can roll over these before heel or toe hit the ground, rad.

    It touches the ground before and behind the middle of the foot, or only there, and nothing sticks into it, as long as that is not too steep.
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
    slope = np.clip(np.clip((under[..., -1] - under[..., 0]) / (along[-1] - along[0]), low, np.maximum(low, high)), -_STEEPEST_SLOPE, _STEEPEST_SLOPE)[..., None]
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
    """Rotations (..., 3, 3) by yaw, then pitch (positive is nose down), then roll about the turned axes, rad."""
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
    """(m, 2) rad by which the toes are down (the body has left the foot behind) or up (the foot is ahead)."""

    def of(foot_poses: Array) -> Array:
        return _roll_angle(np.einsum("mfi,mi->mf", position[:, None] - foot_poses, _forward(heading)) / size[:, None])

    share = footing.swing**2 * (3 - 2 * footing.swing)
    return np.where(footing.standing, of(footing.planted), (1 - share) * of(footing.lifted) + share * of(place))


def _roll_angle(ahead: Array) -> Array:
    """rad by which a foot has rolled that the body is `ahead` of, a share of size."""
    down, up = np.clip((ahead - 0.09) / 0.22, 0.0, 1.0), np.clip((-ahead - 0.08) / 0.10, 0.0, 1.0)
    return 0.95 * down**1.5 - 0.33 * up
