"""How one map lies in another: yaw and translation between two sets of landmarks that are partly the same, with wrong pairs among them.

Both maps know from gravity which way is up, so that four numbers are left. Every two pairs give a hypothesis; the one that most pairs agree with
is made better by generalised least squares with the whole covariance of both maps, and pairs that the others speak against are taken out one by one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.gaussian import gate
from tracker.geometry import Array, Pose, rotation_z
from tracker.landmarks import Indices


@dataclass(frozen=True)
class Meeting:
    """When two maps count as one. pairs: landmarks in common at least; share: of the pairs that look alike, those that must agree; unlike, ratio: how
    much alike a pair must look, as in association.Gate; same m: how far apart two estimates of one landmark may lie beyond their covariances
    (seen from two sides, the corner of a thing is not quite the same place); probability: of the chi-square tests, to pass where all is right; loose
    m, rad: largest standard deviations of the alignment; apart m: the two pairs of a hypothesis lie so far apart; limit: best pairs that are used.
    """

    pairs: int = 10
    share: float = 0.4
    unlike: float = 0.4
    ratio: float = 0.85
    same: float = 0.02
    probability: float = 0.999
    loose: tuple[float, float] = (0.3, 0.05)
    apart: float = 0.5
    limit: int = 60

    def __post_init__(self) -> None:
        if self.pairs < 3:
            raise ValueError(f"pairs is {self.pairs}, needs at least 3")
        if not 0 < self.share <= 1:
            raise ValueError(f"share is {self.share}, needs more than 0 and at most 1")


@dataclass(frozen=True, eq=False)
class Alignment:
    """T_team_own; covariance (4, 4) of its error, m along the axes of the team's frame and rad about "up" through centre (3,) m of that frame;
    pairs (k,): those that agree.
    """

    T_team_own: Pose
    covariance: Array
    centre: Array
    pairs: Indices


def levers(points: Array, centre: Array) -> Array:
    """(n, 3) m → (n, 3, 4): how places move with an alignment's error, a translation and a turn about "up" through the centre."""
    out = np.zeros((len(points), 3, 4))
    out[:, :, :3] = np.eye(3)
    out[:, 0, 3], out[:, 1, 3] = -(points[:, 1] - centre[1]), points[:, 0] - centre[0]
    return out


def align(own: tuple[Array, Array], team: tuple[Array, Array], rule: Meeting) -> Alignment | str:
    """own, team: places (k, 3) m and their covariance (3k, 3k) m² of the same k landmarks as they should be, best pair first. What is wrong where
    they do not fit: too few agree, the whole fails its chi-square test, or the alignment is not sharp enough.
    """
    k = min(len(own[0]), rule.limit)
    own, team = ((places[:k], P[: 3 * k, : 3 * k]) for places, P in (own, team))
    if k < rule.pairs:
        return "too little in common"
    agreed = _consensus(own, team, rule)
    needed = max(rule.pairs, int(np.ceil(rule.share * k)))
    while len(agreed) >= needed:
        rows = (3 * agreed[:, None] + np.arange(3)).ravel()
        T, C, odds, misfit = _least_squares((own[0][agreed], own[1][np.ix_(rows, rows)]), (team[0][agreed], team[1][np.ix_(rows, rows)]), rule.same)
        worst = int(odds.argmax())
        if misfit < gate(3 * len(agreed) - 4, rule.probability) and odds[worst] < gate(3, rule.probability):
            # In a straight line one above the other, landmarks do not tell the yaw.
            sharp = np.sqrt(np.diag(C).clip(0)) < np.repeat(rule.loose, (3, 1))
            return Alignment(T, C, team[0][agreed].mean(axis=0), agreed) if sharp.all() else "alignment not sharp"
        # Far off, several go at once: one by one would take as many inversions.
        several = int((odds > gate(3, rule.probability)).sum()) // 4
        agreed = np.delete(agreed, np.argsort(odds, kind="stable")[-max(1, several) :])
    return "places disagree"


