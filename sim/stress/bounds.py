"""How near the tracker's cliques are to the best: graphs that it solved, solved again with proof.

How well anybody could tell where people are: the posterior Cramér-Rao bound of their places on the ground (Tichavský, Muravchik, Nehorai 1998).

It is generous, so that it stays a bound: robots are taken to know where they are, boxes to be known by their people, whole and told of level ground,
and each person's height to be known. A box then measures the direction of a person by its sides and the distance by its feet and its head; people
move on with nearly constant velocity (Bar-Shalom, Li, Kirubarajan 2001, 6.2.2), as unsteadily as those of the run do on average.

How good any tracker could have been on the same footage: what stands beside its scores.

The bound of the robots' places is the posterior Cramér-Rao bound (Van Trees 1968; Tichavský, Muravchik, Nehorai 1998) of the whole problem: all poses
of the team and all landmarks, their places unknown, from starts, odometry, "up" and bearings, of each other too, with Jacobians at the truth. It
holds for errors that are as the measurements' covariances say, and for who is told which landmark is which: nobody can do better.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ellipe

from sim.stress import bounds
from sim.stress.footage import TrialData
from sim.stress.map_truth import whose
from tracker.clique.branch_and_bound import exact
from tracker.ekf.measurement_models import CameraPose, jacobians, robot_jacobians
from tracker.formats.dimacs import read_graph
from tracker.geometry import Array, Pose, skew, tangent_basis
from tracker.metrics import cramer_rao
from tracker.metrics.cramer_rao import bound_step
from tracker.metrics.evaluation import who_counts
from tracker.tracks.tracks import MotionParameters, transition
from tracker.types import LandmarkHistory, Mount, Odometry, RobotDetections, Sightings, View

SOLVED = 100
"""Graphs of a run that are solved again at most, evenly spread over it."""

LARGEST = 400
"""Vertices of a graph that is; larger ones may take the proof long."""

PATIENCE = 60.0
"""s for a proof. So few vertices take milliseconds: a run without a proof is a rare one, and its graph counts for nothing."""


def gap(folder: Path, most: int = SOLVED) -> float | None:
    """The share by which the chosen cliques weigh less than the heaviest ones, over all graphs in the folder; None without graphs.

    most: graphs that are solved again, at most, evenly spread over the run.
    """
    paths = [path for path in sorted(folder.glob("*.clq")) if _vertices(path) <= LARGEST]
    chosen = best = 0.0
    for k in np.unique(np.linspace(0, len(paths) - 1, min(most, len(paths))).round().astype(int)).tolist():
        graph = read_graph(paths[k])
        vertices = [int(word) - 1 for word in paths[k].with_suffix(".txt").read_text(encoding="utf-8").split()]
        try:
            heaviest = exact(graph, PATIENCE).weight
        except ValueError:
            continue
        chosen, best = chosen + float(graph.weight[vertices].sum()), best + heaviest
    # Two sums of the same weights may differ in their last bits.
    return max(0.0, round(1.0 - chosen / best, 12)) if best > 0 else None


def _vertices(path: Path) -> int:
    with path.open(encoding="utf-8") as file:
        return next((int(line.split()[2]) for line in file if line.startswith("p ")), 0)


HEAD = 1.7
"""m over the feet."""

ANYWHERE, FASTEST = 20.0, 1.5
"""m and m/s: sigmas an axis of somebody of whom nothing is known yet."""


def target_bound(footage: TrialData) -> float | None:
    """m: the mean distance between people and the best estimate of their places, over all frames in which a box tells of them; None where nobody
    knows whose boxes they are.
    """
    period, people = footage.setup.period, np.unique(np.concatenate([t.person_id for t in footage.truth]))
    F, Q = transition(period, MotionParameters(acceleration=float(np.sqrt(_unsteadiness(footage)))))
    P = np.tile(np.diag([ANYWHERE**2, ANYWHERE**2, FASTEST**2, FASTEST**2]), (len(people), 1, 1))
    errors = []
    for k in range(len(footage.truth)):
        information = _told(footage, k, people)
        seen = information.any(axis=(1, 2))
        P = bound_step(P, F, Q, information)
        errors.append(mean_distance(P[seen, :2, :2]))
    found = np.concatenate(errors)
    return float(found.mean()) if len(found) else None


def mean_distance(P: Array) -> Array:
    """(n,) m: E |e| of errors e with covariances P (n, 2, 2) m² and mean 0: √(2 λ₁ / π) E(1 − λ₂ / λ₁), E the complete elliptic integral."""
    small, large = np.linalg.eigvalsh(P).T
    out: Array = np.sqrt(2 * large / np.pi) * ellipe(1 - small / large)
    return out


def _unsteadiness(footage: TrialData) -> float:
    """m²/s³ an axis: what the second differences of people's places are worth, whose variance is ⅔ q dt³."""
    squares = []
    for before, now, after in zip(footage.truth, footage.truth[1:], footage.truth[2:], strict=False):
        both = np.intersect1d(np.intersect1d(before.person_id, now.person_id), after.person_id)
        a, b, c = (t.feet[np.searchsorted(t.person_id, both, sorter=np.argsort(t.person_id))][:, :2] for t in (before, now, after))
        squares.append((a - 2 * b + c).ravel() ** 2)
    found = np.concatenate([*squares, np.zeros(0)])
    return max(1.5 * float(found.mean()) / footage.setup.period**3, 1e-3) if len(found) else 1e-3


