"""A robot that has lost its way: whether it has, and where it is by what it sees, whatever its odometry says.

Who is carried off, or drove too far blind, sees many things and knows none of them where it believes to be. Then its panorama is matched with the
whole map by looks alone, and its pose comes from those that agree (tracker.resection).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.association import mutual
from tracker.bearings import Sight
from tracker.geometry import Array, Pose, rotation_z
from tracker.joint import Indices, Joint
from tracker.landmarks import Landmarks, dissimilarity, unit_rows
from tracker.measurements import Sightings, Start
from tracker.resection import Search, resect

State = tuple[Joint, Landmarks]


class Wayfinder:
    """Which robots may have lost their way, and for how long they have been looked for."""

    def __init__(self, rule: Search, period: float) -> None:
        self.rule = rule
        self._most = max(1, round(rule.patience / period))
        self._usual: dict[str, float] = {}
        self._astray: dict[str, int] = {}

    def astray(self, robot: str) -> bool:
        """Whether the robot is being looked for: what it sees is put nowhere meanwhile."""
        return self._astray.get(robot, 0) > 0

    def doubts(self, robot: str, seen: int, matched: int) -> bool:
        """Whether a robot that saw so many things at a tick knew so much fewer of them than it used to that it may be elsewhere."""
        return seen >= self.rule.pairs and matched < max(self.rule.few + 1, self.rule.drop * self._usual.get(robot, 0.0)) and robot in self._usual

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
class Place:
    """T_map_robot, and how many landmarks speak for it."""

    pose: Pose
    agreed: int


def locate(team: State, own: tuple[Sight, Pose], seen: Sightings, rule: Search) -> Place | str:
    """Where in the team's map a robot is by what one of its cameras sees, or why it is not found. own: the camera, and the robot, in any frame whose
    "up" is that of the map; gravity has told it.
    """
    (joint, book), (sight, pose) = team, own
    unlike = dissimilarity(book.look, book.subject[: book.count], unit_rows(seen.descriptor), seen.subject)
    if not unlike.size:
        return "too little alike"
    row, column = mutual(np.where(unlike < rule.unlike, unlike, np.inf), unlike, rule.ratio)
    order = np.argsort(unlike[row, column], kind="stable")
    row, column = row[order], column[order]
    found = resect(seen.bearing[column] @ sight.rotation.T, joint.point[row], _spread(joint, row), rule)
    if isinstance(found, str):
        return found
    turn = rotation_z(found.yaw)
    return Place(Pose(turn @ pose.rotation, found.origin - turn @ (sight.origin - pose.translation)), len(found.agreed))


def doubted(pose: Pose, rule: Search) -> Start:
    """A pose that was found, with the doubt that the sightings which it came from will take away: they count once."""
    return Start(pose, np.diag(np.repeat(rule.doubt, 3) ** 2))


def _spread(joint: Joint, landmarks: Indices) -> Array:
    """(k,) m: standard deviations of landmarks, the mean over the axes."""
    variance = np.diag(joint.P)[joint.base :].reshape(-1, 3)[landmarks]
    out: Array = np.sqrt(variance.mean(axis=1))
    return out
