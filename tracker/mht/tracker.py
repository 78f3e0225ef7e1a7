"""Multiple hypothesis tracking of people: track trees, and the global hypothesis of each tick as a maximum-weight clique of leaves.

`MhtFilter.step` takes the boxes of all views at a tick and gives the tracks of the global hypothesis.
The global hypothesis is computed anew at every tick, so that a wrong association can be corrected within the N-scan window.

It differs from Yoo et al. (2017) in four points:

* A track takes single boxes, not tracklets, and its score is the likelihood of its own Kalman filter.
* All leaves form one graph, whose connected components are solved one by one (K_H above 1: one graph for each hypothesis).
* A leaf is kept by its max-marginal loss, not by the share of hypotheses that hold it.
* The leaves of the global hypothesis also branch jointly: the boxes of each view are assigned to all of them at once.

The sensor model, the registration bias and the measurement noise of each view are learned online (tracker/tracks). Lost tracks are re-identified
there, and an appearance model weighs boxes where there are images. Where feet may be hidden, a box gives a density along its line of sight.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple, final

import numpy as np
from scipy.special import logit

from tracker.detections.cross_view import CrossViewGroup, group_across_views
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Viewpoint
from tracker.detections.optical_flow import TrackOwners
from tracker.detections.walkable_prior import WalkablePrior
from tracker.geometry import Array, Ints, Mask
from tracker.mht.appearance_model import AppearanceModel
from tracker.mht.branching import branch
from tracker.mht.branching_data import BoxTable, BranchingConstants, ChildHypotheses, Observation, ParentHypotheses
from tracker.mht.conflicts import conflicts_of, of_one_body
from tracker.mht.global_hypothesis import CliqueSolver, GlobalHypothesis, HypothesisSearch
from tracker.mht.joint_assignment import assign_jointly, assigned_boxes, union
from tracker.mht.pruning import PATIENCE, Lifetimes, prune_branches, surviving_leaves
from tracker.mht.root_measurement import with_statures, with_walkable_prior
from tracker.mht.tick_memory import Step, TickMemory
from tracker.mht.track_trees import MhtFixedLagSmoother, TrackHypotheses, coasted, initiated, predict, survived
from tracker.tracks.measurement_noise import MeasurementNoise
from tracker.tracks.parameters import MhtParameters
from tracker.tracks.reidentification import Appearance, NewTargetModel, Reidentification
from tracker.tracks.sensor_model import SensorModel, TickOutcome
from tracker.tracks.standing_things import StandingThings
from tracker.tracks.tracks import Places, Tracks, transition
from tracker.types import Setup
from tracker.types.ticks import ROUNDING

MOSTLY = 0.9
"""A person counts as seen if the last box is fewer revisits ago. The bound is below 1 because clocks jitter."""

MOST_LEAVING = 0.99
"""Largest probability that a person leaves between two ticks, however far apart they are."""

MAX_OUTSIDE = 3 / 7
"""s outside all views after which a confirmed track is deleted."""

REPORT_SIGMA = 1.0
"""m, standard deviation of a place above which a coasting person is no longer reported."""

COVERING_SHARE = 0.3
"""Probability that an undetected person stands in front of another person's box, so that the corners in the box are theirs."""

SUPPORTED = 0.5
"""Probability that an unassigned box is false, where a box of another view may show the same person."""


@final
class MhtTracker:
    """The multiple-hypothesis tracker of people, which reports `delay` frames late. Raises ValueError where delay is below 0."""

    def __init__(self, setup: Setup, parameters: MhtParameters, delay: int, solver: CliqueSolver | None = None) -> None:
        """solver: finds heavy cliques in the graphs of leaves; by default `proved_cliques`."""
        # Without known occluders, a track that is not seen again is more often wrong than hidden.
        hidden_sigma = 0.0 if setup.occluders is None else REPORT_SIGMA
        self._smoother = MhtFixedLagSmoother(delay, parameters.motion, hidden_sigma)
        self.filter = MhtFilter(setup, parameters, delay, solver)

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint], time: float, reported: bool = True) -> Tracks | None:
        """Process a tick at `time` s. Returns the people `delay` frames before, None at the start and where the tick is not `reported`."""
        tracks, present = self.filter.step(views, cameras, time, reported)
        return self._with_person_ids(self._smoother.feed(tracks, present, self.filter.now.seconds, reported))

    def drain(self) -> Tracks | None:
        """The people of the oldest frame that is not reported yet; None where all are."""
        return self._with_person_ids(self._smoother.drain())

    def current(self) -> Tracks:
        """The people of the last tick, without correction by later ticks. Raises ValueError before the first tick."""
        return self.filter.reidentification.relabelled(self._smoother.current())

    def _with_person_ids(self, people: Tracks | None) -> Tracks | None:
        return None if people is None else self.filter.reidentification.relabelled(people)


