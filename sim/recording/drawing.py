"""Drawing of moments (pictures of all lenses and cameras, and the people in them) by this process, by other processes, or by a Dask cluster.

A Simulation cannot be pickled, and is not needed: a Moment holds all that is drawn, in 34 kB. The simulation runs ahead. Images come back
encoded, so that only one process writes and records them.
"""

from __future__ import annotations

import importlib.metadata
import math
import pickle
import tempfile
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.cameras.partial import PartialCamera
from sim.effects import averaged
from sim.parallel.pool import cluster, drawing_alone, losses, processes
from sim.recording.shots import Moment, MountedRig, PartShot, ShotPlan, ShutterPart
from sim.rendering.coverage import UnoccludedExtent
from sim.rendering.cubemap import RenderedImage
from sim.rendering.draw_list import classes
from sim.rendering.gl_context import choose_gl
from sim.rendering.panorama import PanoramaRenderer
from sim.sensors.true_boxes import InstanceImage, seen_people
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Image
from tracker.geometry.cameras import Camera
from tracker.io.image_files import encoded
from tracker.sequence.writer import ImageForm, view_name
from tracker.types import Boxes, Keypoints
from worlds.engine import mujoco

AHEAD = 3
"""Parts per process that are queued, being drawn, or waiting for an earlier part. A part is one moment here, and several moments on a cluster."""
SHORTEST, LONGEST = 8, 64
"""Frames of a part. A part opens a renderer, which takes as long as 4 frames of four panoramas; a longer part holds more images in memory."""
PARTS = 2
"""Parts for each thread of the cluster, where their length allows it, so that threads end at about the same time."""
_renderers: dict[Path, MomentRenderer] = {}


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """The constants of a sequence: the model, the person (ngeom,) of each geom, rigs and shots, and the form of the images.

    raw: whether pictures of lenses are returned as pixels, because their further processing follows the order of the frames.
    """

    model: mujoco.MjModel
    person_of_geom: NDArray[np.uint16]
    rigs: list[MountedRig]
    shots: list[list[PartShot]]
    form: ImageForm
    raw: bool

    @staticmethod
    def of(simulation: Simulation, plan: ShotPlan, form: ImageForm, raw: bool) -> DrawnScene:
        return DrawnScene(simulation.model, simulation.person_of_geom.astype(np.uint16), plan.rigs, list(plan.shots.values()), form, raw)


@dataclass(frozen=True, eq=False)
class Rendered:
    """One frame in memory. lenses: name → picture (H, W, 3) of a lens. images: camera → its image, with the colour that was rendered.

    people: camera → boxes and key points.
    """

    lenses: dict[str, Image]
    images: dict[str, RenderedImage]
    people: dict[str, tuple[Boxes, Keypoints]]


@dataclass(frozen=True, eq=False)
class Drawn:
    """Images and people of one frame. files: path in the sequence → bytes of an image file. colours: lens → pixels, where they are raw.

    people: camera → boxes and key points.
    """

    frame: int
    files: dict[str, bytes]
    colours: dict[str, Image]
    people: dict[str, tuple[Boxes, Keypoints]]


