"""What is rendered in each frame: shots of all cameras at the times of their rows, scene states, and effects of cameras on colours.

The time of a frame is the end of its last row's exposure, since the simulation has only past states. The truth of a row (instances and range) is
that of the middle of its exposure. Rows within a physics step are rendered together, at the time of their middle row.
Every camera is a rig: an ideal camera has a single lens and one shot, at the time of the frame.
Colours have effects of the lens, exposure, stitching, and effects of processing. Their random numbers are drawn frame by frame, in order.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sim.cameras import Rig, RigView
from sim.cameras.partial import PartialCamera
from sim.cameras.stitching import HalfPanorama
from sim.effects import Effects, ImageEffects
from sim.recording.frames import FrameState
from sim.scenario import Scenario
from sim.sensors.true_boxes import People
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Image, Ints, Pose
from tracker.geometry.cameras import Camera
from tracker.sequence.calibration import pose_row
from tracker.types import Setup

TIME_CONSTANT = 3.0
"""s: time constant of the drift of exposure."""


@dataclass(frozen=True, eq=False)
class MountedRig:
    """A rig on a robot, or at a fixed place. name: of its stitched or only view."""

    name: str
    robot: str
    rig: Rig
    T_body_rig: Pose


@lru_cache(maxsize=16)
def rig_of(text: str, width: int) -> Rig:
    """The rig of a camera's text. Equal arguments give the same object."""
    return Rig.of(text, width)


def mounted_rigs(simulation: Simulation, setup: Setup) -> list[MountedRig]:
    """The rigs of all rovers and fixed cameras."""
    scenario = simulation.scenario
    own = rig_of(scenario.camera, scenario.width)
    out = [MountedRig(f"{robot}_camera", robot, own, simulation.mount(robot)) for robot in simulation.robots]
    for name in setup.starts:
        if name not in simulation.robots:
            if scenario.view_camera:
                rig = rig_of(scenario.view_camera, scenario.view_width)
            else:
                views = (RigView("", setup.mounts[name].camera, Pose.identity()),)
                rig = Rig(views, views)
            out.append(MountedRig(name, name, rig, Pose.identity()))
    return out


@dataclass(frozen=True, eq=False)
class ShutterPart:
    """Pixels of a camera that are read out together. rows: first one and end, of the lens. before: s from the middle of exposure to the frame."""

    camera: Camera | PartialCamera
    rows: tuple[int, int]
    before: float


@dataclass(frozen=True)
class ShutterTimes:
    """When rows are exposed. readout: s from the first row to the last; shutter: s of exposure; step: s, the largest time between two parts."""

    readout: float
    shutter: float
    step: float
    averaged: int

    @staticmethod
    def of(effects: Effects, step: float) -> ShutterTimes:
        return ShutterTimes(effects.readout or 0.0, effects.shutter or 0.0, step, effects.averaged)

    def parts(self, height: int) -> list[tuple[int, int, float]]:
        """First row, end and time before the frame of the parts of an image with `height` rows."""
        count = min(max(math.ceil(self.readout / self.step - 1e-9), 1), height)
        edges = [round(height * k / count) for k in range(count + 1)]
        return [(a, b, self.readout * (1 - (a + b) / 2 / height) + self.shutter / 2) for a, b in itertools.pairwise(edges)]

    def subframes(self, before: float) -> list[float]:
        """Times before the frame of the images that are averaged; the middle one is that of the truth."""
        n = self.averaged
        return [max(before + self.shutter * (k - (n - 1) / 2) / n, 0.0) for k in range(n)]


def lens_parts(camera: Camera, times: ShutterTimes) -> tuple[ShutterPart, ...]:
    """The parts of a lens' image. Equal arguments give the same objects. All camera models have a hash."""
    assert isinstance(camera, Hashable)
    return _lens_parts(camera, times)


@lru_cache(maxsize=64)
def _lens_parts(camera: Any, times: ShutterTimes) -> tuple[ShutterPart, ...]:
    rows = times.parts(camera.height)
    if len(rows) == 1:
        return (ShutterPart(camera, (0, camera.height), rows[0][2]),)
    mask, out = np.zeros((camera.height, camera.width), np.bool_), []
    for first, last, before in rows:
        mask[:] = False
        mask[first:last] = True
        out.append(ShutterPart(PartialCamera.of(camera, mask), (first, last), before))
    return tuple(out)


