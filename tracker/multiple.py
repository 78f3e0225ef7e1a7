"""Which boxes are which people: track trees, and the best set of tracks as a maximum-weight clique, from tick to tick.

`MultipleHypotheses.step` takes what all views have at a tick and gives the tracks of the best hypothesis, with their last moments. A person who
was taken for somebody else is put right within the N-scan: the best hypothesis is found anew at every tick over all that is not decided.

It departs from the scheme of Yoo et al. in this: a track takes boxes one by one, not tracklets, with the likelihood of its own Kalman filter as
score; all leaves make one graph, which falls into parts that are solved by themselves (`small_graphs` has one graph for each hypothesis); and a
leaf stays by what it would cost the best hypothesis to hold it, not by the share of hypotheses that do. By default the tracker of
tracker/hypotheses.py is used, which is better on PETS 2009: it learns how far each view can be believed (tracker/evidence.py), this does not yet."""

from __future__ import annotations

from dataclasses import replace
from typing import final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tracker import bonds, branches
from tracker.bonds import Bonds
from tracker.branches import Boxes, Branches, Numbers, Standing
from tracker.cameras import Camera
from tracker.fusion import Combination, Feet, combine
from tracker.geometry import Array, Pose
from tracker.leaves import Leaves, born, predict, weights
from tracker.measurements import Ints, Setup
from tracker.recall import Recall
from tracker.selection import MultipleParameters, Selection, select
from tracker.trees import Tracks
from tracker.visibility import Bodies

Mask = NDArray[np.bool_]


