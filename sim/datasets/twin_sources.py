"""What a twin takes from its source: cameras, and people on their true paths, of a recording, of a sequence of pilsim, or of PETS 2009.

Paths of PETS 2009 are the annotated feet, projected from View_001 to z = 0. Statures are the heights of the upper edges of the boxes above these.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.pedestrian.skeleton import ADULTS
from sim.recording.tracker_setup import FixedCamera
from sim.scenario import BOUNDS, INDEPENDENT, Scenario
from tracker.formats.opening import format_of, open_recording
from tracker.formats.pets2009 import PETS_AREA, PETS_RATE, Annotations, annotation_file, calibration_of, ground_truth, read_annotations
from tracker.formats.source_options import SourceOptions, camera_named
from tracker.formats.table import PILSIM
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Flat
from tracker.io.resume import checksum
from tracker.io.tsai_xml import read_camera
from tracker.recordings.images import ImageSource, VideoFile
from tracker.sequence.reader import read_sequence
from worlds import catalogue
from worlds.scenes import hall

PETS = "pets2009"
PETS_WORLD, ANNOTATED = "campus", "View_001"
"""The world of a twin of PETS 2009, and the view in whose image the annotations were made."""
PETS_ROVERS = 2
"""Number of rovers beside the cameras of PETS 2009, where it is not said."""
MOST_RELIEF = 0.5
"""m: people may be so far above or below the level floor of the twin."""


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
    """What a twin takes from a source.

    cameras: name → fixed camera. rate: frames per second. ids (m,): of the source. position (m, frames, 2) m, NaN where a person is absent.
    level: z of the floor, m. area (2, 2): where people are reported, m, or None. origin: of the twin, in its provenance.
    pillars: as in Setup. images: camera → its images. scenario: of the world that the twin has; None for a hall. stature (m,) m, None for drawn ones.
    boxes: frame, camera → ids (n,) and edges (n, 4) px of annotated boxes, where they are known.
    """

    cameras: Mapping[str, FixedCamera]
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
    cameras = {name: FixedCamera(camera.camera, camera.pose) for name, camera in recording.cameras.items()}
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
        cameras[name] = FixedCamera(fixed[name].camera, start.T_world_robot @ fixed[name].T_body_camera)
    ids, position, height = _tracks(twin, {one.index: (one.person_id, one.feet) for one in truth})
    scenario = _own_scenario(sequence.provenance["scenario"])
    level = 0.0 if scenario is not None else _level(twin.source, height)
    return TrueMotion(cameras, 1 / setup.period, ids, position, level, setup.area, _origin(twin, cameras), setup.pillars, scenario=scenario)


def _origin(twin: Twin, cameras: Mapping[str, FixedCamera]) -> dict[str, Any]:
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
    fixed = {name: FixedCamera(*read_camera(files[name])[1:]) for name in dict.fromkeys([ANNOTATED, *names])}
    camera, pose = fixed[ANNOTATED].camera, fixed[ANNOTATED].T_world_camera
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
        boxes={
            (frame, ANNOTATED): (present, np.column_stack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]]) + shift)
            for frame, (present, boxes) in annotations.items()
            if ANNOTATED in names
        },
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
