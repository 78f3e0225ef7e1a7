"""COCO: run lengths compared with pycocotools, and round trips."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.testing import assert_allclose, assert_array_equal

from tracker.formats.coco import CocoFile, PersonAnnotation, Rle, decode_counts, encode_counts, encode_masks, person_annotation, read_coco, write_coco

images = arrays(np.uint16, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.sampled_from([0, 0, 1, 2, 65535]))


@settings(max_examples=100, deadline=None)
@given(images)
def test_masks_decode_to_the_image(image: np.ndarray) -> None:
    found = encode_masks(image)
    assert list(found) == np.unique(image[image > 0]).tolist()
    for person, rle in found.items():
        assert_array_equal(rle.decode(), image == person)
        assert rle.area == (image == person).sum()
        assert decode_counts(encode_counts(rle.counts)) == rle.counts


@settings(max_examples=100, deadline=None)
@given(images)
def test_compressed_counts_equal_those_of_pycocotools(image: np.ndarray) -> None:
    mask = pytest.importorskip("pycocotools.mask")
    for person, rle in encode_masks(image).items():
        theirs = mask.encode(np.asfortranarray((image == person).astype(np.uint8)))
        assert theirs == {"size": [rle.height, rle.width], "counts": encode_counts(rle.counts).encode()}


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 2**31), max_size=8))
def test_compressed_counts_round_trip(counts: list[int]) -> None:
    assert decode_counts(encode_counts(counts)) == tuple(counts)


pixel = st.floats(-0.0, 2000).map(lambda x: round(x, 2))
people = st.builds(
    lambda person, box, visible, points: (person, box, visible, points),
    st.one_of(st.integers(0, 20), st.integers(2**31, 2**53 - 1)),
    st.tuples(*[st.floats(0, 2000)] * 8),
    st.floats(0, 1),
    st.lists(st.tuples(pixel, pixel, st.integers(0, 2)), min_size=17, max_size=17),
)


@settings(max_examples=50, deadline=None)
@given(st.lists(people, max_size=4))
def test_round_trip(values: list[tuple[int, tuple[float, ...], float, list[tuple[float, float, int]]]]) -> None:
    content, image = CocoFile(), np.zeros((6, 8), dtype=np.uint16)
    image[2:4, 3:7] = 1
    video = content.add_video("a-view", "view", "a")
    shown = []
    for k, (person, box, visible, points) in enumerate(values):
        pixels, visibility = np.array([p[:2] for p in points]), np.array([p[2] for p in points])
        pixels[visibility == 0] = 0
        shown.append(PersonAnnotation(person, np.array(box[:4]), np.array(box[4:]), visible, 3.5, encode_masks(image)[1], pixels, visibility))
        content.add(content.add_image(video, f"{k}.jpg", (8, 6), k), shown[-1])
    with tempfile.TemporaryDirectory() as folder:
        write_coco(Path(folder) / "people.json", content, "test")
        again = read_coco(Path(folder) / "people.json")
    assert (again.videos, again.images, again.annotations) == (content.videos, content.images, content.annotations)
    for annotation, one in zip(again.annotations, shown, strict=True):
        back = person_annotation(annotation)
        assert (back.person, back.visible, back.range, back.mask) == (one.person, one.visible, one.range, one.mask)
        assert_array_equal(back.box, one.box)
        assert_array_equal(back.full, one.full)
        assert_array_equal(back.visibility, one.visibility)
        assert_allclose(back.pixels, one.pixels, atol=0.0051)


def test_ids_above_the_float_limit_are_refused() -> None:
    content = CocoFile()
    content.add_image(content.add_video("v", "c", "s"), "f", (8, 6), 0)
    mask = Rle(6, 8, (48,))
    with pytest.raises(ValueError, match="person is 9007199254740992, needs 0 to less than 2"):
        content.add(1, PersonAnnotation(2**53, np.zeros(4), np.zeros(4), 1.0, 1.0, mask, np.zeros((17, 2)), np.zeros(17, dtype=np.int64)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "field .* is missing or of the wrong kind"),
        ('{"videos": [], "images": []}', "field 'annotations' is missing"),
        ('{"videos": [], "images": [{"id": 1}, {"id": 1}], "annotations": []}', "an id of the images occurs twice"),
        ('{"videos": [], "images": [], "annotations": [{"id": 1, "image_id": 4}]}', "annotation 1 is of image 4, which is missing"),
        ("{", "not JSON"),
    ],
)
def test_errors_name_the_file(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_coco(tmp_path / "c.json")
    assert str(error.value).startswith(str(tmp_path / "c.json"))


def test_invalid_run_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="need characters from"):
        decode_counts("é")
    with pytest.raises(ValueError, match="end within a number"):
        decode_counts("P")
    with pytest.raises(ValueError, match="add up to 3, need 2 x 2"):
        Rle(2, 2, (1, 2)).decode()
