"""Sweeps as data: ids, and what each sweep changes."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.cameras import parse_camera
from sim.policies.rollouts import BUILT_IN_POLICIES, LEARNED
from sim.scenario import Scenario
from sim.stress.sweeps import (
    CAMERA_SWEEPS,
    OWN_GOALS,
    POLICIES,
    RECORDING_SWEEPS,
    ROOM_SWEEPS,
    SWEEPS,
    cases,
    default_scenario,
    recording_cases,
    saturated,
)
from sim.stress.trial_data import simulate_case
from tests.tracker.recordings.test_folder import small
from tracker.detector_models.model import model_of
from tracker.options import parameters_from
from tracker.recordings.folder import write_recording


@pytest.mark.parametrize("named", [(), CAMERA_SWEEPS, ROOM_SWEEPS], ids=["all", "cameras", "room"])
def test_cases_have_unique_ids_that_name_a_value(named: Iterable[str]) -> None:
    start, known = default_scenario(7), SWEEPS | CAMERA_SWEEPS | ROOM_SWEEPS
    every = cases(named, start)
    assert {case.sweep for case in every} == set(named or SWEEPS)
    assert len({case.id for case in every}) == len(every) == sum(len(known[name].values) for name in named or SWEEPS)
    for case in every:
        assert case.value == known[case.sweep].values[int(case.id.split("/")[1])]
        parameters_from(case.options)


def test_a_sweep_changes_its_parameter_only() -> None:
    start = default_scenario()
    for case in cases((), start):
        changed = {name for name in Scenario.__dataclass_fields__ if getattr(case.scenario, name) != getattr(start, name)}
        assert case.policy == ("" if case.sweep != "placement" else case.value)
        named = {case.parameter, "world"} | ({"frames"} if case.sweep == "rate" else set())
        assert changed <= named, case.id
        assert set(case.faults.to_dict()) <= {case.parameter}
    assert {round(case.scenario.frames / case.scenario.rate, 6) for case in cases(["rate"], start)} == {10.0}
    assert set(POLICIES) - {OWN_GOALS} <= {*BUILT_IN_POLICIES, LEARNED}


def test_a_world_of_the_user_is_that_of_all_sweeps() -> None:
    assert {case.scenario.world for case in cases(["density", "placement"], default_scenario())} == {"ruins"}
    assert {case.scenario.world for case in cases([], replace(default_scenario(), world="my.glb"))} == {"my.glb"}


def test_single_cases_and_unknown_names() -> None:
    assert [case.id for case in cases(["slip/2", "density/0", "slip/2"], default_scenario())] == ["slip/2", "density/0"]
    with pytest.raises(ValueError, match=r"--sweep is 'weather', needs one of density, difficulty, robots"):
        cases(["weather"], default_scenario())
    with pytest.raises(ValueError, match=r"needs slip/0 to slip/4"):
        cases(["slip/5"], default_scenario())


def test_sweeps_of_a_recording(tmp_path: Path) -> None:
    start = default_scenario(5)
    every = recording_cases([], str(tmp_path), 2, start)
    assert {case.sweep for case in every} == set(RECORDING_SWEEPS)
    assert [case.value for case in every if case.sweep == "recorded_cameras"] == [0, 1]
    assert [case.id for case in recording_cases(["recorded_misses/2"], str(tmp_path), 2, start)] == ["recorded_misses/2"]
    with pytest.raises(ValueError, match="--sweep is 'density', needs one of recorded_misses"):
        recording_cases(["density"], str(tmp_path), 2, start)


def test_a_recording_is_changed_as_its_case_says(tmp_path: Path) -> None:
    write_recording(tmp_path, small())
    counts = {}
    for case in recording_cases(["recorded_misses", "recorded_cameras", "recorded_clutter"], str(tmp_path), 2, default_scenario(3)):
        data = simulate_case(case, rendered=False)
        counts[case.id] = len(data.tracker_setup.mounts), sum(len(view.detections) for tick in data.ticks for view in tick.views)
        assert len(data.truth) == len(data.ticks) == 3
    assert counts["recorded_misses/0"] == (2, 3)
    assert counts["recorded_misses/3"][1] < 3
    assert counts["recorded_cameras/1"] == (1, 3)
    assert counts["recorded_clutter/3"][1] > 10


def test_camera_sweeps_change_cameras_or_driving() -> None:
    start = default_scenario(4)
    chosen = {case.id: case.scenario for case in cases(CAMERA_SWEEPS, start)}
    assert chosen["readout/0"] == chosen["mount_angle/0"] == chosen["blur/0"] == start
    assert chosen["readout/4"].camera_effects.readout == 0.033
    assert (chosen["roughness_fast/1"].difficulty, chosen["roughness_fast/1"].speed) == (0.25, 1.2)
    assert parse_camera(chosen["seam/4"].camera).values["baseline"] == 0.03
    both = cases(["mount_shift/2"], replace(start, effects="readout=0.02"))[0].scenario.camera_effects.given()
    assert both == {"readout": 0.02, "mount_shift": 0.02}
    with pytest.raises(ValueError, match="--sweep seam needs --camera dual-fisheye"):
        cases(["seam"], replace(start, camera="fisheye"))


def test_a_sweep_replaces_what_the_user_set() -> None:
    start = replace(default_scenario(4), effects="readout=0.02,vignette=1.0", camera="dual-fisheye:baseline=0.02,output=stitched")
    assert [case.scenario.camera_effects.readout for case in cases(["readout"], start)] == [None, 0.005, 0.01, 0.02, 0.033]
    assert [parse_camera(case.scenario.camera).values["baseline"] for case in cases(["seam"], start)] == [0.0, 0.005, 0.01, 0.02, 0.03]
    assert {case.scenario.camera_effects.vignette for case in cases(["readout", "seam"], start)} == {1.0}


def test_the_tracker_is_told_wrong_mounts_and_the_truth_is_not() -> None:
    case = cases(["mount_angle/4"], replace(default_scenario(2), robots=1, people=0))[0]
    data = simulate_case(case, rendered=False)
    (name, true), told = next(iter(data.setup.mounts.items())), data.tracker_setup.mounts
    turned = (true.T_body_camera.inverse() @ told[name].T_body_camera).log()[3:]
    assert np.degrees(np.linalg.norm(turned)) == pytest.approx(2.0)


def test_sweeps_of_a_room_have_its_cameras() -> None:
    start = default_scenario(12, 256)
    made = cases(ROOM_SWEEPS, start)
    for case in made:
        assert (case.scenario.world, case.scenario.robots, case.scenario.frames, case.source) == ("hall:room=7.7x3.4", 0, 12, "room")
    assert [case.scenario.people for case in made if case.sweep == "room"] == [3, 10, 15, 20]
    models = [model_of(case.scenario.detector_model) for case in made if case.sweep == "lasting"]
    assert [model.standing.sites for model in models if model] == [0, 1, 2, 4, 8]
    with pytest.raises(ValueError, match=r"--sweep detectors varies the independent detector"):
        cases(["detectors"], replace(start, detector_model="fairmot"))


@pytest.mark.render
def test_a_case_of_a_room_is_seen_by_four_corner_cameras() -> None:
    (case,) = cases(["room/0"], default_scenario(3, 256))
    data = simulate_case(case.with_seed(1), rendered=True)
    assert list(data.setup.mounts) == ["View_001", "View_002", "View_003", "View_004"]
    assert [len(truth.person_id) for truth in data.truth] == [3, 3, 3]
    assert sum(len(view.detections) for tick in data.ticks for view in tick.views) > 12


def test_a_sweep_tells_nothing_where_all_scores_are_nearly_perfect() -> None:
    def row(sweep: str, number: int, mota: float, idf1: float) -> dict[str, object]:
        return {"sweep": sweep, "id": f"{sweep}/{number}", "scores": {"mota": mota, "idf1": idf1}}

    easy = [row("easy", 0, 0.99, 1.0), row("easy", 1, 0.985, 0.99), {"sweep": "easy", "id": "easy/2", "scores": None}]
    hard = [row("hard", 0, 0.99, 1.0), row("hard", 1, 0.99, 0.97)]
    assert saturated([*hard, *easy]) == ["easy"]
    # A single value is no sweep.
    assert saturated([row("one", 0, 1.0, 1.0), row("one", 0, 1.0, 1.0)]) == []
    assert saturated([]) == []
