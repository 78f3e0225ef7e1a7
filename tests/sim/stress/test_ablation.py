"""The oracle ladder: shares add up to the whole, and each rung is as good as the truth."""

from itertools import permutations, product
from math import isclose

import numpy as np
import pytest

from sim.scenario import Scenario
from sim.stress.ablation import STAGES, ablate, associated, replaced, shapley
from sim.stress.faults import Faults
from sim.stress.footage import TrialData, simulate_case
from sim.stress.sweeps import Case
from sim.stress.tracker_under_test import TrackerUnderTest
from tracker.pipeline import Parameters

KEYS = ["".join(bits) for bits in product("01", repeat=4)]


@pytest.fixture(scope="module")
def footage() -> TrialData:
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


def test_a_stage_that_changes_nothing_owns_nothing() -> None:
    values = {key: 0.4 * (key[1] == "1") + 0.2 * (key[2] == "1") for key in KEYS}
    shares = shapley(values)
    assert shares["poses"] == shares["terrain"] == 0.0
    assert isclose(shares["detections"], 0.4)
    assert isclose(shares["association"], 0.2)


def test_the_whole_loss_is_shared_out(footage: TrialData) -> None:
    ladder = ablate(footage, TrackerUnderTest())
    assert set(ladder["combinations"]) == set(KEYS)
    for measure, sign in (("mota", 1.0), ("metres", -1.0)):
        whole = sign * (ladder["combinations"]["1111"][measure] - ladder["combinations"]["0000"][measure])
        assert isclose(sum(ladder[measure][stage] for stage in STAGES), whole, abs_tol=1e-9)
        assert ladder[measure]["total"] == whole
    assert ladder["combinations"]["1111"]["mota"] > ladder["combinations"]["0000"]["mota"]
    assert ladder["combinations"]["1111"]["metres"] < 0.15


def test_every_rung_is_as_good_as_the_truth(footage: TrialData) -> None:
    every = dict.fromkeys(STAGES, True)
    setup, ticks, whose = replaced(footage, every)
    assert setup.ground is footage.setup.ground
    estimates, off = list(associated(setup, ticks, Parameters(), whose)), list[float]()
    for tick, truth, estimate in zip(ticks, footage.truth, estimates, strict=True):
        for robot, pose in truth.T_world_robot.items():
            assert np.linalg.norm((pose.inverse() @ estimate.T_world_robot[robot]).log()) < 1e-6
        where = dict(zip(truth.person_id.tolist(), truth.feet, strict=True))
        # Nobody is mixed up: whoever is told of is that person.
        for person, place in zip(estimate.target_id.tolist(), estimate.position, strict=True):
            off.append(float(np.linalg.norm(place[:2] - where[person][:2])))
        for view, visible in zip(tick.views, truth.visible.T, strict=True):
            shown = set(truth.person_id[visible >= 0.2].tolist())
            assert set(whose.of(view.detections).tolist()) == shown
            assert len(view.detections) == len(shown)
    assert len(estimates[-1].target_id) >= 4
    # One has hidden feet at first, and is where the world leaves it open.
    assert np.quantile(off, 0.9) < 0.3
    assert max(off) < 2.0


def test_nothing_replaced_is_what_the_tracker_got(footage: TrialData) -> None:
    setup, ticks, _ = replaced(footage, dict.fromkeys(STAGES, False))
    assert setup is footage.told
    for before, now in zip(footage.ticks, ticks, strict=True):
        assert all(a is b for a, b in zip(before.views, now.views, strict=True))
