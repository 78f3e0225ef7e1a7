"""Multiple hypothesis tracking of people: track trees, and the global hypothesis of each tick as a maximum-weight clique of leaves.

`MhtFilter.step` takes the boxes of all views at a tick and gives the tracks of the global hypothesis.
The global hypothesis is found anew at every tick, so that a wrong association is corrected within the N-scan window.

It differs from Yoo et al. (2017) in four points:

* A track takes single boxes, not tracklets, and its score is the likelihood of its own Kalman filter.
* All leaves form one graph, whose connected components are solved one by one (`small_graphs`: one graph for each hypothesis).
* A leaf is kept by its max-marginal loss, not by the share of hypotheses that hold it.
* The leaves of the global hypothesis also branch jointly: the boxes of each view are assigned to all of them at once.

The sensor model, the registration bias and the measurement noise of each view are learned online (tracker/tracks). Lost tracks are re-identified
there, and an appearance model weighs boxes where there are images. Where feet may be hidden, a box gives a density along its line of sight.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import final

import numpy as np

from tracker.detections.cross_view import CrossViewGroup, group_across_views
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Viewpoint
from tracker.detections.optical_flow import TrackOwners
from tracker.detections.walkable_prior import WalkablePrior
from tracker.geometry import Array, Ints, Mask
from tracker.mht.appearance_model import AppearanceModel
from tracker.mht.branching import branch
from tracker.mht.branching_data import BoxTable, BranchingConstants, ChildHypotheses, ParentHypotheses
from tracker.mht.conflicts import ConflictRows, Conflicts, conflicts_of
from tracker.mht.fixed_lag import MhtFixedLagSmoother
from tracker.mht.global_hypothesis import GlobalHypothesis, solve
from tracker.mht.initiation import with_statures, with_walkable_prior
from tracker.mht.joint_assignment import assign_jointly, assigned_boxes, union
from tracker.mht.negative_information import ExpectedVisibility
from tracker.mht.parameters import MhtParameters
from tracker.mht.pruning import prune_branches, surviving_leaves
from tracker.mht.track_trees import TrackHypotheses, initiated, predict
from tracker.tracks.crowding import Crowding
from tracker.tracks.measurement_noise import MeasurementNoise
from tracker.tracks.reidentification import NewTargetModel, Reidentification
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import Tracks
from tracker.types import Setup


@final
class MhtTracker:
    """The tracker of people by multiple hypotheses, which reports `delay` ticks late. Raises ValueError where delay is below 0."""

    def __init__(self, setup: Setup, parameters: MhtParameters, delay: int) -> None:
        # Without known occluders, a track that is not seen again is more often wrong than hidden.
        hidden_sigma = 0.0 if setup.occluders is None else parameters.report_sigma
        self._smoother = MhtFixedLagSmoother(delay, setup.period, parameters.motion, hidden_sigma)
        self.filter = MhtFilter(setup, parameters, delay)

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> Tracks | None:
        """Take a tick; the people of the tick `delay` ticks before, None at the start."""
        return self._with_person_ids(self._smoother.feed(*self.filter.step(views, cameras)))

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that is not reported yet; None where all are."""
        return self._with_person_ids(self._smoother.drain())

    def _with_person_ids(self, people: Tracks | None) -> Tracks | None:
        return None if people is None else self.filter.reidentification.relabelled(people)


