"""Global nearest neighbour tracker of people: one global hypothesis, from tick to tick.

View by view, boxes are assigned to tracks with the highest sum of log-likelihood ratios. Groups of boxes that are left over initiate tracks.
`GnnFilter.step` takes the detections of all views at a tick and returns the tracks; `GnnTracker` smooths and reports them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import final

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import linear_sum_assignment

from tracker.detections.cross_view import CrossViewGroup, group_across_views
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Viewpoint
from tracker.detections.optical_flow import TrackOwners
from tracker.detections.walkable_prior import WalkablePrior
from tracker.geometry import Array, Ints, Mask
from tracker.gnn.ambiguous_range import AmbiguousUpdate, initiated_along_ray
from tracker.gnn.fixed_lag import GnnFixedLagSmoother
from tracker.gnn.negative_information import ExpectedVisibility
from tracker.tracks.parameters import TrackParameters
from tracker.tracks.reidentification import NewTargetModel, Reidentification
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import HeadInnovations, Innovations, Tracks, head_innovations, initiated, innovations, predict, update, with_marginal
from tracker.types import Setup

CERTAIN_PRIOR = 0.99
"""Expectation of the walkable prior from which it leaves a track unchanged."""


class GnnFilter:
    """The filter over ticks; causal: its state depends on the ticks so far. `tracks` are all tracks, `confirmed` (t,) the confirmed ones."""

    def __init__(self, setup: Setup, parameters: TrackParameters) -> None:
        self.setup, self.parameters = setup, parameters
        self.tracks = Tracks.none()
        self.confirmed = np.zeros(0, dtype=bool)
        self.sensor_model = SensorModel(setup, parameters)
        ranges = parameters.fusion.ranges
        self._stature = ranges.stature, ranges.stature_sigma
        self._walkable = WalkablePrior.of(setup.ground, setup.occluders, ranges.walkability)
        self.reidentification = Reidentification(
            parameters.reidentification, parameters.motion, setup.period, NewTargetModel(parameters.arrival_rate, *self._stature)
        )
        self._next_tree = 1
        self._merge_scores: dict[tuple[int, int], float] = {}  # pairs of trees near each other → log-likelihood ratio of one person
        self._owners = TrackOwners()
        self._ticks = 0
        self._max_gap = round(parameters.delta_a / setup.period)
        self._outside = np.zeros(0)  # s for which each track (t,) is outside all views

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> tuple[Tracks, Mask]:
        """Take a tick; all tracks, and which of them (t,) are confirmed and have a box recently enough to be reported.

        views: detections of each view; cameras: viewpoint of each view.
        """
        q = self.parameters
        self.tracks = self._with_walkable_prior(predict(self.tracks, self.setup.period, q.motion))
        taken = [feet.confidence < q.ignored_confidence for feet in views]
        self._ticks += 1
        box = np.full((len(self.tracks), len(views)), -1, dtype=np.int64)
        gain, rival = np.zeros(box.shape), np.zeros(box.shape)
        predicted = self._expected_visibility(cameras).share
        for v, feet in enumerate(views):
            if len(feet) and len(self.tracks):
                none = self.sensor_model.missed(feet.camera, predicted[:, v])
                self._assign(feet, taken[v], none, (box[:, v], gain[:, v], rival[:, v]))
        expected = self._score(views, cameras, box, (gain, rival))
        current = self.confirmed & (self.tracks.misses <= self._max_gap)
        self.sensor_model.learn(views, box, expected, (current, self.tracks.score))
        seen = box >= 0
        trees = self.tracks.tree
        free = [~t & (f.confidence >= q.initiation_confidence) for t, f in zip(taken, views, strict=True)]
        groups = self._initiate(views, cameras, free, seen)
        for v, feet in enumerate(views):
            if feet.links is not None:
                self._owners.add(feet.camera, _box_owners(len(feet), trees, box[:, v], [(tree, dict(g.members).get(v, -1)) for tree, g in groups]))
        self._confirm_and_delete()
        return self.tracks, self.confirmed & (self.tracks.misses <= self._max_gap)

    def detection(self, views: list[GroundDetections]) -> Array:
        """Estimated detection rate of each view (v,) for people in full view."""
        return np.array([self.sensor_model.detection(feet.camera) for feet in views])

    def miss_probability(self, others: Tracks, cameras: list[Viewpoint], detection: Array, people: Tracks) -> Array:
        """Probability (n,) that all `cameras`, of detection rates (v,), miss `people`, whom `others` may occlude."""
        both = others.join(people)
        bodies = self.sensor_model.bodies(both.state[:, :2], both.tree, np.arange(len(others)))
        share = bodies.expected_by_view(cameras, self.parameters.fusion.reach)[len(others) :]
        return np.asarray((1 - detection * share).prod(axis=1))

    def _expected_visibility(self, cameras: list[Viewpoint]) -> ExpectedVisibility:
        """The expected detection of all tracks in the views."""
        return ExpectedVisibility.of(self.tracks, cameras, self.sensor_model)

    def _assign(self, feet: GroundDetections, taken: Mask, none: Array, given: tuple[Ints, Array, Array]) -> None:
        """Assign at most one box of the view to each track by the highest sum of log-likelihood ratios, and update the tracks.

        An unconfident box keeps a confirmed track from the box of another one, and has no other effect. taken (d,): boxes that are not free, changed
        in place; none (t,): log-likelihood of a missed detection. given: arrays (t,) that are filled in place with the box of each track, its
        log-likelihood ratio, and the gain of the best rival.
        """
        q = self.parameters
        bias = self.sensor_model.registration_bias.at(feet.camera, self.tracks.state[:, :2])
        foot = innovations(self.tracks, feet, bias, self.setup.ground, q.motion)
        head = head_innovations(self.tracks, foot, feet, q.fusion.ranges.head_sigma)
        (gain, feet_seen), head_fits = self._gain(foot, head, feet), head.within_gate(q.gate)
        ambiguous = AmbiguousUpdate.of(self.tracks, feet, np.flatnonzero(feet.ambiguous), bias, q.motion.foot_spread)
        if len(ambiguous.box):
            gain[:, ambiguous.box] = self.sensor_model.detection_log_ratio(feet)[ambiguous.box] + ambiguous.density(q.gate)
        gain[:, taken] = -np.inf
        unconfident = feet.confidence < q.min_confidence
        gain[np.ix_(~self.confirmed, unconfident)] = -np.inf
        # Links of images decide between tracks. They are no evidence of existence.
        detection = self.sensor_model.detection(feet.camera)
        ratio = gain + self._owners.links(feet.camera, self.tracks.tree, feet.links, q.covering_share * (1 - detection)) if feet.links else gain
        rows, boxes = linear_sum_assignment(np.where(ratio > none[:, None], none[:, None] - ratio, 0.0))
        chosen = ratio[rows, boxes] > none[rows]
        rows, boxes = rows[chosen], boxes[chosen]
        taken[boxes] = True
        rows, boxes = rows[~unconfident[boxes]], boxes[~unconfident[boxes]]
        given[0][rows], given[1][rows], given[2][rows] = boxes, gain[rows, boxes], self._rival_gains(ratio, none, rows, boxes)
        for t, d in zip(rows, boxes, strict=True):
            if feet.ambiguous[d]:
                self.tracks = ambiguous.correct(self.tracks, int(t), int(np.searchsorted(ambiguous.box, d)))
            else:
                self._update(feet, int(t), int(d), (foot, head), (feet_seen[t, d], head_fits[t, d]))

    def _update(self, feet: GroundDetections, t: int, d: int, expected: tuple[Innovations, HeadInnovations], use: tuple[bool, bool]) -> None:
        """Update track `t` by box `d`, and the registration bias by a confirmed track; use: whether feet are visible, and whether the head fits."""
        (foot, head), (feet_seen, head_fits) = expected, use
        H, r, R = foot.H[t], foot.residual[t, d], feet.covariance[d]
        R = R + (H @ H.T) * self.parameters.motion.foot_spread**2
        if not feet_seen:
            H, r, R = H[:1], r[:1], R[:1, :1]
        elif self.confirmed[t]:
            S = R + H @ self.tracks.covariance[t, :2, :2] @ H.T
            self.sensor_model.registration_bias.learn(feet.camera, self.tracks.state[t, None, :2], (r[None], H[None], S[None]))
        if (feet.ranges is not None or (not feet_seen and feet.cut[d])) and head_fits:
            # The upper edge measures the distance as precisely as the stature is known.
            H, r = np.vstack([np.column_stack([H, np.zeros(len(H))]), head.H[t, d]]), np.append(r, head.above[t, d])
            R = block_diag(R, head.noise[t, d])
        self.tracks = update(self.tracks, t, r, H, R)

    def _rival_gains(self, ratio: Array, none: Array, rows: Ints, boxes: Ints) -> Array:
        """Greatest gain (k,) of another track by taking the box of each of `rows`, whose boxes are `boxes`.

        ratio (t, d): log-likelihood ratios, none (t,): those of no box. Tentative tracks are no rivals of confirmed ones.
        """
        now = none.copy()
        now[rows] = ratio[rows, boxes]
        others = ratio[:, boxes].T
        more = np.where(others > none, others - now, 0.0)
        more[np.arange(len(rows)), rows] = 0.0
        more[np.ix_(self.confirmed[rows], ~self.confirmed)] = 0.0
        return np.asarray(more.max(axis=1, initial=0.0))

    def _gain(self, foot: Innovations, head: HeadInnovations, feet: GroundDetections) -> tuple[Array, Mask]:
        """Log-likelihood ratio (t, d) of a box of the track over clutter, −inf outside the gate; and whether (t, d) the feet count as visible."""
        q = self.parameters
        S = foot.expected[:, None] + feet.covariance[None, :]
        r = np.where(np.isfinite(foot.residual), foot.residual, 1e3)
        a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
        det = a * c - b * b
        both = (c * r[..., 0] ** 2 - 2 * b * r[..., 0] * r[..., 1] + a * r[..., 1] ** 2) / det
        side = r[..., 0] ** 2 / a
        rate = self.sensor_model.detection_log_ratio(feet)[None, :]
        hidden = feet.feet_hidden[None, :]
        gain_both = rate + np.log(1 - hidden) - 0.5 * (both + np.log((2 * np.pi) ** 2 * det))
        # With hidden feet the lower edge is uniform between the predicted feet and the upper end of the body.
        body = np.arctan2(1.2, foot.distance)[:, None]
        above = (r[..., 1] > -2 * np.sqrt(c)) & (r[..., 1] < body)
        gain_side = rate + np.log(hidden / body) - 0.5 * (side + np.log(2 * np.pi * a))
        gain_both[both > q.gate**2] = -np.inf
        gain_side[(side > q.gate**2) | ~above | (self.tracks.position_sigma > q.footless_sigma)[:, None]] = -np.inf
        low, high = self.setup.height
        slack = 0.15 + 0.02 * foot.distance[:, None]
        fits = (foot.height > low - slack) & (foot.height < high + slack)
        gain = np.where(fits, np.maximum(gain_both, gain_side), -np.inf)
        if feet.ranges is not None:
            gain += self._height_ratio(foot.height, head)
        return gain, gain_both >= gain_side

    def _height_ratio(self, height: Array, head: HeadInnovations) -> Array:
        """Log-likelihood ratio (t, d) of the heights of boxes by the statures of the tracks, over those of people in general."""
        p = self.parameters.fusion.ranges
        outlier = p.outlier_share / (p.stature_range[1] - p.stature_range[0])
        track, anybody = (
            (1 - p.outlier_share) * np.exp(-0.5 * above**2 / spread) / np.sqrt(2 * np.pi * spread) + outlier
            for above, spread in ((head.above, head.spread), (height - p.stature, p.stature_sigma**2 + head.noise))
        )
        return np.log(track / anybody)

    def _score(self, views: list[GroundDetections], cameras: list[Viewpoint], box: Ints, gains: tuple[Array, Array]) -> Array:
        """Update existence scores (C_rec) and counts of all tracks by detections and missed detections; the expected detection (t, v).

        box (t, v): the box of each track, −1 for none; gains: its log-likelihood ratio and the gain of the best rival, (t, v) each.
        """
        q, tracks, (gain, rival) = self.parameters, self.tracks, gains
        visibility, bodies = self._expected_visibility(cameras), self.sensor_model.bodies(tracks.state[:, :2], tracks.tree, np.arange(len(tracks)))
        miss, watched = np.zeros(box.shape), bodies.in_any_view(cameras)
        for v, feet in enumerate(views):
            miss[:, v] = self.sensor_model.missed(feet.camera, visibility.share[:, v])
        seen = box >= 0
        any_seen = seen.any(axis=1)
        # A box that another track would take is little evidence for this one: without it the data would be as likely.
        total = np.where(seen, np.minimum(gain - rival, q.max_gain), miss).sum(axis=1)
        score = tracks.score + np.where(any_seen, total, np.maximum(total, self.sensor_model.joint_miss(views)))
        self.tracks = replace(
            tracks,
            score=np.clip(score, -20.0, q.max_score),
            hits=tracks.hits + any_seen,
            misses=np.where(any_seen, 0, tracks.misses + 1),
        )
        self._outside = np.where(watched | any_seen, 0.0, self._outside + self.setup.period)
        self._update_merge_scores(seen, miss, gain)
        # A tentative track may be false, so that its missed detections tell nothing about its place.
        self.tracks = visibility.given_misses(self.tracks, seen | ~self.confirmed[:, None], self.detection(views))
        return visibility.share

    def _update_merge_scores(self, seen: Mask, miss: Array, gain: Array) -> None:
        """Update the log-likelihood ratios of two tracks being one person, for all pairs near each other.

        A view with a box of each supports two people. A view with a box of only one supports one person, by the cost of the miss.
        """
        q = self.parameters
        near = np.linalg.norm(self.tracks.state[:, None, :2] - self.tracks.state[None, :, :2], axis=2) < q.merge_distance
        now: dict[tuple[int, int], float] = {}
        for i, j in np.argwhere(np.triu(near, 1)):
            key = (int(self.tracks.tree[i]), int(self.tracks.tree[j]))
            both = seen[i] & seen[j]
            # The farther one may be hidden by the nearer one, which is no evidence.
            one = float(-np.maximum(miss[i], miss[j])[~both].sum())
            two = float(np.clip(np.minimum(gain[i], gain[j]), 0.0, q.max_gain)[both].sum())
            now[key] = max(self._merge_scores.get(key, 0.0) + min(one, q.merge_step) - q.split_share * two, -10.0)
        self._merge_scores = now

    def _initiate(self, views: list[GroundDetections], cameras: list[Viewpoint], free: list[Mask], seen: Mask) -> list[tuple[int, CrossViewGroup]]:
        """Initiate tracks from groups of free boxes; the new trees with their groups.

        A group near a track without a box in its views is the same person and initiates nothing. free: boxes (d,) of each view; seen (t, v): which
        tracks have a box.
        """
        q = self.parameters
        groups = group_across_views(views, free, self.setup.height, q.fusion)
        groups = [g for g in groups if not self._near_existing(g, seen)]
        new = initiated(self._next_tree, groups, q.motion, self._stature)
        for k, group in enumerate(groups):
            new = self._with_stature(new, k, [(views[v], d) for v, d in group.members])
        seen_by = list(zip(views, cameras, strict=True))
        new = self._with_walkable_prior(
            replace(new, score=self.sensor_model.initiation_score(seen_by, groups, (self.tracks.state[:, :2], self.tracks.tree), self._ticks))
        )
        self._next_tree += len(groups)
        self.tracks = self.tracks.join(new)
        self.confirmed = np.concatenate([self.confirmed, np.zeros(len(groups), dtype=bool)])
        self._outside = np.concatenate([self._outside, np.zeros(len(groups))])
        return list(zip(new.tree.tolist(), groups, strict=True))

    def _with_stature(self, new: Tracks, k: int, boxes: list[tuple[GroundDetections, int]]) -> Tracks:
        """The tracks with the one in row k of `new` updated by the upper edges of the boxes that initiate it."""
        q = self.parameters
        usable = [(feet, d) for feet, d in boxes if feet.ranges is not None and not feet.ambiguous[d] and not feet.cut[d]]
        for feet, d in usable:
            one = new.select(np.array([k]))
            foot = innovations(one, feet, self.sensor_model.registration_bias.at(feet.camera, one.state[:, :2]), self.setup.ground, q.motion)
            head = head_innovations(one, foot, feet, q.fusion.ranges.head_sigma)
            if head.within_gate(q.gate)[0, d]:
                new = update(new, k, head.above[0, d, None], head.H[0, d, None], head.noise[:, d, None])
        return new if usable or not boxes[0][0].ambiguous[boxes[0][1]] else initiated_along_ray(new, k, *boxes[0])

    def _with_walkable_prior(self, tracks: Tracks) -> Tracks:
        """The tracks with places and scores updated by the walkable prior."""
        if self._walkable is None or not len(tracks):
            return tracks
        before = tracks.state[:, :2], tracks.covariance[:, :2, :2]
        mean, covariance, prior = self._walkable.posterior(*before)
        rows = np.flatnonzero(prior < CERTAIN_PRIOR)
        tracks = replace(tracks, score=tracks.score + np.log(np.where(prior < CERTAIN_PRIOR, prior, 1.0)))
        place = np.broadcast_to(np.eye(2, 5), (len(rows), 2, 5))
        return with_marginal(tracks, rows, place, (before[0][rows], before[1][rows]), (mean[rows], covariance[rows]))

    def _near_existing(self, group: CrossViewGroup, seen: Mask) -> bool:
        """Whether a recent track near the group has no box in the group's views."""
        near = np.linalg.norm(self.tracks.state[:, :2] - group.point, axis=1) < self.parameters.merge_distance
        distinct = seen[:, [v for v, _ in group.members]].any(axis=1)
        return bool((near & ~distinct & (self.tracks.misses < 3)).any())

    def _confirm_and_delete(self) -> None:
        """Confirm tracks, re-identify lost people, and delete tracks, of two that are one person the weaker one."""
        q, tracks = self.parameters, self.tracks
        before = self.confirmed
        self.confirmed = before | ((tracks.hits >= q.n_conf) & (tracks.score >= q.confirm_score) & (tracks.misses == 0))
        left = self._outside > q.max_outside
        replaced = self.reidentification.step(tracks, self.confirmed, self.confirmed & ~before, set(tracks.tree[left].tolist()))
        coasting = round(q.coasting_factor * q.delta_a / self.setup.period)
        kept = (tracks.misses <= coasting) & (tracks.score > q.delete_confirmed_score) & ~left & ~np.isin(tracks.tree, list(replaced))
        keep = np.where(self.confirmed, kept, (tracks.misses < 4) & (tracks.score > q.delete_tentative_score)) & (tracks.speed <= q.motion.v_max)
        place = {int(tree): k for k, tree in enumerate(tracks.tree)}
        for (a, b), ratio in self._merge_scores.items():
            if ratio > q.merge_score and a in place and b in place:
                i, j = place[a], place[b]
                worse = j if (self.confirmed[i], tracks.hits[i]) >= (self.confirmed[j], tracks.hits[j]) else i
                keep[worse] = False
        self.tracks, self.confirmed, self._outside = tracks.select(keep), self.confirmed[keep], self._outside[keep]


