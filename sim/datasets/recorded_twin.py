"""The twin of a recording with truth: its people walk their true paths before the models of its fixed cameras.

The world is a hall whose extent follows from paths and cameras: a room where all of them lie close together, otherwise a square.
A sequence of pilsim has its own world again. The twin of PETS 2009 is of sim/datasets/pets_twin.py.
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
from sim.datasets.pets_twin import LARGEST_ID, confine_rovers
from sim.recording.record import SimulatedSequence
from sim.recording.tracker_setup import FixedCamera
from sim.scenario import BOUNDS, INDEPENDENT, Scenario
from sim.simulation.simulation import Simulation, furnished
from tracker.formats.opening import format_of, open_recording
from tracker.formats.source_options import SourceOptions, camera_named
from tracker.formats.table import PILSIM
from tracker.geometry import Array, Ints
from tracker.geometry.ground import Flat
from tracker.recordings.images import ImageSource
from tracker.sequence.reader import read_sequence
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
MOST_RELIEF = 0.5
"""m: people may be so far above or below the level floor of the twin."""


@dataclass(frozen=True)
class RecordedTwin:
    """The description of a twin.

    source: the folder of the recording. cameras: names or numbers of its fixed cameras, empty for all. frames: number of frames, None for all.
    robots: number of rovers, with panoramas of `width` px. seed: of all random streams.
    difficulty: of the world; None for 0 in a hall, and for that of a sequence of pilsim. Paths stay free in a hall.
    """

    source: Path
    cameras: tuple[str, ...] = ()
    frames: int | None = None
    robots: int = 0
    width: int = 1024
    seed: int = 0
    detector_model: str = INDEPENDENT
    difficulty: float | None = None


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """What a twin takes from a source.

    cameras: name → fixed camera. rate: frames per second. ids (m,): of the source. position (m, frames, 2) m, NaN where a person is absent.
    level: z of the floor, m. area (2, 2): where people are reported, m, or None. pillars: as in Setup. images: camera → its images.
    scenario: of a sequence of pilsim, whose world the twin has; None for a hall.
    """

    cameras: Mapping[str, FixedCamera]
    rate: float
    ids: Ints
    position: Array
    level: float
    area: Array | None
    pillars: Array
    images: Mapping[str, ImageSource]
    scenario: Scenario | None = None


def true_motion(twin: RecordedTwin) -> TrueMotion:
    """Read a source. Raises ValueError, with its path, where it has no truth, no fixed cameras, or people far from a level floor."""
    motion = _of_sequence(twin) if format_of(twin.source).name == PILSIM else _of_recording(twin)
    low, high = BOUNDS["rate"]
    if not low <= motion.rate <= high:
        raise ValueError(f"{twin.source}: has {motion.rate:g} frames/s, a twin needs {low:g} to {high:g}")
    return motion


def _of_recording(twin: RecordedTwin) -> TrueMotion:
    recording = open_recording(twin.source, SourceOptions(cameras=twin.cameras))
    if moving := [name for name, camera in recording.cameras.items() if camera.robot is not None]:
        raise ValueError(f"{twin.source}: camera {moving[0]} is on a robot, needs cameras that stand still; --views chooses some")
    if not recording.truth:
        raise ValueError(f"{twin.source}: has no truth, which a twin needs")
    cameras = {name: FixedCamera(camera.camera, camera.pose) for name, camera in recording.cameras.items()}
    ids, position, height = _tracks(twin, recording.truth)
    level = recording.ground.level if isinstance(recording.ground, Flat) else _level(twin.source, height)
    area = None if recording.area is None else np.asarray(recording.area)
    return TrueMotion(cameras, recording.rate, ids, position, level, area, recording.pillars, recording.images)


def _of_sequence(twin: RecordedTwin) -> TrueMotion:
    """A sequence of pilsim: its fixed cameras, and its own world, which its scenario gives."""
    sequence = read_sequence(twin.source)
    setup, truth = sequence.setup, sequence.truth
    fixed = {name: mount for name, mount in setup.mounts.items() if setup.is_fixed(mount.robot)}
    if not fixed:
        raise ValueError(f"{twin.source}: has no fixed camera, which a twin needs (generate it with --views)")
    if not truth:
        raise ValueError(f"{twin.source}: has no truth, which a twin needs")
    names = [camera_named(text, fixed) for text in twin.cameras] or list(fixed)
    cameras = {}
    for name in names:
        start = setup.starts[fixed[name].robot]
        assert start is not None
        cameras[name] = FixedCamera(fixed[name].camera, start.T_world_robot @ fixed[name].T_body_camera)
    ids, position, height = _tracks(twin, {one.index: (one.person_id, one.feet) for one in truth})
    scenario = _own_scenario(sequence.provenance["scenario"])
    level = 0.0 if scenario is not None else _level(twin.source, height)
    return TrueMotion(cameras, 1 / setup.period, ids, position, level, setup.area, setup.pillars, {}, scenario)


def _own_scenario(provenance: Mapping[str, Any]) -> Scenario | None:
    """The scenario in the provenance of a sequence, or None where there is none, and for a twin, whose hall is made again."""
    known = {field.name: provenance[field.name] for field in dataclasses.fields(Scenario) if field.name in provenance}
    try:
        scenario = Scenario.from_json(json.dumps(known))
        catalogue.check_name(scenario.world)
    except (ValueError, TypeError):
        return None
    return None if "twin" in provenance and scenario.world.startswith(hall.NAME) else scenario


def _tracks(twin: RecordedTwin, truth: Mapping[int, tuple[Ints, Array]]) -> tuple[Ints, Array, Array]:
    """Ids (m,), positions (m, frames, 2) m, and all heights (n,) m, of the frames that are wanted."""
    frames = max(truth) + 1 if twin.frames is None else twin.frames
    if not 1 <= frames <= max(truth) + 1:
        raise ValueError(f"frames is {frames}, needs 1 to {max(truth) + 1}, the frames of {twin.source} with truth")
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
    eyes = np.array([camera.T_world_camera.translation for camera in motion.cameras.values()])
    corners = [places.min(axis=0) - PATH_MARGIN, places.max(axis=0) + PATH_MARGIN]
    corners += [] if motion.area is None else list(motion.area)
    inner = np.array([np.min(corners, axis=0), np.max(corners, axis=0)])
    outer = np.array([np.minimum(inner[0], eyes[:, :2].min(axis=0) - CAMERA_MARGIN), np.maximum(inner[1], eyes[:, :2].max(axis=0) + CAMERA_MARGIN)])
    walled = bool((outer[1] - outer[0]).max() <= LONGEST_ROOM)
    # The ground of a square ends at a plain, so that far cameras need not stand on it.
    extent = outer if walled or (outer[1] - outer[0]).max() <= hall.LONGEST_SQUARE else inner
    extent = _at_least(np.round(extent, 3), hall.LEAST_SIDE)
    wall = max(WALL_HEIGHT, round(float(eyes[:, 2].max()) + ABOVE_CAMERAS - motion.level, 2))
    return HallPlan(extent, walled, motion.level, wall, places, motion.pillars)


def _at_least(extent: Array, side: float) -> Array:
    missing = np.maximum(side - (extent[1] - extent[0]), 0.0) / 2
    return np.array([extent[0] - missing, extent[1] + missing])


def recording_of(twin: RecordedTwin, motion: TrueMotion | None = None) -> SimulatedSequence:
    """The twin at its first frame. Raises ValueError as `true_motion`, and for paths that are not free in the world."""
    motion = true_motion(twin) if motion is None else motion
    ids, position = motion.ids, motion.position
    # People of the twin have the ids of the source where these are valid instance numbers.
    kept = bool(ids[0] >= 1 and ids[-1] <= LARGEST_ID)
    people = ids if kept else np.arange(1, len(ids) + 1)
    own = motion.scenario
    plan = plan_of(motion) if own is None else None
    scenario = Scenario(
        world=f"{hall.NAME}:{plan.text}" if plan is not None else own.world if own is not None else "",
        difficulty=twin.difficulty if twin.difficulty is not None else own.difficulty if own is not None else 0.0,
        seed=twin.seed,
        robots=twin.robots,
        people=len(people),
        frames=position.shape[1],
        rate=motion.rate,
        width=twin.width,
        detector_model=twin.detector_model,
    )
    world = hall.build(scenario.stream("world"), scenario.difficulty, plan) if own is None else _world_of(own, scenario.difficulty)
    paths = Paths(people, scenario.period * np.arange(scenario.frames, dtype=np.float64), position)
    simulation = Simulation(scenario, world=confine_rovers(world, position) if twin.robots else world, paths=paths)
    origin = {"source": twin.source.resolve().name, "cameras": list(motion.cameras)} | ({} if kept else {"ids": ids.tolist()})
    return SimulatedSequence(scenario, simulation, motion.cameras, json.loads(scenario.to_json()) | {"twin": origin})


def _world_of(scenario: Scenario, difficulty: float) -> World:
    return furnished(catalogue.build(scenario.world, scenario.stream("world"), difficulty), scenario)
