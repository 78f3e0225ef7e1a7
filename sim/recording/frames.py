"""Assembly of all frames: state of the simulation, truth of the views, and outputs of sensors and detectors.

The views are rendered (`record.py`, which can draw them later and in other processes) or ray cast (`raycast_frames`).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, final

import numpy as np

from sim.cameras.view_clock import TimedPicture, ViewClock, parse_view_clocks
from sim.rendering.cubemap import RenderedImage
from sim.scenario import Scenario
from sim.sensors.raycast_camera import RaycastCamera, RobotDetector, is_rover_panorama
from sim.sensors.robot_sensors import RobotSensors
from sim.sensors.true_boxes import People
from sim.sensors.view_detectors import view_detectors
from sim.simulation.simulation import Simulation
from tracker.geometry import Array, Ints, Pose
from tracker.types import Detections, Mount, Odometry, RobotDetections, SensorSamples, Setup, Sightings, Tick, Truth, View, ViewTruth


@dataclass(frozen=True, eq=False)
class FrameState:
    """The output of a simulation for one frame, before that of cameras.

    truth: without the views. odometry: by robot, empty at frame 0. companions: camera → the robots detected by it, None for fixed cameras.
    samples: of the robots' own sensors since the previous frame.
    """

    truth: Truth
    odometry: dict[str, Odometry]
    companions: dict[str, RobotDetections | None]
    samples: SensorSamples = field(default_factory=SensorSamples)

    @property
    def index(self) -> int:
        return self.truth.index

    @property
    def people(self) -> People:
        """The people who are present."""
        assert self.truth.joints is not None
        return People(self.truth.person_id, self.truth.joints)


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame: the tick for the tracker, the truth, and the truth of the view by camera.

    pictures: unsynchronized camera → the picture that it took since the previous frame and that arrived. The tick has synchronized cameras only.
    images: by camera, empty without rendering. samples: as of FrameState. rows: of truth/rows.csv, empty where all rows show one time.
    """

    tick: Tick
    truth: Truth
    views: Mapping[str, ViewTruth]
    samples: SensorSamples
    images: Mapping[str, RenderedImage] = field(default_factory=dict)
    rows: list[list[object]] = field(default_factory=list)
    pictures: Mapping[str, TakenView] = field(default_factory=dict)


class TakenView(NamedTuple):
    """A picture of an unsynchronized camera, and the people found in it."""

    picture: TimedPicture
    detections: Detections


class PastView(NamedTuple):
    """A picture of an unsynchronized camera, the truth of its view at that time, and feet (m, 3) m of all people present."""

    picture: TimedPicture
    true: ViewTruth
    feet: Array


def simulated_frames(simulation: Simulation, setup: Setup, sensors: RobotSensors | None = None) -> Iterator[FrameState]:
    """Advance a simulation frame by frame, from its current state as frame 0, and yield the state of every frame.

    sensors: those of the scenario, if they exist already; else they are made.
    """
    scenario = simulation.scenario
    sensors = sensors or RobotSensors.of(simulation, setup)
    robot_detector = RobotDetector(simulation, setup)
    for index in range(scenario.frames):
        if index:
            simulation.step()
        samples = sensors.sample(index) if sensors else SensorSamples()
        companions = {name: robot_detector.detect(name) for name in setup.mounts}
        yield FrameState(_truth(index, simulation, setup), simulation.odometry() if index else {}, companions, samples)


