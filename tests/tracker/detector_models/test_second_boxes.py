"""Second boxes that move while they last: runs of examples are found, and simulated boxes take their steps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from tests.tracker.detector_models.test_sampler import bodies, people, plain, run
from tracker.detector_models.model import SecondBoxes, model_text, parse_model
from tracker.detector_models.second_boxes import examples, runs


def rows_of(*boxes):
    """Rows (n, 10) of FalseSamples.seconds, of (person, left edge, whether there is no first box, frame)."""
    return np.array([[person, left, 0.0, left, 0.0, 0.5, 1.0, base, 0.0, frame] for person, left, base, frame in boxes])


def test_runs_are_one_box_in_frames_in_a_row():
    # Two boxes of person 1 keep apart; person 2 has a gap, and then no first box.
    rows = rows_of((1, 0.0, 0, 3), (1, 0.5, 0, 3), (1, 0.52, 0, 4), (1, 0.03, 0, 4), (2, 0.1, 0, 3), (2, 0.1, 0, 5), (2, 0.1, 1, 6))
    assert sorted(runs(rows)) == [[0, 3], [1, 2], [4], [5], [6]]
    kept = examples(rows)
    assert kept.shape == (7, 8)
    np.testing.assert_allclose(kept[:, 0], [0.0, 0.03, 0.5, 0.52, 0.1, 0.1, 0.1])
    assert kept[:, 7].tolist() == [1, 0, 1, 0, 0, 0, 0]


def test_a_second_box_takes_the_steps_of_its_run():
    offsets = (0.1, 0.14, 0.3)
    samples = tuple((left, 0.0, left, 0.0, 0.5, 1.0, 0.0, float(k < 2)) for k, left in enumerate(offsets))
    second = SecondBoxes((1.0,), 1e6, samples, (), 0.25)
    model = plain(second=second)
    still = replace(model, misses=replace(model.misses, coefficients=(-30.0, 0.0, 0.0, 0.0, 0.0), flicker=0.0))
    crowd = people((5, 4))
    height = bodies(*crowd).height[0]
    seen = []
    for one in run(still, crowd, 9):
        first, other = one.boxes[np.argsort(one.confidence == 0.5)][:, 0]
        seen.append(round(float((other - first) / height), 4))
    # To and fro between the ends of the run.
    at = [offsets.index(offset) for offset in seen]
    assert all(abs(a - b) == 1 for a, b in pairwise(at))
    assert set(at) == {0, 1, 2}
    assert parse_model(model_text(still)).second == second
    # Rows without runs stay where they are while a box lasts.
    frozen = replace(still, second=replace(second, step_s=0.0))
    lefts = [one.boxes[one.confidence == 0.5] - one.boxes[one.confidence != 0.5] for one in run(frozen, crowd, 5)]
    assert len({round(float(left[0, 0] / height), 4) for left in lefts}) == 1
