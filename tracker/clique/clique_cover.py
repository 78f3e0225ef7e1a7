"""Covers of a conflict graph by classes, compiled; dominated vertices and connected components.

A class is a set of vertices that exclude each other: a clique of the conflict graph. Classes are given in CSR form (first, member): those of
class c are member[first[c] : first[c + 1]]. A clique of the compatible vertices holds at most one vertex of a class.
"""

from __future__ import annotations

import numpy as np

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.compilation import njit


@njit(cache=True)
def dominated(weight: Array, start: Ints, conflict: Ints) -> Mask:
    """Which vertices (n,) are dominated: one that they exclude is as heavy, and excludes no vertex that they do not exclude."""
    n = len(weight)
    out, mark = np.zeros(n, np.bool_), np.full(n, -1)
    for v in range(n):
        mark[v] = v
        for k in range(start[v], start[v + 1]):
            mark[conflict[k]] = v
        for k in range(start[v], start[v + 1]):
            u = conflict[k]
            if out[u] or weight[u] < weight[v] or (weight[u] == weight[v] and u > v) or start[u + 1] - start[u] > start[v + 1] - start[v]:
                continue
            q = start[u]
            while q < start[u + 1] and mark[conflict[q]] == v:
                q += 1
            if q == start[u + 1]:
                out[v] = True
                break
    return out


@njit(cache=True)
def component_labels(start: Ints, conflict: Ints, rows: Ints) -> Ints:
    """Number (k,) of the connected component of the conflicts among `rows` (k,) in which each lies."""
    label, place, waiting, count = np.full(len(rows), -1), np.full(len(start), -1), np.empty(len(rows), np.int64), 0
    place[rows] = np.arange(len(rows))
    for first in range(len(rows)):
        if label[first] >= 0:
            continue
        label[first], waiting[0], size = count, first, 1
        while size:
            size -= 1
            v = rows[waiting[size]]
            for k in range(start[v], start[v + 1]):
                u = place[conflict[k]]
                if u >= 0 and label[u] < 0:
                    label[u], waiting[size] = count, u
                    size += 1
        count += 1
    return label


@njit(cache=True)
def conflict_classes(start: Ints, conflict: Ints) -> tuple[Ints, Ints]:
    """Classes (first, member) such that every conflict lies in one.

    A class grows from a conflict that lies in none, greedily by the vertex with most such conflicts.
    """
    n = len(start) - 1
    uncovered, clash = np.zeros((n, n), np.bool_), np.zeros((n, n), np.bool_)
    for v in range(n):
        for k in range(start[v], start[v + 1]):
            uncovered[v, conflict[k]] = clash[v, conflict[k]] = True
    first, member = [0], [np.int64(0) for _ in range(0)]
    candidates, gain = np.empty(n, np.int64), np.zeros(n, np.int64)
    for a in range(n):
        for k in range(start[a], start[a + 1]):
            if not uncovered[a, conflict[k]]:
                continue
            size = 0
            for q in range(start[a], start[a + 1]):
                candidates[size], gain[conflict[q]] = conflict[q], uncovered[a, conflict[q]]
                size += 1
            member.append(np.int64(a))
            v = conflict[k]
            while v >= 0:
                member.append(np.int64(v))
                kept, following = 0, -1
                for q in range(size):
                    u = candidates[q]
                    if clash[v, u]:
                        candidates[kept] = u
                        gain[u] += uncovered[v, u]
                        kept += 1
                        if following < 0 or gain[u] > gain[following]:
                            following = u
                size, v = kept, following
            for p in range(first[-1], len(member)):
                for q in range(first[-1], len(member)):
                    uncovered[member[p], member[q]] = False
            first.append(len(member))
    return np.array(first), np.array(member)


@njit(cache=True)
def partition(first: Ints, member: Ints, n: int) -> tuple[Ints, int, Mask]:
    """A partition of the n vertices into groups within classes: group (n,), the number of groups, and which classes are whole groups.

    Greedily, the class with most vertices that have no group becomes the next group.
    """
    classes = len(first) - 1
    group, groups, whole = np.full(n, -1), 0, np.zeros(classes, np.bool_)
    free = np.diff(first)
    while classes:
        c = np.argmax(free)
        if free[c] < 2:
            break
        whole[c] = free[c] == first[c + 1] - first[c]
        for k in range(first[c], first[c + 1]):
            if group[member[k]] < 0:
                group[member[k]] = groups
        groups += 1
        for d in range(classes):
            free[d] = 0
            for k in range(first[d], first[d + 1]):
                free[d] += group[member[k]] < 0
    for v in range(n):
        if group[v] < 0:
            group[v] = groups
            groups += 1
    return group, groups, whole


@njit(cache=True)
def violated_classes(start: Ints, conflict: Ints, free: Mask, primal: Array) -> tuple[Ints, Ints]:
    """Classes (first, member) over which the primal estimate (n,) sums to more than 1, each grown greedily from one vertex."""
    n = len(start) - 1
    first, member = [0], [np.int64(0) for _ in range(0)]
    candidates, mark, stamp, done = np.empty(n, np.int64), np.zeros(n, np.int64), 0, np.zeros(n, np.bool_)
    value = primal + 1e-9 * np.diff(start)
    for a in np.argsort(-primal, kind="mergesort"):
        if not free[a] or primal[a] < 0.01:
            continue
        size = 0
        for k in range(start[a], start[a + 1]):
            if free[conflict[k]]:
                candidates[size] = conflict[k]
                size += 1
        member.append(np.int64(a))
        total, new = primal[a], not done[a]
        while size:
            v = candidates[0]
            for q in range(1, size):
                if value[candidates[q]] > value[v]:
                    v = candidates[q]
            member.append(v)
            total += primal[v]
            new = new or (primal[v] > 0.01 and not done[v])
            stamp += 1
            for k in range(start[v], start[v + 1]):
                mark[conflict[k]] = stamp
            kept = 0
            for q in range(size):
                if mark[candidates[q]] == stamp:
                    candidates[kept] = candidates[q]
                    kept += 1
            size = kept
        if total > 1.03 and new:
            for k in range(first[-1], len(member)):
                done[member[k]] = True
            first.append(len(member))
        else:
            while len(member) > first[-1]:
                member.pop()
    return np.array(first), np.array(member)
