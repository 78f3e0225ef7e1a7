"""The maximum-weight clique as a set packing problem, with Lagrangian bounds: proved where the classes of conflicts are large.

A class is a set of vertices that exclude each other. A clique holds at most one vertex of a class, which gives a linear program.
Conflicts of trackers come from trees and boxes, whose leaves form such classes, so that the program is nearly integral.

* Dominated vertices are left out, and connected components of the conflicts are solved one by one.
* Lagrangian multipliers bound the weight (lagrangian_bound.py). Classes that the primal estimate violates are added in between.
* Vertices that the bound excludes from every better clique, or finds in all of them, are fixed.
* The remaining graph is smaller. It is solved in the same way, or by branch and bound, and at last by HiGHS (scipy.optimize.milp).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from tracker.clique.clique_cover import component_labels, conflict_classes, dominated, partition, violated_classes
from tracker.clique.lagrangian_bound import ROOT_STEPS, BoundState, SetPacking, branch, minimize_bound
from tracker.clique.local_search import Graph, Limits, Options, search
from tracker.geometry import Ints

ROUNDS = 5
"""Greatest number of minimizations of the bound before the first branch; classes are added in between."""

SHRUNK = 0.7
"""Share of the vertices below which the remaining graph is solved from the start."""


@dataclass(frozen=True)
class Effort:
    """Bounds on the effort. moves, seed: of a local search before the multipliers; 0 moves skip it. branches: of each component, and nodes of
    HiGHS; 0 skips both."""

    moves: int = 2000
    seed: int = 0
    branches: int = 100


def heaviest_clique(graph: Graph, known: Ints, effort: Effort) -> tuple[Ints, bool]:
    """The heaviest clique found, at least as heavy as the clique `known`, and whether it is proved to be optimal.

    The same graph, clique and effort give the same result. Memory grows with the square of the number of vertices.
    """
    inside = np.zeros(len(graph), dtype=bool)
    inside[known] = True
    rows = np.flatnonzero(~dominated(graph.weight, graph.start, graph.conflict))
    label = component_labels(graph.start, graph.conflict, rows)
    chosen, proved = [np.zeros(0, dtype=np.int64)], True
    order = np.argsort(label, kind="stable")
    for component in np.split(rows[order], np.flatnonzero(np.diff(label[order])) + 1):
        if len(component) == 1:
            chosen.append(component)
            continue
        best, sure = _component(graph.within(component), np.flatnonzero(inside[component]), effort)
        chosen.append(component[best])
        proved &= sure
    found = np.sort(np.concatenate(chosen))
    return (found if graph.weight[found].sum() > graph.weight[known].sum() else known), proved


def _component(graph: Graph, known: Ints, effort: Effort) -> tuple[Ints, bool]:
    """`heaviest_clique` for a graph whose conflicts are connected."""
    if effort.moves:
        known = search(graph, Limits(moves=effort.moves), effort.seed, Options(start=known, T=10)).vertices
    n = len(graph)
    first, member, group, groups = _classes(graph)
    best, best_weight = np.zeros(n, dtype=bool), np.array([graph.weight[known].sum()])
    best[known] = True
    free, y, primal = np.ones(n, dtype=bool), np.zeros(0), np.zeros(n)
    for _ in range(ROUNDS):
        packing, y = _packing(graph, first, member, group), np.append(y, np.zeros(len(first) - 1 - len(y)))
        state = BoundState(
            best, best_weight, np.zeros(n), primal, np.zeros(groups), np.zeros(groups), np.zeros(groups, np.int64), np.zeros(len(y)),
            np.zeros(n, np.bool_), np.zeros(len(y)),
        )  # fmt: skip
        if minimize_bound(packing, state, free, y, ROOT_STEPS):
            return np.flatnonzero(best), True
        rows = np.flatnonzero(free)
        if len(rows) < SHRUNK * n:
            inner, proved = heaviest_clique(graph.within(rows), np.flatnonzero(best[rows]), replace(effort, moves=0))
            return (rows[inner] if graph.weight[rows[inner]].sum() > best_weight[0] else np.flatnonzero(best)), proved
        more, others = violated_classes(graph.start, graph.conflict, free, primal)
        if len(more) == 1:
            break
        first, member = np.append(first, first[-1] + more[1:]), np.append(member, others)
    if branch(packing, state, free, y, effort.branches):
        return np.flatnonzero(best), True
    if not effort.branches:
        return np.flatnonzero(best), False
    found, proved = _solve_by_milp(graph, effort.branches)
    return (found if graph.weight[found].sum() > best_weight[0] else np.flatnonzero(best)), proved


def _solve_by_milp(graph: Graph, nodes: int) -> tuple[Ints, bool]:
    """The clique that HiGHS finds by integer programming in `nodes` nodes, empty where it finds none, and whether it is proved to be optimal."""
    first, member = conflict_classes(graph.start, graph.conflict)
    classes = csr_array((np.ones(len(member)), member, first), shape=(len(first) - 1, len(graph)))
    options = {"mip_rel_gap": 0.0, "node_limit": nodes}
    limits = LinearConstraint(classes, -np.inf, 1)
    answer = milp(-graph.weight, constraints=limits, bounds=Bounds(0, 1), integrality=np.ones(len(graph)), options=options)
    found = np.flatnonzero(answer.x > 0.5) if answer.x is not None else np.zeros(0, dtype=np.int64)
    return found, answer.status == 0


def _classes(graph: Graph) -> tuple[Ints, Ints, Ints, int]:
    """Classes that need a multiplier (first, member), group (n,) of each vertex, and the number of groups."""
    first, member = conflict_classes(graph.start, graph.conflict)
    group, groups, whole = partition(first, member, len(graph))
    # A class that is a whole group needs no multiplier.
    count = np.diff(first)
    return np.concatenate([[0], np.cumsum(count[~whole])]), member[np.repeat(~whole, count)], group, groups


def _packing(graph: Graph, first: Ints, member: Ints, group: Ints) -> SetPacking:
    """The graph with its classes and groups, and the classes of each vertex."""
    order = np.argsort(member, kind="stable")
    enter = np.concatenate([[0], np.cumsum(np.bincount(member, minlength=len(graph)))])
    owner = np.repeat(np.arange(len(first) - 1), np.diff(first))
    return SetPacking(graph.weight, graph.start, graph.conflict, first, member, enter, owner[order], group)