class MhtFilter:
    """The online filter: its state after a tick depends on the ticks up to it alone."""

    def __init__(self, setup: Setup, parameters: MhtParameters, delay: int = 0) -> None:
        """delay: ticks that the tracks remember at least."""
        self.setup, self.parameters = setup, parameters
        self.sensor_model = SensorModel(setup, parameters)
        self.crowding = Crowding(parameters.crowding, setup.period)
        ranges = parameters.fusion.ranges
        self._stature = ranges.stature, ranges.stature_sigma
        self._walkable = WalkablePrior.of(setup.ground, setup.occluders, ranges.walkability)
        new_target = NewTargetModel(parameters.arrival_rate, *self._stature)
        self.appearance = AppearanceModel(parameters.appearance_weight, parameters.appearance_rate, list(setup.mounts))
        lost = parameters.reidentification
        self.reidentification = Reidentification(lost, parameters.motion, setup.period, new_target, self.appearance.same_person)
        self.n_scan = round(parameters.n_scan / setup.period)
        self.window = max(self.n_scan, delay) + 1
        self.leaves = TrackHypotheses.none(self.window)
        self.best = np.zeros(0, dtype=np.int64)  # rows of the leaves in the global hypothesis
        self.kept = np.zeros((0, 1), dtype=bool)  # which leaves each hypothesis holds; the last column is for roots, whose parent is −1
        self._parent, self._boxes = np.zeros(0, dtype=np.int64), np.zeros((0, 0), dtype=np.int64)
        self._conflicts = Conflicts(np.zeros((0, 0), dtype=bool), np.zeros((0, 0)))
        self._owners = TrackOwners()
        self.noise = MeasurementNoise(parameters.noise)
        self._next_tree, self._next_node, self._ticks = 1, 0, 0
        self._max_gap = round(parameters.delta_a / setup.period)

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> tuple[TrackHypotheses, Mask]:
        """Take one tick; cameras: the viewpoint of each view. The tracks (k,) of the global hypothesis, and which are present."""
        self._ticks += 1
        views = [self.noise.inflated(boxes) for boxes in views]
        self.sensor_model.observe(views)
        self.leaves = self._with_walkable_prior(predict(self.leaves, self.setup.period, self.parameters.motion))
        active = self.best[~self.leaves.deleted[self.best]]
        bodies = self.sensor_model.bodies(self.leaves.state[:, :2], self.leaves.tree, active)
        table = BoxTable.of(views, self.sensor_model, self.parameters.clutter)
        expected = ExpectedVisibility.of(self.leaves, cameras, self.sensor_model, active).share
        missed = self._missed(views, expected)
        parents = ParentHypotheses.of(self.leaves, self.setup.ground, missed, self._image_links(views, table))
        limits = self._branching_constants(views)
        joint, ratio = assign_jointly(active, parents, table, limits)
        children = union(branch(parents, table, limits), joint)
        rivals = self.leaves.tree[active], self.leaves.confirmed[active], ratio
        kept = prune_branches(children, self.leaves.tree, self.leaves.misses, self.parameters.uncontested_margin, len(table.usable))
        children = ChildHypotheses._make(column[kept] for column in children)
        roots, doubt = self._initiate(views, table, children)
        score = self._initiation_scores(views, cameras, roots)
        self._extend_trees(children, (roots, score), (table, missed), bodies.in_any_view(cameras))
        self._measure_new_people(np.flatnonzero(self._parent < 0), roots, views, (table, limits))
        self._exclude_watched_places(views, cameras)
        self._update_appearance(views, table)
        chosen = solve(self.leaves, self._conflicts, self.kept[:, self._parent], self.parameters, self._ticks + 1_000_003 * self.parameters.seed)
        self._own_boxes(views, table, chosen.best)
        self._discount_contested_boxes(chosen.best, table, rivals)
        new = self._confirm(chosen.best)
        self._update_sensor_model((views, doubt), children, (table.start, expected, bodies.occluded_by_view(cameras)), chosen.best)
        self._reidentify(chosen.best, new)
        self._prune(chosen)
        people = self.leaves.select(self.best)
        self.crowding.learn(people.state[people.confirmed & ~people.deleted, :2])
        # Ticks at which no view could have had a box do not count as a gap.
        present = people.confirmed & ~people.deleted & (people.expected_misses <= self._max_gap)
        present &= (people.misses == 0) | (people.position_sigma <= self.parameters.report_sigma)
        return people, present

    def _image_links(self, views: list[GroundDetections], table: BoxTable) -> Array:
        """Log-likelihood ratio (n, D) of each box for each leaf by images: appearance, and tracklets from the boxes that its tree took before."""
        out = self.appearance.log_ratio(self.leaves, views)
        for v, boxes in enumerate(views):
            if boxes.links:
                hidden = self.parameters.covering_share * (1 - self.sensor_model.detection(boxes.camera))
                out[:, table.start[v] : table.start[v + 1]] += self._owners.links(boxes.camera, self.leaves.tree, boxes.links, hidden)
        return out

    def _own_boxes(self, views: list[GroundDetections], table: BoxTable, best: Ints) -> None:
        """Remember which trees the boxes of this tick belong to in the global hypothesis, for the tracklets of the next ticks."""
        for v, boxes in enumerate(views):
            if boxes.links is not None:
                owner, mine = np.full(len(boxes), -1), best[self._boxes[best, v] >= 0]
                owner[self._boxes[mine, v] - table.start[v]] = self.leaves.tree[mine]
                self._owners.add(boxes.camera, owner)

    def _missed(self, views: list[GroundDetections], expected: Array) -> Array:
        """Log-likelihood (n, V) of a missed detection in each view, which should have a box with probability `expected` (n, V) times P_D."""
        out = np.zeros((len(self.leaves), len(views)))
        for v, boxes in enumerate(views):
            out[:, v] = self.sensor_model.missed(boxes.camera, expected[:, v])
        return out

    def _branching_constants(self, views: list[GroundDetections]) -> BranchingConstants:
        q, (low, high) = self.parameters, self.setup.height
        missed_by_all = self.sensor_model.joint_miss(views)
        return BranchingConstants(q.gate, q.motion.foot_spread, low, high, missed_by_all, q.min_ratio, q.margin, q.beam_width, q.max_children)

    def _initiate(self, views: list[GroundDetections], table: BoxTable, children: ChildHypotheses) -> tuple[list[CrossViewGroup], list[Array]]:
        """Groups of unassigned boxes that may be new people, without those near a track without a box in their views. Also `_doubt`."""
        first = np.concatenate([[True], children.parent[1:] != children.parent[:-1]]) if len(children.parent) else np.zeros(0, dtype=bool)
        # A track that is detected again after a gap may be another person.
        trees = _one_leaf_per_tree(self.leaves, self.best)
        taken = assigned_boxes(trees[(self.leaves.misses[trees] < 2) & ~self.leaves.deleted[trees]], children, table)
        free = [~taken[start:end] & table.usable[start:end] for start, end in itertools.pairwise(table.start.tolist())]
        groups = group_across_views([self.sensor_model.corrected(boxes) for boxes in views], free, self.setup.height, self.parameters.fusion)
        doubt = _doubt(views, groups, self.parameters.supported)
        sure = [self.sensor_model.may_start(f) for f in views]
        groups = [g for g in groups if any(sure[v][d] for v, d in g.members)]
        place, seen = children.state[first, :2], children.box[first] >= 0
        recent = (self.leaves.misses < 3) & ~self.leaves.deleted
        known, reach = [], self.crowding.merge_distance(self.parameters.merge_distance)
        for g in groups:
            near = np.linalg.norm(place - g.point, axis=1) < reach
            known.append((near & recent & ~seen[:, [v for v, _ in g.members]].any(axis=1)).any())
        return [g for g, k in zip(groups, known, strict=True) if not k], doubt

    def _initiation_scores(self, views: list[GroundDetections], cameras: list[Viewpoint], roots: list[CrossViewGroup]) -> Array:
        """Log-likelihood ratio of each root being a new person over clutter."""
        people = self.leaves.select(self.best)
        rate = self.sensor_model.arrival_rate(self._ticks, self.crowding.arrivals)
        return self.sensor_model.initiation_score(list(zip(views, cameras, strict=True)), roots, (people.state[:, :2], people.tree), rate)

    def _extend_trees(
        self, children: ChildHypotheses, new_trees: tuple[list[CrossViewGroup], Array], seen: tuple[BoxTable, Array], watched: Mask
    ) -> None:
        """Replace the leaves by their children, add the roots of new trees, and find the conflicts of all.

        new_trees: roots and their scores; seen: the boxes and the log-likelihoods (n, V) of missed detections; watched (n,): in some view.
        """
        q, (roots, score), (table, missed) = self.parameters, new_trees, seen
        parents, detected = self.leaves.select(children.parent), (children.box >= 0).any(axis=1)
        # The likelihood of a place tells whose box it is, not whether there is a person.
        existence = np.append(table.existence_ratio, 0.0)[children.box].sum(axis=1) + children.missed
        expected_misses = np.where(detected, 0.0, parents.expected_misses + 1 - np.exp(missed[children.parent].sum(axis=1)))
        states, covariances, detections = parents.states.copy(), parents.covariances.copy(), parents.detected.copy()
        states[:, 0], covariances[:, 0], detections[:, 0] = children.state, children.covariance, detected
        leaves = replace(
            parents, state=children.state, covariance=children.covariance, score=parents.score + children.increment,
            existence=np.clip(parents.existence + existence, -20.0, q.max_score),
            hits=parents.hits + detected, misses=np.where(detected, 0, parents.misses + 1),
            states=states, covariances=covariances, detected=detections, unselected=parents.unselected + 1, expected_misses=expected_misses,
            out_of_view=np.where(watched[children.parent] | detected, 0, parents.out_of_view + 1),
        )  # fmt: skip
        new = initiated(self._next_tree, roots, q.motion, self._stature, (self.window, *self.leaves.appearance.shape[1:]))
        self._next_tree += len(roots)
        new = replace(new, score=score, existence=score)
        self._boxes = np.full((len(leaves) + len(new), len(table.origin)), -1, dtype=np.int64)
        self._boxes[: len(leaves)] = children.box
        for k, group in enumerate(roots, len(leaves)):
            for v, d in group.members:
                self._boxes[k, v] = table.start[v] + d
        leaves = leaves.join(new)
        leaves.node[:, 0] = self._next_node + np.arange(len(leaves))
        self._next_node += len(leaves)
        parent = np.concatenate([children.parent, np.full(len(new), -1, dtype=np.int64)])
        self._parent, self.leaves = parent, leaves
        missed = np.vstack([missed[children.parent], np.zeros((len(new), len(table.origin)))])
        rows = ConflictRows(leaves.tree, self._boxes, leaves.state[:, :2], leaves.deleted, missed)
        limits = self.crowding.merge_distance(q.merge_distance), q.merge_step, q.split_share
        self._conflicts = conflicts_of(self._conflicts, parent, rows, table.existence_ratio, limits)

    def _with_walkable_prior(self, leaves: TrackHypotheses) -> TrackHypotheses:
        """The leaves with places and scores updated by the prior of walkable places."""
        state, covariance, ratio = with_walkable_prior(self._walkable, leaves.state, leaves.covariance)
        return replace(leaves, state=state, covariance=covariance, score=leaves.score + ratio, existence=leaves.existence + ratio)

    def _measure_new_people(
        self, rows: Ints, groups: list[CrossViewGroup], views: list[GroundDetections], seen: tuple[BoxTable, BranchingConstants]
    ) -> None:
        """Give the roots in `rows` the statures and places that their boxes and the known world tell."""
        if not len(rows):
            return
        new, leaves = self.leaves.select(rows), self.leaves
        with_statures(new, groups, views, (*seen, self.setup.ground))
        new = self._with_walkable_prior(new)
        for name in ("state", "covariance", "score", "existence"):
            getattr(leaves, name)[rows] = getattr(new, name)
        leaves.states[rows, 0], leaves.covariances[rows, 0] = new.state, new.covariance

    def _exclude_watched_places(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> None:
        """Update the places of uncertain leaves by their missed detections."""
        leaves = self.leaves
        if self.setup.occluders is None or not len(leaves):
            return
        # A tentative track may be false, so that its missed detections tell nothing about its place.
        seen = self._boxes >= 0
        visibility = ExpectedVisibility.of(leaves, cameras, self.sensor_model, self._active_rows(), ~seen & leaves.confirmed[:, None])
        detection = np.array([self.sensor_model.detection(feet.camera) for feet in views])
        state, covariance = visibility.given_misses(leaves.state, leaves.covariance, seen, detection)
        states, covariances = leaves.states.copy(), leaves.covariances.copy()
        states[:, 0], covariances[:, 0] = state, covariance
        self.leaves = replace(leaves, state=state, covariance=covariance, states=states, covariances=covariances)

    def _active_rows(self) -> Ints:
        """Rows of the best child of each leaf in the global hypothesis of the last tick."""
        held = np.isin(self._parent, self.best)
        rows = np.flatnonzero(held)
        return np.asarray(rows[np.unique(self._parent[rows], return_index=True)[1]])

    def _update_appearance(self, views: list[GroundDetections], table: BoxTable) -> None:
        """Update the appearance of leaves by the boxes that they have taken."""
        box = np.where(self._boxes >= 0, self._boxes - table.start[:-1], -1)
        self.leaves = self.appearance.with_appearance(self.leaves, views, box, self.leaves.confirmed)

    def _discount_contested_boxes(self, best: Ints, table: BoxTable, rivals: tuple[Ints, Mask, Array]) -> None:
        """Reduce the existence scores of leaves in the global hypothesis whose boxes another track would take.

        rivals: tree (k,), whether confirmed (k,), and the log-likelihood ratio (k, D) of each box over a missed detection.
        """
        tree, known, ratio = rivals
        if not ratio.size:
            return
        view, existence = np.repeat(np.arange(len(table.origin)), np.diff(table.start)), self.leaves.existence.copy()
        row, column = np.nonzero(tree[:, None] == self.leaves.tree[best])
        has = self._boxes[best[column]]
        now = np.zeros((len(tree), len(table.origin)))
        now[row] = np.where(has >= 0, ratio[row[:, None], has], 0.0)
        more = np.maximum(ratio - now[:, view], 0.0)
        for leaf in best:
            rival = (tree != self.leaves.tree[leaf]) & (known | ~self.leaves.confirmed[leaf])
            box = self._boxes[leaf][self._boxes[leaf] >= 0]
            existence[leaf] -= np.minimum(more[np.ix_(rival, box)].max(axis=0, initial=0.0), np.maximum(table.existence_ratio[box], 0.0)).sum()
        self.leaves = replace(self.leaves, existence=existence)

    def _confirm(self, best: Ints) -> set[int]:
        """Confirm and delete tracks of the global hypothesis; the trees that are confirmed for the first time."""
        q, leaves = self.parameters, self.leaves
        sure = np.zeros(len(leaves), dtype=bool)
        sure[best] = (leaves.hits[best] >= q.n_conf) & (leaves.existence[best] >= q.confirm_score) & (leaves.misses[best] == 0)
        unselected, confirmed = leaves.unselected.copy(), leaves.confirmed | sure
        unselected[best] = 0
        new = set(leaves.tree[sure].tolist()) - set(leaves.tree[leaves.confirmed].tolist())
        # Deleted tracks stay while the fixed-lag smoother may report their last ticks.
        gone = (leaves.existence < q.delete_confirmed_score) | self._has_left(leaves)
        self.leaves = replace(leaves, unselected=unselected, confirmed=confirmed, deleted=leaves.deleted | (confirmed & gone))
        return new

    def _has_left(self, leaves: TrackHypotheses) -> Mask:
        """Which leaves (n,) are outside all views for too long."""
        return np.asarray(leaves.out_of_view * self.setup.period > self.parameters.max_outside)

    def _update_sensor_model(
        self, doubted: tuple[list[GroundDetections], list[Array]], children: ChildHypotheses, seen: tuple[Ints, Array, Array], best: Ints
    ) -> None:
        """Learn the detection rates, measurement noise and registration bias of each view from the confirmed tracks of the global hypothesis.

        doubted: the views, and `_doubt` of their boxes. seen: first row of each view's boxes; probability (n, V) that a view should have a box of a
        parent; its occluded shares (n, V, 2).
        """
        (start, expected, occluded), leaves = seen, self.leaves
        known = best[self._parent[best] >= 0]
        box = self._boxes[known]
        sure = leaves.confirmed[known] & (leaves.misses[known] <= self._max_gap)
        parent = self._parent[known]
        self.sensor_model.learn(
            doubted, np.where(box >= 0, box - start[:-1], -1), expected[parent],
            (sure, leaves.existence[known], leaves.state[known, :2], leaves.covariance[known, :2, :2]), occluded[parent],
        )  # fmt: skip
        old = known[leaves.confirmed[known]]
        for v, boxes in enumerate(doubted[0]):
            innovations = children.residual[old, v], children.H[old, v], children.S[old, v]
            mine = old[self._boxes[old, v] >= 0], v
            self.noise.learn(boxes.camera, children.residual[mine], children.S[mine], boxes.covariance[self._boxes[mine] - start[v]])
            self.sensor_model.registration_bias.learn(boxes.camera, leaves.state[old, :2], innovations)

    def _reidentify(self, best: Ints, new: set[int]) -> None:
        """Re-identify newly confirmed trees with lost ones, and delete the lost ones."""
        people = self.leaves.select(_one_leaf_per_tree(self.leaves, best))
        left = self._has_left(people)
        confirmed, held = np.isin(people.tree, list(new)), np.isin(people.tree, self.leaves.tree[best])
        tracks, looks = _tracks(people), (people.appearance, people.appearance_count)
        ended = self.reidentification.step(tracks, people.confirmed & held, confirmed, set(people.tree[left].tolist()), looks)
        self.leaves = replace(self.leaves, deleted=self.leaves.deleted | np.isin(self.leaves.tree, list(ended)))

    def _prune(self, chosen: GlobalHypothesis) -> None:
        """Keep the surviving leaves, with their conflicts and the hypotheses that hold them."""
        longest = max(round(self.parameters.coasting_factor * self._max_gap), self.window)
        keep = surviving_leaves(self.leaves, self._boxes, chosen, (longest, self.n_scan), self.parameters)
        rows = np.flatnonzero(keep)
        number = np.full(len(self.leaves), -1)
        number[rows] = np.arange(len(rows))
        among = np.ix_(rows, rows)
        self.leaves, self._conflicts = self.leaves.select(rows), Conflicts(self._conflicts.conflict[among], self._conflicts.same_person[among])
        self.best = number[chosen.best][keep[chosen.best]]
        self.kept = np.pad(chosen.hypotheses[:, rows], ((0, 0), (0, 1)))


def _doubt(views: list[GroundDetections], groups: list[CrossViewGroup], supported: float) -> list[Array]:
    """Factor (d,), for the boxes of each view, of the probability that a box that nobody takes is false: less where another view agrees."""
    out = [np.ones(len(feet)) for feet in views]
    for group in groups:
        if len(group.members) > 1:
            for v, d in group.members:
                out[v][d] = supported
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
