import mujoco
import numpy as np
import pytest

from sim.scenario import Scenario
from sim.simulation.simulation import Simulation, furnished
from tests.sim.footfalls import Footfalls
from tests.sim.yard import yard
from tracker.geometry import Pose
from tracker.types import KEYPOINT_NAMES
from worlds import catalogue

SMALL = Scenario(robots=2, people=3, frames=6, rate=6.0)


class Run:
    """Twenty seconds of pilsun, recorded."""

    def __init__(self) -> None:
        self.scenario = Scenario(frames=121)
        self.simulation = s = Simulation(self.scenario)
        self.poses = {name: [s.T_world_robot(name)] for name in s.robots}
        self.odometry, self.feet, self.tipped = [], [s.feet()], []
        for _ in range(self.scenario.frames - 1):
            s.step()
            for name in s.robots:
                self.poses[name].append(s.T_world_robot(name))
            self.odometry.append(s.odometry())
            self.feet.append(s.feet())
            self.tipped.append(any(s.tipped().values()))


@pytest.fixture(scope="module")
def run() -> Run:
    return Run()


@pytest.fixture
def small() -> Simulation:
    return Simulation(SMALL, yard())


@pytest.mark.soak
def test_rovers_drive_and_stay_upright(run):
    way = [np.linalg.norm(np.diff([p.translation for p in poses], axis=0), axis=1).sum() for poses in run.poses.values()]
    # One may have to wait long for people in a narrow place.
    assert np.median(way) > 3.0
    assert min(way) > 0.5
    assert not any(run.tipped)
    tilt = np.degrees(np.arccos([p.rotation[2, 2] for poses in run.poses.values() for p in poses]))
    assert tilt.mean() < 4.0


@pytest.mark.soak
def test_single_frames_of_odometry_fit_their_covariance(run):
    nees, components = [], []
    for name, poses in run.poses.items():
        for k, odometry in enumerate(run.odometry):
            error = (odometry[name].T_before_now.inverse() @ (poses[k].inverse() @ poses[k + 1])).log()
            nees.append(error @ np.linalg.solve(odometry[name].covariance, error) / 6)
            components.append(error**2 / np.diag(odometry[name].covariance))
    assert 0.2 < np.median(nees) < 1.5
    assert np.quantile(components, 0.95, axis=0).max() < 9.0
    # Now and then wheels spin before something that they do not get over; no encoder knows it.
    assert np.mean(np.array(nees) > 10) < 0.02


@pytest.mark.soak
def test_people_walk_in_free_space(run):
    feet = np.array(run.feet)
    world = run.simulation.world
    assert world.feet.clearance_at(feet[..., :2].reshape(-1, 2)).min() > 0
    assert np.linalg.norm(np.diff(feet[..., :2], axis=0), axis=2).sum(axis=0).min() > 3.0


@pytest.mark.soak
def test_people_and_rovers_keep_apart(run):
    robots = np.array([[p.translation[:2] for p in poses] for poses in run.poses.values()])
    gap = np.linalg.norm(np.array(run.feet)[None, :, :, :2] - robots[:, :, None], axis=-1)
    assert (gap < 0.6).mean() < 0.002


def test_model_and_data_represent_the_current_frame(small):
    small.step()
    xpos, geoms = small.data.xpos.copy(), small.data.geom_xpos.copy()
    mujoco.mj_kinematics(small.model, small.data)
    np.testing.assert_array_equal(small.data.xpos, xpos)
    np.testing.assert_array_equal(small.data.geom_xpos, geoms)
    for name in small.robots:
        np.testing.assert_allclose(small.T_world_robot(name).translation, small.data.body(name).xpos, atol=1e-12)
        np.testing.assert_allclose(small.T_world_robot(name).rotation.ravel(), small.data.body(name).xmat, atol=1e-9)
    assert small.frame == 1
    assert small.time == pytest.approx(1 / 6)
    assert small.data.time == pytest.approx(1 / 6)


