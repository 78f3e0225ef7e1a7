"""Robots that do not know where they start: each maps in a frame of its own until it sees enough of the team's landmarks to be placed by them, as one
that has lost its way, or until its map lies firmly in the team's; then both become one state.

The two filters have no error in common until then, so the newcomer's block comes into the joint state as it is, moved by the alignment, with an
error of the alignment that is next to unknown; common landmarks, told to be the same, then bring it down to what they know. Nothing counts twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tracker.alignment import Alignment, Meeting, align, levers
from tracker.association import mutual
from tracker.geometry import Array, Pose
from tracker.joint import Indices, Joint, Linear
from tracker.landmarks import Landmarks, dissimilarity
from tracker.measurements import Setup, Start, Tick
from tracker.relocation import Place, State, doubted, locate

if TYPE_CHECKING:
    from tracker.slam import Slam, SlamParameters

LEVEL_SIGMA = 0.3
"""rad: what is known of roll and pitch before the first "up" is used; that measurement is taken in by the filter as any other."""
FRAME_SIGMA = 1e-4
"""m and rad: place and heading in one's own frame are so by definition."""
WEAK = 100.0
"""Standard deviations of the alignment's error before the common landmarks are told to be the same, over those after: a prior that weighs 1e-4."""

BY_SIGHT = "joined by what it sees"
"""Counted where a robot has joined with a pose whose sightings have not been taken in yet."""

ITERATIONS = 2
"""Linearisations of the update by what is in common."""


@dataclass(frozen=True, eq=False)
class Encounter:
    """An alignment with the landmarks that speak for it: names (k,), identities in the team's book, and own (k,), numbers in the newcomer's map.
    same m: how far apart two estimates of one landmark may lie beyond their covariances.
    """

    alignment: Alignment
    names: Indices
    own: Indices
    same: float


class Newcomers:
    """Robots that wait, each with a filter of its own, which `build` makes."""

    def __init__(self, setup: Setup, parameters: SlamParameters, build: Callable[[Setup, SlamParameters], Slam]) -> None:
        self.setup, self.parameters, self._build = setup, parameters, build
        self._alone: dict[str, Slam] = {}

    def step(self, name: str, tick: Tick, team: State, forget: Callable[[int, str], None]) -> tuple[int | None, str]:
        """A waiting robot's views of one tick: its number in the team where it joins now, and "joined" or BY_SIGHT, or the reason why it waits.

        forget is called with landmarks of the team's map, and why, that must go to make room.
        """
        if name not in self._alone and not self._begin(name, tick):
            return None, "waits: no level"
        alone = self._alone[name]
        alone.step(tick)
        if (pose := self._recognised(name, tick, team)) is not None:
            del self._alone[name]
            return team[0].join(doubted(pose, self.parameters.search)), BY_SIGHT
        encounter = meet(alone.state, team, self.parameters.meeting, self.parameters.survival.young)
        if isinstance(encounter, str):
            return None, f"waits: {encounter}"
        del self._alone[name]
        return unite(alone.state, team, encounter, tick.index, forget), "joined"

    def _recognised(self, name: str, tick: Tick, team: State) -> Pose | None:
        """T_team_robot where the robot sees at this tick as many of the team's landmarks as two maps must have in common."""
        alone, rule = self._alone[name], self.parameters.search
        strict = replace(rule, pairs=max(rule.pairs, self.parameters.meeting.pairs))
        for view in tick.views:
            if view.camera in alone.sighted:
                mount = self.setup.mounts[view.camera]
                found = locate(team, (alone.state[0].sight(0, mount), alone.pose(name)), alone.sighted[view.camera], strict)
                if isinstance(found, Place):
                    return found.pose
        return None

    def counters(self, name: str) -> dict[str, int]:
        """What the robot's own filter has counted."""
        return self._alone[name].counters if name in self._alone else {}

    def _begin(self, name: str, tick: Tick) -> bool:
        """Put up a filter in a frame of its own: here, heading along x, level by the first "up"."""
        ups = [v.odometry.gravity for v in tick.views if v.odometry is not None and v.odometry.gravity is not None]
        if not ups:
            return False
        mounts = {camera: mount for camera, mount in self.setup.mounts.items() if mount.robot == name}
        setup = replace(self.setup, mounts=mounts, starts={name: level_start(ups[0])})
        # How high the ground lies is not known in this frame.
        self._alone[name] = self._build(setup, replace(self.parameters, trial=replace(self.parameters.trial, under=np.inf)))
        return True


def level_start(up: Array) -> Start:
    """A robot at the origin, heading along x as seen from above, for which the unit direction (3,) in its body is up: roll and pitch are doubted."""
    z = up / np.linalg.norm(up)
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * FRAME_SIGMA**2
    covariance[3:, 3:] = rotation.T @ np.diag(np.square([LEVEL_SIGMA, LEVEL_SIGMA, FRAME_SIGMA])) @ rotation
    return Start(Pose(rotation, np.zeros(3)), covariance)


