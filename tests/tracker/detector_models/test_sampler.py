"""The simulated boxes of a view: rates, persistence, and places that stand in the world."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracker.recordings.walked_room import camera_at
from tracker.detector_models.bodies import bodies_in_view
from tracker.detector_models.fitting import at_its_places
from tracker.detector_models.model import DetectorModel, FalseBoxes, Merges, Misses, SecondBoxes, StandingBoxes, model_text, named_model, parse_model
from tracker.detector_models.observations import match_frame
from tracker.detector_models.sampler import FixedPlaces, Place, ViewSampler, expected_edges, miss_rate
from tracker.detector_models.samples import FalseSamples, PeopleSamples, Samples
from tracker.detector_models.second_boxes import example_kinds, examples_by_kind, second_rates
from tracker.detector_models.trends import TREND, bounds_of, fitted_trend, folds_of, trend_features

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


def walked(rng, people_=8, frames=80):
    """Features (n, 7), person and frame (n,) of people who walk through an image."""
    t = np.linspace(0, 1, frames)
    place = np.concatenate([rng.uniform(0, 1, 2) * (1 - t)[:, None] + rng.uniform(0, 1, 2) * t[:, None] for _ in range(people_)])
    size = -1.0 + 0.5 * place[:, 1] + rng.normal(0, 0.05, len(place))
    raw = trend_features(place, size, rng.uniform(0.5, 1, len(place)), np.array([[-np.inf], [np.inf]]))
    return np.clip(raw, *bounds_of(raw)), np.repeat(np.arange(people_), frames), np.tile(np.arange(frames), people_)


def test_a_trend_is_found_back_and_not_invented():
    rng = np.random.default_rng(0)
    features, person, frame = walked(rng)
    folds = folds_of(person, frame)
    truth = 0.2 * features[:, 0]
    # Each person has an error of their own, which no place explains.
    own = rng.normal(0, 0.02, 8)[person] + rng.normal(0, 0.02, len(person))
    found = features @ fitted_trend(features, truth + own, folds)
    assert np.corrcoef(found, truth)[0, 1] > 0.9
    assert not fitted_trend(features, own, folds).any()
    assert len(TREND) == features.shape[1]


def test_boxes_move_by_the_trend():
    model = plain()
    slope = [[0.0] * 7 for _ in range(4)]
    slope[0][0] = 0.5
    bounds = ((-1.0,) * 7, (1.0,) * 7)
    moved = replace(model, edges=replace(model.edges, trend=tuple(map(tuple, slope)), trend_bounds=bounds, near=0.5))
    still = replace(model, edges=replace(model.edges, near=0.5))
    crowd = people((5, 5))
    body = bodies(*crowd)
    across = body.whole[0, [0, 2]].mean() / CAMERA.camera.width - 0.5
    for one, two in zip(run(moved, crowd, 5), run(still, crowd, 5), strict=True):
        np.testing.assert_allclose(one.boxes[:, 0] - two.boxes[:, 0], 0.5 * across * body.height[0], atol=1e-6)
    assert parse_model(model_text(moved)).edges == moved.edges


def test_fixed_places_stand_end_and_begin():
    rows = ((10.0, 20.0, 60.0, 120.0, 1.0, 0.5, 0.9, 1.0), (300.0, 20.0, 360.0, 120.0, 1.0, 0.5, 0.9, 0.0))
    standing = StandingBoxes(0.0, 0.0, 0.0, (), rows, 5.0, 0.0)
    count = np.zeros(200)
    for seed in range(60):
        places = FixedPlaces(plain(standing=standing), PERIOD, np.random.default_rng(seed))
        for frame in range(200):
            edges, sure = places.step()
            if len(edges):
                np.testing.assert_allclose(edges, [rows[0][:4]])
                assert 0.5 <= sure[0] <= 0.9
            count[frame] += len(edges)
    # They end with a mean life of 5 s, 20 frames.
    assert count.sum() / 60 == pytest.approx(1 / (1 - np.exp(-PERIOD / 5)), rel=0.35)
    born = FixedPlaces(plain(standing=replace(standing, births=0.4, life_s=2.0)), PERIOD, np.random.default_rng(1))
    assert {tuple(edge) for _ in range(400) for edge in born.step()[0].tolist()} == {rows[0][:4], rows[1][:4]}


def test_places_that_stood_at_the_start_count_as_begun():
    # One place stands in frames 0 to 39 of 100, and none comes later.
    frames, zeros = np.arange(40), np.zeros(40, dtype=np.int64)
    box = np.tile([10.0, 20.0, 60.0, 120.0], (40, 1))
    false = FalseSamples(zeros, frames, zeros, box, np.ones((40, 3)), np.full(40, 0.5), 0, np.array([100]), np.zeros((0, 10)))
    nobody = PeopleSamples(*[np.zeros(0)] * 17)
    standing = at_its_places(plain(), Samples(nobody, false, PERIOD, ("C1",))).standing
    assert standing.life_s == pytest.approx(40 * PERIOD)
    # Of one birth a second and lives of 1 s, two places are seen in 1 s: one that comes, and one that is there.
    assert standing.births == pytest.approx(1 / ((100 + 40) * PERIOD), rel=1e-3)
    assert standing.fixed == ((10.0, 20.0, 60.0, 120.0, 1.0, 0.5, 0.5, 0.0),)


def test_second_boxes_depend_on_visibility():
    samples = ((0.1, 0.0, 0.1, 0.0, 0.4, 1.0, 0.0, 0.0), (0.2, 0.0, 0.2, 0.0, 0.6, 0.2, 0.0, 0.0), (0.3, 0.0, 0.3, 0.0, 0.7, 0.2, 1.0, 0.0))
    second = SecondBoxes((0.2, 0.05), 0.5, samples, (-4.0, 8.0, 0.0, 0.0, 0.0, 0.0))
    features = np.array([[1.0, 0.0, 0.0, -1.0, 0.0], [1.0, 0.9, 0.4, -1.0, 0.0]])
    rates = second_rates(second, features, np.array([True, True]))
    assert rates[:, 0] == pytest.approx([0.018, 0.9608], abs=1e-3)
    np.testing.assert_allclose(rates[:, 1], rates[:, 0] / 4)
    kind, alike = example_kinds(np.array([1.0, 0.1, 0.1]), np.array([True, True, False])), examples_by_kind(second)
    assert [alike[k].tolist() for k in kind] == [[0], [1], [2]]
    # Models of before have one rate for all.
    np.testing.assert_allclose(second_rates(replace(second, coefficients=()), features, np.array([True, False])), [[0.2, 0.05]] * 2)


def test_displaced_boxes_are_matched_where_asked():
    body = bodies(*people((6, 4)))
    box = body.whole + 0.3 * body.height[0] * np.array([1.0, 0.0, 1.0, 0.0])
    found = box, np.array([0.9])
    assert match_frame("C1", 0, body, found, CAMERA.camera).match.tolist() == [-1]
    assert match_frame("C1", 0, body, found, CAMERA.camera, 0.5).match.tolist() == [0]
    small = np.column_stack([box[:, :2], box[:, :2] + 0.3 * (box[:, 2:] - box[:, :2])])
    assert match_frame("C1", 0, body, (small, found[1]), CAMERA.camera, 0.5).match.tolist() == [-1]
