import json
import math

import numpy as np
import pytest

from sim.scenario import BOUNDS, Scenario


def test_round_trip_is_exact():
    scenario = Scenario(world="hills", difficulty=1 / 3, seed=2**62 + 1, robots=7, people=0, frames=1, rate=7.1, width=66, bearing_noise=1e-17)
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario
    assert again.to_json() == scenario.to_json()


def test_whole_numbers_become_floats_where_floats_are_meant():
    assert Scenario(rate=6) == Scenario(rate=6.0)
    assert Scenario(rate=6).to_json() == Scenario(rate=6.0).to_json()


@pytest.mark.parametrize("name", sorted(BOUNDS))
def test_bounds_belong_to_the_values(name):
    low, high = BOUNDS[name]
    # Windows glare on facades alone.
    others = {"facades": 1} if name == "glare" else {}
    for value in (low, high):
        assert getattr(Scenario(**{name: value}, **others), name) == value
    for value in (low - 1, high + 1, math.nan, math.inf, "1", None, True):
        with pytest.raises(ValueError, match=f"{name} is .*needs"):
            Scenario(**{name: value}, **others)


@pytest.mark.parametrize(("name", "value"), [("frames", 1.0), ("robots", 2.5), ("width", 101), ("world", ""), ("world", 3)])
def test_values_of_the_wrong_kind(name, value):
    with pytest.raises(ValueError, match=f"{name} is "):
        Scenario(**{name: value})


def test_fields_are_neither_unknown_nor_missing():
    content = json.loads(Scenario().to_json())
    with pytest.raises(ValueError, match=r"unknown fields .*colour"):
        Scenario.from_json(json.dumps(content | {"colour": 1}))
    del content["seed"]
    with pytest.raises(ValueError, match=r"lacks the fields .*seed"):
        Scenario.from_json(json.dumps(content))
    for text in ("[]", "3", "{", ""):
        with pytest.raises(ValueError, match=r"."):
            Scenario.from_json(text)


def test_period_and_height():
    scenario = Scenario(rate=8.0, width=512)
    assert scenario.period == 0.125
    assert scenario.height == 256


def test_streams_are_repeatable_and_independent():
    def draw(seed: int, name: str) -> np.ndarray:
        return Scenario(seed=seed).stream(name).random(1000)

    np.testing.assert_array_equal(draw(3, "a"), draw(3, "a"))
    assert abs(np.corrcoef(draw(3, "a"), draw(3, "b"))[0, 1]) < 0.1
    assert abs(np.corrcoef(draw(3, "a"), draw(4, "a"))[0, 1]) < 0.1


def test_streams_do_not_depend_on_other_fields():
    assert Scenario(people=3).stream("x").random() == Scenario(people=30).stream("x").random()
