"""A robot that has lost its way: whether it has, and where it is by what it sees, whatever its odometry says.

Who is carried off, or drove too far blind, sees many things and knows none of them where it believes to be. Then its panorama is matched by looks
alone with the whole map, and with all that the map had no room for any more, and its pose comes from those that agree (tracker.slam.resection).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tracker.ekf.measurement_models import CameraPose
from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices, Pose, rotation_z
from tracker.slam.data_association import mutual
from tracker.slam.landmark_map import LandmarkMap, dissimilarity, unit_rows
from tracker.slam.resection import Search, resect
from tracker.types import Mount, Sightings, Start

State = tuple[JointState, LandmarkMap]


class Relocalizer:
    """Which robots may have lost their way, for how long they have been looked for, and what they are found by; memory: what left the map."""

    def __init__(self, rule: Search, period: float) -> None:
        self.rule, self.memory = rule, Memory(rule.memory)
        self._most = max(1, round(rule.patience / period))
        self._usual: dict[str, float] = {}
        self._astray: dict[str, int] = {}

    def astray(self, robot: str) -> bool:
        """Whether the robot is being looked for: what it sees is put nowhere meanwhile."""
        return self._astray.get(robot, 0) > 0

    def doubts(self, robot: str, seen: int, matched: int) -> bool:
        """Whether a robot that saw so many things at a tick knew so much fewer of them than it used to that it may be elsewhere."""
        return seen >= self.rule.pairs and matched < max(self.rule.few + 1, self.rule.drop * self._usual.get(robot, 0.0)) and robot in self._usual

    def find(self, team: State, robot: int, mount: Mount, seen: Sightings, matched: int) -> tuple[str, int]:
        """Look for a robot, by its number, that may have lost its way; where many more landmarks agree with another place than are matched, there it
        is put. What came of it, and how many landmarks agree with the place where it is now, if it is known.
        """
        joint, _ = team
        pose = Pose(joint.rotation[robot], joint.translation[robot])
        found = relocalize(self.memory.with_map(team), (joint.sight(robot, mount), pose), seen, self.rule)
        if isinstance(found, str):
            return f"lost: {found}", 0
        if found.agreed <= 1.5 * matched:
            return "not lost", 0
        if found.near(pose, self.rule):
            return "not lost", found.agreed
        joint.put(robot, found.start(self.rule))
        return "found again", found.agreed

    def judge(self, robot: str, matched: int) -> None:
        """Book what a robot knew in the end at a tick at which it saw something. Who knows next to nothing is looked for; who is not found in time
        is taken to be in a new place: it begins anew, and is not looked for until it has known some again.
        """
        if matched > self.rule.few:
            self._usual[robot] = matched if robot not in self._usual else 0.8 * self._usual[robot] + 0.2 * matched
            self._astray[robot] = 0
        elif robot in self._usual:
            self._astray[robot] = self._astray.get(robot, 0) + 1
            if self._astray[robot] > self._most:
                del self._usual[robot], self._astray[robot]


@dataclass(frozen=True, eq=False)
class Known:
    """Landmarks to look for: look (n, k, d), the last descriptor of each robot, or zeros; subject (n,), as Landmarks has them; point (n, 3) m;
    spread (n,) m: standard deviations, the mean over the axes. The first `mapped` of them are those of the map.
    """

    look: Floats
    subject: Indices
    point: Array
    spread: Array
    mapped: int


class Memory:
    """Landmarks that gave way to others in the map, as they were then; of more than `capacity` the oldest are forgotten for good."""

    def __init__(self, capacity: int) -> None:
        self._kept: deque[tuple[Floats, int, Array, float]] = deque(maxlen=capacity)

    def keep(self, team: State, landmark: int) -> None:
        """Remember a landmark that is about to leave the map."""
        joint, book = team
        spread = float(_spread(joint, np.array([landmark]))[0])
        self._kept.append((book.look[landmark].copy(), int(book.subject[landmark]), joint.point[landmark].copy(), spread))

    def with_map(self, team: State) -> Known:
        """The map, and what is remembered beside it."""
        joint, book = team
        n = book.count
        spread = _spread(joint, np.arange(n))
        if not self._kept:
            return Known(book.look, book.subject[:n], joint.point[:n], spread, n)
        look, subject, point, spreads = zip(*self._kept, strict=True)
        looks = np.concatenate([book.look, np.stack(look)])
        subjects = np.concatenate([book.subject[:n], np.array(subject)])
        return Known(looks, subjects, np.concatenate([joint.point[:n], np.stack(point)]), np.concatenate([spread, np.array(spreads)]), n)


@dataclass(frozen=True, eq=False)
class Place:
    """T_map_robot, how many landmarks speak for it, and how many of these are in the map."""

    pose: Pose
    agreed: int
    mapped: int

    def start(self, rule: Search) -> Start:
        """The pose with a doubt that the landmarks which it came from will take away: they count once. Those that are not in the map take nothing
        away, and where most are such the pose is as good as it will be.
        """
        doubt = rule.doubt if self.mapped >= rule.pairs else rule.firm
        return Start(self.pose, np.diag(np.repeat(doubt, 3) ** 2))

    def near(self, pose: Pose, rule: Search) -> bool:
        """Whether another pose is the same but for what is always in doubt."""
        apart = np.linalg.norm((pose.inverse() @ self.pose).log().reshape(2, 3), axis=1)
        return bool((apart < 3 * np.array(rule.firm)).all())


def relocalize(known: Known, own: tuple[CameraPose, Pose], seen: Sightings, rule: Search) -> Place | str:
    """Where among the landmarks a robot is by what one of its cameras sees, or why it is not found. own: the camera, and the robot, in any frame
    whose "up" is that of the map; gravity has told it.
    """
    sight, pose = own
    unlike = dissimilarity(known.look, known.subject, unit_rows(seen.descriptor), seen.subject)
    if not unlike.size:
        return "too little alike"
    row, column = mutual(np.where(unlike < rule.unlike, unlike, np.inf), unlike, rule.ratio)
    order = np.argsort(unlike[row, column], kind="stable")
    row, column = row[order], column[order]
    found = resect(seen.bearing[column] @ sight.rotation.T, known.point[row], known.spread[row], rule)
    if isinstance(found, str):
        return found
    turn = rotation_z(found.yaw)
    place = Pose(turn @ pose.rotation, found.origin - turn @ (sight.origin - pose.translation))
    return Place(place, len(found.agreed), int((row[found.agreed] < known.mapped).sum()))


def _spread(joint: JointState, landmarks: Indices) -> Array:
    """(k,) m: standard deviations of landmarks, the mean over the axes."""
    variance = np.diag(joint.P)[joint.base :].reshape(-1, 3)[landmarks]
    out: Array = np.sqrt(variance.mean(axis=1))
    return out
