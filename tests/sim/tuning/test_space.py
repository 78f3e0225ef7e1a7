"""Spaces of parameters and files of them: what is read, what is refused in one line, and that files give back what was written."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.placement.config import PlacementConfig
from sim.stress.tracker_under_test import TrackerUnderTest
from sim.tuning.space import OWN_SPACE, SearchRange, function_defaults, own_defaults, read_space
from tests.benchmarks.nearest_neighbour import GATE, nearest_neighbour
from tracker.options import parameters_from
from tracker.parameter_file import parameters_text, read_parameters, with_fields
from tracker.tracks.parameters import MhtParameters

VALUES = st.one_of(st.booleans(), st.integers(-(2**40), 2**40), st.floats(allow_nan=False, allow_infinity=False), st.text(max_size=8))


def test_the_shipped_space_fits_the_parameters_of_the_tracker() -> None:
    space = read_space(OWN_SPACE)
    defaults = own_defaults(space, "space")
    assert list(defaults) == [one.name for one in space]
    assert all(one.holds(defaults[one.name]) for one in space)
    assert with_fields(MhtParameters(), defaults) == MhtParameters()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no parameter"),
        ("x = 1", "x needs range"),
        ("[x]\nrange = [2.0, 1.0]", "the range from 2.0 to 1.0 is empty"),
        ("[x]\nrange = [1, 1]", "is empty"),
        ("[x]\nrange = [0.0, 1.0]\nlog = true", "needs more than 0"),
        ("[x]\nrange = [0.0, inf]", "needs two finite numbers"),
        ("[x]\nchoices = [1]", "needs two values"),
        ("[x]\nchoices = [1, 1]", "twice"),
        ("[x]\nrange = [1, 2]\nstep = 1", "x needs range"),
        ("[x", "not TOML"),
    ],
)
def test_a_wrong_space_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "space.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"^{path}: [^\n]*{said}[^\n]*$"):
        read_space(path)


@pytest.mark.parametrize(
    ("name", "entry", "said"),
    [
        ("residnece", "range = [1.0, 2.0]", "residnece is unknown; did you mean residence"),
        ("motion", "range = [1.0, 2.0]", "has parts, needs the path of one of them, as motion.acceleration"),
        ("residence", "choices = [true, false]", "is 60.0 by default"),
        ("n_conf", "range = [1.0, 3.0]", "is 2 by default"),
    ],
)
def test_unknown_parameters_of_the_tracker_are_refused(tmp_path: Path, name: str, entry: str, said: str) -> None:
    path = tmp_path / "space.toml"
    path.write_text(f"[{name}]\n{entry}")
    with pytest.raises(ValueError, match=said):
        own_defaults(read_space(path), str(path))


def test_integers_on_a_logarithmic_scale_are_drawn_on_it() -> None:
    rng = np.random.default_rng(0)
    drawn = [SearchRange("k", 1, 1000, log=True).draw(rng) for _ in range(400)]
    assert all(type(value) is int for value in drawn)
    assert 1 in drawn
    assert 150 < sum(value <= 31 for value in drawn) < 250, "half of them are below the middle of the scale"


def test_defaults_of_a_function_are_those_of_its_arguments(tmp_path: Path) -> None:
    path = tmp_path / "space.toml"
    path.write_text("[gate]\nrange = [0.1, 2.0]")
    assert function_defaults(nearest_neighbour, read_space(path), "") == {"gate": GATE}
    path.write_text("[gait]\nrange = [0.1, 2.0]")
    with pytest.raises(ValueError, match="has no argument gait, needs one of gate, least_confidence, lost"):
        function_defaults(nearest_neighbour, read_space(path), "")
    path.write_text("[setup]\nrange = [0.1, 2.0]")
    with pytest.raises(ValueError, match=r"^file: setup has no default in the tracker, needs one$"):
        function_defaults(nearest_neighbour, read_space(path), "file")


@settings(max_examples=40, deadline=None)
@given(st.dictionaries(st.text(min_size=1, max_size=6).filter(lambda name: name.isprintable()), VALUES, max_size=4))
def test_files_of_parameters_give_back_what_was_written(values: dict[str, bool | int | float | str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "best.toml"
        path.write_text(parameters_text(values, ("a comment",)), encoding="utf-8", newline="")
        assert read_parameters(path) == values


def test_parameters_reach_the_tracker_and_options_override_them(tmp_path: Path) -> None:
    path = tmp_path / "best.toml"
    path.write_text('residence = 5\n"detection_rates.log_ratios.0" = 0.2\nn_conf = 4\n[motion]\nfoot_spread = 0.3\n')
    people = parameters_from({"parameters": path, "n_conf": 3}).targets
    assert (people.residence, people.n_conf, people.motion.foot_spread) == (5.0, 3, 0.3)
    assert people.detection_rates.log_ratios == (0.2, MhtParameters().detection_rates.log_ratios[1])
    assert parameters_from({"parameters": read_parameters(path), "n_conf": 3}).targets == people
    path.write_text("n_conf = 2.5")
    with pytest.raises(ValueError, match=rf"^{path}: parameter n_conf is 2.5, needs a whole number$"):
        parameters_from({"parameters": path})
    config = PlacementConfig(observation="tracks", parameters=(("residence", 5.0),))
    assert config == PlacementConfig.of({"observation": "tracks", "parameters": (("residence", 5.0),)})
    with pytest.raises(ValueError, match="parameters are of the observation tracks"):
        PlacementConfig(parameters=(("residence", 5.0),))
    TrackerUnderTest("tests.benchmarks.nearest_neighbour:greedy", {"parameters": {"gate": 0.5}})
    with pytest.raises(ValueError, match="options delay are of the default tracker"):
        TrackerUnderTest("tests.benchmarks.nearest_neighbour:greedy", {"delay": 3})
