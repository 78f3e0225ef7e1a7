"""The book about the landmarks of the map, beside their means and covariance in the joint state: who they are, how they look, how they fare."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tracker.geometry import Array, Floats, Indices


def unit_rows(descriptor: ArrayLike) -> Floats:
    """Descriptors (n, d) of any scale → rows of length 1, float32; rows of zeros stay so."""
    rows = np.asarray(descriptor, dtype=np.float32)
    if rows.ndim != 2:
        raise ValueError(f"descriptor has shape {rows.shape}, needs (n, d)")
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)


def dissimilarity(look: Floats, subject: Indices, descriptor: Floats, other: Indices) -> Floats:
    """How unlike n things (n, k, d) with up to k looks each and m (m, d) are: (n, m) the distance of unit descriptors, the best look counts.

    Subjects that are known (≥ 0) decide alone: 0 where they are equal, infinite where they differ. Empty looks are rows of zeros, at distance 2.
    """
    n, k, d = look.shape
    if n == 0:
        return np.zeros((0, len(descriptor)), dtype=np.float32)
    filled = np.asarray(look.any(axis=2))
    product = np.full((n, len(descriptor)), -1.0, dtype=np.float32)
    # One product a look that is there; those of a landmark follow each other.
    some = np.flatnonzero(filled.any(axis=1))
    if len(some):
        first = np.cumsum(filled.sum(axis=1))[some] - filled.sum(axis=1)[some]
        product[some] = np.maximum.reduceat(look.reshape(n * k, d)[filled.ravel()] @ descriptor.T, first, axis=0)
    distance = np.sqrt(np.maximum(2 - 2 * product, 0.0))
    named = (subject[:, None] >= 0) | (other[None, :] >= 0)
    out: Floats = np.where(named, np.where(subject[:, None] == other[None, :], np.float32(0), np.float32(np.inf)), distance)
    return out


@dataclass(frozen=True)
class PruningParameters:
    """When a landmark goes. young: sightings under which it is on trial; trial: misses in a row that end a trial; refusals in a row that end any."""

    young: int = 4
    trial: int = 5
    refusals: int = 4


class LandmarkMap:
    """Rows 0 … count − 1 run with the landmarks of the joint state and are removed in the same way: the last takes the place.

    identity: a number that is never used again; subject: the given name or −1; look (capacity, robots, d): the last descriptor that each robot saw;
    hits, missed, refused; last: the tick of the last sighting; by: the robot that had it; when (capacity, robots): the last one of each, −1 for none.
    looked (robots,): the last tick at which each robot looked round and knew where it was.
    """

    def __init__(self, capacity: int, robots: int) -> None:
        self.count, self._next = 0, 0
        self.identity, self.subject, self.hits, self.missed, self.refused, self.last, self.by = np.zeros((7, capacity), dtype=np.intp)
        self.when = np.full((capacity, robots), -1, dtype=np.intp)
        self.looked = np.full(robots, -1, dtype=np.intp)
        self._look = np.zeros((capacity, robots, 0), dtype=np.float32)

    @property
    def look(self) -> Floats:
        return self._look[: self.count]

    def add(self, subject: int, descriptor: Floats, robot: int, tick: int, hits: int) -> None:
        """Book a new landmark with the descriptor (d,) that `robot` saw."""
        self._fit(len(descriptor))
        i = self.count
        self.count += 1
        self.identity[i], self.subject[i], self.hits[i], self.missed[i], self.refused[i] = self._next, subject, hits, 0, 0
        self.last[i], self.by[i] = tick, robot
        self.when[i] = -1
        self.when[i, robot] = tick
        self._look[i] = 0
        self._look[i, robot] = descriptor
        self._next += 1

    def seen(self, landmarks: Indices, descriptor: Floats, robot: int, tick: int) -> None:
        """Book sightings: landmarks (n,), their present descriptors (n, d)."""
        if len(landmarks) == 0:
            return
        self._look[landmarks, robot] = descriptor
        self.hits[landmarks] += 1
        self.missed[landmarks] = self.refused[landmarks] = 0
        self.last[landmarks], self.by[landmarks] = tick, robot
        self.when[landmarks, robot] = tick

    def doomed(self, survival: PruningParameters) -> Indices:
        """The landmarks to be dropped now, ascending."""
        n = slice(0, self.count)
        lost = (self.hits[n] < survival.young) & (self.missed[n] >= survival.trial)
        return np.flatnonzero(lost | (self.refused[n] >= survival.refusals))

    def stalest(self) -> int:
        """The landmark that was not seen for the longest while the robot that knows it looked; among equals the one with the fewest sightings, then
        the oldest. What a blind or lost robot knew waits for it: by that it is found again.
        """
        n = slice(0, self.count)
        overlooked = self.looked[self.by[n]] - self.last[n]
        return int(np.lexsort((self.identity[n], self.hits[n], -overlooked))[0])

    def remove(self, landmark: int) -> None:
        last = self.count - 1
        for column in (self.identity, self.subject, self.hits, self.missed, self.refused, self.last, self.by, self.when, self._look):
            column[landmark] = column[last]
        self.count = last

    def _fit(self, length: int) -> None:
        """Take the length of descriptors from the first one; a later one of another length is an error."""
        capacity, robots, known = self._look.shape
        if known == 0 and self.count == 0:
            self._look = np.zeros((capacity, robots, length), dtype=np.float32)
        elif known != length:
            raise ValueError(f"descriptor has length {length}, needs {known} as those before")


def spread(bearing_azimuth: Array, priority: Array, limit: int, sectors: int = 12) -> Indices:
    """At most `limit` of n things, dealt round the horizon: by rank within their sector of azimuth (n,) rad, then by priority (n,), high first."""
    sector = np.floor((bearing_azimuth + np.pi) / (2 * np.pi) * sectors).astype(int) % sectors
    order = np.argsort(-priority, kind="stable")
    rank = np.zeros(len(order), dtype=int)
    for s in range(sectors):
        members = order[sector[order] == s]
        rank[members] = np.arange(len(members))
    return np.sort(np.lexsort((-priority, rank))[:limit])
