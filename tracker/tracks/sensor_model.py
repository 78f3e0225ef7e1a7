"""What boxes, and their absence, say of people: what both trackers of people (hypotheses.py, multiple.py) hold of views.

A view is learned while it is used: how often it finds people and how many of its boxes are nobody's (tracker/trust.py), and how far it
is off on the ground for good.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tracker.detections.cross_view import CrossViewGroup
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Bodies, Viewpoint
from tracker.geometry import Array, Ints, Mask
from tracker.tracks.calibration_bias import RegistrationBias
from tracker.tracks.detection_rates import COVERED, DetectionRates
from tracker.tracks.parameters import TrackParameters
from tracker.types import Setup


class SensorModel:
    """What is known of the views."""

    def __init__(self, setup: Setup, parameters: TrackParameters) -> None:
        self.setup, self.parameters = setup, parameters
        area = setup.area
        square = float(np.prod(area[1] - area[0])) if area is not None else np.pi * parameters.trust.watched**2
        self.trust = DetectionRates(parameters.trust, square)
        self.offsets = RegistrationBias(setup, parameters.offsets)

    def detection(self, camera: str) -> float:
        """Share of the people in full view of `camera` who get a box."""
        return self.trust.detection(camera)

    def bodies(self, place: Array, tree: Ints, front: Ints) -> Bodies:
        """People at places (n, 2) m, of trees (n,), of whom those in the rows `front` may stand before others."""
        return Bodies(place, tree, front, self.setup, self.trust.shown if self.parameters.partly else None)

    def missed(self, camera: str, expected: Array) -> Array:
        """Log-likelihood (n,) of `camera` showing no box of people of whom it should see so much (n,), 0 to 1."""
        return np.asarray(np.log(1 - self.detection(camera) * expected))

    def certain(self, feet: GroundDetections) -> Array:
        """log (d,) of the rate at which people get such boxes over the density of false ones on the sphere of directions."""
        # False boxes are even on the ground; on the sphere they are as dense as the ground is slanted and far.
        reach = np.where(feet.grounded, np.linalg.norm(feet.point - feet.origin, axis=1), self.parameters.fusion.reach)
        return self.trust.worth(feet.camera, feet.confidence) - np.log(reach**2 / np.maximum(-feet.direction[:, 2], 0.3 / reach))

    def at_once(self, views: list[GroundDetections]) -> float:
        """Log-likelihood of all views' losing somebody at once: they do so for one reason, and that is a few misses, not many."""
        detection = np.array([self.detection(feet.camera) for feet in views])
        return float((self.parameters.at_once * np.log(1 - detection)).min(initial=0.0))

    def corrected(self, feet: GroundDetections) -> GroundDetections:
        """The boxes with their points where they are without the view's offset."""
        point = feet.point.copy()
        point[:, :2] -= self.offsets.at(feet.camera, point[:, :2])
        return replace(feet, point=point)

    def learn(self, views: list[GroundDetections], box: Ints, expected: Array, people: tuple[Mask, Array], cover: Array | None = None) -> None:
        """Count what each view found and missed of the people who are known, and what it showed beside them.

        box (t, v): of each track the box of each view, −1 for none; expected (t, v): how often the view should have one; people: which tracks
        (t,) are known, and the score (t,) of each; cover (t, v, 2): how much of them things and others cover, None where that is not looked at.
        """
        q, (sure, score) = self.parameters, people
        for v, feet in enumerate(views):
            known = sure & (expected[:, v] > 0.5)
            if cover is not None:
                self.trust.learn_shown(feet.camera, cover[sure, v], box[sure, v] >= 0)
                known &= cover[:, v].max(axis=1, initial=0.0) < COVERED[0]
            weight = np.ones(len(feet))
            mine = box[:, v] >= 0
            weight[box[mine, v]] = 1 / (1 + np.exp(np.clip(score[mine], -20, 20)))
            weight[box[sure & mine, v]] = 0
            place = feet.point[:, :2]
            watched = np.linalg.norm(place - feet.origin[:2], axis=1) < q.trust.watched
            inside = watched if self.setup.area is None else self.setup.contains(place)
            low, high = self.setup.height
            other = inside & feet.grounded & (feet.height > low) & (feet.height < high) & (feet.confidence >= q.min_confidence)
            self.trust.learn(feet.camera, feet.confidence[box[known & mine, v]], float(known.sum()), (feet.confidence[other], weight[other]))

    def prior(self, seen: list[tuple[GroundDetections, Viewpoint]], groups: list[CrossViewGroup], others: tuple[Array, Ints], ticks: int) -> Array:
        """log-likelihood ratio (g,) of "somebody new" over "false boxes": who sees, who should, and how rare new people are.

        seen: of each view its boxes and viewpoint; others: places (t, 2) m and trees (t,) of who is there, who may stand before them;
        ticks: how many there have been, this one with them.
        """
        q, (place, tree) = self.parameters, others
        rate = q.arrivals + q.present * np.exp(-(ticks - 1) * self.setup.period / 0.3)
        points = np.array([g.point for g in groups]).reshape(-1, 2)
        score, nobody = np.full(len(groups), np.log(rate)), np.full(len(groups), -1, dtype=np.int64)
        front = np.arange(len(groups), len(groups) + len(place))
        bodies = self.bodies(np.concatenate([points, place]), np.concatenate([nobody, tree]), front)
        for v, (feet, view) in enumerate(seen):
            member = np.array([dict(g.members).get(v, -1) for g in groups], dtype=np.int64)
            expected = bodies.expected(view, q.fusion.reach)[: len(groups)]
            miss = self.missed(feet.camera, expected)
            here = member >= 0
            score[~here] += miss[~here]
            score[here] += self.trust.worth(feet.camera, feet.confidence[member[here]]) + np.log(1 - feet.lying[member[here]])
        # Each box after the first must lie near: its density about the common place, at the spread of feet.
        size = np.array([len(g.members) for g in groups])
        area = np.array([2 * np.pi * np.sqrt(np.linalg.det(2 * n * g.covariance)) for n, g in zip(size, groups, strict=True)])
        return np.minimum(score - (size - 1) * np.log(np.maximum(area, 0.3)), q.most_gain * size)
