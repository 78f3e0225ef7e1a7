"""Projection of detections to the ground: ground points of feet, their covariances, and whether the feet may be hidden.

The lower edge of a box is at the feet only if the feet are visible. They are likely hidden where a nearer box or the image's edge covers the lower
edge, or where the detector says so. Where terrain and objects are known, range_likelihood.py gives the likelihood of each
distance of the person. A box is ambiguous where several distances are possible.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tracker.detections.range_likelihood import BoxEdges, RangeLikelihood, Statures, infer_ranges
from tracker.geometry import Array, Mask, Pose, angles_from_bearing, bearing_from_angles, skew, tangent_basis, wrap
from tracker.types import Detections, Mount, Setup

EDGE = np.linspace(-0.9, 0.9, 9)
"""Sample points of a box's lower edge, from its middle, in half widths."""

BELOW, COVERED = 0.012, 0.3
"""rad below the lower edge of a box down to which a nearer box may hide the feet. It does where such boxes cover this share of the edge."""

FEET_HIDDEN = np.array([0.03, 0.6, 0.6])
"""Probability that a box ends above the feet: free, behind people, at the image's edge."""

FEET_HIDDEN_KNOWN = np.array([0.05, 0.15])
"""The same in a known world, for causes other than known objects: free, behind people."""

AMBIGUOUS_FEET, AMBIGUOUS_RANGE = 0.01, 1.5
"""Probability of hidden feet, or ratio of range errors, above which a box is ambiguous."""


@dataclass(frozen=True)
class FusionParameters:
    """Assumptions on boxes and feet, and thresholds of cross-view association."""

    foot_spread: float = 0.25  # m, standard deviation of the lowest point of a walking body from the ground under its middle
    ahead: float = 0.03  # m, from the nearest point of the soles, where a box ends, to the point under the body
    reach: float = 60.0  # m, greatest distance of a ground point; `over` raises it where the area is farther from a fixed camera
    stature: float = 1.72  # m, mean of people
    stature_sigma: float = 0.12  # m, standard deviation of people
    gate: float = 3.5  # standard deviations between two ground points of one person

    @property
    def statures(self) -> Statures:
        """Mean and standard deviation, m."""
        return Statures(self.stature, self.stature_sigma)

    def over(self, setup: Setup) -> FusionParameters:
        """These parameters with a reach that covers the whole area, horizontally, from each fixed camera."""
        if setup.area is None:
            return self
        farthest = np.abs(setup.fixed_places[:, None] - setup.area).max(axis=1)
        return replace(self, reach=float(np.linalg.norm(farthest, axis=1).max(initial=self.reach)))


