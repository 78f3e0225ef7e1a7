"""The heaviest clique as a set packing: bounded by multipliers, and so proved where the classes of conflicts are large.

Every conflict lies in a class of vertices that all exclude each other, and a clique holds one vertex of a class at most: a linear program over the
classes bounds its weight. Vertices that another dominates are left out first, and parts that no conflict joins are solved by themselves. The bound
is lowered by multipliers (tracker/multipliers.py); classes of which more than one vertex is picked on the average are added; what the bound shows to
be in no better clique, or in every one, is fixed. What is left is a smaller graph, to be settled anew, or is branched on; where that does not end,
HiGHS is asked. The conflicts of trackers come from trees and boxes, whose leaves are such classes, and that program is nearly integral.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from tracker.clique.clique_cover import cover, dominated, grouped, labels, violated
from tracker.clique.lagrangian_bound import ROOT, Packing, Work, lower, settle
from tracker.clique.local_search import Graph, Limits, Options, Tuning, search
from tracker.geometry import Ints

ROUNDS = 5
"""Times that the bound is lowered before the first branch; between two of them classes are added."""

SHRUNK = 0.7
"""Share of the vertices below which what is left is a graph of its own."""


@dataclass(frozen=True)
class Effort:
    """What a solution may cost: moves of a search before the multipliers (0: none) and seed of it, branches, and nodes of HiGHS, at most of each
    part (0: neither)."""

    moves: int = 2000
    seed: int = 0
    branches: int = 100


def settled(graph: Graph, known: Ints, effort: Effort) -> tuple[Ints, bool]:
    """The heaviest clique found, at least as heavy as the clique `known`, and whether it is proved to be the heaviest.

    The same graph, clique and effort give the same result. Takes memory for a matrix of the vertices.
    """
    inside = np.zeros(len(graph), dtype=bool)
    inside[known] = True
    rows = np.flatnonzero(~dominated(graph.weight, graph.start, graph.conflict))
    label = labels(graph.start, graph.conflict, rows)
    chosen, proved = [np.zeros(0, dtype=np.int64)], True
    order = np.argsort(label, kind="stable")
    for part in np.split(rows[order], np.flatnonzero(np.diff(label[order])) + 1):
        if len(part) == 1:
            chosen.append(part)
            continue
        best, sure = _part(graph.within(part), np.flatnonzero(inside[part]), effort)
        chosen.append(part[best])
        proved &= sure
    found = np.sort(np.concatenate(chosen))
    return (found if graph.weight[found].sum() > graph.weight[known].sum() else known), proved


def _part(graph: Graph, known: Ints, effort: Effort) -> tuple[Ints, bool]:
    """`settled` for a graph whose conflicts hold together: what the multipliers leave is a smaller graph, to be settled anew or branched on."""
    if effort.moves:
        known = search(graph, Limits(moves=effort.moves), effort.seed, Options(start=known, tuning=Tuning(T=10))).vertices
    n = len(graph)
    first, member, group, groups = _classes(graph)
    best, most = np.zeros(n, dtype=bool), np.array([graph.weight[known].sum()])
    best[known] = True
    free, y, often = np.ones(n, dtype=bool), np.zeros(0), np.zeros(n)
    for _ in range(ROUNDS):
        packing, y = _packed(graph, first, member, group), np.append(y, np.zeros(len(first) - 1 - len(y)))
        work = Work(
            best, most, np.zeros(n), often, np.zeros(groups), np.zeros(groups), np.zeros(groups, np.int64), np.zeros(len(y)), np.zeros(n, np.bool_),
            np.zeros(len(y)),
        )  # fmt: skip
        if lower(packing, work, free, y, ROOT):
            return np.flatnonzero(best), True
        rows = np.flatnonzero(free)
        if len(rows) < SHRUNK * n:
            inner, proved = settled(graph.within(rows), np.flatnonzero(best[rows]), replace(effort, moves=0))
            return (rows[inner] if graph.weight[rows[inner]].sum() > most[0] else np.flatnonzero(best)), proved
        more, others = violated(graph.start, graph.conflict, free, often)
        if len(more) == 1:
            break
        first, member = np.append(first, first[-1] + more[1:]), np.append(member, others)
    if settle(packing, work, free, y, effort.branches):
        return np.flatnonzero(best), True
    if not effort.branches:
        return np.flatnonzero(best), False
    found, proved = _programmed(graph, effort.branches)
    return (found if graph.weight[found].sum() > most[0] else np.flatnonzero(best)), proved


def _programmed(graph: Graph, nodes: int) -> tuple[Ints, bool]:
    """The clique that HiGHS finds by integer programming in so many nodes, none where it finds none, and whether it is proved to be the heaviest."""
    first, member = cover(graph.start, graph.conflict)
    classes = csr_array((np.ones(len(member)), member, first), shape=(len(first) - 1, len(graph)))
    options = {"mip_rel_gap": 0.0, "node_limit": nodes}
    limits = LinearConstraint(classes, -np.inf, 1)
    answer = milp(-graph.weight, constraints=limits, bounds=Bounds(0, 1), integrality=np.ones(len(graph)), options=options)
    found = np.flatnonzero(answer.x > 0.5) if answer.x is not None else np.zeros(0, dtype=np.int64)
    return found, answer.status == 0


def _classes(graph: Graph) -> tuple[Ints, Ints, Ints, int]:
    """Classes that need a multiplier: first, member; group (n,) and how many groups."""
    first, member = cover(graph.start, graph.conflict)
    group, groups, whole = grouped(first, member, len(graph))
    # A class that is a group needs none.
    count = np.diff(first)
    return np.concatenate([[0], np.cumsum(count[~whole])]), member[np.repeat(~whole, count)], group, groups


def _packed(graph: Graph, first: Ints, member: Ints, group: Ints) -> Packing:
    """The graph with its classes and groups, and the classes of each vertex."""
    order = np.argsort(member, kind="stable")
    enter = np.concatenate([[0], np.cumsum(np.bincount(member, minlength=len(graph)))])
    owner = np.repeat(np.arange(len(first) - 1), np.diff(first))
    return Packing(graph.weight, graph.start, graph.conflict, first, member, enter, owner[order], group)