class MomentRenderer:
    """Draws the moments of a scene, in any order. It is a context manager, which frees OpenGL."""

    def __init__(self, scene: DrawnScene) -> None:
        self.scene = scene
        # All cameras of a renderer share one buffer; their number and order change no pixel.
        cameras = list(dict.fromkeys(shot.part.camera for shots in scene.shots for shot in shots))
        self._renderer = PanoramaRenderer(scene.model, cameras, scene.person_of_geom, classes(scene.model))
        self._index = {camera: k for k, camera in enumerate(cameras)}

    def __enter__(self) -> MomentRenderer:
        return self

    def __exit__(self, *raised: object) -> None:
        self._renderer.close()

    def draw(self, moment: Moment) -> Drawn:
        """Coded images and people of a moment."""
        rendered, form, files = self.render(moment), self.scene.form, {}
        for camera, image in rendered.images.items():
            name = view_name(camera, moment.frame)
            if not self.scene.raw:
                path, options = form.colour_file(name)
                files[path] = encoded(path, image.colour[:, :, ::-1], options)
            for path, pixels, options in form.layer_files(name, image.instances, image.range, image.classes):
                files[path] = encoded(path, pixels, options)
        return Drawn(moment.frame, files, rendered.lenses if self.scene.raw else {}, rendered.people)

    def render(self, moment: Moment) -> Rendered:
        """Pictures and people of a moment."""
        pictures, images, people = self._pictures(moment), {}, {}
        for mounted in self.scene.rigs:
            for view in mounted.rig.views:
                name = mounted.name + view.suffix
                image = images[name] = pictures[name].image()
                instance_image = InstanceImage(view.camera, moment.views[name], image.instances, image.range)
                people[name] = seen_people(instance_image, moment.people, pictures[name].extents(len(moment.people.person)))
        lenses = [mounted.name + lens.suffix for mounted in self.scene.rigs for lens in mounted.rig.lenses]
        return Rendered({name: pictures[name].colour for name in lenses}, images, people)

    def _pictures(self, moment: Moment) -> dict[str, _Picture]:
        """Everything that is planned, rendered: name of a lens or a stitched view → its picture."""
        out: dict[str, _Picture] = {}
        self.scene.model.geom_group[:] = moment.groups
        persons = moment.people.person.tolist()
        for shots, state, poses in zip(self.scene.shots, moment.states, moment.poses, strict=True):
            data: Any = state
            which = [self._index[shot.part.camera] for shot in shots]
            images = self._renderer.render(data, poses, which)
            truth = [n for n, shot in enumerate(shots) if shot.truth]
            extents = self._renderer.unoccluded(data, [poses[n] for n in truth], persons, [which[n] for n in truth]) if truth else []
            found = dict(zip(truth, extents, strict=True))
            for n, (shot, image) in enumerate(zip(shots, images, strict=True)):
                out.setdefault(shot.name, _Picture(shot.whole)).add(shot.part, image, found.get(n))
        return out


