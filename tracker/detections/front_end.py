"""Front end: it converts the views of a tick to ground detections, with the evidence of their images.

A fixed camera with images has a second detector, its silhouettes (silhouettes.py). Their boxes form a view of their own from the same place, so that
the tracker learns how good each detector is. The name of that view is the camera's name with SILHOUETTES after it.

The appearance of a person is a colour histogram of the upper and one of the lower body. Yoo et al. 2017 (C_app) use three histograms of 16 bins for
the whole body. Here each half has its own, of hue, saturation and brightness.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tracker.detections.boxes import approximate_pixel_boxes
from tracker.detections.ground_points import FusionParameters, GroundDetections, project_to_ground
from tracker.detections.occlusion import Viewpoint
from tracker.detections.optical_flow import KltTracklets, TrackletParameters
from tracker.detections.silhouettes import Silhouettes
from tracker.geometry import Array, Image, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.types import Detections, Intervals, Mount, Setup, Tick, View

SILHOUETTES = " silhouettes"
"""Suffix of the views of silhouettes."""

Placed = tuple[Pose, Array]
"""T_world_robot and the covariance (6, 6) of its right tangent."""
BINS = 16
PARTS = ((0.15, 0.5), (0.5, 0.9))
"""Shares of a box's height between which the upper and the lower body lie, from its upper edge."""
SIZE = BINS * 3 * len(PARTS)
"""Length of an appearance vector."""
COLUMN_SIGMA = 0.2
"""Standard deviation, as a share of a box's width, of the weight of a pixel by its distance from the box's middle."""
MIN_VISIBLE = 0.2
"""Least weight of the visible pixels of a part, as a share of the weight of the whole part."""
MIN_PIXELS = 4, 8
"""px, least width and height of a box that has an appearance."""


@dataclass(frozen=True)
class ImageParameters:
    """What is computed from images; None and False switch a part off."""

    tracklets: TrackletParameters | None = None  # corners tracked back through the last images (optical_flow.py)
    silhouettes: bool = False  # people by background subtraction, of fixed cameras (silhouettes.py)
    appearance: bool = False  # colour histograms of people, where the detector gives no vectors


class FrontEnd:
    """The front end of all cameras of a setup. The attribute `setup` is the given one with the views of silhouettes added."""

    def __init__(self, setup: Setup, fusion: FusionParameters, images: ImageParameters, threads: ThreadPoolExecutor | None = None) -> None:
        """threads: they process the views of a tick in parallel; each view has its own state."""
        fixed = {name: mount for name, mount in setup.mounts.items() if images.silhouettes and setup.is_fixed(mount.robot)}
        self.setup = replace(setup, mounts=setup.mounts | {name + SILHOUETTES: mount for name, mount in fixed.items()})
        self.fusion, self.images = fusion, images
        self._map = map if threads is None else threads.map
        self._tracklets = {name: KltTracklets(mount.camera, images.tracklets) for name, mount in setup.mounts.items() if images.tracklets}
        self._silhouettes = {name: Silhouettes(mount.camera, _pose(setup, mount), setup) for name, mount in fixed.items()}
        self._intervals = {name: Intervals(setup.period) for name in fixed}

    def step(self, tick: Tick, placed: dict[str, Placed]) -> tuple[list[GroundDetections], list[Viewpoint]]:
        """Ground detections and viewpoint of each view whose robot has a pose.

        placed: robot → T_world_robot and covariance (6, 6) of its right tangent.
        """
        seen = [view for view in tick.views if self.setup.mounts[view.camera].robot in placed]
        found = self._map(lambda view: self._ground_detections(view, placed[self.setup.mounts[view.camera].robot], tick.time + view.later), seen)
        feet = [replace(boxes, later=view.later) for view, of_view in zip(seen, found, strict=True) for boxes in of_view]
        return feet, [self._viewpoint(f.camera, placed) for f in feet]

    def _ground_detections(self, view: View, placed: Placed, time: float) -> list[GroundDetections]:
        feet = project_to_ground(self.setup, view.camera, view.detections, placed, self.fusion)
        if self._tracklets:
            feet = replace(feet, links=self._tracklets[view.camera].step(view.image, view.detections))
        silhouettes = self._silhouettes.get(view.camera)
        if view.image is None or silhouettes is None:
            return [self._with_appearance(feet, view, None)]
        found = silhouettes.step(view.image, view.detections, feet, self._intervals[view.camera].step(time))
        other = project_to_ground(self.setup, view.camera + SILHOUETTES, found, placed, self.fusion)
        return [self._with_appearance(f, v, silhouettes.foreground) for f, v in ((feet, view), (other, replace(view, detections=found)))]

    def _with_appearance(self, feet: GroundDetections, view: View, foreground: Mask | None) -> GroundDetections:
        given = view.detections.appearance
        if given.shape[1]:
            length = np.linalg.norm(given, axis=1, keepdims=True)
            # A vector of zeros is an unknown appearance.
            return replace(feet, appearance=np.where(length > 0, given / np.where(length > 0, length, 1.0), np.nan), appearance_given=True)
        if not self.images.appearance or view.image is None:
            return feet
        return replace(feet, appearance=appearances(view.image, self.setup.mounts[view.camera].camera, view.detections, foreground))

    def _viewpoint(self, camera: str, placed: dict[str, Placed]) -> Viewpoint:
        mount = self.setup.mounts[camera]
        return Viewpoint(camera, mount.camera, placed[mount.robot][0] @ mount.T_body_camera)


