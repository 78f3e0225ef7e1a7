"""The simulated boxes of a view: rates, persistence, and places that stand in the world."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.recordings.walked_room import camera_at
from tracker.detector_models.bodies import bodies_in_view
from tracker.detector_models.model import DetectorModel, FalseBoxes, Merges, Misses, SecondBoxes, StandingBoxes, named_model
from tracker.detector_models.sampler import Place, ViewSampler, expected_edges, miss_rate

CAMERA = camera_at((0.0, 0.0, 2.4), (6.0, 4.0, 0.8))
PERIOD = 0.25
NONE = np.zeros((0, 5))


def plain(**changes) -> DetectorModel:
    """The model of FairMOT without boxes that are no person's and without merges, with changes."""
    quiet = {
        "merges": Merges((0.0, 0.0, 0.0), 0.0),
        "second": SecondBoxes((), 0.0, ()),
        "false": FalseBoxes(0.0, ()),
        "standing": StandingBoxes(0.0, 0.0, 0.0, ()),
    }
    return replace(named_model("fairmot"), **(quiet | changes))


def people(*places):
    return np.arange(1, len(places) + 1), np.array([[x, y, 0.0] for x, y in places])


def bodies(ids, feet, camera=CAMERA):
    return bodies_in_view((camera.camera, camera.pose), ids, feet, NONE)


def run(model, crowd, frames, seed=0, persons=(1, 2, 3, 4)):
    sampler = ViewSampler(model, CAMERA.camera, PERIOD, persons, np.random.default_rng(seed))
    return [sampler.step(bodies(*crowd), Place(CAMERA.pose, 0.0)) for _ in range(frames)]


def test_misses_have_their_rate_and_last():
    misses = Misses((-1.0, 0.0, 0.0, 0.0, 0.0), (-3.0, -0.5), 1.0, 0.05)
    crowd = people((4, 4), (6, 2), (8, 6))
    out = run(plain(misses=misses), crowd, 2000)
    found = np.array([[person in one.person for person in (1, 2, 3)] for one in out])
    expected = miss_rate(plain(misses=misses), bodies(*crowd).features(720, misses.sizes))
    assert 1 - found.mean() == pytest.approx(expected[0], abs=0.04)
    missed = ~found - (1 - found.mean())
    # The flicker takes its part of the correlation; the chain keeps exp(−0.25).
    q = (expected[0] - 0.05) / 0.95
    covariance = 0.95**2 * q * (1 - q) * np.exp(-PERIOD)
    assert (missed[1:] * missed[:-1]).mean() == pytest.approx(covariance, rel=0.2)


def test_a_person_does_not_depend_on_the_others():
    alone = run(plain(), people((4, 4)), 30)
    both = run(plain(), people((4, 4), (9, 1)), 30)
    for one, two in zip(alone, both, strict=True):
        np.testing.assert_array_equal(one.boxes[one.person == 1], two.boxes[two.person == 1])
        np.testing.assert_array_equal(one.confidence[one.person == 1], two.confidence[two.person == 1])


def test_the_seed_decides():
    first, again, other = (run(named_model("faster-rcnn"), people((4, 4), (6, 2)), 10, seed) for seed in (1, 1, 2))
    assert all(np.array_equal(a.boxes, b.boxes) for a, b in zip(first, again, strict=True))
    assert not all(np.array_equal(a.boxes, b.boxes) for a, b in zip(first, other, strict=True))


def test_hidden_people_have_no_box():
    crowd = people((4.0, 2.7), (4.4, 2.97))
    assert bodies(*crowd).visible[1] < 0.5
    model = plain(misses=Misses((-30.0, 60.0, 0.0, 0.0, 0.0), (-3.0, -0.5), 0.0, 0.0))
    for one in run(model, crowd, 20):
        assert one.person.tolist() == [1]


def test_merged_people_share_a_box():
    crowd = people((4.0, 2.7), (4.6, 3.0))
    seen = Misses((-30.0, 0.0, 0.0, 0.0, 0.0), (-3.0, -0.5), 0.0, 0.0)
    model = plain(misses=seen, merges=Merges((1.0, 1.0, 1.0), 0.0))
    both = expected_edges(model, bodies(*crowd), CAMERA.camera)
    for one in run(model, crowd, 20):
        assert one.person.tolist() == [1]
        left, top, width, height = one.boxes[0]
        middle = left + width / 2
        assert middle == pytest.approx((both[:, 0].min() + both[:, 2].max()) / 2, abs=0.15 * height)
        assert top < both[:, 1].max() + 0.1 * height


def test_standing_boxes_stand_in_the_world():
    standing = StandingBoxes(3.0, 1.0, 0.0, ((5.0, 1.2, 0.5, 1.0, 0.6, 0.9),))
    nobody = people()
    out = run(plain(standing=standing), (nobody[0], nobody[1].reshape(0, 3)), 20, seed=3)
    assert len(out[0].boxes) > 0
    for one in out[1:]:
        np.testing.assert_allclose(np.sort(one.boxes, axis=0), np.sort(out[0].boxes, axis=0), atol=1e-9)
        assert ((one.confidence >= 0.6) & (one.confidence <= 0.9)).all()
    # The camera turns by 0.1 rad: the boxes move in the image the other way, and stay at their places.
    sampler = ViewSampler(plain(standing=standing), CAMERA.camera, PERIOD, (1,), np.random.default_rng(3))
    empty = bodies(nobody[0], nobody[1].reshape(0, 3))
    before = sampler.step(empty, Place(CAMERA.pose, 0.0))
    turned = camera_at((0.0, 0.0, 2.4), (6.0, 4.6, 0.8))
    after = sampler.step(empty, Place(turned.pose, 0.0))
    assert np.sort(after.boxes[:, 0] + after.boxes[:, 2]).max() > np.sort(before.boxes[:, 0] + before.boxes[:, 2]).max()


def test_other_views_see_other_false_boxes():
    first, second = (run(named_model("faster-rcnn"), (people()[0], np.zeros((0, 3))), 5, seed) for seed in (5, 6))
    assert not np.array_equal(first[0].boxes, second[0].boxes)