@lru_cache(maxsize=64)
def half_parts(half: HalfPanorama, times: ShutterTimes) -> tuple[ShutterPart, ...]:
    """The parts of a lens' half of a stitched panorama. A pixel is exposed with the row of the lens from which it is sampled."""
    lens = half.stitching.lens
    u, v = np.meshgrid(np.arange(half.width) + 0.5, np.arange(half.height) + 0.5)
    own = ~half.blind(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(half.height, half.width)
    row = np.clip(np.rint(half.stitching.lens_rows(half.index)), 0, lens.height - 1)
    parts = [(own & (row >= first) & (row < last), first, last, before) for first, last, before in times.parts(lens.height)]
    return tuple(ShutterPart(PartialCamera.of(half, mask), (first, last), before) for mask, first, last, before in parts if mask.any())


@dataclass(frozen=True, eq=False)
class PartShot:
    """One rendering: a part of the picture `name`, whose camera is `whole`, from a pose on a robot. truth: whether it also gives the truth."""

    name: str
    whole: Camera
    part: ShutterPart
    robot: str
    T_body_part: Pose
    truth: bool


@dataclass(frozen=True, eq=False)
class SceneState:
    """What a renderer reads of an MjData, by its names: geoms' positions (ngeom, 3) m and rotations (ngeom, 9), lights' positions and directions."""

    geom_xpos: Array
    geom_xmat: Array
    light_xpos: Array
    light_xdir: Array


@dataclass(frozen=True, eq=False)
class Moment:
    """All that is drawn in one frame. groups (ngeom,): of the geoms. states, poses: the scene and T_world_part of the shots, time by time.

    views: camera → T_world_camera at the time of the frame. people: who are present.
    """

    frame: int
    groups: Ints
    states: list[SceneState]
    poses: list[list[Pose]]
    views: dict[str, Pose]
    people: People


class ShotPlan:
    """What is rendered of a scenario in each frame. The simulation keeps its steps from now on, where images show more than one time.

    rigs: of all cameras. shots: s before the frame → what is rendered at that time, the earliest first.
    """

    def __init__(self, simulation: Simulation, setup: Setup) -> None:
        scenario = simulation.scenario
        effects = scenario.camera_effects
        simulation.keep_steps = simulation.keep_steps or effects.moves
        self._simulation, self._mounts, self._period, self._moves = simulation, setup.mounts, scenario.period, effects.moves
        self._times = ShutterTimes.of(effects, 1 / scenario.physics_rate)
        self.rigs = mounted_rigs(simulation, setup)
        self.shots = self._planned()

    def _planned(self) -> dict[float, list[PartShot]]:
        shots: dict[float, list[PartShot]] = defaultdict(list)
        for mounted in self.rigs:
            rig, robot = mounted.rig, mounted.robot
            for lens in rig.lenses:
                name, T = mounted.name + lens.suffix, mounted.T_body_rig @ lens.T_rig_view
                recorded = any(view.suffix == lens.suffix for view in rig.views)
                for part in lens_parts(lens.camera, self._times):
                    times = self._times.subframes(part.before)
                    for n, time in enumerate(times):
                        shots[round(time, 9)].append(PartShot(name, lens.camera, part, robot, T, recorded and n == len(times) // 2))
            if rig.stitching and not rig.views[0].suffix:
                for half, lens in zip(rig.stitching.halves, rig.lenses, strict=True):
                    for part in half_parts(half, self._times):
                        T = mounted.T_body_rig @ lens.T_rig_view
                        shots[round(part.before, 9)].append(PartShot(mounted.name, rig.stitching.panorama, part, robot, T, True))
        return dict(sorted(shots.items(), reverse=True))

    def moment(self, state: FrameState) -> Moment:
        """What is drawn of the current frame of the simulation."""
        states, poses = [], []
        for before, shots in self.shots.items():
            data = self._simulation.past(before)
            states.append(SceneState(*(of.copy() for of in (data.geom_xpos, data.geom_xmat, data.light_xpos, data.light_xdir))))
            poses.append([self._pose(shot.robot, data, state) @ shot.T_body_part for shot in shots])
        views = {name: state.truth.T_world_robot[mount.robot] @ mount.T_body_camera for name, mount in self._mounts.items()}
        return Moment(state.index, self._simulation.model.geom_group.copy(), states, poses, views, state.people)

    def _pose(self, robot: str, data: Any, state: FrameState) -> Pose:
        return self._simulation.T_world_robot(robot, data) if robot in self._simulation.robots else state.truth.T_world_robot[robot]

    def rows(self, state: FrameState) -> list[list[object]]:
        """Rows of truth/rows.csv of the current frame: frame, camera, first row, end, time s, and the pose of the camera at this time."""
        out: list[list[object]] = []
        for mounted in self.rigs if self._moves else ():
            for lens in mounted.rig.lenses:
                for part in lens_parts(lens.camera, self._times):
                    pose = self._pose(mounted.robot, self._simulation.past(part.before), state) @ (mounted.T_body_rig @ lens.T_rig_view)
                    time = state.index * self._period - part.before
                    out.append([state.index, mounted.name + lens.suffix, *part.rows, time, *pose_row(pose)])
        return out


class Exposure:
    """Exposure and noise of one view, frame by frame.

    stops: sigma of the exposure drift in stops (factors of two), a stationary Ornstein-Uhlenbeck process (Uhlenbeck & Ornstein 1930).
    noise: sigma of white noise in every pixel and channel, in counts of 255. period: s between frames.
    If both are 0, images pass unchanged and nothing is drawn from rng.
    """

    def __init__(self, stops: float, noise: float, period: float, rng: np.random.Generator) -> None:
        self._stops, self._noise, self._rng = stops, noise, rng
        self._decay = math.exp(-period / TIME_CONSTANT)
        self._stops_now = rng.normal(0.0, stops) if stops else 0.0

    def apply(self, picture: Image) -> Image:
        """The image (H, W, 3) of the next frame, with exposure and noise applied."""
        if not self._stops and not self._noise:
            return picture
        light = picture.astype(np.float32)
        if self._stops:
            light *= np.float32(2.0**self._stops_now)
            self._stops_now = self._decay * self._stops_now + math.sqrt(1 - self._decay**2) * self._rng.normal(0.0, self._stops)
        if self._noise:
            light += np.float32(self._noise) * self._rng.standard_normal(picture.shape, dtype=np.float32)
        return np.asarray(np.clip(np.rint(light), 0, 255), dtype=np.uint8)


class CameraColours:
    """The colours of all views, frame by frame.

    changed: whether an image can differ from the picture of its lens.
    """

    def __init__(self, scenario: Scenario, rigs: list[MountedRig]) -> None:
        self._rigs, drift = rigs, (scenario.exposure, scenario.image_noise, scenario.period)
        self.changed = bool(scenario.effects or scenario.exposure or scenario.image_noise) or any(mounted.rig.stitching for mounted in rigs)
        self._lens = _lens_effects(scenario, rigs)
        self._exposure = {name: Exposure(*drift, scenario.stream(f"exposure/{name}")) for name in self._lens}
        self._view: dict[str, ImageEffects] = {}
        for mounted in rigs:
            for view in mounted.rig.views:
                name = mounted.name + view.suffix
                self._view[name] = ImageEffects(scenario.camera_effects, view.camera, scenario.stream(f"effects/{name}/view"))

    def images(self, lenses: Mapping[str, Image]) -> dict[str, Image]:
        """Camera → image (H, W, 3) of the next frame. lenses: name → picture (H, W, 3) of every lens."""
        out = {}
        for mounted in self._rigs:
            rig = mounted.rig
            captured = {lens.suffix: self._captured(mounted.name + lens.suffix, lenses[mounted.name + lens.suffix]) for lens in rig.lenses}
            for view in rig.views:
                name = mounted.name + view.suffix
                if rig.stitching is None or view.suffix:
                    colour = captured[view.suffix]
                else:
                    front, back = captured.values()
                    colour = rig.stitching.stitched((front, back))
                out[name] = self._view[name].processed(colour)
        return out

    def skip(self) -> None:
        """Draw the random numbers of the next frame, whose images are on disk."""
        for mounted in self._rigs:
            for lens in mounted.rig.lenses:
                self._captured(mounted.name + lens.suffix, np.zeros((lens.camera.height, lens.camera.width, 3), np.uint8))

    def _captured(self, name: str, picture: Image) -> Image:
        return self._exposure[name].apply(self._lens[name].captured(picture))


def _lens_effects(scenario: Scenario, rigs: list[MountedRig]) -> dict[str, ImageEffects]:
    """Name of each lens → its effects."""
    effects, out = scenario.camera_effects, {}
    for mounted in rigs:
        stops = (effects.seam or 0.0) / 2 if mounted.rig.stitching else 0.0
        for lens, sign in zip(mounted.rig.lenses, (1, -1), strict=False):
            name = mounted.name + lens.suffix
            out[name] = ImageEffects(effects, lens.camera, scenario.stream(f"effects/{name}"), sign * stops)
    return out


def effect_rows(simulation: Simulation, setup: Setup) -> list[list[object]]:
    """Rows of truth/effects.csv: camera, effect, value (degrees and m for errors of mounts), and for specks and drops their middle and radius, px."""
    scenario = simulation.scenario
    rigs, given, out = mounted_rigs(simulation, setup), scenario.camera_effects.given(), list[list[object]]()
    for name, chain in _lens_effects(scenario, rigs).items():
        for effect, value in given.items():
            if effect in ("dust", "drops"):
                out += [[name, spot.effect, spot.opacity, spot.u, spot.v, spot.radius] for spot in chain.spots if spot.effect == effect]
            elif effect not in ("mount_angle", "mount_shift") and (effect != "seam" or chain.stops):
                out.append([name, effect, chain.stops if effect == "seam" else value, 0.0, 0.0, 0.0])
    errors = [(effect, given[effect]) for effect in ("mount_angle", "mount_shift") if effect in given]
    return out + [[mounted.name, effect, value, 0.0, 0.0, 0.0] for mounted in rigs for effect, value in errors]
