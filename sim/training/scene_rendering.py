"""Rendered scenes for training and evaluation: a crowd in a world under some light, seen by random cameras over some moments.

The same task gives the same bytes in any process.
"""

from __future__ import annotations

import dataclasses
import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.datasets.presets import confine
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import PLAIN_CLOTHING, VARIED_CLOTHING, Scenario
from sim.sensors.true_boxes import InstanceImage, People, image_points, true_boxes
from sim.simulation.lighting import set_light, set_sky
from sim.simulation.simulation import Simulation, furnished
from sim.training.camera_sampling import INDOORS, OUTDOORS, CameraSampler, draw_cameras
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera, Panorama
from tracker.io.atomic import new_folder
from worlds import catalogue
from worlds.scenes import meeting_room
from worlds.world import World

PEOPLE = (10, 70)
"""Number of people in a scene."""
DENSE_SHARE, DENSE_GROUND = 0.5, (8.0, 22.0)
"""Share of scenes whose people are confined to a square, and bounds of its edge, m: bodies hide each other there."""
STEP_RATE = 0.5
"""Hz: rate of the moments of a scene. People walk about 2 m between two of them."""
DISTRACTOR_SHARE, DISTRACTORS = 0.6, (4.0, 48.0)
"""Share of scenes with distractors, and bounds of their number, log-uniform. Real pictures have them."""
RICH = {"groups": (0.6, 0.1, 0.6), "sitting": (0.5, 0.05, 0.4), "wet": (0.25, 0.3, 1.0), "umbrellas": (0.15, 0.05, 0.5)}
"""Field of a scenario → share of the rich scenes that have it, and bounds of its value."""
VARIED_SHARE = 0.6
"""Share of the rich scenes with varied clothing."""
LIGHTS = {"built": 0.35, "overcast": 0.3, "low": 0.2, "dim": 0.15}
"""Kind of light (sim.simulation.lighting) → share of scenes."""
PLACES = ("campus", "forest", "hills", "pilsun", "quarry", "ruins", "tunnel")
"""The worlds of the scenes. New worlds are not added automatically, since scenes must not depend on the number of worlds."""
TWICE = ("campus", "pilsun")
"""Worlds of which twice as many scenes are made: they alone have furniture and streets."""
ROOMS, ROOM_PINHOLES = 7, 2
"""Number of meeting rooms after each turn of the worlds, where scenes are rich, and most pinhole images at a moment there."""
STANDING = 4
"""Largest number of people in a room who stand."""
PANORAMAS, PINHOLES = "panorama", "pinhole"


