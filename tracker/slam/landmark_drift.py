"""Errors of image features that last: the point that a feature shows slides over the surface while the view of it changes.

The errors of the bearings of one feature are alike from frame to frame. They change with the direction and the distance of the view.
A filter that takes them for independent is overconfident. Here they are a random walk of the landmark, beside white noise.

Several robots may see one landmark at a time from different sides, and so different points of its surface. The landmark is the point that one
of them sees, its viewer. For the others the difference of the views is noise of their bearings. If the landmark took a step at each change of
the robot, it would be forgotten from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tracker.ekf.state import JointState
from tracker.geometry import Array, Indices
from tracker.slam.landmark_map import LandmarkMap


@dataclass(frozen=True)
class DriftModel:
    """The parameters of the errors of features, as shares of their stated variance.

    white_share: the variance of the white noise of an update. rate: the variance of the drift, an axis, for each radian of change of the view.
    A change is the angle at the landmark between two views, and the logarithm of the ratio of their distances.
    repetition: factor of the drift between the viewer's view and that of another robot, which is noise of the other robot's bearings. It is more
    than 1 because this error lasts over several sightings. patience: ticks without a sighting by the viewer, after which another robot becomes it.
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
