"""Drawing of one moment: the images of all cameras, coded, and the people in them. It needs no simulation, so any process can do it."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.recording.frame_loop import FrameState
from sim.rendering.panorama import PanoramaRenderer
from sim.rendering.semantic_labels import classes
from sim.sensors.keypoints import InstanceImage
from sim.sensors.person_detector import People, seen_people
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera
from tracker.io.image_files import encoded
from tracker.sequence.writer import ImageForm, Layers, view_name
from tracker.types import Boxes, Keypoints, Setup
from worlds.engine import mujoco


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """What stays the same in a sequence: the model, the cameras by name, the person (ngeom,) of each geom, and the form of the images.

    raw: whether colours are handed back as pixels, since something is still to be done to them in the order of the frames.
    """

    model: mujoco.MjModel
    cameras: dict[str, Camera]
    person_of_geom: NDArray[np.uint16]
    form: ImageForm
    raw: bool

    @staticmethod
    def of(simulation: Simulation, setup: Setup, form: ImageForm, raw: bool) -> DrawnScene:
        cameras = {name: mount.camera for name, mount in setup.mounts.items()}
        return DrawnScene(simulation.model, cameras, simulation.person_of_geom.astype(np.uint16), form, raw)


@dataclass(frozen=True, eq=False)
class Moment:
    """The state that is drawn in one frame. geoms: positions (ngeom, 3) m, rotations (ngeom, 9), groups (ngeom,). lights: positions, directions.

    poses: T_world_camera of every camera. people: who are present.
    """

    frame: int
    geoms: tuple[Array, Array, Ints]
    lights: tuple[Array, Array]
    poses: list[Pose]
    people: People

    @staticmethod
    def of(state: FrameState, simulation: Simulation, setup: Setup) -> Moment:
        data, model = simulation.data, simulation.model
        poses = [state.robots[mount.robot] @ mount.T_body_camera for mount in setup.mounts.values()]
        geoms = data.geom_xpos.copy(), data.geom_xmat.copy(), model.geom_group.copy()
        return Moment(state.index, geoms, (data.light_xpos.copy(), data.light_xdir.copy()), poses, state.people)


@dataclass(frozen=True, eq=False)
class Drawn:
    """Images and people of one frame. files: path in the sequence → bytes of an image file. colours: camera → pixels, where they are raw.

    people: camera → boxes and key points.
    """

    frame: int
    files: dict[str, bytes]
    colours: dict[str, NDArray[np.uint8]]
    people: dict[str, tuple[Boxes, Keypoints]]


class MomentRenderer:
    """Draws the moments of a scene, in any order. It is a context manager, which frees OpenGL."""

    def __init__(self, scene: DrawnScene) -> None:
        self.scene = scene
        # A renderer of several cameras shares one buffer: their number and order change no pixel.
        self._renderer = PanoramaRenderer(scene.model, list(dict.fromkeys(scene.cameras.values())), scene.person_of_geom, classes(scene.model))
        self._which = [self._renderer.cameras.index(camera) for camera in scene.cameras.values()]

    def __enter__(self) -> MomentRenderer:
        return self

    def __exit__(self, *raised: object) -> None:
        self._renderer.close()

    def draw(self, moment: Moment) -> Drawn:
        """Images and people of a moment."""
        names, people = list(self.scene.cameras), moment.people
        self.scene.model.geom_group[:] = moment.geoms[2]
        # The renderer reads these arrays of an MjData, and no others.
        data: Any = SimpleNamespace(geom_xpos=moment.geoms[0], geom_xmat=moment.geoms[1], light_xpos=moment.lights[0], light_xdir=moment.lights[1])
        images = self._renderer.render(data, moment.poses, self._which)
        unoccluded = self._renderer.unoccluded(data, moment.poses, people.person.tolist(), self._which)
        seen = {}
        for name, pose, image, extents in zip(names, moment.poses, images, unoccluded, strict=True):
            seen[name] = seen_people(InstanceImage(self.scene.cameras[name], pose, image.instances, image.range), people, extents)
        by_name = dict(zip(names, images, strict=True))
        kinds = {name: image.classes for name, image in by_name.items() if image.classes is not None}
        layers = Layers({k: image.instances for k, image in by_name.items()}, {k: image.range for k, image in by_name.items()}, kinds)
        files = {}
        for name, image in by_name.items():
            if not self.scene.raw:
                path, options = self.scene.form.colour_file(view_name(name, moment.frame))
                files[path] = encoded(path, image.colour[:, :, ::-1], options)
            for path, pixels, options in self.scene.form.layer_files(name, moment.frame, layers):
                files[path] = encoded(path, pixels, options)
        return Drawn(moment.frame, files, {k: image.colour for k, image in by_name.items()} if self.scene.raw else {}, seen)
