"""Umbrellas: in the hand of a raised arm, over the head, and no part of the body."""

import mujoco
import numpy as np
import pytest

from sim.pedestrian import gait, skeleton
from sim.pedestrian.skeleton import FOREARM, UPPER_ARM, trunk_size
from sim.pedestrian.umbrella import RIM, TOP, add_umbrella, umbrella_places, with_raised_arms
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.yard import yard
from tracker.types import KEYPOINT_NAMES
from worlds.terrain.heightfield import Heightfield

STATURE = np.array([1.2, 1.6, 1.75, 1.95])
HEADING = np.array([0.3, -2.0, 1.5, 3.0])


def test_arms_keep_their_lengths_and_umbrellas_are_over_heads():
    ground, position = Heightfield.flat([[-3, -3], [9, 9]], 0.1), np.column_stack([np.arange(4.0), np.zeros(4)])
    before = skeleton.limb_poses(STATURE, gait.stand(position, HEADING, STATURE), position, HEADING, ground)
    holders = np.array([0, 2, 3])
    after = with_raised_arms(before, holders, STATURE, HEADING)
    np.testing.assert_array_equal(after.joints[1], before.joints[1])
    joint = {name: after.joints[holders, k] for k, name in enumerate(KEYPOINT_NAMES)}
    size = trunk_size(STATURE[holders])
    assert np.linalg.norm(joint["right_elbow"] - joint["right_shoulder"], axis=1) == pytest.approx(UPPER_ARM * size)
    assert np.linalg.norm(joint["right_wrist"] - joint["right_elbow"], axis=1) == pytest.approx(FOREARM * size)
    hand = umbrella_places(after.position[holders], after.quaternion[holders], STATURE[holders])
    assert np.linalg.norm(hand - joint["right_wrist"], axis=1) == pytest.approx(0.045 * size)
    assert (hand[:, 2] + RIM > STATURE[holders] - 0.02).all()
    assert np.linalg.norm((hand - joint["nose"])[:, :2], axis=1).max() < 0.45


def test_an_umbrella_is_as_high_as_stated():
    spec = mujoco.MjSpec()
    add_umbrella(spec, "umbrella3", np.random.default_rng(0))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    heights = (model.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0])[:, 2]
    assert heights.max() == pytest.approx(TOP + 0.04, abs=0.01)
    assert not model.geom_contype.any()


@pytest.mark.soak
def test_umbrellas_follow_hands_and_belong_to_nobody():
    scenario = Scenario(robots=1, people=8, at_once=5, frames=4, umbrellas=0.6, seed=2)
    simulation = Simulation(scenario, yard())
    simulation.keep_steps = True
    simulation.step()
    model, data = simulation.model, simulation.data
    geoms = [k for k in range(model.ngeom) if model.geom(k).name.startswith("umbrella")]
    assert 2 <= len(geoms) <= 8
    assert not simulation.person_of_geom[geoms].any()
    present, shown = simulation.persons.tolist(), 0
    for k in geoms:
        person, body = int(model.geom(k).name.removeprefix("umbrella")), model.body(model.geom(k).name).mocapid[0]
        assert (model.geom_group[k] == 2) == (person in present)
        if person in present:
            wrist = simulation.joints()[present.index(person)][KEYPOINT_NAMES.index("right_wrist")]
            assert np.linalg.norm(data.mocap_pos[body] - wrist) < 0.1
            before = simulation.past(0.1).mocap_pos[body]
            assert 1e-4 < np.linalg.norm(before - data.mocap_pos[body]) < 0.3
            shown += 1
    assert shown