def test_people_stand_on_the_ground_at_their_true_positions(small):
    for _ in range(4):
        small.step()
    feet, joints = small.feet(), small.joints()
    np.testing.assert_allclose(feet[:, 2], small.world.ground.height_at(feet))
    assert joints.shape == (3, len(KEYPOINT_NAMES), 3)
    np.testing.assert_allclose(joints[:, 11:13, :2].mean(axis=1), feet[:, :2], atol=0.02)
    for person, place in zip(small.persons, feet, strict=True):
        np.testing.assert_allclose(small.data.body(f"person_{person}/collider").xpos, place)
        np.testing.assert_allclose(small.data.body(f"person_{person}/pelvis").xpos[:2], place[:2])


def test_owners_of_geoms(small):
    assert small.robots == ("robot_0", "robot_1")
    np.testing.assert_array_equal(small.persons, [1, 2, 3])
    assert set(small.person_of_geom) == {0, 1, 2, 3}
    assert set(small.robot_of_geom) == {0, 1, 2}
    assert not ((small.person_of_geom > 0) & (small.robot_of_geom > 0)).any()
    for k in range(small.model.ngeom):
        name = small.model.geom(k).name
        assert small.person_of_geom[k] == (int(name.split("/")[0][7:]) if name.startswith("person_") else 0)
        assert small.robot_of_geom[k] == (int(name.split("/")[0][6:]) + 1 if name.startswith("robot_") else 0)


def test_frame_0_is_at_rest_and_has_no_odometry(small):
    assert small.odometry() == {}
    assert small.time == 0
    # The rovers have settled: level ground would have the camera at its height.
    for name in small.robots:
        camera = (small.T_world_robot(name) @ small.mount(name)).translation
        T = small.T_world_robot(name)
        below = T.translation - 0.12 * T.rotation[:, 2]
        assert abs(below[2] - small.world.ground.height_at(below[None])[0]) < 0.03
        assert abs(camera[2] - small.world.ground.height_at(camera[None])[0] - SMALL.camera_height) < 0.08
    small.step()
    assert set(small.odometry()) == set(small.robots)


def test_another_person_does_not_change_the_rovers_random_draws():
    first, second = (Simulation(Scenario(robots=2, people=people), yard()) for people in (0, 4))
    for name in first.robots:
        np.testing.assert_allclose(first.T_world_robot(name).log(), second.T_world_robot(name).log(), atol=1e-9)
    first.step()
    second.step()
    for name in first.robots:
        true = [(s.odometry()[name].T_before_now, s.odometry()[name].gravity) for s in (first, second)]
        np.testing.assert_allclose(true[0][0].log(), true[1][0].log(), atol=1e-6)


@pytest.mark.parametrize("rate", [1.0, 7.0, 60.0])
def test_steps_divide_the_period_exactly(rate):
    simulation = Simulation(Scenario(robots=1, people=1, rate=rate), yard())
    assert 0.003 < simulation.model.opt.timestep < 0.008
    simulation.step()
    assert simulation.data.time == pytest.approx(1 / rate, rel=1e-9)


@pytest.mark.soak
def test_pairs_of_limbs_of_a_large_crowd_need_no_memory():
    simulation = Simulation(Scenario(robots=1, people=250, at_once=3), yard())
    simulation.step()
    assert simulation.data.ncon == 0
    assert len(simulation.feet()) == 3


def test_what_does_not_fit_is_refused(small):
    with pytest.raises(ValueError, match="robot is 'robot_9'"):
        small.T_world_robot("robot_9")
    with pytest.raises(ValueError, match="world is 'nowhere'"):
        Simulation(Scenario(world="nowhere"))
    with pytest.raises(ValueError, match="fit"):
        Simulation(Scenario(robots=60), yard())


