"""Ablation: Shapley values add up to the loss, and replaced stages are as good as the truth."""

from itertools import permutations, product
from math import isclose

import numpy as np
import pytest

from sim.scenario import Scenario
from sim.stress.ablation import STAGES, ablate, shapley, track_with_true_association, with_true_stages
from sim.stress.sweeps import Case, Faults
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData, simulate_case
from tracker.pipeline import Parameters

KEYS = ["".join(bits) for bits in product("01", repeat=4)]


@pytest.fixture(scope="module")
def data() -> TrialData:
    scenario = Scenario(seed=1004, robots=2, people=5, frames=8, width=256, misses=0.3, clutter=0.5)
    return simulate_case(Case("x/0", "x", "people", 5, scenario, Faults(terrain="flat", slip=0.3)), rendered=False)


def test_shares_are_means_over_all_orders_and_add_up() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        values = dict(zip(KEYS, rng.normal(size=16).tolist(), strict=True))
        shares = shapley(values)
        for k, stage in enumerate(STAGES):
            gains = []
            for order in permutations(range(4)):
                before = set(order[: order.index(k)])
                without = "".join("01"[i in before] for i in range(4))
                gains.append(values["".join("01"[i in before or i == k] for i in range(4))] - values[without])
            assert isclose(shares[stage], float(np.mean(gains)), abs_tol=1e-12)
        assert isclose(sum(shares[stage] for stage in STAGES), values["1111"] - values["0000"], abs_tol=1e-12)
        assert shares["total"] == values["1111"] - values["0000"]
    # A stage without effect has the share zero.
    shares = shapley({key: 0.4 * (key[1] == "1") + 0.2 * (key[2] == "1") for key in KEYS})
    assert [round(shares[stage], 12) for stage in STAGES] == [0.0, 0.4, 0.2, 0.0]


def test_shares_add_up_to_the_loss(data: TrialData) -> None:
    ablation = ablate(data, TrackerUnderTest())
    assert set(ablation["combinations"]) == set(KEYS)
    for measure, sign in (("mota", 1.0), ("metres", -1.0)):
        whole = sign * (ablation["combinations"]["1111"][measure] - ablation["combinations"]["0000"][measure])
        assert isclose(sum(ablation[measure][stage] for stage in STAGES), whole, abs_tol=1e-9)
        assert ablation[measure]["total"] == whole
    assert ablation["combinations"]["1111"]["mota"] > ablation["combinations"]["0000"]["mota"]
    assert ablation["combinations"]["1111"]["metres"] < 0.15


def test_replaced_stages_are_as_good_as_the_truth(data: TrialData) -> None:
    every = dict.fromkeys(STAGES, True)
    setup, ticks, persons = with_true_stages(data, every)
    assert setup.ground is data.setup.ground
    estimates, errors = list(track_with_true_association(setup, ticks, Parameters(), persons)), list[float]()
    for tick, truth, estimate in zip(ticks, data.truth, estimates, strict=True):
        for robot, pose in truth.T_world_robot.items():
            assert np.linalg.norm((pose.inverse() @ estimate.T_world_robot[robot]).log()) < 1e-6
        where = dict(zip(truth.person_id.tolist(), truth.feet, strict=True))
        # The id of each estimate is its true person.
        for person, place in zip(estimate.target_id.tolist(), estimate.position, strict=True):
            errors.append(float(np.linalg.norm(place[:2] - where[person][:2])))
        for view, visible in zip(tick.views, truth.visible.T, strict=True):
            shown = set(truth.person_id[visible >= 0.2].tolist())
            assert set(persons.of(view.detections).tolist()) == shown
            assert len(view.detections) == len(shown)
    assert len(estimates[-1].target_id) >= 4
    # The feet of one person are hidden at first, so that its range is not known.
    assert np.quantile(errors, 0.9) < 0.3
    assert max(errors) < 2.0


def test_without_replaced_stages_the_input_is_unchanged(data: TrialData) -> None:
    setup, ticks, _ = with_true_stages(data, dict.fromkeys(STAGES, False))
    assert setup is data.tracker_setup
    for before, now in zip(data.ticks, ticks, strict=True):
        assert all(a is b for a, b in zip(before.views, now.views, strict=True))
