"""Sweeps as data: ids, what each sweep changes, and cases as JSON."""

import pytest

from sim.policies.rollouts import BUILT_IN_POLICIES
from sim.scenario import Scenario
from sim.stress.sweeps import OWN_GOALS, POLICIES, SWEEPS, Case, cases, default_scenario
from tracker.options import parameters_from


def test_ids_are_unique_and_name_a_value() -> None:
    every = cases((), default_scenario())
    assert len({case.id for case in every}) == len(every) == sum(len(sweep.values) for sweep in SWEEPS.values())
    assert {case.sweep for case in every} == set(SWEEPS)
    for case in every:
        assert case.value == SWEEPS[case.sweep].values[int(case.id.split("/")[1])]
        parameters_from(case.options)


def test_a_sweep_changes_its_parameter_only() -> None:
    start = default_scenario()
    for case in cases((), start):
        changed = {name for name in Scenario.__dataclass_fields__ if getattr(case.scenario, name) != getattr(start, name)}
        assert case.policy == ("" if case.sweep != "placement" else case.value)
        named = {case.parameter, "world"} | ({"frames"} if case.sweep == "rate" else set())
        assert changed <= named, case.id
        assert set(case.faults.to_dict()) <= {case.parameter}
    people = [case.scenario.people for case in cases(["density"], start)]
    assert people == [5, 10, 20, 40, 80, 150]
    seconds = {round(case.scenario.frames / case.scenario.rate, 6) for case in cases(["rate"], start)}
    assert seconds == {10.0}


def test_policies_need_no_file() -> None:
    assert set(POLICIES) - {OWN_GOALS} <= set(BUILT_IN_POLICIES)


def test_cases_travel_as_json() -> None:
    for case in cases((), default_scenario(frames=7)):
        assert Case.from_json(case.with_seed(3).to_json()) == case.with_seed(3)


def test_single_cases_and_unknown_names() -> None:
    assert [case.id for case in cases(["slip/2", "density/0", "slip/2"], default_scenario())] == ["slip/2", "density/0"]
    with pytest.raises(ValueError, match=r"--sweep is 'weather', needs one of density, difficulty, robots"):
        cases(["weather"], default_scenario())
    with pytest.raises(ValueError, match=r"needs slip/0 to slip/4"):
        cases(["slip/5"], default_scenario())
