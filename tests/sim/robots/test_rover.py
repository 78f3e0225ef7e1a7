import mujoco
import numpy as np
import pytest

from sim.robots import rover
from sim.robots.rover import WHEELS, add_rover, camera_mount, wheel_speeds

CAMERA = 1.5


class Lot:
    """One rover on a level floor."""

    def __init__(self) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.cone, spec.option.integrator = (
            0.005,
            mujoco.mjtCone.mjCONE_ELLIPTIC,
            mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
        )
        spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 1))
        add_rover(spec, "robot_0", 0, CAMERA)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.data.qpos[2] = rover.WHEEL_RADIUS + 0.005
        self.drive(0.0, 0.0, 1.0)

    def drive(self, speed: float, yaw_rate: float, seconds: float) -> np.ndarray:
        """State (n, 13) of the body, qpos and qvel, after each step."""
        states = []
        for k in range(round(seconds / 0.005)):
            ramp = min(1.0, k * 0.005 / 0.8)
            self.data.ctrl[:] = wheel_speeds(ramp * speed, ramp * yaw_rate, self.data.qvel[5])
            mujoco.mj_step(self.model, self.data)
            states.append(np.concatenate([self.data.qpos[:7], self.data.qvel[:6]]))
        mujoco.mj_kinematics(self.model, self.data)
        return np.array(states)

    def yaw(self) -> float:
        x = self.data.body("robot_0").xmat.reshape(3, 3)[:, 0]
        return float(np.arctan2(x[1], x[0]))


@pytest.fixture
def lot() -> Lot:
    return Lot()


def test_weight_and_height(lot):
    assert 20 < lot.model.body_subtreemass[lot.model.body("robot_0").id] < 30
    body = lot.data.body("robot_0")
    camera = body.xpos + body.xmat.reshape(3, 3) @ camera_mount(CAMERA).translation
    np.testing.assert_allclose(camera, [0, 0, CAMERA], atol=0.003)


def test_it_stands_still_and_level(lot):
    states = lot.drive(0.0, 0.0, 2.0)
    assert np.abs(states[:, 7:]).max() < 1e-3
    assert np.linalg.norm(states[-1, 4:6]) < 1e-3


def test_it_drives_straight_at_the_commanded_speed(lot):
    states = lot.drive(0.6, 0.0, 3.0)
    np.testing.assert_allclose(states[-200:, 7], 0.6, rtol=0.03)
    assert abs(lot.data.qpos[1]) < 0.02
    # No jitter: hardly any roll, pitch or heave at speed on the level.
    assert np.abs(states[-200:, 10:12]).max() < 0.02
    assert np.abs(states[-200:, 9]).max() < 0.005


@pytest.mark.parametrize("yaw_rate", [0.6, -0.6])
def test_it_turns_on_the_spot(lot, yaw_rate):
    states = lot.drive(0.0, yaw_rate, 3.0)
    assert 0.7 < states[-200:, 12].mean() / yaw_rate < 1.1
    assert np.linalg.norm(lot.data.qpos[:2]) < 0.05


def test_it_turns_as_it_goes(lot):
    states = lot.drive(0.5, 0.5, 3.0)
    assert 0.7 < states[-200:, 12].mean() / 0.5 < 1.1
    assert 0.4 < np.hypot(*states[-200:, 7:9].T).mean() < 0.55
    assert lot.yaw() > 0.7


def test_wheels_roll_as_far_as_the_body_goes(lot):
    wheels = [lot.model.joint(f"robot_0/{w}").qposadr[0] for w in WHEELS]
    before = lot.data.qpos[wheels].copy()
    lot.drive(0.6, 0.0, 3.0)
    np.testing.assert_allclose(rover.WHEEL_RADIUS * (lot.data.qpos[wheels] - before), lot.data.qpos[0], rtol=0.02)


def test_nothing_is_near_the_camera(lot):
    centre = camera_mount(CAMERA).translation
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(400, 3))
    up = np.ascontiguousarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))
    origin = lot.data.body("robot_0").xpos + lot.data.body("robot_0").xmat.reshape(3, 3) @ centre
    geom = np.zeros(1, dtype=np.int32)
    for direction in up:
        distance = mujoco.mj_ray(lot.model, lot.data, origin, direction, None, 1, -1, geom, None)
        assert distance < 0 or distance > 0.05


def test_no_part_leaves_the_footprint(lot):
    for k in range(lot.model.ngeom):
        geom = lot.model.geom(k)
        if geom.name != "floor":
            reach = np.hypot(*lot.data.geom_xpos[k, :2])
            assert reach < rover.FOOTPRINT_RADIUS
    corner = np.abs(rover.wheel_positions()[0, :2]) + np.array([rover.WHEEL_RADIUS, 0.045])
    assert np.hypot(*corner) < rover.FOOTPRINT_RADIUS


def test_wheel_speeds_are_those_of_a_rigid_body():
    np.testing.assert_allclose(wheel_speeds(0.6, 0.0, 0.0), 0.6 / rover.WHEEL_RADIUS)
    left, right, *_ = wheel_speeds(0.0, 0.5, 0.5)
    assert left == -right < 0
