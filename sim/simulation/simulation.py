"""Simulation of a world with its rovers and people. It makes the only calls of mj_step in the project."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim.crowd.crowd import Crowd, CrowdState, Obstacles, PedestrianModel
from sim.crowd.goals import Postures
from sim.crowd.replay import Paths, Replay
from sim.pedestrian import clothing, clothing_textures, gait, skeleton
from sim.pedestrian.skeleton import SittingManner, sitting_poses, with_sitters
from sim.pedestrian.umbrella import KIND, add_umbrella, umbrella_places, with_raised_arms
from sim.robots import driving, odometry, rover
from sim.robots.driving import DriveState, Motion, Pilot, Traffic
from sim.robots.robot_choice import ROVER, WHEELS, parse_robots
from sim.robots.user_robot import UserRobot, encoder_wheels, load_robot, wheel_commands
from sim.scenario import LAMPS, VARIED_CLOTHING, Scenario
from sim.simulation import lighting
from sim.simulation.frame_history import FrameHistory, StepStates
from sim.simulation.guided_robots import GuidedRobots
from sim.simulation.initial_states import InitialStates, clear_of_robots, draw_places, draw_robots, make_crowd, resting_pose
from tracker.geometry import Array, Ints, Pose, rotation_from_quaternion
from tracker.types import Odometry
from worlds import catalogue
from worlds.engine import mujoco
from worlds.props.facades import add_facades
from worlds.scenes.distractor_placement import with_distractors, with_seats
from worlds.world import World

SETTLING_TIME = 1.0
"""s of simulation before frame 0 in which the rovers come to rest."""
TIPPED = math.cos(math.pi / 4)
"""Smallest z of the up axis of a rover that has not tipped over."""

ABSENT, PARKING_DEPTH = 5, 100.0
"""Geom group of absent people, which is never drawn, and the depth below the ground at which they are kept, m."""


def world_of(scenario: Scenario) -> World:
    """The world of a scenario. Raises ValueError for an unknown world, and where distractors or seats do not fit in."""
    return furnished(catalogue.build(scenario.world, scenario.stream("world"), scenario.difficulty), scenario)


def fleet_of(scenario: Scenario) -> dict[int, UserRobot]:
    """Index of a robot → the user robot in place of a rover. The names of the scenario repeat cyclically. Raises ValueError as load_robot."""
    chosen = parse_robots(scenario.robot) if scenario.robot else ()
    named = {i: chosen[i % len(chosen)] for i in range(scenario.robots if chosen else 0)}
    return {i: load_robot(choice) for i, choice in named.items() if choice.source != ROVER}


def furnished(world: World, scenario: Scenario) -> World:
    """A world with the distractors, seats and façades of a scenario. Raises ValueError where they do not fit in."""
    world = with_distractors(world, scenario.stream("world/distractors"), scenario.distractors)
    world = with_seats(world, scenario.stream("world/seats"), scenario.sitters)
    if not scenario.facades:
        return world
    spec = world.spec.copy()
    add_facades(spec, scenario.stream("world/facades"), world.ground, scenario.facades, scenario.glare)
    return replace(world, spec=spec)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """State of a simulation.

    frame; data: the whole scene. moving: the physics model. people: crowd, footing, gaze, joints.
    robots: drivers, commands, odometry, courses of guided robots.
    streams: states of the random streams of the odometry.
    """

    frame: int
    data: mujoco.MjData
    moving: mujoco.MjData
    people: tuple[CrowdState, gait.Footing, Array, Array]
    robots: tuple[tuple[DriveState, ...], Array, dict[str, Odometry], dict[int, tuple[float, ...]]]
    streams: tuple[Any, ...]


class Simulation:
    """The state of a scenario, advanced frame by frame. `model` and `data` always represent the current frame.

    Limbs are posed only when data or joints are read, which keeps steps cheap. They collide with nothing.
    Between frames the rovers move in a second model without limbs, which starts from `data` and is copied back.

    paths: given paths of the people, with their ids, instead of random plans. start: given initial states instead of random ones.
    Raises ValueError for an unknown world, for robots or people that do not fit in, for paths that leave the world or enter a wall.
    It is also raised for a start with other numbers of robots or people.
    keep_steps: whether the states at the physics steps of the last frame are kept, for `step_states`. This changes no result.
    """

    def __init__(self, scenario: Scenario, world: World | None = None, paths: Paths | None = None, start: InitialStates | None = None) -> None:
        self.scenario = scenario
        self.world = world_of(scenario) if world is None else world
        self.robots = tuple(f"robot_{i}" for i in range(scenario.robots))
        if paths is not None and len(paths.ids) != scenario.people:
            raise ValueError(f"people is {scenario.people}, needs {len(paths.ids)}, as many as there are paths")
        if start is not None:
            if paths is not None:
                raise ValueError("paths and start are both given, needs one of them")
            start.check(scenario)
        self._paths, self._start = paths, start
        self.all_persons: Ints = np.arange(1, scenario.people + 1) if paths is None else paths.ids
        self._fleet = fleet_of(scenario)
        self.frame = 0
        self.keep_steps = False
        self._steps: list[tuple[Array, Array]] = []
        self._history: FrameHistory | None = None
        self._past_data: mujoco.MjData | None = None
        people = [scenario.stream(f"person_{i}") for i in self.all_persons]
        drawn = np.array([skeleton.statures(rng, 1, scenario.children)[0] for rng in people])
        self.stature = drawn if paths is None or paths.stature is None else paths.stature
        # Before the costly compilation, so that an error comes at once.
        self._places = draw_places(scenario, self.world.feet) if paths is None and start is None else np.zeros((0, 2))
        self.model = self._compile(people)
        self._data, self._posed = mujoco.MjData(self.model), False
        self._physics = self._rovers_and_colliders().compile()
        self._physics_data = mujoco.MjData(self._physics)
        self._index()
        self._guided = GuidedRobots(self._fleet, self._physics, self.world.terrain, scenario.camera_height)
        self._place_rovers()
        self._place_people(people)
        self._settle_rovers()

    @property
    def data(self) -> mujoco.MjData:
        """The whole scene at the current frame, up to date."""
        self._pose_people()
        return self._data

    @property
    def time(self) -> float:
        """s since frame 0."""
        return self.frame * self.scenario.period

    def step(self) -> None:
        """Advance by one frame period."""
        before, poses = self.wheel_angles(), {name: self.T_world_robot(name) for name in self.robots}
        velocity = self._data.qvel[self._velocities].copy()
        rates = []
        self._copy_state(self._data, self._physics_data)
        self._steps = [(self._data.qpos.copy(), self._data.qvel.copy())] if self.keep_steps else []
        people, head_yaw = [(self._crowd_state, self._footing)], self._gaze
        for _ in range(self._crowd_steps):
            self._move_people()
            rates.append(self._drive())
            people.append((self._crowd_state, self._footing))
        self._copy_state(self._physics_data, self._data)
        self.frame += 1
        self._turn_heads()
        if self.keep_steps:
            qpos = [position for position, _ in self._steps]
            self._history = FrameHistory(float(self._physics.opt.timestep), qpos, people, (head_yaw, self._gaze), self._corrected)
        self._posed = False
        self._measure_odometry(np.concatenate(rates), before, velocity, poses)

    @property
    def drives(self) -> tuple[DriveState, ...]:
        """State of each rover's driver."""
        return tuple(self._drives)

    def set_drivers(self, drivers: Sequence[Pilot], drives: Sequence[DriveState]) -> None:
        """Replace the drivers of all rovers and their states."""
        self._drivers, self._drives = list(drivers), list(drives)

    def motions(self) -> Array:
        """Current motion (r, 5) of the rovers: x, y m, yaw rad, forward speed m/s, yaw rate rad/s."""
        heading, rates = self._heading(), self._physics_data.qvel[self._velocities[:, 5]]
        return np.column_stack([self._physics_data.qpos[self._poses[:, :2]], np.arctan2(heading[:, 1], heading[:, 0]), heading[:, 2], rates])

    @property
    def crowd_state(self) -> CrowdState:
        """State of the crowd, absent people included."""
        return self._crowd_state

    def past(self, before: float) -> mujoco.MjData:
        """The whole scene `before` s before the current frame, until the next call. Before the first frame everything is at rest.

        Raises ValueError for a time before the last frame, and where its steps were not kept (`keep_steps`).
        """
        if before == 0 or not self.frame:
            return self.data
        if self._history is None:
            raise ValueError("physics steps were not kept: set keep_steps before the step")
        if self._past_data is None:
            self._past_data = mujoco.MjData(self.model)
        data, now = self._past_data, self.data
        data.qpos[:] = self._history.rovers(self.model, before)
        data.mocap_pos[:], data.mocap_quat[:] = now.mocap_pos, now.mocap_quat
        if len(self.all_persons):
            position, quaternion = self._history.limbs(self.stature, self.world.terrain, before)
            data.mocap_pos[self._limbs], data.mocap_quat[self._limbs] = self._parked(position), quaternion
            self._hold_umbrellas(data, position, quaternion)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_camlight(self.model, data)
        return data

    def past_feet(self, before: float) -> Array:
        """As `feet`, `before` s before the current frame. Raises ValueError as `past`."""
        if before == 0 or not self.frame:
            return self.feet()
        if self._history is None:
            raise ValueError("physics steps were not kept: set keep_steps before the step")
        position = self._history.places(before)
        return np.column_stack([position, self.world.terrain.height_at(position)])[self._crowd_state.present]

    def T_world_robot(self, name: str, data: mujoco.MjData | None = None) -> Pose:
        """The pose of a rover's body, now or in the scene of `past`. Raises ValueError for a name that is not in `robots`."""
        if name not in self.robots:
            raise ValueError(f"robot is {name!r}, needs one of {self.robots}")
        qpos = (self._data if data is None else data).qpos[self._poses[self.robots.index(name)]]
        return Pose(rotation_from_quaternion(qpos[3:]), qpos[:3])

    def mount(self, name: str) -> Pose:
        """T_body_camera of the panorama of a robot. Raises ValueError for a name that is not in `robots`."""
        if name not in self.robots:
            raise ValueError(f"robot is {name!r}, needs one of {self.robots}")
        robot = self._fleet.get(self.robots.index(name))
        return rover.camera_mount(self.scenario.camera_height) if robot is None else robot.mount(self.scenario.camera_height)

    def is_of_user(self, name: str) -> bool:
        """Whether a robot is a user robot instead of a rover."""
        return self.robots.index(name) in self._fleet

    def imu_mount(self, name: str) -> Pose:
        """T_body_imu of a robot: the specified site, or the body itself."""
        robot = self._fleet.get(self.robots.index(name))
        return Pose.identity() if robot is None else robot.imu

    @property
    def persons(self) -> Ints:
        """Ids (m,) of the people who are present. The id of a person who has left is not reused."""
        return self.all_persons[self._crowd_state.present]

    def change_manner(self, rng: np.random.Generator) -> None:
        """Give all people who sit new random postures, until the next change."""
        if len(sitters := self._postures.sitters):
            manner = SittingManner.drawn(len(sitters), rng)
            self._seated: skeleton.Poses | None = sitting_poses(self.stature[sitters], self._postures.seat, self.world.terrain, manner)
            self._posed = False

    @property
    def sitting(self) -> Ints | None:
        """Ids (k,) of the people who sit and are present; None where the scenario has no sitters."""
        sitters = self._postures.sitters
        return self.all_persons[sitters[self._crowd_state.present[sitters]]] if self.scenario.sitting else None

    def feet(self) -> Array:
        """Ground points (m, 3) m under the centres of the bodies, in the order of `persons`."""
        return self._ground_positions()[self._crowd_state.present]

    def joints(self) -> Array:
        """Key points (m, 17, 3) m in the order of KEYPOINT_NAMES, world frame, in the order of `persons`."""
        self._pose_people()
        return self._joints[self._crowd_state.present]

    def odometry(self) -> dict[str, Odometry]:
        """Odometry of each rover since the previous frame; empty at frame 0."""
        return dict(self._odometry)

    def wheel_angles(self) -> Array:
        """Total angles (robots, 4) rad of the wheels, in the order of rover.WHEELS. For user robots: equivalent angles of a rover's wheels."""
        return self._wheels_of(self._data.qpos[None])[0]

    def _wheels_of(self, qpos: Array) -> Array:
        """Wheel angles (n, robots, 4) rad in states qpos (n, nq); 0 for a robot without wheels."""
        out = np.zeros((len(qpos), len(self.robots), len(rover.WHEELS)))
        out[:, self._rolling] = qpos[:, self._wheel_qpos] * self._wheel_scale
        return out

    def step_states(self) -> StepStates:
        """States of the rovers at the physics steps of the last frame. Raises ValueError where they were not kept (`keep_steps`)."""
        if not self._steps:
            raise ValueError("physics steps were not kept: set keep_steps before the step")
        qpos, qvel = (np.array(values) for values in zip(*self._steps, strict=True))
        poses, velocities = qpos[:, self._poses], qvel[:, self._velocities]
        timestep, gravity = float(self._physics.opt.timestep), np.array(self._physics.opt.gravity)
        return StepStates(timestep, gravity, poses[..., :3], poses[..., 3:], velocities, self._wheels_of(qpos))

    def tipped(self) -> dict[str, bool]:
        """Whether each rover leans by more than 45 degrees."""
        return {name: bool(self.T_world_robot(name).rotation[2, 2] < TIPPED) for name in self.robots}

    def save(self) -> Snapshot:
        """All changing state, but for postures of `change_manner`. Any simulation of the same scenario, world and paths can restore it."""
        data = copy.copy(self.data)
        streams = tuple(rng.bit_generator.state for rng in self._noise)
        people = (self._crowd_state, self._footing, self._gaze, self._joints)
        robots = (tuple(self._drives), self._ctrl.copy(), dict(self._odometry), self._guided.save())
        return Snapshot(self.frame, data, copy.copy(self._physics_data), people, robots, streams)

    def restore(self, snapshot: Snapshot) -> None:
        """Restore a state from `save`; what follows is identical, bit by bit. Raises ValueError for a state of another model."""
        if (snapshot.data.qpos.shape, snapshot.data.mocap_pos.shape) != (self._data.qpos.shape, self._data.mocap_pos.shape):
            raise ValueError(f"snapshot has {len(snapshot.data.mocap_pos)} moved bodies, needs {len(self._data.mocap_pos)}, as this simulation has")
        self.frame, self._steps, self._history = snapshot.frame, [], None
        mujoco.mj_copyData(self._data, self.model, snapshot.data)
        self._posed = True
        mujoco.mj_copyData(self._physics_data, self._physics, snapshot.moving)
        self._crowd_state, self._footing, self._gaze, self._joints = snapshot.people
        drives, ctrl, odometry_now, guided = snapshot.robots
        self._guided.restore(guided)
        self._drives, self._ctrl, self._odometry = list(drives), ctrl.copy(), dict(odometry_now)
        for rng, state in zip(self._noise, snapshot.streams, strict=True):
            rng.bit_generator.state = state
        self._show_present()

    def _compile(self, people: list[np.random.Generator]) -> mujoco.MjModel:
        """The model of the whole scene, with the limbs of people."""
        spec = self._rovers_and_colliders()
        varied = self.scenario.clothing == VARIED_CLOTHING
        clothing_textures.add_clothing_textures(
            spec, self.scenario.stream("fabrics"), clothing_textures.VARIED if varied else clothing_textures.PLAIN
        )
        for person, stature, rng in zip(self.all_persons, self.stature, people, strict=True):
            variety = self.scenario.stream(f"person_{person}/clothing") if varied else None
            clothing.add_person(spec, f"person_{person}", float(stature), rng, variety)
        umbrellas = self.scenario.stream("people/umbrellas")
        self._with_umbrella = np.flatnonzero(umbrellas.random(len(people)) < self.scenario.umbrellas)
        for person in self.all_persons[self._with_umbrella]:
            add_umbrella(spec, f"{KIND}{person}", umbrellas)
        if self.scenario.light == LAMPS:
            lighting.add_lamps(spec, self.world.ground.extent, float(np.median(self.world.ground.heights)), self.scenario.stream("light/lamps"))
        model = clothing.compile_posed(spec)
        lighting.apply(model, self.scenario)
        return model

    def _rovers_and_colliders(self) -> mujoco.MjSpec:
        """The world with rovers and with the colliders of people."""
        spec = self.world.spec.copy()
        for i, name in enumerate(self.robots):
            if i in self._fleet:
                self._fleet[i].add_to(spec, name, self.scenario.camera_height)
            else:
                rover.add_rover(spec, name, i, self.scenario.camera_height)
        for person, stature in zip(self.all_persons, self.stature, strict=True):
            clothing.add_collider(spec, f"person_{person}", float(stature))
        self._crowd_steps, self._substeps = self.scenario.crowd_steps, self.scenario.substeps
        self._dt = self.scenario.period / self._crowd_steps
        spec.option.timestep = self._dt / self._substeps
        # An elliptic friction cone: friction of skidding wheels is opposite to their slip, not along the axes of a pyramid.
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        # Enough for wheels on rough ground; it saves a twentieth of the time of a step.
        spec.option.tolerance = 1e-6
        return spec

    def _index(self) -> None:
        """Addresses of rovers and people in MuJoCo's arrays."""
        m = self.model
        joints = np.array([m.joint(robot).id for robot in self.robots], dtype=np.int64)
        self._poses = m.jnt_qposadr[joints][:, None] + np.arange(7)
        self._velocities = m.jnt_dofadr[joints][:, None] + np.arange(6)
        self._index_wheels()
        limbs = [[m.body(f"person_{p}/{limb}").mocapid[0] for limb in (*skeleton.LIMBS, "collider")] for p in self.all_persons]
        mocap = np.array(limbs, dtype=np.int64).reshape(-1, len(skeleton.LIMBS) + 1)
        self._limbs, self._colliders = mocap[:, :-1], mocap[:, -1]
        bodies = [self._physics.body(f"person_{p}/collider").mocapid[0] for p in self.all_persons]
        self._moving_colliders = np.array(bodies, dtype=np.int64)
        owners = {f"person_{p}": (int(p), 0) for p in self.all_persons} | {robot: (0, i + 1) for i, robot in enumerate(self.robots)}
        names = [m.body(int(body)).name.split("/")[0] for body in m.geom_bodyid]
        owner = np.array([owners.get(name, (0, 0)) for name in names], dtype=np.int64).reshape(-1, 2)
        self.person_of_geom, self.robot_of_geom = owner[:, 0].copy(), owner[:, 1].copy()
        self._groups = m.geom_group.copy()
        self._umbrella_of_geom = np.array([int(name.removeprefix(KIND)) if name.startswith(KIND) else 0 for name in names], dtype=np.int64)

    def _index_wheels(self) -> None:
        """Index the robots that roll, their wheels (k, 4) with factors from their angle to that of a rover's wheel, and all motors (m,)."""
        rolling, wheels, scale, motors = [], [], [], []
        for i, robot in enumerate(self.robots):
            user = self._fleet.get(i)
            if user is not None and not user.wheels:
                continue
            counted = [] if user is None else encoder_wheels(user)
            rolling.append(i)
            wheels.append([f"{robot}/{name}" for name in (rover.WHEELS if user is None else [joint for joint, _ in counted])])
            scale.append([1.0] * len(rover.WHEELS) if user is None else [metres / rover.WHEEL_RADIUS for _, metres in counted])
            motors += wheels[-1] if user is None else [f"{robot}/{servo}" for servo in user.servos]
        joints = np.array([[self.model.joint(name).id for name in names] for names in wheels], dtype=np.int64).reshape(-1, len(rover.WHEELS))
        self._rolling, self._wheel_qpos = np.array(rolling, dtype=np.int64), self.model.jnt_qposadr[joints]
        self._wheel_scale = np.array(scale).reshape(-1, len(rover.WHEELS))
        self._motors = np.array([self.model.actuator(name).id for name in motors], dtype=np.int64)

    def _place_rovers(self) -> None:
        """Place the rovers on the ground, and give each a driver and its sensor errors."""
        if self._start is None:
            room = driving.turning_space(self.world.wheels)
            robots = draw_robots(self.scenario, room)
            speed, radius = self.scenario.speed, {i: user.turning_radius for i, user in self._fleet.items() if user.motion == WHEELS}
            streams = [self.scenario.stream(f"{name}/goals") for name in self.robots]
            drivers: Sequence[Pilot] = [driving.make_driver(room, rng, speed, radius.get(i, 0.0)) for i, rng in enumerate(streams)]
        else:
            robots, drivers = self._start.robots, self._start.drivers
        for i, (index, row) in enumerate(zip(self._poses, robots, strict=True)):
            self._data.qpos[index] = self._resting_pose(i, row)
            for joint, rest in (self._fleet[i].rest if i in self._fleet else {}).items():
                self._data.joint(f"{self.robots[i]}/{joint}").qpos = rest
        self.set_drivers(drivers, [driver.start(row[:2]) for driver, row in zip(drivers, robots, strict=True)])
        self._ctrl = np.zeros(self._motors.shape)
        self._systematic_errors = [odometry.SystematicErrors.draw(self.scenario.stream(f"{name}/wear")) for name in self.robots]
        self._noise = [self.scenario.stream(f"{name}/odometry") for name in self.robots]
        self._odometry = {}

    def _resting_pose(self, robot: int, row: Array) -> Array:
        """Position and quaternion (7,) of a robot at rest. row (3,): x, y m and yaw rad."""
        if robot in self._guided:
            return self._guided.start(robot, row[:2], float(row[2]))
        user = self._fleet.get(robot)
        pose = resting_pose(self.world.terrain, row[:2], float(row[2]))
        if user is not None:
            pose[2] += user.height - rover.WHEEL_RADIUS + 0.01
        return pose

    def _physics_step(self) -> None:
        """Advance the physics and the guided robots by one step."""
        data, dt = self._physics_data, float(self._physics.opt.timestep)
        self._guided.before(data, self._drives, dt)
        mujoco.mj_step(self._physics, data)
        self._guided.after(data, dt)

    def _wheel_goals(self, yaw_rate: Array) -> Array:
        """Wheel speeds (m,) rad/s of all motors for the drivers' commands; yaw_rate (robots,) rad/s is what gyroscopes measure."""
        goals = [np.zeros(0)]
        for i in self._rolling.tolist():
            drive, user = self._drives[i], self._fleet.get(i)
            if user is None:
                goals.append(rover.wheel_speeds(drive.speed, drive.yaw_rate, yaw_rate[i]))
            elif user.servos:
                goals.append(wheel_commands(user, drive.speed, drive.yaw_rate, float(yaw_rate[i])))
        return np.concatenate(goals)

    def _place_people(self, people: list[np.random.Generator]) -> None:
        """Place the people and their colliders."""
        self._crowd, self._crowd_state = self._pedestrian_model(people)
        state = self._crowd_state
        known = self._crowd.postures if isinstance(self._crowd, Crowd) else None
        self._postures = known or Postures.none(len(people))
        self._seated = None
        if len(sitters := self._postures.sitters):
            self._seated = sitting_poses(self.stature[sitters], self._postures.seat, self.world.terrain)
        self._holders = np.setdiff1d(self._with_umbrella, sitters)
        self._umbrellas = np.array([self.model.body(f"{KIND}{p}").mocapid[0] for p in self.all_persons[self._holders]], dtype=np.int64)
        self._footing, self._gaze = gait.stand(state.position, state.heading, self.stature), np.zeros(len(people))
        self._physics_data.mocap_pos[self._moving_colliders] = self._parked(self._ground_positions())

    def _pedestrian_model(self, people: list[np.random.Generator]) -> tuple[PedestrianModel, CrowdState]:
        """The model that moves the people, and their initial state."""
        if self._start is not None:
            return self._start.pedestrians, self._start.people
        if self._paths is not None:
            replay = Replay(self._paths, self.world.feet)
            return replay, replay.start()
        robots = self._data.qpos[self._poses[:, :2]]
        return make_crowd(self.scenario, self.world, people, clear_of_robots(robots, self._places), robots)

    def _settle_rovers(self) -> None:
        self._copy_state(self._data, self._physics_data)
        for _ in range(round(SETTLING_TIME / self._physics.opt.timestep)):
            self._physics_step()
        self._physics_data.qvel[:] = 0.0
        self._physics_data.time = 0.0
        self._copy_state(self._physics_data, self._data)
        for i, user in self._fleet.items():
            if self.tipped()[self.robots[i]]:
                raise ValueError(f"{user.path}: falls over where it stands; lower its mass, widen its track, or tell motion=base")

    @staticmethod
    def _copy_state(source: mujoco.MjData, target: mujoco.MjData) -> None:
        """Copy the state from which the rovers step. The solver's warm start is not copied: reading `data` must have no effect."""
        target.time = source.time
        for name in ("qpos", "qvel", "ctrl"):
            getattr(target, name)[:] = getattr(source, name)

    def _heading(self) -> Array:
        """(robots, 3): x and y of the rovers' forward axes, and forward speed m/s."""
        poses, velocity = self._physics_data.qpos[self._poses], self._physics_data.qvel[self._velocities]
        x = np.array([rotation_from_quaternion(q)[:, 0] for q in poses[:, 3:]]).reshape(-1, 3)
        return np.column_stack([x[:, :2], np.einsum("ri,ri->r", x, velocity[:, :3])])

    def _move_people(self) -> None:
        """Advance the crowd and its colliders by one crowd step."""
        if not len(self.all_persons):
            return
        position, velocity = self._physics_data.qpos[self._poses[:, :2]], self._physics_data.qvel[self._velocities[:, :2]]
        requested_velocity = np.array([drive.requested_velocity for drive in self._drives]).reshape(-1, 2)
        obstacles = Obstacles(position, velocity, np.full(len(position), rover.FOOTPRINT_RADIUS), requested_velocity)
        state = self._crowd.step(self._crowd_state, obstacles, self._dt)
        bodies = gait.Bodies(state.position, state.velocity, state.heading, self.stature)
        self._footing = gait.walk(self._footing, bodies, self._dt)
        arrived = state.present & ~self._crowd_state.present
        if arrived.any():
            self._footing = gait.select_rows(arrived, gait.stand(state.position, state.heading, self.stature), self._footing)
        self._crowd_state = state
        self._physics_data.mocap_pos[self._moving_colliders] = self._parked(self._ground_positions())

    def _turn_heads(self) -> None:
        """Turn the heads by one frame."""
        state = self._crowd_state
        bodies = gait.Bodies(state.position, state.velocity, state.heading, self.stature)
        points = np.concatenate([state.position[state.present], self._physics_data.qpos[self._poses[:, :2]]])
        self._gaze = skeleton.head_yaw(self._gaze, bodies, points, self.scenario.period)

    def _drive(self) -> Array:
        """Advance the rovers by one crowd step. Returns their angular velocities (substeps, robots, 3) rad/s, body frame."""
        position, heading = self._physics_data.qpos[self._poses[:, :2]], self._heading()
        yaw_rate = self._physics_data.qvel[self._velocities[:, 5]]
        people = self._crowd_state.position[self._crowd_state.present]
        for i, driver in enumerate(self._drivers):
            others = np.delete(position, i, axis=0)
            radius = np.concatenate([np.full(len(others), rover.HALF_WIDTH), np.full(len(people), skeleton.RADIUS)])
            traffic = Traffic(np.concatenate([others, people]), radius)
            motion = Motion(position[i], float(np.arctan2(heading[i, 1], heading[i, 0])), float(heading[i, 2]), float(yaw_rate[i]))
            self._drives[i] = driver.step(self._drives[i], motion, traffic, self._dt)
        goal = self._wheel_goals(yaw_rate)
        before, self._ctrl = self._ctrl, goal
        ctrl, qvel = self._physics_data.ctrl, self._physics_data.qvel
        commands, velocities = np.tile(ctrl, (self._substeps, 1)), np.empty((self._substeps, len(qvel)))
        share = np.arange(1, self._substeps + 1)[:, None] / self._substeps
        commands[:, self._motors] = before + (goal - before) * share
        for k in range(self._substeps):
            ctrl[:] = commands[k]
            self._physics_step()
            velocities[k] = qvel
            if self.keep_steps:
                self._steps.append((self._physics_data.qpos.copy(), qvel.copy()))
        return velocities[:, self._velocities[:, 3:]]

    def _pose_people(self) -> None:
        """Pose all limbs for the current frame, if that is not done yet."""
        if self._posed:
            return
        state = self._crowd_state
        poses = skeleton.limb_poses(self.stature, self._footing, state.position, state.heading, self.world.terrain)
        poses = skeleton.with_head_yaw(self._corrected(poses, state.heading), self._gaze)
        self._data.mocap_pos[self._limbs], self._data.mocap_quat[self._limbs] = self._parked(poses.position), poses.quaternion
        self._hold_umbrellas(self._data, poses.position, poses.quaternion)
        self._data.mocap_pos[self._colliders] = self._parked(self._ground_positions())
        self._show_present()
        self._joints, self._posed = poses.joints, True
        mujoco.mj_forward(self.model, self._data)

    def _corrected(self, poses: skeleton.Poses, heading: Array) -> skeleton.Poses:
        """The poses of walkers, with sitters on their seats, and with raised right arms of people with umbrellas."""
        if self._seated is not None:
            poses = with_sitters(poses, self._postures.sitters, self._seated)
        return with_raised_arms(poses, self._holders, self.stature, heading) if len(self._holders) else poses

    def _hold_umbrellas(self, data: mujoco.MjData, position: Array, quaternion: Array) -> None:
        """Put the umbrellas into the hands of limbs at position (people, limbs, 3) m with quaternion (people, limbs, 4)."""
        k = self._holders
        if len(k):
            data.mocap_pos[self._umbrellas] = self._parked(umbrella_places(position[k], quaternion[k], self.stature[k]), k)

    def _show_present(self) -> None:
        holders = self.all_persons[self._holders[self._crowd_state.present[self._holders]]]
        absent = np.isin(self.person_of_geom, self.all_persons[~self._crowd_state.present])
        absent |= (self._umbrella_of_geom > 0) & ~np.isin(self._umbrella_of_geom, holders)
        self.model.geom_group[:] = np.where(absent, ABSENT, self._groups)

    def _ground_positions(self) -> Array:
        """Ground points (people, 3) m under all bodies, absent people included."""
        position = self._crowd_state.position
        return np.column_stack([position, self.world.terrain.height_at(position)])

    def _parked(self, position: Array, people: Ints | None = None) -> Array:
        """position (people, ..., 3) m, with absent people moved far below the ground, out of contact. people: their indices; None for all."""
        out = position.copy()
        present = self._crowd_state.present if people is None else self._crowd_state.present[people]
        out[~present, ..., 2] -= PARKING_DEPTH
        return out

    def _measure_odometry(self, rates: Array, wheels: Array, velocity: Array, poses: dict[str, Pose]) -> None:
        """Measure the odometry of the frame that has just ended. wheels, velocity, poses: at its start."""
        angles_now = self.wheel_angles()
        acceleration = (self._data.qvel[self._velocities[:, :3]] - velocity[:, :3]) / self.scenario.period
        for i, name in enumerate(self.robots):
            R = self.T_world_robot(name).rotation
            angles = np.stack([wheels[i], angles_now[i]])
            motion = odometry.FrameMotion(rates[:, i], self.model.opt.timestep, angles, R.T @ acceleration[i], R[2])
            errors, rng = self._systematic_errors[i], self._noise[i]
            user = self._fleet.get(i)
            if user is not None and not user.wheels:
                moved = (poses[name].inverse() @ self.T_world_robot(name)).translation
                drift = odometry.VISUAL_DRIFT if user.flies else odometry.LEG_DRIFT
                self._odometry[name] = odometry.measure_moved(motion, moved, errors, drift, rng)
            else:
                self._odometry[name] = odometry.measure(motion, errors, rng, 0.0 if user is None else user.axle)
