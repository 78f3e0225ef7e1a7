"""Ticks whose boxes are those that the person detector finds in their images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tracker.person_detector.detector import CameraPlace, PersonDetector
from tracker.types import Detections, Odometry, Sequence, Setup, Tick, Ticks, View


@dataclass(frozen=True, eq=False)
class DetectedTicks:
    """Ticks with the boxes of the person detector in place of their own. Fixed cameras without an image have no view.

    setup: of the ticks. model: an ONNX file, None for the shipped one. The network is loaded when an iteration begins.
    """

    ticks: Ticks
    setup: Setup
    model: Path | None = None

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        detector = PersonDetector(self.model)
        sites = sites_of(self.setup)
        for tick in self.ticks:
            yield with_found_people(tick, detector, sites)

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        return self.ticks.odometry()


def with_found_people(tick: Tick, detector: PersonDetector, sites: Mapping[str, CameraPlace]) -> Tick:
    """The tick with the boxes that a detector finds in its images. sites: by camera. Fixed cameras without an image have no view."""

    def found(view: View) -> View:
        return replace(view, detections=Detections.none() if view.image is None else detector.detections(view.image, sites[view.camera]))

    return replace(tick, views=tuple(found(view) for view in tick.views if view.image is not None or view.odometry is not None))


def sites_of(setup: Setup) -> dict[str, CameraPlace]:
    """Camera → what is known of its place: pose and ground of fixed cameras, the model alone of cameras on robots."""
    out = {}
    for name, mount in setup.mounts.items():
        start = setup.starts[mount.robot]
        out[name] = CameraPlace(mount.camera)
        if start is not None and setup.is_fixed(mount.robot):
            out[name] = CameraPlace(mount.camera, start.T_world_robot @ mount.T_body_camera, setup.ground)
    return out


def detected_in_images(sequence: Sequence, model: Path | None = None) -> Sequence:
    """The sequence with the boxes of the person detector, which finds them while the ticks are read."""
    return replace(sequence, ticks=DetectedTicks(sequence.ticks, sequence.setup, model))
