"""The detectors of all views: the same with and without rendering, and as their model says."""

from dataclasses import replace

import numpy as np
import pytest

from sim.recording.frames import raycast_frames
from sim.recording.record import rendered_frames
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.yard import yard
from tracker.detector_models.model import model_text, named_model

SCENARIO = Scenario(seed=21, robots=1, people=8, frames=6, width=256, detector_model="faster-rcnn")


def raycast(scenario):
    simulation = Simulation(scenario, yard())
    return list(raycast_frames(simulation, make_setup(simulation)))


@pytest.mark.render
def test_rendered_and_ray_cast_views_have_nearly_the_same_boxes():
    simulation = Simulation(SCENARIO, yard())
    rendered = [frame.tick.views[0].detections for frame in rendered_frames(simulation, make_setup(simulation))]
    cast = [frame.tick.views[0].detections for frame in raycast(SCENARIO)]
    assert sum(map(len, cast)) > 20
    pairs = [(a, b) for a, b in zip(rendered, cast, strict=True) if len(a) == len(b)]
    assert len(pairs) >= 4
    # Pixels and sample points of a body differ a little in what they call visible.
    apart = np.concatenate([np.linalg.norm(a.bearing - b.bearing, axis=1) for a, b in pairs])
    assert np.median(apart) < 0.01


def test_the_same_scenario_gives_the_same_boxes_and_models_differ():
    short = replace(SCENARIO, frames=3)
    first, again = raycast(short), raycast(short)
    other = raycast(replace(short, detector_model="independent"))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.tick.views[0].detections.bearing, b.tick.views[0].detections.bearing)
    assert any(len(a.tick.views[0].detections) != len(b.tick.views[0].detections) for a, b in zip(first, other, strict=True))
    for a, b in zip(first, other, strict=True):
        np.testing.assert_array_equal(a.truth.feet, b.truth.feet)


def test_scenarios_hold_their_model():
    assert "detector_model" not in Scenario().to_json()
    assert Scenario.from_json(Scenario().to_json()) == Scenario()
    for choice in ("fairmot", model_text(named_model("fairmot"))):
        scenario = Scenario(detector_model=choice)
        assert Scenario.from_json(scenario.to_json()) == scenario
    with pytest.raises(ValueError, match="detector model is 'yolo'"):
        Scenario(detector_model="yolo")
