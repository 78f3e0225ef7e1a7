"""Ticks whose boxes are those that the person detector finds in their images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from tracker.person_detector.detector import CameraPlace, PersonDetector
from tracker.person_detector.search_levels import CameraHeight
from tracker.reading_ahead import ahead
from tracker.types import Detections, Odometry, Sequence, Setup, Tick, Ticks, View

AHEAD = 2
"""Ticks that are read and searched while the consumer works on an earlier one."""


@dataclass(frozen=True, eq=False)
class DetectedTicks:
    """Ticks with the boxes of the person detector in place of their own. Fixed cameras without an image have no view.

    setup: of the ticks. model: an ONNX file, None for the shipped one. The network is loaded when an iteration begins.
    threads: number of threads that search views, with more than 1 ahead of the consumer; the ticks do not depend on it.
    """

    ticks: Ticks
    setup: Setup
    model: Path | None = None
    threads: int = 1

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[Tick]:
        detector = PersonDetector(self.model)
        sites = sites_of(self.setup)
        if self.threads == 1:
            for tick in self.ticks:
                yield with_found_people(tick, detector, sites)
            return
        with ExitStack() as stack:
            # Ticks are read one after the other, so the reader is one thread. It ends first, because it submits views to the searchers.
            searchers = ThreadPoolExecutor(self.threads)
            stack.callback(searchers.shutdown, cancel_futures=True)
            for found in stack.enter_context(ahead((_searched(tick, detector, sites, searchers) for tick in self.ticks), AHEAD)):
                yield found()

    def odometry(self) -> Iterator[dict[str, Odometry]]:
        return self.ticks.odometry()


def with_found_people(tick: Tick, detector: PersonDetector, sites: Mapping[str, CameraPlace]) -> Tick:
    """The tick with the boxes that a detector finds in its images. sites: by camera. Fixed cameras without an image have no view."""
    return replace(tick, views=tuple(_with_found(view, detector, sites) for view in _used(tick)))


def _searched(tick: Tick, detector: PersonDetector, sites: Mapping[str, CameraPlace], pool: ThreadPoolExecutor) -> Callable[[], Tick]:
    """Search the views of a tick by the threads of a pool. Returns a function that waits for all of them and returns the tick."""
    views = [pool.submit(_with_found, view, detector, sites) for view in _used(tick)]
    return lambda: replace(tick, views=tuple(view.result() for view in views))


def _used(tick: Tick) -> list[View]:
    return [view for view in tick.views if view.image is not None or view.odometry is not None]


def _with_found(view: View, detector: PersonDetector, sites: Mapping[str, CameraPlace]) -> View:
    if view.image is None:
        return replace(view, detections=Detections.none())
    site = sites[view.camera]
    found = detector.detections(view.image, site)
    if site.mount is not None and site.mount.own_body is not None:
        # A box on the robot itself, for instance on its arm, is no person.
        found = found.select(~site.mount.sees_itself(found.bearing))
    return replace(view, detections=found)


def sites_of(setup: Setup) -> dict[str, CameraPlace]:
    """Camera → what is known of its place: pose and ground of fixed cameras, model and height above the ground of cameras on robots."""
    out = {}
    for name, mount in setup.mounts.items():
        start = setup.starts[mount.robot]
        if start is None:
            out[name] = CameraPlace(mount.camera, mount=mount)
            continue
        pose, fixed = start.T_world_robot @ mount.T_body_camera, setup.is_fixed(mount.robot)
        above = CameraHeight.of(pose, setup.ground, moves=not fixed)
        out[name] = CameraPlace(mount.camera, pose, setup.ground, above) if fixed else CameraPlace(mount.camera, above=above, mount=mount)
    return out


def detected_in_images(sequence: Sequence, model: Path | None = None, threads: int = 1) -> Sequence:
    """The sequence with the boxes of the person detector, which finds them while the ticks are read. threads: as of DetectedTicks."""
    return replace(sequence, ticks=DetectedTicks(sequence.ticks, sequence.setup, model, threads))
