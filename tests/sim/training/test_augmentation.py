"""Random crops: targets agree with the picture, and batches depend on seed and number alone."""

from __future__ import annotations

import numpy as np
import pytest

from sim.training.augmentation import CropSampler, cut_off, visible_parts
from sim.training.clutter import KINDS, piece
from sim.training.scene_rendering import ImageSet
from sim.training.targets import STRIDE, targets_of


def _images(width: int, height: int, boxes: list[tuple[int, int, int, int]]) -> ImageSet:
    """One grey image with filled boxes as people."""
    colour, instances = np.full((1, height, width, 3), 90, np.uint8), np.zeros((1, height, width), np.uint8)
    for k, (left, top, right, bottom) in enumerate(boxes, 1):
        columns = np.arange(left, right) % width
        instances[0, top:bottom, columns] = k
        colour[0, top:bottom, columns] = 255
    count = len(boxes)
    return ImageSet(colour, instances, np.zeros(count, np.int64), np.arange(1, count + 1), np.array(boxes, float), np.ones(count))


def test_batches_depend_on_seed_and_number_alone():
    images = [_images(320, 240, [(40, 60, 70, 150), (200, 80, 225, 140)])]
    first, again = CropSampler([], images, 0), CropSampler([], images, 0)
    again.batch(1)
    np.testing.assert_array_equal(first.batch(0)["picture"], again.batch(0)["picture"])
    np.testing.assert_array_equal(first.batch(0)["edges"], again.batch(0)["edges"])
    assert (first.batch(1)["picture"] != first.batch(0)["picture"]).any()


@pytest.mark.parametrize("wraps", [False, True])
def test_boxes_follow_the_picture(wraps: bool):
    """The body is white: where it is found by its instance, the box of the targets is around it; in a panorama it lies over the seam."""
    box = (300, 80, 340, 180) if wraps else (140, 80, 180, 180)
    images = _images(320, 240, [box])
    sampler = CropSampler([images], [], 0) if wraps else CropSampler([], [images], 0)
    rng = np.random.default_rng(5)
    compared = 0
    for _ in range(30):
        crop = sampler._crop(rng, 256, (40.0, 120.0))
        if not len(crop.boxes):
            continue
        rows, columns = np.nonzero(crop.instances == 1)
        inside = crop.boxes[0].min() > 1 and crop.boxes[0].max() < 255
        if inside:
            shown = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            np.testing.assert_allclose(shown, crop.boxes[0], atol=2.0)
            compared += 1
    assert compared >= 5


def test_bodies_who_fill_a_panorama_are_within_their_crop():
    """Of a body that a crop is made for, at most 0.4 of the crop beside its middle, the middle is always inside."""
    sampler, rng = CropSampler([_images(1024, 512, [(400, 150, 480, 450)])], [], 0), np.random.default_rng(0)
    crops = [sampler._crop(rng, 256, (40.0, 120.0)) for _ in range(200)]
    middle = np.array([crop.boxes[0, [0, 2]].mean() if len(crop.boxes) else -1.0 for crop in crops])
    assert np.mean((middle > 0) & (middle < 256)) > 0.85


def test_targets_give_the_box_back():
    box = np.array([[40.0, 30.0, 72.0, 130.0]])
    made = targets_of(box, np.ones(1), 256)
    (row,), (column,) = np.nonzero(made.heat[0] == 1)
    centre = (np.array([column, row]) + 0.5) * STRIDE
    edges = made.edges[:, row, column]
    np.testing.assert_allclose(np.concatenate([centre - edges[:2], centre + edges[2:]]), box[0], atol=1e-4)
    assert made.counted.all()


def test_targets_have_the_shares_beyond_the_visible_part():
    box, seen = np.array([[40.0, 30.0, 72.0, 130.0]]), np.array([[44.0, 30.0, 72.0, 80.0]])
    made = targets_of(box, np.ones(1), 256, seen)
    trained = made.weight[0] > 0
    np.testing.assert_allclose(made.hidden[:, trained], np.tile([[4 / 32], [0], [0], [0.5]], trained.sum()), atol=1e-6)
    assert not targets_of(box, np.ones(1), 256).hidden.any()


def test_hidden_bodies_are_ignored_and_invisible_ones_are_background():
    boxes = np.array([[40.0, 30.0, 72.0, 130.0]])
    whole, half, hidden, invisible = (targets_of(boxes, np.array([share]), 256) for share in (1.0, 0.2, 0.05, 0.0))
    assert whole.worth.max() == 1
    assert 0.7 < half.worth.max() < 0.8
    assert half.weight.sum() == pytest.approx(half.worth.max() * whole.weight.sum(), rel=1e-5)
    assert not hidden.heat.any()
    assert (hidden.counted == 0).any()
    assert not invisible.heat.any()
    assert invisible.counted.all()


