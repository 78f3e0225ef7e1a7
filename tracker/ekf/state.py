"""The joint state of a team and its map: means and ONE covariance of all of them, every cross block kept.

Order of the covariance: robots (six numbers of the pose's right tangent, then three of the correction factor and eight of what lasts of its
odometry's errors, where these are kept), clones (six each: where a robot was at a few earlier ticks; Roumeliotis & Burdick 2002), landmarks (three
each, metres in the world). The store has some room to spare; landmarks fill it from the front, and a removed one is replaced by the last, so that
shrinking, and mostly growing, cost O(n).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from tracker.ekf.gaussian import block_diagonal, robust_weights, solve_positive, subtract, whitened
from tracker.ekf.invariant_error import Means, landmark_shears, pose_charts, retracted
from tracker.ekf.lie_kernels import compose, exponential, logarithm, orthogonal, retract, retraction_jacobian, right_jacobian
from tracker.ekf.measurement_models import CameraPose
from tracker.ekf.odometry_biases import COUNT, BiasModel, bias_corrected
from tracker.geometry import Array, Indices, Pose
from tracker.types import Mount, Start

Found = TypeVar("Found")

Held = tuple[Array, Array, Array, Array, Array]
"""Means before an update: rotations, translations, corrections, landmarks, lasting errors."""

ROOM = 32
"""Landmarks by which the store grows."""


@dataclass(frozen=True, eq=False)
class Linear:
    """k measured directions linearised at the present mean: residual (2k,), H (2k, c) over the state's `columns` (c,), noise (k, 2, 2) rad².

    The first columns are those of `robot` (pose, then what else is kept of it), the next belong to landmarks, the last to the poses of the
    `others` (j,), robots that it sees.
    """

    robot: int
    columns: Indices
    H: Array
    residual: Array
    noise: Array
    others: tuple[int, ...] = ()


class JointState:
    """Means and the joint covariance. Poses are numbered: robots first, then the clones of robot 0, of robot 1, …

    rotation (p, 3, 3), translation (p, 3) m; correction (robots, 3) rad; lasting (robots, 8) (tracker.ekf.odometry_biases); point (capacity, 3) m, of
    which the first `count` are alive.

    mode: "iekf", tangents at the present means; "invariant" (invariant_error.py); or "fej" (Huang, Mourikis, Roumeliotis 2010): Jacobians, and the
    axes of P, are those of first estimates: of a pose where it was last predicted, of a landmark where it was first put.
    """

    def __init__(
        self,
        clones: int,
        capacity: int,
        correction_sigma: tuple[float, float, float] | None,
        mode: str = "iekf",
        persistence: BiasModel | None = None,
    ) -> None:
        self.robots, self.clones, self.capacity, self.count = 0, clones, capacity, 0
        self.invariant, self.first_estimates = mode == "invariant", mode == "fej"
        self.corrected, self.persistent = correction_sigma is not None, persistence is not None
        spread = () if persistence is None else persistence.spread
        self._own_sigma = np.array([*(correction_sigma or ()), *spread])
        self.stride = 6 + len(self._own_sigma)
        self.rotation, self.translation = np.zeros((0, 3, 3)), np.zeros((0, 3))
        self.used = np.zeros(0, dtype=bool)
        self.correction, self.lasting = np.zeros((0, 3)), np.zeros((0, COUNT))
        self.point = np.zeros((capacity, 3))
        self._P = np.zeros((0, 0))
        self._first = (self.rotation, self.translation, np.zeros((capacity, 3))) if self.first_estimates else None

    @property
    def base(self) -> int:
        """The row of the first landmark."""
        return self.robots * (self.stride + 6 * self.clones)

    def join(self, start: Start) -> int:
        """Take in one more robot, which knows nothing of the others yet; returns its number. Clones keep their k, poses are numbered anew."""
        robot, base, n = self.robots, self.base, len(self.P)
        P = np.zeros((len(self._P) + self.stride + 6 * self.clones,) * 2)
        old = np.arange(n)
        new = old + np.where(old < self.stride * robot, 0, self.stride) + np.where(old < base, 0, 6 * self.clones)
        P[np.ix_(new, new)] = self.P
        at = self.stride * robot
        P[at : at + 6, at : at + 6] = start.covariance
        more = np.arange(at + 6, at + self.stride)
        P[more, more] = self._own_sigma**2
        T, empty = start.T_world_robot, self.clones
        self.rotation, self.translation = _longer(self.rotation, self.translation, robot, T, empty)
        if self._first is not None:
            self._first = (*_longer(*self._first[:2], robot, T, empty), self._first[2])
        self.used = np.concatenate([np.insert(self.used, robot, True), np.zeros(empty, dtype=bool)])
        self.correction, self.lasting = (np.concatenate([kept, np.zeros((1, kept.shape[1]))]) for kept in (self.correction, self.lasting))
        self.robots, self._P = robot + 1, P
        return robot

    @property
    def anchors(self) -> Means:
        """Where Jacobians are taken: the means, or the first estimates where the mode is so."""
        return (self.rotation, self.translation, self.point) if self._first is None else self._first

    def sight(self, robot: int, mount: Mount, pose: int | Indices | None = None, anchored: bool = False) -> CameraPose:
        """A camera of a robot, now or at its clones (`pose`, a number, or several for rows), with the correction as it is believed now; `anchored`
        where Jacobians are taken.
        """
        p, T = robot if pose is None else pose, mount.T_body_camera
        rotation, translation, _ = self.anchors if anchored else (self.rotation, self.translation, self.point)
        return CameraPose(rotation[p], translation[p], T.rotation, T.translation, self.correction[robot])

    def covariance(self, robot: int) -> Array:
        """(6, 6) of a robot's right tangent [m, rad] at its mean."""
        at = self.offset(robot)
        P = self.P[at : at + 6, at : at + 6].copy()
        if self._first is None:
            return P
        turn = np.kron(np.eye(2), self.rotation[robot].T @ self._first[0][robot])
        return np.asarray(turn @ P @ turn.T)

    @property
    def P(self) -> Array:
        """The covariance of what is in use, (n, n): a view into the store. Rows of empty clones are zero."""
        n = self.base + 3 * self.count
        return self._P[:n, :n]

    def active(self) -> Indices:
        """The rows of P that stand for something."""
        poses = [np.arange(self.offset(p), self.offset(p) + (self.stride if p < self.robots else 6)) for p in np.flatnonzero(self.used).tolist()]
        return np.concatenate([*poses, np.arange(self.base, self.base + 3 * self.count)])

    def offset(self, pose: int) -> int:
        """The first row of a robot's or clone's pose."""
        return self.stride * pose if pose < self.robots else self.stride * self.robots + 6 * (pose - self.robots)

    def columns(self, robot: int, landmarks: Indices, others: tuple[int, ...] = ()) -> Indices:
        """The rows of a robot (pose, then what else is kept of it), then those of landmarks, three each, then the poses of other robots, six each."""
        own = np.arange(self.offset(robot), self.offset(robot) + self.stride)
        poses = [np.arange(self.offset(other), self.offset(other) + 6) for other in others]
        return np.concatenate([own, (self.base + 3 * landmarks[:, None] + np.arange(3)).ravel(), *poses])

    def clone_slot(self, robot: int, k: int) -> int:
        """The number of the pose that is clone k of a robot."""
        return self.robots + robot * self.clones + k

    def predict(self, robot: int, motion: Pose, Q: Array, scale: Array | None = None) -> None:
        """X⁻ = F X + u, P⁻ = F P Fᵀ + Q for one robot: T_before_now and the covariance (6, 6) of its right tangent.

        scale (6, 6): what one of each of the first six lasting errors makes of the motion, in that tangent; the motion is freed of them.
        """
        pose, G = slice(self.offset(robot), self.offset(robot) + 6), None
        if scale is not None:
            motion, G = bias_corrected(motion, scale, self.lasting[robot, :6])
        self.rotation[robot], self.translation[robot], F = compose(self.rotation[robot], self.translation[robot], motion)
        if self._first is not None:
            R, t = self._first[0][robot].copy(), self._first[1][robot].copy()
            self._first[0][robot], self._first[1][robot] = self.rotation[robot], self.translation[robot]
            # From one first estimate to the next: what updates in between have moved counts as motion.
            F = compose(R, t, Pose(orthogonal(R.T @ self.rotation[robot]), R.T @ (self.translation[robot] - t)))[2]
        if G is not None:
            wide = np.eye(self.stride)
            wide[:6, :6], wide[:6, self.stride - COUNT : self.stride - 2] = F, G
            self._transform(slice(pose.start, pose.start + self.stride), wide)
        else:
            self._transform(pose, F)
        self.P[pose, pose] += Q

    def drift(self, sigma: float) -> None:
        """One step of the corrections' random walk, sigma rad an axis."""
        for i in range(self.robots if self.corrected else 0):
            rows = np.arange(self.offset(i) + 6, self.offset(i) + 9)
            self.P[rows, rows] += sigma**2

    def fade(self, rho: Array) -> None:
        """One step of the lasting errors: of each the share rho (8,) stays, and as much comes anew that its spread stays as it is."""
        for i in range(self.robots if self.persistent else 0):
            rows = slice(self.offset(i) + self.stride - COUNT, self.offset(i) + self.stride)
            self.lasting[i] *= rho
            self._transform(rows, np.diag(rho))
            self.P[rows, rows] += np.diag((1 - rho**2) * self._own_sigma[-COUNT:] ** 2)

    def inflate(self, robot: int, variance: Array) -> None:
        """Add independent doubt to a robot's pose, variance (6,) m² and rad²."""
        rows = np.arange(self.offset(robot), self.offset(robot) + 6)
        self.P[rows, rows] += variance

    def reopened(self, robot: int, variance: Array, attempt: Callable[[], tuple[Found, int, int]], few: int) -> tuple[Found, bool]:
        """What an attempt to find what a robot sees gives, which says beside how many agree and how many are refused. Where these are more than
        those, and than `few`, it is the pose that is wrong (a wheel slipped): it is doubted by variance (6,) m² and rad² for another attempt, and
        the doubt stays if more agree then: whether it did.
        """
        found, agreed, refused = attempt()
        if refused <= max(few, agreed):
            return found, False
        self.inflate(robot, variance)
        again, more, _ = attempt()
        if more > 1.5 * agreed:
            return again, True
        self.inflate(robot, -variance)
        return found, False

    def put(self, robot: int, start: Start) -> None:
        """Put a robot elsewhere: its pose is what `start` says, and has no error in common with anything else any more."""
        rows, T = slice(self.offset(robot), self.offset(robot) + 6), start.T_world_robot
        self.P[rows], self.P[:, rows] = 0.0, 0.0
        self.P[rows, rows] = start.covariance
        for rotation, translation in ((self.rotation, self.translation), self.anchors[:2]):
            rotation[robot], translation[robot] = T.rotation, T.translation

    def clone(self, robot: int, k: int) -> int:
        """Remember the robot's present pose as its clone k, in the place of what was there; returns the number of the pose."""
        slot = self.clone_slot(robot, k)
        to, source = self.offset(slot), self.offset(robot)
        self.rotation[slot], self.translation[slot], self.used[slot] = self.rotation[robot], self.translation[robot], True
        if self._first is not None:
            self._first[0][slot], self._first[1][slot] = self._first[0][robot], self._first[1][robot]
        P = self.P
        P[to : to + 6, :] = P[source : source + 6, :]
        P[:, to : to + 6] = P[:, source : source + 6]
        return slot

    def add(self, point: Array, columns: Indices, G: Array, own: Array) -> int:
        """Grow by a landmark whose error is G (3, c) times that of the state's `columns` plus an own one (3, 3) m²; returns its number.

        Raises ValueError where the map is full.
        """
        if self.count >= self.capacity:
            raise ValueError(f"map holds {self.count} landmarks, needs fewer than {self.capacity}")
        n = self.base + 3 * self.count
        if n + 3 > len(self._P):
            self._P = np.pad(self._P, (0, 3 * ROOM))
        cross = G @ self.P[columns]
        self._P[n : n + 3, :n] = cross
        self._P[:n, n : n + 3] = cross.T
        block = cross[:, columns] @ G.T + own
        self._P[n : n + 3, n : n + 3] = 0.5 * (block + block.T)
        self.point[self.count] = self.anchors[2][self.count] = point
        self.count += 1
        return self.count - 1

    def remove(self, landmark: int) -> None:
        """Forget a landmark (marginalise); the last one takes its number."""
        last = self.count - 1
        hole, tail, n = self.base + 3 * landmark, self.base + 3 * last, self.base + 3 * self.count
        if landmark != last:
            self.point[landmark], self.anchors[2][landmark] = self.point[last], self.anchors[2][last]
            self._P[hole : hole + 3, :n] = self._P[tail:n, :n]
            self._P[:n, hole : hole + 3] = self._P[:n, tail:n]
        self.count = last

    def update(self, linearise: Callable[[], Linear], iterations: int, threshold: float) -> Array:
        """The iterated update with exactly `iterations` linearisations (Bell & Cathey 1993): δ ← K (r(x ⊕ δ) + H J δ), then P.

        `linearise` is asked at the mean of each pass. H is brought to the tangent at the prior by the retraction's Jacobian J, and P to the tangent
        at the posterior when all is done. One iteration is the plain EKF. With the invariant error landmarks go with the robot that sees them; the
        Jacobians are then those of tracker.ekf.invariant_error. `threshold` is that of gaussian.robust_weights, whose weights (k,) of the
        last pass are returned.
        """
        before = (self.rotation.copy(), self.translation.copy(), self.correction.copy(), self.point[: self.count].copy(), self.lasting.copy())
        delta = np.zeros(len(self.P))
        linear = linearise()
        rows = self.P[linear.columns]
        for left in reversed(range(iterations)):
            H, marks = linear.H.copy(), slice(self.stride, len(linear.columns) - 6 * len(linear.others))
            if self._first is None:
                poses = np.delete(np.arange(len(linear.columns)), marks)
                at = linear.columns[poses]
                H[:, poses] = H[:, poses] @ self._chart(before, delta)[np.ix_(at, at)]
            if self.invariant:
                seen = (linear.columns[marks][::3] - self.base) // 3
                shears = landmark_shears(self._means(before), self._means(), linear.robot)[seen]
                H[:, 3:6] += linear.H[:, marks] @ shears.reshape(-1, 3)
            HP = H @ rows
            spread = HP[:, linear.columns] @ H.T
            innovation = linear.residual + H @ delta[linear.columns]
            weights = robust_weights(spread, linear.noise, innovation, threshold)
            S = spread + block_diagonal(linear.noise / weights[:, None, None])
            delta = HP.T @ solve_positive(S, innovation)
            self._retract(before, delta, linear.robot)
            if left:
                linear = linearise()
        self._settle(before, (HP, S), linear.robot)
        if self._first is None:
            chart = self._chart(before, delta)
            for p in range(len(self.used)):
                own = slice(self.offset(p), self.offset(p) + (self.stride if p < self.robots else 6))
                self._transform(own, chart[own, own])
        return weights

    def _settle(self, before: Held, measured: tuple[Array, Array], robot: int) -> None:
        """P after an update, measured = H P and S; with the invariant error the landmarks' errors gain, beside, what those of the robot's rotation
        were times the shears: P ← M P Mᵀ, M = I + B E with B (n, 3) and E the three rows of the rotation, in one pass with the other.
        """
        n = len(self.P)
        A = np.zeros((len(measured[1]), len(self._P)))
        A[:, :n] = whitened(*measured)
        if not (self.invariant and self.count):
            return subtract(self._P, A)
        turn = slice(self.offset(robot) + 3, self.offset(robot) + 6)
        E = self.P[turn] - A[:, turn].T @ A[:, :n]
        B = landmark_shears(self._means(before), self._means(), robot).reshape(-1, 3)
        X, Y = np.zeros((2, len(self._P), 3))
        X[self.base : n], Y[:n] = -B, E.T
        Y[self.base : n] += 0.5 * B @ E[:, turn]
        return subtract(self._P, A, X, Y)

    def _tangents(self, delta: Array) -> tuple[Array, Array, Array]:
        """The parts of a change (n,) that belong to the poses (p, 6), to the corrections (robots, 3 or 0) and to what lasts (robots, 8 or 0)."""
        team = delta[: self.stride * self.robots].reshape(self.robots, self.stride)
        clones = delta[self.stride * self.robots : self.base].reshape(-1, 6)
        split = 9 if self.corrected else 6
        return np.concatenate([team[:, :6], clones]), team[:, 6:split], team[:, split:]

    def _means(self, held: Held | None = None) -> Means:
        """Rotations, translations and landmarks: those of `held`, or as they are now."""
        return (self.rotation, self.translation, self.point[: self.count]) if held is None else (held[0], held[1], held[3])

    def _chart(self, before: Held, delta: Array) -> Array:
        """The retraction's Jacobian for all that comes before the landmarks, (base, base)."""
        poses, corrections, _ = self._tangents(delta)
        J = pose_charts(self._means(before), self._means()) if self.invariant else retraction_jacobian(poses)
        out = np.eye(self.base)
        for p in range(len(poses)):
            at = self.offset(p)
            out[at : at + 6, at : at + 6] = J[p]
        for robot, block in enumerate(right_jacobian(corrections) if self.corrected else ()):
            at = self.offset(robot) + 6
            out[at : at + 3, at : at + 3] = block
        return out

    def _retract(self, before: Held, delta: Array, robot: int) -> None:
        poses, corrections, lasting = self._tangents(delta)
        if self._first is not None:
            turn = np.swapaxes(before[0], 1, 2) @ self._first[0]
            poses = np.concatenate([turn @ poses[:, :3, None], turn @ poses[:, 3:, None]], axis=1)[..., 0]
        moves = delta[self.base :].reshape(-1, 3)
        if self.invariant:
            means = retracted(self._means(before), (poses, moves), exponential(poses[:, 3:]), robot)
            self.rotation, self.translation, self.point[: self.count] = means
        else:
            self.rotation, self.translation = retract(before[0], before[1], poses)
            self.point[: self.count] = before[3] + moves
        if self.corrected:
            self.correction = logarithm(exponential(before[2]) @ exponential(corrections))
        if self.persistent:
            self.lasting = before[4] + lasting

    def _transform(self, rows: slice, F: Array) -> None:
        """P ← F P Fᵀ for the rows and columns of one block."""
        P = self.P
        strip = F @ P[rows, :]
        block = strip[:, rows] @ F.T
        strip[:, rows] = 0.5 * (block + block.T)
        P[rows, :] = strip
        P[:, rows] = strip.T


def _longer(rotation: Array, translation: Array, at: int, T: Pose, empty: int) -> tuple[Array, Array]:
    """Rotations (p, 3, 3) and translations (p, 3) with a pose more before `at`, and empty ones at the end."""
    rotations = np.concatenate([np.insert(rotation, at, T.rotation, axis=0), np.tile(np.eye(3), (empty, 1, 1))])
    return rotations, np.concatenate([np.insert(translation, at, T.translation, axis=0), np.zeros((empty, 3))])
