"""Delayed initialization of landmarks: feature tracks of one camera, their triangulation, and their entry into the map.

One bearing has no range. A feature is tracked by its descriptor until clones of the robot and its present pose see it with enough parallax.
Then it is triangulated from all of these bearings (measurement_models.triangulate). All poses involved are in the joint state. So the new
landmark's covariance and cross-covariances follow exactly, to first order, from the inverse model.
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
from tracker.slam.landmark_map import LandmarkMap, dissimilarity, spread_over_azimuth, unit_rows
from tracker.types import Mount, Sightings


@dataclass(frozen=True)
class InitializationParameters:
    """Conditions on a feature track to become a landmark.

    min_parallax: rad between two of its bearings. min_sightings: ticks at which it was seen. min_clones: clones that saw it, for features of images.
    epipolar_tolerance: rad from the segment of possible directions. max_distance and ratio: as in data_association.Gate. max_misses: in a row,
    until deletion. probability: gate of the misfit of the bearings. max_relative_sigma: standard deviation of the range over the range.
    min_range, max_range: m. max_below_ground: m. max_tracks: per camera. For noisy bearings parallax_sigmas and epipolar_sigmas are lower
    bounds of the parallax and of the tolerance. They are in standard deviations of the difference of two bearings.

    One clone and the present pose do not contradict a point that moves along its epipolar line. While robots start, such points have parallax
    before static ones have, and then become the first landmarks. So the bearings of two clones are needed.
    """

    min_parallax: float = 0.07
    min_sightings: int = 4
    min_clones: int = 2
    epipolar_tolerance: float = 0.012
    max_distance: float = 0.6
    ratio: float = 0.8
    max_misses: int = 2
    probability: float = 0.99
    max_relative_sigma: float = 0.15
    min_range: float = 0.5
    max_range: float = 40.0
    max_below_ground: float = 0.3
    max_tracks: int = 250
    parallax_sigmas: float = 12.0
    epipolar_sigmas: float = 2.0

    def scaled_to_noise(self, covariance: Array) -> InitializationParameters:
        """The parameters for sightings with covariances (n, 2, 2) rad²."""
        sigma = float(np.sqrt(np.median(np.trace(covariance, axis1=1, axis2=2)))) if len(covariance) else 0.0
        return replace(
            self,
            min_parallax=max(self.min_parallax, self.parallax_sigmas * sigma),
            epipolar_tolerance=max(self.epipolar_tolerance, self.epipolar_sigmas * sigma),
        )


class FeatureTracks:
    """The feature tracks of one camera, n in all, with c clones.

    direction (n, 3) in the world and origin (n, 3) m of the camera at the last sighting; descriptor (n, d); subject, hits, missed (n,).
    seen_from (n, c): whether clone c saw the feature; bearing (n, c, 3) and covariance (n, c, 2, 2) of it there.
    """

    def __init__(self, clones: int) -> None:
        self.direction, self.origin = np.zeros((2, 0, 3))
        self.descriptor: Floats = np.zeros((0, 0), dtype=np.float32)
        self.subject, self.hits, self.missed = (np.zeros(0, dtype=np.intp) for _ in range(3))
        self.seen_from = np.zeros((0, clones), dtype=bool)
        self.bearing = np.zeros((0, clones, 3))
        self.covariance = np.zeros((0, clones, 2, 2))

    def __len__(self) -> int:
        return len(self.direction)

    def track(self, camera_origin: Array, direction: Array, appearance: tuple[Floats, Indices], parameters: InitializationParameters) -> Indices:
        """Find the features among sightings of the camera at camera_origin (3,) m: (n,) the sighting of each, or −1.

        direction (m, 3): of the sightings, in the world. appearance: their descriptors (m, d) and subjects (m,).
        """
        match = np.full(len(self), -1, dtype=np.intp)
        if len(self) == 0:
            return match
        descriptor, subject = appearance
        if len(direction):
            near = self._epipolar_distance(camera_origin, direction, parameters.min_range) < parameters.epipolar_tolerance
            descriptor_distance = np.where(near, dissimilarity(self.descriptor[:, None], self.subject, descriptor, subject), np.inf)
            best = descriptor_distance.argmin(axis=1)
            rows = np.arange(len(self))
            value = descriptor_distance[rows, best]
            is_mutual = descriptor_distance.argmin(axis=0)[best] == rows
            descriptor_distance[rows, best] = np.inf
            good = (value < parameters.max_distance) & (value <= parameters.ratio * descriptor_distance.min(axis=1)) & is_mutual
            match[good] = best[good]
        seen = match >= 0
        self.hits[seen] += 1
        self.missed = np.where(seen, 0, self.missed + 1)
        self.direction[seen], self.descriptor[seen], self.origin[seen] = direction[match[seen]], descriptor[match[seen]], camera_origin
        return match

    def _epipolar_distance(self, camera_origin: Array, direction: Array, nearest: float) -> Array:
        """The angles (n, m) rad between directions and the epipolar segments of the features.

        A static point at range r moves by −t/r across its old direction when the camera moves by t. The segment extends from 0 (far) to
        −t/nearest. Infinite for directions more than 90° away.
        """
        basis = tangent_basis(self.direction)
        x, y = basis[:, 0] @ direction.T, basis[:, 1] @ direction.T
        epipole_step = (basis @ ((self.origin - camera_origin) / nearest)[:, :, None])[:, :, 0]
        a, b = epipole_step[:, :1], epipole_step[:, 1:]
        along = (x * a + y * b) / np.maximum(a * a + b * b, 1e-12)
        np.clip(along, 0, 1, out=along)
        x -= along * a
        y -= along * b
        out: Array = np.where(self.direction @ direction.T > 0, np.sqrt(x * x + y * y), np.inf)
        return out

    def keep(self, alive: NDArray[np.bool_]) -> None:
        """Delete all tracks but those of the mask `alive` (n,)."""
        for name in ("direction", "origin", "descriptor", "subject", "hits", "missed", "seen_from", "bearing", "covariance"):
            setattr(self, name, getattr(self, name)[alive])

    def record_clone(self, clone: int, rows: Indices, bearing: Array, covariance: Array) -> None:
        """Replace the bearings from a clone by those (k, 3) of the tracks `rows` (k,) from its new pose."""
        self.seen_from[:, clone] = False
        self.seen_from[rows, clone] = True
        self.bearing[rows, clone], self.covariance[rows, clone] = bearing, covariance

    def initiate(self, clone: int, camera_origin: Array, seen: tuple[Array, Array, Array], appearance: tuple[Floats, Indices]) -> None:
        """Start tracks of features seen from `clone`, with the camera at camera_origin (3,) m.

        seen: directions (k, 3) in the world, bearings (k, 3) in the camera and covariances (k, 2, 2); appearance as in `track`.
        """
        direction, bearing, covariance = seen
        descriptor, subject = appearance
        k, clones = len(direction), self.seen_from.shape[1]
        old = len(self)
        if old == 0:
            self.descriptor = np.zeros((0, descriptor.shape[1]), dtype=np.float32)
        self.direction = np.concatenate([self.direction, direction])
        self.origin = np.concatenate([self.origin, np.tile(camera_origin, (k, 1))])
        self.descriptor = np.concatenate([self.descriptor, descriptor])
        self.subject = np.concatenate([self.subject, subject])
        self.hits = np.concatenate([self.hits, np.ones(k, dtype=np.intp)])
        self.missed = np.concatenate([self.missed, np.zeros(k, dtype=np.intp)])
        self.seen_from = np.concatenate([self.seen_from, np.zeros((k, clones), dtype=bool)])
        self.bearing = np.concatenate([self.bearing, np.zeros((k, clones, 3))])
        self.covariance = np.concatenate([self.covariance, np.zeros((k, clones, 2, 2))])
        rows = np.arange(old, old + k)
        self.seen_from[rows, clone] = True
        self.bearing[rows, clone], self.covariance[rows, clone] = bearing, covariance

    def parallax(self, turns: Array) -> Array:
        """The largest angle between the present direction and those from the clones, (n,) rad; turns (c, 3, 3): R_world_camera at the clones."""
        rays = np.einsum("cij,ncj->nci", turns, self.bearing)
        cosine = np.where(self.seen_from, np.einsum("nci,ni->nc", rays, self.direction), 1.0)
        out: Array = np.arccos(np.clip(cosine.min(axis=1, initial=1.0), -1, 1))
        return out


class LandmarkInitializer:
    """Feature tracks of one camera on a robot of the joint state, and how they become landmarks. Rejections are counted by reason."""

    def __init__(self, robot: int, mount: Mount, state: tuple[JointState, LandmarkMap], ground: Ground, parameters: InitializationParameters) -> None:
        self.robot, self.mount, self.ground, self.parameters = robot, mount, ground, parameters
        self.joint, self.landmark_map = state
        self.tracks = FeatureTracks(self.joint.clones)
        self.counters: Counter[str] = Counter()
        self._seen: Sightings | None = None
        self._match = np.zeros(0, dtype=np.intp)
        self._new = np.zeros(0, dtype=np.intp)

    def advance(self, seen: Sightings, free: Indices, room: int, tick: int, clones: int = 1) -> None:
        """Track features among the sightings `free`, and add at most `room` landmarks to the map, each seen from at least `clones` clones."""
        tracks, camera = self.tracks, self.joint.camera_pose(self.robot, self.mount)
        direction, parameters = seen.bearing[free] @ camera.rotation.T, self.parameters.scaled_to_noise(seen.covariance)
        match = tracks.track(camera.origin, direction, (unit_rows(seen.descriptor[free]), seen.subject[free]), parameters)
        earlier = self.joint.camera_pose(self.robot, self.mount, self._clones())
        found = match >= 0
        wide = tracks.parallax(earlier.rotation) > parameters.min_parallax
        self.counters["little parallax"] += int((found & ~wide).sum())
        done = np.zeros(len(tracks), dtype=bool)
        often = tracks.seen_from.sum(axis=1) >= min(clones, self.joint.clones)
        for row in np.flatnonzero(found & wide & often & (tracks.hits >= self.parameters.min_sightings)):
            if room > 0:
                reason = self._add_landmark(int(row), seen, int(free[match[row]]), tick)
                self.counters[reason] += 1
                room -= reason == "new"
                done[row] = reason != "little parallax"
        taken = np.zeros(len(free), dtype=bool)
        taken[match[found]] = True
        alive = ~done & (tracks.missed <= self.parameters.max_misses)
        followed = np.full(len(match), -1)
        followed[found] = free[match[found]]
        self._seen, self._match, self._new = seen, followed[alive], free[~taken]
        tracks.keep(alive)

    def record_clone(self, clone: int) -> None:
        """Record the bearings from the robot's new clone, and start tracks of unmatched sightings."""
        tracks, seen = self.tracks, self._seen
        if seen is None:
            tracks.seen_from[:, clone] = False
            return
        rows = np.flatnonzero(self._match >= 0)
        at = self._match[rows]
        tracks.record_clone(clone, rows, seen.bearing[at], seen.covariance[at])
        azimuth, _ = angles_from_bearing(seen.bearing[self._new])
        new = self._new[spread_over_azimuth(azimuth, np.zeros(len(azimuth)), max(0, self.parameters.max_tracks - len(tracks)))]
        camera = self.joint.camera_pose(self.robot, self.mount)
        rays = (seen.bearing[new] @ camera.rotation.T, seen.bearing[new], seen.covariance[new])
        tracks.initiate(clone, camera.origin, rays, (unit_rows(seen.descriptor[new]), seen.subject[new]))
        self._seen = None

    def _clones(self) -> Indices:
        """The numbers of the robot's clones in the joint state."""
        return np.array([self.joint.clone_slot(self.robot, k) for k in range(self.joint.clones)])

    def _add_landmark(self, row: int, seen: Sightings, sighting: int, tick: int) -> str:
        """Triangulate one track and add it to the map: "new", or the reason of its rejection."""
        tracks = self.tracks
        seen_from = np.flatnonzero(tracks.seen_from[row])
        bearing = np.concatenate([tracks.bearing[row, seen_from], seen.bearing[sighting][None]])
        covariance = np.concatenate([tracks.covariance[row, seen_from], seen.covariance[sighting][None]])
        poses = np.append(self._clones()[seen_from], self.robot)
        cameras = self.joint.camera_pose(self.robot, self.mount, poses)
        start, ahead = intersect(cameras.origin[None], (cameras.rotation @ bearing[:, :, None])[None, :, :, 0])
        if not ahead[0]:
            return "behind"
        linearization_points = self.joint.camera_pose(self.robot, self.mount, poses, for_jacobians=True) if self.joint.first_estimates else None
        triangulated = triangulate(cameras, bearing, covariance, start[0], linearization_points)
        columns, G = self._state_jacobian(triangulated, poses)
        reason = self._rejection_reason(triangulated, columns, cameras.origin[-1])
        if not reason:
            self.joint.add_landmark(triangulated.point, columns, G, triangulated.noise_covariance)
            self.landmark_map.add(int(tracks.subject[row]), tracks.descriptor[row], self.robot, tick, int(tracks.hits[row]))
            self.landmark_map.view[self.landmark_map.count - 1] = cameras.origin[-1] - triangulated.point
        return reason or "new"

    def _state_jacobian(self, triangulated: TriangulatedPoint, poses: Indices) -> tuple[Indices, Array]:
        """The columns of the state that the bearings depend on (poses, then the correction), and the landmark's Jacobian (3, c) in them."""
        columns = [np.arange(6) + self.joint.offset(int(p)) for p in poses]
        G = triangulated.G_body.reshape(3, -1)
        if self.joint.has_correction:
            columns.append(np.arange(6, 9) + self.joint.offset(self.robot))
            G = np.concatenate([G, triangulated.G_correction], axis=1)
        return np.concatenate(columns), G

    def _rejection_reason(self, triangulated: TriangulatedPoint, columns: Indices, camera_origin: Array) -> str:
        """The reason to reject the triangulated landmark, or an empty text."""
        distance = float(np.linalg.norm(triangulated.point - camera_origin))
        if not self.parameters.min_range < distance < self.parameters.max_range:
            return "out of range"
        along = (triangulated.point - camera_origin) / distance
        if along @ triangulated.noise_covariance @ along > (self.parameters.max_relative_sigma * distance) ** 2:
            return "little parallax"
        if triangulated.point[2] < self.ground.height_at(triangulated.point[None])[0] - self.parameters.max_below_ground:
            return "below ground"
        H = triangulated.misfit_body.reshape(len(triangulated.misfit), -1)
        if self.joint.has_correction:
            H = np.concatenate([H, triangulated.misfit_correction], axis=1)
        S = H @ self.joint.P[np.ix_(columns, columns)] @ H.T + np.eye(len(H))
        return "rays disagree" if mahalanobis2(triangulated.misfit, S) > gate(len(H), self.parameters.probability) else ""
