"""Which boxes are which people: the global hypothesis, from frame to frame.

One hypothesis is kept: per view the assignment of boxes to tracks with the highest likelihood, new tracks from what is left over.
`Hypotheses.step` takes what all views have at a tick and gives the tracks that are believed.
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
from tracker.tracks.tracks import Heads, Sights, Tracks, heads, informed, initiated, predict, sights, update
from tracker.types import Setup

AMID = 0.99
"""Where tracks are so likely on firm ground, it says nothing new of them."""


class GnnFilter:
    """The online tracker of people. State after a tick depends on ticks up to it alone."""

    def __init__(self, setup: Setup, parameters: TrackParameters) -> None:
        self.setup, self.parameters = setup, parameters
        self.tracks = Tracks.none()
        self.believed = np.zeros(0, dtype=bool)
        self.evidence = SensorModel(setup, parameters)
        people = parameters.fusion.standpoints
        self._stature = people.stature, people.stature_sigma
        self._footing = WalkablePrior.of(setup.ground, setup.occluders, people.footing)
        self.reunions = Reidentification(parameters.reunion, parameters.motion, setup.period, NewTargetModel(parameters.arrivals, *self._stature))
        self._next_tree = 1
        self._one: dict[tuple[int, int], float] = {}  # trees near each other → log-likelihood ratio of being one person
        self._owners = TrackOwners()
        self._ticks = 0
        self._bridged = round(parameters.delta_a / setup.period)
        self._gone = np.zeros(0)  # s for which a track was out of all views

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> tuple[Tracks, Mask]:
        """Take one tick; cameras: from where each view looks. All tracks, and which of them the best hypothesis holds."""
        q = self.parameters
        self.tracks = self._placed(predict(self.tracks, self.setup.period, q.motion))
        taken = [feet.confidence < q.least_confidence for feet in views]
        self._ticks += 1
        box = np.full((len(self.tracks), len(views)), -1, dtype=np.int64)
        gain, wanted = np.zeros(box.shape), np.zeros(box.shape)
        ahead = self._outlook(cameras).share
        for v, feet in enumerate(views):
            if len(feet) and len(self.tracks):
                none = self.evidence.missed(feet.camera, ahead[:, v])
                self._assign(feet, taken[v], none, (box[:, v], gain[:, v], wanted[:, v]))
        expected = self._judge(views, cameras, box, (gain, wanted))
        sure = self.believed & (self.tracks.misses <= self._bridged)
        self.evidence.learn(views, box, expected, (sure, self.tracks.score))
        seen = box >= 0
        trees = self.tracks.tree
        free = [~t & (f.confidence >= q.birth_confidence) for t, f in zip(taken, views, strict=True)]
        groups = self._bear(views, cameras, free, seen)
        for v, feet in enumerate(views):
            if feet.links is not None:
                self._owners.add(feet.camera, _owners(len(feet), trees, box[:, v], [(tree, dict(g.members).get(v, -1)) for tree, g in groups]))
        self._prune()
        return self.tracks, self.believed & (self.tracks.misses <= self._bridged)

    def detection(self, views: list[GroundDetections]) -> Array:
        """How often each view (v,) has a box of who is in full view, by now."""
        return np.array([self.evidence.detection(feet.camera) for feet in views])

    def unseen(self, others: Tracks, cameras: list[Viewpoint], detection: Array, people: Tracks) -> Array:
        """How likely (n,) `cameras`, with such a detection (v,), show no box of `people` among `others`."""
        both = others.join(people)
        bodies = self.evidence.bodies(both.state[:, :2], both.tree, np.arange(len(others)))
        share = bodies.by_view(cameras, self.parameters.fusion.reach)[len(others) :]
        return np.asarray((1 - detection * share).prod(axis=1))

    def _outlook(self, cameras: list[Viewpoint]) -> ExpectedVisibility:
        """What the views should have boxes of now."""
        return ExpectedVisibility.of(self.tracks, cameras, self.evidence)

    def _assign(self, feet: GroundDetections, taken: Mask, none: Array, given: tuple[Ints, Array, Array]) -> None:
        """Give each track at most one box of this view, by the highest sum of log-likelihood ratios, and correct it; none (t,): that of no box.

        A doubtful box keeps somebody who is known from another's, and says nothing else. given: box of each track, its log-likelihood ratio, and
        what another track would gain by it.
        """
        q = self.parameters
        place = self.tracks.state[:, :2]
        offset = self.evidence.offsets.at(feet.camera, place)
        look = sights(self.tracks, feet, offset, self.setup.ground, q.motion)
        tops = heads(self.tracks, look, feet, q.fusion.standpoints.nod)
        (gain, upright), fit = self._gain(look, tops, feet), tops.fit(q.gate)
        vague = AmbiguousUpdate.of(self.tracks, feet, np.flatnonzero(feet.vague), offset, q.motion.foot_spread)
        if len(vague.box):
            gain[:, vague.box] = self.evidence.certain(feet)[vague.box] + vague.density(q.gate)
        gain[:, taken] = -np.inf
        doubtful = feet.confidence < q.min_confidence
        gain[np.ix_(~self.believed, doubtful)] = -np.inf
        # What images say decides whose box it is, but not whether there is anybody.
        found = self.evidence.detection(feet.camera)
        worth = gain + self._owners.links(feet.camera, self.tracks.tree, feet.links, q.before * (1 - found)) if feet.links else gain
        rows, boxes = linear_sum_assignment(np.where(worth > none[:, None], none[:, None] - worth, 0.0))
        chosen = worth[rows, boxes] > none[rows]
        rows, boxes = rows[chosen], boxes[chosen]
        taken[boxes] = True
        rows, boxes = rows[~doubtful[boxes]], boxes[~doubtful[boxes]]
        given[0][rows], given[1][rows], given[2][rows] = boxes, gain[rows, boxes], self._wanted(worth, none, rows, boxes)
        for t, d in zip(rows, boxes, strict=True):
            if feet.vague[d]:
                self.tracks = vague.correct(self.tracks, int(t), int(np.searchsorted(vague.box, d)))
                continue
            H, r, R = look.H[t], look.residual[t, d], feet.covariance[d]
            R = R + (H @ H.T) * q.motion.foot_spread**2
            if not upright[t, d]:
                H, r, R = H[:1], r[:1], R[:1, :1]
            elif self.believed[t]:
                S = R + H @ self.tracks.covariance[t, :2, :2] @ H.T
                self.evidence.offsets.learn(feet.camera, place[t, None], (r[None], H[None], S[None]))
            if (feet.lines is not None or (not upright[t, d] and feet.cut[d])) and fit[t, d]:
                # The head tells how far somebody is, too, as well as it is known how tall.
                H, r = np.vstack([np.column_stack([H, np.zeros(len(H))]), tops.H[t, d]]), np.append(r, tops.above[t, d])
                R = block_diag(R, tops.noise[t, d])
            self.tracks = update(self.tracks, int(t), r, H, R)

    def _wanted(self, worth: Array, none: Array, rows: Ints, boxes: Ints) -> Array:
        """What (k,) the track that wants it most would gain by the box of each of `rows`, given as `boxes`; of the young the known lose nothing."""
        now = none.copy()
        now[rows] = worth[rows, boxes]
        others = worth[:, boxes].T
        more = np.where(others > none, others - now, 0.0)
        more[np.arange(len(rows)), rows] = 0.0
        more[np.ix_(self.believed[rows], ~self.believed)] = 0.0
        return np.asarray(more.max(axis=1, initial=0.0))

    def _gain(self, look: Sights, tops: Heads, feet: GroundDetections) -> tuple[Array, Mask]:
        """Log-likelihood ratio (t, d) of "this track's box" over "clutter", −inf outside the gate; and whether the feet were taken as seen."""
        q = self.parameters
        S = look.expected[:, None] + feet.covariance[None, :]
        r = np.where(np.isfinite(look.residual), look.residual, 1e3)
        a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
        det = a * c - b * b
        both = (c * r[..., 0] ** 2 - 2 * b * r[..., 0] * r[..., 1] + a * r[..., 1] ** 2) / det
        side = r[..., 0] ** 2 / a
        certain = self.evidence.certain(feet)[None, :]
        lying = feet.lying[None, :]
        gain_both = certain + np.log(1 - lying) - 0.5 * (both + np.log((2 * np.pi) ** 2 * det))
        # Feet out of sight: the lower edge is anywhere above where they must be, as far up as the body reaches.
        body = np.arctan2(1.2, look.distance)[:, None]
        above = (r[..., 1] > -2 * np.sqrt(c)) & (r[..., 1] < body)
        gain_side = certain + np.log(lying / body) - 0.5 * (side + np.log(2 * np.pi * a))
        gain_both[both > q.gate**2] = -np.inf
        gain_side[(side > q.gate**2) | ~above | (self.tracks.doubt > q.surely)[:, None]] = -np.inf
        low, high = self.setup.height
        slack = 0.15 + 0.02 * look.distance[:, None]
        fits = (look.height > low - slack) & (look.height < high + slack)
        gain = np.where(fits, np.maximum(gain_both, gain_side), -np.inf)
        if feet.lines is not None:
            gain += self._known_by_height(look.height, tops)
        return gain, gain_both >= gain_side

    def _known_by_height(self, height: Array, tops: Heads) -> Array:
        """Log-likelihood ratio (t, d) of boxes being as tall as these tracks, against as tall as anybody."""
        p = self.parameters.fusion.standpoints
        strange = p.strange / (p.tall[1] - p.tall[0])
        mine, anybody = (
            (1 - p.strange) * np.exp(-0.5 * above**2 / spread) / np.sqrt(2 * np.pi * spread) + strange
            for above, spread in ((tops.above, tops.spread), (height - p.stature, p.stature_sigma**2 + tops.noise))
        )
        return np.log(mine / anybody)

    def _judge(self, views: list[GroundDetections], cameras: list[Viewpoint], box: Ints, gains: tuple[Array, Array]) -> Array:
        """Score every track by what saw it and what should have (C_rec), and count frames; how often (t, v) each view should have a box."""
        q, tracks, (gain, wanted) = self.parameters, self.tracks, gains
        outlook, bodies = self._outlook(cameras), self.evidence.bodies(tracks.state[:, :2], tracks.tree, np.arange(len(tracks)))
        miss, watched = np.zeros(box.shape), bodies.watched(cameras)
        for v, feet in enumerate(views):
            miss[:, v] = self.evidence.missed(feet.camera, outlook.share[:, v])
        seen = box >= 0
        any_seen = seen.any(axis=1)
        # A box that another track would take says little for this one: all would be as likely without it.
        total = np.where(seen, np.minimum(gain - wanted, q.most_gain), miss).sum(axis=1)
        score = tracks.score + np.where(any_seen, total, np.maximum(total, self.evidence.at_once(views)))
        self.tracks = replace(
            tracks,
            score=np.clip(score, -20.0, q.most_score),
            hits=tracks.hits + any_seen,
            misses=np.where(any_seen, 0, tracks.misses + 1),
        )
        self._gone = np.where(watched | any_seen, 0.0, self._gone + self.setup.period)
        self._remember_apart(seen, miss, gain)
        # Who is not believed may be nobody, and then no view shows nobody for a reason.
        self.tracks = outlook.without(self.tracks, seen | ~self.believed[:, None], self.detection(views))
        return outlook.share

    def _remember_apart(self, seen: Mask, miss: Array, gain: Array) -> None:
        """Two tracks that one view saw at once are two people; that views see but one of them speaks for one person, by what a miss is worth."""
        q = self.parameters
        near = np.linalg.norm(self.tracks.state[:, None, :2] - self.tracks.state[None, :, :2], axis=2) < q.same_person
        now: dict[tuple[int, int], float] = {}
        for i, j in np.argwhere(np.triu(near, 1)):
            key = (int(self.tracks.tree[i]), int(self.tracks.tree[j]))
            both = seen[i] & seen[j]
            # The farther one may be hidden by the nearer, which is no miss.
            one = float(-np.maximum(miss[i], miss[j])[~both].sum())
            two = float(np.clip(np.minimum(gain[i], gain[j]), 0.0, q.most_gain)[both].sum())
            now[key] = max(self._one.get(key, 0.0) + min(one, q.alone) - q.apart * two, -10.0)
        self._one = now

    def _bear(self, views: list[GroundDetections], cameras: list[Viewpoint], free: list[Mask], seen: Mask) -> list[tuple[int, CrossViewGroup]]:
        """Start a track where boxes are left over, unless a track stands there that these views did not see: that is the same person.

        The new trees and what they come from.
        """
        q = self.parameters
        groups = group_across_views(views, free, self.setup.height, q.fusion)
        groups = [g for g in groups if not self._known(g, seen)]
        new = initiated(self._next_tree, groups, q.motion, self._stature)
        for k, group in enumerate(groups):
            new = self._grown(new, k, [(views[v], d) for v, d in group.members])
        seen_by = list(zip(views, cameras, strict=True))
        new = self._placed(replace(new, score=self.evidence.prior(seen_by, groups, (self.tracks.state[:, :2], self.tracks.tree), self._ticks)))
        self._next_tree += len(groups)
        self.tracks = self.tracks.join(new)
        self.believed = np.concatenate([self.believed, np.zeros(len(groups), dtype=bool)])
        self._gone = np.concatenate([self._gone, np.zeros(len(groups))])
        return list(zip(new.tree.tolist(), groups, strict=True))

    def _grown(self, new: Tracks, k: int, boxes: list[tuple[GroundDetections, int]]) -> Tracks:
        """The track in row k of `new` with what these boxes, from which it starts, say of how tall it is, and so of where."""
        q = self.parameters
        clear = [(feet, d) for feet, d in boxes if feet.lines is not None and not feet.vague[d] and not feet.cut[d]]
        for feet, d in clear:
            one = new.select(np.array([k]))
            look = sights(one, feet, self.evidence.offsets.at(feet.camera, one.state[:, :2]), self.setup.ground, q.motion)
            tops = heads(one, look, feet, q.fusion.standpoints.nod)
            if tops.fit(q.gate)[0, d]:
                new = update(new, k, tops.above[0, d, None], tops.H[0, d, None], tops.noise[:, d, None])
        return new if clear or not boxes[0][0].vague[boxes[0][1]] else initiated_along_ray(new, k, *boxes[0])

    def _placed(self, tracks: Tracks) -> Tracks:
        """The tracks where people can be, and their scores by how likely they are there."""
        if self._footing is None or not len(tracks):
            return tracks
        before = tracks.state[:, :2], tracks.covariance[:, :2, :2]
        mean, covariance, likely = self._footing.meet(*before)
        rows = np.flatnonzero(likely < AMID)
        tracks = replace(tracks, score=tracks.score + np.log(np.where(likely < AMID, likely, 1.0)))
        place = np.broadcast_to(np.eye(2, 5), (len(rows), 2, 5))
        return informed(tracks, rows, place, (before[0][rows], before[1][rows]), (mean[rows], covariance[rows]))

    def _known(self, group: CrossViewGroup, seen: Mask) -> bool:
        near = np.linalg.norm(self.tracks.state[:, :2] - group.point, axis=1) < self.parameters.same_person
        apart = seen[:, [v for v, _ in group.members]].any(axis=1)
        return bool((near & ~apart & (self.tracks.misses < 3)).any())

    def _prune(self) -> None:
        q, tracks = self.parameters, self.tracks
        before = self.believed
        self.believed = before | ((tracks.hits >= q.n_conf) & (tracks.score >= q.believe) & (tracks.misses == 0))
        away = self._gone > q.outside
        back = self.reunions.step(tracks, self.believed, self.believed & ~before, set(tracks.tree[away].tolist()))
        patience = round(q.followed * q.delta_a / self.setup.period)
        known = (tracks.misses <= patience) & (tracks.score > q.end) & ~away & ~np.isin(tracks.tree, list(back))
        keep = np.where(self.believed, known, (tracks.misses < 4) & (tracks.score > q.forget)) & (tracks.speed <= q.motion.v_max)
        place = {int(tree): k for k, tree in enumerate(tracks.tree)}
        for (a, b), ratio in self._one.items():
            if ratio > q.duplicate and a in place and b in place:
                i, j = place[a], place[b]
                worse = j if (self.believed[i], tracks.hits[i]) >= (self.believed[j], tracks.hits[j]) else i
                keep[worse] = False
        self.tracks, self.believed, self._gone = tracks.select(keep), self.believed[keep], self._gone[keep]


def _owners(boxes: int, tree: Ints, box: Ints, new: list[tuple[int, int]]) -> Ints:
    """The trees (boxes,) whose the boxes of a view are, −1 for nobody's: box (t,) of the trees that there were, and (tree, box) of new ones."""
    out = np.full(boxes, -1, dtype=np.int64)
    out[box[box >= 0]] = tree[box >= 0]
    for number, d in new:
        if d >= 0:
            out[d] = number
    return out


@final
class GnnTracker:
    """The tracker of people with one hypothesis, told `delay` ticks late. Raises ValueError where delay is below 0."""

    def __init__(self, setup: Setup, parameters: TrackParameters, delay: int) -> None:
        self.hypotheses = GnnFilter(setup, parameters)
        self._lag = GnnFixedLagSmoother(delay, setup.period, parameters.motion)

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> Tracks | None:
        """Take a tick; the people of the tick `delay` before it, None where there was none."""
        tracks, believed = self.hypotheses.step(views, cameras)
        unseen = partial(self.hypotheses.unseen, tracks, cameras, self.hypotheses.detection(views))
        return self._told(self._lag.feed(tracks, believed, unseen))

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that was not told yet; None where all are."""
        return self._told(self._lag.drain())

    def _told(self, people: Tracks | None) -> Tracks | None:
        return None if people is None else self.hypotheses.reunions.renamed(people)
