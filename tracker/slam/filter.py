"""Multi-robot EKF-SLAM in SE(3) from panoramas: one joint covariance of the team and its map.

A tick: prediction by odometry, levelling by gravity, then for each robot data association, update and landmark initialization.
The state holds a correction factor per robot, and an update has a fixed number of linearisations.
A robot without odometry is predicted by its motion between the last two ticks (constant velocity with white acceleration noise). Bearings alone do
not determine the scale of its map, which is then that of the velocity assumed at the start.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from tracker.ekf.linearization import LandmarkMeasurement, RobotMeasurements, linearize
from tracker.ekf.odometry_biases import bias_scale
from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices, Mask, Pose, angles_from_bearing
from tracker.geometry.cameras import Panorama
from tracker.slam.data_association import Matches, associate, identify, on_robots, within_gate
from tracker.slam.image_features import moved_to_frame, turned_to_frame
from tracker.slam.landmark_initialization import LandmarkInitializer
from tracker.slam.landmark_map import LandmarkMap, dissimilarity, spread_over_azimuth, unit_rows
from tracker.slam.parameters import SlamParameters
from tracker.slam.relocalization import RelocalizedPose, Relocalizer, SlamState
from tracker.slam.unknown_start import UnknownStarts
from tracker.types import Intervals, MapSnapshot, Mount, Odometry, Setup, Sightings, Start, Tick, View

ACCELERATION = 1.0
"""m/s² and rad/s²: standard deviation of the accelerations between two ticks."""
AHEAD, SPREAD = 0.3, 0.3
"""m/s: forward velocity at the start, and its standard deviation, m/s and rad/s. A velocity of zero would leave the scale undefined."""
FASTEST = 3.0
"""m/s: a faster motion is a relocalization, after which the start velocity is assumed again."""


class Slam:
    """The online filter. Fixed cameras (those of PETS) stay constants outside the state.

    sighted: camera → the static sightings of the last tick.
    """

    def __init__(self, setup: Setup, parameters: SlamParameters) -> None:
        self.setup, self.parameters = setup, parameters
        correction = parameters.correction_sigma if parameters.correction else None
        self._joint = JointState(parameters.clones, parameters.capacity, correction, parameters.mode, parameters.odometry_biases)
        self._map = LandmarkMap(parameters.capacity, max(1, len(setup.starts)))
        self._team: dict[str, int] = {}
        self._initializers: dict[str, LandmarkInitializer] = {}
        self._cloned: dict[str, int] = {}
        self._odometry: dict[str, Odometry | None] = {}
        self._gravity: dict[str, Odometry] = {}  # robot → odometry whose "up" no update has used yet
        self._counters: Counter[str] = Counter()
        self._unknown_starts = UnknownStarts(setup, parameters, Slam)
        self._odometry_gap: dict[str, tuple[int, Array]] = {}
        self._without_odometry = {name: ConstantVelocity() for name in setup.starts}
        self._relocalizer = Relocalizer(parameters.relocalization)
        self._intervals = Intervals(setup.period), {name: Intervals(setup.period) for name in setup.starts}  # of ticks, and per robot
        self._seconds: dict[str, float] = {}  # robot → s between its last two ticks
        self._frame: dict[str, int] = {}  # robot → its last one
        self.sighted: dict[str, Sightings] = {}
        self._inflation = np.repeat(parameters.inflation_sigma, 3) ** 2
        self._tick = -1

    def step(self, tick: Tick) -> None:
        """Process all views of one tick. Features of images are found before (ImageFeatures.find).

        Raises ValueError for a view of a camera, or of a robot, that the setup does not know.
        """
        self._tick, views = tick.index, dict[str, list[View]]()
        self.sighted.clear()
        for view in tick.views:
            if view.camera not in self.setup.mounts:
                raise ValueError(f"view of camera {view.camera!r}, needs one of {sorted(self.setup.mounts)}")
            if view.robot_detections is not None:
                self.setup.check_robot_detections(view.camera, view.robot_detections)
            views.setdefault(self.setup.mounts[view.camera].robot, []).append(view)
        for name in self.setup.starts:
            self._add_known_start(name, views.get(name, []))
        now = [name for name in self.setup.starts if name in views or (tick.reported and self._frame.get(name) != tick.index)]
        for name in now:
            self._seconds[name], self._frame[name] = self._intervals[1][name].step(tick.time), tick.index
        moved = [name for name in self._team if name in now]
        for name in moved:
            self._predict(name, views.get(name, []))
        passed = self._intervals[0].step(tick.time)
        self._joint.add_correction_noise(self.parameters.correction_walk * np.sqrt(passed))
        if self.parameters.odometry_biases is not None:
            self._joint.decay_biases(self.parameters.odometry_biases.retention(passed))
        for name in moved:
            self._process_views(name, views.get(name, []), tick.index)
        for name, start in self.setup.starts.items():
            if start is None and name not in self._team and _takes_part(views.get(name, []), self.setup):
                self._find_unknown_start(name, replace(tick, views=tuple(views[name])))

    @property
    def state(self) -> SlamState:
        """The joint state and the landmark map; both change with the filter."""
        return self._joint, self._map

    @property
    def team(self) -> Mapping[str, int]:
        """The robots in the joint state, and their numbers there."""
        return MappingProxyType(self._team)

    def is_localized(self, robot: str) -> bool:
        """Whether the robot's pose is known: false only for a robot with an unknown start that has not joined the team yet."""
        return robot in self._team or self.setup.starts[robot] is not None

    @property
    def counters(self) -> dict[str, int]:
        """Counts of events and of rejections, by reason."""
        return dict(sum((f.counters for f in self._initializers.values()), self._counters))

    def pose(self, robot: str) -> Pose:
        """The estimate of T_world_robot. Raises ValueError for a robot whose start is unknown."""
        if robot not in self._team:
            return self._start(robot).T_world_robot
        return Pose(self._joint.rotation[self._team[robot]], self._joint.translation[self._team[robot]])

    def covariance(self, robot: str) -> Array:
        """(6, 6) of the pose's right tangent [m, rad]. Raises ValueError as `pose` does."""
        if robot not in self._team:
            return self._start(robot).covariance
        return self._joint.covariance(self._team[robot])

    def correction(self, robot: str) -> Array:
        """(3,) rad: the correction factor, a rotation vector of the robot's cameras in its body (CameraPose); zero if none is estimated."""
        return self._joint.correction[self._team[robot]].copy() if robot in self._team else np.zeros(3)

    def landmarks(self) -> Array:
        """(n, 3) m in the world."""
        return self._joint.point[: self._joint.count].copy()

    def identities(self) -> Indices:
        """(n,) unique numbers of the landmarks, never reused."""
        return self._map.identity[: self._map.count].copy()

    def map_snapshot(self, tick: int) -> MapSnapshot | None:
        """The map after the tick and the landmarks that each robot has seen at it; None if no robot is in the joint state."""
        if not self._joint.robots:
            return None
        identity, last_seen_by = self._map.identity[: self._map.count], self._map.last_seen_by[: self._map.count]
        sighted = {name: identity[last_seen_by[:, robot] == tick].astype(np.int64) for name, robot in self._team.items()}
        return MapSnapshot(self.identities().astype(np.int64), self.landmarks(), sighted)

    def _start(self, robot: str) -> Start:
        start = self.setup.starts[robot]
        if start is None:
            raise ValueError(f"robot {robot!r} has no start pose, needs one")
        return start

    def _add_known_start(self, name: str, views: list[View]) -> None:
        """Add a robot to the state at its first odometry or sighting."""
        if name not in self._team and self.setup.starts[name] is not None and _takes_part(views, self.setup):
            self._add_to_team(name, self._joint.add_robot(self._start(name)))

    def _find_unknown_start(self, name: str, tick: Tick) -> None:
        """Relocalize a robot whose start is unknown; it joins the team if that succeeds."""
        self._counters["unknown start"] += 1
        found = self._unknown_starts.step(name, tick, self._relocalizer.archive.with_map(self.state))
        self._counters[f"waits: {found}" if isinstance(found, str) else "joined"] += 1
        if isinstance(found, RelocalizedPose):
            self._add_to_team(name, self._joint.add_robot(found.start(self.parameters.relocalization)))
            self._process_views(name, list(tick.views), tick.index)

    def _add_to_team(self, name: str, robot: int) -> None:
        """Register a robot of the joint state, and create the landmark initializers of its cameras."""
        self._team[name] = robot
        for camera, mount in self.setup.mounts.items():
            if mount.robot == name:
                self._initializers[camera] = LandmarkInitializer(
                    robot, mount, (self._joint, self._map), self.setup.ground, self.parameters.initialization
                )

    def _predict(self, name: str, views: list[View]) -> None:
        """Predict by odometry. In a gap the covariance is inflated, because the robot may have stopped or have moved on at its last speed.

        A robot that never had odometry moves at constant velocity.
        """
        odometry = next((v.odometry for v in views if v.odometry is not None), None)
        if odometry is not None:
            stated = odometry.covariance
            odometry, scale = self._with_error_model(name, odometry)
            variance = odometry.covariance if scale is None else stated
        self._odometry[name] = odometry
        self._gravity.pop(name, None)
        if odometry is not None and odometry.gravity is not None:
            self._gravity[name] = odometry
        if odometry is not None:
            self._joint.predict(self._team[name], odometry.T_before_now, odometry.covariance, scale)
            self._odometry_gap[name] = 0, np.square(odometry.T_before_now.log()) + np.diag(variance)
        elif name in self._odometry_gap:
            gap, step = self._odometry_gap[name]
            # The distance grows with time, and its variance with the square of time.
            self._joint.inflate(self._team[name], (2 * gap + 1) * np.repeat([step[:3].sum(), step[3:].sum()], 3))
            self._odometry_gap[name] = gap + 1, step
            self._counters["no odometry"] += 1
        elif (guess := self._without_odometry[name].step(self.pose(name), self._seconds[name])) is not None:
            self._joint.predict(self._team[name], *guess)
            self._counters["constant velocity"] += 1

    def _with_error_model(self, name: str, odometry: Odometry) -> tuple[Odometry, Array | None]:
        """The odometry with its covariance for the prediction, and the map from odometry biases to its tangent, None without biases.

        Biases in the state leave the white part of the errors. Otherwise the variances are inflated for the correlation of the errors in time.
        """
        parameters, period = self.parameters, self._seconds[name]
        level = np.sqrt(_correlation_factor(parameters.gravity_correlation_time, period))
        if parameters.odometry_biases is not None:
            covariance, sigma = parameters.odometry_biases.white_noise(odometry)
            up = (self._joint.rotation[self._team[name]] @ odometry.T_before_now.rotation)[2]
            return replace(odometry, covariance=covariance, gravity_sigma=sigma * level), bias_scale(odometry.covariance, up, period)
        scale = np.repeat([1.0, np.sqrt(_correlation_factor(parameters.rotation_correlation_time, period))], 3)
        return replace(odometry, covariance=odometry.covariance * np.outer(scale, scale), gravity_sigma=odometry.gravity_sigma * level), None

    def _process_views(self, name: str, views: list[View], tick: int) -> None:
        """All views of one robot at one tick: update, prune landmarks, initialize new ones."""
        rest = []
        for view in views:
            seen = self._sightings(name, view)
            if seen is not None:
                clones = self.parameters.initialization.min_clones if view.sightings is None else 1
                rest.append((self._initializers[view.camera], seen, clones, self._update(name, view, seen, tick)))
            elif view.robot_detections:
                self._measurement_update(name, None, view)
        if not rest:
            self._measurement_update(name, None)
        for landmark in self._map.to_prune(self.parameters.pruning)[::-1]:
            self._remove_landmark(int(landmark), "lost")
        if self._relocalizer.is_lost(name):
            return
        for initializer, seen, clones, (free, matched) in rest:
            room = max(0, min(self.parameters.max_new_landmarks, self.parameters.max_updates - matched))
            while self._joint.count > self._joint.capacity - room:
                stalest = self._map.least_recently_seen()
                self._relocalizer.archive.keep(self.state, stalest)
                self._remove_landmark(stalest, "map full")
            initializer.advance(seen, free, room, tick, clones)
        self._clone_pose(name)

    def _sightings(self, name: str, view: View) -> Sightings | None:
        """The view's sightings of static landmarks, in an order that does not depend on that of the input."""
        mount = self.setup.mounts[view.camera]
        seen = view.sightings if view.sightings is not None else view.features
        if seen is None:
            return None
        odometry = self._odometry.get(name)
        if odometry is not None:
            seen = replace(seen, bearing=turned_to_frame(seen.bearing, mount, odometry.T_before_now, self._seconds[name]))
        others = [number for other, number in self._team.items() if other != name]
        moving = on_robots(self._joint, self._joint.camera_pose(self._team[name], mount), others, seen, self.parameters.robot_radius)
        self._counters["on a robot"] += int(moving.sum())
        order = np.lexsort(seen.bearing.T)
        keep = order[~moving[order]]
        self.sighted[view.camera] = Sightings(seen.bearing[keep], seen.range[keep], seen.subject[keep], seen.descriptor[keep], seen.covariance[keep])
        return self.sighted[view.camera]

    def _update(self, name: str, view: View, seen: Sightings, tick: int) -> tuple[Indices, int]:
        """Associate and update; returns the sightings without a landmark, and the number of those with one."""
        robot, landmark_map, mount = self._team[name], self._map, self.setup.mounts[view.camera]
        descriptor = unit_rows(seen.descriptor)
        descriptor_distance = dissimilarity(landmark_map.descriptor, landmark_map.subject[: landmark_map.count], descriptor, seen.subject)
        appearance = descriptor_distance, np.asarray(landmark_map.descriptor[:, robot].any(axis=1))
        m = self._associate(robot, mount, seen, appearance, tick)
        known = len(m.landmark)
        if self._relocalizer.may_be_lost(name, len(seen), known):
            reason, agreed = self._relocalizer.relocalize(self.state, robot, mount, seen, known)
            self._counters[reason] += 1
            if agreed:
                m = associate(
                    self._joint, robot, self._joint.camera_pose(robot, mount), (seen.bearing, seen.covariance), appearance, self.parameters.gate
                )
            known = max(known, agreed)
        self._relocalizer.record_matches(name, known, self._seconds[name])
        if self._relocalizer.is_lost(name):
            self._measurement_update(name, None)
            return np.zeros(0, dtype=np.intp), 0
        landmark_map.last_localized[robot] = tick
        azimuth, _ = angles_from_bearing(seen.bearing[m.sighting])
        chosen = spread_over_azimuth(azimuth, landmark_map.hits[m.landmark].astype(np.float64), self.parameters.max_updates)
        landmark, sighting = m.landmark[chosen], m.sighting[chosen]
        self._count_matches(robot, m)
        bearing = self._without_parallax(name, mount, landmark, seen.bearing[sighting])
        noise, drift = seen.covariance[sighting], self.parameters.feature_drift
        if drift is not None and view.sightings is None:
            noise = drift.apply(self._joint, landmark_map, landmark, (robot, tick, self._joint.camera_pose(robot, mount).origin), noise)
        good = self._measurement_update(name, (mount, landmark, bearing, noise), view) > 0.3
        landmark_map.record_sightings(landmark[good], descriptor[sighting[good]], robot, tick)
        landmark_map.rejected[landmark[~good]] += 1
        self._counters["outlier"] += int((~good).sum())
        free = np.ones(len(seen), dtype=bool)
        free[m.sighting] = free[m.rejected_sighting] = False
        self._counters["no match"] += int(free.sum())
        return np.flatnonzero(free), len(m.landmark)

    def _without_parallax(self, name: str, mount: Mount, landmark: Indices, bearing: Array) -> Array:
        """Bearings (k, 3) of landmarks without the parallax of the camera's motion since their rows were exposed."""
        odometry = self._odometry.get(name)
        if odometry is None or not (mount.readout or mount.exposure):
            return bearing
        place = self._joint.camera_pose(self._team[name], mount).origin
        ranges = np.linalg.norm(self._joint.point[landmark] - place, axis=1)
        return moved_to_frame(bearing, ranges, mount, odometry.T_before_now, self._seconds[name])

    def _measurement_update(self, name: str, seen: LandmarkMeasurement | None, view: View | None = None) -> Array:
        """One update by associated sightings, robots in the view, and gravity, which is used once a tick.

        Returns the weights (k,) of the sightings. Raises ValueError if the filter diverges.
        """
        robot, up, others = self._team[name], self._gravity.pop(name, None), self._detected_robots(name, view)
        k = 0 if seen is None else len(seen[1])
        if up is None and not k and not others:
            return np.ones(0)
        try:
            weights = self._joint.update(lambda: linearize(self._joint, robot, seen, up, others), self.parameters.iterations, self.parameters.robust)
        except np.linalg.LinAlgError:
            weights = np.full(1, np.nan)
        if not (np.isfinite(weights).all() and np.isfinite(self._joint.translation).all()):
            where, variance = self._joint.translation[robot].tolist(), float(self._joint.P[self._joint.offset(robot), self._joint.offset(robot)])
            raise ValueError(f"the filter diverged at tick {self._tick}: robot {name!r} is at {where}, variance {variance:.3g} m²")
        self._counters["shaken level"] += int(up is not None and weights[-1] < 0.3)
        return weights[:k]

    def _detected_robots(self, name: str, view: View | None) -> RobotMeasurements | None:
        """The robots of the team in a view that pass the gate. Lost robots neither observe others nor are observed."""
        if view is None or not view.robot_detections or self._relocalizer.is_lost(name):
            return None
        there = {other: number for other, number in self._team.items() if not self._relocalizer.is_lost(other)}
        seen = identify(self.setup, self.setup.mounts[view.camera], view.robot_detections, there)

        def attempt() -> tuple[Mask, int, int]:
            inside = within_gate(self._joint, self._team[name], seen, self.parameters.gate.probability)
            return inside, int(inside.sum()), int((~inside).sum())

        inside, again = self._joint.retry_with_inflation(self._team[name], self._inflation, attempt, 1)
        counts = {
            "robot seen": inside.sum(),
            "robot refused": (~inside).sum(),
            "robot unplaced": len(view.robot_detections) - len(seen),
            "reopened": again,
        }
        self._counters.update({reason: int(count) for reason, count in counts.items() if count})
        return seen.subset(inside)

    def _associate(self, robot: int, mount: Mount, seen: Sightings, appearance: tuple[Floats, Mask], tick: int) -> Matches:
        """Matches with the map, if necessary with an inflated pose covariance; landmarks that the robot saw within `recent_ticks` decide."""
        joint, landmark_map, parameters = self._joint, self._map, self.parameters

        def attempt() -> tuple[Matches, int, int]:
            m = associate(joint, robot, joint.camera_pose(robot, mount), (seen.bearing, seen.covariance), appearance, parameters.gate)
            # Landmarks of other robots may look different from here, or match by chance.
            recent = (landmark_map.last_robot[: landmark_map.count] == robot) & (
                landmark_map.last_seen[: landmark_map.count] >= tick - parameters.recent_ticks
            )
            return m, int(recent[m.landmark].sum()), int(recent[m.rejected].sum())

        m, again = joint.retry_with_inflation(robot, self._inflation, attempt, 5)
        if again:
            self._counters["reopened"] += 1
        return m

    def _count_matches(self, robot: int, m: Matches) -> None:
        """Count rejections, and misses of the robot that last saw the landmark."""
        landmark_map = self._map
        landmark_map.rejected[m.rejected] += 1
        absent = m.in_range.copy()
        absent[m.landmark] = absent[m.rejected] = False
        landmark_map.missed[: landmark_map.count][absent & (landmark_map.last_robot[: landmark_map.count] == robot)] += 1
        self._counters["matched"] += len(m.landmark)
        self._counters["gated"] += len(m.rejected)

    def _remove_landmark(self, landmark: int, reason: str) -> None:
        self._counters[reason] += 1
        self._joint.remove_landmark(landmark)
        self._map.remove(landmark)

    def _clone_pose(self, name: str) -> None:
        """Clone the present pose if the robot is far enough from its last clone."""
        robot, count = self._team[name], self._cloned.get(name, 0)
        joint = self._joint
        last = joint.clone_slot(robot, (count - 1) % joint.clones)
        if count and np.linalg.norm(joint.translation[robot] - joint.translation[last]) < self.parameters.clone_spacing:
            return
        k = count % joint.clones
        joint.clone(robot, k)
        self._cloned[name] = count + 1
        for initializer in self._initializers.values():
            if initializer.robot == robot:
                initializer.record_clone(k)


