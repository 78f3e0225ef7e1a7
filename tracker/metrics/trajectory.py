"""Scores of robots: absolute and relative trajectory error, and consistency (NEES).

Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems"; Bar-Shalom, Li & Kirubarajan 2001, sec. 5.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import permutations

import numpy as np
from scipy.special import gammaincinv

from tracker.geometry import Array, Pose, rotation_onto

Poses = Mapping[str, Sequence[Pose | None]]
Covariances = Mapping[str, Sequence[Array | None] | None]

DEGREES_OF_FREEDOM = 6
# A smaller share of the largest eigenvalue means a direction without uncertainty.
MIN_EIGENVALUE_SHARE = 1e-12
MEASURES = ("ate_m", "ate_aligned_m", "ate_yaw_m", "rpe_m", "rpe_between_m", "nees_per_dof", "way_m", "ate_share")


@dataclass(frozen=True)
class RobotScore:
    """Sums over robots and frames; `+` merges sequences and RobotScore() is neutral. Ratios are derived last, NaN where undefined.

    robots: those with at least one estimated frame; frames: their estimated frames; absent: frames without an estimate. ate, ate_aligned,
    ate_yaw: Σ over robots of the RMSE of position, m; distance: Σ of the true path lengths, m. steps, rpe: number and Σ of squares (m²) of
    relative errors in time; relative_pairs, between: the same between robots. nees: Σ over nees_frames; runs: sequences with any.
    """

    robots: int = 0
    frames: int = 0
    absent: int = 0
    ate: float = 0.0
    ate_aligned: float = 0.0
    ate_yaw: float = 0.0
    distance: float = 0.0
    steps: int = 0
    rpe: float = 0.0
    relative_pairs: int = 0
    between: float = 0.0
    runs: int = 0
    nees_frames: int = 0
    nees: float = 0.0

    def __add__(self, other: RobotScore) -> RobotScore:
        return RobotScore(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})

    @property
    def ate_m(self) -> float:
        """Mean over robots of the RMSE of position, without alignment, m."""
        return self.ate / self.robots if self.robots else float("nan")

    @property
    def ate_aligned_m(self) -> float:
        """The same after one rigid motion that aligns the whole team with its truth, m: without the error of an unknown common start."""
        return self.ate_aligned / self.robots if self.robots else float("nan")

    @property
    def ate_yaw_m(self) -> float:
        """The same after a rotation about the vertical and a translation of the team: the unobservable directions if gravity is measured."""
        return self.ate_yaw / self.robots if self.robots else float("nan")

    @property
    def way_m(self) -> float:
        """Mean over robots of the true path length over the estimated frames, m."""
        return self.distance / self.robots if self.robots else float("nan")

    @property
    def ate_share(self) -> float:
        """ATE over the path length; undefined for robots that stand still."""
        return self.ate / self.distance if self.distance else float("nan")

    @property
    def rpe_between_m(self) -> float:
        """RMSE over ordered pairs of robots and frames of the other robot's position in the own frame, m."""
        return float(np.sqrt(self.between / self.relative_pairs)) if self.relative_pairs else float("nan")

    @property
    def rpe_m(self) -> float:
        """RMSE over robots and frames of the translation of the relative pose error, m."""
        return float(np.sqrt(self.rpe / self.steps)) if self.steps else float("nan")

    @property
    def nees_per_dof(self) -> float:
        """Mean of ξᵀ Σ⁻¹ ξ over robots and frames, over 6: 1 for a consistent filter, more for an overconfident one."""
        return self.nees / (DEGREES_OF_FREEDOM * self.nees_frames) if self.nees_frames else float("nan")

    @property
    def nees_band(self) -> tuple[float, float]:
        """The interval of nees_per_dof of a consistent filter with 95 % probability: χ² with 6 degrees of freedom per run, over their number.

        Only runs (sequences merged by `+`) are independent: frames are correlated in time, and robots share a map. So a whole run counts as one
        error. The mean of correlated errors varies at most as much as one error, so the interval is too wide for a long run.
        """
        if not self.runs:
            return float("nan"), float("nan")
        freedom = DEGREES_OF_FREEDOM * self.runs
        low, high = 2 * gammaincinv(freedom / 2, [0.025, 0.975]) / freedom
        return float(low), float(high)

    def to_dict(self) -> dict[str, float | None]:
        """JSON values, None for undefined ones."""
        values = {name: float(getattr(self, name)) for name in MEASURES}
        values |= dict(zip(("nees_low", "nees_high"), self.nees_band, strict=True))
        return {name: None if np.isnan(value) else value for name, value in values.items()}


def score_robots(truth: Poses, estimate: Poses, covariances: Covariances | None = None) -> RobotScore:
    """Score T_world_robot, robot → one pose a frame; an estimate is None where the robot's pose is unknown.

    covariances: robot → (6, 6) of the right tangent [m, rad] a frame, or None for a frame or a robot. A frame with a singular covariance
    (an exactly known pose) has no NEES.
    Raises ValueError with robot and frame for a robot without estimates, lists of other lengths, or a matrix that is no covariance.
    """
    parts = score_each(truth, estimate, covariances)
    team = sum(parts.values(), RobotScore())
    pairs = {robot: _pairs(robot, truth[robot], estimate) for robot in sorted(truth)}
    return replace(team + _between(pairs), runs=min(team.runs, 1))


