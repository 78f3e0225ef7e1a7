"""Which boxes are which people: the global hypothesis, from frame to frame (METHOD 6 and 7).

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
from tracker.measurements import Setup
from tracker.smoothing import Lag
from tracker.trees import MotionParameters, Sights, Tracks, body_points, born, predict, shadowed, sights, update

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class TargetParameters:
    """METHOD 8 by name where it has one; times in seconds, so that other frame rates work."""

    fusion: FusionParameters = field(default_factory=FusionParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    min_confidence: float = 0.6  # boxes below are not looked at
    birth_confidence: float = 0.8  # and below this they start nobody
    false_positive: float = 0.05  # FP
    false_negative: float = 0.1  # FN
    clutter: float = 2.0  # false boxes a steradian: what a box must beat to be taken
    gate: float = 4.0  # standard deviations of the innovation
    hidden_feet: float = 0.15  # how often a box ends above the feet for no reason that is known
    delta_a: float = 9 / 7  # s, longest gap that is bridged
    n_conf: int = 2  # frames until a track may be believed
    believe: float = 6.0  # score from which it is
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
        self._together: dict[tuple[int, int], int] = {}

    def step(self, views: list[Feet], cameras: list[tuple[Camera, Pose]]) -> tuple[Tracks, Mask]:
        """Take one tick; cameras: model and T_world_camera of each view. All tracks, and which of them the best hypothesis holds."""
        q = self.parameters
        self.tracks = predict(self.tracks, self.setup.period, q.motion)
        taken = [feet.confidence < q.min_confidence for feet in views]
        seen = np.zeros((len(self.tracks), len(views)), dtype=bool)
        for v, feet in enumerate(views):
            if len(feet) and len(self.tracks):
                self._assign(v, feet, taken[v], seen)
        self._judge(views, cameras, seen)
        free = [~t & (f.confidence >= q.birth_confidence) for t, f in zip(taken, views, strict=True)]
        self._bear(views, free, seen)
        self._prune()
        return self.tracks, self.believed & (self.tracks.misses * self.setup.period <= q.delta_a)

    def _assign(self, v: int, feet: Feet, taken: Mask, seen: Mask) -> None:
        """Give each track at most one box of this view, by the highest sum of log-likelihood ratios, and correct it."""
        q = self.parameters
        offset, _ = self._offset(feet.camera)
        look = sights(self.tracks, feet, offset, self.setup.ground, q.motion)
        gain, upright = self._gain(look, feet)
        gain[:, taken] = -np.inf
        rows, boxes = linear_sum_assignment(np.where(gain > 0, -gain, 0.0))
        for t, d in zip(rows, boxes, strict=True):
            if not gain[t, d] > 0:
                continue
            taken[d], seen[t, v] = True, True
            m = 2 if upright[t, d] else 1
            H, r = look.H[t, :m], look.residual[t, d, :m]
            R = feet.covariance[d, :m, :m] + (H @ H.T) * q.motion.foot_spread**2
            if m == 2 and self.believed[t]:
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
        certain = np.log((1 - q.false_negative) / q.clutter)
        lying = np.where(feet.hidden, 0.6, q.hidden_feet)[None, :]
        gain_both = certain + np.log(1 - lying) - 0.5 * (both + np.log((2 * np.pi) ** 2 * det))
        # Feet out of sight: the lower edge is anywhere above where they must be, as far up as the body reaches.
        body = np.arctan2(1.2, look.distance)[:, None]
        above = (r[..., 1] > -2 * np.sqrt(c)) & (r[..., 1] < body)
        gain_side = certain + np.log(lying / body) - 0.5 * (side + np.log(2 * np.pi * a))
        gain_both[both > q.gate**2] = -np.inf
        gain_side[(side > q.gate**2) | ~above] = -np.inf
        low, high = self.setup.height
        slack = 0.15 + 0.02 * look.distance[:, None]
        fits = (look.height > low - slack) & (look.height < high + slack)
        return np.where(fits, np.maximum(gain_both, gain_side), -np.inf), gain_both >= gain_side

    def _judge(self, views: list[Feet], cameras: list[tuple[Camera, Pose]], seen: Mask) -> None:
        """Score every track by what saw it and what should have (METHOD 5, C_rec), and count frames."""
        q, tracks = self.parameters, self.tracks
        hit, miss = np.log((1 - q.false_positive) / q.false_positive), np.log(q.false_negative / (1 - q.false_negative))
        gain = np.zeros(len(tracks))
        for v, (feet, (camera, pose)) in enumerate(zip(views, cameras, strict=True)):
            expected = self._expected(feet, camera, pose)
            gain += np.where(seen[:, v], hit, miss * expected)
        any_seen = seen.any(axis=1)
        # Where all views lose a person at once they do so for one reason: that is two misses, not many.
        score = tracks.score + np.where(any_seen, gain, np.maximum(gain, 2 * miss))
        self.tracks = replace(
            tracks,
            score=np.clip(score, -20.0, 20.0),
            hits=tracks.hits + any_seen,
            misses=np.where(any_seen, 0, tracks.misses + 1),
        )
        self._remember_apart(seen)

    def _expected(self, feet: Feet, camera: Camera, pose: Pose) -> Array:
        """How much of each track this view should see, 0 to 1: in the image, not behind what stands there, not behind another track."""
        points = body_points(self.tracks, self.setup.ground, (0.4, 1.0, 1.5))
        t = len(points)
        sight = points.reshape(-1, 3) - feet.origin
        distance = np.maximum(np.linalg.norm(sight, axis=1), 1e-6)
        direction = sight / distance[:, None]
        _, inside = camera.pixels_from_bearings(direction @ pose.rotation)
        visible = inside
        if self.setup.occluders is not None and t:
            stop, stopped = self.setup.occluders.intersect(np.broadcast_to(feet.origin, direction.shape), direction, self.parameters.fusion.reach)
            visible = inside & ~(stopped & (np.linalg.norm(stop - feet.origin, axis=1) < distance - 0.3))
        share = visible.reshape(t, -1).mean(axis=1) if t else np.zeros(0)
        behind = shadowed(points[:, 1], feet.origin, distance.reshape(t, -1)[:, 1]) if t else np.zeros(0, dtype=bool)
        return share * np.where(behind, 0.2, 1.0) * (share > 0.5)

    def _remember_apart(self, seen: Mask) -> None:
        """Two tracks that one view saw at once are two people: forget that they were together."""
        near = np.linalg.norm(self.tracks.state[:, None, :2] - self.tracks.state[None, :, :2], axis=2) < self.parameters.same_person
        both = (seen.astype(int) @ seen.T.astype(int)) > 0
        now: dict[tuple[int, int], int] = {}
        for i, j in np.argwhere(np.triu(near & ~both, 1)):
            key = (int(self.tracks.tree[i]), int(self.tracks.tree[j]))
            now[key] = self._together.get(key, 0) + 1
        self._together = now

    def _bear(self, views: list[Feet], free: list[Mask], seen: Mask) -> None:
        """Start a track where boxes are left over, unless a track stands there that these views did not see: that is the same person."""
        q = self.parameters
        groups = combine(views, free, self.setup.height, q.fusion)
        groups = [g for g in groups if not self._known(g, seen)]
        new = born(self._next_tree, groups, q.motion)
        hit = np.log((1 - q.false_positive) / q.false_positive)
        new = replace(new, score=np.array([hit * len(g.members) for g in groups]))
        self._next_tree += len(groups)
        self.tracks = self.tracks.join(new)
        self.believed = np.concatenate([self.believed, np.zeros(len(groups), dtype=bool)])

    def _known(self, group: Combination, seen: Mask) -> bool:
        near = np.linalg.norm(self.tracks.state[:, :2] - group.point, axis=1) < self.parameters.same_person
        apart = seen[:, [v for v, _ in group.members]].any(axis=1)
        return bool((near & ~apart & (self.tracks.misses < 3)).any())

    def _prune(self) -> None:
        q, tracks = self.parameters, self.tracks
        self.believed = self.believed | ((tracks.hits >= q.n_conf) & (tracks.score >= q.believe) & (tracks.misses == 0))
        missed = tracks.misses * self.setup.period
        keep = np.where(self.believed, (missed <= 2 * q.delta_a) & (tracks.score > -10), (tracks.misses < 3) & (tracks.score > -3))
        place = {int(tree): k for k, tree in enumerate(tracks.tree)}
        for (a, b), frames in self._together.items():
            if frames >= 4 and a in place and b in place:
                i, j = place[a], place[b]
                worse = j if (self.believed[i], tracks.hits[i]) >= (self.believed[j], tracks.hits[j]) else i
                keep[worse] = False
        self.tracks, self.believed = tracks.select(keep), self.believed[keep]


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
