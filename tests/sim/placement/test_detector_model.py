"""The tracker in the loop with the detections of a detector model."""

import numpy as np
import pytest

from sim.placement.config import PlacementConfig
from sim.placement.env import Placement
from tracker.detector_models.model import named_model


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


@pytest.mark.slow
def test_the_model_gives_other_detections_and_the_same_again():
    first, again, plain = detected("faster-rcnn"), detected(named_model("faster-rcnn").to_json()), detected("independent")
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(first, plain, strict=True))


def test_only_tracks_have_a_detector():
    with pytest.raises(ValueError, match="detector_model is of the observation tracks"):
        PlacementConfig(detector_model="fairmot")
