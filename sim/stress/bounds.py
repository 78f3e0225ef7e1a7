"""Bounds on the scores of any tracker on a trial: visible recall, Cramér-Rao bounds of robots and people, and the gap of the clique search.

Robots: the posterior Cramér-Rao bound (Van Trees 1968; Tichavský, Muravchik, Nehorai 1998) of the batch problem. The unknowns are the poses of the
whole team and the positions of all landmarks. The measurements are starts, odometry, "up", and bearings of landmarks and of other robots. Jacobians
are evaluated at the truth. The bound holds where errors follow the stated covariances; data association is assumed to be known.

People: the posterior Cramér-Rao bound of their positions on the ground. It assumes more knowledge than any tracker has, so that it stays a bound.
Robot poses, the person of every box, level ground, and each person's height are known, and boxes are whole. The sides of a box then measure the
direction of a person, and its bottom and top edges measure the distance. People move with nearly constant velocity (Bar-Shalom, Li, Kirubarajan
2001, 6.2.2), with the mean process noise of the people of the run.

Cliques: graphs that the tracker solved are solved again exactly, with a proof of optimality.

Maps: where true landmarks are known, the final map of a tracker is scored against them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import ellipe

from sim.stress.trial_data import TrialData
from tracker.clique.dimacs import read_graph
from tracker.clique.exact_clique import exact
from tracker.ekf.measurement_models import CameraPose, jacobians, robot_jacobians
from tracker.geometry import Array, Ints, Mask, Pose, skew, tangent_basis
from tracker.metrics.trajectory import align
from tracker.sequence.results import Results
from tracker.slam import cramer_rao
from tracker.slam.cramer_rao import bound_step
from tracker.tracks.tracks import MotionParameters, transition
from tracker.types import LandmarkHistory, Mount, Odometry, RobotDetections, Sightings, View
from tracker.types.truth import evaluated_people

EVALUATIONS = 5
"""Frames, evenly spread, at which the bound of the robots is evaluated; the error of a run is the root mean square over them."""

PRIOR_INFORMATION = 1e-9
"""1/m²: prior information of a landmark an axis, so that its matrix can be inverted."""

HEAD = 1.7
"""Height of a head above the feet, m."""

PRIOR_POSITION, PRIOR_SPEED = 20.0, 1.5
"""m and m/s: prior standard deviations an axis of a person."""

MAX_GRAPHS = 100
"""Largest number of graphs of a run that are solved again, evenly spread over it."""

MAX_VERTICES = 400
"""Largest number of vertices of a graph that is solved again. The proof for a larger graph may take long."""

PROOF_LIMIT = 60.0
"""Time limit of a proof, s. Graphs of this size take milliseconds as a rule; a graph without a proof is left out."""

MAX_ANGLE = np.radians(1.0)
"""Largest angle between a sighting and its landmark, rad."""
MIN_SIGHTINGS = 5
"""A landmark should be in the map after this number of sightings by one robot."""
NEAR = 0.5
"""m: the largest distance between a landmark and its true one; a landmark farther from all true ones is false (a ghost)."""

MEASURES = ("map_m", "map_aligned_m", "map_complete", "map_ghosts")


def all_bounds(data: TrialData, graphs: Path | None = None, history: LandmarkHistory | None = None) -> dict[str, Any]:
    """All bounds of a trial, by the names in its row. Bounds that are not known are left out, except visible_recall.

    visible_recall: the largest possible recall, None where nobody is present. ate_bound_m: the bound of the robots' ATE, m.
    target_bound_m: the bound of the mean position error of people, m. clique_gap: the share of the largest weight that the tracker's cliques lack.

    graphs: the folder of the graphs that the tracker solved. history: the sightings of landmarks by the tracker, as for `ate_bound`.
    """
    out: dict[str, Any] = {"visible_recall": visible_recall(data)}
    if (bound := ate_bound(data, history)) is not None:
        out["ate_bound_m"] = bound
    if (bound := target_bound(data)) is not None:
        out["target_bound_m"] = bound
    if graphs is not None and (gap := clique_gap(graphs)) is not None:
        out["clique_gap"] = gap
    return out


def visible_recall(data: TrialData) -> float | None:
    """The share of true positions of people whom a view showed lately (evaluated_people). None where there are no true positions."""
    counts = evaluated_people(data.truth, data.setup.period)
    total = sum(len(c) for c in counts)
    return float(sum(int(np.sum(c)) for c in counts)) / total if total else None


def ate_bound(data: TrialData, history: LandmarkHistory | None = None) -> float | None:
    """The bound of the robots' mean position error, m.

    Where landmarks are features of images, none of them is known, and the bound takes the tracker's own sightings in `history`
    (cramer_rao.bound_of_map). None for runs without landmarks, and where a fault makes odometry worse than its covariance says.
    """
    faults = data.case.faults
    moving = list(data.setup.anchored_robots)
    if not moving or faults.slip or faults.kidnapped or faults.skew:
        return None
    if data.landmarks is None:
        if history is None:
            return None
        return cramer_rao.bound_of_map(data.setup, [t.T_world_robot for t in data.truth], data.in_memory().odometry(), history)
    problem = _BatchProblem(data, moving)
    last = len(data.ticks) - 1
    evaluated = sorted({round(last * k / EVALUATIONS) for k in range(1, EVALUATIONS + 1)} - {0}) or [0]
    for k in range(last + 1):
        problem.add_frame(k)
        if k in evaluated:
            problem.evaluate(k)
    return problem.error()


def map_score(data: TrialData, results: Results) -> dict[str, float | None] | None:
    """The score of the final map against the true landmarks that one robot saw MIN_SIGHTINGS times.

    The map is aligned by the alignment of the robots' paths. None where true landmarks are not known, and where the tracker reports no map.
    """
    if data.landmarks is None or results.landmark_history is None:
        return None
    seen = {robot: np.zeros(len(data.landmarks), dtype=np.int64) for robot in data.setup.starts}
    for tick, truth in zip(data.ticks, data.truth, strict=True):
        for view in tick.views:
            mount = data.setup.mounts[view.camera]
            if view.sightings is not None and len(view.sightings) and mount.robot in truth.T_world_robot:
                found = true_landmarks(data.landmarks, truth.T_world_robot[mount.robot] @ mount.T_body_camera, view.sightings)
                seen[mount.robot][found[found >= 0]] += 1
    wanted = np.max(list(seen.values()), axis=0) >= MIN_SIGHTINGS
    pairs = [
        (pose.translation, t.T_world_robot[robot].translation)
        for robot, poses in results.poses.items()
        for pose, t in zip(poses, data.truth, strict=True)
        if pose is not None and robot in t.T_world_robot
    ]
    given, true = np.array(pairs).reshape(-1, 2, 3).swapaxes(0, 1)
    return score_map(data.landmarks, results.landmark_history.map, wanted, align(given, true) if pairs else None)


def true_landmarks(landmarks: Array, T_world_camera: Pose, seen: Sightings) -> Ints:
    """(n,) the landmark nearest in direction to each sighting, at most one sighting a landmark; −1 beyond MAX_ANGLE.

    landmarks: (m, 3) m, world frame.
    """
    direction = landmarks - T_world_camera.translation
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    cosine = seen.bearing @ T_world_camera.rotation.T @ direction.T
    best = cosine.argmax(axis=1)
    good = cosine[np.arange(len(best)), best] > np.cos(MAX_ANGLE)
    _, first = np.unique(best, return_index=True)
    once = np.zeros(len(best), dtype=bool)
    once[first] = True
    return np.where(good & once, best, -1)


def target_bound(data: TrialData) -> float | None:
    """The bound of the mean distance between people and their estimates, m, over all frames in which a box shows the person.

    None where the persons of boxes are not known, as in real sequences.
    """
    period, people = data.setup.period, np.unique(np.concatenate([t.person_id for t in data.truth]))
    F, Q = transition(period, MotionParameters(acceleration=float(np.sqrt(_process_noise(data)))))
    P = np.tile(np.diag([PRIOR_POSITION**2, PRIOR_POSITION**2, PRIOR_SPEED**2, PRIOR_SPEED**2]), (len(people), 1, 1))
    errors = []
    for k in range(len(data.truth)):
        information = _information(data, k, people)
        seen = information.any(axis=(1, 2))
        P = bound_step(P, F, Q, information)
        errors.append(mean_distance(P[seen, :2, :2]))
    found = np.concatenate(errors)
    return float(found.mean()) if len(found) else None


def mean_distance(P: Array) -> Array:
    """(n,) m: E |e| of errors e with mean 0 and covariances P (n, 2, 2) m²: √(2 λ₁ / π) E(1 − λ₂ / λ₁).

    λ₁ ≥ λ₂ are the eigenvalues of P, and E is the complete elliptic integral of the second kind.
    """
    small, large = np.linalg.eigvalsh(P).T
    out: Array = np.sqrt(2 * large / np.pi) * ellipe(1 - small / large)
    return out


def box_information(eye: Array, variance: float) -> Array:
    """(2, 2) 1/m²: the Fisher information of a box about the position of the feet on the ground.

    eye: (3,) m, the camera relative to the feet. variance: of each edge of the box, rad².
    """
    r = max(float(np.hypot(eye[0], eye[1])), 1e-3)
    away = eye[:2] / r
    aside = np.array([-away[1], away[0]])
    along = sum((height / (r**2 + height**2)) ** 2 for height in (eye[2], eye[2] - HEAD)) / variance
    # The middle between two edges has half of an edge's variance.
    return np.outer(aside, aside) * 2 / (r**2 * variance) + np.outer(away, away) * along


def clique_gap(folder: Path, most: int = MAX_GRAPHS) -> float | None:
    """The share by which the chosen cliques weigh less than the heaviest ones, over all graphs in the folder. None without graphs.

    most: the largest number of graphs that are solved again, evenly spread over the run.
    """
    paths = [path for path in sorted(folder.glob("*.clq")) if _vertices(path) <= MAX_VERTICES]
    chosen = best = 0.0
    for k in np.unique(np.linspace(0, len(paths) - 1, min(most, len(paths))).round().astype(int)).tolist():
        graph = read_graph(paths[k])
        vertices = [int(word) - 1 for word in paths[k].with_suffix(".txt").read_text(encoding="utf-8").split()]
        try:
            heaviest = exact(graph, PROOF_LIMIT).weight
        except ValueError:
            continue
        chosen, best = chosen + float(graph.weight[vertices].sum()), best + heaviest
    # Two sums of the same weights may differ in their last bits.
    return max(0.0, round(1.0 - chosen / best, 12)) if best > 0 else None


def _vertices(path: Path) -> int:
    with path.open(encoding="utf-8-sig") as file:
        return next((int(line.split()[2]) for line in file if line.startswith("p ")), 0)


def _process_noise(data: TrialData) -> float:
    """Spectral density q an axis, m²/s³, from the second differences of positions, whose variance is ⅔ q dt³."""
    squares = []
    for before, now, after in zip(data.truth, data.truth[1:], data.truth[2:], strict=False):
        both = np.intersect1d(np.intersect1d(before.person_id, now.person_id), after.person_id)
        a, b, c = (t.feet[np.searchsorted(t.person_id, both, sorter=np.argsort(t.person_id))][:, :2] for t in (before, now, after))
        squares.append((a - 2 * b + c).ravel() ** 2)
    found = np.concatenate([*squares, np.zeros(0)])
    return max(1.5 * float(found.mean()) / data.setup.period**3, 1e-3) if len(found) else 1e-3


def _information(data: TrialData, k: int, people: Array) -> Array:
    """(n, 4, 4): the Fisher information of the boxes of frame k about position and velocity of each of `people`."""
    out, truth = np.zeros((len(people), 4, 4)), data.truth[k]
    row, feet = {int(p): n for n, p in enumerate(people)}, dict(zip(truth.person_id.tolist(), truth.feet, strict=True))
    for view in data.ticks[k].views:
        mount = data.setup.mounts[view.camera]
        start = data.setup.starts[mount.robot]
        pose = truth.T_world_robot.get(mount.robot) or (start and start.T_world_robot)
        if not pose:
            continue
        eye = (pose @ mount.T_body_camera).translation
        for n, person in enumerate(data.true_persons(view.detections).tolist()):
            if person in feet:
                variance = float(np.trace(view.detections.covariance[n])) / 2
                out[row[person], :2, :2] += box_information(eye - feet[person], variance)
    return out


class _BatchProblem:
    """The information matrix of the poses of all frames and of the landmarks.

    J (n, n): of the poses, 6 unknowns a robot and frame, right tangent. cross (n, landmarks, 3): between poses and landmarks.
    own (landmarks, 3, 3): of the landmarks.
    """

    def __init__(self, data: TrialData, moving: list[str]) -> None:
        assert data.landmarks is not None
        self.data, self.moving, self.landmarks = data, moving, data.landmarks
        n = 6 * len(moving) * len(data.ticks)
        self.J = np.zeros((n, n))
        self.cross = np.zeros((n, len(self.landmarks), 3))
        self.own = np.tile(PRIOR_INFORMATION * np.eye(3), (len(self.landmarks), 1, 1))
        self._squares: list[Array] = []

    def add_frame(self, k: int) -> None:
        """Add the information of the measurements of frame k."""
        for view in self.data.ticks[k].views:
            mount = self.data.setup.mounts[view.camera]
            if mount.robot not in self.moving:
                continue
            start = self.data.setup.starts[mount.robot]
            if k == 0 and start is not None:
                at = self._at(0, mount.robot)
                self.J[at, at] += np.linalg.inv(start.covariance)
            self._add_odometry(k, mount.robot, view)
            if view.sightings is not None:
                self._add_sightings(k, mount, view.sightings)
            if view.robot_detections is not None:
                self._add_robot_detections(k, mount, view.robot_detections)

    def evaluate(self, k: int) -> None:
        """Evaluate the bound at frame k given the measurements so far: landmarks and all other poses are marginalized."""
        n = 6 * len(self.moving) * (k + 1)
        known = np.flatnonzero(np.linalg.eigvalsh(self.own)[:, 0] > 1e3 * PRIOR_INFORMATION)
        cross = self.cross[:n, known]
        S = self.J[:n, :n] - np.einsum("anb,mnb->am", np.einsum("ani,nij->anj", cross, np.linalg.inv(self.own[known])), cross, optimize=True)
        last = np.zeros((n, 6 * len(self.moving)))
        last[-last.shape[1] :] = np.eye(last.shape[1])
        covariance = np.linalg.solve((S + S.T) / 2, last)[-last.shape[1] :]
        diagonal = np.diag(covariance).reshape(len(self.moving), 6)
        self._squares.append(diagonal[:, :3].sum(axis=1))

    def error(self) -> float:
        """The mean over robots of the root mean square over the evaluated frames, m."""
        return cramer_rao.ate_bound(np.array(self._squares))

    def _at(self, k: int, robot: str) -> slice:
        first = 6 * (k * len(self.moving) + self.moving.index(robot))
        return slice(first, first + 6)

    def _add_odometry(self, k: int, robot: str, view: View) -> None:
        """Odometry measures two poses, e = ξ now − Ad ξ before; "up" measures one."""
        odometry: Odometry | None = view.odometry
        if odometry is None or k == 0:
            return
        before, now = (self.data.truth[j].T_world_robot[robot] for j in (k - 1, k))
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

    def _add_sightings(self, k: int, mount: Mount, seen: Sightings) -> None:
        """A bearing of a landmark measures a pose and the landmark."""
        pose = self.data.truth[k].T_world_robot[mount.robot]
        landmark = true_landmarks(self.landmarks, pose @ mount.T_body_camera, seen)
        rows = np.flatnonzero(landmark >= 0)
        which = landmark[rows]
        T = mount.T_body_camera
        H, G, _ = jacobians(CameraPose(pose.rotation, pose.translation, T.rotation, T.translation, np.zeros(3)), self.landmarks[which])
        W = np.linalg.inv(seen.covariance[rows])
        at = self._at(k, mount.robot)
        self.J[at, at] += np.einsum("nki,nkl,nlj->ij", H, W, H)
        self.cross[at, which] += np.einsum("nki,nkl,nlj->inj", H, W, G)
        self.own[which] += np.einsum("nki,nkl,nlj->nij", G, W, G)

    def _add_robot_detections(self, k: int, mount: Mount, seen: RobotDetections) -> None:
        """A bearing of another robot's camera measures two poses."""
        poses, T = self.data.truth[k].T_world_robot, mount.T_body_camera
        camera = CameraPose(poses[mount.robot].rotation, poses[mount.robot].translation, T.rotation, T.translation, np.zeros(3))
        others = np.array([poses[r].rotation for r in seen.robot]), np.array([poses[r].translation for r in seen.robot])
        levers = np.array([self.data.setup.mount_of(r).T_body_camera.translation for r in seen.robot])
        H, _, G = robot_jacobians(camera, (others[0].reshape(-1, 3, 3), others[1].reshape(-1, 3)), levers.reshape(-1, 3))
        a = self._at(k, mount.robot)
        for robot, W, own, other in zip(seen.robot, np.linalg.inv(seen.covariance), H, G, strict=True):
            if robot not in self.moving:
                continue
            b = self._at(k, robot)
            for i, one in ((a, own), (b, other)):
                for j, two in ((a, own), (b, other)):
                    self.J[i, j] += one.T @ W @ two