def _consensus(own: tuple[Array, Array], team: tuple[Array, Array], rule: Meeting) -> Indices:
    """The pairs that agree with the best of the hypotheses that any two of the pairs make; all are tried, so that nothing is drawn."""
    a, b, k = own[0], team[0], len(own[0])
    blocks = [P.reshape(k, 3, k, 3)[np.arange(k), :, np.arange(k)] for _, P in (own, team)]
    # The larger axis of both together is a bound that does not depend on the yaw.
    reach2: Array = np.linalg.eigvalsh(blocks[0])[:, -1] + np.linalg.eigvalsh(blocks[1])[:, -1] + rule.same**2
    i, j = np.triu_indices(k, 1)
    do, dt, slack = a[j] - a[i], b[j] - b[i], 3 * (np.sqrt(reach2[i]) + np.sqrt(reach2[j]))
    lo, lt = np.hypot(do[:, 0], do[:, 1]), np.hypot(dt[:, 0], dt[:, 1])
    sound = (np.minimum(lo, lt) > rule.apart) & (np.abs(lo - lt) < slack) & (np.abs(do[:, 2] - dt[:, 2]) < slack)
    i, j, do, dt = i[sound], j[sound], do[sound], dt[sound]
    if len(i) == 0:
        return np.zeros(0, dtype=np.intp)
    yaw = np.arctan2(dt[:, 1], dt[:, 0]) - np.arctan2(do[:, 1], do[:, 0])
    turn = np.stack([rotation_z(y) for y in yaw])
    shift = (b[i] + b[j] - ((a[i] + a[j])[:, None] @ np.swapaxes(turn, 1, 2))[:, 0]) / 2
    off2 = ((b - a @ np.swapaxes(turn, 1, 2) - shift[:, None]) ** 2).sum(axis=2)
    # A hypothesis errs by about as much as the two pairs that it comes from.
    odds = off2 / (reach2 + (reach2[i] + reach2[j])[:, None] / 2) / gate(3, rule.probability)
    best = int(np.minimum(odds, 1).sum(axis=1).argmin())
    return np.flatnonzero(odds[best] < 1)


def _least_squares(own: tuple[Array, Array], team: tuple[Array, Array], same: float) -> tuple[Pose, Array, Array, float]:
    """Gauss-Newton for team = T own with covariances of both: T, its covariance (4, 4) about the middle of team's places, for each pair (k,) the
    squared Mahalanobis distance to what all others say of it, and the whole sum of squares.
    """
    a, b = own[0], team[0]
    centre, middle = b.mean(axis=0), a.mean(axis=0)
    da, db = a - middle, b - centre
    yaw = float(np.arctan2((da[:, 0] * db[:, 1] - da[:, 1] * db[:, 0]).sum(), (da[:, :2] * db[:, :2]).sum()))
    shift, k = centre - rotation_z(yaw) @ middle, len(a)
    for _ in range(3):
        R = rotation_z(yaw)
        placed = a @ R.T + shift
        turned = (R @ own[1].reshape(k, 3, k, 3).transpose(0, 2, 1, 3) @ R.T).transpose(0, 2, 1, 3).reshape(3 * k, 3 * k)
        W = np.linalg.inv(turned + team[1] + same**2 * np.eye(3 * k))
        A, r = levers(placed, centre).reshape(-1, 4), (b - placed).ravel()
        C: Array = np.asarray(np.linalg.inv(A.T @ W @ A), dtype=np.float64)
        change = C @ A.T @ W @ r
        yaw += float(change[3])
        shift = change[:3] + centre + rotation_z(float(change[3])) @ (shift - centre)
    # With the four numbers taken out: r'V r is the misfit, and (V r)ₖ with V's block is pair k against all others.
    V = W - W @ A @ C @ A.T @ W
    force = (V @ r).reshape(k, 3)
    blocks = V.reshape(k, 3, k, 3)[np.arange(k), :, np.arange(k)]
    odds: Array = (force * np.linalg.solve(blocks, force[..., None])[..., 0]).sum(axis=1)
    return Pose(rotation_z(yaw), shift), C, odds, float(r @ V @ r)