@dataclass(frozen=True, eq=False)
class GroundDetections:
    """The n boxes of a view on the ground, by their feet.

    origin (3,) m and direction (n, 3): line of sight to the feet; covariance (n, 2, 2) rad² in its tangent plane, the robot's pose included.
    point (n, 3) m and spread (n, 2, 2) m²: where it meets the ground, and the covariance there. height (n,) m: of a box standing there.
    head_elevation (n,) rad: elevation of the upper edge. grounded (n,): there is a point within the reach. confidence (n,).
    occludable (n,): something may occlude the feet; cut (n,): the lower edge is at the image's edge.
    feet_hidden (n,): probability that the box ends above the feet.
    ambiguous (n,): `ranges` (None where no box is ambiguous) allows several distances; point and spread then cover all of them, and height
    is the mean stature.
    known: whether terrain and objects are known, so that upper edges measure statures.
    later: s by which the view is later than its tick.
    links: log-likelihood ratios with the boxes of the last frames (optical_flow.KltTracklets.step), None where images are not used.
    appearance (n, d): unit vectors, NaN where unknown, or None. appearance_given: whether the detector gave them, else see front_end.appearances.
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
    occludable: Mask
    cut: Mask
    feet_hidden: Array
    confidence: Array
    ambiguous: Mask
    ranges: RangeLikelihood | None = None
    known: bool = False
    later: float = 0.0
    links: tuple[Array, ...] | None = None
    appearance: Array | None = None
    appearance_given: bool = False

    def __len__(self) -> int:
        return len(self.direction)

    def select(self, rows: Mask) -> GroundDetections:
        """The boxes in `rows` (n,), without links and appearance."""
        whole = ("camera", "origin", "ranges", "known", "later", "links", "appearance", "appearance_given")
        columns = {name: getattr(self, name)[rows] for name in GroundDetections.__dataclass_fields__ if name not in whole}
        ranges = None if self.ranges is None else self.ranges.select(rows)
        return GroundDetections(self.camera, self.origin, **columns, known=self.known, later=self.later, ranges=ranges)


def project_to_ground(setup: Setup, camera: str, detections: Detections, pose: tuple[Pose, Array], parameters: FusionParameters) -> GroundDetections:
    """Project the boxes of `camera` to the ground; pose: T_world_robot and the covariance (6, 6) of its right tangent."""
    mount = setup.mounts[camera]
    T_world_camera = pose[0] @ mount.T_body_camera
    # Boxes are upright in the frame of the camera, which may be tilted.
    across, up = angles_from_bearing(detections.bearing)
    half = detections.extent[:, 1] / 2
    foot, head = (bearing_from_angles(across, up + side * half) @ T_world_camera.rotation.T for side in (-1, 1))
    azimuth, low = angles_from_bearing(foot)
    high = angles_from_bearing(head)[1]
    origin = T_world_camera.translation
    origins = np.broadcast_to(origin, foot.shape)
    point, grounded = setup.ground.intersect(origins, foot, parameters.reach)
    point, foot = _under_body(setup, origin, point, (foot, grounded), parameters.ahead)
    distance = np.hypot(*(point - origin)[:, :2].T)
    height = origin[2] - point[:, 2] + distance * np.tan(high)
    covariance = detections.covariance + _pose_covariance(foot, np.where(grounded, np.linalg.norm(point - origin, axis=1), 10.0), mount, pose)
    spread = _ground_covariance(foot, point - origin, covariance) + parameters.foot_spread**2 * np.eye(2)
    near, covered = _nearer_boxes(up - half, across, detections)
    if detections.feet_seen is not None:
        near, covered = near | ~detections.feet_seen, covered | ~detections.feet_seen
    cut = ~mount.camera.pixels_from_bearings(bearing_from_angles(across, up - half - BELOW))[1]
    feet_hidden = FEET_HIDDEN[np.where(cut, 2, covered + 0)]
    feet = GroundDetections(
        camera, origin, foot, covariance, point, spread, height, high, grounded, near | cut, cut, feet_hidden, detections.confidence,
        ambiguous=np.zeros(len(foot), dtype=bool),
    )  # fmt: skip
    if not len(feet):
        return feet
    no_border = np.full(len(foot), -np.pi / 2)
    edges = BoxEdges(azimuth, detections.extent[:, 0] / 2, low, high, covariance[:, 1, 1], feet_hidden, no_border)
    if setup.occluders is None:
        return _with_hidden_feet(feet, setup, edges, covered | cut, parameters)
    # Feet that the detector reports as hidden are hidden whatever the map shows.
    told = np.zeros(len(feet), dtype=bool) if detections.feet_seen is None else ~detections.feet_seen
    edges = edges._replace(feet_hidden=np.where(told, FEET_HIDDEN[1], FEET_HIDDEN_KNOWN[covered + 0]), border=np.where(cut, low, no_border))
    ranges = infer_ranges((setup.ground, setup.occluders), origin, edges, parameters.ahead, parameters.statures)
    return _with_ranges(feet, setup, ranges, edges, parameters)


def _with_hidden_feet(feet: GroundDetections, setup: Setup, edges: BoxEdges, rows: Mask, parameters: FusionParameters) -> GroundDetections:
    """The detections with those in `rows` (n,) ambiguous: their distance follows from the visible edges and usual statures."""
    if not rows.any():
        return feet
    some = BoxEdges._make(column[rows] for column in edges)
    ranges = infer_ranges((setup.ground, setup.ground), feet.origin, some, parameters.ahead, parameters.statures).spread_to(rows)
    return _ambiguous(feet, setup, ranges, (edges.azimuth, ranges.possible), parameters)


def _under_body(setup: Setup, origin: Array, soles: Array, rays: tuple[Array, Mask], ahead: float) -> tuple[Array, Array]:
    """Points (n, 3) m on the ground `ahead` m beyond the soles, and the directions (n, 3) to them.

    rays: directions to the soles, and which of them meet the ground; the others stay unchanged.
    """
    direction, grounded = rays
    horizontal = direction[:, :2] / np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-9)[:, None]
    point = np.column_stack([soles[:, :2] + ahead * horizontal, np.zeros(len(soles))])
    point[:, 2] = setup.ground.height_at(point)
    toward = point - origin
    toward /= np.maximum(np.linalg.norm(toward, axis=1), 1e-9)[:, None]
    return np.where(grounded[:, None], point, soles), np.where(grounded[:, None], toward, direction)


def _with_ranges(feet: GroundDetections, setup: Setup, ranges: RangeLikelihood, edges: BoxEdges, parameters: FusionParameters) -> GroundDetections:
    """The detections in a known world, with the ambiguous ones marked."""
    along = np.stack([np.cos(edges.azimuth), np.sin(edges.azimuth)], axis=1)
    sigma = np.sqrt(np.einsum("ni,nij,nj->n", along, feet.spread, along))
    uncertain = (ranges.feet_hidden > AMBIGUOUS_FEET) | (ranges.sigma > AMBIGUOUS_RANGE * sigma) | ~feet.grounded
    return replace(_ambiguous(feet, setup, ranges, (edges.azimuth, ranges.possible & uncertain), parameters), known=True)


def _ambiguous(
    feet: GroundDetections, setup: Setup, ranges: RangeLikelihood, of: tuple[Array, Mask], parameters: FusionParameters
) -> GroundDetections:
    """The detections with the ambiguous ones placed at the mean of their `ranges`; of: azimuths (n,) rad, and which (n,) are ambiguous."""
    azimuth, ambiguous = of
    along = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    place = feet.origin[:2] + ranges.mean[:, None] * along
    place = np.column_stack([place, setup.ground.height_at(place)])
    cross_range = feet.covariance[:, 0, 0] * ranges.mean**2 + parameters.foot_spread**2
    spread = _axis_covariances(along, ranges.sigma**2) + _axis_covariances(across, cross_range)
    return replace(
        feet,
        point=np.where(ambiguous[:, None], place, feet.point),
        spread=np.where(ambiguous[:, None, None], spread, feet.spread),
        height=np.where(ambiguous, parameters.stature, feet.height),
        grounded=feet.grounded | ambiguous,
        occludable=feet.occludable | (ambiguous & (ranges.feet_hidden > 0.5)),
        feet_hidden=np.where(ambiguous, FEET_HIDDEN_KNOWN[0], feet.feet_hidden),
        ambiguous=ambiguous,
        ranges=ranges,
    )


def _axis_covariances(axis: Array, variance: Array) -> Array:
    """Covariances (n, 2, 2) m² with a variance (n,) m² along unit vectors (n, 2) and 0 across."""
    return np.asarray(variance[:, None, None] * axis[:, :, None] * axis[:, None, :])


def _pose_covariance(foot: Array, distance: Array, mount: Mount, pose: tuple[Pose, Array]) -> Array:
    """Covariance (n, 2, 2) rad² in the tangent plane of `foot` (n, 3) due to the robot's pose; distance (n,) m to the feet."""
    T_world_robot, P = pose
    if not P.any():
        return np.zeros((len(foot), 2, 2))
    R = T_world_robot.rotation
    lever = R @ mount.T_body_camera.translation
    basis = tangent_basis(foot)
    # A point p seen from o: d(direction) = across · (dp − do)/r; a rotation of the robot moves o about the body's origin and turns the direction.
    turn = distance[:, None, None] * skew(foot) + skew(np.broadcast_to(lever, foot.shape))
    J = np.concatenate([np.broadcast_to(-np.eye(3), (len(foot), 3, 3)) @ R, turn @ R], axis=2) / distance[:, None, None]
    J = basis @ J
    return J @ P @ J.transpose(0, 2, 1)


