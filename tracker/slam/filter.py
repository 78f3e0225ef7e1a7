"""Multi-robot EKF-SLAM in SE(3) from panoramas: one joint covariance of the team and its map, a correction factor a robot, and an
update of exactly two linearisations.

A tick: predict by odometry, level by gravity, then robot by robot: sightings → association → update → new landmarks.

What the filter's map is at a tick, and which of it each robot has just seen.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from tracker.ekf.linearization import RobotMeasurements, Seen, linearise
from tracker.ekf.odometry_biases import root
from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices, Mask, Pose, angles_from_bearing
from tracker.geometry.cameras import Panorama
from tracker.slam.data_association import Matches, associate
from tracker.slam.features import extract
from tracker.slam.inter_robot import expected, identify, on_robots
from tracker.slam.landmark_initialization import LandmarkInitializer
from tracker.slam.landmark_map import LandmarkMap, dissimilarity, spread, unit_rows
from tracker.slam.parameters import SlamParameters
from tracker.slam.relocalization import Place, Relocalizer, State
from tracker.slam.unknown_start import UnknownStarts
from tracker.types import MapSnapshot, Mount, Odometry, Setup, Sightings, Start, Tick, View


class Slam:
    """The online filter. Robots that never move nor see landmarks (the fixed cameras of PETS) stay constants outside the state."""

    def __init__(self, setup: Setup, parameters: SlamParameters) -> None:
        self.setup, self.parameters = setup, parameters
        correction = parameters.correction_sigma if parameters.correction else None
        self._joint = JointState(parameters.clones, parameters.capacity, correction, parameters.mode, parameters.persistence)
        self._map = LandmarkMap(parameters.capacity, max(1, len(setup.starts)))
        self._team: dict[str, int] = {}
        self._frontier: dict[str, LandmarkInitializer] = {}
        self._cloned: dict[str, int] = {}
        self._odometry: dict[str, Odometry | None] = {}
        self._counters: Counter[str] = Counter()
        self._newcomers = UnknownStarts(setup, parameters, Slam)
        self._blind: dict[str, tuple[int, Array]] = {}
        self._wayfinder = Relocalizer(parameters.search, setup.period)
        self.sighted: dict[str, Sightings] = {}  # by camera, what was seen at the last tick of what stands still
        self._doubt = np.repeat(parameters.reopen_sigma, 3) ** 2
        self._tick = -1

    def step(self, tick: Tick) -> None:
        """Take in all views of one tick. Raises ValueError for a view of a camera, or of a robot, that the setup does not know."""
        self._tick, views = tick.index, dict[str, list[View]]()
        self.sighted.clear()
        for view in tick.views:
            if view.camera not in self.setup.mounts:
                raise ValueError(f"view of camera {view.camera!r}, needs one of {sorted(self.setup.mounts)}")
            if view.companions is not None:
                self.setup.check_companions(view.camera, view.companions)
            views.setdefault(self.setup.mounts[view.camera].robot, []).append(view)
        for name in self.setup.starts:
            self._admit(name, views.get(name, []))
        for name in self._team:
            self._predict(name, views.get(name, []))
        self._joint.drift(self.parameters.correction_walk * np.sqrt(self.setup.period))
        if self.parameters.persistence is not None:
            self._joint.fade(self.parameters.persistence.kept(self.setup.period))
        for name in self._team:
            self._look(name, views.get(name, []), tick.index)
        for name, start in self.setup.starts.items():
            if start is None and name not in self._team and _active(views.get(name, []), self.setup):
                self._meet(name, replace(tick, views=tuple(views[name])))

    @property
    def state(self) -> State:
        """The joint state and the book of its landmarks, which go on changing with the filter."""
        return self._joint, self._map

    @property
    def team(self) -> Mapping[str, int]:
        """The robots in the joint state, and their numbers there."""
        return MappingProxyType(self._team)

    def placed(self, robot: str) -> bool:
        """Whether it is known where the robot is: no more than where its start is unknown and it has not yet joined the team."""
        return robot in self._team or self.setup.starts[robot] is not None

    @property
    def counters(self) -> dict[str, int]:
        """How often something happened or was refused, by reason."""
        return dict(sum((f.counters for f in self._frontier.values()), self._counters))

    def pose(self, robot: str) -> Pose:
        """T_world_robot as believed now. Raises ValueError for a robot whose start is unknown."""
        if robot not in self._team:
            return self._start(robot).T_world_robot
        return Pose(self._joint.rotation[self._team[robot]], self._joint.translation[self._team[robot]])

    def covariance(self, robot: str) -> Array:
        """(6, 6) of the pose's right tangent [m, rad]. Raises ValueError as pose does."""
        if robot not in self._team:
            return self._start(robot).covariance
        return self._joint.covariance(self._team[robot])

    def correction(self, robot: str) -> Array:
        """(3,) rad: the correction factor, a rotation vector of the robot's cameras in its body (bearings.Sight); zero where there is none."""
        return self._joint.correction[self._team[robot]].copy() if robot in self._team else np.zeros(3)

    def landmarks(self) -> Array:
        """(n, 3) m in the world."""
        return self._joint.point[: self._joint.count].copy()

    def identities(self) -> Indices:
        """(n,) numbers of the landmarks, never used again."""
        return self._map.identity[: self._map.count].copy()

    def _start(self, robot: str) -> Start:
        start = self.setup.starts[robot]
        if start is None:
            raise ValueError(f"robot {robot!r} has no start pose, needs one")
        return start

    def _admit(self, name: str, views: list[View]) -> None:
        """Take a robot into the state at its first odometry or sight of landmarks."""
        if name not in self._team and self.setup.starts[name] is not None and _active(views, self.setup):
            self._enlist(name, self._joint.join(self._start(name)))

    def _meet(self, name: str, tick: Tick) -> None:
        """A robot whose start is unknown is looked for by what it sees, and joins where it is found."""
        self._counters["unknown start"] += 1
        found = self._newcomers.step(name, tick, self._wayfinder.memory.with_map(self.state))
        self._counters[f"waits: {found}" if isinstance(found, str) else "joined"] += 1
        if isinstance(found, Place):
            self._enlist(name, self._joint.join(found.start(self.parameters.search)))
            self._look(name, list(tick.views), tick.index)

    def _enlist(self, name: str, robot: int) -> None:
        """The robot is in the joint state."""
        self._team[name] = robot
        for camera, mount in self.setup.mounts.items():
            if mount.robot == name:
                self._frontier[camera] = LandmarkInitializer(robot, mount, (self._joint, self._map), self.setup.ground, self.parameters.trial)

    def _predict(self, name: str, views: list[View]) -> None:
        """Go on by odometry; in a gap of it a robot may have gone on as it last did, or stood still: its pose is doubted by that way."""
        odometry = next((v.odometry for v in views if v.odometry is not None), None)
        if odometry is not None:
            stated = odometry.covariance
            odometry, scale = self._believed(odometry)
            doubt = odometry.covariance if scale is None else stated
        self._odometry[name] = odometry
        if odometry is not None:
            self._joint.predict(self._team[name], odometry.T_before_now, odometry.covariance, scale)
            self._blind[name] = 0, np.square(odometry.T_before_now.log()) + np.diag(doubt)
        elif name in self._blind:
            gap, step = self._blind[name]
            # The way grows with the time, its variance with the square of it.
            self._joint.inflate(self._team[name], (2 * gap + 1) * np.repeat([step[:3].sum(), step[3:].sum()], 3))
            self._blind[name] = gap + 1, step
            self._counters["no odometry"] += 1

    def _believed(self, odometry: Odometry) -> tuple[Odometry, Array | None]:
        """The odometry with the errors that are new at this tick, and what one of each lasting error makes of it; where none are kept, with errors
        that are believed the less, as they hang together.
        """
        rule, period = self.parameters, self.setup.period
        level = np.sqrt(_worth(rule.level_memory, period))
        if rule.persistence is not None:
            covariance, sigma = rule.persistence.whitened(odometry)
            return replace(odometry, covariance=covariance, gravity_sigma=sigma * level), root(odometry.covariance)
        scale = np.repeat([1.0, np.sqrt(_worth(rule.turn_memory, period))], 3)
        return replace(odometry, covariance=odometry.covariance * np.outer(scale, scale), gravity_sigma=odometry.gravity_sigma * level), None

    def _look(self, name: str, views: list[View], tick: int) -> None:
        """All that one robot sees at one tick: update, forget what fails, follow what is new."""
        rest = []
        for view in views:
            seen = self._sightings(name, view)
            if seen is not None:
                rest.append((self._frontier[view.camera], seen, self._update(name, view, seen, tick)))
            elif view.companions:
                self._correct(name, None, view)
        if not rest:
            self._correct(name, None)
        for landmark in self._map.doomed(self.parameters.survival)[::-1]:
            self._forget(int(landmark), "lost")
        if self._wayfinder.astray(name):
            return
        for frontier, seen, (free, matched) in rest:
            room = max(0, min(self.parameters.growth, self.parameters.seen - matched))
            while self._joint.count > self._joint.capacity - room:
                stalest = self._map.stalest()
                self._wayfinder.memory.keep(self.state, stalest)
                self._forget(stalest, "map full")
            frontier.advance(seen, free, room, tick)
        self._remember(name)

    def _sightings(self, name: str, view: View) -> Sightings | None:
        """What the view shows of the world that stands still, in an order that does not depend on how it came."""
        mount = self.setup.mounts[view.camera]
        seen = view.sightings
        if seen is None and view.image is not None and isinstance(mount.camera, Panorama):
            up = self._joint.sight(self._team[name], mount).rotation[2]
            seen = extract(view.image, mount.camera, up, view.detections, self.parameters.extraction).sightings()
        if seen is None:
            return None
        others = [number for other, number in self._team.items() if other != name]
        moving = on_robots(self._joint, self._joint.sight(self._team[name], mount), others, seen, self.parameters.robot_radius)
        self._counters["on a robot"] += int(moving.sum())
        order = np.lexsort(seen.bearing.T)
        keep = order[~moving[order]]
        self.sighted[view.camera] = Sightings(seen.bearing[keep], seen.range[keep], seen.subject[keep], seen.descriptor[keep], seen.covariance[keep])
        return self.sighted[view.camera]

    def _update(self, name: str, view: View, seen: Sightings, tick: int) -> tuple[Indices, int]:
        """Associate and update; returns the sightings that belong to no landmark, and how many did."""
        robot, book, mount = self._team[name], self._map, self.setup.mounts[view.camera]
        descriptor = unit_rows(seen.descriptor)
        unlike = dissimilarity(book.look, book.subject[: book.count], descriptor, seen.subject)
        looks = unlike, np.asarray(book.look[:, robot].any(axis=1))
        m = self._associate(robot, mount, seen, looks, tick)
        known = len(m.landmark)
        if self._wayfinder.doubts(name, len(seen), known):
            reason, agreed = self._wayfinder.find(self.state, robot, mount, seen, known)
            self._counters[reason] += 1
            if agreed:
                m = associate(self._joint, robot, self._joint.sight(robot, mount), (seen.bearing, seen.covariance), looks, self.parameters.gate)
            known = max(known, agreed)
        self._wayfinder.judge(name, known)
        if self._wayfinder.astray(name):
            self._correct(name, None)
            return np.zeros(0, dtype=np.intp), 0
        book.looked[robot] = tick
        azimuth, _ = angles_from_bearing(seen.bearing[m.sighting])
        chosen = spread(azimuth, book.hits[m.landmark].astype(np.float64), self.parameters.seen)
        landmark, sighting = m.landmark[chosen], m.sighting[chosen]
        self._account(robot, m)
        good = self._correct(name, (mount, landmark, seen.bearing[sighting], seen.covariance[sighting]), view) > 0.3
        book.seen(landmark[good], descriptor[sighting[good]], robot, tick)
        book.refused[landmark[~good]] += 1
        self._counters["outlier"] += int((~good).sum())
        free = np.ones(len(seen), dtype=bool)
        free[m.sighting] = free[m.refused_sighting] = False
        self._counters["no match"] += int(free.sum())
        return np.flatnonzero(free), len(m.landmark)

    def _correct(self, name: str, seen: Seen | None, view: View | None = None) -> Array:
        """One update by what was associated, by robots in the view, and by gravity if not yet used; the weights (k,) of what was associated."""
        robot, odometry, others = self._team[name], self._odometry.pop(name, None), self._met(name, view)
        up = None if odometry is None or odometry.gravity is None else odometry
        k = 0 if seen is None else len(seen[1])
        if up is None and not k and not others:
            return np.ones(0)
        try:
            weights = self._joint.update(lambda: linearise(self._joint, robot, seen, up, others), self.parameters.iterations, self.parameters.robust)
        except np.linalg.LinAlgError:
            weights = np.full(1, np.nan)
        if not (np.isfinite(weights).all() and np.isfinite(self._joint.translation).all()):
            where, doubt = self._joint.translation[robot].tolist(), float(self._joint.P[self._joint.offset(robot), self._joint.offset(robot)])
            raise ValueError(f"the filter diverged at tick {self._tick}: robot {name!r} is at {where}, variance {doubt:.3g} m²")
        self._counters["shaken level"] += int(up is not None and weights[-1] < 0.3)
        return weights[:k]

    def _met(self, name: str, view: View | None) -> RobotMeasurements | None:
        """The robots of the team that a view shows where they may be. Who is being looked for tells nothing of others, nor they of it."""
        if view is None or not view.companions or self._wayfinder.astray(name):
            return None
        there = {other: number for other, number in self._team.items() if not self._wayfinder.astray(other)}
        seen = identify(self.setup, self.setup.mounts[view.camera], view.companions, there)

        def attempt() -> tuple[Mask, int, int]:
            inside = expected(self._joint, self._team[name], seen, self.parameters.gate.probability)
            return inside, int(inside.sum()), int((~inside).sum())

        inside, again = self._joint.reopened(self._team[name], self._doubt, attempt, 1)
        counts = {"robot seen": inside.sum(), "robot refused": (~inside).sum(), "robot unplaced": len(view.companions) - len(seen), "reopened": again}
        self._counters.update({reason: int(count) for reason, count in counts.items() if count})
        return seen.those(inside)

    def _associate(self, robot: int, mount: Mount, seen: Sightings, looks: tuple[Floats, Mask], tick: int) -> Matches:
        """Matches with the map, if need be with a pose that is doubted by reopen_sigma: asked of what the robot saw a moment ago."""
        joint, book, rule = self._joint, self._map, self.parameters

        def attempt() -> tuple[Matches, int, int]:
            m = associate(joint, robot, joint.sight(robot, mount), (seen.bearing, seen.covariance), looks, rule.gate)
            # What others mapped may look different from here, or alike by chance.
            fresh = (book.by[: book.count] == robot) & (book.last[: book.count] >= tick - rule.reopen)
            return m, int(fresh[m.landmark].sum()), int(fresh[m.refused].sum())

        m, again = joint.reopened(robot, self._doubt, attempt, 5)
        if again:
            self._counters["reopened"] += 1
        return m

    def _account(self, robot: int, m: Matches) -> None:
        """Book refusals, and misses of the robot that should know the landmark best."""
        book = self._map
        book.refused[m.refused] += 1
        absent = m.expected.copy()
        absent[m.landmark] = absent[m.refused] = False
        book.missed[: book.count][absent & (book.by[: book.count] == robot)] += 1
        self._counters["matched"] += len(m.landmark)
        self._counters["gated"] += len(m.refused)

    def _forget(self, landmark: int, reason: str) -> None:
        self._counters[reason] += 1
        self._joint.remove(landmark)
        self._map.remove(landmark)

    def _remember(self, name: str) -> None:
        """Keep the present pose as a clone where the robot has gone far enough since the last one."""
        robot, count = self._team[name], self._cloned.get(name, 0)
        joint = self._joint
        last = joint.clone_slot(robot, (count - 1) % joint.clones)
        if count and np.linalg.norm(joint.translation[robot] - joint.translation[last]) < self.parameters.stride:
            return
        k = count % joint.clones
        joint.clone(robot, k)
        self._cloned[name] = count + 1
        for frontier in self._frontier.values():
            if frontier.robot == robot:
                frontier.remember(k)


def _active(views: list[View], setup: Setup) -> bool:
    """Whether a robot reports motion or sees landmarks."""
    cameras = [setup.mounts[v.camera].camera for v in views if v.image is not None]
    return any(v.odometry is not None or v.sightings is not None for v in views) or any(isinstance(c, Panorama) for c in cameras)


def _worth(memory: float, period: float) -> float:
    """How much the variance of errors must grow that hang together for `memory` s, ρ = exp(−period/memory) from one to the next: (1 + ρ)/(1 − ρ),
    so that a long row of them is worth what it is.
    """
    rho = float(np.exp(-period / memory)) if memory > 0 else 0.0
    return (1 + rho) / (1 - rho)


def map_snapshot(slam: Slam, tick: int) -> MapSnapshot | None:
    """The map after the tick; None where no robot has a map."""
    joint, book = slam.state
    if not joint.robots:
        return None
    n, sighted = joint.count, {}
    for name, robot in slam.team.items():
        sighted[name] = book.identity[:n][book.when[:n, robot] == tick].astype(np.int64)
    return MapSnapshot(slam.identities().astype(np.int64), slam.landmarks(), sighted)
