"""Which boxes are which people: track trees, and the best set of tracks as a maximum-weight clique, from tick to tick.

`MultipleHypotheses.step` takes what all views have at a tick and gives the tracks of the best hypothesis, with their last moments. A person who
was taken for somebody else is put right within the N-scan: the best hypothesis is found anew at every tick over all that is not decided.

It departs from the scheme of Yoo et al. in this: a track takes boxes one by one, not tracklets, with the likelihood of its own Kalman filter as
score; all leaves make one graph, which falls into parts that are solved by themselves (`small_graphs` has one graph for each hypothesis); and a leaf
stays by what it would cost the best hypothesis to hold it, not by the share of hypotheses that do. Leaves that are true together also go on together,
the boxes of each view shared out among them: what each would do alone seldom goes together before many views. What views find, miss and are off is
learned as in tracker/hypotheses.py, by how much of people things and others cover (tracker/cover.py), who was lost and comes back keeps the id
(tracker/reunion.py), and images say whose box it is by what people look like (tracker/likeness.py). Where terrain and things are known this does not
yet ask at which distances a box could be of somebody (tracker/standpoints.py): there the default tracker is better.
"""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np

from tracker.detections.cross_view import CrossViewGroup, group_across_views
from tracker.detections.ground_points import GroundDetections
from tracker.detections.occlusion import Viewpoint
from tracker.geometry import Array, Ints, Mask
from tracker.mht import conflicts
from tracker.mht.appearance_model import AppearanceModel
from tracker.mht.branching import BoxTable, BranchingConstants, ChildHypotheses, ParentHypotheses, assign_jointly, assigned_boxes, branch, union
from tracker.mht.conflicts import Conflicts
from tracker.mht.fixed_lag import MhtFixedLagSmoother
from tracker.mht.global_hypothesis import GlobalHypothesis, solve
from tracker.mht.parameters import MhtParameters
from tracker.mht.track_trees import TrackHypotheses, initiated, predict, weights
from tracker.tracks.measurement_noise import MeasurementNoise
from tracker.tracks.reidentification import NewTargetModel, Reidentification
from tracker.tracks.sensor_model import SensorModel
from tracker.tracks.tracks import Tracks
from tracker.types import Setup


