"""How well anybody could tell where people are: the posterior Cramér-Rao bound of their places on the ground (Tichavský, Muravchik, Nehorai 1998).

It is generous, so that it stays a bound: robots are taken to know where they are, boxes to be known by their people, whole and told of level ground,
and each person's height to be known. A box then measures the direction of a person by its sides and the distance by its feet and its head; people
move on with nearly constant velocity (Bar-Shalom, Li, Kirubarajan 2001, 6.2.2), as unsteadily as those of the run do on average.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ellipe

from sim.footage import Footage
from tracker.cramer_rao import bound_step
from tracker.geometry import Array
from tracker.trees import MotionParameters, transition

HEAD = 1.7
"""m over the feet."""
ANYWHERE, FASTEST = 20.0, 1.5
"""m and m/s: sigmas an axis of somebody of whom nothing is known yet."""


def target_bound(footage: Footage) -> float | None:
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


def _unsteadiness(footage: Footage) -> float:
    """m²/s³ an axis: what the second differences of people's places are worth, whose variance is ⅔ q dt³."""
    squares = []
    for before, now, after in zip(footage.truth, footage.truth[1:], footage.truth[2:], strict=False):
        both = np.intersect1d(np.intersect1d(before.person_id, now.person_id), after.person_id)
        a, b, c = (t.feet[np.searchsorted(t.person_id, both, sorter=np.argsort(t.person_id))][:, :2] for t in (before, now, after))
        squares.append((a - 2 * b + c).ravel() ** 2)
    found = np.concatenate([*squares, np.zeros(0)])
    return max(1.5 * float(found.mean()) / footage.setup.period**3, 1e-3) if len(found) else 1e-3


def _told(footage: Footage, k: int, people: Array) -> Array:
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