def meet(alone: State, team: State, rule: Meeting, young: int) -> Encounter | str:
    """Whether the newcomer's map lies firmly in the team's: the encounter, or why not. Landmarks with fewer sightings than `young` are none."""
    (joint, book), (own_joint, own_book) = team, alone
    ours, theirs = (np.flatnonzero(b.hits[: b.count] >= young) for b in (book, own_book))
    if min(len(ours), len(theirs)) < rule.pairs:
        return "too little in common"
    unlike = dissimilarity(book.look[ours], book.subject[ours], own_book.look[theirs, 0], own_book.subject[theirs])
    row, column = mutual(np.where(unlike < rule.unlike, unlike, np.inf), unlike, rule.ratio)
    order = np.argsort(unlike[row, column], kind="stable")
    ours, theirs = ours[row[order]], theirs[column[order]]
    found = align(_places(own_joint, theirs), _places(joint, ours), rule)
    if isinstance(found, str):
        return found
    return Encounter(found, book.identity[ours[found.pairs]], theirs[found.pairs], rule.same)


def unite(alone: State, team: State, encounter: Encounter, tick: int, forget: Callable[[int, str], None]) -> int:
    """Put a newcomer and its landmarks into the team's state and make the common landmarks one; its number there.

    Of its other landmarks so many come as are its share of the map's room, the latest first; for them the stalest of the team are forgotten.
    """
    (joint, book), (own_joint, own_book) = team, alone
    k, share = len(encounter.own), joint.capacity // (joint.robots + 1)
    # What is in common is not stale, whoever saw it.
    book.last[_numbers(book, encounter.names)] = tick + 1
    rest = np.setdiff1d(np.arange(own_book.count), encounter.own)
    rest = rest[np.lexsort((-own_book.hits[rest], -own_book.last[rest]))][: max(0, min(share - k, joint.capacity - 2 * k))]
    taken = np.concatenate([encounter.own, rest])
    while joint.count > joint.capacity - len(taken):
        forget(book.stalest(), "map full")
    first, common = joint.count, _numbers(book, encounter.names)
    robot = adopt(joint, own_joint, taken, encounter.alignment)
    for landmark in taken.tolist():
        book.add(int(own_book.subject[landmark]), own_book.look[landmark, 0], robot, int(own_book.last[landmark]), int(own_book.hits[landmark]))
    copies = first + np.arange(k)
    joint.update(lambda: _sameness(joint, robot, (common, copies), encounter.same), ITERATIONS, np.inf)
    book.seen(common, book.look[copies, robot], robot, tick)
    for copy in copies[::-1].tolist():
        joint.remove(copy)
        book.remove(copy)
    return robot


def adopt(joint: Joint, own: Joint, landmarks: Indices, alignment: Alignment) -> int:
    """Take in the one robot of another joint state and its landmarks (m,) as they are, the alignment next to unknown (WEAK); the map's last.

    Errors of poses stay what they are in the body; those of landmarks turn with the frame; all move with the alignment's error.
    """
    T, m = alignment.T_team_own, len(landmarks)
    pose, rows = T @ Pose(own.rotation[0], own.translation[0]), own.columns(0, landmarks)
    robot = joint.join(Start(pose, np.zeros((6, 6))))
    joint.correction[robot], joint.lasting[robot] = own.correction[0], own.lasting[0]
    new = joint.count + np.arange(m)
    joint.point[new] = T.apply(own.point[landmarks])
    (rotation, translation, point), (R, t, p) = joint.anchors, own.anchors
    rotation[robot], translation[robot], point[new] = T.rotation @ R[0], T.apply(t[0]), T.apply(p[landmarks])
    joint.count += m
    mine = joint.columns(robot, new)
    turn = np.eye(len(rows))
    for at in range(joint.stride, len(rows), 3):
        turn[at : at + 3, at : at + 3] = T.rotation
    move = np.zeros((len(rows), 4))
    move[:3] = rotation[robot].T @ levers(translation[robot][None], alignment.centre)[0]
    move[3:6, 3] = rotation[robot][2]
    move[joint.stride :] = levers(point[new], alignment.centre).reshape(-1, 4)
    P = turn @ own.P[np.ix_(rows, rows)] @ turn.T + WEAK**2 * move @ alignment.covariance @ move.T
    joint.P[mine], joint.P[:, mine] = 0.0, 0.0
    joint.P[np.ix_(mine, mine)] = 0.5 * (P + P.T)
    return robot


def _sameness(joint: Joint, robot: int, pairs: tuple[Indices, Indices], sigma: float) -> Linear:
    """Two landmarks each (k,) are one: the difference of their places is nothing, up to sigma m."""
    k = len(pairs[0])
    H = np.zeros((3 * k, joint.stride + 6 * k))
    H[:, joint.stride :] = np.concatenate([np.eye(3 * k), -np.eye(3 * k)], axis=1)
    columns = joint.columns(robot, np.concatenate(pairs))
    return Linear(robot, columns, H, (joint.point[pairs[1]] - joint.point[pairs[0]]).ravel(), np.tile(sigma**2 * np.eye(3), (k, 1, 1)))


def _places(joint: Joint, landmarks: Indices) -> tuple[Array, Array]:
    """Means (k, 3) and covariance (3k, 3k) of some landmarks."""
    rows = (joint.base + 3 * landmarks[:, None] + np.arange(3)).ravel()
    return joint.point[landmarks], joint.P[np.ix_(rows, rows)]


def _numbers(book: Landmarks, names: Indices) -> Indices:
    """Identities (k,) → present numbers (k,)."""
    where = {name: i for i, name in enumerate(book.identity[: book.count].tolist())}
    return np.array([where[name] for name in names.tolist()], dtype=np.intp)
