"""From boxes to feet on the ground, and from views to places.

A box says where the feet are only if the feet are in it. Where terrain and things are known, `stand` asks them at which distances the box could be
of somebody (tracker/standpoints.py), and marks as vague those that leave more than one place; nearer boxes over its lower edge, and the
edge of the image, make it likelier that it ends above the feet.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tracker.detections.range_likelihood import Edges, RangeLikelihood, StandpointParameters, standpoints
from tracker.geometry import Array, Mask, Pose, angles_from_bearing, bearing_from_angles, skew, tangent_basis, wrap
from tracker.types import Detections, Mount, Setup

EDGE = np.linspace(-0.9, 0.9, 9)
"""Places along a box's lower edge, from its middle in half widths, at which is looked for what lies over it."""


@dataclass(frozen=True)
class FusionParameters:
    """What is assumed of boxes and feet."""

    foot_spread: float = 0.25  # m, the lowest point of a walking body strays this far from the ground under its middle
    ahead: float = 0.06  # m, a box ends at the nearest point of the soles, so far before the ground under the body
    reach: float = 60.0  # m, feet farther away are not believed
    edge: float = 0.012  # rad, what begins this near under the lower edge may hide the feet
    covered: float = 0.3  # share of a lower edge that nearer boxes lie over, from which these may hide the feet
    lying: tuple[float, float, float] = (0.03, 0.6, 0.6)  # how often boxes end above the feet: nothing, people, the image's edge before them ...
    lying_known: tuple[float, float] = (0.05, 0.15)  # ... and where the world is known, for no reason or as people stand before them
    doubtful: float = 0.3  # boxes that end above the feet more often start nobody ...
    near: float = 0.5  # m, and those with something before them only where the place is so sure (standard deviation)
    standpoints: StandpointParameters = field(default_factory=StandpointParameters)
    vague: tuple[float, float] = (0.01, 1.5)  # chance of hidden feet, or share by which a place is less sure than feet, from which a box is vague
    somewhere: float = 4.0  # m, vague boxes start somebody where the place is so sure (standard deviation)
    gate: float = 3.5  # standard deviations between two feet of one person


@dataclass(frozen=True, eq=False)
class GroundDetections:
    """The boxes of one view in the world.

    origin (3,) m and direction (n, 3): line of sight to the feet; covariance (n, 2, 2) rad² in its tangent plane, pose included.
    point (n, 3) m and spread (n, 2, 2) m²: where it meets the ground, and how surely. height (n,) m of the box standing there.
    head_elevation (n,) rad above the horizon of the box's upper edge. grounded (n,): there is a point and it is near enough.
    hidden (n,): the feet may be out of sight, cut (n,): beyond the image's edge; lying (n,): how often such a box ends above the feet.
    vague (n,): there is more than one place for the feet, as `lines` says (None where the world is not known); point and spread are the mean and
    covariance of all of them then, and height is the usual one. confidence (n,).
    links: what images say of the boxes of the last frames and these (tracklets.Tracklets.step); appearance (n, d): what boxes look like in them
    (appearance.appearances); None where they are not looked at.
    """

    camera: str
    origin: Array
    direction: Array
    covariance: Array
    point: Array
    spread: Array
    height: Array
    head_elevation: Array
    grounded: Mask
    hidden: Mask
    cut: Mask
    lying: Array
    confidence: Array
    vague: Mask
    lines: RangeLikelihood | None = None
    links: tuple[Array, ...] | None = None
    appearance: Array | None = None

    def __len__(self) -> int:
        return len(self.direction)

    def select(self, rows: Mask) -> GroundDetections:
        """The boxes in `rows` (n,), without what images say of them."""
        whole = ("camera", "origin", "lines", "links", "appearance")
        columns = {name: getattr(self, name)[rows] for name in GroundDetections.__dataclass_fields__ if name not in whole}
        return GroundDetections(self.camera, self.origin, **columns, lines=None if self.lines is None else self.lines.select(rows))


def project_to_ground(setup: Setup, camera: str, detections: Detections, pose: tuple[Pose, Array], parameters: FusionParameters) -> GroundDetections:
    """Bring the boxes of `camera` on a robot at `pose` (T_world_robot, covariance (6, 6) of its right tangent) to the ground."""
    mount = setup.mounts[camera]
    T_world_camera = pose[0] @ mount.T_body_camera
    middle = detections.bearing @ T_world_camera.rotation.T
    azimuth, elevation = angles_from_bearing(middle)
    half = detections.extent[:, 1] / 2
    foot, head = bearing_from_angles(azimuth, elevation - half), bearing_from_angles(azimuth, elevation + half)
    origin = T_world_camera.translation
    origins = np.broadcast_to(origin, foot.shape)
    point, grounded = setup.ground.intersect(origins, foot, parameters.reach)
    point, foot = _under_body(setup, origin, point, (foot, grounded), parameters.ahead)
    distance = np.hypot(*(point - origin)[:, :2].T)
    height = origin[2] - point[:, 2] + distance * np.tan(angles_from_bearing(head)[1])
    covariance = detections.covariance + _pose_in_sight(foot, np.where(grounded, np.linalg.norm(point - origin, axis=1), 10.0), mount, pose)
    spread = _spread_on_ground(foot, point - origin, covariance) + parameters.foot_spread**2 * np.eye(2)
    lowered = bearing_from_angles(azimuth, elevation - half - parameters.edge)
    people, covered = _behind_people(elevation - half, azimuth, detections, parameters)
    cut = ~mount.camera.pixels_from_bearings(lowered @ T_world_camera.rotation)[1]
    lying = np.array(parameters.lying)[np.where(cut, 2, covered + 0)]
    known = np.zeros(len(foot), dtype=bool)
    feet = GroundDetections(
        camera, origin, foot, covariance, point, spread, height, elevation + half, grounded, people | cut, cut, lying, detections.confidence, known
    )
    if setup.occluders is None or not len(feet):
        return feet
    lying = np.array(parameters.lying_known)[covered + 0]
    edges = Edges(azimuth, detections.extent[:, 0] / 2, elevation - half, elevation + half, covariance[:, 1, 1], lying)
    lines = standpoints((setup.ground, setup.occluders), origin, edges, parameters.ahead, parameters.standpoints)
    return _in_the_world(feet, setup, lines, azimuth, parameters)


