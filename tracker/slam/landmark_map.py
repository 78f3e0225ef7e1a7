"""The map's records of each landmark beside its mean and covariance: identity, descriptors, sightings and rejections; and the drift of features.

The errors of the bearings of one feature are correlated in time. The point that it shows slides over the surface as the view changes.
A filter that treats them as independent is overconfident. Here they are a random walk of the landmark, plus white noise.

Several robots may see one landmark at a time from different sides, and so different points of its surface. The landmark is the point that one
of them sees, its viewer. For the others the difference of the views is noise of their bearings. If the landmark took a random step at each change
of the robot, its information would be lost from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices

SECTORS = 12
"""Sectors of azimuth over which the updates of a view are spread."""


def unit_rows(descriptor: ArrayLike) -> Floats:
    """Descriptors (n, d) of any scale → rows of length 1, float32; rows of zeros stay zero. Raises ValueError for another shape."""
    rows = np.asarray(descriptor, dtype=np.float32)
    if rows.ndim != 2:
        raise ValueError(f"descriptor has shape {rows.shape}, needs (n, d)")
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)


def dissimilarity(descriptors: Floats, subject: Indices, descriptor: Floats, other: Indices) -> Floats:
    """Descriptor distances (n, m) between n landmarks (n, k, d), with up to k descriptors each, and m sightings (m, d).

    It is the Euclidean distance of unit descriptors, minimal over the k. Known subjects (≥ 0) decide alone: 0 where they are equal, infinite
    where they differ. Missing descriptors are rows of zeros, at distance 2.
    """
    n, k, d = descriptors.shape
    if n == 0:
        return np.zeros((0, len(descriptor)), dtype=np.float32)
    filled = np.asarray(descriptors.any(axis=2))
    product = np.full((n, len(descriptor)), -1.0, dtype=np.float32)
    # One product for each existing descriptor; those of a landmark are adjacent.
    some = np.flatnonzero(filled.any(axis=1))
    if len(some):
        first = np.cumsum(filled.sum(axis=1))[some] - filled.sum(axis=1)[some]
        product[some] = np.maximum.reduceat(descriptors.reshape(n * k, d)[filled.ravel()] @ descriptor.T, first, axis=0)
    distance = np.sqrt(np.maximum(2 - 2 * product, 0.0))
    named = (subject[:, None] >= 0) | (other[None, :] >= 0)
    out: Floats = np.where(named, np.where(subject[:, None] == other[None, :], np.float32(0), np.float32(np.inf)), distance)
    return out


@dataclass(frozen=True)
class PruningParameters:
    """When a landmark is deleted.

    A landmark with fewer than min_sightings is deleted after max_misses in a row, and any landmark after max_rejections in a row.
    """

    min_sightings: int = 4
    max_misses: int = 5
    max_rejections: int = 4


class LandmarkMap:
    """Records of the landmarks; rows 0 … count − 1 correspond to the joint state's. The last row replaces a removed one.

    identity: a unique number; subject: the given name or −1; descriptor (count, robots, d): the last one that each robot saw; hits, missed,
    rejected: counts. last_seen: tick of the last sighting; last_robot: its robot; last_seen_by (capacity, robots): tick of each robot's last
    sighting, −1 for none. view (capacity, 3) m: the last position of the camera of the robot `viewer`, relative to the landmark, at the tick
    `viewed`; zero if unknown.
    last_localized (robots,): the last tick at which each robot had sightings and was not lost.
    """

    def __init__(self, capacity: int, robots: int) -> None:
        self.count, self._next = 0, 0
        self.identity, self.subject, self.hits, self.missed, self.rejected, self.last_seen, self.last_robot = np.zeros((7, capacity), dtype=np.intp)
        self.last_seen_by = np.full((capacity, robots), -1, dtype=np.intp)
        self.last_localized = np.full(robots, -1, dtype=np.intp)
        self.viewer, self.viewed = np.zeros((2, capacity), dtype=np.intp)
        self.view = np.zeros((capacity, 3))
        self._descriptor = np.zeros((capacity, robots, 0), dtype=np.float32)

    @property
    def descriptor(self) -> Floats:
        """Descriptors (count, robots, d); zeros where a robot has not seen the landmark."""
        return self._descriptor[: self.count]

    def add(self, subject: int, descriptor: Floats, robot: int, tick: int, hits: int) -> None:
        """Record a new landmark with the descriptor (d,) that `robot` saw."""
        self._check_length(len(descriptor))
        i = self.count
        self.count += 1
        self.identity[i], self.subject[i], self.hits[i], self.missed[i], self.rejected[i] = self._next, subject, hits, 0, 0
        self.last_seen[i], self.last_robot[i] = tick, robot
        self.last_seen_by[i] = -1
        self.last_seen_by[i, robot] = tick
        self.viewer[i], self.viewed[i], self.view[i] = robot, tick, 0.0
        self._descriptor[i] = 0
        self._descriptor[i, robot] = descriptor
        self._next += 1

    def record_sightings(self, landmarks: Indices, descriptor: Floats, robot: int, tick: int) -> None:
        """Record sightings of landmarks (n,) with their present descriptors (n, d)."""
        if len(landmarks) == 0:
            return
        self._descriptor[landmarks, robot] = descriptor
        self.hits[landmarks] += 1
        self.missed[landmarks] = self.rejected[landmarks] = 0
        self.last_seen[landmarks], self.last_robot[landmarks] = tick, robot
        self.last_seen_by[landmarks, robot] = tick

    def to_prune(self, parameters: PruningParameters) -> Indices:
        """The landmarks to delete, ascending."""
        n = slice(0, self.count)
        lost = (self.hits[n] < parameters.min_sightings) & (self.missed[n] >= parameters.max_misses)
        return np.flatnonzero(lost | (self.rejected[n] >= parameters.max_rejections))

    def least_recently_seen(self) -> int:
        """The landmark that its last robot has not seen for the longest time, up to the last tick at which that robot was localized.

        Ties go to the landmark with the fewest sightings, then to the oldest. Landmarks of a blind or lost robot are kept: it is relocalized by them.
        """
        n = slice(0, self.count)
        unseen_for = self.last_localized[self.last_robot[n]] - self.last_seen[n]
        return int(np.lexsort((self.identity[n], self.hits[n], -unseen_for))[0])

    def remove(self, landmark: int) -> None:
        """Delete a landmark; the last one takes its row."""
        last = self.count - 1
        for column in (
            self.identity,
            self.subject,
            self.hits,
            self.missed,
            self.rejected,
            self.last_seen,
            self.last_robot,
            self.last_seen_by,
            self.viewer,
            self.viewed,
            self.view,
            self._descriptor,
        ):
            column[landmark] = column[last]
        self.count = last

    def _check_length(self, length: int) -> None:
        """Take the length of descriptors from the first one. Raises ValueError for another length later."""
        capacity, robots, known = self._descriptor.shape
        if known == 0 and self.count == 0:
            self._descriptor = np.zeros((capacity, robots, length), dtype=np.float32)
        elif known != length:
            raise ValueError(f"descriptor has length {length}, needs {known}, the length of the others")


def spread_over_azimuth(bearing_azimuth: Array, priority: Array, limit: int) -> Indices:
    """At most `limit` of n items, distributed over the horizon.

    They are ordered by their rank within the sector of azimuth (n,) rad, then by priority (n,), high first.
    """
    sector = np.floor((bearing_azimuth + np.pi) / (2 * np.pi) * SECTORS).astype(int) % SECTORS
    order = np.argsort(-priority, kind="stable")
    rank = np.zeros(len(order), dtype=int)
    for s in range(SECTORS):
        members = order[sector[order] == s]
        rank[members] = np.arange(len(members))
    return np.sort(np.lexsort((-priority, rank))[:limit])


@dataclass(frozen=True)
class DriftModel:
    """The parameters of the errors of features, as shares of their stated variance.

    white_share: the variance of the white noise of an update. rate: the variance of the drift, per axis and radian of change of the view.
    A change combines the angle at the landmark between two views and the logarithm of the ratio of their distances (view_change).
    repetition: factor of the drift between the viewer's view and that of another robot, which is noise of the other robot's bearings. It is more
    than 1 because this error is common to several sightings. patience: ticks without a sighting by the viewer, after which another robot becomes it.
    """

    white_share: float = 0.5
    rate: float = 4.0
    repetition: float = 4.0
    patience: int = 5

    def __post_init__(self) -> None:
        for name in ("white_share", "rate", "repetition", "patience"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, needs a finite number more than 0")

    def apply(self, joint: JointState, landmark_map: LandmarkMap, landmarks: Indices, camera: tuple[int, int, Array], covariance: Array) -> Array:
        """Let the landmarks (k,) drift since their viewer last saw them; returns the white noise (k, 2, 2) rad² of their bearings.

        camera: its robot, the tick and its origin (3,) m. covariance (k, 2, 2) rad²: the stated one of the bearings.
        """
        robot, tick, origin = camera
        view = origin - joint.point[landmarks]
        distance2 = (view * view).sum(axis=1)
        drift = self.rate * view_change(landmark_map.view[landmarks], view)
        is_viewer = (landmark_map.viewer[landmarks] == robot) | (tick - landmark_map.viewed[landmarks] > self.patience)
        joint.diffuse(landmarks, np.where(is_viewer, drift, 0.0) * distance2 * np.trace(covariance, axis1=1, axis2=2) / 2)
        seen = landmarks[is_viewer]
        landmark_map.view[seen], landmark_map.viewer[seen], landmark_map.viewed[seen] = view[is_viewer], robot, tick
        noise: Array = (self.white_share + np.where(is_viewer, 0.0, self.repetition * drift))[:, None, None] * covariance
        return noise


def view_change(before: Array, now: Array) -> Array:
    """(k,) rad: how much views differ, from cameras at before and now (k, 3) m relative to their landmarks; 0 where before is zero.

    It is the root of the squared angle plus the squared logarithm of the ratio of the distances.
    """
    a, b = np.linalg.norm(before, axis=1), np.linalg.norm(now, axis=1)
    known = (a > 0) & (b > 0)
    a, b = np.where(known, a, 1.0), np.where(known, b, 1.0)
    angle = np.arctan2(np.linalg.norm(np.cross(before, now), axis=1), (before * now).sum(axis=1))
    return np.where(known, np.hypot(angle, np.log(b / a)), 0.0)
