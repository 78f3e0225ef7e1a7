"""Rendering of the views of cameras with any model and effects: colour after the effects, and the truth of the same pixels."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sim.cameras import Rig, RigView
from sim.cameras.partial import PartialCamera
from sim.cameras.rig import LENSES
from sim.effects import ImageEffects
from sim.effects.image_effects import averaged
from sim.recording.frame_loop import FrameState
from sim.recording.rig_rendering import ShutterPart, ShutterTimes, half_parts, joined, lens_parts, rig_of
from sim.rendering.coverage import UnoccludedExtent
from sim.rendering.panorama import PanoramaRenderer, RenderedImage
from sim.scenario import Scenario
from sim.sensors.exposure import Exposure
from sim.sensors.keypoints import InstanceImage
from sim.sensors.person_detector import true_view
from sim.simulation.simulation import Simulation
from tracker.geometry import Image, Pose
from tracker.geometry.cameras import Camera, PanoramicCamera
from tracker.sequence.calibration import pose_row
from tracker.types import Setup, ViewTruth


def is_plain(scenario: Scenario) -> bool:
    """Whether all cameras of a scenario are ideal and of the usual models, which need nothing of this file."""
    return not (scenario.camera or scenario.view_camera or scenario.effects)


def rendered_cameras(scenario: Scenario, others: Iterable[Camera]) -> list[Camera]:
    """The cameras that a renderer needs for a scenario. others: cameras of the usual model at fixed places."""
    times = ShutterTimes.of(scenario.camera_effects, 1 / scenario.physics_rate)
    rigs = [rig_of(scenario.camera, scenario.width)]
    rigs += [rig_of(scenario.view_camera, scenario.view_width)] if scenario.view_camera else [_single(camera) for camera in others]
    found: dict[Camera, None] = {}
    for rig in rigs:
        for part in _all_parts(rig, times):
            found[part.camera] = None
    return list(found)


def _single(camera: Camera) -> Rig:
    views = (RigView("", camera, Pose.identity()),)
    return Rig(views, views)


def _all_parts(rig: Rig, times: ShutterTimes) -> list[ShutterPart]:
    parts = [part for lens in rig.lenses for part in lens_parts(lens.camera, times)]
    if rig.stitching and not rig.views[0].suffix:
        parts += [part for half in rig.stitching.halves for part in half_parts(half, times)]
    return parts


@dataclass(frozen=True, eq=False)
class MountedRig:
    """A rig on a robot, or at a fixed place. name: of its stitched or only view."""

    name: str
    robot: str
    rig: Rig
    T_body_rig: Pose


def mounted_rigs(scenario: Scenario, simulation: Simulation, setup: Setup) -> list[MountedRig]:
    """The rigs of all rovers and fixed cameras."""
    own = rig_of(scenario.camera, scenario.width)
    out = [MountedRig(f"{robot}_camera", robot, own, simulation.T_body_camera) for robot in simulation.robots]
    for name in setup.starts:
        if name not in simulation.robots:
            fixed = rig_of(scenario.view_camera, scenario.view_width) if scenario.view_camera else _single(setup.mounts[name].camera)
            out.append(MountedRig(name, name, fixed, Pose.identity()))
    return out


@dataclass(frozen=True, eq=False)
class _Job:
    """One rendering: a part of the picture `target` of a rig at one time. truth: whether it gives the truth, too."""

    target: tuple[int, str]
    part: ShutterPart
    T_rig_part: Pose
    truth: bool


class ViewRenderer:
    """Renders the views of a scenario whose cameras are not plain, frame by frame.

    renderer: opened with `rendered_cameras`. The simulation keeps its steps from now on, where images show more than one time.
    """

    def __init__(self, scenario: Scenario, simulation: Simulation, setup: Setup, renderer: PanoramaRenderer) -> None:
        self._simulation, self._setup, self._renderer, self._period = simulation, setup, renderer, scenario.period
        effects = scenario.camera_effects
        simulation.keep_steps = simulation.keep_steps or effects.moves
        self._times = ShutterTimes.of(effects, 1 / scenario.physics_rate)
        self.rigs = mounted_rigs(scenario, simulation, setup)
        self._index = {camera: k for k, camera in enumerate(renderer.cameras)}
        self._lens = _lens_effects(scenario, self.rigs)
        self._drift = {
            name: Exposure(scenario.exposure, scenario.image_noise, scenario.period, scenario.stream(f"exposure/{name}")) for name in self._lens
        }
        self._view: dict[str, ImageEffects] = {}
        for mounted in self.rigs:
            for view in mounted.rig.views:
                name = mounted.name + view.suffix
                self._view[name] = ImageEffects(effects, view.camera, scenario.stream(f"effects/{name}/view"))
        self._jobs = self._planned()

    def _planned(self) -> dict[float, list[_Job]]:
        """Time before the frame → what is rendered at it."""
        jobs: dict[float, list[_Job]] = defaultdict(list)
        for k, mounted in enumerate(self.rigs):
            rig = mounted.rig
            for lens in rig.lenses:
                recorded = any(view.suffix == lens.suffix for view in rig.views)
                for part in lens_parts(lens.camera, self._times):
                    times = self._times.subframes(part.before)
                    for n, time in enumerate(times):
                        truth = recorded and n == len(times) // 2
                        jobs[round(time, 9)].append(_Job((k, lens.suffix), part, lens.T_rig_view, truth))
            if rig.stitching and not rig.views[0].suffix:
                for half, lens in zip(rig.stitching.halves, rig.lenses, strict=True):
                    for part in half_parts(half, self._times):
                        jobs[round(part.before, 9)].append(_Job((k, ""), part, lens.T_rig_view, True))
        return dict(sorted(jobs.items(), reverse=True))

    def render(self, state: FrameState) -> tuple[dict[str, RenderedImage], dict[str, ViewTruth]]:
        """Camera → image with effects, and camera → truth of its view, of the current frame."""
        pictures = self._pictures(state)
        images: dict[str, RenderedImage] = {}
        true: dict[str, ViewTruth] = {}
        for k, mounted in enumerate(self.rigs):
            colours = [self._captured(mounted.name + lens.suffix, pictures[k, lens.suffix]) for lens in mounted.rig.lenses]
            for view in mounted.rig.views:
                name, picture = mounted.name + view.suffix, pictures[k, view.suffix]
                stitched = mounted.rig.stitching is not None and not view.suffix
                at = [lens.suffix for lens in mounted.rig.lenses].index(view.suffix) if not stitched else 0
                colour = mounted.rig.stitching.stitched((colours[0], colours[1])) if stitched and mounted.rig.stitching else colours[at]
                image = picture.image(self._view[name].processed(colour))
                pose = state.robots[mounted.robot] @ mounted.T_body_rig @ view.T_rig_view
                extents = picture.extents(len(state.people.person))
                images[name] = image
                instance_image = InstanceImage(view.camera, pose, image.instances, image.range)
                true[name] = true_view(instance_image, state.people, extents, self._simulation.world)
        order = self._setup.mounts
        return {name: images[name] for name in order}, {name: true[name] for name in order}

    def _captured(self, name: str, picture: _Picture) -> Image:
        return self._drift[name].apply(self._lens[name].captured(picture.colour()))

    def _pictures(self, state: FrameState) -> dict[tuple[int, str], _Picture]:
        """Everything that is planned, rendered: (number of the rig, lens or "") → its picture."""
        out: dict[tuple[int, str], _Picture] = {}
        persons = state.people.person.tolist()
        for before, jobs in self._jobs.items():
            data = self._simulation.past(before)
            poses = [self._pose(self.rigs[job.target[0]], data, state) @ job.T_rig_part for job in jobs]
            which = [self._index[job.part.camera] for job in jobs]
            images = self._renderer.render(data, poses, which)
            truth = [n for n, job in enumerate(jobs) if job.truth]
            extents = self._renderer.unoccluded(data, [poses[n] for n in truth], persons, [which[n] for n in truth]) if truth else []
            found = dict(zip(truth, extents, strict=True))
            for n, (job, image) in enumerate(zip(jobs, images, strict=True)):
                if job.target not in out:
                    k, suffix = job.target
                    out[job.target] = _Picture(_camera_of(self.rigs[k].rig, suffix))
                out[job.target].add(job.part, image, found.get(n))
        return out

    def _pose(self, mounted: MountedRig, data: object, state: FrameState) -> Pose:
        if mounted.robot in self._simulation.robots:
            return self._simulation.T_world_robot(mounted.robot, data) @ mounted.T_body_rig
        return state.robots[mounted.robot] @ mounted.T_body_rig

    def row_rows(self, state: FrameState) -> list[list[object]]:
        """Rows of truth/rows.csv of the current frame: frame, camera, first row, end, time s, and the pose of the camera at it."""
        if not self._times.readout and not self._times.shutter:
            return []
        out: list[list[object]] = []
        for mounted in self.rigs:
            for lens in mounted.rig.lenses:
                for part in lens_parts(lens.camera, self._times):
                    pose = self._pose(mounted, self._simulation.past(part.before), state) @ lens.T_rig_view
                    time = state.index * self._period - part.before
                    out.append([state.index, mounted.name + lens.suffix, *part.rows, time, *pose_row(pose)])
        return out


def _lens_effects(scenario: Scenario, rigs: list[MountedRig]) -> dict[str, ImageEffects]:
    """Name of each lens → its effects."""
    effects, out = scenario.camera_effects, {}
    for mounted in rigs:
        stops = (effects.seam or 0.0) / 2 if mounted.rig.stitching else 0.0
        for lens, sign in zip(mounted.rig.lenses, (1, -1), strict=False):
            name = mounted.name + lens.suffix
            out[name] = ImageEffects(effects, lens.camera, scenario.stream(f"effects/{name}"), sign * stops)
    return out


def effect_rows(scenario: Scenario, simulation: Simulation, setup: Setup) -> list[list[object]]:
    """Rows of truth/effects.csv: camera, effect, value, and for specks and drops their middle and radius, px."""
    out: list[list[object]] = []
    for name, chain in _lens_effects(scenario, mounted_rigs(scenario, simulation, setup)).items():
        for effect, value in chain.effects.given().items():
            if effect in ("dust", "drops"):
                out += [[name, spot.effect, spot.opacity, spot.u, spot.v, spot.radius] for spot in chain.spots if spot.effect == effect]
            elif effect not in ("mount_angle", "mount_shift") and (effect != "seam" or chain.stops):
                out.append([name, effect, chain.stops if effect == "seam" else value, 0.0, 0.0, 0.0])
    return out


def _camera_of(rig: Rig, suffix: str) -> Camera:
    if rig.stitching and suffix not in LENSES:
        return rig.stitching.panorama
    return next(lens.camera for lens in rig.lenses if lens.suffix == suffix)


class _Picture:
    """A picture that is put together from its parts and exposures."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._colours: dict[int, list[tuple[ShutterPart, Image]]] = defaultdict(list)
        self._truth: list[tuple[ShutterPart, RenderedImage, list[UnoccludedExtent]]] = []

    def add(self, part: ShutterPart, image: RenderedImage, extents: list[UnoccludedExtent] | None) -> None:
        """Add a rendered part. extents: of all people, for the exposure that gives the truth."""
        self._colours[id(part)].append((part, image.colour))
        if extents is not None:
            self._truth.append((part, image, extents))

    def colour(self) -> Image:
        """The picture (H, W, 3) as the lens sees it, averaged over the exposures."""
        mean = [(parts[0][0], parts[0][1] if len(parts) == 1 else averaged([image for _, image in parts])) for parts in self._colours.values()]
        return self._pasted([(part, image) for part, image in mean], 0)

    def image(self, colour: Image) -> RenderedImage:
        """The truth of the picture, with the colour of the final image."""
        shots = [(part, image) for part, image, _ in self._truth]
        instances = self._pasted([(part, image.instances) for part, image in shots], 0)
        distance = self._pasted([(part, image.range) for part, image in shots], np.inf)
        kinds = [(part, image.classes) for part, image in shots if image.classes is not None]
        return RenderedImage(colour, instances, distance, self._pasted(kinds, 0) if kinds else None)

    def extents(self, people: int) -> list[UnoccludedExtent]:
        """Extents of all people without occlusion."""
        wraps = isinstance(self.camera, PanoramicCamera)
        return [joined([(part.camera, of[k]) for part, _, of in self._truth], self.camera.width, wraps) for k in range(people)]

    def _pasted(self, parts: list[tuple[ShutterPart, np.ndarray]], empty: float) -> np.ndarray:
        first_part, first = parts[0]
        if not isinstance(first_part.camera, PartialCamera):
            return first
        whole = np.full((self.camera.height, self.camera.width, *first.shape[2:]), empty, first.dtype)
        for part, image in parts:
            assert isinstance(part.camera, PartialCamera)
            part.camera.paste(image, whole)
        return whole
