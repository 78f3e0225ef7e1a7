"""Features on the way to becoming landmarks: followed by how they look until two clones of a robot see them under enough parallax.

One bearing has no range. The choice here is delayed triangulation with exact correlations: a candidate is born at a tick whose pose is kept in the
joint state as a clone, is seen again at later clones and now, and is placed from all of these rays (bearings.place). All poses it comes from are in
the state, so the new landmark's covariance and cross covariances are those of the inverse model, with nothing left out.

Where the map grows: one camera's unmatched sightings, followed as candidates, placed when their rays cross well, judged, and added.

The clones of the camera's robot are in the joint state, so the new landmark's error is an exact linear function of errors that are in there.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tracker.ekf.gaussian import gate, mahalanobis2
from tracker.ekf.measurement_models import TriangulatedPoint, intersect, triangulate
from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices, angles_from_bearing, tangent_basis
from tracker.geometry.ground import Ground
from tracker.slam.landmark_map import LandmarkMap, dissimilarity, spread, unit_rows
from tracker.types import Mount, Sightings


@dataclass(frozen=True)
class InitializationParameters:
    """What a candidate must show. parallax: rad between two of its rays; sightings: how many ticks it was followed; strip: rad about the way that
    its direction can have gone since it was seen; unlike and ratio as in association.Gate; misses in a row that end it; probability: gate of the
    misfit of its rays; doubt: largest standard deviation of the range over the range; nearest, farthest: m; under: m below the known ground
    that are still believed; limit: how many a camera follows. Where bearings err much, parallax is at least `crossing` standard deviations of the
    difference of two, and strip `straying`.
    """

    parallax: float = 0.07
    sightings: int = 4
    strip: float = 0.012
    unlike: float = 0.6
    ratio: float = 0.8
    misses: int = 2
    probability: float = 0.99
    doubt: float = 0.15
    nearest: float = 0.5
    farthest: float = 40.0
    under: float = 0.3
    limit: int = 250
    crossing: float = 12.0
    straying: float = 2.0

    def fitted(self, covariance: Array) -> InitializationParameters:
        """The rule for sightings with covariances (n, 2, 2) rad²."""
        sigma = float(np.sqrt(np.median(np.trace(covariance, axis1=1, axis2=2)))) if len(covariance) else 0.0
        return replace(self, parallax=max(self.parallax, self.crossing * sigma), strip=max(self.strip, self.straying * sigma))


class FeatureTracks:
    """What one camera follows. Rows are candidates: direction (n, 3) in the world and origin (n, 3) m of the camera when last seen,
    descriptor (n, d), subject, hits, missed (n,); held (n, c): whether the candidate was seen from clone c;
    bearing (n, c, 3), covariance (n, c, 2, 2) of it there.
    """

    def __init__(self, clones: int) -> None:
        self.direction, self.origin = np.zeros((2, 0, 3))
        self.descriptor: Floats = np.zeros((0, 0), dtype=np.float32)
        self.subject, self.hits, self.missed = (np.zeros(0, dtype=np.intp) for _ in range(3))
        self.held = np.zeros((0, clones), dtype=bool)
        self.bearing = np.zeros((0, clones, 3))
        self.covariance = np.zeros((0, clones, 2, 2))

    def __len__(self) -> int:
        return len(self.direction)

    def follow(self, eye: Array, direction: Array, looks: tuple[Floats, Indices], rule: InitializationParameters) -> Indices:
        """Find the candidates among sightings from the camera at eye (3,) m in directions (m, 3) of the world with looks = descriptors (m, d) and
        subjects (m,): (n,) the sighting of each, or −1.
        """
        match = np.full(len(self), -1, dtype=np.intp)
        if len(self) == 0:
            return match
        descriptor, subject = looks
        if len(direction):
            near = self._off_the_way(eye, direction, rule.nearest) < rule.strip
            unlike = np.where(near, dissimilarity(self.descriptor[:, None], self.subject, descriptor, subject), np.inf)
            best = unlike.argmin(axis=1)
            rows = np.arange(len(self))
            value = unlike[rows, best]
            mutual = unlike.argmin(axis=0)[best] == rows
            unlike[rows, best] = np.inf
            good = (value < rule.unlike) & (value <= rule.ratio * unlike.min(axis=1)) & mutual
            match[good] = best[good]
        seen = match >= 0
        self.hits[seen] += 1
        self.missed = np.where(seen, 0, self.missed + 1)
        self.direction[seen], self.descriptor[seen], self.origin[seen] = direction[match[seen]], descriptor[match[seen]], eye
        return match

    def _off_the_way(self, eye: Array, direction: Array, nearest: float) -> Array:
        """How far (n, m) rad directions lie from where candidates may have gone: a thing that stands still at range r has moved by −t/r across its
        old direction when the camera has moved by t, so between 0 (far) and −t/nearest. Infinite more than 90° away.
        """
        basis = tangent_basis(self.direction)
        x, y = basis[:, 0] @ direction.T, basis[:, 1] @ direction.T
        way = (basis @ ((self.origin - eye) / nearest)[:, :, None])[:, :, 0]
        a, b = way[:, :1], way[:, 1:]
        along = (x * a + y * b) / np.maximum(a * a + b * b, 1e-12)
        np.clip(along, 0, 1, out=along)
        x -= along * a
        y -= along * b
        out: Array = np.where(self.direction @ direction.T > 0, np.sqrt(x * x + y * y), np.inf)
        return out

    def keep(self, alive: NDArray[np.bool_]) -> None:
        """Drop all others."""
        for name in ("direction", "origin", "descriptor", "subject", "hits", "missed", "held", "bearing", "covariance"):
            setattr(self, name, getattr(self, name)[alive])

    def hold(self, clone: int, rows: Indices, bearing: Array, covariance: Array) -> None:
        """The clone is new: forget what was seen from the one before, and note bearings (k, 3) of the candidates `rows` (k,) from it."""
        self.held[:, clone] = False
        self.held[rows, clone] = True
        self.bearing[rows, clone], self.covariance[rows, clone] = bearing, covariance

    def born(self, clone: int, eye: Array, seen: tuple[Array, Array, Array], looks: tuple[Floats, Indices]) -> None:
        """New candidates seen from `clone`, the camera at eye (3,) m: directions (k, 3) in the world, bearings (k, 3) in the camera and covariances
        (k, 2, 2); looks as in follow.
        """
        direction, bearing, covariance = seen
        descriptor, subject = looks
        k, clones = len(direction), self.held.shape[1]
        old = len(self)
        if old == 0:
            self.descriptor = np.zeros((0, descriptor.shape[1]), dtype=np.float32)
        self.direction = np.concatenate([self.direction, direction])
        self.origin = np.concatenate([self.origin, np.tile(eye, (k, 1))])
        self.descriptor = np.concatenate([self.descriptor, descriptor])
        self.subject = np.concatenate([self.subject, subject])
        self.hits = np.concatenate([self.hits, np.ones(k, dtype=np.intp)])
        self.missed = np.concatenate([self.missed, np.zeros(k, dtype=np.intp)])
        self.held = np.concatenate([self.held, np.zeros((k, clones), dtype=bool)])
        self.bearing = np.concatenate([self.bearing, np.zeros((k, clones, 3))])
        self.covariance = np.concatenate([self.covariance, np.zeros((k, clones, 2, 2))])
        rows = np.arange(old, old + k)
        self.held[rows, clone] = True
        self.bearing[rows, clone], self.covariance[rows, clone] = bearing, covariance

    def parallax(self, turns: Array) -> Array:
        """The largest angle between the present direction and those from the clones, (n,) rad; turns (c, 3, 3): R_world_camera at the clones."""
        rays = np.einsum("cij,ncj->nci", turns, self.bearing)
        cosine = np.where(self.held, np.einsum("nci,ni->nc", rays, self.direction), 1.0)
        out: Array = np.arccos(np.clip(cosine.min(axis=1, initial=1.0), -1, 1))
        return out


class LandmarkInitializer:
    """The candidates of one camera, on a robot of the joint state, and how they become landmarks. Refusals are counted by reason."""

    def __init__(self, robot: int, mount: Mount, state: tuple[JointState, LandmarkMap], ground: Ground, rule: InitializationParameters) -> None:
        self.robot, self.mount, self.ground, self.rule = robot, mount, ground, rule
        self.joint, self.book = state
        self.candidates = FeatureTracks(self.joint.clones)
        self.counters: Counter[str] = Counter()
        self._seen: Sightings | None = None
        self._match = np.zeros(0, dtype=np.intp)
        self._new = np.zeros(0, dtype=np.intp)

    def advance(self, seen: Sightings, free: Indices, room: int, tick: int) -> None:
        """Follow the candidates among the sightings `free` and make at most `room` landmarks of those that are ripe."""
        c, sight = self.candidates, self.joint.sight(self.robot, self.mount)
        direction, rule = seen.bearing[free] @ sight.rotation.T, self.rule.fitted(seen.covariance)
        match = c.follow(sight.origin, direction, (unit_rows(seen.descriptor[free]), seen.subject[free]), rule)
        earlier = self.joint.sight(self.robot, self.mount, self._clones())
        found = match >= 0
        wide = c.parallax(earlier.rotation) > rule.parallax
        self.counters["little parallax"] += int((found & ~wide).sum())
        done = np.zeros(len(c), dtype=bool)
        for row in np.flatnonzero(found & wide & (c.hits >= self.rule.sightings)):
            if room > 0:
                reason = self._grow(int(row), seen, int(free[match[row]]), tick)
                self.counters[reason] += 1
                room -= reason == "new"
                done[row] = reason != "little parallax"
        taken = np.zeros(len(free), dtype=bool)
        taken[match[found]] = True
        alive = ~done & (c.missed <= self.rule.misses)
        followed = np.full(len(match), -1)
        followed[found] = free[match[found]]
        self._seen, self._match, self._new = seen, followed[alive], free[~taken]
        c.keep(alive)

    def remember(self, clone: int) -> None:
        """The robot's present pose has just become its clone: note what the candidates look like from it, and begin new ones."""
        c, seen = self.candidates, self._seen
        if seen is None:
            c.held[:, clone] = False
            return
        rows = np.flatnonzero(self._match >= 0)
        at = self._match[rows]
        c.hold(clone, rows, seen.bearing[at], seen.covariance[at])
        azimuth, _ = angles_from_bearing(seen.bearing[self._new])
        new = self._new[spread(azimuth, np.zeros(len(azimuth)), max(0, self.rule.limit - len(c)))]
        sight = self.joint.sight(self.robot, self.mount)
        rays = (seen.bearing[new] @ sight.rotation.T, seen.bearing[new], seen.covariance[new])
        c.born(clone, sight.origin, rays, (unit_rows(seen.descriptor[new]), seen.subject[new]))
        self._seen = None

    def _clones(self) -> Indices:
        """The numbers of the robot's clones in the joint state."""
        return np.array([self.joint.clone_slot(self.robot, k) for k in range(self.joint.clones)])

    def _grow(self, row: int, seen: Sightings, sighting: int, tick: int) -> str:
        """Place one candidate and add it to the map: "new", or the reason why not."""
        c = self.candidates
        held = np.flatnonzero(c.held[row])
        bearing = np.concatenate([c.bearing[row, held], seen.bearing[sighting][None]])
        covariance = np.concatenate([c.covariance[row, held], seen.covariance[sighting][None]])
        poses = np.append(self._clones()[held], self.robot)
        sights = self.joint.sight(self.robot, self.mount, poses)
        start, ahead = intersect(sights.origin[None], (sights.rotation @ bearing[:, :, None])[None, :, :, 0])
        if not ahead[0]:
            return "behind"
        anchors = self.joint.sight(self.robot, self.mount, poses, anchored=True) if self.joint.first_estimates else None
        placed = triangulate(sights, bearing, covariance, start[0], anchors)
        columns, G = self._dependence(placed, poses)
        reason = self._verdict(placed, columns, sights.origin[-1])
        if not reason:
            self.joint.add(placed.point, columns, G, placed.own)
            self.book.add(int(c.subject[row]), c.descriptor[row], self.robot, tick, int(c.hits[row]))
        return reason or "new"

    def _dependence(self, placed: TriangulatedPoint, poses: Indices) -> tuple[Indices, Array]:
        """The state's columns that the rays came from (poses, then the correction) and the landmark's Jacobian (3, c) in them."""
        columns = [np.arange(6) + self.joint.offset(int(p)) for p in poses]
        G = placed.G_body.reshape(3, -1)
        if self.joint.corrected:
            columns.append(np.arange(6, 9) + self.joint.offset(self.robot))
            G = np.concatenate([G, placed.G_correction], axis=1)
        return np.concatenate(columns), G

    def _verdict(self, placed: TriangulatedPoint, columns: Indices, eye: Array) -> str:
        """Nothing where the new landmark is sound, else the reason against it."""
        distance = float(np.linalg.norm(placed.point - eye))
        if not self.rule.nearest < distance < self.rule.farthest:
            return "out of range"
        along = (placed.point - eye) / distance
        if along @ placed.own @ along > (self.rule.doubt * distance) ** 2:
            return "little parallax"
        if placed.point[2] < self.ground.height_at(placed.point[None])[0] - self.rule.under:
            return "below ground"
        H = placed.misfit_body.reshape(len(placed.misfit), -1)
        if self.joint.corrected:
            H = np.concatenate([H, placed.misfit_correction], axis=1)
        S = H @ self.joint.P[np.ix_(columns, columns)] @ H.T + np.eye(len(H))
        return "rays disagree" if mahalanobis2(placed.misfit, S) > gate(len(H), self.rule.probability) else ""
