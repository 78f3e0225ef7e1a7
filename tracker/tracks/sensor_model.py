"""Sensor model of the views: detection and clutter rates, registration biases, and the scores of tracks that follow from them.

Its parts are estimated while tracking: detection_rates.py and calibration_bias.py. Visibility comes from detections/occlusion.py.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.detections.cross_view import CrossViewGroup, may_initiate
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Bodies, Viewpoint
from tracker.geometry import Array, Ints, Mask
from tracker.tracks.calibration_bias import RegistrationBias
from tracker.tracks.detection_rates import COVER_BOUNDS, WATCHED, DetectionRates, StandingClutter
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.tracks import Tracks
from tracker.types import Setup

INITIAL_DENSITY = 2e-2
"""Density of people at the first tick, per square metre."""


class TickOutcome(NamedTuple):
    """Data of a tick from which the sensor model learns: the V views, and the boxes of t people of the global hypothesis.

    doubt: factors (d,), for each view, of the probability that an unassigned box is false.
    box (t, V): the box of each track in each view, −1 for none. expected (t, V): relative detection rates. cover (t, V, 2): shares covered by
    objects and by people. confirmed (t,); existence (t,): log-odds that there is a person; place (t, 2) m with covariance spread (t, 2, 2) m².
    """

    views: list[GroundDetections]
    doubt: list[Array]
    box: Ints
    expected: Array
    cover: Array
    confirmed: Mask
    existence: Array
    place: Array
    spread: Array


class SensorModel:
    """The estimated rates and biases of all views."""

    def __init__(self, setup: Setup, parameters: MhtParameters) -> None:
        self.setup, self.parameters = setup, parameters
        area = setup.area
        ground_area = float(np.prod(area[1] - area[0])) if area is not None else np.pi * WATCHED**2
        self.detection_rates = DetectionRates(parameters.detection_rates, ground_area)
        self.registration_bias = RegistrationBias(setup, parameters.registration_bias)
        self.standing_clutter = StandingClutter()

    def detection(self, camera: str) -> float:
        """Detection rate of people in full view of `camera`."""
        return self.detection_rates.detection(camera)

    def bodies(self, place: Array, tree: Ints, front: Ints) -> Bodies:
        """People at places (n, 2) m, of trees (n,); those in the rows `front` (m,) may occlude others."""
        return Bodies(place, tree, front, self.setup, self.detection_rates.relative_detection)

    def observe(self, views: list[GroundDetections]) -> None:
        """Remember the confidences of a tick, among which boxes are ranked."""
        for feet in views:
            self.detection_rates.observe(feet.camera, feet.confidence)

    def missed(self, camera: str, expected: Array) -> Array:
        """Log-likelihood (n,) of a missed detection in `camera`; expected (n,): relative detection rate, 0 to 1, of each person."""
        return np.asarray(np.log(1 - self.detection(camera) * expected))

    def log_ratio(self, feet: GroundDetections) -> Array:
        """log (d,) of the rate of boxes of people over the density of false boxes, per square metre of ground."""
        ratio = self.detection_rates.log_ratio(feet.camera, feet.confidence)
        if not self.parameters.standing_clutter:
            return ratio
        return ratio - np.log1p(self.standing_clutter.density(feet) / self.detection_rates.false_density(feet.camera))

    def log_ground(self, feet: GroundDetections) -> Array:
        """log (d,) of the square metres of ground that a steradian at each box covers."""
        # False boxes are uniform on the ground; the density on the sphere grows with the squared distance and the slant.
        reach = np.where(feet.grounded, np.linalg.norm(feet.point - feet.origin, axis=1), self.parameters.fusion.reach)
        return np.asarray(np.log(reach**2 / np.maximum(-feet.direction[:, 2], 0.3 / reach)))

    def joint_miss(self, views: list[GroundDetections]) -> float:
        """Lower bound of the log-likelihood of a miss in all views at once, which has a common cause and counts as few independent misses."""
        detection = np.array([self.detection(feet.camera) for feet in views])
        return float((self.parameters.joint_misses * np.log(1 - detection)).min(initial=0.0))

    def corrected(self, feet: GroundDetections) -> GroundDetections:
        """The detections with ground points corrected for the registration bias, and spreads that include how far people walk until the tick."""
        point = feet.point.copy()
        point[:, :2] -= self.registration_bias.at(feet.camera, point[:, :2])
        walked = feet.later * self.parameters.motion.start_speed
        return replace(feet, point=point, spread=feet.spread + walked**2 * np.eye(2))

    def learn(self, now: TickOutcome) -> None:
        """Count the detections and missed detections of confirmed people in each view, and its other boxes."""
        several = now.confirmed & ((now.box >= 0).sum(axis=1) > 1)
        for v, feet in enumerate(now.views):
            confirmed, mine = now.confirmed, now.box[:, v] >= 0
            expected = confirmed & (now.expected[:, v] > 0)
            self.detection_rates.learn_partly_visible(feet.camera, now.cover[expected, v], mine[expected])
            false = now.doubt[v].copy()
            false[now.box[mine, v]] = 1 / (1 + np.exp(np.clip(now.existence[mine], -20, 20)))
            false[now.box[confirmed & mine, v]] = 0
            # With one view, unassigned boxes often show people whose tracks start late.
            if len(now.views) > 1:
                self.standing_clutter.learn(feet, false, now.place[several])
            self._learn_rates(now, v, false)

    def _learn_rates(self, now: TickOutcome, v: int, false: Array) -> None:
        """Count the people in full view of view v, and its other boxes; false (d,): probability of each box to be false."""
        feet, learned = now.views[v], self.detection_rates.parameters.learned
        visible = now.confirmed & (now.expected[:, v] > 0.5) & (now.cover[:, v].max(axis=1, initial=0.0) < COVER_BOUNDS[0])
        place = feet.point[:, :2]
        watched = np.linalg.norm(place - feet.origin[:2], axis=1) < WATCHED
        inside = watched if self.setup.area is None else self.setup.contains(place)
        low, high = self.setup.height
        # A box that may not initiate a track often shows a person with hidden feet, and is no evidence of false boxes.
        other = inside & may_initiate(feet) & (feet.height > low) & (feet.height < high)
        # If confidences are learned, only people in the area count: false boxes are counted there alone, and their tracks would confirm themselves.
        known, mine = visible & (self.setup.contains(now.place) | (not learned)), now.box[:, v] >= 0
        found, others = now.box[known & mine, v], np.flatnonzero(other)
        if learned:
            free, without = np.setdiff1d(np.flatnonzero(feet.grounded), now.box[mine, v]), known & ~mine
            found = np.concatenate([found, self._not_taken(feet, free, now.place[without], now.spread[without])])
            others = np.setdiff1d(others, found)
        self.detection_rates.learn(feet.camera, feet.confidence[found], float(known.sum()), feet.confidence[others], false[others])

    def _not_taken(self, feet: GroundDetections, free: Ints, place: Array, spread: Array) -> Ints:
        """Boxes among `free` that likely show people without a box, at places (k, 2) m with covariance (k, 2, 2) m²: at most one per person.

        Otherwise a class of confidence whose boxes no track takes would confirm itself, as all its boxes would count as false.
        """
        apart = self.corrected(feet).point[free, None, :2] - place
        S = feet.spread[free, None] + spread + self.parameters.motion.foot_spread**2 * np.eye(2)
        distance = (apart * np.linalg.solve(S, apart[..., None])[..., 0]).sum(axis=2)
        within = np.maximum(self.parameters.gate**2 - distance, 0.0)
        box, person = linear_sum_assignment(within, maximize=True)
        return free[box[within[box, person] > 0]]

    def arrival_rate(self, elapsed: float, revisits: float) -> float:
        """New people per square metre at a tick `elapsed` s after the first tick and `revisits` revisits after the last one."""
        q = self.parameters
        return float(q.arrival_rate * revisits + INITIAL_DENSITY * np.exp(-elapsed / 0.3))

    def initiation_score(
        self, views: list[GroundDetections], cameras: list[Viewpoint], ratios: list[Array], groups: list[CrossViewGroup], others: Tracks, rate: float
    ) -> Array:
        """log-likelihood ratio (g,) of the birth of a track, a new person over false boxes, for each group of boxes.

        cameras: viewpoint of each view. ratios: `log_ratio` of each view. others: the tracks, which may occlude the new people.
        rate: of new people, as `arrival_rate`.
        """
        q, place, tree = self.parameters, others.state[:, :2], others.tree
        points = np.array([g.point for g in groups]).reshape(-1, 2)
        score, no_tree = np.full(len(groups), np.log(rate)), np.full(len(groups), -1, dtype=np.int64)
        front = np.arange(len(groups), len(groups) + len(place))
        bodies = self.bodies(np.concatenate([points, place]), np.concatenate([no_tree, tree]), front)
        for v, (feet, view, ratio) in enumerate(zip(views, cameras, ratios, strict=True)):
            member = np.array([dict(g.members).get(v, -1) for g in groups], dtype=np.int64)
            expected = bodies.expected_detection(view, q.fusion.reach, np.arange(len(groups)))
            miss = self.missed(feet.camera, expected)
            here = member >= 0
            score[~here] += miss[~here]
            score[here] += ratio[member[here]] + np.log(1 - feet.feet_hidden[member[here]])
        # Each further box multiplies the likelihood by its density about the common place.
        size = np.array([len(g.members) for g in groups])
        area = np.array([2 * np.pi * np.sqrt(np.linalg.det(2 * n * g.covariance)) for n, g in zip(size, groups, strict=True)])
        return np.asarray(score - (size - 1) * np.log(np.maximum(area, 0.3)))