def _takes_part(views: list[View], setup: Setup) -> bool:
    """Whether a robot reports odometry or sees landmarks."""
    cameras = [setup.mounts[v.camera].camera for v in views if v.image is not None]
    return any(v.odometry is not None or v.sightings is not None for v in views) or any(isinstance(c, Panorama) for c in cameras)


def _correlation_factor(correlation_time: float, period: float) -> float:
    """The factor (1 + ρ)/(1 − ρ) by which the variance of correlated errors grows in a long sum.

    ρ = exp(−period/correlation_time) is the correlation of successive errors.
    """
    rho = float(np.exp(-period / correlation_time)) if correlation_time > 0 else 0.0
    return (1 + rho) / (1 - rho)


@dataclass(eq=False)
class ConstantVelocity:
    """The last poses of one robot."""

    poses: list[Pose] = field(default_factory=list)

    seconds: float = 0.0

    def step(self, pose: Pose, seconds: float) -> tuple[Pose, Array] | None:
        """The motion in the last `seconds` and its covariance (6, 6), by the estimate of the pose before them; None at the first tick."""
        self.poses, before, self.seconds = [*self.poses[-2:], pose], self.seconds, seconds
        if len(self.poses) == 1:
            return None
        moved = self.poses[-2].inverse() @ pose
        if len(self.poses) == 2 or np.linalg.norm(moved.translation) > FASTEST * before:
            return Pose.planar(AHEAD * seconds, 0.0, 0.0), (SPREAD * seconds) ** 2 * np.eye(6)
        if seconds != before:
            moved = Pose.exp(moved.log() * (seconds / before))
        return moved, (ACCELERATION * seconds**2) ** 2 * np.eye(6)