@dataclass(frozen=True)
class SceneTask:
    """A scene to render. folder: its output. seed: of its scenario. world: its name, a name of worlds.catalogue or that of meeting rooms.

    moments: number of moments. panoramas, pinholes: images of each kind at every moment.
    plain: whether world, crowd and light are as `pilsim generate` makes them by default, as for evaluation.
    rich: whether some scenes have groups, sitters, varied clothing and wet ground, by RICH.
    """

    folder: Path
    seed: int
    world: str
    moments: int = 10
    panoramas: int = 1
    pinholes: int = 3
    plain: bool = False
    rich: bool = False

    @property
    def complete(self) -> bool:
        """Whether the scene is on disk."""
        return (self.folder / f"{PINHOLES}.npz").is_file()

    def run(self) -> None:
        """Render the scene and write it, unless it is on disk. Raises ValueError for a scenario that does not fit into its world."""
        if self.complete:
            return
        os.environ["LP_NUM_THREADS"] = "1"
        rng = np.random.default_rng([self.seed, zlib.crc32(b"training scene")])
        simulation = self._simulation(rng)
        if not self.plain:
            kind = str(rng.choice(list(LIGHTS), p=list(LIGHTS.values())))
            set_light(simulation.model, kind, rng)
            if self.rich:
                set_sky(simulation.model, kind)
        with new_folder(self.folder) as part:
            for name, images in self._images(simulation, rng).items():
                images.write(part, name)

    def _simulation(self, rng: np.random.Generator) -> Simulation:
        """The simulation; the crowd is halved until it fits."""
        if self.world == meeting_room.NAME:
            return self._room(rng)
        difficulty, people, edge = rng.uniform(0.0, 1.0), int(rng.integers(*PEOPLE)), rng.uniform(*DENSE_GROUND)
        dense, height = rng.random() < DENSE_SHARE, rng.uniform(0.5, 2.0)
        distractors = int(np.exp(rng.uniform(*np.log(DISTRACTORS)))) if rng.random() < DISTRACTOR_SHARE else 0
        scenario = Scenario(world=self.world, seed=self.seed, robots=2, people=people, frames=self.moments, rate=STEP_RATE, timestep=0.01)
        if not self.plain:
            scenario = dataclasses.replace(scenario, difficulty=difficulty, children=0.1, camera_height=height)
        world = catalogue.build(scenario.world, scenario.stream("world"), scenario.difficulty)
        if dense and not self.plain:
            world = confine(world, (edge, edge), scenario.stream("world/confined"))
        if not self.plain:
            scenario, world = _furnished(_rich(scenario) if self.rich else scenario, world, distractors)
        while True:
            try:
                return Simulation(scenario, world=world)
            except ValueError:
                if scenario.people < 4:
                    raise
                scenario = dataclasses.replace(scenario, people=scenario.people // 2)

    def _room(self, rng: np.random.Generator) -> Simulation:
        """A room in which most people sit. A room that is too full to stand in is drawn again, with fewer people who stand."""
        for attempt in range(60):
            clothing = VARIED_CLOTHING if rng.random() < VARIED_SHARE else PLAIN_CLOTHING
            scenario = Scenario(world=self.world, seed=self.seed, robots=1, frames=self.moments, rate=STEP_RATE, timestep=0.01, clothing=clothing)
            try:
                world = meeting_room.build(np.random.default_rng([self.seed, attempt, zlib.crc32(b"room")]))
                seated, standing = round(len(world.seats) * rng.uniform(0.4, 1.0)), int(rng.integers(0, max(1, STANDING - attempt // 10)))
                scenario = dataclasses.replace(scenario, people=seated + standing, sitting=seated / (seated + standing), children=0.05)
                return Simulation(scenario, world=world)
            except ValueError as error:
                reason = error
        raise reason

    def _images(self, simulation: Simulation, rng: np.random.Generator) -> dict[str, ImageSet]:
        bounds = INDOORS if self.world == meeting_room.NAME else OUTDOORS
        cameras, sampler = draw_cameras(rng, self.pinholes), CameraSampler(simulation, rng, bounds)
        views = [0] * self.panoramas + list(range(1, 1 + self.pinholes))
        shots: dict[str, list[Shot]] = {PANORAMAS: [], PINHOLES: []}
        with PanoramaRenderer(simulation.model, cameras, simulation.person_of_geom.astype(np.uint16)) as renderer:
            for moment in range(self.moments):
                if moment:
                    simulation.step()
                if bounds is INDOORS:
                    simulation.change_manner(rng)
                people = People(np.asarray(simulation.persons, dtype=np.int64), simulation.joints())
                for which in views:
                    pose = sampler.pose(cameras[which])
                    if pose is None:
                        continue
                    image = renderer.render(simulation.data, [pose], [which])[0]
                    bodies = renderer.unoccluded(simulation.data, [pose], people.person.tolist(), [which])[0]
                    boxes = true_boxes(InstanceImage(cameras[which], pose, image.instances, image.range), people, bodies)
                    kind = PANORAMAS if isinstance(cameras[which], Panorama) else PINHOLES
                    visible = boxes.visible * _inside(cameras[which], pose, people, boxes.person)
                    shots[kind].append(Shot(image.colour, image.instances.astype(np.uint8), boxes.person, boxes.full, visible))
        return {kind: ImageSet.of(taken, cameras[kind == PINHOLES]) for kind, taken in shots.items()}


def _inside(camera: Camera, pose: Pose, people: People, person: Ints) -> Array:
    """Share (n,) of the joints of each person that is within the image, at least one. A true box ends at the border, whatever is beyond."""
    joints = people.joints[np.searchsorted(people.person, person)]
    inside = image_points(camera, pose, joints.reshape(-1, 3))[1].reshape(len(person), -1)
    return np.asarray(np.maximum(inside.sum(axis=1), 1) / people.joints.shape[1])


def _rich(scenario: Scenario) -> Scenario:
    """The scenario with groups, sitters, clothing and wet ground by RICH."""
    rng = scenario.stream("rich scene")
    drawn: dict[str, Any] = {name: float(rng.uniform(low, high)) if rng.random() < share else 0.0 for name, (share, low, high) in RICH.items()}
    clothing = VARIED_CLOTHING if rng.random() < VARIED_SHARE else PLAIN_CLOTHING
    return dataclasses.replace(scenario, clothing=clothing, **drawn)


def _furnished(scenario: Scenario, world: World, distractors: int) -> tuple[Scenario, World]:
    """The scenario with distractors, and its world with them and with seats. Both numbers are halved until they fit."""
    scenario = dataclasses.replace(scenario, distractors=distractors)
    while True:
        try:
            return scenario, furnished(world, scenario)
        except ValueError:
            if not scenario.distractors and not scenario.sitters:
                raise
            scenario = dataclasses.replace(scenario, distractors=scenario.distractors // 2, sitting=scenario.sitting / 2)


@dataclass(frozen=True, eq=False)
class Shot:
    """An image (H, W, 3) RGB with instances (H, W), ids (n,), whole bodies (n, 4) left, top, right, bottom px, and visible shares (n,)."""

    colour: NDArray[np.uint8]
    instances: NDArray[np.uint8]
    person: NDArray[np.int64]
    boxes: Array
    visible: Array


@dataclass(frozen=True, eq=False)
class ImageSet:
    """Images of one size: colour (n, H, W, 3), instances (n, H, W), and a table of bodies.

    image (m,): index of the image of a body; person (m,) its id; boxes (m, 4) px; visible (m,). Colours and instances may be mapped from disk.
    source: folder and name of the files, or None.
    """

    colour: NDArray[np.uint8]
    instances: NDArray[np.uint8]
    image: NDArray[np.int64]
    person: NDArray[np.int64]
    boxes: Array
    visible: Array
    source: tuple[Path, str] | None = None

    def __reduce__(self) -> Any:
        """Another process reads a set from disk, so that its images are not copied."""
        fields = (self.colour, self.instances, self.image, self.person, self.boxes, self.visible)
        return (ImageSet, fields) if self.source is None else (ImageSet.read, self.source)

    @staticmethod
    def of(shots: list[Shot], camera: object) -> ImageSet:
        """The set of some shots of cameras of the size of `camera`."""
        size = (camera.height, camera.width)  # type: ignore[attr-defined]
        image = np.repeat(np.arange(len(shots)), [len(shot.person) for shot in shots]).astype(np.int64)
        return ImageSet(
            np.array([shot.colour for shot in shots], dtype=np.uint8).reshape(-1, *size, 3),
            np.array([shot.instances for shot in shots], dtype=np.uint8).reshape(-1, *size),
            image,
            np.concatenate([shot.person for shot in shots] or [np.zeros(0, np.int64)]),
            np.concatenate([shot.boxes for shot in shots] or [np.zeros((0, 4))]),
            np.concatenate([shot.visible for shot in shots] or [np.zeros(0)]),
        )

    def write(self, folder: Path, name: str) -> None:
        """Write colour and instances as .npy, which can be mapped, and the table as .npz."""
        np.save(folder / f"{name}.npy", self.colour)
        np.save(folder / f"{name}-instances.npy", self.instances)
        np.savez(folder / f"{name}.npz", image=self.image, person=self.person, boxes=self.boxes, visible=self.visible)

    @staticmethod
    def read(folder: Path, name: str) -> ImageSet:
        """The inverse of `write`; images stay on disk."""
        with np.load(folder / f"{name}.npz") as table:
            rows = {key: table[key] for key in ("image", "person", "boxes", "visible")}
        colour = np.load(folder / f"{name}.npy", mmap_mode="r")
        return ImageSet(colour, np.load(folder / f"{name}-instances.npy", mmap_mode="r"), **rows, source=(folder, name))


def scene_tasks(folder: Path, count: int, seed: int, size: dict[str, int] | None = None, rich: bool = False) -> list[SceneTask]:
    """Tasks of `count` scenes in `folder`; the worlds take turns. The n-th has seed + n. size: numbers of SceneTask that differ from its defaults."""
    names = [*PLACES, *TWICE, *([meeting_room.NAME] * ROOMS if rich else [])]
    tasks = [SceneTask(folder / f"scene-{k:04d}", seed + k, names[k % len(names)], **(size or {}), plain=False, rich=rich) for k in range(count)]
    return [dataclasses.replace(task, pinholes=min(task.pinholes, ROOM_PINHOLES)) if task.world == meeting_room.NAME else task for task in tasks]
