"""The twin of a recording with truth: its people walk their true paths before the models of its fixed cameras.

The world is a hall whose extent follows from paths and cameras: a room where all of them lie close together, otherwise a square.
A sequence of pilsim has its own world again, and PETS 2009 the world `campus`, with rovers beside its cameras.
"""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from sim.crowd.replay import Paths
from sim.datasets.presets import within
from sim.datasets.twin_sources import PETS_ROVERS, TrueMotion, Twin, true_motion
from sim.recording.record import SimulatedSequence
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation, furnished
from tracker.geometry import Array
from tracker.geometry.image_boxes import box_overlaps
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