def test_boxes_end_at_the_border_of_the_crop():
    boxes = np.array([[100.0, 180.0, 140.0, 330.0], [30.0, 200.0, 70.0, 330.0], [-30.0, 40.0, 4.0, 140.0]])
    made = targets_of(boxes, np.ones(3), 256)
    found = {}
    for row, column in np.argwhere(made.heat[0] == 1):
        centre, edges = (np.array([column, row]) + 0.5) * STRIDE, made.edges[:, row, column]
        found[round(float(centre[0] - edges[0]))] = np.concatenate([centre - edges[:2], centre + edges[2:]])
    assert found.keys() == {30, 100}
    np.testing.assert_allclose(found[100], [100, 180, 140, 256], atol=1e-4)
    np.testing.assert_allclose(found[30], [30, 200, 70, 256], atol=1e-4)
    # Of the last one too little is inside.
    assert (made.counted[0, 11:35, 0] == 0).all()


def test_a_large_body_weighs_little_more_than_a_small_one():
    small, large = (targets_of(np.array([box]), np.ones(1), 256).weight.sum() for box in ([40.0, 30.0, 48.0, 55.0], [40.0, 30.0, 120.0, 240.0]))
    assert small < large < 5 * small


def test_crops_lie_within_their_image():
    image = _images(320, 240, [(140, 20, 220, 230)])
    image.colour[:] = np.maximum(image.colour, 1)
    sampler, rng = CropSampler([], [image], 0), np.random.default_rng(1)
    for _ in range(40):
        crop = sampler._crop(rng, 256, (20.0, 200.0))
        assert crop.picture.shape == (256, 256, 3)
        assert crop.picture.min() > 0


def test_an_image_that_ends_before_its_crop_is_continued_and_bodies_end_with_it():
    images, rng = _images(320, 240, [(140, 80, 180, 180)]), np.random.default_rng(3)
    images.colour[:] = rng.integers(0, 256, images.colour.shape)
    sampler, shares = CropSampler([], [images], 0), []
    for _ in range(40):
        crop = sampler._crop(rng, 256, (100.0, 240.0))
        before = crop.boxes.copy()
        sampler._end(crop, rng)
        rows, columns = (256 - int((one[:-1] == one[1:]).all(axis=(1, 2))[::-1].argmin()) for one in (crop.picture, crop.picture.swapaxes(0, 1)))
        assert min(rows, columns) > 256 - 32
        np.testing.assert_array_equal(crop.boxes, np.minimum(before, [columns, rows, columns, rows]))
        assert not crop.instances[rows:].any()
        assert not crop.instances[:, columns:].any()
        shares.append(crop.visible.min(initial=1.0))
    assert 0.0 <= min(shares) < 0.95


def test_what_hides_a_part_lowers_the_visible_share_and_screens_are_behind():
    sampler, rng = CropSampler([], [_images(320, 240, [(140, 80, 180, 180)])], 0), np.random.default_rng(3)
    shares = []
    for _ in range(40):
        crop = sampler._crop(rng, 256, (100.0, 101.0))
        pixels = np.count_nonzero(crop.instances == 1)
        sampler._paste_screen(crop, rng)
        assert np.count_nonzero(crop.instances == 1) == pixels
        sampler._hide(crop, rng)
        shares.append(crop.visible[0])
        assert crop.visible[0] == pytest.approx(np.count_nonzero(crop.instances == 1) / pixels)
        assert crop.visible_here()[0] <= crop.visible[0]
        rows, columns = np.nonzero(crop.instances == 1)
        if len(rows):
            np.testing.assert_array_equal(
                visible_parts(crop.instances, crop.person, crop.boxes)[0], [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            )
    assert 0.2 < np.mean(shares) < 0.8
    assert min(shares) < 0.4


def test_what_is_pasted_in_front_hides():
    crop = CropSampler([], [_images(320, 240, [(140, 80, 180, 180)])], 0)._crop(np.random.default_rng(0), 256, (100.0, 101.0))
    before = crop.instances.copy()
    black, mask = np.zeros((256, 128, 3), np.uint8), np.ones((256, 128), np.uint8)
    crop.paste(black, mask, (0, 0), 0, behind=True)
    np.testing.assert_array_equal(crop.instances, before)
    crop.paste(black, mask, (0, 0), 0, behind=False)
    crop.paste(black, mask, (128, 0), 0, behind=False)
    assert not crop.instances.any()
    assert (crop.visible == 0).all()


def test_pieces_are_of_the_asked_size():
    rng = np.random.default_rng(0)
    for _ in range(6 * len(KINDS)):
        picture, mask = piece(rng, 40)
        assert picture.shape[:2] == mask.shape
        assert mask.any()
        assert max(mask.shape) <= 90


def test_boxes_at_the_edge_are_cut():
    boxes = np.array([[0.0, 5, 9, 20], [5, 5, 9, 20], [5, 0, 9, 20], [90, 5, 100, 20]])
    assert cut_off(boxes, 100, 50, False).tolist() == [True, False, True, True]
    assert cut_off(boxes, 100, 50, True).tolist() == [False, False, True, False]
