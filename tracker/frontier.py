"""Where the map grows: one camera's unmatched sightings, followed as candidates, placed when their rays cross well, judged, and added.

The clones of the camera's robot are in the joint state, so the new landmark's error is an exact linear function of errors that are in there.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from tracker.bearings import Placed, intersect, place
from tracker.candidates import Candidates, Trial
from tracker.gaussian import gate, mahalanobis2
from tracker.geometry import Array, angles_from_bearing
from tracker.ground import Ground
from tracker.joint import Indices, Joint
from tracker.landmarks import Landmarks, spread, unit_rows
from tracker.measurements import Mount, Sightings


class Frontier:
    """The candidates of one camera, on a robot of the joint state, and how they become landmarks. Refusals are counted by reason."""

    def __init__(self, robot: int, mount: Mount, state: tuple[Joint, Landmarks], ground: Ground, rule: Trial) -> None:
        self.robot, self.mount, self.ground, self.rule = robot, mount, ground, rule
        self.joint, self.book = state
        self.candidates = Candidates(self.joint.clones)
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
        placed = place(sights, bearing, covariance, start[0], anchors)
        columns, G = self._dependence(placed, poses)
        reason = self._verdict(placed, columns, sights.origin[-1])
        if not reason:
            self.joint.add(placed.point, columns, G, placed.own)
            self.book.add(int(c.subject[row]), c.descriptor[row], self.robot, tick, int(c.hits[row]))
        return reason or "new"

    def _dependence(self, placed: Placed, poses: Indices) -> tuple[Indices, Array]:
        """The state's columns that the rays came from (poses, then the correction) and the landmark's Jacobian (3, c) in them."""
        columns = [np.arange(6) + self.joint.offset(int(p)) for p in poses]
        G = placed.G_body.reshape(3, -1)
        if self.joint.corrected:
            columns.append(np.arange(6, 9) + self.joint.offset(self.robot))
            G = np.concatenate([G, placed.G_correction], axis=1)
        return np.concatenate(columns), G

    def _verdict(self, placed: Placed, columns: Indices, eye: Array) -> str:
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
