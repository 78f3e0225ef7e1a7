"""The twin of a PETS 2009 sequence: annotated people walk their recorded paths through the world `campus`, seen by the real cameras and by rovers.

Paths are the annotated feet, projected from View_001 to z = 0. Statures are the heights of the upper edges of the boxes above these feet.
The twin has the same people at the same positions and times as the recording, and exact truth.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.crowd.replay import Paths
from sim.datasets.presets import within
from sim.pedestrian.skeleton import ADULTS
from sim.recording.record import SimulatedSequence
from sim.recording.tracker_setup import FixedCamera
from sim.scenario import INDEPENDENT, Scenario
from sim.simulation.simulation import Simulation
from tracker.formats.pets2009 import PETS_RATE, Annotations, ground_truth, read_annotations
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Flat
from tracker.geometry.image_boxes import box_overlaps as overlaps
from tracker.io.resume import checksum
from tracker.io.tsai_xml import read_camera
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes
from worlds import catalogue
from worlds.world import World

WORLD = "campus"
ANNOTATED = 1
"""The view in whose image the annotations were made."""
STATURES = ADULTS
"""Bounds of statures, m. Values beyond them are errors of a box."""
ROVER_MARGIN = 4.0
"""Margin around the area of the paths within which rovers stay, m."""
LARGEST_ID = (1 << 16) - 1


@dataclass(frozen=True)
class Twin:
    """The description of a twin.

    annotations: a CVML file. calibration: the folder of View_00N.xml. views: numbers of the cameras in the twin.
    frames: number of annotated frames, or None for all. robots: number of rovers, with panoramas of `width` px. seed: of all random streams.
    """

    annotations: Path
    calibration: Path
    views: tuple[int, ...] = (1,)
    frames: int | None = None
    robots: int = 2
    width: int = 1024
    seed: int = 0
    detector_model: str = INDEPENDENT


@dataclass(frozen=True, eq=False)
class AnnotatedWalkers:
    """The people of an annotation: id (m,); position (m, frames, 2) m, NaN where a person is absent; stature (m,) m."""

    id: Ints
    position: Array
    stature: Array


def annotations_of(folder: Path) -> Path:
    """The annotation file of a PETS 2009 folder. Raises ValueError where there is none.

    The complete annotations, whose people also walk outside the evaluated area, are preferred.
    """
    files = sorted((folder / "annotations").glob("*.xml"))
    whole = [file for file in files if "cropped" not in file.name] or files
    if not whole:
        raise ValueError(f"{folder / 'annotations'}: no *.xml, the truth which a twin needs")
    return whole[0]


def recording_of(twin: Twin, world: World | None = None) -> SimulatedSequence:
    """The twin at its first frame. The cameras are robots that never move. world: replaces `campus` at difficulty 0.

    Raises ValueError, in one line, for missing or invalid files, for an unknown view, and for paths outside the free space of the world.
    """
    fixed = {f"View_{number:03d}": _fixed(twin.calibration, number) for number in twin.views}
    annotated = _fixed(twin.calibration, ANNOTATED)
    annotations = annotated_frames(twin)
    walkers = walkers_of(annotations, annotated.camera, annotated.T_world_camera)
    scenario = Scenario(
        world=WORLD,
        difficulty=0.0,
        seed=twin.seed,
        robots=twin.robots,
        people=len(walkers.id),
        frames=walkers.position.shape[1],
        rate=PETS_RATE,
        width=twin.width,
        detector_model=twin.detector_model,
    )
    site = catalogue.build(WORLD, scenario.stream("world"), 0.0) if world is None else world
    paths = Paths(walkers.id, scenario.period * np.arange(scenario.frames, dtype=np.float64), walkers.position, walkers.stature)
    simulation = Simulation(scenario, world=confine_rovers(site, walkers.position), paths=paths)
    return SimulatedSequence(scenario, simulation, fixed, _provenance(twin, scenario))


def _fixed(calibration: Path, number: int) -> FixedCamera:
    path = calibration / f"View_{number:03d}.xml"
    if not path.is_file():
        there = ", ".join(p.name for p in sorted(calibration.glob("View_*.xml"))) or "none"
        raise ValueError(f"{path}: no such file; there are {there}")
    _, camera, pose = read_camera(path)
    return FixedCamera(camera, pose)


def annotated_frames(twin: Twin) -> Annotations:
    """The annotated frames that are selected; frame numbers that the file leaves out are empty."""
    if not twin.annotations.is_file():
        raise ValueError(f"{twin.annotations}: no such file")
    annotations = read_annotations(twin.annotations)
    count = max(annotations, default=-1) + 1
    if twin.frames is not None and not 1 <= twin.frames <= count:
        raise ValueError(f"frames is {twin.frames}, needs 1 to {count}, the frames of {twin.annotations}")
    nobody = np.zeros(0, dtype=np.int64), np.zeros((0, 4))
    selected = {k: annotations.get(k, nobody) for k in range(twin.frames or count)}
    if not any(len(ids) for ids, _ in selected.values()):
        raise ValueError(f"{twin.annotations}: nobody is annotated in {len(selected)} frames, needs at least one person")
    return selected


def walkers_of(annotations: Annotations, camera: Camera, T_world_camera: Pose) -> AnnotatedWalkers:
    """Paths and statures of the annotated people, in frames from 0. Raises ValueError for an id that is no valid instance number."""
    places = ground_truth(annotations, camera, T_world_camera, Flat())
    ids = np.unique(np.concatenate([ids for ids, _ in annotations.values()]))
    if ids[0] < 1 or ids[-1] > LARGEST_ID:
        raise ValueError(f"object id is {ids[0] if ids[0] < 1 else ids[-1]}, needs 1 to {LARGEST_ID}")
    position = np.full((len(ids), max(annotations) + 1, 2), np.nan)
    height = np.full(position.shape[:2], np.nan)
    for frame, (present, feet) in places.items():
        rows = np.searchsorted(ids, present)
        position[rows, frame] = feet[:, :2]
        height[rows, frame] = box_top_heights(annotations[frame][1], feet, camera, T_world_camera)
    return AnnotatedWalkers(ids, position, np.clip(np.nanmedian(height, axis=1), *STATURES))


def box_top_heights(boxes: Array, feet: Array, camera: Camera, T_world_camera: Pose) -> Array:
    """Heights (n,) m of the upper edges of boxes above feet (n, 3) m.

    boxes (n, 4): left, top, width, height, px. A height is the point of the vertical through the feet that is nearest to the viewing ray of
    the middle of the edge. Two lines P + h z and C + s d are nearest to each other at h = ((z·d)(w·d) − z·w) / (1 − (z·d)²), with w = P − C
    and unit d.
    """
    top = np.stack([boxes[:, 0] + boxes[:, 2] / 2, boxes[:, 1]], axis=1)
    d = camera.bearings_from_pixels(top) @ T_world_camera.rotation.T
    w = feet - T_world_camera.translation
    return np.asarray((d[:, 2] * np.einsum("ni,ni->n", d, w) - w[:, 2]) / (1 - d[:, 2] ** 2))


def confine_rovers(world: World, position: Array) -> World:
    """The world with the free space of rovers restricted to the area around the paths position (m, frames, 2) m."""
    there = position[np.isfinite(position).all(axis=-1)]
    low, high = there.min(axis=0) - ROVER_MARGIN, there.max(axis=0) + ROVER_MARGIN
    return dataclasses.replace(world, wheels=within(world.wheels, low, high, world.name))


def _provenance(twin: Twin, scenario: Scenario) -> dict[str, Any]:
    files = [twin.annotations, *(twin.calibration / f"View_{number:03d}.xml" for number in sorted({ANNOTATED, *twin.views}))]
    sums = {path.name: checksum(path) for path in files}
    return json.loads(scenario.to_json()) | {"twin": {"views": list(twin.views), "files": sums}}


def box_overlaps(twin: Twin, folder: Path) -> Array:
    """Intersection over union (n,) of each annotated box with the same person's box in the twin's View_001.

    Both boxes are of the whole body, clipped to the image. Annotated people who are absent from the twin count 0. Raises ValueError where
    the twin in `folder` has no View_001.
    """
    name = f"View_{ANNOTATED:03d}"
    if ANNOTATED not in twin.views:
        raise ValueError(f"views are {twin.views}, need {ANNOTATED}: the annotations are of {name}")
    camera = _fixed(twin.calibration, ANNOTATED).camera
    boxes_by_view: Mapping[tuple[int, str], Boxes] = read_boxes(folder)
    out = []
    for frame, (ids, boxes) in annotated_frames(twin).items():
        truth = boxes_by_view.get((frame, name), Boxes.none())
        corner = boxes[:, :2] + (0.5 - camera.pixel_centre)
        edges = np.column_stack([corner, corner + boxes[:, 2:]])
        edges = np.clip(edges, 0.0, [camera.width, camera.height, camera.width, camera.height])
        same = ids[:, None] == truth.person[None, :]
        out.append((overlaps(edges, truth.full) * same).max(axis=1, initial=0.0))
    return np.concatenate(out)
