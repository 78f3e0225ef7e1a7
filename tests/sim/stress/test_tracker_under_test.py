"""Trackers under test: options of pilsim's own, functions by name, and errors of faulty ones."""

import re

import pytest

from sim.scenario import Scenario
from sim.stress.sweeps import Case
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.stress.trial_data import TrialData, simulate_case


@pytest.fixture(scope="module")
def data() -> TrialData:
    scenario = Scenario(seed=1001, robots=1, people=2, frames=3, width=256)
    return simulate_case(Case("x/0", "x", "people", 2, scenario), rendered=False)


def sample(name: str) -> TrackerUnderTest:
    return TrackerUnderTest(f"tests.sim.sample_trackers:{name}")


def test_a_function_by_name_gives_the_results_of_the_same_function(data: TrialData) -> None:
    ours, theirs = (c.results_of(data.tracker_setup, data.ticks, "x/0/1") for c in (TrackerUnderTest(), sample("good")))
    assert ours.frames == theirs.frames == 3
    for own, other in zip(ours.tracks.values(), theirs.tracks.values(), strict=True):
        assert (own[0] == other[0]).all()
        assert (own[1] == other[1]).all()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("short", "gave 2 estimates, needs 3"),
        ("long", "gave more than 3 estimates"),
        ("twice", "gave a target twice in frame 0"),
        ("robotless", "no pose and covariance (6, 6) of robot_0 in frame 0"),
        ("numbers", "gave a int for frame 0, needs an Estimate"),
    ],
)
def test_faulty_estimates_are_refused(data: TrialData, name: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        sample(name).results_of(data.tracker_setup, data.ticks, "x/0/1")


def test_unknown_functions_are_refused(data: TrialData) -> None:
    for name, message in (
        ("nothing", "needs module:function"),
        ("no.such:track", "no"),
        ("tests.sim.sample_trackers:absent", "has no function absent"),
    ):
        with pytest.raises(ValueError, match=message):
            TrackerUnderTest(name).estimates(data.tracker_setup, data.ticks)


def test_options_of_a_case_override_those_of_the_tracker() -> None:
    changed = TrackerUnderTest(options={"slam": "ekf", "correction": "on"}).with_options({"slam": "iekf"})
    assert changed.options == {"slam": "iekf", "correction": "on"}
    with pytest.raises(ValueError, match="options slam are of the default tracker"):
        TrackerUnderTest("tests.sim.sample_trackers:good", {"slam": "ekf"})