class MhtFilter:
    """The online tracker of people. State after a tick depends on ticks up to it alone."""

    def __init__(self, setup: Setup, parameters: MhtParameters, delay: int = 0) -> None:
        """delay: ticks that the tracks shall remember."""
        self.setup, self.parameters = setup, parameters
        self.evidence = SensorModel(setup, parameters)
        people = parameters.fusion.standpoints
        self._stature = people.stature, people.stature_sigma
        self.reunions = Reidentification(parameters.reunion, parameters.motion, setup.period, NewTargetModel(parameters.arrivals, *self._stature))
        self.n_scan = max(1, round(parameters.n_scan / setup.period))
        self.window = max(self.n_scan, delay) + 1
        self.leaves = TrackHypotheses.none(self.window)
        self.best = np.zeros(0, dtype=np.int64)  # rows of the leaves in the best hypothesis
        self.kept = np.zeros((0, 1), dtype=bool)  # which leaves each hypothesis holds; the last column is for roots, whose parent is −1
        self._parent, self._boxes = np.zeros(0, dtype=np.int64), np.zeros((0, 0), dtype=np.int64)
        self._bonds = Conflicts(np.zeros((0, 0), dtype=bool), np.zeros((0, 0)))
        self.noise = MeasurementNoise(parameters.noise)
        self.likeness = AppearanceModel(parameters.alike, parameters.fashion, list(setup.mounts))
        self._next_tree, self._next_node, self._ticks = 1, 0, 0
        self._bridged = round(parameters.delta_a / setup.period)

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> tuple[TrackHypotheses, Mask]:
        """Take one tick; cameras: from where each view looks. The tracks of the best hypothesis, and who of them is there now."""
        self._ticks += 1
        views = [self.noise.widened(feet) for feet in views]
        self.leaves = predict(self.leaves, self.setup.period, self.parameters.motion)
        together = self.best[~self.leaves.over[self.best]]
        bodies = self.evidence.bodies(self.leaves.state[:, :2], self.leaves.tree, together)
        table = BoxTable.of(views, self.evidence, self.parameters.clutter)
        expected = bodies.by_view(cameras, self.parameters.fusion.reach)
        missed = self._missed(views, expected)
        standing = ParentHypotheses.of(self.leaves, self.setup.ground, missed, self.likeness.worth(self.leaves, views))
        numbers = self._numbers(views)
        mutual, worth = assign_jointly(together, standing, table, numbers)
        ways = union(branch(standing, table, numbers), mutual)
        who = self.leaves.tree[together], self.leaves.believed[together]
        held = conflicts.prune_branches(ways, self.leaves.tree, self.leaves.misses, self.parameters.slack, len(table.usable))
        ways = ChildHypotheses._make(column[held] for column in ways)
        roots = self._roots(views, table, ways)
        prior = self._prior(views, cameras, roots)
        self._extend(ways, (roots, prior), (table, missed), bodies.watched(cameras))
        self._dress(views, table)
        chosen = solve(self.leaves, self._bonds, self.kept[:, self._parent], self.parameters, self._ticks + 1_000_003 * self.parameters.seed)
        self._doubt(chosen.best, table, (*who, worth))
        fresh = self._believe(chosen.best)
        self._learn(views, ways, (table.start, expected, bodies.covers(cameras)), chosen.best)
        self._reunite(chosen.best, fresh)
        self._prune(chosen)
        people = self.leaves.select(self.best)
        # Where no view could have shown somebody that is no gap.
        here = people.believed & ~people.over & (people.due <= self._bridged)
        return people, here

    def _missed(self, views: list[GroundDetections], expected: Array) -> Array:
        """Log-likelihood (n, V) of each view showing no box of people of whom it should see so much."""
        out = np.zeros((len(self.leaves), len(views)))
        for v, feet in enumerate(views):
            out[:, v] = self.evidence.missed(feet.camera, expected[:, v])
        return out

    def _dress(self, views: list[GroundDetections], table: BoxTable) -> None:
        """Note what the boxes look like that leaves have taken."""
        box = np.where(self._boxes >= 0, self._boxes - table.start[:-1], -1)
        self.leaves = self.likeness.dressed(self.leaves, views, box, self.leaves.believed)

    def _numbers(self, views: list[GroundDetections]) -> BranchingConstants:
        q, (low, high) = self.parameters, self.setup.height
        return BranchingConstants(q.gate, q.motion.foot_spread, low, high, self.evidence.at_once(views), q.least, q.width, q.beam, q.children)

    def _prior(self, views: list[GroundDetections], cameras: list[Viewpoint], roots: list[CrossViewGroup]) -> Array:
        """Log-likelihood ratio of each root being somebody new."""
        people = self.leaves.select(self.best)
        return self.evidence.prior(list(zip(views, cameras, strict=True)), roots, (people.state[:, :2], people.tree), self._ticks)

    def _roots(self, views: list[GroundDetections], table: BoxTable, ways: ChildHypotheses) -> list[CrossViewGroup]:
        """What may be somebody new: boxes that are left over, where nobody stands whom these views did not see."""
        first = np.concatenate([[True], ways.parent[1:] != ways.parent[:-1]]) if len(ways.parent) else np.zeros(0, dtype=bool)
        # Who comes back after a while out of sight may be somebody else.
        trees = _of_trees(self.leaves, self.best)
        taken = assigned_boxes(trees[(self.leaves.misses[trees] < 2) & ~self.leaves.over[trees]], ways, table)
        free = [~taken[table.start[v] : table.start[v + 1]] & (f.confidence >= self.parameters.birth_confidence) for v, f in enumerate(views)]
        groups = group_across_views([self.evidence.corrected(feet) for feet in views], free, self.setup.height, self.parameters.fusion)
        place, seen = ways.state[first, :2], ways.box[first] >= 0
        here = (self.leaves.misses < 3) & ~self.leaves.over
        known = []
        for g in groups:
            near = np.linalg.norm(place - g.point, axis=1) < self.parameters.same_person
            known.append((near & here & ~seen[:, [v for v, _ in g.members]].any(axis=1)).any())
        return [g for g, k in zip(groups, known, strict=True) if not k]

    def _extend(self, ways: ChildHypotheses, new_trees: tuple[list[CrossViewGroup], Array], seen: tuple[BoxTable, Array], watched: Mask) -> None:
        """Leaves become their children, and roots with their scores are added; bonds go along. The columns of their boxes are kept for this tick."""
        q, (roots, prior), (table, missed) = self.parameters, new_trees, seen
        parents, met = self.leaves.select(ways.parent), (ways.box >= 0).any(axis=1)
        # For and against being there it does not count how well a box lies: that says which box it is.
        evidence = np.append(table.hit, 0.0)[ways.box].sum(axis=1) + ways.missed
        due = np.where(met, 0.0, parents.due + 1 - np.exp(missed[ways.parent].sum(axis=1)))
        past, spread, taken = parents.past.copy(), parents.spread.copy(), parents.met.copy()
        past[:, 0], spread[:, 0], taken[:, 0] = ways.state, ways.covariance, met
        children = replace(
            parents, state=ways.state, covariance=ways.covariance, score=parents.score + ways.gain,
            alive=np.clip(parents.alive + evidence, -20.0, q.most_score), hits=parents.hits + met, misses=np.where(met, 0, parents.misses + 1),
            past=past, spread=spread, met=taken, out=parents.out + 1, due=due, away=np.where(watched[ways.parent] | met, 0, parents.away + 1),
        )  # fmt: skip
        new = initiated(self._next_tree, roots, q.motion, self.window, self.leaves.appearance.shape[1])
        self._next_tree += len(roots)
        new = replace(new, score=prior, alive=prior)
        self._boxes = np.full((len(children) + len(new), len(table.origin)), -1, dtype=np.int64)
        self._boxes[: len(children)] = ways.box
        for k, group in enumerate(roots, len(children)):
            for v, d in group.members:
                self._boxes[k, v] = table.start[v] + d
        leaves = children.join(new)
        leaves.node[:, 0] = self._next_node + np.arange(len(leaves))
        self._next_node += len(leaves)
        parent = np.concatenate([ways.parent, np.full(len(new), -1, dtype=np.int64)])
        self._parent, self.leaves = parent, leaves
        missed = np.vstack([missed[ways.parent], np.zeros((len(new), len(table.origin)))])
        who = conflicts.ConflictRows(leaves.tree, self._boxes, leaves.state[:, :2], leaves.over, missed)
        self._bonds = conflicts.conflicts_of(self._bonds, parent, who, table.hit, (q.same_person, q.alone, q.apart))

    def _doubt(self, best: Ints, table: BoxTable, others: tuple[Ints, Mask, Array]) -> None:
        """A box that another track would take says little for who has it: there would be one as likely without them. others: tree (k,), whether
        believed, and what each would gain by each box (k, D)."""
        tree, known, worth = others
        if not worth.size:
            return
        view, alive = np.repeat(np.arange(len(table.origin)), np.diff(table.start)), self.leaves.alive.copy()
        row, column = np.nonzero(tree[:, None] == self.leaves.tree[best])
        has = self._boxes[best[column]]
        now = np.zeros((len(tree), len(table.origin)))
        now[row] = np.where(has >= 0, worth[row[:, None], has], 0.0)
        more = np.maximum(worth - now[:, view], 0.0)
        for leaf in best:
            rival = (tree != self.leaves.tree[leaf]) & (known | ~self.leaves.believed[leaf])
            box = self._boxes[leaf][self._boxes[leaf] >= 0]
            alive[leaf] -= np.minimum(more[np.ix_(rival, box)].max(axis=0, initial=0.0), np.maximum(table.hit[box], 0.0)).sum()
        self.leaves = replace(self.leaves, alive=alive)

    def _believe(self, best: Ints) -> set[int]:
        """Note who is certain by now; the trees that are for the first time."""
        q, leaves = self.parameters, self.leaves
        sure = np.zeros(len(leaves), dtype=bool)
        sure[best] = (leaves.hits[best] >= q.n_conf) & (leaves.alive[best] >= q.believe) & (leaves.misses[best] == 0)
        out, believed = leaves.out.copy(), leaves.believed | sure
        out[best] = 0
        fresh = set(leaves.tree[sure].tolist()) - set(leaves.tree[leaves.believed].tolist())
        # Who has ended stays for as long as the delay may ask of their last moments.
        gone = (leaves.alive < q.end) | self._left(leaves)
        self.leaves = replace(leaves, out=out, believed=believed, over=leaves.over | (believed & gone))
        return fresh

    def _left(self, leaves: TrackHypotheses) -> Mask:
        """Who (n,) is out of all views for so long that they are gone."""
        return np.asarray(leaves.away * self.setup.period > self.parameters.outside)

    def _learn(self, views: list[GroundDetections], ways: ChildHypotheses, seen: tuple[Ints, Array, Array], best: Ints) -> None:
        """Count what the views found of the best hypothesis; take innovations of who is believed as looks at the views' own offsets and noise.

        seen: first row of each view's boxes; how often (n, V) each view should see a parent, and how much (n, V, 2) of it is covered.
        """
        (start, expected, cover), leaves = seen, self.leaves
        known = best[self._parent[best] >= 0]
        box = self._boxes[known]
        sure = leaves.believed[known] & (leaves.misses[known] <= self._bridged)
        seen_of, shown = expected[self._parent[known]], cover[self._parent[known]]
        self.evidence.learn(views, np.where(box >= 0, box - start[:-1], -1), seen_of, (sure, leaves.alive[known]), shown)
        old = known[leaves.believed[known]]
        for v, feet in enumerate(views):
            looks = ways.residual[old, v], ways.H[old, v], ways.S[old, v]
            mine = old[self._boxes[old, v] >= 0], v
            self.noise.learn(feet.camera, ways.residual[mine], ways.S[mine], feet.covariance[self._boxes[mine] - start[v]])
            self.evidence.offsets.learn(feet.camera, leaves.state[old, :2], looks)

    def _reunite(self, best: Ints, fresh: set[int]) -> None:
        """Who is believed for the first time may be who was lost; end what has gone on as another."""
        people = self.leaves.select(_of_trees(self.leaves, best))
        away = self._left(people)
        new, held = np.isin(people.tree, list(fresh)), np.isin(people.tree, self.leaves.tree[best])
        ended = self.reunions.step(_as_tracks(people, self._stature), people.believed & held, new, set(people.tree[away].tolist()))
        self.leaves = replace(self.leaves, over=self.leaves.over | np.isin(self.leaves.tree, list(ended)))

    def _prune(self, chosen: GlobalHypothesis) -> None:
        """Drop what has ended, what was decided against n_scan ticks ago, and what is too much."""
        q, leaves = self.parameters, self.leaves
        longest = max(round(q.followed * self._bridged), self.window)
        # Who is not believed yet and takes what belongs to others would live for ever.
        young = (leaves.misses < 3) & (leaves.alive > q.forget) & (leaves.out <= q.patience)
        keep = np.where(leaves.believed, (leaves.misses <= longest) & (leaves.out <= self.n_scan), young)
        keep &= leaves.speed <= q.motion.v_max
        decided = {int(leaves.tree[k]): int(leaves.node[k, self.n_scan]) for k in chosen.best if leaves.believed[k]}
        past = zip(leaves.tree.tolist(), leaves.node[:, self.n_scan].tolist(), strict=True)
        keep &= np.array([decided.get(tree, node) == node for tree, node in past], dtype=bool)
        # Trees by their place among those that live: their ids grow for ever.
        _, tree = np.unique(leaves.tree, return_inverse=True)
        regret = conflicts.max_marginal_losses(np.maximum(weights(leaves, q.most_weight), 0.0), chosen.conflict, tree, chosen.best)
        regret[chosen.best] = -np.inf
        most = np.where(leaves.believed, q.tree_leaves, q.young_leaves)
        # Ended and undecided leaves are out before the places of a tree are given.
        keep &= conflicts.k_best_per_tree(tree, self._boxes, leaves.state, np.where(keep, regret, np.inf), most)
        keep &= (regret < q.most_regret) | ~leaves.believed
        if q.small_graphs:
            keep &= chosen.hypotheses.any(axis=0) | ~leaves.believed
        if keep.sum() > q.most_leaves:
            best = np.argsort(np.where(keep, regret, np.inf), kind="stable")[: q.most_leaves]
            keep = np.isin(np.arange(len(keep)), best)
        rows = np.flatnonzero(keep)
        number = np.full(len(leaves), -1)
        number[rows] = np.arange(len(rows))
        self.leaves, self._bonds = leaves.select(rows), Conflicts(self._bonds.conflict[np.ix_(rows, rows)], self._bonds.together[np.ix_(rows, rows)])
        self.best = number[chosen.best][keep[chosen.best]]
        self.kept = np.pad(chosen.hypotheses[:, rows], ((0, 0), (0, 1)))