def _pose(setup: Setup, mount: Mount) -> Pose:
    start = setup.starts[mount.robot]
    assert start is not None
    return start.T_world_robot @ mount.T_body_camera


def appearances(image: Image, camera: Camera, detections: Detections, foreground: Mask | None = None) -> Array:
    """Appearance vectors (n, SIZE) of boxes, of length 1; NaN where too little of a person is visible.

    They are square roots of histograms, so that the product of two is the Bhattacharyya coefficient: 1 for equal histograms.
    foreground (h, w) of any size: pixels that show people, None where that is unknown. Pixels under a nearer box, which ends lower, are left out.
    """
    height, width = image.shape[:2]
    middle, size = approximate_pixel_boxes(camera, detections)
    scale = np.array([width / camera.width, height / camera.height])
    middle, size = (middle + 0.5 - camera.pixel_centre) * scale, size * scale
    boxes = np.column_stack([middle - size / 2, middle + size / 2])
    colours = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2HSV), dtype=np.uint8) // (256 // BINS)
    people: Image = np.ones((height, width), dtype=np.uint8)
    if foreground is not None:
        people = np.asarray(cv2.resize(foreground.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    return np.array([_appearance(colours, people, boxes, k, camera.wraps) for k in range(len(boxes))]).reshape(-1, SIZE)


def _appearance(colours: Image, people: Image, boxes: Array, k: int, wraps: bool) -> Array:
    """Appearance vector (SIZE,) of the box in row k of `boxes` (n, 4): left, top, right, bottom px.

    wraps: the image is a panorama, where columns beyond an edge are those of the other side. Otherwise they do not count.
    """
    unknown = np.full(SIZE, np.nan)
    if not np.isfinite(boxes[k]).all():
        return unknown
    left, top, right, bottom = boxes[k]
    columns = np.arange(round(left), round(right))
    rows = np.arange(max(round(top), 0), min(round(bottom), len(colours)))
    if len(columns) < MIN_PIXELS[0] or len(rows) < MIN_PIXELS[1]:
        return unknown
    across = np.exp(-0.5 * ((columns + 0.5 - (left + right) / 2) / (COLUMN_SIGMA * (right - left))) ** 2)
    patch = np.ix_(rows, columns % colours.shape[1])
    weight = people[patch] * np.where(wraps | ((columns >= 0) & (columns < colours.shape[1])), across, 0.0)
    for other in boxes[boxes[:, 3] > bottom + 1]:
        occluded = (rows[:, None] >= other[1]) & (rows[:, None] < other[3]) & (columns >= other[0]) & (columns < other[2])
        weight = np.where(occluded, 0.0, weight)
    histograms, level = [], colours[patch]
    for low, high in PARTS:
        part = (rows + 0.5 > top + low * (bottom - top)) & (rows + 0.5 < top + high * (bottom - top))
        counted = weight[part]
        if not counted.size or counted.sum() < MIN_VISIBLE * across.sum() * (high - low) * (bottom - top):
            return unknown
        for channel in range(3):
            histogram = np.bincount(level[part][..., channel].ravel(), weights=counted.ravel(), minlength=BINS)
            histograms.append(np.convolve(histogram, [0.25, 0.5, 0.25], mode="same") / counted.sum())
    vector = np.sqrt(np.concatenate(histograms))
    return vector / np.linalg.norm(vector)
