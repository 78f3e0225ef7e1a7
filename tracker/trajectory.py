"""Scores of robots: absolute and relative trajectory error (Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems")
and consistency (NEES, Bar-Shalom, Li & Kirubarajan 2001, sec. 5.4).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from tracker.geometry import Array, Pose

Poses = Mapping[str, Sequence[Pose | None]]
Covariances = Mapping[str, Sequence[Array | None] | None]

DEGREES_OF_FREEDOM = 6
# An eigenvalue below this share of the largest belongs to a direction that the covariance calls certain.
CERTAIN = 1e-12


@dataclass(frozen=True)
class RobotScore:
    """Sums over robots and frames; `+` merges sequences and RobotScore() is neutral. Ratios are derived last, NaN where undefined.

    robots: those with at least one estimated frame; frames: their estimated frames; absent: frames without an estimate. ate, ate_aligned:
    Σ over robots of the RMSE of position, m. steps, rpe: number and Σ of squares (m²) of relative errors. nees: Σ over nees_frames.
    """

    robots: int = 0
    frames: int = 0
    absent: int = 0
    ate: float = 0.0
    ate_aligned: float = 0.0
    steps: int = 0
    rpe: float = 0.0
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
        """The same after one rigid motion brought the whole team nearest to its truth, m: what an unknown common start costs is gone."""
        return self.ate_aligned / self.robots if self.robots else float("nan")

    @property
    def rpe_m(self) -> float:
        """RMSE over robots and frames of the translation of the relative pose error, m."""
        return float(np.sqrt(self.rpe / self.steps)) if self.steps else float("nan")

    @property
    def nees_per_dof(self) -> float:
        """Mean of ξᵀ Σ⁻¹ ξ over robots and frames, over 6: 1 where the filter knows how wrong it is, more where it is overconfident."""
        return self.nees / (DEGREES_OF_FREEDOM * self.nees_frames) if self.nees_frames else float("nan")

    def to_dict(self) -> dict[str, float | None]:
        """For JSON: plain numbers, None for what is undefined."""
        values = {name: float(getattr(self, name)) for name in ("ate_m", "ate_aligned_m", "rpe_m", "nees_per_dof")}
        return {name: None if np.isnan(value) else value for name, value in values.items()}


def score_robots(truth: Poses, estimate: Poses, covariances: Covariances | None = None, *, delta: int = 1) -> RobotScore:
    """Score T_world_robot, robot → one pose a frame; an estimate may be None where the robot's place was not known yet.

    covariances: robot → (6, 6) of the right tangent [m, rad] a frame, or None, a frame or a robot. A frame whose covariance is singular
    (a robot that was told where it is) has no NEES and is left out of it. delta: frames between the two ends of a relative error.
    Raises ValueError naming robot and frame: a robot without estimates, lists of other lengths, a covariance that is none.
    """
    if delta < 1:
        raise ValueError(f"delta is {delta} frames, needs at least 1")
    score = RobotScore()
    pairs = {robot: _pairs(robot, truth[robot], estimate) for robot in sorted(truth)}
    wanted, given = (np.array([p[i].translation for ps in pairs.values() for p in ps.values()]).reshape(-1, 3) for i in (0, 1))
    alignment = align(given, wanted) if len(given) else Pose.identity()
    for robot, frames in pairs.items():
        score += RobotScore(absent=len(truth[robot]) - len(frames)) + _absolute(frames, alignment) + _relative(frames, delta)
        score += _consistency(robot, frames, (covariances or {}).get(robot), len(truth[robot]))
    return score


Pairs = dict[int, tuple[Pose, Pose]]


def _pairs(robot: str, truth: Sequence[Pose | None], estimates: Poses) -> Pairs:
    """Frame → true and estimated pose, where both are there."""
    if robot not in estimates:
        raise ValueError(f"robot {robot} is in the truth, needs estimates too")
    estimate = estimates[robot]
    if len(estimate) != len(truth):
        raise ValueError(f"robot {robot} has {len(estimate)} estimates, needs {len(truth)}")
    return {k: (t, e) for k, (t, e) in enumerate(zip(truth, estimate, strict=True)) if t is not None and e is not None}


def align(points: Array, onto: Array) -> Pose:
    """The rigid motion that brings `points` (n, 3) nearest to `onto` (n, 3) in the mean of squares (Umeyama 1991, scale 1)."""
    middle, target = points.mean(axis=0), onto.mean(axis=0)
    U, _, Vt = np.linalg.svd((onto - target).T @ (points - middle))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt
    return Pose(R, target - R @ middle)


def _absolute(frames: Pairs, alignment: Pose) -> RobotScore:
    if not frames:
        return RobotScore()
    wanted, given = (np.array([pair[i].translation for pair in frames.values()]) for i in (0, 1))

    def rmse(points: Array) -> float:
        return float(np.sqrt(((points - wanted) ** 2).sum(axis=1).mean()))

    return RobotScore(robots=1, frames=len(frames), ate=rmse(given), ate_aligned=rmse(alignment.apply(given)))


def _relative(frames: Pairs, delta: int) -> RobotScore:
    """E = (T*ₖ⁻¹ T*ₖ₊δ)⁻¹ (Tₖ⁻¹ Tₖ₊δ), Sturm et al. eq. 1, its translation."""
    squares = []
    for k, (true, estimated) in frames.items():
        if k + delta in frames:
            true_later, estimated_later = frames[k + delta]
            error = (true.inverse() @ true_later).inverse() @ (estimated.inverse() @ estimated_later)
            squares.append(float(error.translation @ error.translation))
    return RobotScore(steps=len(squares), rpe=sum(squares))


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
    return RobotScore(nees_frames=number, nees=total)


def _definite(P: Array, name: str) -> bool:
    """Whether P can be inverted. Raises ValueError where it is no covariance."""
    if np.shape(P) != (DEGREES_OF_FREEDOM, DEGREES_OF_FREEDOM) or not np.isfinite(P).all():
        raise ValueError(f"{name} has shape {np.shape(P)}, needs (6, 6) and finite numbers")
    # Metres and radians are brought to one scale by the diagonal, so that a small variance does not look like none.
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
    return low > CERTAIN
