"""Trackers under trial: options of ours, functions of others, and what is said of those that break."""

import re

import pytest

from sim.scenario import Scenario
from sim.stress.footage import TrialData, simulate_case
from sim.stress.sweeps import Case
from sim.stress.tracker_under_test import TrackerUnderTest


@pytest.fixture(scope="module")
def footage() -> TrialData:
    scenario = Scenario(seed=1001, robots=1, people=2, frames=3, width=256)
    return simulate_case(Case("x/0", "x", "people", 2, scenario), rendered=False)


def of(name: str) -> TrackerUnderTest:
    return TrackerUnderTest(f"tests.sim.contenders:{name}")


def test_a_function_of_somebody_elses_is_as_good_as_ours(footage: TrialData) -> None:
    ours, theirs = (c.results_of(footage.told, footage.ticks, ("x/0", 1)) for c in (TrackerUnderTest(), of("good")))
    assert ours.frames == theirs.frames == 3
    for k in range(3):
        assert (ours.tracks[k][0] == theirs.tracks[k][0]).all()
        assert (ours.tracks[k][1] == theirs.tracks[k][1]).all()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("short", "gave 2 estimates, needs 3"),
        ("long", "gave more than 3 estimates"),
        ("flat", r"position has shape \(2, 2\)"),
        ("twice", "gave a target twice in frame 0"),
        ("nowhere", "position holds NaN"),
        ("robotless", "no pose and covariance (6, 6) of robot_0 in frame 0"),
        ("numbers", "gave a int for frame 0, needs an Estimate"),
    ],
)
def test_what_is_no_estimate_is_refused(footage: TrialData, name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message if "\\" in message else re.escape(message)):
        of(name).results_of(footage.told, footage.ticks, ("x/0", 1))


def test_functions_that_are_not_there(footage: TrialData) -> None:
    for name, message in (("nothing", "needs module:function"), ("no.such:track", "no"), ("tests.sim.contenders:absent", "has no function absent")):
        with pytest.raises(ValueError, match=message):
            TrackerUnderTest(name).estimates(footage.told, footage.ticks)


def test_a_cases_options_go_first() -> None:
    assert TrackerUnderTest(options={"slam": "ekf", "correction": "on"}).with_options({"slam": "iekf"}).options == {
        "slam": "iekf",
        "correction": "on",
    }
    with pytest.raises(ValueError, match="options slam are of the default tracker"):
        TrackerUnderTest("tests.sim.contenders:good", {"slam": "ekf"})
