"""The joint state of a team and its map: the means of robots, clones and landmarks, and one covariance with all cross-covariances.

Order of the covariance: robots, clones, landmarks. A robot has six numbers of the pose's right tangent. Three of the correction factor and
nine odometry biases follow where these are estimated. A clone has six: a robot's pose at an earlier tick (Roumeliotis & Burdick 2002).
A landmark has three, metres in the world. The array is larger than the state. Landmarks fill it from the front, and the last one
replaces a removed one, so that adding and removing cost O(n).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from tracker.ekf.gaussian import block_diagonal, robust_weights, solve_positive, subtract, whitened
from tracker.ekf.lie_kernels import compose, exponential, logarithm, orthogonal, retract, retraction_jacobian, right_jacobian
from tracker.ekf.measurement_models import CameraPose
from tracker.ekf.odometry_biases import BIASES, MOTION_BIASES, BiasModel, bias_corrected
from tracker.geometry import Array, Indices, Pose
from tracker.types import Mount, Start

Outcome = TypeVar("Outcome")

SPARE_LANDMARKS = 32
"""Landmarks by which the array grows."""


class Means(NamedTuple):
    """Rotations (p, 3, 3), translations (p, 3) m and landmarks (n, 3) m."""

    rotation: Array
    translation: Array
    point: Array


class PriorMeans(NamedTuple):
    """Means before an update: as those of JointState, with the landmarks in the map alone."""

    rotation: Array
    translation: Array
    correction: Array
    point: Array
    odometry_bias: Array


@dataclass(frozen=True, eq=False)
class LinearizedMeasurement:
    """k measured directions linearised at the present state.

    residual (2k,), H (2k, c) over the state's `columns` (c,), noise (k, 2, 2) rad². The columns are those of a robot, then those of landmarks,
    then the poses of other robots that it sees.
    """

    columns: Indices
    H: Array
    residual: Array
    noise: Array


class JointState:
    """Means and the joint covariance. Poses are numbered: robots first, then the clones of robot 0, of robot 1, …

    rotation (p, 3, 3), translation (p, 3) m; correction (robots, 3) rad; odometry_bias (robots, 9) (odometry_biases.py); point (capacity, 3) m, of
    which the first `count` are in the map.

    mode "iekf": tangents at the present means. "fej": first-estimates Jacobians (Huang, Mourikis, Roumeliotis 2010), which also define the axes
    of P. A pose's first estimate is its last prediction, a landmark's its initial position.
    """

    def __init__(
        self,
        clones: int,
        capacity: int,
        correction_sigma: tuple[float, float, float] | None,
        mode: str = "iekf",
        bias_model: BiasModel | None = None,
    ) -> None:
        self.robots, self.clones, self.capacity, self.count = 0, clones, capacity, 0
        self.first_estimates = mode == "fej"
        self.has_correction, self.has_odometry_bias = correction_sigma is not None, bias_model is not None
        self._extra_sigma = np.array([*(correction_sigma or ()), *(() if bias_model is None else bias_model.sigmas)])
        self.stride = 6 + len(self._extra_sigma)
        self.rotation, self.translation = np.zeros((0, 3, 3)), np.zeros((0, 3))
        self.used = np.zeros(0, dtype=bool)
        self.correction, self.odometry_bias = np.zeros((0, 3)), np.zeros((0, BIASES))
        self.point = np.zeros((capacity, 3))
        self._P = np.zeros((0, 0))
        self._first = Means(self.rotation, self.translation, np.zeros((capacity, 3))) if self.first_estimates else None

    @property
    def base(self) -> int:
        """The row of the first landmark."""
        return self.robots * (self.stride + 6 * self.clones)

    def add_robot(self, start: Start) -> int:
        """Add a robot that is uncorrelated with all others; returns its number. Clones keep their k, poses are renumbered."""
        robot, base, n = self.robots, self.base, len(self.P)
        P = np.zeros((len(self._P) + self.stride + 6 * self.clones,) * 2)
        old = np.arange(n)
        new = old + np.where(old < self.stride * robot, 0, self.stride) + np.where(old < base, 0, 6 * self.clones)
        P[np.ix_(new, new)] = self.P
        at = self.stride * robot
        P[at : at + 6, at : at + 6] = start.covariance
        more = np.arange(at + 6, at + self.stride)
        P[more, more] = self._extra_sigma**2
        T, empty = start.T_world_robot, self.clones
        self.rotation, self.translation = _with_pose_inserted(self.rotation, self.translation, robot, T, empty)
        if self._first is not None:
            self._first = Means(*_with_pose_inserted(*self._first[:2], robot, T, empty), self._first.point)
        self.used = np.concatenate([np.insert(self.used, robot, True), np.zeros(empty, dtype=bool)])
        self.correction, self.odometry_bias = (np.concatenate([kept, np.zeros((1, kept.shape[1]))]) for kept in (self.correction, self.odometry_bias))
        self.robots, self._P = robot + 1, P
        return robot

    @property
    def linearization_points(self) -> Means:
        """Where Jacobians are taken: the present means, or the first estimates in the mode "fej"."""
        return Means(self.rotation, self.translation, self.point) if self._first is None else self._first

    def camera_pose(self, robot: int, mount: Mount, pose: int | Indices | None = None, for_jacobians: bool = False) -> CameraPose:
        """A camera of a robot, at its present pose or at `pose`: the number of a clone, or numbers (n,) for n rows.

        for_jacobians: at the linearization points. The correction is the present estimate.
        """
        p, T = robot if pose is None else pose, mount.T_body_camera
        rotation, translation = self.linearization_points[:2] if for_jacobians else (self.rotation, self.translation)
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
        """The covariance of the state, (n, n): a view into the array. Rows of unused clones are zero."""
        n = self.base + 3 * self.count
        return self._P[:n, :n]

    def active(self) -> Indices:
        """The rows of P that belong to robots, used clones and landmarks."""
        poses = [np.arange(self.offset(p), self.offset(p) + (self.stride if p < self.robots else 6)) for p in np.flatnonzero(self.used).tolist()]
        return np.concatenate([*poses, np.arange(self.base, self.base + 3 * self.count)])

    def offset(self, pose: int) -> int:
        """The first row of a robot's or clone's pose."""
        return self.stride * pose if pose < self.robots else self.stride * self.robots + 6 * (pose - self.robots)

    def columns(self, robot: int, landmarks: Indices, others: tuple[int, ...] = ()) -> Indices:
        """The rows of a robot, then of landmarks, three each, then of the poses of other robots, six each."""
        own = np.arange(self.offset(robot), self.offset(robot) + self.stride)
        poses = [np.arange(self.offset(other), self.offset(other) + 6) for other in others]
        return np.concatenate([own, (self.base + 3 * landmarks[:, None] + np.arange(3)).ravel(), *poses])

    def clone_slot(self, robot: int, k: int) -> int:
        """The pose number of clone k of a robot."""
        return self.robots + robot * self.clones + k

    def predict(self, robot: int, motion: Pose, Q: Array, scale: Array | None = None) -> None:
        """X⁻ = F X + u, P⁻ = F P Fᵀ + Q for one robot: the motion T_before_now and its covariance Q (6, 6) in the right tangent.

        scale (6, 7): maps the odometry biases of the motion to that tangent; the motion is corrected for them.
        """
        pose, G = slice(self.offset(robot), self.offset(robot) + 6), None
        if scale is not None:
            motion, G = bias_corrected(motion, scale, self.odometry_bias[robot, :MOTION_BIASES])
        self.rotation[robot], self.translation[robot], F = compose(self.rotation[robot], self.translation[robot], motion)
        if self._first is not None:
            R, t = self._first[0][robot].copy(), self._first[1][robot].copy()
            self._first[0][robot], self._first[1][robot] = self.rotation[robot], self.translation[robot]
            # The motion leads from one first estimate to the next, and so includes the updates in between.
            F = compose(R, t, Pose(orthogonal(R.T @ self.rotation[robot]), R.T @ (self.translation[robot] - t)))[2]
        if G is not None:
            wide = np.eye(self.stride)
            first = self.stride - BIASES
            wide[:6, :6], wide[:6, first : first + MOTION_BIASES] = F, G
            self._transform(slice(pose.start, pose.start + self.stride), wide)
        else:
            self._transform(pose, F)
        self.P[pose, pose] += Q

    def add_correction_noise(self, sigma: float) -> None:
        """One step of the corrections' random walk, sigma rad per axis."""
        for i in range(self.robots if self.has_correction else 0):
            rows = np.arange(self.offset(i) + 6, self.offset(i) + 9)
            self.P[rows, rows] += sigma**2

    def decay_biases(self, rho: Array) -> None:
        """One step of the odometry biases: each is multiplied by its factor rho (9,), and noise keeps its stationary variance."""
        for i in range(self.robots if self.has_odometry_bias else 0):
            rows = slice(self.offset(i) + self.stride - BIASES, self.offset(i) + self.stride)
            self.odometry_bias[i] *= rho
            self._transform(rows, np.diag(rho))
            self.P[rows, rows] += np.diag((1 - rho**2) * self._extra_sigma[-BIASES:] ** 2)

    def inflate(self, robot: int, variance: Array) -> None:
        """Add an independent variance (6,) m² and rad² to a robot's pose."""
        rows = np.arange(self.offset(robot), self.offset(robot) + 6)
        self.P[rows, rows] += variance

    def diffuse(self, landmarks: Indices, variance: Array) -> None:
        """Add an independent variance (k,) m² per axis to landmarks (k,), each at most once."""
        rows = self.base + 3 * landmarks[:, None] + np.arange(3)
        self.P[rows, rows] += variance[:, None]

    def retry_with_inflation(self, robot: int, variance: Array, attempt: Callable[[], tuple[Outcome, int, int]], few: int) -> tuple[Outcome, bool]:
        """The result of an attempt at association, repeated with an inflated pose covariance if most matches fail the gate.

        `attempt` returns its result, the number of accepted matches and that of rejected ones. The pose may be wrong, as after a wheel slip, if
        the rejected ones are more than the accepted ones and than `few`. Then its covariance is inflated by variance (6,) m² and rad² for a second
        attempt. The inflation stays if that one accepts 1.5 times as many. Returns the result and whether the inflation stays.
        """
        found, agreed, rejected = attempt()
        if rejected <= max(few, agreed):
            return found, False
        self.inflate(robot, variance)
        again, more, _ = attempt()
        if more > 1.5 * agreed:
            return again, True
        self.inflate(robot, -variance)
        return found, False

    def reset_pose(self, robot: int, start: Start) -> None:
        """Replace a robot's pose and covariance by `start`, and remove all its correlations."""
        rows, T = slice(self.offset(robot), self.offset(robot) + 6), start.T_world_robot
        self.P[rows], self.P[:, rows] = 0.0, 0.0
        self.P[rows, rows] = start.covariance
        for rotation, translation in ((self.rotation, self.translation), self.linearization_points[:2]):
            rotation[robot], translation[robot] = T.rotation, T.translation

    def clone(self, robot: int, k: int) -> int:
        """Copy the robot's present pose to its clone k, and overwrite the old one; returns the number of the pose."""
        slot = self.clone_slot(robot, k)
        to, source = self.offset(slot), self.offset(robot)
        self.rotation[slot], self.translation[slot], self.used[slot] = self.rotation[robot], self.translation[robot], True
        if self._first is not None:
            self._first[0][slot], self._first[1][slot] = self._first[0][robot], self._first[1][robot]
        P = self.P
        P[to : to + 6, :] = P[source : source + 6, :]
        P[:, to : to + 6] = P[:, source : source + 6]
        return slot

    def add_landmark(self, point: Array, columns: Indices, G: Array, own: Array) -> int:
        """Add a landmark; its error is G (3, c) times that of the state's `columns` plus an independent one of covariance `own` (3, 3) m².

        Returns its number. Raises ValueError if the map is full.
        """
        if self.count >= self.capacity:
            raise ValueError(f"map holds {self.count} landmarks, needs fewer than {self.capacity}")
        n = self.base + 3 * self.count
        if n + 3 > len(self._P):
            self._P = np.pad(self._P, (0, 3 * SPARE_LANDMARKS))
        cross = G @ self.P[columns]
        self._P[n : n + 3, :n] = cross
        self._P[:n, n : n + 3] = cross.T
        block = cross[:, columns] @ G.T + own
        self._P[n : n + 3, n : n + 3] = 0.5 * (block + block.T)
        self.point[self.count] = self.linearization_points[2][self.count] = point
        self.count += 1
        return self.count - 1

    def remove_landmark(self, landmark: int) -> None:
        """Marginalise a landmark; the last one takes its number."""
        last = self.count - 1
        hole, tail, n = self.base + 3 * landmark, self.base + 3 * last, self.base + 3 * self.count
        if landmark != last:
            self.point[landmark], self.linearization_points[2][landmark] = self.point[last], self.linearization_points[2][last]
            self._P[hole : hole + 3, :n] = self._P[tail:n, :n]
            self._P[:n, hole : hole + 3] = self._P[:n, tail:n]
        self.count = last

    def update(self, linearize: Callable[[], LinearizedMeasurement], iterations: int, threshold: float) -> Array:
        """The iterated update with exactly `iterations` linearisations (Bell & Cathey 1993): δ ← K (r(x ⊕ δ) + H J δ), then P.

        `linearize` is called at the mean of each pass. The retraction's Jacobian J brings H to the tangent at the prior, and at the end P to that at
        the posterior. One iteration is the plain EKF. `threshold` is that of gaussian.robust_weights. Returns the weights (k,) of the last pass.
        """
        means = (self.rotation, self.translation, self.correction, self.point[: self.count], self.odometry_bias)
        before = PriorMeans(*(array.copy() for array in means))
        delta = np.zeros(len(self.P))
        linear = linearize()
        rows = self.P[linear.columns]
        for left in reversed(range(iterations)):
            H = linear.H.copy()
            if self._first is None:
                poses = np.flatnonzero(linear.columns < self.base)
                at = linear.columns[poses]
                H[:, poses] = H[:, poses] @ self._reset_jacobian(delta)[np.ix_(at, at)]
            HP = H @ rows
            HPH = HP[:, linear.columns] @ H.T
            innovation = linear.residual + H @ delta[linear.columns]
            weights = robust_weights(HPH, linear.noise, innovation, threshold)
            S = HPH + block_diagonal(linear.noise / weights[:, None, None])
            delta = HP.T @ solve_positive(S, innovation)
            self._retract(before, delta)
            if left:
                linear = linearize()
        A = np.zeros((len(S), len(self._P)))
        A[:, : len(self.P)] = whitened(HP, S)
        subtract(self._P, A)
        if self._first is None:
            reset = self._reset_jacobian(delta)
            for p in range(len(self.used)):
                own = slice(self.offset(p), self.offset(p) + (self.stride if p < self.robots else 6))
                self._transform(own, reset[own, own])
        return weights

    def _split_change(self, delta: Array) -> tuple[Array, Array, Array]:
        """A change (n,) split into poses (p, 6), corrections (robots, 3 or 0) and odometry biases (robots, 9 or 0)."""
        team = delta[: self.stride * self.robots].reshape(self.robots, self.stride)
        clones = delta[self.stride * self.robots : self.base].reshape(-1, 6)
        split = 9 if self.has_correction else 6
        return np.concatenate([team[:, :6], clones]), team[:, 6:split], team[:, split:]

    def _reset_jacobian(self, delta: Array) -> Array:
        """The retraction's Jacobian of all states before the landmarks, (base, base)."""
        poses, corrections, _ = self._split_change(delta)
        J = retraction_jacobian(poses)
        out = np.eye(self.base)
        for p in range(len(poses)):
            at = self.offset(p)
            out[at : at + 6, at : at + 6] = J[p]
        for robot, block in enumerate(right_jacobian(corrections) if self.has_correction else ()):
            at = self.offset(robot) + 6
            out[at : at + 3, at : at + 3] = block
        return out

    def _retract(self, before: PriorMeans, delta: Array) -> None:
        """Set the means to those before ⊞ a change (n,)."""
        poses, corrections, odometry_bias = self._split_change(delta)
        if self._first is not None:
            turn = np.swapaxes(before.rotation, 1, 2) @ self._first.rotation
            poses = np.concatenate([turn @ poses[:, :3, None], turn @ poses[:, 3:, None]], axis=1)[..., 0]
        self.rotation, self.translation = retract(before.rotation, before.translation, poses)
        self.point[: self.count] = before.point + delta[self.base :].reshape(-1, 3)
        if self.has_correction:
            self.correction = logarithm(exponential(before.correction) @ exponential(corrections))
        if self.has_odometry_bias:
            self.odometry_bias = before.odometry_bias + odometry_bias

    def _transform(self, rows: slice, F: Array) -> None:
        """P ← F P Fᵀ for the rows and columns of one block."""
        P = self.P
        strip = F @ P[rows, :]
        block = strip[:, rows] @ F.T
        strip[:, rows] = 0.5 * (block + block.T)
        P[rows, :] = strip
        P[:, rows] = strip.T


def _with_pose_inserted(rotation: Array, translation: Array, at: int, T: Pose, empty: int) -> tuple[Array, Array]:
    """Rotations (p, 3, 3) and translations (p, 3) with T inserted at index `at`, and `empty` identity poses appended."""
    rotations = np.concatenate([np.insert(rotation, at, T.rotation, axis=0), np.tile(np.eye(3), (empty, 1, 1))])
    return rotations, np.concatenate([np.insert(translation, at, T.translation, axis=0), np.zeros((empty, 3))])