def _under_body(setup: Setup, origin: Array, soles: Array, sight: tuple[Array, Mask], ahead: float) -> tuple[Array, Array]:
    """Points (n, 3) m on the ground `ahead` m farther from `origin` than where soles end, and lines of sight to them; sight: those to the soles, and
    which of them meet the ground: the others stay as they are.
    """
    direction, grounded = sight
    over = direction[:, :2] / np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-9)[:, None]
    point = np.column_stack([soles[:, :2] + ahead * over, np.zeros(len(soles))])
    point[:, 2] = setup.ground.height_at(point)
    toward = point - origin
    toward /= np.maximum(np.linalg.norm(toward, axis=1), 1e-9)[:, None]
    return np.where(grounded[:, None], point, soles), np.where(grounded[:, None], toward, direction)


def _in_the_world(feet: GroundDetections, setup: Setup, lines: RangeLikelihood, azimuth: Array, parameters: FusionParameters) -> GroundDetections:
    """`feet` with those marked and moved that are vague by `lines`."""
    least, share = parameters.vague
    along = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    sure = np.sqrt(np.einsum("ni,nij,nj->n", along, feet.spread, along))
    vague = lines.possible & ~feet.cut & ((lines.hidden > least) | (lines.sigma > share * sure) | ~feet.grounded)
    place = feet.origin[:2] + lines.mean[:, None] * along
    place = np.column_stack([place, setup.ground.height_at(place)])
    beside = feet.covariance[:, 0, 0] * lines.mean**2 + parameters.foot_spread**2
    spread = _ellipses(along, lines.sigma**2) + _ellipses(across, beside)
    return replace(
        feet,
        point=np.where(vague[:, None], place, feet.point),
        spread=np.where(vague[:, None, None], spread, feet.spread),
        height=np.where(vague, parameters.standpoints.stature, feet.height),
        grounded=feet.grounded | vague,
        hidden=feet.hidden | (vague & (lines.hidden > 0.5)),
        lying=np.where(vague, parameters.lying_known[0], feet.lying),
        vague=vague,
        lines=lines,
    )


def _ellipses(axis: Array, variance: Array) -> Array:
    """Covariances (n, 2, 2) m² with a variance (n,) m² along unit vectors (n, 2) and none across."""
    return np.asarray(variance[:, None, None] * axis[:, :, None] * axis[:, None, :])


def _pose_in_sight(foot: Array, distance: Array, mount: Mount, pose: tuple[Pose, Array]) -> Array:
    """Covariance (n, 2, 2) rad² in the tangent plane of `foot` that comes from the robot's pose; distance (n,) m to the feet."""
    T_world_robot, P = pose
    if not P.any():
        return np.zeros((len(foot), 2, 2))
    R = T_world_robot.rotation
    lever = R @ mount.T_body_camera.translation
    basis = tangent_basis(foot)
    # A point p seen from o: d(direction) = across · (dp − do)/r; the robot's turn moves o about the body's origin and turns the sight.
    turn = distance[:, None, None] * skew(foot) + skew(np.broadcast_to(lever, foot.shape))
    J = np.concatenate([np.broadcast_to(-np.eye(3), (len(foot), 3, 3)) @ R, turn @ R], axis=2) / distance[:, None, None]
    J = basis @ J
    return J @ P @ J.transpose(0, 2, 1)


def _spread_on_ground(foot: Array, sight: Array, covariance: Array) -> Array:
    """Tangent covariance → covariance (n, 2, 2) m² of x, y where the sight meets a level ground; bounded at grazing angles."""
    distance = np.maximum(np.linalg.norm(sight, axis=1), 0.1)
    sink = np.maximum(-foot[:, 2], 0.01)
    along = foot[:, :2] / np.maximum(np.hypot(foot[:, 0], foot[:, 1]), 1e-9)[:, None]
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    J = np.stack([left * distance[:, None], along * (distance / sink)[:, None]], axis=2)
    return J @ covariance @ J.transpose(0, 2, 1)


def _behind_people(low: Array, azimuth: Array, detections: Detections, parameters: FusionParameters) -> tuple[Mask, Mask]:
    """Whether a nearer box (one that reaches lower) lies over a part of the lower edge of each box, and over so much that it may hide the feet."""
    half, high = detections.extent[:, 0] / 2, low + detections.extent[:, 1]
    apart = wrap(azimuth[:, None] - azimuth[None, :])
    nearer = (low[None, :] < low[:, None] - 1e-3) & (high[None, :] > low[:, None] - parameters.edge)
    beside = np.abs(apart) < 0.7 * half[:, None] + half[None, :]
    along = np.array([(nearer & (np.abs(apart + u * half[:, None]) < half[None, :])).any(axis=1) for u in EDGE])
    return (nearer & beside).any(axis=1), np.asarray(along.mean(axis=0) >= parameters.covered)
