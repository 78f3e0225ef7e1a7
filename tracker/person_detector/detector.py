"""People in an image: the network at several levels of scale, one box for each person, and a test of statures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.detections.boxes import detections_from_boxes, feet_seen
from tracker.geometry import Array, Image, Mask, Pose
from tracker.geometry.cameras import Camera, Panorama
from tracker.geometry.ground import Ground
from tracker.geometry.image_boxes import edges_of
from tracker.geometry.panoramas import PanoramicCamera
from tracker.person_detector.found_boxes import FoundBoxes, hidden_shares, one_for_each, peaks_of
from tracker.person_detector.magnification import SHARED, SLACK, magnified_parts
from tracker.person_detector.network import STRIDE, PersonNetwork
from tracker.person_detector.pixels import Level, level_of, level_of_part, rgb_image
from tracker.person_detector.search_levels import CameraHeight, SearchLevel, search_levels
from tracker.types import Detections, Mount

STATURE = (1.0, 2.3)
"""m: from a child, or a person who sits, to the tallest."""
REACH = 200.0
"""m: farther feet are at the horizon, where statures are undetermined."""
EDGE_SHARE, EDGE_PIXELS = 0.04, 1.5
"""Standard deviation of an edge where the network gives none: a share of the box's height, and px."""
WITHIN = 2.0
"""Standard deviations of error that the test of statures allows for each edge."""


@dataclass(frozen=True, eq=False)
class CameraPlace:
    """A camera's model, pose T_world_camera, ground, and height above the ground, each None where unknown.

    mount: of a camera on a robot.
    """

    camera: Camera | None = None
    pose: Pose | None = None
    ground: Ground | None = None
    above: CameraHeight | None = None
    mount: Mount | None = None

    @property
    def wraps(self) -> bool:
        """Whether the right edge of its images continues at the left one."""
        return self.camera is not None and self.camera.wraps


TRACKED = 0.2
"""Least probability of a box for tracking. Most boxes below it show static objects, which several cameras repeatedly take for a person."""


class PersonDetector:
    """The detector of people in pixels. The same picture gives the same boxes.

    model: an ONNX file, None for the shipped one. Raises ValueError as PersonNetwork.
    """

    def __init__(self, model: Path | None = None) -> None:
        self.network = PersonNetwork(model)

    def find(self, picture: NDArray[Any], site: CameraPlace | None = None, wraps: bool | None = None) -> FoundBoxes:
        """Boxes of whole people in a picture (as of pixels.rgb_image), the highest score first.

        Parts of a box outside the picture are cut off, but not those beyond the seam of an image that wraps.
        site: of the camera. With pose and ground, boxes of impossible statures are left out.
        wraps: whether the right edge continues at the left one; None for the camera's own value.
        Raises ValueError as rgb_image, and for a picture of another size than the camera's.
        """
        image, site = rgb_image(picture), site or CameraPlace()
        if site.camera is not None and image.shape[:2] != (site.camera.height, site.camera.width):
            raise ValueError(f"image is {image.shape[1]} x {image.shape[0]} px, its camera {site.camera.width} x {site.camera.height}")
        if wraps is None:
            wraps = site.wraps
        levels = search_levels(image.shape, _panorama(site.camera, image, wraps), site.above)
        peaks = self.peaks(image, levels, wraps, self.network.calibration.least_logit)
        found = replace(peaks, score=self.network.calibration.probabilities(peaks.score))
        # Boxes are cut off first, because two boxes of one person may differ only outside of the image.
        found = within(found.select(found.score >= self.network.calibration.min_score), image, wraps)
        found = one_for_each(found, self.network.calibration.nms_iou, image.shape[1] if wraps else None)
        if site.camera is None or site.pose is None or site.ground is None:
            return found
        return found.select(could_stand(found, site.camera, site.pose, site.ground))

    def detections(self, picture: NDArray[Any], site: CameraPlace) -> Detections:
        """`find` in the tracker's format: confidences are probabilities, covariances those of the network. site: with the camera.

        Boxes with probabilities below TRACKED are left out.
        """
        assert site.camera is not None
        found = self.find(picture, site)
        found = found.select(found.score >= TRACKED)
        deviation = None
        if found.sigma is not None:
            left, _, right, bottom = found.sigma.T
            deviation = np.column_stack([np.hypot(left, right) / 2, bottom])
        detections = detections_from_boxes(site.camera, found.box, found.score, deviation)
        return detections if found.hidden is None else replace(detections, feet_seen=feet_seen(found.box, found.visible))

    def peaks(self, image: Image, levels: list[SearchLevel], wraps: bool, least_logit: float) -> FoundBoxes:
        """Boxes in an image (H, W, 3) before suppression, with logits of at least `least_logit`.

        levels: of search_levels, the finest first; parts of the finest with peaks of small bodies are searched again at twice the size.
        wraps: as in `find`.
        """
        period = image.shape[1] if wraps else None
        finest = levels[0]
        rows = len(image)
        full = finest.in_band(self._at_level(level_of(image, 0, wraps, finest.rows), finest.heights, min(least_logit, finest.reason), period), rows)
        out = []
        for one in levels[1:]:
            out.append(one.in_band(self._at_level(level_of(image, one.halvings, wraps, one.rows), one.heights, least_logit, period), rows))
        small = full.select((full.height < finest.magnified) & (full.score >= finest.reason))
        for part in magnified_parts(small, image.shape, wraps):
            full = full.select(~((full.height < SHARED * finest.magnified) & part.holds(full)))
            level = level_of_part(part.cut_out(image), part.seen[:2])
            found = self._at_level(level, (0.0, finest.magnified), least_logit, None)
            out.append(found.select(part.holds(found, SLACK) & part.whole(found, rows)))
        return FoundBoxes.joined([full.select(full.score >= least_logit), *out])

    def _at_level(self, level: Level, heights: tuple[float, float], least_logit: float, period: float | None) -> FoundBoxes:
        """The peaks of a level with heights between two bounds, px of the picture. period: width of a picture that wraps, px."""
        found = peaks_of(self.network(level.pixels), level, least_logit)
        found = found.select((found.height >= heights[0]) & (found.height < heights[1]))
        if period is None:
            return found
        # Beyond the seam the image repeats the same people. At the seam, each copy may have its middle on the other side.
        slack, x = STRIDE * level.scale, found.middle[:, 0]
        turns = np.floor(x / period)[:, None] * np.array([period, 0.0, 0.0, 0.0])
        return replace(found, box=found.box - turns).select((x >= -slack) & (x < period + slack))


