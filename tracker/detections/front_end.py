"""Front end: the views of a tick turned into ground detections, with what their images tell beside the boxes.

A fixed camera with images has a second detector, its silhouettes (silhouettes.py). Their boxes form a view of their own from the same place, so that
the tracker learns how good each detector is. The name of that view is the camera's name with SILHOUETTES after it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from tracker.detections.appearance import appearances
from tracker.detections.ground_points import FusionParameters, GroundDetections, project_to_ground
from tracker.detections.occlusion import Viewpoint
from tracker.detections.optical_flow import KltTracklets, TrackletParameters
from tracker.detections.silhouettes import SilhouetteParameters, Silhouettes
from tracker.geometry import Array, Mask, Pose
from tracker.types import Mount, Setup, Tick, View

SILHOUETTES = " silhouettes"
"""Suffix of the views of silhouettes."""

Placed = tuple[Pose, Array]
"""T_world_robot and the covariance (6, 6) of its right tangent."""


@dataclass(frozen=True)
class ImageParameters:
    """What is computed from images; None and False switch a part off."""

    tracklets: TrackletParameters | None = None  # corners tracked back through the last images (optical_flow.py)
    silhouettes: SilhouetteParameters | None = None  # people by background subtraction, of fixed cameras (silhouettes.py)
    appearance: bool = False  # colour histograms of people (appearance.py), where the detector gives no vectors


class FrontEnd:
    """The front end of all cameras of a setup. The attribute `setup` is the given one with the views of silhouettes added."""

    def __init__(self, setup: Setup, fusion: FusionParameters, images: ImageParameters, threads: ThreadPoolExecutor | None = None) -> None:
        """threads: work on the views of a tick side by side, each with a state of its own."""
        fixed = {name: mount for name, mount in setup.mounts.items() if images.silhouettes and setup.is_fixed(mount.robot)}
        self.setup = replace(setup, mounts=setup.mounts | {name + SILHOUETTES: mount for name, mount in fixed.items()})
        self.fusion, self.images = fusion, images
        self._map = map if threads is None else threads.map
        self._tracklets = {name: KltTracklets(mount.camera, images.tracklets) for name, mount in setup.mounts.items() if images.tracklets}
        self._silhouettes = {name: Silhouettes(mount.camera, _pose(setup, mount), setup, images.silhouettes) for name, mount in fixed.items()}

    def step(self, tick: Tick, placed: dict[str, Placed]) -> tuple[list[GroundDetections], list[Viewpoint]]:
        """Ground detections and viewpoint of each view whose robot has a pose.

        placed: robot → T_world_robot and covariance (6, 6) of its right tangent.
        """
        seen = [view for view in tick.views if self.setup.mounts[view.camera].robot in placed]
        found = self._map(lambda view: self._ground_detections(view, placed[self.setup.mounts[view.camera].robot]), seen)
        feet = [boxes for view in found for boxes in view]
        return feet, [self._viewpoint(f.camera, placed) for f in feet]

    def _ground_detections(self, view: View, placed: Placed) -> list[GroundDetections]:
        feet = project_to_ground(self.setup, view.camera, view.detections, placed, self.fusion)
        if self._tracklets:
            feet = replace(feet, links=self._tracklets[view.camera].step(view.image, view.detections))
        silhouettes = self._silhouettes.get(view.camera)
        if view.image is None or silhouettes is None:
            return [self._with_appearance(feet, view, None)]
        found = silhouettes.step(view.image, view.detections, feet)
        other = project_to_ground(self.setup, view.camera + SILHOUETTES, found, placed, self.fusion)
        return [self._with_appearance(f, v, silhouettes.foreground) for f, v in ((feet, view), (other, replace(view, detections=found)))]

    def _with_appearance(self, feet: GroundDetections, view: View, foreground: Mask | None) -> GroundDetections:
        given = view.detections.appearance
        if given.shape[1]:
            length = np.linalg.norm(given, axis=1, keepdims=True)
            # A vector of zeros says nothing.
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
