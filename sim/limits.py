"""How good any tracker could have been on the same footage: what stands beside its scores.

The bound of the robots' places is the posterior Cramér-Rao bound (Van Trees 1968; Tichavský, Muravchik, Nehorai 1998) of the whole problem: all poses
of the team and all landmarks, their places unknown, from starts, odometry, "up" and bearings, of each other too, with Jacobians at the truth. It
holds for errors that are as the measurements' covariances say, and for who is told which landmark is which: nobody can do better.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sim import cliques
from sim.footage import Footage
from sim.landmarks import whose
from sim.target_limits import target_bound
from tracker import cramer_rao
from tracker.bearings import Sight, jacobians, robot_jacobians
from tracker.evaluation import who_counts
from tracker.geometry import Array, Pose, skew, tangent_basis
from tracker.measurements import Companions, Mount, Odometry, Sightings, Survey, View

MOMENTS = 5
"""Frames, evenly spread, at which the bound is taken; the errors of a run are the mean of squares over them."""
FAINT = 1e-9


def limits(footage: Footage, graphs: Path | None = None, survey: Survey | None = None) -> dict[str, Any]:
    """visible_recall: the share of all true places at which somebody stood whom some view had shown lately: nobody can follow whom no robot sees.
    ate_bound_m: the least mean error of the robots' places, m; in pictures, where no landmark is known as such, for the sightings of a tracker's
    `survey` (cramer_rao.surveyed). target_bound_m: of people's places, m, where it is known whose boxes are whose (not in real sequences).
    clique_gap: by what share the tracker's cliques weigh less than the best, where it left its graphs in the folder `graphs`. What is not known is
    left out.
    """
    out: dict[str, Any] = {"visible_recall": visible_recall(footage)}
    if (bound := ate_bound(footage, survey)) is not None:
        out["ate_bound_m"] = bound
    if (bound := target_bound(footage)) is not None:
        out["target_bound_m"] = bound
    if graphs is not None and (gap := cliques.gap(graphs)) is not None:
        out["clique_gap"] = gap
    return out


def visible_recall(footage: Footage) -> float | None:
    """As in `limits`; None where nobody was there."""
    counts = who_counts(footage.truth, footage.setup.period)
    total = sum(len(c) for c in counts)
    return float(sum(int(np.sum(c)) for c in counts)) / total if total else None


def ate_bound(footage: Footage, survey: Survey | None = None) -> float | None:
    """As in `limits`; None for runs without landmarks, and where odometry is made worse than it says."""
    troubles = footage.case.troubles
    moving = list(footage.setup.anchored_robots)
    if not moving or troubles.slip or troubles.kidnapped or troubles.skew:
        return None
    if footage.landmarks is None:
        if survey is None:
            return None
        return cramer_rao.surveyed(footage.setup, [t.T_world_robot for t in footage.truth], footage.in_memory().odometry(), survey)
    problem = _Problem(footage, moving)
    last = len(footage.ticks) - 1
    ends = sorted({round(last * k / MOMENTS) for k in range(1, MOMENTS + 1)} - {0}) or [0]
    for k in range(last + 1):
        problem.add(k)
        if k in ends:
            problem.take(k)
    return problem.error()


class _Problem:
    """The information about the poses of all frames and, by landmark, what ties it to them. Unknowns of pose: 6 a robot and frame, right tangent."""

    def __init__(self, footage: Footage, moving: list[str]) -> None:
        assert footage.landmarks is not None
        self.footage, self.moving, self.landmarks = footage, moving, footage.landmarks
        n = 6 * len(moving) * len(footage.ticks)
        self.J = np.zeros((n, n))
        self.cross = np.zeros((n, len(self.landmarks), 3))
        self.own = np.tile(FAINT * np.eye(3), (len(self.landmarks), 1, 1))
        self._squares: list[Array] = []

    def _at(self, k: int, robot: str) -> slice:
        first = 6 * (k * len(self.moving) + self.moving.index(robot))
        return slice(first, first + 6)

    def add(self, k: int) -> None:
        """What is measured at a frame."""
        for view in self.footage.ticks[k].views:
            mount = self.footage.setup.mounts[view.camera]
            if mount.robot not in self.moving:
                continue
            start = self.footage.setup.starts[mount.robot]
            if k == 0 and start is not None:
                at = self._at(0, mount.robot)
                self.J[at, at] += np.linalg.inv(start.covariance)
            self._move(k, mount.robot, view)
            if view.sightings is not None:
                self._see(k, mount, view.sightings)
            if view.companions is not None:
                self._meet(k, mount, view.companions)

    def _move(self, k: int, robot: str, view: View) -> None:
        """Odometry ties two poses, e = ξ now − Ad ξ before; "up" is tied to one."""
        odometry: Odometry | None = view.odometry
        if odometry is None or k == 0:
            return
        before, now = (self.footage.truth[j].T_world_robot[robot] for j in (k - 1, k))
        a, b = self._at(k - 1, robot), self._at(k, robot)
        information, F = np.linalg.inv(odometry.covariance), _adjoint(now.inverse() @ before)
        self.J[a, a] += F.T @ information @ F
        self.J[a, b] -= F.T @ information
        self.J[b, a] -= information @ F
        self.J[b, b] += information
        if odometry.gravity is not None:
            up = now.rotation[2]
            H = np.concatenate([np.zeros((2, 3)), tangent_basis(up[None])[0] @ skew(up)], axis=1)
            self.J[b, b] += H.T @ H / odometry.gravity_sigma**2

    def _see(self, k: int, mount: Mount, seen: Sightings) -> None:
        pose = self.footage.truth[k].T_world_robot[mount.robot]
        landmark = whose(self.landmarks, pose @ mount.T_body_camera, seen)
        rows = np.flatnonzero(landmark >= 0)
        which = landmark[rows]
        T = mount.T_body_camera
        H, G, _ = jacobians(Sight(pose.rotation, pose.translation, T.rotation, T.translation, np.zeros(3)), self.landmarks[which])
        W = np.linalg.inv(seen.covariance[rows])
        at = self._at(k, mount.robot)
        self.J[at, at] += np.einsum("nki,nkl,nlj->ij", H, W, H)
        self.cross[at, which] += np.einsum("nki,nkl,nlj->inj", H, W, G)
        self.own[which] += np.einsum("nki,nkl,nlj->nij", G, W, G)

    def _meet(self, k: int, mount: Mount, seen: Companions) -> None:
        """The bearing of another robot's camera ties two poses."""
        poses, T = self.footage.truth[k].T_world_robot, mount.T_body_camera
        sight = Sight(poses[mount.robot].rotation, poses[mount.robot].translation, T.rotation, T.translation, np.zeros(3))
        others = np.array([poses[r].rotation for r in seen.robot]), np.array([poses[r].translation for r in seen.robot])
        levers = np.array([self.footage.setup.mount_of(r).T_body_camera.translation for r in seen.robot])
        H, _, G = robot_jacobians(sight, (others[0].reshape(-1, 3, 3), others[1].reshape(-1, 3)), levers.reshape(-1, 3))
        a = self._at(k, mount.robot)
        for robot, W, own, other in zip(seen.robot, np.linalg.inv(seen.covariance), H, G, strict=True):
            if robot not in self.moving:
                continue
            b = self._at(k, robot)
            for i, one in ((a, own), (b, other)):
                for j, two in ((a, own), (b, other)):
                    self.J[i, j] += one.T @ W @ two

    def take(self, k: int) -> None:
        """The bound at a frame from all that was measured until then: landmarks taken out, and the poses of that frame left."""
        n = 6 * len(self.moving) * (k + 1)
        known = np.flatnonzero(np.linalg.eigvalsh(self.own)[:, 0] > 1e3 * FAINT)
        cross = self.cross[:n, known]
        S = self.J[:n, :n] - np.einsum("anb,mnb->am", np.einsum("ani,nij->anj", cross, np.linalg.inv(self.own[known])), cross, optimize=True)
        last = np.zeros((n, 6 * len(self.moving)))
        last[-last.shape[1] :] = np.eye(last.shape[1])
        covariance = np.linalg.solve((S + S.T) / 2, last)[-last.shape[1] :]
        diagonal = np.diag(covariance).reshape(len(self.moving), 6)
        self._squares.append(diagonal[:, :3].sum(axis=1))

    def error(self) -> float:
        """m: the mean over robots of the root mean square over the frames that were taken."""
        return cramer_rao.ate_bound(np.array(self._squares))


def _adjoint(T: Pose) -> Array:
    """(6, 6): T Exp(ξ) T⁻¹ = Exp(Ad ξ) for tangents [translation, rotation]."""
    R = T.rotation
    return np.block([[R, skew(T.translation) @ R], [np.zeros((3, 3)), R]])