class MultipleHypotheses:
    """The online tracker of people. State after a tick depends on ticks up to it alone."""

    def __init__(self, setup: Setup, parameters: MultipleParameters, delay: int = 0) -> None:
        """delay: ticks that the tracks shall remember."""
        self.setup, self.parameters = setup, parameters
        self.n_scan = max(1, round(parameters.n_scan / setup.period))
        self.window = max(self.n_scan, delay) + 1
        self.leaves = Leaves.none(self.window)
        self.best = np.zeros(0, dtype=np.int64)  # rows of the leaves in the best hypothesis
        self.kept = np.zeros((0, 1), dtype=bool)  # which leaves each hypothesis holds; the last column is for roots, whose parent is −1
        self.offsets: dict[str, tuple[Array, Array]] = {}  # camera → offset (2,) m on the ground, covariance (2, 2)
        self._parent, self._boxes = np.zeros(0, dtype=np.int64), np.zeros((0, 0), dtype=np.int64)
        self._bonds = Bonds(np.zeros((0, 0), dtype=bool), np.zeros((0, 0), dtype=np.int16))
        self._next_tree, self._next_node, self._ticks = 1, 0, 0

    def step(self, views: list[Feet], cameras: list[tuple[Camera, Pose]]) -> tuple[Leaves, Mask]:
        """Take one tick; cameras: model and T_world_camera of each view. The tracks of the best hypothesis, and who of them is there now."""
        self._ticks += 1
        self.leaves = predict(self.leaves, self.setup.period, self.parameters.motion)
        expected = self._expected(cameras)
        table = self._table(views)
        ways = branches.grow(self._standing(expected), table, self._numbers())
        held = bonds.worthwhile(ways, self.leaves.tree, self.leaves.misses, self.parameters.slack, len(table.usable))
        ways = Branches._make(column[held] for column in ways)
        roots = self._roots(views, table, ways)
        self._extend(ways, roots, table)
        chosen = select(self.leaves, self._bonds, self.kept[:, self._parent], self.parameters, self._ticks + 1_000_003 * self.parameters.seed)
        self._believe(chosen.best)
        self._learn(views, ways, chosen.best)
        self._prune(chosen)
        people = self.leaves.select(self.best)
        here = people.believed & ~people.over & (people.misses * self.setup.period <= self.parameters.delta_a)
        return people, here

    def _expected(self, cameras: list[tuple[Camera, Pose]]) -> Array:
        front = self.best[~self.leaves.over[self.best]]
        bodies = Bodies(self.leaves.state[:, :2], self.leaves.tree, front, self.setup.ground)
        return bodies.by_view(cameras, self.setup.occluders, self.parameters.fusion.reach).copy()

    def _standing(self, expected: Array) -> Standing:
        place, ground = self.leaves.state[:, :2], self.setup.ground
        around = [np.array([0.1, 0.0]), np.array([0.0, 0.1])]
        slope = np.stack([(ground.height_at(place + e) - ground.height_at(place - e)) / 0.2 for e in around], axis=1)
        return Standing(self.leaves.state, self.leaves.covariance, ground.height_at(place), slope, expected, self.leaves.over, self.leaves.tree)

    def _numbers(self) -> Numbers:
        q, (low, high) = self.parameters, self.setup.height
        certain, miss = np.log((1 - q.false_negative) / q.clutter), np.log(q.false_negative / (1 - q.false_negative))
        return Numbers(certain, q.gate, q.motion.foot_spread, q.hidden_feet, low, high, miss, q.least, q.width, q.beam, q.children)

    def _table(self, views: list[Feet]) -> Boxes:
        def column(name: str, shape: tuple[int, ...]) -> Array:
            return np.concatenate([np.zeros((0, *shape)), *(getattr(f, name) for f in views)])

        start = np.cumsum([0, *(len(f) for f in views)])
        offset = np.array([self._offset(f.camera)[0] for f in views]).reshape(-1, 2)
        origin = np.array([f.origin for f in views]).reshape(-1, 3)
        usable = column("confidence", ()) >= self.parameters.min_confidence
        return Boxes(
            origin, offset, start, column("direction", (3,)), column("covariance", (2, 2)), column("hidden", ()) > 0,
            np.tan(column("head_elevation", ())), usable,
        )  # fmt: skip

    def _roots(self, views: list[Feet], table: Boxes, ways: Branches) -> list[Combination]:
        """What may be somebody new: boxes that no leaf wants most, where nobody stands whom these views did not see."""
        first = np.concatenate([[True], ways.parent[1:] != ways.parent[:-1]]) if len(ways.parent) else np.zeros(0, dtype=bool)
        claimed = np.zeros(len(table.usable) + 1, dtype=bool)
        # Who comes back after a while out of sight may be somebody else.
        claimed[ways.box[first & (self.leaves.misses[ways.parent] < 2)].ravel()] = True
        free = [~claimed[table.start[v] : table.start[v + 1]] & (f.confidence >= self.parameters.birth_confidence) for v, f in enumerate(views)]
        groups = combine(views, free, self.setup.height, self.parameters.fusion)
        place, seen = ways.state[first, :2], ways.box[first] >= 0
        here = (self.leaves.misses < 3) & ~self.leaves.over
        known = []
        for g in groups:
            near = np.linalg.norm(place - g.point, axis=1) < self.parameters.same_person
            known.append((near & here & ~seen[:, [v for v, _ in g.members]].any(axis=1)).any())
        return [g for g, k in zip(groups, known, strict=True) if not k]

    def _extend(self, ways: Branches, roots: list[Combination], table: Boxes) -> None:
        """Leaves become their children, and roots are added; bonds go along. The columns of their boxes are kept for this tick."""
        q = self.parameters
        parents, met = self.leaves.select(ways.parent), (ways.box >= 0).any(axis=1)
        hit, views = np.log((1 - q.false_positive) / q.false_positive), (ways.box >= 0).sum(axis=1)
        # For and against being there each box counts alike: how well it lies says which box it is.
        evidence = hit * views + ways.missed
        past, spread, seen = parents.past.copy(), parents.spread.copy(), parents.met.copy()
        past[:, 0], spread[:, 0], seen[:, 0] = ways.state, ways.covariance, met
        children = replace(
            parents, state=ways.state, covariance=ways.covariance, score=parents.score + ways.gain,
            alive=np.clip(parents.alive + evidence, -20.0, 20.0), hits=parents.hits + met, misses=np.where(met, 0, parents.misses + 1),
            past=past, spread=spread, met=seen, out=parents.out + 1,
        )  # fmt: skip
        new = born(self._next_tree, roots, q.motion, self.window)
        self._next_tree += len(roots)
        size = np.array([len(g.members) for g in roots], dtype=np.float64)
        new = replace(new, score=q.birth + q.confirmation * (size - 1), alive=hit * size)
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
        self._bonds = bonds.bind(self._bonds, self._parent, self.leaves.tree, self._boxes, self.leaves.state[:, :2], q.same_person)

    def _believe(self, best: Ints) -> None:
        q, leaves = self.parameters, self.leaves
        sure = np.zeros(len(leaves), dtype=bool)
        sure[best] = (leaves.hits[best] >= q.n_conf) & (leaves.alive[best] >= q.believe) & (leaves.misses[best] == 0)
        out, believed = leaves.out.copy(), leaves.believed | sure
        out[best] = 0
        self.leaves = replace(leaves, out=out, believed=believed, over=leaves.over | (believed & (leaves.alive < -10)))

    def _offset(self, camera: str) -> tuple[Array, Array]:
        return self.offsets.get(camera, (np.zeros(2), self.parameters.offset_sigma**2 * np.eye(2)))

    def _learn(self, views: list[Feet], ways: Branches, best: Ints) -> None:
        """Take the innovations of who is believed as looks at the views' own offsets; Kalman's update, widened as looks are not independent."""
        if self.parameters.offset_sigma <= 0:
            return
        old = best[self.leaves.believed[best] & (self._parent[best] >= 0)]
        for v, feet in enumerate(views):
            looks = ways.residual[old, v], ways.H[old, v], ways.S[old, v]
            self.offsets[feet.camera] = _learnt(self._offset(feet.camera), looks, self.parameters.offset_memory)

    def _prune(self, chosen: Selection) -> None:
        """Drop what has ended, what was decided against n_scan ticks ago, and what is too much."""
        q, leaves = self.parameters, self.leaves
        longest = max(round(2 * q.delta_a / self.setup.period), self.window)
        # Who is not believed yet and takes what belongs to others would live for ever.
        young = (leaves.misses < 3) & (leaves.alive > -3) & (leaves.out <= q.patience)
        keep = np.where(leaves.believed, (leaves.misses <= longest) & (leaves.out <= self.n_scan), young)
        keep &= leaves.speed <= q.motion.v_max
        decided = {int(leaves.tree[k]): int(leaves.node[k, self.n_scan]) for k in chosen.best if leaves.believed[k]}
        past = zip(leaves.tree.tolist(), leaves.node[:, self.n_scan].tolist(), strict=True)
        keep &= np.array([decided.get(tree, node) == node for tree, node in past], dtype=bool)
        # Trees by their place among those that live: their ids grow for ever.
        _, tree = np.unique(leaves.tree, return_inverse=True)
        regret = bonds.regrets(np.maximum(weights(leaves, q.most_weight), 0.0), chosen.conflict, tree, chosen.best)
        regret[chosen.best] = -np.inf
        most = np.where(leaves.believed, q.tree_leaves, q.young_leaves)
        # Ended and undecided leaves are out before the places of a tree are given.
        keep &= bonds.leaders(tree, self._boxes, leaves.state, np.where(keep, regret, np.inf), most)
        keep &= (regret < q.most_regret) | ~leaves.believed
        if q.small_graphs:
            keep &= chosen.hypotheses.any(axis=0) | ~leaves.believed
        if keep.sum() > q.most_leaves:
            best = np.argsort(np.where(keep, regret, np.inf), kind="stable")[: q.most_leaves]
            keep = np.isin(np.arange(len(keep)), best)
        rows = np.flatnonzero(keep)
        number = np.full(len(leaves), -1)
        number[rows] = np.arange(len(rows))
        self.leaves, self._bonds = leaves.select(rows), Bonds(self._bonds.conflict[np.ix_(rows, rows)], self._bonds.together[np.ix_(rows, rows)])
        self.best = number[chosen.best][keep[chosen.best]]
        self.kept = np.pad(chosen.hypotheses[:, rows], ((0, 0), (0, 1)))