@dataclass(frozen=True, eq=False)
class NewLeaves:
    """The n leaves of a tick before they are pruned.

    parent (n,): row of the leaf of the last tick, −1 for a root. box (n, V): row of BoxTable that each leaf takes in each view, −1 for none.
    conflict (n, n): which pairs of leaves exclude each other.
    """

    leaves: TrackHypotheses
    parent: Ints
    box: Ints
    conflict: Mask


class Roots(NamedTuple):
    """New people: groups of boxes, and the log-likelihood ratio (g,) of each over clutter."""

    groups: list[CrossViewGroup]
    score: Array


class MhtFilter:
    """The online filter: its state after a tick depends on the ticks up to it alone."""

    def __init__(self, setup: Setup, parameters: MhtParameters, delay: int = 0, solver: CliqueSolver | None = None) -> None:
        """delay: least number of frames that tracks remember."""
        self.setup, self.parameters = setup, parameters
        self.sensor_model = SensorModel(setup, parameters)
        self._stature = parameters.fusion.statures
        self._walkable = WalkablePrior.of(setup.ground, setup.occluders)
        new_target = NewTargetModel(parameters.arrival_rate, *self._stature)
        self.appearance = AppearanceModel(list(setup.mounts))
        lost = parameters.reidentification
        self.reidentification = Reidentification(lost, new_target, self.appearance.same_person)
        self.search = HypothesisSearch(parameters, solver)
        self.now = Step(setup.period, setup.revisit, 0.0, 0, 1)
        self._memory = TickMemory(parameters.n_scan, delay, setup.period, setup.revisit)
        self._longest, self._max_gap = _longest(parameters, setup, delay)
        self._viewpoints: dict[str, Viewpoint] = {}  # the last one of each view
        self.leaves = TrackHypotheses.none(1)
        self.conflict = np.zeros((0, 0), dtype=bool)  # (n, n): which pairs of leaves exclude each other
        self.best = np.zeros(0, dtype=np.int64)  # rows of the leaves in the global hypothesis
        self.kept = np.zeros((0, 1), dtype=bool)  # which leaves each hypothesis holds; the last column is for roots, whose parent is −1
        self._owners = TrackOwners()
        self.things = StandingThings()
        self.noise = MeasurementNoise(parameters.noise)
        self._next_tree, self._next_node, self._ticks, self._time = 1, 0, 0, 0.0

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint], time: float, reported: bool = True) -> tuple[TrackHypotheses, Mask]:
        """Process a tick at `time` s; cameras: viewpoint of each view. Returns the people (k,) in the global hypothesis, and which are present."""
        self.now, self._time = self._memory.step(time, reported), time
        self._ticks += 1
        if not views:
            return self._coasted()
        self._viewpoints |= {camera.name: camera for camera in cameras}
        now = self._observation([self.noise.inflated(boxes) for boxes in views], cameras)
        children = self._branch(now)
        roots, doubt = self._initiate(now, children)
        new = self._updated_leaves(now, roots, self._extended(now, children, roots))
        excluded = new.conflict | of_one_body(new.leaves, self.parameters.body)
        chosen = self.search.solve(new.leaves, excluded, self.kept[:, new.parent], self._ticks + 1_000_003 * self.parameters.seed)
        self._own_boxes(now, new, chosen.best)
        leaves, fresh = self._confirmed(new.leaves, chosen.best)
        new = replace(new, leaves=leaves)
        self._learn(now, children, new, chosen.best, doubt)
        new = replace(new, leaves=self._reidentified(time, leaves, chosen.best, fresh))
        self._prune(new, chosen)
        return self._present()

    def expected(self, time: float) -> Places:
        """Where those who were detected at the last tick are expected at `time` s."""
        leaves = self.leaves.select(self.best)
        leaves = leaves.select(leaves.confirmed & ~leaves.deleted & (leaves.misses < MOSTLY))
        F, Q = transition(max(time - self._time, 0.0), self.parameters.motion)
        covariance = F @ leaves.covariance[:, :4, :4] @ F.T + Q
        return Places((leaves.state[:, :4] @ F.T)[:, :2], covariance[:, :2, :2])

    def _coasted(self) -> tuple[TrackHypotheses, Mask]:
        """As `step`, for a tick without a view."""
        leaves = coasted(predict(self.leaves, self.now, self.parameters.motion), self.now)
        self.leaves = replace(leaves, existence=self._survived(leaves.existence))
        return self._present()

    def _present(self) -> tuple[TrackHypotheses, Mask]:
        people = self.leaves.select(self.best[~self.things.likely(self.leaves.tree[self.best], self.parameters.thing)])
        # Time in which no view could have detected the person does not count as a gap.
        present = people.confirmed & ~people.deleted & (people.expected_misses <= self._max_gap)
        present &= (people.misses < MOSTLY) | (people.position_sigma <= REPORT_SIGMA)
        return people, present

    def _survived(self, existence: Array) -> Array:
        return survived(existence, min(self.now.seconds / self.parameters.residence, MOST_LEAVING))

    def _observation(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> Observation:
        """The views of a tick with the predicted leaves."""
        self.sensor_model.observe(views)
        leaves = self._with_walkable_prior(predict(self.leaves, self.now, self.parameters.motion))
        active = self.best[~leaves.deleted[self.best]]
        table = BoxTable.of(views, self.sensor_model, self.parameters.clutter)
        bodies = self.sensor_model.bodies(leaves.state[:, :2], leaves.tree, active)
        expected = bodies.expected_by_view(cameras, self.parameters.fusion.reach)
        missed = np.zeros(expected.shape)
        for v, boxes in enumerate(views):
            missed[:, v] = self.sensor_model.missed(boxes.camera, expected[:, v])
        chance = 1 - np.exp(missed.sum(axis=1))
        # Misses within one revisit have one cause, whether the cameras are synchronous or staggered.
        missed *= np.minimum(max(self.parameters.joint_misses, 1.0) * leaves.due, 1.0)[:, None]
        return Observation(views, cameras, table, self._branching_constants(views), leaves, active, bodies, expected, missed, chance)

    def _branching_constants(self, views: list[GroundDetections]) -> BranchingConstants:
        q, (low, high) = self.parameters, self.setup.height
        missed_by_all = self.sensor_model.joint_miss(views)
        return BranchingConstants(q.gate, q.motion.foot_spread, low, high, missed_by_all, q.margin, q.least_fit, q.beam_width, q.max_children)

    def _branch(self, now: Observation) -> ChildHypotheses:
        """The children of all leaves, found for each leaf alone and for the global hypothesis jointly."""
        leaves, table = now.leaves, now.table
        parents = ParentHypotheses.of(leaves, self.setup.ground, now.missed, self._image_links(now))
        children = union(branch(parents, table, now.limits), assign_jointly(now.active, parents, table, now.limits))
        children = children._replace(increment=children.increment + self._by_existence(leaves, children))
        kept = prune_branches(children, leaves.tree, leaves.misses, self.parameters.uncontested_margin, len(table.cut))
        return ChildHypotheses._make(column[kept] for column in children)

    def _by_existence(self, leaves: TrackHypotheses, children: ChildHypotheses) -> Array:
        """Change of the increments (m,) of the children of lost tracks by the existence r of their person.

        A box needs a person who is still there: log r. Misses may also mean that the person has left: log(1 − r + r exp(missed)) replaces `missed`.
        """
        lost = (leaves.misses > 0) & leaves.confirmed
        odds = np.where(lost, leaves.existence, np.inf)[children.parent]
        there, gone = -np.logaddexp(0, -odds), -np.logaddexp(0, odds)
        none = np.logaddexp(gone, there + children.missed) - children.missed
        return np.asarray(np.where((children.box >= 0).any(axis=1), there, none))

    def _image_links(self, now: Observation) -> Array:
        """Log-likelihood ratio (n, D) of each box for each leaf from images: by appearance, and by tracklets from the last boxes of its tree."""
        out, start = self.appearance.log_ratio(now.leaves, now.views), now.table.start
        for v, boxes in enumerate(now.views):
            if boxes.links:
                hidden = COVERING_SHARE * (1 - self.sensor_model.detection(boxes.camera))
                out[:, start[v] : start[v + 1]] += self._owners.links(boxes.camera, now.leaves.tree, boxes.links, hidden)
        return out

    def _own_boxes(self, now: Observation, new: NewLeaves, best: Ints) -> None:
        """Remember which trees the boxes of this tick belong to in the global hypothesis, for the tracklets of the next ticks."""
        for v, boxes in enumerate(now.views):
            if boxes.links is not None:
                owner, mine = np.full(len(boxes), -1), best[new.box[best, v] >= 0]
                owner[new.box[mine, v] - now.table.start[v]] = new.leaves.tree[mine]
                self._owners.add(boxes.camera, owner)

    def _initiate(self, now: Observation, children: ChildHypotheses) -> tuple[Roots, list[Array]]:
        """Unassigned boxes that may be new people; and `_doubt` of all boxes."""
        leaves, table = now.leaves, now.table
        # A track that is detected again after a gap may be another person.
        trees = _one_leaf_per_tree(leaves, self.best)
        taken = assigned_boxes(trees[(leaves.misses[trees] < 1.5) & ~leaves.deleted[trees]], children, table)
        free = [~taken[start:end] for start, end in itertools.pairwise(table.start.tolist())]
        groups = group_across_views([self.sensor_model.corrected(boxes) for boxes in now.views], free, self.setup.height, self.parameters.fusion)
        doubt = _doubt(now.views, groups)
        rate = self.sensor_model.arrival_rate(self.now.elapsed, self.now.revisits)
        ratios = np.split(table.existence_ratio, table.start[1:-1])
        score = self.sensor_model.initiation_score(now.views, now.cameras, ratios, groups, _tracks(leaves.select(self.best)), rate)
        return Roots(groups, score), doubt

    def _extended(self, now: Observation, children: ChildHypotheses, roots: Roots) -> NewLeaves:
        """The children and the roots of new trees, with the conflicts of all."""
        q, table, grown = self.parameters, now.table, self._grown(now, children)
        new = initiated(self._next_tree, roots.groups, q.motion, self._stature, (self.now.window, *now.leaves.appearance.shape[1:]))
        self._next_tree += len(new)
        new = replace(new, score=roots.score, existence=roots.score)
        box = np.full((len(grown) + len(new), len(table.origin)), -1, dtype=np.int64)
        box[: len(grown)] = children.box
        for k, group in enumerate(roots.groups, len(grown)):
            for v, d in group.members:
                box[k, v] = table.start[v] + d
        leaves = grown.join(new)
        leaves.node[:, 0] = self._next_node + np.arange(len(leaves))
        self._next_node += len(leaves)
        parent = np.concatenate([children.parent, np.full(len(new), -1, dtype=np.int64)])
        return NewLeaves(leaves, parent, box, conflicts_of(self.conflict, parent, leaves.tree, box))

    def _grown(self, now: Observation, children: ChildHypotheses) -> TrackHypotheses:
        """The leaves that the children become, with updated scores, counts and memory."""
        parents, detected = now.leaves.select(children.parent), (children.box >= 0).any(axis=1)
        # The likelihood of a place is evidence of which person a box shows, not of whether there is a person.
        boxes = np.append(now.table.existence_ratio, 0.0)[children.box].sum(axis=1)
        existence = self._survived(parents.existence) + boxes + children.missed * min(1.0, self.now.revisit / self.parameters.miss_time)
        chance, due, passed = now.chance[children.parent], parents.due, self.now.revisits
        outside = self._outside(now)[children.parent]
        states, covariances, detections = parents.states.copy(), parents.covariances.copy(), parents.detected.copy()
        states[:, 0], covariances[:, 0], detections[:, 0] = children.state, children.covariance, detected
        return replace(
            parents, state=children.state, covariance=children.covariance, score=parents.score + children.increment,
            existence=existence,
            hits=parents.hits + detected, misses=np.where(detected, 0.0, parents.misses + passed),
            expected_misses=np.where(detected, 0.0, parents.expected_misses + due * chance), due=np.where(detected, 0.0, due * (1 - chance)),
            states=states, covariances=covariances, detected=detections, unselected=parents.unselected + passed,
            out_of_view=np.where(outside & ~detected, parents.out_of_view + passed, 0.0),
        )  # fmt: skip

    def _outside(self, now: Observation) -> Mask:
        """Which leaves (n,) of the last tick no view could show, occluded or not."""
        out: Mask = np.asarray((now.expected <= 0).all(axis=1))
        rows = np.flatnonzero(out)
        out[rows] = ~now.bodies.in_any_view(list(self._viewpoints.values()), rows)
        return out

    def _updated_leaves(self, now: Observation, roots: Roots, new: NewLeaves) -> NewLeaves:
        """The leaves with the statures of new people, and with appearance updated by this tick."""
        self._measure_new_people(now, roots, new)
        box = np.where(new.box >= 0, new.box - now.table.start[:-1], -1)
        return replace(new, leaves=self.appearance.with_appearance(new.leaves, now.views, box, new.leaves.confirmed))

    def _with_walkable_prior(self, leaves: TrackHypotheses) -> TrackHypotheses:
        """The leaves with places and scores updated by the prior of walkable places."""
        state, covariance, ratio = with_walkable_prior(self._walkable, leaves.state, leaves.covariance)
        return replace(leaves, state=state, covariance=covariance, score=leaves.score + ratio, existence=leaves.existence + ratio)

    def _measure_new_people(self, now: Observation, roots: Roots, new: NewLeaves) -> None:
        """Update statures and places of the roots, in place, by their boxes and the known world."""
        rows, leaves = np.flatnonzero(new.parent < 0), new.leaves
        if not len(rows):
            return
        measured = leaves.select(rows)
        with_statures(measured, roots.groups, now, self.setup.ground)
        measured = self._with_walkable_prior(measured)
        for name in ("state", "covariance", "score", "existence"):
            getattr(leaves, name)[rows] = getattr(measured, name)
        leaves.states[rows, 0], leaves.covariances[rows, 0] = measured.state, measured.covariance

    def _confirmed(self, leaves: TrackHypotheses, best: Ints) -> tuple[TrackHypotheses, set[int]]:
        """The leaves with their confirmation and deletion decided; and the trees that are confirmed for the first time."""
        q = self.parameters
        sure = np.zeros(len(leaves), dtype=bool)
        sure[best] = (leaves.hits[best] >= q.n_conf) & (leaves.existence[best] >= logit(q.report)) & (leaves.misses[best] == 0)
        unselected, confirmed = leaves.unselected.copy(), leaves.confirmed | sure
        unselected[best] = 0
        fresh = set(leaves.tree[sure].tolist()) - set(leaves.tree[leaves.confirmed].tolist())
        # Deleted tracks stay while the fixed-lag smoother may report their last ticks.
        gone = (leaves.existence < logit(q.forget)) | self._has_left(leaves)
        return replace(leaves, unselected=unselected, confirmed=confirmed, deleted=leaves.deleted | (confirmed & gone)), fresh

    def _has_left(self, leaves: TrackHypotheses) -> Mask:
        """Which leaves (n,) have been outside all views for too long."""
        return np.asarray(leaves.out_of_view * self.now.revisit > MAX_OUTSIDE)

    def _learn(self, now: Observation, children: ChildHypotheses, new: NewLeaves, best: Ints, doubt: list[Array]) -> None:
        """Learn the detection rates, measurement noise and registration bias of each view from the confirmed tracks of the global hypothesis."""
        leaves, start = new.leaves, now.table.start
        known = best[new.parent[best] >= 0]
        parent = new.parent[known]
        box = np.where(new.box[known] >= 0, new.box[known] - start[:-1], -1)
        sure = leaves.confirmed[known] & (leaves.misses[known] <= self._max_gap)
        self.sensor_model.learn(TickOutcome(
            now.views, doubt, box, now.expected[parent], now.bodies.occluded_by_view(now.cameras)[parent],
            sure, leaves.existence[known], leaves.state[known, :2], leaves.covariance[known, :2, :2],
        ))  # fmt: skip
        self._judge_things(now, leaves.select(known[sure]), box[sure], now.expected[parent[sure]])
        old = known[leaves.confirmed[known]]
        for v, boxes in enumerate(now.views):
            innovations = children.residual[old, v], children.H[old, v], children.S[old, v]
            mine = old[new.box[old, v] >= 0]
            self.noise.learn(boxes.camera, children.residual[mine, v], children.S[mine, v], boxes.covariance[new.box[mine, v] - start[v]])
            self.sensor_model.registration_bias.learn(boxes.camera, leaves.state[old, :2], innovations)

    def _judge_things(self, now: Observation, tracks: TrackHypotheses, box: Ints, expected: Array) -> None:
        """Learn which tracks (t,) are things. box (t, V): of each track in each view, −1 for none. expected (t, V): relative detection rates."""
        ranks = np.full(box.shape, np.nan)
        for v, boxes in enumerate(now.views):
            mine = box[:, v] >= 0
            ranks[mine, v] = self.sensor_model.detection_rates.rank(boxes.camera, boxes.confidence)[box[mine, v]]
        self.things.learn(
            self.now.seconds, tracks.tree, (tracks.state[:, :2], tracks.position_sigma), ranks, expected, set(self.leaves.tree.tolist())
        )

    def _reidentified(self, time: float, leaves: TrackHypotheses, best: Ints, fresh: set[int]) -> TrackHypotheses:
        """The leaves; lost trees that newly confirmed trees continue are marked as deleted."""
        people = leaves.select(_one_leaf_per_tree(leaves, best))
        left = set(people.tree[self._has_left(people)].tolist())
        held = people.confirmed & np.isin(people.tree, leaves.tree[best])
        appearance = Appearance(people.appearance, people.appearance_count)
        ended = self.reidentification.step(time, _tracks(people), (held, np.isin(people.tree, list(fresh))), left, appearance)
        return replace(leaves, deleted=leaves.deleted | np.isin(leaves.tree, list(ended)))

    def _prune(self, new: NewLeaves, chosen: GlobalHypothesis) -> None:
        """Keep the surviving leaves, with their conflicts and the hypotheses that hold them."""
        keep = surviving_leaves(new.leaves, new.box, chosen, self._longest._replace(scan=self.now.scan), self.parameters)
        rows = np.flatnonzero(keep)
        number = np.full(len(keep), -1)
        number[rows] = np.arange(len(rows))
        self.leaves, self.conflict = new.leaves.select(rows), new.conflict[np.ix_(rows, rows)]
        self.best = number[chosen.best][keep[chosen.best]]
        self.kept = np.pad(chosen.hypotheses[:, rows], ((0, 0), (0, 1)))


def _longest(q: MhtParameters, setup: Setup, delay: int) -> tuple[Lifetimes, int]:
    """Bounds of coasting, and the longest gap that is bridged, in whole revisits. Tracks stay while the smoother may report their last frames."""
    gap, scan = round(q.delta_a / setup.revisit), round(q.n_scan / setup.revisit)
    window = max(scan, math.ceil(delay * setup.period / setup.revisit - ROUNDING)) + 1
    return Lifetimes(max(round(q.coasting_factor * gap), window) + 0.5, max(scan, PATIENCE) + 0.5, scan), gap


def _doubt(views: list[GroundDetections], groups: list[CrossViewGroup]) -> list[Array]:
    """Factors (d,), for each view, of the probability that an unassigned box is false: SUPPORTED where another view has a box of the group."""
    out = [np.ones(len(feet)) for feet in views]
    for group in groups:
        if len(group.members) > 1:
            for v, d in group.members:
                out[v][d] = SUPPORTED
    return out


def _one_leaf_per_tree(leaves: TrackHypotheses, best: Ints) -> Ints:
    """A row of each tree: the one in `best`, or the one of the highest score."""
    held = np.zeros(len(leaves), dtype=bool)
    held[best] = True
    order = np.lexsort((-leaves.score, ~held, leaves.tree))
    return np.asarray(order[np.unique(leaves.tree[order], return_index=True)[1]])


def _tracks(people: TrackHypotheses) -> Tracks:
    """The tracks without their memory."""
    return Tracks(people.tree, people.state, people.covariance, people.score, people.misses)