def _ground_covariance(foot: Array, rays: Array, covariance: Array) -> Array:
    """Covariance (n, 2, 2) m² of x, y where lines of sight (n, 3) m meet level ground, by that in the tangent plane; bounded at grazing angles."""
    distance = np.maximum(np.linalg.norm(rays, axis=1), 0.1)
    sink = np.maximum(-foot[:, 2], 0.01)
    along = foot[:, :2] / np.maximum(np.hypot(foot[:, 0], foot[:, 1]), 1e-9)[:, None]
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    J = np.stack([left * distance[:, None], along * (distance / sink)[:, None]], axis=2)
    return J @ covariance @ J.transpose(0, 2, 1)


def _nearer_boxes(low: Array, azimuth: Array, detections: Detections) -> tuple[Mask, Mask]:
    """Which boxes (n,) have a nearer box, which ends lower, close to their lower edge; and whose lower edge such boxes cover by COVERED or more."""
    half, high = detections.extent[:, 0] / 2, low + detections.extent[:, 1]
    apart = wrap(azimuth[:, None] - azimuth[None, :])
    nearer = (low[None, :] < low[:, None] - 1e-3) & (high[None, :] > low[:, None] - BELOW)
    beside = np.abs(apart) < 0.7 * half[:, None] + half[None, :]
    along = np.array([(nearer & (np.abs(apart + u * half[:, None]) < half[None, :])).any(axis=1) for u in EDGE])
    return (nearer & beside).any(axis=1), np.asarray(along.mean(axis=0) >= COVERED)