def score_each(truth: Poses, estimate: Poses, covariances: Covariances | None = None) -> dict[str, RobotScore]:
    """As score_robots, a score for each robot; the alignments are those of the whole team."""
    pairs = {robot: _pairs(robot, truth[robot], estimate) for robot in sorted(truth)}
    true_points, points = (np.array([p[i].translation for ps in pairs.values() for p in ps.values()]).reshape(-1, 3) for i in (0, 1))
    alignments = tuple(align(points, true_points, upright) if len(points) else Pose.identity() for upright in (False, True))
    out = {}
    for robot, frames in pairs.items():
        score = RobotScore(absent=len(truth[robot]) - len(frames)) + _absolute(frames, alignments) + _relative(frames)
        out[robot] = score + _consistency(robot, frames, (covariances or {}).get(robot), len(truth[robot]))
    return out


Pairs = dict[int, tuple[Pose, Pose]]


def _pairs(robot: str, truth: Sequence[Pose | None], estimates: Poses) -> Pairs:
    """Frame → true and estimated pose, where both exist."""
    if robot not in estimates:
        raise ValueError(f"robot {robot} is in the truth, needs estimates too")
    estimate = estimates[robot]
    if len(estimate) != len(truth):
        raise ValueError(f"robot {robot} has {len(estimate)} estimates, needs {len(truth)}")
    return {k: (t, e) for k, (t, e) in enumerate(zip(truth, estimate, strict=True)) if t is not None and e is not None}


def align(points: Array, onto: Array, upright: bool = False) -> Pose:
    """The rigid motion that brings `points` (n, 3) nearest to `onto` (n, 3) in the mean of squares (Umeyama 1991, scale 1).

    upright: among those that rotate about z alone.
    """
    R = rotation_onto(points, onto, upright)
    return Pose(R, onto.mean(axis=0) - R @ points.mean(axis=0))


def _absolute(frames: Pairs, alignments: tuple[Pose, ...]) -> RobotScore:
    if not frames:
        return RobotScore()
    true_points, estimated = (np.array([pair[i].translation for pair in frames.values()]) for i in (0, 1))

    def rmse(points: Array) -> float:
        return float(np.sqrt(((points - true_points) ** 2).sum(axis=1).mean()))

    aligned, yaw = (rmse(alignment.apply(estimated)) for alignment in alignments)
    distance = float(np.linalg.norm(np.diff(true_points, axis=0), axis=1).sum())
    return RobotScore(robots=1, frames=len(frames), ate=rmse(estimated), ate_aligned=aligned, ate_yaw=yaw, distance=distance)


def _relative(frames: Pairs) -> RobotScore:
    """E = (T*ₖ⁻¹ T*ₖ₊₁)⁻¹ (Tₖ⁻¹ Tₖ₊₁), Sturm et al. eq. 1, its translation."""
    squares = []
    for k, (true, estimated) in frames.items():
        if k + 1 in frames:
            true_later, estimated_later = frames[k + 1]
            error = (true.inverse() @ true_later).inverse() @ (estimated.inverse() @ estimated_later)
            squares.append(float(error.translation @ error.translation))
    return RobotScore(steps=len(squares), rpe=sum(squares))


def _between(pairs: Mapping[str, Pairs]) -> RobotScore:
    """The translation of E = (T*ᵢ⁻¹ T*ⱼ)⁻¹ (Tᵢ⁻¹ Tⱼ) at a frame, for robots i ≠ j; _relative is the same in time."""
    number, total = 0, 0.0
    for one, other in permutations(pairs.values(), 2):
        for k in one.keys() & other.keys():
            true, estimated = (one[k][i].inverse().apply(other[k][i].translation[None])[0] for i in (0, 1))
            number, total = number + 1, total + float(((estimated - true) ** 2).sum())
    return RobotScore(relative_pairs=number, between=total)


def _consistency(robot: str, frames: Pairs, covariances: Sequence[Array | None] | None, length: int) -> RobotScore:
    """ξᵀ Σ⁻¹ ξ with ξ = log(T_estimate⁻¹ T_truth)."""
    if covariances is None:
        return RobotScore()
    if len(covariances) != length:
        raise ValueError(f"robot {robot} has {len(covariances)} covariances, needs {length}")
    number, total = 0, 0.0
    for k, (true, estimated) in frames.items():
        P = covariances[k]
        if P is None or not _definite(P, f"covariance of robot {robot} in frame {k}"):
            continue
        xi = (estimated.inverse() @ true).log()
        number += 1
        total += float(xi @ np.linalg.solve(P, xi))
    return RobotScore(nees_frames=number, nees=total, runs=min(number, 1))


def _definite(P: Array, name: str) -> bool:
    """Whether P can be inverted. Raises ValueError if it is no covariance."""
    if np.shape(P) != (DEGREES_OF_FREEDOM, DEGREES_OF_FREEDOM) or not np.isfinite(P).all():
        raise ValueError(f"{name} has shape {np.shape(P)}, needs (6, 6) and finite numbers")
    # The diagonal scales metres and radians alike, so that a small variance is not taken for a singular matrix.
    scale = np.sqrt(np.diag(P).clip(min=0))
    if not (scale > 0).all():
        if (np.diag(P) < 0).any():
            raise ValueError(f"{name} has a variance of {np.diag(P).min():.3g}, needs at least 0")
        return False
    correlation = P / np.outer(scale, scale)
    if np.abs(correlation - correlation.T).max() > 1e-6:
        raise ValueError(f"{name} differs from its transpose, needs to be symmetric")
    low = float(np.linalg.eigvalsh(correlation)[0])
    if low < -1e-6:
        raise ValueError(f"{name} has an eigenvalue below 0 ({low:.3g} of its scale), needs none")
    return low > MIN_EIGENVALUE_SHARE