def _box_owners(boxes: int, tree: Ints, box: Ints, new: list[tuple[int, int]]) -> Ints:
    """The tree (boxes,) of each box of a view, −1 for none; box (t,): of the trees `tree` (t,); new: pairs of new trees and their boxes."""
    out = np.full(boxes, -1, dtype=np.int64)
    out[box[box >= 0]] = tree[box >= 0]
    for number, d in new:
        if d >= 0:
            out[d] = number
    return out


@final
class GnnTracker:
    """The tracker of people with one hypothesis, which reports `delay` ticks late. Raises ValueError where delay is below 0."""

    def __init__(self, setup: Setup, parameters: TrackParameters, delay: int) -> None:
        self.filter = GnnFilter(setup, parameters)
        self._lag = GnnFixedLagSmoother(delay, setup.period, parameters.motion)

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> Tracks | None:
        """Take a tick; the people of the tick `delay` before it, None where there is none."""
        tracks, confirmed = self.filter.step(views, cameras)
        miss_probability = partial(self.filter.miss_probability, tracks, cameras, self.filter.detection(views))
        return self._reported(self._lag.feed(tracks, confirmed, miss_probability))

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that is not reported yet; None where all are."""
        return self._reported(self._lag.drain())

    def _reported(self, people: Tracks | None) -> Tracks | None:
        return None if people is None else self.filter.reidentification.relabelled(people)
