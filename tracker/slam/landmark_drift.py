"""Errors of image features that last: the point that a feature shows slides over the surface while the view of it changes.

The errors of the bearings of one feature are alike from frame to frame. They change with the direction and the distance of the view.
A filter that takes them for independent is overconfident. Here they are a random walk of the landmark, beside white noise.
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
    """

    white_share: float = 0.5
    rate: float = 4.0

    def __post_init__(self) -> None:
        for name in ("white_share", "rate"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, needs a finite number more than 0")

    def apply(self, joint: JointState, landmark_map: LandmarkMap, landmarks: Indices, origin: Array, covariance: Array) -> Array:
        """Let the landmarks (k,) drift since they were last seen, from a camera at origin (3,) m; returns the white part (k, 2, 2) of their noise.

        covariance (k, 2, 2) rad²: the stated one of their bearings.
        """
        view = origin - joint.point[landmarks]
        distance2 = (view * view).sum(axis=1)
        change = view_change(landmark_map.view[landmarks], view)
        joint.diffuse(landmarks, self.rate * change * distance2 * np.trace(covariance, axis1=1, axis2=2) / 2)
        landmark_map.view[landmarks] = view
        return self.white_share * covariance


def view_change(before: Array, now: Array) -> Array:
    """(k,) rad: how much views differ, from cameras at before and now (k, 3) m relative to their landmarks; 0 where before is zero.

    It is the root of the squared angle plus the squared logarithm of the ratio of the distances.
    """
    a, b = np.linalg.norm(before, axis=1), np.linalg.norm(now, axis=1)
    known = (a > 0) & (b > 0)
    a, b = np.where(known, a, 1.0), np.where(known, b, 1.0)
    angle = np.arctan2(np.linalg.norm(np.cross(before, now), axis=1), (before * now).sum(axis=1))
    return np.where(known, np.hypot(angle, np.log(b / a)), 0.0)