class _Picture:
    """A picture that is assembled from its parts and exposures."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._colours: dict[int, list[tuple[ShutterPart, Image]]] = defaultdict(list)
        self._truth: list[tuple[ShutterPart, RenderedImage, list[UnoccludedExtent]]] = []

    def add(self, part: ShutterPart, image: RenderedImage, extents: list[UnoccludedExtent] | None) -> None:
        """Add a rendered part. extents: of all people, for the exposure that gives the truth."""
        self._colours[id(part)].append((part, image.colour))
        if extents is not None:
            self._truth.append((part, image, extents))

    @cached_property
    def colour(self) -> Image:
        """The picture (H, W, 3) as the lens sees it, averaged over the exposures."""
        parts = [(of[0][0], of[0][1] if len(of) == 1 else averaged([image for _, image in of])) for of in self._colours.values()]
        return self._pasted(parts, 0)

    def image(self) -> RenderedImage:
        """The picture with its truth."""
        instances = self._pasted([(part, image.instances) for part, image, _ in self._truth], 0)
        distance = self._pasted([(part, image.range) for part, image, _ in self._truth], np.inf)
        return RenderedImage(self.colour, instances, distance, self._pasted([(part, image.classes) for part, image, _ in self._truth], 0))

    def extents(self, people: int) -> list[UnoccludedExtent]:
        """Extents of all people without occlusion."""
        return [_joined([(part.camera, of[k]) for part, _, of in self._truth], self.camera) for k in range(people)]

    def _pasted(self, parts: list[tuple[ShutterPart, np.ndarray]], empty: float) -> np.ndarray:
        first_part, first = parts[0]
        if not isinstance(first_part.camera, PartialCamera):
            return first
        whole = np.full((self.camera.height, self.camera.width, *first.shape[2:]), empty, first.dtype)
        for part, image in parts:
            assert isinstance(part.camera, PartialCamera)
            part.camera.paste(image, whole)
        return whole


def _joined(extents: list[tuple[PartialCamera | Camera, UnoccludedExtent]], whole: Camera) -> UnoccludedExtent:
    """The extent of one body in a whole image, from those in its parts."""
    seen = [(camera, extent) for camera, extent in extents if extent.pixels]
    if not seen:
        return UnoccludedExtent(0, np.full(4, np.nan))
    corners = [(camera.left, camera.top) if isinstance(camera, PartialCamera) else (0, 0) for camera, _ in seen]
    boxes = np.array([extent.box + np.array([*corner, *corner]) for corner, (_, extent) in zip(corners, seen, strict=True)])
    return UnoccludedExtent(sum(extent.pixels for _, extent in seen), around(boxes, whole.width, whole.wraps))


def around(boxes: Array, width: int, wraps: bool) -> Array:
    """The smallest box (4,) around boxes (n, 4). wraps: whether the image is a full panorama of `width` px, so that it may lie across the seam."""
    low, high = boxes[:, 1].min(), boxes[:, 3].max()
    if not wraps:
        return np.array([boxes[:, 0].min(), low, boxes[:, 2].max(), high])
    starts = np.unique(np.mod(boxes[:, 0], width))
    ends = [(np.mod(boxes[:, 0] - start, width) + boxes[:, 2] - boxes[:, 0]).max() for start in starts]
    best = int(np.argmin(ends))
    return np.array([starts[best], low, starts[best] + min(ends[best], width), high])


@dataclass(frozen=True, eq=False)
class DrawingWorkers:
    """A number of processes that draw moments of one scene, which is written into a folder."""

    executor: Executor
    count: int
    folder: Path

    def draw(self, scene: DrawnScene, moments: Iterable[Moment | None]) -> Iterator[Drawn | None]:
        """The drawn moments, in their order; None for None. Raises WorkerLost where a worker ends, and the errors of workers."""
        file = self.folder / "scene"
        file.write_bytes(pickle.dumps(scene, pickle.HIGHEST_PROTOCOL))
        return drawn_in_order(([moment] for moment in moments), lambda part: self.executor.submit(_draw, file, part), AHEAD * self.count)


@contextmanager
def drawing_workers(count: int) -> Iterator[DrawingWorkers | None]:
    """Workers during this context; None for one, since the process of the caller draws then.

    They start with it, so that they import what they need while the scene is built.
    """
    if count < 2:
        yield None
        return
    choose_gl()
    with processes(count, __name__) as executor, tempfile.TemporaryDirectory(prefix="pilsim-") as folder:
        yield DrawingWorkers(executor, count, Path(folder))


def _draw(scene: Path, moments: list[Moment]) -> list[Drawn]:
    """Draw a part in a process of this machine, whose renderer stays open."""
    if scene not in _renderers:
        _renderers[scene] = MomentRenderer(pickle.loads(scene.read_bytes()))
    return [_renderers[scene].draw(moment) for moment in moments]


def draw_on_cluster(
    scene: DrawnScene, moments: Iterable[Moment | None], missing: int, address: str, versions: dict[str, str]
) -> Iterator[Drawn | None]:
    """As DrawingWorkers.draw, by the cluster of the scheduler at `address`. Dask gives the part of a lost worker to another worker.

    missing: the number of moments other than None. versions: package → version, which a worker must also have.
    Raises ValueError and OSError as `cluster`.
    """
    with cluster(address) as (client, threads):
        (known,) = client.scatter([scene], broadcast=True, hash=False)
        executor, left, length = client.get_executor(pure=False), iter(moments), part_length(missing, threads)
        parts = iter(lambda: list(islice(left, length)), [])
        yield from drawn_in_order(parts, lambda part: executor.submit(draw_part, known, part, versions), AHEAD * threads)


def part_length(missing: int, threads: int) -> int:
    """The number of frames of a part, where `missing` frames are drawn by a number of threads."""
    return min(LONGEST, max(SHORTEST, math.ceil(missing / (PARTS * threads))))


def draw_part(scene: DrawnScene, moments: list[Moment], versions: dict[str, str]) -> list[Drawn]:
    """Draw a part in a worker of a cluster. versions: as of draw_on_cluster.

    Raises ValueError where the worker has other versions, or several threads of linear algebra.
    """
    check_versions(versions)
    with drawing_alone(), MomentRenderer(scene) as renderer:
        return [renderer.draw(moment) for moment in moments]


def check_versions(needed: dict[str, str]) -> None:
    """Raises ValueError where a package of this process has another version. needed: package → version."""
    for name, version in needed.items():
        own = importlib.metadata.version(name)
        if own != version:
            raise ValueError(f"{name} is {own} in a worker of the cluster, needs {version} as here")


def drawn_in_order(parts: Iterable[list[Moment | None]], submit: Callable[[list[Moment]], Future[list[Drawn]]], most: int) -> Iterator[Drawn | None]:
    """The drawn moments of parts, in their order; None for None. At most `most` parts are queued, being drawn, or waiting for an earlier part."""
    waiting: deque[tuple[list[Moment | None], Future[list[Drawn]] | None]] = deque()
    with losses():
        for part in parts:
            there = [moment for moment in part if moment is not None]
            waiting.append((part, submit(there) if there else None))
            while waiting and (waiting[0][1] is None or waiting[0][1].done() or len(waiting) > most):
                yield from _in_place(*waiting.popleft())
        while waiting:
            yield from _in_place(*waiting.popleft())


def _in_place(part: list[Moment | None], future: Future[list[Drawn]] | None) -> Iterator[Drawn | None]:
    drawn = iter([] if future is None else future.result())
    for moment in part:
        yield None if moment is None else next(drawn)