def _told(footage: TrialData, k: int, people: Array) -> Array:
    """(n, 4, 4): what the boxes of a frame tell of each of `people`."""
    out, truth = np.zeros((len(people), 4, 4)), footage.truth[k]
    row, feet = {int(p): n for n, p in enumerate(people)}, dict(zip(truth.person_id.tolist(), truth.feet, strict=True))
    for view in footage.ticks[k].views:
        mount = footage.setup.mounts[view.camera]
        start = footage.setup.starts[mount.robot]
        pose = truth.T_world_robot.get(mount.robot) or (start and start.T_world_robot)
        if not pose:
            continue
        eye = (pose @ mount.T_body_camera).translation
        for n, person in enumerate(footage.whose(view.detections).tolist()):
            if person in feet:
                variance = float(np.trace(view.detections.covariance[n])) / 2
                out[row[person], :2, :2] += told_by_box(eye - feet[person], variance)
    return out


def told_by_box(eye: Array, variance: float) -> Array:
    """(2, 2) 1/m²: what a box, each edge of it with that variance rad², tells of the place of feet that are seen from eye (3,) m off them."""
    r = max(float(np.hypot(eye[0], eye[1])), 1e-3)
    away = eye[:2] / r
    aside = np.array([-away[1], away[0]])
    along = sum((height / (r**2 + height**2)) ** 2 for height in (eye[2], eye[2] - HEAD)) / variance
    # The middle between two edges has half of an edge's variance.
    return np.outer(aside, aside) * 2 / (r**2 * variance) + np.outer(away, away) * along


MOMENTS = 5
"""Frames, evenly spread, at which the bound is taken; the errors of a run are the mean of squares over them."""

FAINT = 1e-9


def limits(footage: TrialData, graphs: Path | None = None, survey: LandmarkHistory | None = None) -> dict[str, Any]:
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
    if graphs is not None and (gap := bounds.gap(graphs)) is not None:
        out["clique_gap"] = gap
    return out


def visible_recall(footage: TrialData) -> float | None:
    """As in `limits`; None where nobody was there."""
    counts = who_counts(footage.truth, footage.setup.period)
    total = sum(len(c) for c in counts)
    return float(sum(int(np.sum(c)) for c in counts)) / total if total else None


def ate_bound(footage: TrialData, survey: LandmarkHistory | None = None) -> float | None:
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

    def __init__(self, footage: TrialData, moving: list[str]) -> None:
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
        H, G, _ = jacobians(CameraPose(pose.rotation, pose.translation, T.rotation, T.translation, np.zeros(3)), self.landmarks[which])
        W = np.linalg.inv(seen.covariance[rows])
        at = self._at(k, mount.robot)
        self.J[at, at] += np.einsum("nki,nkl,nlj->ij", H, W, H)
        self.cross[at, which] += np.einsum("nki,nkl,nlj->inj", H, W, G)
        self.own[which] += np.einsum("nki,nkl,nlj->nij", G, W, G)

    def _meet(self, k: int, mount: Mount, seen: RobotDetections) -> None:
        """The bearing of another robot's camera ties two poses."""
        poses, T = self.footage.truth[k].T_world_robot, mount.T_body_camera
        sight = CameraPose(poses[mount.robot].rotation, poses[mount.robot].translation, T.rotation, T.translation, np.zeros(3))
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