def _truth(index: int, simulation: Simulation, setup: Setup) -> Truth:
    """Truth of the current frame of a simulation, without the views. Fixed cameras, which the simulation does not know, stay at their start."""
    poses: dict[str, Pose] = {}
    for robot, start in setup.starts.items():
        if robot in simulation.robots:
            poses[robot] = simulation.T_world_robot(robot)
        else:
            assert start is not None
            poses[robot] = start.T_world_robot
    persons = np.asarray(simulation.persons, dtype=np.int64)
    tipped = frozenset(robot for robot, over in simulation.tipped().items() if over)
    sitting = None if simulation.sitting is None else frozenset(simulation.sitting.tolist())
    return Truth(index, poses, persons, simulation.feet(), np.zeros((len(persons), 0)), simulation.joints(), tipped, sitting)


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measurements of one frame: odometry by robot, all others by camera."""

    detections: Mapping[str, Detections]
    odometry: Mapping[str, Odometry]
    sightings: Mapping[str, Sightings] = field(default_factory=dict)
    companions: Mapping[str, RobotDetections | None] = field(default_factory=dict)
    images: Mapping[str, RenderedImage] = field(default_factory=dict)


def tick_of(index: int, period: float, mounts: Mapping[str, Mount], measured: Measurements) -> Tick:
    """The tick of a frame. The first view of a robot carries its odometry. period: s between frames."""
    views, odometry = [], dict(measured.odometry)
    for name, mount in mounts.items():
        if name not in measured.detections:
            continue
        image = measured.images[name].colour if name in measured.images else None
        seen, found = measured.sightings.get(name), measured.companions.get(name)
        views.append(View(name, measured.detections[name], seen, odometry.pop(mount.robot, None), image=image, robot_detections=found))
    return Tick(index, index * period, tuple(views))


@final
class ViewTimes:
    """Times at which the unsynchronized fixed cameras of a setup take their pictures.

    pictures: camera → its pictures, including those that do not arrive. A robot stands for a fixed camera; all views of a rig are taken at once.
    """

    def __init__(self, scenario: Scenario, setup: Setup) -> None:
        self._period = scenario.period
        clocks = clocks_of(scenario, setup)
        end = (scenario.frames - 1) * scenario.period
        self.pictures = {name: clock.pictures(end, scenario.rate, scenario.stream(f"view_clock/{name}")) for name, clock in clocks.items()}
        self._by_frame: dict[int, dict[str, TimedPicture]] = defaultdict(dict)
        for name, of_camera in self.pictures.items():
            for picture in of_camera:
                self._by_frame[math.ceil(picture.time / self._period - 1e-9)][name] = picture

    def at(self, frame: int) -> Mapping[str, TimedPicture]:
        """Camera → the picture that it takes after the previous frame and up to this frame, of unsynchronized cameras."""
        return self._by_frame.get(frame, {})

    def before(self, frame: int, picture: TimedPicture) -> float:
        """s from a picture of `at` to the frame."""
        return min(max(frame * self._period - picture.time, 0.0), self._period)


def clocks_of(scenario: Scenario, setup: Setup) -> dict[str, ViewClock]:
    """Unsynchronized fixed camera → its clock. Raises ValueError for a clock of a missing camera."""
    if not scenario.view_clock:
        return {}
    clocks = parse_view_clocks(scenario.view_clock, scenario.rate)
    fixed = {name: mount.robot for name, mount in setup.mounts.items() if setup.is_fixed(mount.robot)}
    if unknown := sorted(set(clocks) - {""} - set(fixed.values())):
        raise ValueError(f"view_clock names {unknown[0]!r}, but the fixed cameras are {', '.join(fixed) or 'none'}")
    return {name: clock for name, robot in fixed.items() if (clock := clocks.get(robot, clocks.get("", ViewClock()))) != ViewClock()}


@final
class FrameAssembler:
    """Makes frames from states and the truth of their views. It draws the errors of the detectors: call `frame` once per frame, in order."""

    def __init__(self, simulation: Simulation, setup: Setup) -> None:
        scenario = simulation.scenario
        self._mounts, self._period = setup.mounts, scenario.period
        self.times = ViewTimes(scenario, setup)
        self._detectors = view_detectors(scenario, setup.mounts, simulation.all_persons)

    def frame(
        self,
        state: FrameState,
        true: Mapping[str, ViewTruth],
        images: Mapping[str, RenderedImage] | None = None,
        sightings: Mapping[str, Sightings] | None = None,
        past: Mapping[str, PastView] | None = None,
    ) -> Frame:
        """true: camera → truth of its view. images: camera → image, None where it is not needed or not rendered. sightings: camera → sightings.

        past: the pictures that unsynchronized cameras took since the previous frame.
        """
        person, feet, images = state.truth.person_id, state.truth.feet, images or {}
        found = {name: self._detectors[name].detect(true[name], person, feet) for name in self._mounts if name not in self.times.pictures}
        # A picture that does not arrive still draws its random numbers, so that losses do not change other pictures.
        seen = {name: TakenView(one.picture, self._detectors[name].detect(one.true, person, one.feet)) for name, one in (past or {}).items()}
        tick = tick_of(state.index, self._period, self._mounts, Measurements(found, state.odometry, sightings or {}, state.companions, images))
        truth = replace(state.truth, visible=_visible_fractions(person, [true[name] for name in self._mounts]))
        return Frame(tick, truth, true, state.samples, images, pictures={name: one for name, one in seen.items() if one.picture.arrives})


def _visible_fractions(persons: Ints, views: list[ViewTruth]) -> Array:
    """Visible fraction (m, cameras) of every person; 0 for people outside of a camera's image."""
    out = np.zeros((len(persons), len(views)))
    row = {person: k for k, person in enumerate(persons.tolist())}
    for c, view in enumerate(views):
        for person, visible in zip(view.boxes.person.tolist(), view.boxes.visible, strict=True):
            out[row[person], c] = visible
    return out


def raycast_frames(simulation: Simulation, setup: Setup, raycast_camera: RaycastCamera | None = None) -> Iterator[Frame]:
    """The frames of a scenario without rendering: views by ray casting, and sightings of landmarks for panoramas of rovers."""
    scenario = simulation.scenario
    raycast_camera, assembler = raycast_camera or RaycastCamera(simulation), FrameAssembler(simulation, setup)
    simulation.keep_steps = simulation.keep_steps or bool(assembler.times.pictures)
    landmark_streams = {name: scenario.stream(f"sightings/{name}") for name, mount in setup.mounts.items() if is_rover_panorama(simulation, mount)}
    for state in simulated_frames(simulation, setup):
        poses = {name: state.truth.T_world_robot[mount.robot] @ mount.T_body_camera for name, mount in setup.mounts.items()}
        true = {name: raycast_camera.view(setup.mounts[name].camera, pose, state.people) for name, pose in poses.items()}
        seen = {name: raycast_camera.sightings(poses[name], rng) for name, rng in landmark_streams.items()}
        past = {name: _past_view(raycast_camera, assembler.times, (name, setup), state) for name in assembler.times.at(state.index)}
        yield assembler.frame(state, true, sightings=seen, past=past)


def _past_view(raycast_camera: RaycastCamera, times: ViewTimes, view: tuple[str, Setup], state: FrameState) -> PastView:
    """The picture that a fixed camera took before a frame."""
    (name, setup), picture = view, times.at(state.index)[view[0]]
    before, mount = times.before(state.index, picture), setup.mounts[name]
    pose = state.truth.T_world_robot[mount.robot] @ mount.T_body_camera
    true = raycast_camera.past_view(before, mount.camera, pose, state.people)
    return PastView(picture, true, raycast_camera.simulation.past_feet(before))