@njit(cache=True)
def _learnt(offset: tuple[Array, Array], looks: tuple[Array, Array, Array], memory: float) -> tuple[Array, Array]:
    """Offset (2,) and its covariance (2, 2) after looks: residual (k, 2), NaN where there is none, H and S (k, 2, 2)."""
    x, P = offset
    for k in range(len(looks[0])):
        residual, H, S = looks[0][k], looks[1][k], looks[2][k]
        if np.isfinite(residual[0]):
            HP = H @ P
            K = np.linalg.solve(HP @ H.T.copy() + memory * S, HP).T.copy()
            x, P = x + K @ residual, P - K @ HP
    return x, P


@final
class MultipleTargets:
    """The tracker of people with multiple hypotheses, told `delay` ticks late. Raises ValueError where delay is below 0."""

    def __init__(self, setup: Setup, parameters: MultipleParameters, delay: int) -> None:
        self._recall = Recall(delay, setup.period, parameters.motion)
        self.hypotheses = MultipleHypotheses(setup, parameters, delay)

    def step(self, views: list[Feet], cameras: list[tuple[Camera, Pose]]) -> Tracks | None:
        """Take a tick; the people of the tick `delay` before it, None where there was none."""
        return self._recall.feed(*self.hypotheses.step(views, cameras))

    def drain(self) -> Tracks | None:
        """The people of the oldest tick that was not told yet; None where all are."""
        return self._recall.drain()
