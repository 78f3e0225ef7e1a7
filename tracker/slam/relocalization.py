"""Relocalization of robots: detection of lost ones, and their pose from the landmarks that they see.

A robot that was moved, or drove far without sightings, sees many features but matches no landmark where it expects them. Its panorama is then
matched with the whole map by descriptors alone, and with the archive of removed landmarks. Its pose comes from the consistent matches (resection.py).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tracker.ekf.measurement_models import CameraPose
from tracker.ekf.state import JointState
from tracker.geometry import Array, Floats, Indices, Pose, rotation_z
from tracker.slam.data_association import mutual_nearest
from tracker.slam.landmark_map import LandmarkMap, dissimilarity, unit_rows
from tracker.slam.resection import RelocalizationParameters, resect
from tracker.types import Mount, Sightings, Start

SlamState = tuple[JointState, LandmarkMap]


class Relocalizer:
    """Which robots may be lost, for how long, and the archive of landmarks that left the map."""

    def __init__(self, parameters: RelocalizationParameters) -> None:
        self.parameters, self.archive = parameters, LandmarkArchive(parameters.archive_size)
        self._typical_matches: dict[str, float] = {}
        self._lost: dict[str, float] = {}  # s

    def is_lost(self, robot: str) -> bool:
        """Whether the robot is lost; its sightings then do not enter the map."""
        return self._lost.get(robot, 0.0) > 0

    def may_be_lost(self, robot: str, seen: int, matched: int) -> bool:
        """Whether a robot with `seen` sightings matches so many fewer of them than usual that it may be lost."""
        return (
            seen >= self.parameters.min_inliers
            and matched < max(self.parameters.max_matches_lost + 1, self.parameters.match_share * self._typical_matches.get(robot, 0.0))
            and robot in self._typical_matches
        )

    def relocalize(self, team: SlamState, robot: int, mount: Mount, seen: Sightings, matched: int) -> tuple[str, int]:
        """Relocalize a robot, given by its number, that may be lost.

        Its pose is reset where more than 1.5 times as many landmarks agree with another pose as are matched. Returns the outcome, and how many
        landmarks agree with the pose, 0 where it is not found.
        """
        joint, _ = team
        pose = Pose(joint.rotation[robot], joint.translation[robot])
        found = relocalize(self.archive.with_map(team), (joint.camera_pose(robot, mount), pose), seen, self.parameters)
        if isinstance(found, str):
            return f"lost: {found}", 0
        if found.inliers <= 1.5 * matched:
            return "not lost", 0
        if found.is_close_to(pose, self.parameters):
            return "not lost", found.inliers
        joint.reset_pose(robot, found.start(self.parameters))
        return "found again", found.inliers

    def record_matches(self, robot: str, matched: int, seconds: float) -> None:
        """Record how many landmarks a robot matched at a tick with sightings, `seconds` after its last one.

        A robot with almost no matches is lost. If it is not found before the timeout, it starts a new part of the map. It cannot be lost again
        until it has matched landmarks.
        """
        if matched > self.parameters.max_matches_lost:
            self._typical_matches[robot] = matched if robot not in self._typical_matches else 0.8 * self._typical_matches[robot] + 0.2 * matched
            self._lost[robot] = 0.0
        elif robot in self._typical_matches:
            self._lost[robot] = self._lost.get(robot, 0.0) + seconds
            if self._lost[robot] - seconds / 2 > self.parameters.timeout:
                del self._typical_matches[robot], self._lost[robot]


@dataclass(frozen=True, eq=False)
class KnownLandmarks:
    """Landmarks that a robot can be relocalized by.

    descriptor (n, k, d): the last one of each robot, or zeros; subject (n,), as in LandmarkMap; point (n, 3) m; sigma (n,) m: standard
    deviations, the root mean square over the axes. The first `mapped` of them are in the map.
    """

    descriptor: Floats
    subject: Indices
    point: Array
    sigma: Array
    mapped: int


class LandmarkArchive:
    """Landmarks that were removed from a full map, as they were then; beyond `capacity` the oldest are deleted."""

    def __init__(self, capacity: int) -> None:
        self._kept: deque[tuple[Floats, int, Array, float]] = deque(maxlen=capacity)

    def keep(self, team: SlamState, landmark: int) -> None:
        """Archive a landmark that is about to leave the map."""
        joint, landmark_map = team
        sigma = float(_mean_sigma(joint, np.array([landmark]))[0])
        self._kept.append((landmark_map.descriptor[landmark].copy(), int(landmark_map.subject[landmark]), joint.point[landmark].copy(), sigma))

    def with_map(self, team: SlamState) -> KnownLandmarks:
        """The landmarks of the map, then those of the archive."""
        joint, landmark_map = team
        n = landmark_map.count
        sigma = _mean_sigma(joint, np.arange(n))
        if not self._kept:
            return KnownLandmarks(landmark_map.descriptor, landmark_map.subject[:n], joint.point[:n], sigma, n)
        descriptor, subject, point, sigmas = zip(*self._kept, strict=True)
        descriptors = np.concatenate([landmark_map.descriptor, np.stack(descriptor)])
        subjects = np.concatenate([landmark_map.subject[:n], np.array(subject)])
        return KnownLandmarks(descriptors, subjects, np.concatenate([joint.point[:n], np.stack(point)]), np.concatenate([sigma, np.array(sigmas)]), n)


@dataclass(frozen=True, eq=False)
class RelocalizedPose:
    """T_map_robot, the number of landmarks that agree with it, and how many of them are in the map."""

    pose: Pose
    inliers: int
    inliers_in_map: int

    def start(self, parameters: RelocalizationParameters) -> Start:
        """The pose with a covariance for the joint state.

        Inliers in the map will update it once more, so that its covariance is wide: otherwise they would count twice. If most are in the
        archive alone, the pose keeps their accuracy.
        """
        sigma = parameters.pose_sigma if self.inliers_in_map >= parameters.min_inliers else parameters.archive_pose_sigma
        return Start(self.pose, np.diag(np.repeat(sigma, 3) ** 2))

    def is_close_to(self, pose: Pose, parameters: RelocalizationParameters) -> bool:
        """Whether another pose is the same within three standard deviations."""
        apart = np.linalg.norm((pose.inverse() @ self.pose).log().reshape(2, 3), axis=1)
        return bool((apart < 3 * np.array(parameters.archive_pose_sigma)).all())


def relocalize(known: KnownLandmarks, own: tuple[CameraPose, Pose], seen: Sightings, parameters: RelocalizationParameters) -> RelocalizedPose | str:
    """The robot's pose among the landmarks by the sightings of one of its cameras, or the reason why it is not found.

    own: the camera and the robot in any frame whose vertical is that of the map.
    """
    camera, pose = own
    descriptor_distance = dissimilarity(known.descriptor, known.subject, unit_rows(seen.descriptor), seen.subject)
    if not descriptor_distance.size:
        return "too little alike"
    row, column = mutual_nearest(
        np.where(descriptor_distance < parameters.max_distance, descriptor_distance, np.inf), descriptor_distance, parameters.ratio
    )
    order = np.argsort(descriptor_distance[row, column], kind="stable")
    row, column = row[order], column[order]
    found = resect(seen.bearing[column] @ camera.rotation.T, known.point[row], known.sigma[row], parameters)
    if isinstance(found, str):
        return found
    turn = rotation_z(found.yaw)
    placed = Pose(turn @ pose.rotation, found.origin - turn @ (camera.origin - pose.translation))
    return RelocalizedPose(placed, len(found.inliers), int((row[found.inliers] < known.mapped).sum()))


def _mean_sigma(joint: JointState, landmarks: Indices) -> Array:
    """(k,) m: standard deviations of landmarks, the root mean square over the axes."""
    variance = np.diag(joint.P)[joint.base :].reshape(-1, 3)[landmarks]
    out: Array = np.sqrt(variance.mean(axis=1))
    return out