def _of_trees(leaves: TrackHypotheses, best: Ints) -> Ints:
    """A row of each tree: that of `best`, or the one of the highest score."""
    held = np.zeros(len(leaves), dtype=bool)
    held[best] = True
    order = np.lexsort((-leaves.score, ~held, leaves.tree))
    return np.asarray(order[np.unique(leaves.tree[order], return_index=True)[1]])


def _as_tracks(people: TrackHypotheses, stature: tuple[float, float]) -> Tracks:
    """The same with a stature, of which nothing is known but how tall people are: mean and standard deviation, m."""
    state, covariance = np.zeros((len(people), 5)), np.zeros((len(people), 5, 5))
    state[:, :4], covariance[:, :4, :4] = people.state, people.covariance
    state[:, 4], covariance[:, 4, 4] = stature[0], stature[1] ** 2
    return Tracks(people.tree, state, covariance, people.score, people.hits, people.misses, people.age)


@final
class MhtTracker:
    """The tracker of people with multiple hypotheses, told `delay` ticks late. Raises ValueError where delay is below 0."""

    def __init__(self, setup: Setup, parameters: MhtParameters, delay: int) -> None:
        self._recall = MhtFixedLagSmoother(delay, setup.period, parameters.motion)
        self.hypotheses = MhtFilter(setup, parameters, delay)

    def step(self, views: list[GroundDetections], cameras: list[Viewpoint]) -> Tracks | None:
        """Take a tick; the people of the tick `delay` before it, None where there was none."""
        return self._told(self._recall.feed(*self.hypotheses.step(views, cameras)))

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that was not told yet; None where all are."""
        return self._told(self._recall.drain())

    def _told(self, people: Tracks | None) -> Tracks | None:
        return None if people is None else self.hypotheses.reunions.renamed(people)
