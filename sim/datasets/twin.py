"""The twin of a recording with truth: its people walk their true paths in view of models of its fixed cameras.

The source is a recording, a sequence of pilsim, or PETS 2009. Paths of PETS 2009 are the annotated feet, projected from View_001 to z = 0.
Statures are the heights of the upper edges of the boxes above these.
The world is a hall whose extent follows from paths and cameras: a room where all of them lie close together, otherwise a square.
A sequence of pilsim keeps its own world. PETS 2009 has the world `campus`, with rovers beside its cameras.
It is rendered as a sequence with a picture beside the source, or without images as a recording.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sim.crowd.replay import Paths
from sim.datasets.presets import within
from sim.datasets.raycast_recording import write_raycast_recording
from sim.parallel.pool import Pool, usable_cores
from sim.pedestrian.skeleton import ADULTS
from sim.recording.drawing import drawing_workers
from sim.recording.record import SimulatedSequence, check_absent, write_sequence
from sim.scenario import BOUNDS, INDEPENDENT, Scenario
from sim.simulation.simulation import Simulation, furnished
from sim.visualization.overlays import colour_of, save_png
from tracker.formats.opening import format_of, open_recording
from tracker.formats.pets2009 import PETS_AREA, PETS_RATE, Annotations, annotation_file, calibration_of, ground_truth, read_annotations
from tracker.formats.registry import PILSIM
from tracker.formats.source_options import SourceOptions, camera_named
from tracker.geometry import Array, Image, Ints, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Flat
from tracker.geometry.image_boxes import box_overlaps, edges_of
from tracker.io.file_lock import folder_lock
from tracker.io.progress import progress_bar
from tracker.io.resume import checksum
from tracker.io.tsai_xml import read_camera
from tracker.recordings import RecordingCamera
from tracker.recordings.images import ImageSource, VideoFile
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes
from tracker.types import Boxes
from worlds import catalogue
from worlds.scenes import hall
from worlds.scenes.hall import WALL_HEIGHT, HallPlan
from worlds.world import World

PETS = "pets2009"
PETS_WORLD, ANNOTATED = "campus", "View_001"
"""The world of a twin of PETS 2009, and the view in whose image the annotations were made."""
PETS_ROVERS = 2
"""Number of rovers beside the cameras of PETS 2009, where none is given."""
MOST_RELIEF = 0.5
"""m: largest distance of people above or below the level floor of the twin."""
PATH_MARGIN, CAMERA_MARGIN = 0.6, 0.15
"""m: least distances of walls from paths and from cameras."""
LONGEST_ROOM = 20.0
"""m: longest side of a room; a longer extent is a square."""
ABOVE_CAMERAS = 0.4
"""m: height of the walls above the highest camera."""
ROVER_MARGIN = 4.0
"""Margin around the area of the paths within which rovers stay, m."""
LARGEST_ID = (1 << 16) - 1
DARK = 24
"""Grey value of the margins."""


@dataclass(frozen=True)
class Twin:
    """The description of a twin.

    source: the folder of a recording, or a CVML file of annotations with the folder `calibration` of View_00N.xml. cameras: names or numbers of its
    fixed cameras, empty for all, or for View_001 of PETS 2009. frames: number of frames, None for all.
    robots: number of rovers, with panoramas of `width` px; None for 2 in PETS 2009, and 0 elsewhere. seed: of all random streams.
    difficulty: of the world; None for 0, and for that of a sequence of pilsim. Paths stay free in a hall.
    """

    source: Path
    cameras: tuple[str, ...] = ()
    frames: int | None = None
    robots: int | None = None
    width: int = 1024
    seed: int = 0
    detector_model: str = INDEPENDENT
    difficulty: float | None = None
    calibration: Path | None = None

    @property
    def of_pets(self) -> bool:
        """Whether the source is PETS 2009."""
        return self.calibration is not None or format_of(self.source).name == PETS


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """The data of a source that a twin uses.

    cameras: name → fixed camera. rate: frames per second. ids (m,): of the source. position (m, frames, 2) m, NaN where a person is absent.
    level: z of the floor, m. area (2, 2): where people are reported, m, or None. origin: of the twin, in its provenance.
    pillars: as in Setup. images: camera → its images. scenario: of the world that the twin has; None for a hall. stature (m,) m, None for drawn ones.
    boxes: frame, camera → ids (n,) and edges (n, 4) px of annotated boxes, where they are known.
    """

    cameras: Mapping[str, RecordingCamera]
    rate: float
    ids: Ints
    position: Array
    level: float
    area: Array | None
    origin: dict[str, Any]
    pillars: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 5)))
    images: Mapping[str, ImageSource] = dataclasses.field(default_factory=dict)
    scenario: Scenario | None = None
    stature: Array | None = None
    boxes: Mapping[tuple[int, str], tuple[Ints, Array]] = dataclasses.field(default_factory=dict)


def true_motion(twin: Twin) -> TrueMotion:
    """Read a source. Raises ValueError, with its path, where it has no truth, no fixed cameras, or people far from a level floor."""
    if twin.of_pets:
        return _of_pets(twin)
    motion = _of_sequence(twin) if format_of(twin.source).name == PILSIM else _of_recording(twin)
    low, high = BOUNDS["rate"]
    if not low <= motion.rate <= high:
        raise ValueError(f"{twin.source}: has {motion.rate:g} frames/s, a twin needs {low:g} to {high:g}")
    return motion


def _of_recording(twin: Twin) -> TrueMotion:
    recording = open_recording(twin.source, SourceOptions(cameras=twin.cameras))
    if moving := [name for name, camera in recording.cameras.items() if camera.robot is not None]:
        raise ValueError(f"{twin.source}: camera {moving[0]} is on a robot, needs cameras that stand still; --cameras chooses some")
    if not recording.truth:
        raise ValueError(f"{twin.source}: has no truth, which a twin needs")
    cameras = recording.cameras
    ids, position, height = _tracks(twin, recording.truth)
    level = recording.ground.level if isinstance(recording.ground, Flat) else _level(twin.source, height)
    area = None if recording.area is None else np.asarray(recording.area)
    return TrueMotion(cameras, recording.rate, ids, position, level, area, _origin(twin, cameras), recording.pillars, recording.images)


def _of_sequence(twin: Twin) -> TrueMotion:
    """A sequence of pilsim: its fixed cameras, and its own world, which its scenario gives."""
    sequence = read_sequence(twin.source)
    setup, truth = sequence.setup, sequence.truth
    fixed = {name: mount for name, mount in setup.mounts.items() if setup.is_fixed(mount.robot)}
    if not fixed:
        raise ValueError(f"{twin.source}: has no fixed camera, which a twin needs (generate it with --fixed-cameras)")
    if not truth:
        raise ValueError(f"{twin.source}: has no truth, which a twin needs")
    cameras = {}
    for name in [camera_named(text, fixed) for text in twin.cameras] or list(fixed):
        start = setup.starts[fixed[name].robot]
        assert start is not None
        cameras[name] = RecordingCamera(fixed[name].camera, start.T_world_robot @ fixed[name].T_body_camera)
    ids, position, height = _tracks(twin, {one.index: (one.person_id, one.feet) for one in truth})
    scenario = _own_scenario(sequence.provenance["scenario"])
    level = 0.0 if scenario is not None else _level(twin.source, height)
    return TrueMotion(cameras, 1 / setup.period, ids, position, level, setup.area, _origin(twin, cameras), setup.pillars, scenario=scenario)


def _origin(twin: Twin, cameras: Mapping[str, RecordingCamera]) -> dict[str, Any]:
    return {"source": twin.source.resolve().name, "cameras": list(cameras)}


def _of_pets(twin: Twin) -> TrueMotion:
    """A PETS 2009 folder, or its annotations. Raises ValueError for missing or invalid files, and for an unknown view."""
    source, calibration = twin.source, twin.calibration
    if calibration is None:
        source, calibration = annotation_file(twin.source) or twin.source / "annotations" / "*.xml", calibration_of(twin.source)
    if not source.is_file():
        raise ValueError(f"{source}: no such file, the truth which a twin needs")
    if twin.difficulty:
        raise ValueError("--difficulty is for halls; the campus of a twin of PETS 2009 is flat, as the site is")
    files = {} if calibration is None else {path.stem: path for path in sorted(calibration.glob("View_*.xml"))}
    if ANNOTATED not in files:
        raise ValueError(f"{calibration or twin.source / 'calibration'}: no {ANNOTATED}.xml")
    names = [camera_named(text, files) for text in twin.cameras] or [ANNOTATED]
    fixed = {name: RecordingCamera(*read_camera(files[name])[1:]) for name in dict.fromkeys([ANNOTATED, *names])}
    camera, pose = fixed[ANNOTATED].camera, fixed[ANNOTATED].pose
    annotations = _annotated_frames(twin, source)
    places = ground_truth(annotations, camera, pose, Flat())
    ids, position, _ = _tracks(twin, places)
    height = np.full(position.shape[:2], np.nan)
    for frame, (present, feet) in places.items():
        height[np.searchsorted(ids, present), frame] = box_top_heights(annotations[frame][1], feet, camera, pose)
    shift, video = 0.5 - camera.pixel_centre, source.parent.parent / "video" / f"{ANNOTATED}.mp4"
    sums = {path.name: checksum(path) for path in (source, *(files[name] for name in sorted(fixed)))}
    return TrueMotion(
        {name: fixed[name] for name in names},
        PETS_RATE,
        ids,
        position,
        0.0,
        np.array(PETS_AREA),
        {"views": [int(name.removeprefix("View_")) for name in names], "files": sums},
        images={ANNOTATED: VideoFile(video)} if video.is_file() else {},
        scenario=Scenario(world=PETS_WORLD, difficulty=0.0, seed=twin.seed),
        # Values beyond the bounds are errors of a box.
        stature=np.clip(np.nanmedian(height, axis=1), *ADULTS),
        boxes={(frame, ANNOTATED): (present, edges_of(boxes) + shift) for frame, (present, boxes) in annotations.items() if ANNOTATED in names},
    )


def _annotated_frames(twin: Twin, file: Path) -> Annotations:
    """The annotated frames that are selected; frame numbers that the file leaves out are empty."""
    annotations = read_annotations(file)
    nobody = np.zeros(0, dtype=np.int64), np.zeros((0, 4))
    count = max(annotations, default=-1) + 1
    return {k: annotations.get(k, nobody) for k in range(min(twin.frames or count, count))}


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


def _own_scenario(provenance: Mapping[str, Any]) -> Scenario | None:
    """The scenario in the provenance of a sequence, or None where there is none, and for a twin, whose hall is made again."""
    known = {field.name: provenance[field.name] for field in dataclasses.fields(Scenario) if field.name in provenance}
    try:
        scenario = Scenario.from_json(json.dumps(known))
        catalogue.check_name(scenario.world)
    except (ValueError, TypeError):
        return None
    return None if "twin" in provenance and scenario.world.startswith(hall.NAME) else scenario


def _tracks(twin: Twin, truth: Mapping[int, tuple[Ints, Array]]) -> tuple[Ints, Array, Array]:
    """Ids (m,), positions (m, frames, 2) m, and all heights (n,) m, of the frames that are wanted."""
    last = max(truth, default=-1) + 1
    frames = last if twin.frames is None else twin.frames
    if not 1 <= frames <= last:
        raise ValueError(f"frames is {frames}, needs 1 to {last}, the frames of {twin.source} with truth")
    chosen = {frame: people for frame, people in truth.items() if 0 <= frame < frames and len(people[0])}
    if not chosen:
        raise ValueError(f"{twin.source}: nobody is in the truth of {frames} frames, needs at least one person")
    ids = np.unique(np.concatenate([people[0] for people in chosen.values()]))
    position = np.full((len(ids), frames, 2), np.nan)
    for frame, (present, feet) in chosen.items():
        position[np.searchsorted(ids, present), frame] = np.asarray(feet)[:, :2]
    return ids, position, np.concatenate([np.asarray(feet)[:, 2] for _, feet in chosen.values()])


def _level(source: Path, height: Array) -> float:
    """The height of a level floor under people. Raises ValueError where they stand more than MOST_RELIEF from it."""
    level = float(np.median(height))
    if (off := float(np.abs(height - level).max())) > MOST_RELIEF:
        raise ValueError(f"{source}: people stand up to {off:.2f} m from a level floor, the hall of a twin needs at most {MOST_RELIEF} m")
    return level


def plan_of(motion: TrueMotion) -> HallPlan:
    """The hall around the paths, the area and the cameras: a room where no side is longer than LONGEST_ROOM, otherwise a square."""
    places = motion.position[np.isfinite(motion.position).all(axis=2)]
    eyes = np.array([camera.pose.translation for camera in motion.cameras.values()])
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
    """Intersection over union (n,) of each annotated box with the same person's box in the twin. boxes: of the twin.

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
