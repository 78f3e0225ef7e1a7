"""Simulation: a world, its rovers and its people, moved on together. The only mj_step in the project."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from sim import clothes, driving, gait, odometry, pedestrian, rover
from sim.crowd import Crowd, CrowdState, Obstacles, make_plans
from sim.driving import Motion, Traffic
from sim.scenario import Scenario
from tracker.geometry import Array, Pose, quaternion_from_rotation, rotation_from_quaternion, rotation_z
from tracker.measurements import Ints, Odometry
from worlds import catalogue
from worlds.world import World

TIMESTEP = 0.005
"""s: the physics step is the nearest to this that divides a crowd step."""
CROWD_STEP = 0.05
"""s: people and commands move on at the step nearest to this that divides a frame."""
SETTLING = 1.0
"""s that the rovers are given to come to rest before frame 0."""
APART = 1.5
"""m between the starts of rovers."""
TIPPED = math.cos(math.pi / 4)
"""The least z of a rover's up axis."""


class Simulation:
    """The state of a scenario, frame by frame. model and data are at any time exactly the moment of the frame.

    Raises ValueError for an unknown world or where robots and people do not fit in.
    """

    def __init__(self, scenario: Scenario, world: World | None = None) -> None:
        self.scenario = scenario
        self.world = catalogue.build(scenario.world, scenario.stream("world"), scenario.difficulty) if world is None else world
        self.robots = tuple(f"robot_{i}" for i in range(scenario.robots))
        self.persons: Ints = np.arange(1, scenario.people + 1)
        self.T_body_camera = rover.camera_mount(scenario.camera_height)
        self.frame = 0
        people = [scenario.stream(f"person_{i}") for i in self.persons]
        self._stature = np.array([pedestrian.statures(rng, 1)[0] for rng in people])
        self.model = self._compile(people)
        self.data = mujoco.MjData(self.model)
        self._index()
        self._place_rovers()
        self._place_people(people)
        self._settle()

    @property
    def time(self) -> float:
        """s since frame 0."""
        return self.frame * self.scenario.period

    def step(self) -> None:
        """Advance by one frame period."""
        before = self.data.qpos[self._wheel_qpos].copy()
        velocity = self.data.qvel[self._velocities].copy()
        rates = []
        for _ in range(self._crowd_steps):
            self._move_people()
            rates.append(self._drive())
        self.frame += 1
        self._pose_people()
        mujoco.mj_forward(self.model, self.data)
        self._reckon(np.concatenate(rates), before, velocity)

    def T_world_robot(self, name: str) -> Pose:
        """The pose of a rover's body. Raises ValueError for a name that is not in `robots`."""
        if name not in self.robots:
            raise ValueError(f"robot is {name!r}, needs one of {self.robots}")
        qpos = self.data.qpos[self._poses[self.robots.index(name)]]
        return Pose(rotation_from_quaternion(qpos[3:]), qpos[:3])

    def feet(self) -> Array:
        """(m, 3) m: the ground under the middle of each body, in the order of `persons`."""
        position = self._crowd_state.position
        return np.column_stack([position, self.world.terrain.height_at(position)])

    def joints(self) -> Array:
        """(m, 17, 3) m: key points in the order of pedestrian.COCO, world frame."""
        return self._joints

    def odometry(self) -> dict[str, Odometry]:
        """Each rover's motion since the frame before; empty at frame 0."""
        return dict(self._odometry)

    def tipped(self) -> dict[str, bool]:
        """Whether each rover leans by more than 45 degrees."""
        return {name: bool(self.T_world_robot(name).rotation[2, 2] < TIPPED) for name in self.robots}

    def _compile(self, people: list[np.random.Generator]) -> mujoco.MjModel:
        spec = self.world.spec.copy()
        for i, name in enumerate(self.robots):
            rover.add_rover(spec, name, i, self.scenario.camera_height)
        for person, stature, rng in zip(self.persons, self._stature, people, strict=True):
            clothes.add_person(spec, f"person_{person}", float(stature), rng)
        self._crowd_steps = max(1, round(self.scenario.period / CROWD_STEP))
        self._dt = self.scenario.period / self._crowd_steps
        self._substeps = max(1, round(self._dt / TIMESTEP))
        spec.option.timestep = self._dt / self._substeps
        # A round friction cone: wheels that skid are held back along their skid, not along the axes of a pyramid.
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        return spec.compile()

    def _index(self) -> None:
        """Where rovers and people are in the arrays of MuJoCo."""
        m = self.model
        joint = [[m.joint(name).id for name in (robot, *(f"{robot}/{wheel}" for wheel in rover.WHEELS))] for robot in self.robots]
        joints = np.array(joint)
        self._poses = m.jnt_qposadr[joints[:, 0]][:, None] + np.arange(7)
        self._velocities = m.jnt_dofadr[joints[:, 0]][:, None] + np.arange(6)
        self._wheel_qpos = m.jnt_qposadr[joints[:, 1:]]
        self._motors = np.array([[m.actuator(f"{robot}/{wheel}").id for wheel in rover.WHEELS] for robot in self.robots])
        limbs = [[m.body(f"person_{p}/{limb}").mocapid[0] for limb in (*pedestrian.LIMBS, "collider")] for p in self.persons]
        mocap = np.array(limbs, dtype=np.int64).reshape(-1, len(pedestrian.LIMBS) + 1)
        self._limbs, self._colliders = mocap[:, :-1], mocap[:, -1]
        owners = {f"person_{p}": (int(p), 0) for p in self.persons} | {robot: (0, i + 1) for i, robot in enumerate(self.robots)}
        names = [m.body(int(body)).name.split("/")[0] for body in m.geom_bodyid]
        owner = np.array([owners.get(name, (0, 0)) for name in names], dtype=np.int64).reshape(-1, 2)
        self.person_of_geom, self.robot_of_geom = owner[:, 0].copy(), owner[:, 1].copy()

    def _place_rovers(self) -> None:
        """Rovers apart from each other on the ground, as it slopes, heading anywhere."""
        rng = self.scenario.stream("robots/start")
        room = driving.room_to_turn(self.world.wheels)
        try:
            places = room.sample(rng, len(self.robots), 0.1, APART)
        except ValueError as error:
            raise ValueError(f"robots is {len(self.robots)}, more than {self.scenario.world} holds: {error}") from None
        for index, place, yaw in zip(self._poses, places, rng.uniform(-np.pi, np.pi, len(places)), strict=True):
            self.data.qpos[index] = self._resting(place, yaw)
        self._drivers = [driving.make_driver(room, self.scenario.stream(f"{name}/goals")) for name in self.robots]
        self._drives = [driver.start(place) for driver, place in zip(self._drivers, places, strict=True)]
        self._ctrl = np.zeros(self._motors.shape)
        self._wear = [odometry.Wear.draw(self.scenario.stream(f"{name}/wear")) for name in self.robots]
        self._noise = [self.scenario.stream(f"{name}/odometry") for name in self.robots]
        self._odometry: dict[str, Odometry] = {}

    def _resting(self, place: Array, yaw: float) -> Array:
        """(7,) position and quaternion of a rover with its wheels a little above the ground at place (2,) m."""
        wheels = rover.wheel_positions()[:, :2] @ rotation_z(yaw)[:2, :2].T
        height = self.world.terrain.height_at(place + wheels)
        A = np.column_stack([wheels, np.ones(4)])
        east, north, middle = np.linalg.lstsq(A, height, rcond=None)[0]
        up = np.array([-east, -north, 1.0]) / np.sqrt(1 + east**2 + north**2)
        x = rotation_z(yaw)[:, 0] - (rotation_z(yaw)[:, 0] @ up) * up
        x = x / np.linalg.norm(x)
        highest = middle + float((height - A @ [east, north, middle]).max())
        R = np.stack([x, np.cross(up, x), up], axis=1)
        return np.concatenate([[*place, highest + (rover.WHEEL_RADIUS + 0.01) / up[2]], quaternion_from_rotation(R)])

    def _place_people(self, people: list[np.random.Generator]) -> None:
        """People apart from each other and from the rovers."""
        rng, wanted = self.scenario.stream("people/start"), len(people)
        robots = self.data.qpos[self._poses[:, :2]]
        # About three places may be too near to each rover.
        try:
            places = self.world.feet.sample(rng, wanted + 3 * len(robots) if wanted else 0, 0.1, 0.8)
        except ValueError as error:
            raise ValueError(f"people is {wanted}, more than {self.scenario.world} holds: {error}") from None
        clear = np.linalg.norm(places[:, None] - robots, axis=2).min(axis=1, initial=np.inf) > 1.0
        places = places[clear][:wanted]
        if len(places) < wanted:
            raise ValueError(f"people is {wanted}, needs at most {len(places)}: more do not fit beside {len(robots)} robots")
        heading = rng.uniform(-np.pi, np.pi, wanted)
        self._crowd = Crowd(self.world.feet, self.world.terrain, make_plans(self.world.feet, people, self.scenario.stream("people/goals")))
        self._crowd_state: CrowdState = self._crowd.start(places, heading)
        self._footing = gait.stand(places, heading, self._stature)
        self._pose_people()

    def _settle(self) -> None:
        for _ in range(round(SETTLING / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
        self.data.qvel[:] = 0.0
        self.data.time = 0.0
        mujoco.mj_forward(self.model, self.data)

    def _heading(self) -> Array:
        """(robots, 2) unit directions of the rovers' x axes in the plane, and m/s along them in the third column."""
        poses, velocity = self.data.qpos[self._poses], self.data.qvel[self._velocities]
        x = np.array([rotation_from_quaternion(q)[:, 0] for q in poses[:, 3:]])
        return np.column_stack([x[:, :2], np.einsum("ri,ri->r", x, velocity[:, :3])])

    def _move_people(self) -> None:
        """The crowd and its colliders one crowd step on."""
        if not len(self.persons):
            return
        position, velocity = self.data.qpos[self._poses[:, :2]], self.data.qvel[self._velocities[:, :2]]
        obstacles = Obstacles(position, velocity, np.full(len(position), rover.FOOTPRINT_RADIUS))
        state = self._crowd.step(self._crowd_state, obstacles, self._dt)
        self._footing = gait.walk(self._footing, gait.Bodies(state.position, state.velocity, state.heading, self._stature), self._dt)
        self._crowd_state = state
        self.data.mocap_pos[self._colliders] = self.feet()

    def _drive(self) -> Array:
        """The rovers one crowd step on; (substeps, robots, 3) rad/s of their bodies."""
        position, heading = self.data.qpos[self._poses[:, :2]], self._heading()
        yaw_rate = self.data.qvel[self._velocities[:, 5]]
        people = self._crowd_state.position
        for i, driver in enumerate(self._drivers):
            others = np.delete(position, i, axis=0)
            radius = np.concatenate([np.full(len(others), 0.4), np.full(len(people), pedestrian.RADIUS)])
            traffic = Traffic(np.concatenate([others, people]), radius)
            motion = Motion(position[i], float(np.arctan2(heading[i, 1], heading[i, 0])), float(heading[i, 2]), float(yaw_rate[i]))
            self._drives[i] = driver.step(self._drives[i], motion, traffic, self._dt)
        goal = np.array([rover.wheel_speeds(d.speed, d.yaw_rate, w) for d, w in zip(self._drives, yaw_rate, strict=True)])
        before, self._ctrl = self._ctrl, goal
        rates = np.empty((self._substeps, len(self.robots), 3))
        for k in range(self._substeps):
            self.data.ctrl[self._motors] = before + (goal - before) * (k + 1) / self._substeps
            mujoco.mj_step(self.model, self.data)
            rates[k] = self.data.qvel[self._velocities[:, 3:]]
        return rates

    def _pose_people(self) -> None:
        """All limbs where they are now."""
        state = self._crowd_state
        poses = pedestrian.pose(self._stature, self._footing, state.position, state.heading, self.world.terrain)
        self.data.mocap_pos[self._limbs], self.data.mocap_quat[self._limbs] = poses.position, poses.quaternion
        self.data.mocap_pos[self._colliders] = self.feet()
        self._joints = poses.joints

    def _reckon(self, rates: Array, wheels: Array, velocity: Array) -> None:
        """The odometry of the frame that has just ended."""
        acceleration = (self.data.qvel[self._velocities[:, :3]] - velocity[:, :3]) / self.scenario.period
        for i, name in enumerate(self.robots):
            R = self.T_world_robot(name).rotation
            angles = np.stack([wheels[i], self.data.qpos[self._wheel_qpos[i]]])
            ride = odometry.Ride(rates[:, i], self.model.opt.timestep, angles, R.T @ acceleration[i], R[2])
            self._odometry[name] = odometry.measure(ride, self._wear[i], self._noise[i])
