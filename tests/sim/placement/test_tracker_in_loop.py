"""The tracker in the loop: prediction of people whose tracks have ended, and the detections of a detector model."""

from typing import Any

import numpy as np
import pytest

from sim.placement.config import PlacementConfig
from sim.placement.env import Placement
from sim.placement.observations import empty, observe
from sim.placement.tracker_in_loop import MEMORY_DURATION, TrackMemory
from tracker.detector_models.model import model_text, named_model

DT = 0.25
COVARIANCE = 0.04 * np.eye(2)[None]


def reports(ids: list[int], places: list[list[float]], velocity: float) -> TrackMemory:
    """A report of people who walk east."""
    count, position = len(ids), np.array(places, dtype=np.float64).reshape(-1, 2)
    covariance = np.repeat(COVARIANCE, count, axis=0)
    return TrackMemory(np.array(ids, dtype=np.int64), position, np.tile([velocity, 0.0], (count, 1)), covariance, np.zeros(count))


def walked(frames: int) -> TrackMemory:
    """Person 7 walks east at 1.2 m/s from the origin and is reported in `frames` frames."""
    memory = TrackMemory()
    for k in range(frames):
        memory.update(reports([7], [[1.2 * DT * k, 0.0]], 1.2), DT)
    return memory


def no_reports(memory: TrackMemory, frames: int) -> None:
    for _ in range(frames):
        memory.update(TrackMemory(), DT)


def test_a_person_without_reports_is_predicted_with_growing_covariance() -> None:
    memory = walked(20)
    last = memory.position[0, 0]
    no_reports(memory, 8)
    assert memory.track_id.tolist() == [7]
    assert memory.position[0, 0] == pytest.approx(last + 1.2 * 8 * DT, abs=0.02)
    # The added variance grows by eight where the time doubles.
    early = memory.covariance[0, 0, 0] - 0.04
    no_reports(memory, 8)
    assert memory.covariance[0, 0, 0] - 0.04 == pytest.approx(8 * early)
    no_reports(memory, round(MEMORY_DURATION / DT))
    assert len(memory.track_id) == 0


def test_a_new_track_replaces_a_prediction_near_it() -> None:
    memory = walked(20)
    no_reports(memory, 4)
    memory.update(reports([9, 8], [[memory.position[0, 0] + 0.5, 0.3], [9.0, 9.0]], 0.0), DT)
    assert memory.track_id.tolist() == [9, 8]
    np.testing.assert_array_equal(memory.time_unseen, 0)


def detected(model: str) -> list[np.ndarray]:
    environment = Placement(world="pilsun", robots=1, people=4, observation="tracks", detector_model=model)
    environment.reset(seed=3)
    for _ in range(2):
        environment.step(np.zeros((1, 2)))
    episode = environment.episode
    assert episode is not None
    loop = episode.tracking
    assert loop is not None
    return [found.bearing for found in loop.detected]


def test_beliefs_hold_the_velocity_and_the_time_unseen_of_tracks():
    environment = Placement(world="pilsun", robots=1, people=2, observation="tracks")
    environment.reset(seed=3)
    episode = environment.episode
    assert episode is not None
    assert episode.tracking is not None
    episode.tracking.memory = walked(20)
    no_reports(episode.tracking.memory, 12)
    out = empty(environment.config, 1)
    observe([episode], out)
    np.testing.assert_allclose(out["beliefs"][0, :2, [0, 3, 4, 8]], [[1, 0], [0.6, 0], [0, 0], [0.1, 0]], atol=1e-6)


@pytest.mark.parametrize("parameters", [{"fusion.reach": 10.0}, [["fusion.reach", 10.0]]])
def test_parameters_of_a_mapping_or_of_lists_are_the_same(parameters: Any) -> None:
    given = PlacementConfig(observation="tracks", parameters=parameters)
    assert {given} == {PlacementConfig(observation="tracks", parameters=(("fusion.reach", 10.0),))}


def test_the_model_gives_other_detections_and_the_same_again():
    first, again, plain = detected("faster-rcnn"), detected(model_text(named_model("faster-rcnn"))), detected("independent")
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(first, plain, strict=True))