def _adjoint(T: Pose) -> Array:
    """(6, 6): T Exp(ξ) T⁻¹ = Exp(Ad ξ) for tangents [translation, rotation]."""
    R = T.rotation
    return np.block([[R, skew(T.translation) @ R], [np.zeros((3, 3)), R]])


def score_map(truth: Array, landmarks: Array, wanted: Mask, alignment: Pose | None = None) -> dict[str, float | None]:
    """Score estimated landmarks (m, 3) m, without identities, against true ones (n, 3) m. wanted (n,): those that were seen often enough for a map.

    alignment: of the team with its truth (trajectory.align), applied to the map. The matching is one to one, within NEAR after the
    alignment, with the least sum of squares. Returns MEASURES, None where undefined.

    map_m, map_aligned_m: RMSE of the matched landmarks, as they are and after the team's alignment. map_complete: the share of wanted
    landmarks that are found. map_ghosts: the share of landmarks without a true one of their own.
    """
    moved = (alignment or Pose.identity()).apply(landmarks)
    square = ((truth[:, None] - moved) ** 2).sum(axis=2)
    rows, columns = linear_sum_assignment(np.minimum(square, NEAR**2))
    good = square[rows, columns] < NEAR**2
    rows, columns = rows[good], columns[good]
    raw, matched = ((truth[rows] - landmarks[columns]) ** 2).sum(), len(rows)
    values = (
        float(np.sqrt(raw / matched)) if matched else None,
        float(np.sqrt(square[rows, columns].sum() / matched)) if matched else None,
        float(wanted[rows].sum() / wanted.sum()) if wanted.any() else None,
        1 - matched / len(landmarks) if len(landmarks) else None,
    )
    return dict(zip(MEASURES, values, strict=True))