def test_a_rover_on_its_side_is_reported(small):
    small.data.qpos[small.model.joint("robot_0").qposadr[0] + 3 :][:4] = [np.cos(0.6), np.sin(0.6), 0.0, 0.0]
    assert small.tipped() == {"robot_0": True, "robot_1": False}
    assert isinstance(small.T_world_robot("robot_0"), Pose)


@pytest.mark.parametrize(
    ("world", "difficulty"),
    [
        ("pilsun", 1.0),
        *(pytest.param(world, 1.0, marks=pytest.mark.soak) for world in sorted(set(catalogue.WORLDS) - {"pilsun"})),
    ],
)
def test_feet_do_not_slide_float_or_sink_and_knees_stay_open(world, difficulty):
    footfalls = Footfalls(Simulation(Scenario(world=world, difficulty=difficulty, seed=3, robots=1, people=12, rate=12.0)), 40)
    assert len(footfalls.gap) > 400
    footfalls.are_human()


def test_a_restored_state_goes_on_the_same():
    simulation = Simulation(Scenario(robots=2, people=6, at_once=3, frames=40), yard())

    def moment() -> list[bytes]:
        odometry = [o.T_before_now.log() for o in simulation.odometry().values()]
        data = simulation.data
        return [a.tobytes() for a in (simulation.persons, simulation.feet(), simulation.joints(), data.qpos, data.qacc, data.mocap_pos, *odometry)]

    for _ in range(8):
        simulation.step()
    saved = simulation.save()
    first = []
    for _ in range(20):
        simulation.step()
        first.append(moment())
    simulation.restore(saved)
    assert simulation.frame == 8
    for k in range(20):
        simulation.step()
        assert moment() == first[k]


def test_absent_people_are_not_in_the_truth_or_images_and_block_nobody():
    simulation = Simulation(Scenario(robots=1, people=8, at_once=3, frames=120), yard())
    seen = set()
    for _ in range(119):
        simulation.step()
        here = simulation.persons
        seen |= set(here.tolist())
        assert len(here) <= 3
        assert len(simulation.feet()) == len(simulation.joints()) == len(here)
        drawn = set(simulation.person_of_geom[simulation.model.geom_group < 4].tolist()) - {0}
        assert drawn == set(here.tolist())
        for person in simulation.all_persons.tolist():
            assert (simulation.data.body(f"person_{person}/collider").xpos[2] < -50) == (person not in here)
    assert seen == set(range(1, 9))


def test_more_people_than_fit_are_refused_in_one_line():
    with pytest.raises(ValueError, match="people is 500, more than") as error:
        Simulation(Scenario(robots=1, people=500), yard())
    assert "\n" not in str(error.value)


def test_sitters_are_on_their_seats_now_and_within_a_frame():
    scenario = Scenario(robots=1, people=6, frames=4, sitting=0.5, seed=3)
    world = furnished(yard(), scenario)
    assert len(world.seats) >= 3
    simulation = Simulation(scenario, world)
    simulation.keep_steps = True
    simulation.step()
    sitters = [int(person) for person in simulation.sitting]
    assert len(sitters) == 3
    at = [list(simulation.persons).index(person) for person in sitters]
    hips = simulation.joints()[at][:, [KEYPOINT_NAMES.index("left_hip"), KEYPOINT_NAMES.index("right_hip")]].mean(axis=1)
    gap = np.linalg.norm(hips[:, None, :2] - world.seats[:, :2], axis=2)
    assert gap.min(axis=1).max() < 1e-6
    assert hips[:, 2] - world.seats[gap.argmin(axis=1), 2] == pytest.approx(0.1, abs=0.03)
    np.testing.assert_allclose(simulation.feet()[at][:, :2], hips[:, :2], atol=1e-9)
    body = simulation.model.body(f"person_{sitters[0]}/left_thigh").mocapid[0]
    now = simulation.data.mocap_pos[body].copy()
    np.testing.assert_allclose(simulation.past(0.07).mocap_pos[body], now, atol=1e-9)
    assert Simulation(SMALL, yard()).sitting is None
