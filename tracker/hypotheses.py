"""Which boxes are which people: the global hypothesis, from frame to frame.

One hypothesis is kept: per view the assignment of boxes to tracks with the highest likelihood, new tracks from what is left over.
`Hypotheses.step` takes what all views have at a tick and gives the tracks that are believed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tracker.cameras import Camera
from tracker.fusion import Combination, Feet, FusionParameters, combine
from tracker.geometry import Array, Pose
from tracker.measurements import Ints, Setup
from tracker.smoothing import Lag
from tracker.tracklets import Owners
from tracker.trees import MotionParameters, Sights, Tracks, born, predict, sights, update
from tracker.trust import Trust, TrustParameters
from tracker.visibility import Bodies

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TargetParameters:
    """Named as in the paper where it has a name for it; times in seconds, so that other frame rates work."""

    fusion: FusionParameters = field(default_factory=FusionParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    trust: TrustParameters = field(default_factory=TrustParameters)
    min_confidence: float = 0.6  # boxes below are not looked at
    birth_confidence: float = 0.8  # and below this they start nobody
    arrivals: float = 2e-4  # people who appear, a square metre and tick ...
    present: float = 2e-2  # ... and who are there at the start, a square metre
    most_gain: float = 6.0  # log-likelihood ratio that one box counts at most
    alone: float = 2.0  # log-likelihood ratio for one person, at most, of a tick in which views see but one of two tracks ...
    apart: float = 0.8  # ... and share of what a view's second box is worth that speaks for two
    duplicate: float = 10.0  # log-likelihood ratio from which two tracks are one person
    gate: float = 4.0  # standard deviations of the innovation
    delta_a: float = 9 / 7  # s, longest gap that is bridged
    n_conf: int = 2  # frames until a track may be believed
    believe: float = 4.0  # score from which it is
    forget: float = -8.0  # score below which a young track is dropped
    end: float = -5.0  # the same for one that was believed
    most_score: float = 20.0  # what is known of somebody counts at most so much against what is seen now
    at_once: float = 2.0  # misses that all views' missing somebody at once is worth, at most
    stature: tuple[float, float] = (1.72, 0.1)  # m, how tall people are, mean and standard deviation; asked where things hide their feet
    surely: float = 0.6  # m, standard deviation of a place up to which a box without feet is taken
    before: float = 0.3  # share of those without a box who stand before somebody else's, whose corners are theirs then
    outside: float = 3 / 7  # s, after which somebody is gone who is out of all views
    same_person: float = 1.0  # m, two tracks nearer than this that no view tells apart are one person
    offset_sigma: float = 0.3  # m, how far a view may be off on the ground for good; 0 switches the correction off
    offset_memory: float = 30.0  # innovations that are worth one independent look at the offset: they come in runs


class Hypotheses:
    """The online tracker of people. State after a tick depends on ticks up to it alone."""

    def __init__(self, setup: Setup, parameters: TargetParameters) -> None:
        self.setup, self.parameters = setup, parameters
        self.tracks = Tracks.none()
        self.believed = np.zeros(0, dtype=bool)
        self.offsets: dict[str, tuple[Array, Array]] = {}  # camera → offset (2,) m on the ground, covariance (2, 2)
        self._next_tree = 1
        self._one: dict[tuple[int, int], float] = {}  # trees near each other → log-likelihood ratio of being one person
        area = setup.area
        square = float(np.prod(area[1] - area[0])) if area is not None else np.pi * parameters.trust.watched**2
        self.trust = Trust(parameters.trust, square)
        self._owners = Owners()
        self._ticks = 0
        self._gone = np.zeros(0)  # s for which a track was out of all views

    def step(self, views: list[Feet], cameras: list[tuple[Camera, Pose]]) -> tuple[Tracks, Mask]:
        """Take one tick; cameras: model and T_world_camera of each view. All tracks, and which of them the best hypothesis holds."""
        q = self.parameters
        self.tracks = predict(self.tracks, self.setup.period, q.motion)
        taken = [feet.confidence < q.min_confidence for feet in views]
        self._ticks += 1
        box = np.full((len(self.tracks), len(views)), -1, dtype=np.int64)
        gain = np.zeros(box.shape)
        for v, feet in enumerate(views):
            if len(feet) and len(self.tracks):
                self._assign(v, feet, taken[v], (box[:, v], gain[:, v]))
        expected = self._judge(views, cameras, box, gain)
        self._learn(views, box, expected)
        seen = box >= 0
        trees = self.tracks.tree
        free = [~t & (f.confidence >= q.birth_confidence) for t, f in zip(taken, views, strict=True)]
        groups = self._bear(views, cameras, free, seen)
        for v, feet in enumerate(views):
            if feet.links is not None:
                self._owners.add(feet.camera, _owners(len(feet), trees, box[:, v], [(tree, dict(g.members).get(v, -1)) for tree, g in groups]))
        self._prune()
        return self.tracks, self.believed & (self.tracks.misses * self.setup.period <= q.delta_a)

    def _assign(self, v: int, feet: Feet, taken: Mask, given: tuple[Ints, Array]) -> None:
        """Give each track at most one box of this view, by the highest sum of log-likelihood ratios, and correct it."""
        q = self.parameters
        offset, _ = self._offset(feet.camera)
        look = sights(self.tracks, feet, offset, self.setup.ground, q.motion)
        gain, upright = self._gain(look, feet)
        gain[:, taken] = -np.inf
        # What images say decides whose box it is, but not whether there is anybody.
        found = self.trust.detection(feet.camera)
        worth = gain + self._owners.links(feet.camera, self.tracks.tree, feet.links, q.before * (1 - found)) if feet.links else gain
        least = np.log(1 - found)
        rows, boxes = linear_sum_assignment(np.where(worth > least, least - worth, 0.0))
        for t, d in zip(rows, boxes, strict=True):
            if not worth[t, d] > least:
                continue
            taken[d], given[0][t], given[1][t] = True, d, gain[t, d]
            H, r, R = look.H[t], look.residual[t, d], feet.covariance[d]
            R = R + (H @ H.T) * q.motion.foot_spread**2
            if not upright[t, d] and feet.walled[d]:
                # The head tells how far somebody is whose feet are hidden, as well as it is known how tall people are.
                H, r = np.stack([H[0], look.climb[t, d]]), np.array([r[0], q.stature[0] - look.height[t, d]])
                R = np.diag([R[0, 0], q.stature[1] ** 2 + feet.covariance[d, 1, 1] * look.distance[t] ** 2])
            elif not upright[t, d]:
                H, r, R = H[:1], r[:1], R[:1, :1]
            elif self.believed[t]:
                self._learn_offset(feet.camera, r, H, R + H @ self.tracks.covariance[t, :2, :2] @ H.T)
            self.tracks = update(self.tracks, int(t), r, H, R)

    def _offset(self, camera: str) -> tuple[Array, Array]:
        return self.offsets.get(camera, (np.zeros(2), self.parameters.offset_sigma**2 * np.eye(2)))

    def _learn_offset(self, camera: str, residual: Array, H: Array, S: Array) -> None:
        """Take an innovation, covariance S, as a look at this view's own offset; Kalman's update, S widened as looks are not independent."""
        if self.parameters.offset_sigma > 0:
            offset, P = self._offset(camera)
            K = np.linalg.solve(H @ P @ H.T + self.parameters.offset_memory * S, H @ P).T
            self.offsets[camera] = offset + K @ residual, P - K @ H @ P

    def _gain(self, look: Sights, feet: Feet) -> tuple[Array, Mask]:
        """Log-likelihood ratio (t, d) of "this track's box" over "clutter", −inf outside the gate; and whether the feet were taken as seen."""
        q = self.parameters
        S = look.expected[:, None] + feet.covariance[None, :]
        r = np.where(np.isfinite(look.residual), look.residual, 1e3)
        a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
        det = a * c - b * b
        both = (c * r[..., 0] ** 2 - 2 * b * r[..., 0] * r[..., 1] + a * r[..., 1] ** 2) / det
        side = r[..., 0] ** 2 / a
        # False boxes are even on the ground; on the sphere they are as dense as the ground is slanted and far.
        reach = np.where(feet.grounded, np.linalg.norm(feet.point - feet.origin, axis=1), q.fusion.reach)
        dense = np.log(reach**2 / np.maximum(-feet.direction[:, 2], 0.3 / reach))
        certain = (self.trust.worth(feet.camera, feet.confidence) - dense)[None, :]
        lying = feet.lying[None, :]
        gain_both = certain + np.log(1 - lying) - 0.5 * (both + np.log((2 * np.pi) ** 2 * det))
        # Feet out of sight: the lower edge is anywhere above where they must be, as far up as the body reaches.
        body = np.arctan2(1.2, look.distance)[:, None]
        above = (r[..., 1] > -2 * np.sqrt(c)) & (r[..., 1] < body)
        gain_side = certain + np.log(lying / body) - 0.5 * (side + np.log(2 * np.pi * a))
        gain_both[both > q.gate**2] = -np.inf
        gain_side[(side > q.gate**2) | ~above | (look.doubt > q.surely)[:, None]] = -np.inf
        low, high = self.setup.height
        slack = 0.15 + 0.02 * look.distance[:, None]
        fits = (look.height > low - slack) & (look.height < high + slack)
        return np.where(fits, np.maximum(gain_both, gain_side), -np.inf), gain_both >= gain_side

    def _judge(self, views: list[Feet], cameras: list[tuple[Camera, Pose]], box: Ints, gain: Array) -> Array:
        """Score every track by what saw it and what should have (C_rec), and count frames; how much (t, v) each view should see."""
        q, tracks = self.parameters, self.tracks
        everybody = np.arange(len(tracks))
        bodies = Bodies(tracks.state[:, :2], tracks.tree, everybody, self.setup.ground)
        expected, miss, floor, watched = np.zeros(box.shape), np.zeros(box.shape), 0.0, np.zeros(len(tracks), dtype=bool)
        for v, (feet, camera) in enumerate(zip(views, cameras, strict=True)):
            expected[:, v] = bodies.expected(camera, self.setup.occluders, q.fusion.reach)
            watched |= bodies.inside(camera)
            found = self.trust.detection(feet.camera)
            miss[:, v] = np.log(1 - found * expected[:, v])
            floor = min(floor, q.at_once * np.log(1 - found))
        seen = box >= 0
        any_seen = seen.any(axis=1)
        # Where all views lose a person at once they do so for one reason: that is two misses, not many.
        total = np.where(seen, np.minimum(gain, q.most_gain), miss).sum(axis=1)
        score = tracks.score + np.where(any_seen, total, np.maximum(total, floor))
        self.tracks = replace(
            tracks,
            score=np.clip(score, -20.0, q.most_score),
            hits=tracks.hits + any_seen,
            misses=np.where(any_seen, 0, tracks.misses + 1),
        )
        self._gone = np.where(watched | any_seen, 0.0, self._gone + self.setup.period)
        self._remember_apart(seen, miss, gain)
        return expected

    def _learn(self, views: list[Feet], box: Ints, expected: Array) -> None:
        """Count what each view found and missed of the people who are known, and what it showed beside them."""
        q, area = self.parameters, self.setup.area
        sure = self.believed & (self.tracks.misses * self.setup.period <= q.delta_a)
        for v, feet in enumerate(views):
            known = sure & (expected[:, v] > 0.5)
            weight = np.ones(len(feet))
            mine = box[:, v] >= 0
            weight[box[mine, v]] = 1 / (1 + np.exp(np.clip(self.tracks.score[mine], -20, 20)))
            weight[box[sure & mine, v]] = 0
            place = feet.point[:, :2]
            if area is None:
                inside = np.linalg.norm(place - feet.origin[:2], axis=1) < q.trust.watched
            else:
                inside = ((place >= area[0]) & (place <= area[1])).all(axis=1)
            low, high = self.setup.height
            other = inside & feet.grounded & (feet.height > low) & (feet.height < high) & (feet.confidence >= q.min_confidence)
            self.trust.learn(feet.camera, feet.confidence[box[known & mine, v]], float(known.sum()), (feet.confidence[other], weight[other]))

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

    def _bear(self, views: list[Feet], cameras: list[tuple[Camera, Pose]], free: list[Mask], seen: Mask) -> list[tuple[int, Combination]]:
        """Start a track where boxes are left over, unless a track stands there that these views did not see: that is the same person.

        The new trees and what they come from.
        """
        q = self.parameters
        groups = combine(views, free, self.setup.height, q.fusion)
        groups = [g for g in groups if not self._known(g, seen)]
        new = born(self._next_tree, groups, q.motion)
        new = replace(new, score=self._prior(views, cameras, groups))
        self._next_tree += len(groups)
        self.tracks = self.tracks.join(new)
        self.believed = np.concatenate([self.believed, np.zeros(len(groups), dtype=bool)])
        self._gone = np.concatenate([self._gone, np.zeros(len(groups))])
        return list(zip(new.tree.tolist(), groups, strict=True))

    def _prior(self, views: list[Feet], cameras: list[tuple[Camera, Pose]], groups: list[Combination]) -> Array:
        """log-likelihood ratio (g,) of "somebody new" over "false boxes": who sees, who should, and how rare new people are."""
        q = self.parameters
        rate = q.arrivals + q.present * np.exp(-(self._ticks - 1) * self.setup.period / 0.3)
        place = np.array([g.point for g in groups]).reshape(-1, 2)
        score = np.full(len(groups), np.log(rate))
        new = np.full(len(groups), -1, dtype=np.int64)
        bodies = Bodies(
            np.concatenate([place, self.tracks.state[:, :2]]), np.concatenate([new, self.tracks.tree]),
            np.arange(len(groups), len(groups) + len(self.tracks)), self.setup.ground,
        )  # fmt: skip
        for v, (feet, camera) in enumerate(zip(views, cameras, strict=True)):
            member = np.array([dict(g.members).get(v, -1) for g in groups], dtype=np.int64)
            expected = bodies.expected(camera, self.setup.occluders, q.fusion.reach)[: len(groups)]
            miss = np.log(1 - self.trust.detection(feet.camera) * expected)
            here = member >= 0
            score[~here] += miss[~here]
            score[here] += self.trust.worth(feet.camera, feet.confidence[member[here]]) + np.log(1 - feet.lying[member[here]])
        # Each box after the first must lie near: its density about the common place, at the spread of feet.
        size = np.array([len(g.members) for g in groups])
        area = np.array([2 * np.pi * np.sqrt(np.linalg.det(2 * n * g.covariance)) for n, g in zip(size, groups, strict=True)])
        return np.minimum(score - (size - 1) * np.log(np.maximum(area, 0.3)), q.most_gain * size)

    def _known(self, group: Combination, seen: Mask) -> bool:
        near = np.linalg.norm(self.tracks.state[:, :2] - group.point, axis=1) < self.parameters.same_person
        apart = seen[:, [v for v, _ in group.members]].any(axis=1)
        return bool((near & ~apart & (self.tracks.misses < 3)).any())

    def _prune(self) -> None:
        q, tracks = self.parameters, self.tracks
        self.believed = self.believed | ((tracks.hits >= q.n_conf) & (tracks.score >= q.believe) & (tracks.misses == 0))
        missed = tracks.misses * self.setup.period
        known = (missed <= 2 * q.delta_a) & (tracks.score > q.end) & (self._gone <= q.outside)
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
class SingleTargets:
    """The tracker of people with one hypothesis, told `delay` ticks late. Raises ValueError where delay is below 0."""

    def __init__(self, setup: Setup, parameters: TargetParameters, delay: int) -> None:
        self.hypotheses = Hypotheses(setup, parameters)
        self._lag = Lag(delay, setup.period, parameters.motion)

    def step(self, views: list[Feet], cameras: list[tuple[Camera, Pose]]) -> Tracks | None:
        """Take a tick; the people of the tick `delay` before it, None where there was none."""
        return self._lag.feed(*self.hypotheses.step(views, cameras))

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that was not told yet; None where all are."""
        return self._lag.drain()
