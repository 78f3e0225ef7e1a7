"""The twin of a recording with truth: its people walk their true paths before the models of its fixed cameras.

The world is a hall whose extent follows from paths and cameras: a room where all of them lie close together, otherwise a square.
A sequence of pilsim has its own world again, and PETS 2009 the world `campus`, with rovers beside its cameras.
It is rendered as a sequence with a picture beside the source, or without images as a recording.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from sim.crowd.replay import Paths
from sim.datasets.presets import within
from sim.datasets.raycast_recording import write_raycast_recording
from sim.datasets.twin_sources import PETS_ROVERS, TrueMotion, Twin, true_motion
from sim.parallel.pool import Pool, usable_cores
from sim.recording.drawing_workers import drawing_workers
from sim.recording.record import SimulatedSequence, check_absent, write_sequence
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation, furnished
from sim.visualization.overlays import colour_of, save_png
from tracker.geometry import Array, Image, Ints
from tracker.geometry.image_boxes import box_overlaps
from tracker.io.file_lock import folder_lock
from tracker.io.progress import progress_bar
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes
from worlds import catalogue
from worlds.scenes import hall
from worlds.scenes.hall import WALL_HEIGHT, HallPlan
from worlds.world import World

PATH_MARGIN, CAMERA_MARGIN = 0.6, 0.15
"""m: walls are at least so far from all paths and cameras."""
LONGEST_ROOM = 20.0
"""m: a longer extent is a square."""
ABOVE_CAMERAS = 0.4
"""m: walls end so far above the highest camera."""
ROVER_MARGIN = 4.0
"""Margin around the area of the paths within which rovers stay, m."""
LARGEST_ID = (1 << 16) - 1
DARK = 24
"""Grey value of the margins."""


def plan_of(motion: TrueMotion) -> HallPlan:
    """The hall around the paths, the area and the cameras: a room where no side is longer than LONGEST_ROOM, otherwise a square."""
    places = motion.position[np.isfinite(motion.position).all(axis=2)]
    eyes = np.array([camera.T_world_camera.translation for camera in motion.cameras.values()])
    corners = [places.min(axis=0) - PATH_MARGIN, places.max(axis=0) + PATH_MARGIN]
    corners += [] if motion.area is None else list(motion.area)
    inner = np.array([np.min(corners, axis=0), np.max(corners, axis=0)])
    outer = np.array([np.minimum(inner[0], eyes[:, :2].min(axis=0) - CAMERA_MARGIN), np.maximum(inner[1], eyes[:, :2].max(axis=0) + CAMERA_MARGIN)])
    walled = bool((outer[1] - outer[0]).max() <= LONGEST_ROOM)
    # The ground of a square ends at a plain, so that far cameras need not stand on it.
    extent = np.round(outer if walled or (outer[1] - outer[0]).max() <= hall.LONGEST_SQUARE else inner, 3)
    missing = np.maximum(hall.LEAST_SIDE - (extent[1] - extent[0]), 0.0) / 2
    wall = max(WALL_HEIGHT, round(float(eyes[:, 2].max()) + ABOVE_CAMERAS - motion.level, 2))
    return HallPlan(np.array([extent[0] - missing, extent[1] + missing]), walled, motion.level, wall, places, motion.pillars)


def recording_of(twin: Twin, motion: TrueMotion | None = None, world: World | None = None) -> SimulatedSequence:
    """The twin at its first frame. The cameras are robots that never move. world: replaces the one of the twin.

    Raises ValueError as `true_motion`, and for paths that are not free in the world.
    """
    motion = true_motion(twin) if motion is None else motion
    ids, position, own = motion.ids, motion.position, motion.scenario
    # People of the twin have the ids of the source where these are valid instance numbers.
    kept = bool(ids[0] >= 1 and ids[-1] <= LARGEST_ID)
    people = ids if kept else np.arange(1, len(ids) + 1)
    plan = plan_of(motion) if own is None else None
    scenario = Scenario(
        world=f"{hall.NAME}:{plan.text}" if plan is not None else own.world if own is not None else "",
        difficulty=twin.difficulty if twin.difficulty is not None else own.difficulty if own is not None else 0.0,
        seed=twin.seed,
        robots=twin.robots if twin.robots is not None else PETS_ROVERS if twin.of_pets else 0,
        people=len(people),
        frames=position.shape[1],
        rate=motion.rate,
        width=twin.width,
        detector_model=twin.detector_model,
    )
    if world is None and own is not None:
        world = furnished(catalogue.build(own.world, own.stream("world"), scenario.difficulty), own)
    site = hall.build(scenario.stream("world"), scenario.difficulty, plan) if world is None else world
    paths = Paths(people, scenario.period * np.arange(scenario.frames, dtype=np.float64), position, motion.stature)
    simulation = Simulation(scenario, world=confine_rovers(site, position) if scenario.robots else site, paths=paths)
    origin = motion.origin | ({} if kept else {"ids": ids.tolist()})
    return SimulatedSequence(simulation, motion.cameras, json.loads(scenario.to_json()) | {"twin": origin})


def confine_rovers(world: World, position: Array) -> World:
    """The world with the free space of rovers restricted to the area around the paths position (m, frames, 2) m."""
    there = position[np.isfinite(position).all(axis=-1)]
    low, high = there.min(axis=0) - ROVER_MARGIN, there.max(axis=0) + ROVER_MARGIN
    return dataclasses.replace(world, wheels=within(world.wheels, low, high, world.name))


def annotated_overlaps(motion: TrueMotion, boxes: dict[tuple[int, str], Boxes]) -> Array:
    """Intersection over union (n,) of each annotated box with the same person's box in the twin, of all of which there are `boxes`.

    Both boxes are of the whole body, clipped to the image. Annotated people who are absent from the twin count 0.
    """
    out = [np.zeros(0)]
    for (frame, name), (ids, edges) in motion.boxes.items():
        camera, truth = motion.cameras[name].camera, boxes.get((frame, name), Boxes.none())
        inside = np.clip(edges, 0.0, [camera.width, camera.height, camera.width, camera.height])
        out.append((box_overlaps(inside, truth.full) * (ids[:, None] == truth.person[None, :])).max(axis=1, initial=0.0))
    return np.concatenate(out)


def generate_twin(twin: Twin, out: Path, render: bool = True, workers: int | None = None) -> Iterator[str]:
    """Write the twin into the new folder `out`, and yield lines that say what there is. Raises ValueError, in one line, for invalid sources.

    render: False for a recording without images and rovers. workers: number of processes that draw, None for one a core.
    """
    if not render:
        if twin.robots:
            raise ValueError(f"robots is {twin.robots}, needs 0 without rendering: the SLAM of rovers needs images")
        twin = dataclasses.replace(twin, robots=0)
    check_absent(out)
    count = Pool(usable_cores() if workers is None else workers).workers
    # A folder that cannot be written is named before the sources are read.
    with folder_lock(out):
        motion = true_motion(twin)
        _write(recording_of(twin, motion), render, motion.area, count, out)
        yield f"{out}: a {'sequence' if render else 'recording without images'} (README.md in it); `pilsim track {out}` tracks it"
        if render and draw_twin(motion, out) is not None:
            yield f"{out / 'twin.png'} shows a frame beside the source's"
        if render and len(alike := annotated_overlaps(motion, read_boxes(out))):
            yield f"overlap of {len(alike)} annotated boxes with the twin's: median IoU {np.sort(alike)[len(alike) // 2]:.3f}"
        people, frames, _ = motion.position.shape
        yield f"{people} people in {frames} frames, before {len(motion.cameras)} cameras"


def _write(made: SimulatedSequence, render: bool, area: Array | None, workers: int, out: Path) -> None:
    if not render:
        write_raycast_recording(made, out, area)
        return
    with drawing_workers(min(workers, made.scenario.frames)) as drawing:
        write_sequence(dataclasses.replace(made, workers=drawing), out, partial(progress_bar, desc="frames", unit="frame"))


def draw_twin(motion: TrueMotion, folder: Path) -> Path | None:
    """Write `twin.png` into the twin's folder and return its path, or None where the source has neither boxes nor images of its cameras and frames.

    The left image is the twin's, the right one the source's, where there is one. Boxes of both are annotated ones of the source, where these are
    known; the twin's own boxes of whole bodies are then thick. Otherwise both have the true boxes of the twin.
    View and frame are those with most people. Raises ValueError where an image of the source cannot be read.
    """
    own = read_boxes(folder)
    shown = motion.boxes or {key: (boxes.person, boxes.full) for key, boxes in own.items() if key[1] in motion.images}
    for frame, name in sorted(shown, key=lambda key: (-len(shown[key][0]), key)):
        camera, (ids, edges) = motion.cameras[name].camera, shown[frame, name]
        source = motion.images.get(name)
        real = None if source is None else next(source.cut(frame, frame + 1).images(1, (camera.height, camera.width)), None)
        if real is None and not motion.boxes:
            continue
        thin, image, note = max(1, camera.width // 900), _image_of(folder, frame, name), "the twin's true boxes"
        if motion.boxes:
            boxes, note = own.get((frame, name), Boxes.none()), "annotated boxes"
            image = _boxed(image, boxes.person, boxes.full, 2 * thin)
        pictures = [_titled(_boxed(image, ids, edges, thin), f"twin, {name}, frame {frame}{': own boxes thick' if motion.boxes else ''}")]
        pictures += [] if real is None else [_titled(_boxed(real, ids, edges, thin), f"the source, with {note}")]
        padded = [cv2.copyMakeBorder(p, 0, 0, 0, 6, cv2.BORDER_CONSTANT, value=(DARK,) * 3).astype(np.uint8) for p in pictures]
        save_png(folder / "twin.png", np.hstack(padded))
        return folder / "twin.png"
    return None


def _image_of(folder: Path, frame: int, camera: str) -> Image:
    tick = next(islice(read_sequence(folder).ticks, frame, None))
    image = next(view.image for view in tick.views if view.camera == camera)
    assert image is not None
    return image


def _boxed(image: Image, ids: Ints, boxes: Array, thickness: int) -> Image:
    """A copy of the image with boxes (n, 4): left, top, right, bottom, px, in the colours of their people."""
    out = np.ascontiguousarray(image).copy()
    for person, edges in zip(ids.tolist(), boxes.tolist(), strict=True):
        left, top, right, bottom = (round(edge) for edge in edges)
        cv2.rectangle(out, (left, top), (right - 1, bottom - 1), colour_of(person), thickness)
    return out


def _titled(image: Image, title: str) -> Image:
    """The image under a line of text."""
    out = cv2.copyMakeBorder(image, 30, 0, 0, 0, cv2.BORDER_CONSTANT, value=(DARK,) * 3)
    cv2.putText(out, title, (8, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (235, 235, 235), 1, cv2.LINE_AA)
    return np.asarray(out, dtype=np.uint8)
