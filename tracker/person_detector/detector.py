"""People in an image: the network at several levels of scale, one box for each person, and a test of statures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.detections.boxes import detections_from_boxes
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera, Panorama
from tracker.geometry.ground import Ground
from tracker.person_detector.found_boxes import FoundBoxes, one_for_each
from tracker.person_detector.network import STRIDE, Calibration, Maps, PersonNetwork
from tracker.person_detector.pixels import Level, level_of, rgb_image
from tracker.person_detector.statures import could_stand
from tracker.types import Detections

BODIES: tuple[tuple[float, float], ...] = ((0.0, 288.0), (96.0, np.inf))
"""px of the picture: heights of bodies that are taken from the whole picture, and from the picture at half its size."""
MOST = 1000
"""Candidates of a level, the surest."""
POLES = 8
"""The upper and lower 1/POLES of a panorama are searched at half size alone: there, bodies are large and bent."""
LONGEST_EDGE = 8.0
"""Logarithm of the longest distance to an edge, px."""


@dataclass(frozen=True, eq=False)
class CameraPlace:
    """Where a camera is: its model, its pose T_world_camera and the ground, each None where unknown."""

    camera: Camera | None = None
    pose: Pose | None = None
    ground: Ground | None = None


class PersonDetector:
    """The detector of people in pixels.

    model: an ONNX file, None for the shipped one. threads: of the network; with 1, the same picture gives the same boxes.
    Raises ValueError as PersonNetwork.
    """

    def __init__(self, model: Path | None = None, threads: int = 1) -> None:
        self.network = PersonNetwork(model, threads)

    def find(self, picture: NDArray[Any], site: CameraPlace | None = None, wraps: bool | None = None) -> FoundBoxes:
        """Boxes of whole people in a picture, as of pixels.rgb_image, the surest first.

        Parts of a box outside the picture are cut off, but not those beyond the seam of an image that wraps.
        site: of the camera; where pose and ground are known, too, boxes that no person could have are left out.
        wraps: whether the right edge continues at the left one, None for what the camera says. Raises ValueError as rgb_image.
        """
        image, site = rgb_image(picture), site or CameraPlace()
        if wraps is None:
            wraps = site.camera is not None and site.camera.wraps
        found = _joined([self._at_level(image, level, site.camera, wraps) for level in range(len(BODIES))])
        found = _within(one_for_each(found, self.network.calibration.nms_iou, image.shape[1] if wraps else None), image, wraps)
        if site.camera is None or site.pose is None or site.ground is None:
            return found
        return found.select(could_stand(found, site.camera, site.pose, site.ground))

    def detections(self, picture: NDArray[Any], site: CameraPlace) -> Detections:
        """As `find`, as the tracker takes them: confidences are probabilities, covariances those of the network. site: with the camera."""
        assert site.camera is not None
        found = self.find(picture, site)
        if found.sigma is None:
            return detections_from_boxes(site.camera, found.box, found.probability)
        left, _, right, bottom = found.sigma.T
        return detections_from_boxes(site.camera, found.box, found.probability, np.column_stack([np.hypot(left, right) / 2, bottom]))

    def _at_level(self, image: NDArray[np.uint8], halvings: int, camera: Camera | None, wraps: bool) -> FoundBoxes:
        rows = None
        if halvings == 0 and isinstance(camera, Panorama):
            step = max(1, len(image) // POLES)
            rows = step, len(image) - step
        level = level_of(image, halvings, wraps, rows)
        found = candidates(self.network(level.pixels), level, self.network.calibration)
        low, high = BODIES[halvings]
        middle = found.box[:, 0] + found.box[:, 2] / 2
        # Beyond the seam, the same people stand again. On it, each side may place the middle beyond the other.
        slack = STRIDE * level.scale
        here = (middle >= -slack) & (middle < image.shape[1] + slack) if wraps else np.isfinite(middle)
        return found.select(here & (found.box[:, 3] >= low) & (found.box[:, 3] < high))


def candidates(maps: Maps, level: Level, calibration: Calibration) -> FoundBoxes:
    """Boxes, px of the picture, at the local maxima of the scores of a level."""
    scores = maps["scores"][0]
    peaks = scores >= cv2.dilate(scores, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero(peaks & (scores >= calibration.least_logit) & np.isfinite(scores))
    logits = scores[rows, columns].astype(np.float64)
    first = np.lexsort((columns, rows, -logits))[:MOST]
    rows, columns, logits = rows[first], columns[first], logits[first]
    edges = np.exp(np.minimum(maps["edges"][:, rows, columns].astype(np.float64), LONGEST_EDGE)).T
    centre = (np.stack([columns, rows], axis=1) + 0.5) * STRIDE - level.origin
    left_top, right_bottom = centre - edges[:, :2], centre + edges[:, 2:]
    box = np.concatenate([left_top, right_bottom - left_top], axis=1) * level.scale
    sigma = None
    if "spread" in maps:
        # The standard deviation of a Laplace distribution is its scale times √2.
        sigma = np.sqrt(2) * np.exp(np.minimum(maps["spread"][:, rows, columns].astype(np.float64).T, 0.0)) * box[:, 3:]
    good = np.isfinite(box).all(axis=1) & (box[:, 2:] > 0).all(axis=1)
    found = FoundBoxes(box, calibration.probabilities(logits), sigma)
    return found.select(good & (found.probability >= calibration.min_score))


def _joined(parts: list[FoundBoxes]) -> FoundBoxes:
    sigmas = [part.sigma for part in parts if part.sigma is not None]
    sigma = np.concatenate(sigmas) if len(sigmas) == len(parts) else None
    return FoundBoxes(np.concatenate([part.box for part in parts]), np.concatenate([part.probability for part in parts]), sigma)


def _within(found: FoundBoxes, image: NDArray[np.uint8], wraps: bool) -> FoundBoxes:
    """The boxes with what lies outside the image cut off; those of which nothing is left are left out."""
    height, width = image.shape[:2]
    corners = np.concatenate([found.box[:, :2], found.box[:, :2] + found.box[:, 2:]], axis=1)
    corners[:, 1::2] = np.clip(corners[:, 1::2], 0, height)
    if not wraps:
        corners[:, ::2] = np.clip(corners[:, ::2], 0, width)
    box: Array = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    if wraps:
        box[:, 2] = np.minimum(box[:, 2], width)
        box[:, 0] %= width
    return FoundBoxes(box, found.probability, found.sigma).select(np.asarray((box[:, 2:] > 0).all(axis=1)))