def _panorama(camera: Camera | None, image: Image, wraps: bool) -> PanoramicCamera | None:
    """The panoramic camera of an image. Where none is known, an image that wraps and is twice as wide as high is of the whole sphere."""
    if isinstance(camera, PanoramicCamera):
        return camera
    height, width = image.shape[:2]
    return Panorama(width, height) if camera is None and wraps and width == 2 * height else None


def within(found: FoundBoxes, image: NDArray[np.uint8], wraps: bool) -> FoundBoxes:
    """The boxes with what lies outside the image cut off; those of which nothing is left are left out."""
    height, width = image.shape[:2]
    low, high = (-np.inf if wraps else 0.0, 0.0) * 2, (np.inf if wraps else width, height) * 2
    corners, seen = (np.clip(edges_of(box), low, high) for box in (found.box, found.visible))
    hidden = None if found.hidden is None else hidden_shares(corners, seen)
    box: Array = np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)
    if wraps:
        box[:, 2] = np.minimum(box[:, 2], width)
        box[:, 0] %= width
    return replace(found, box=box, hidden=hidden).select(np.asarray((box[:, 2:] > 0).all(axis=1)))


def could_stand(found: FoundBoxes, camera: Camera, pose: Pose, ground: Ground) -> Mask:
    """Whether each box (n,) could be of a person of STATURE on the ground. pose: T_world_camera.

    The edges may be off by WITHIN standard deviations. A body may extend beyond a border that cuts its box.
    """
    left, top, width, height = found.box.T
    sigma = EDGE_SHARE * height + EDGE_PIXELS if found.sigma is None else found.sigma[:, 3]
    middle, bottom = left + width / 2, top + height
    margin = WITHIN * sigma
    tallest = _stature(camera, pose, ground, (middle, bottom + margin, top - margin))
    shortest = _stature(camera, pose, ground, (middle, bottom - margin, top + margin))
    # Stature is not monotone in the row of the feet, because lower feet are nearer. So the box itself and shifts of both edges are tried.
    others = [_stature(camera, pose, ground, (middle, bottom + a * margin, top + b * margin)) for a, b in ((0, 0), (1, 1), (-1, -1))]
    all_ = np.stack([tallest, shortest, *others])
    low, high = np.min(all_, axis=0), np.max(all_, axis=0)
    cut_below, cut_above = bottom >= camera.height - 1, top <= 1
    return np.asarray((cut_below | cut_above | (high >= STATURE[0])) & (cut_below | (low <= STATURE[1])))


def _stature(camera: Camera, pose: Pose, ground: Ground, box: tuple[Array, Array, Array]) -> Array:
    """Height (n,) m of upright bodies with feet and heads at pixels; ∞ where the feet are not on the ground. box: column, feet, heads (n,) px."""
    column, feet, heads = box
    foot, head = (camera.bearings_from_pixels(np.stack([column, rows], axis=1)) @ pose.rotation.T for rows in (feet, heads))
    origin = np.broadcast_to(pose.translation, foot.shape)
    point, there = ground.intersect(origin, foot, REACH)
    distance = np.hypot(*(point - origin)[:, :2].T)
    along = np.maximum(np.hypot(head[:, 0], head[:, 1]), 1e-9)
    height = origin[:, 2] - point[:, 2] + distance * head[:, 2] / along
    return np.asarray(np.where(there, height, np.inf))
