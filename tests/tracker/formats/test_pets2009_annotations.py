"""CVML annotations: round trips and errors."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from tracker.formats.pets2009 import read_annotations, write_annotations
from tracker.io.mot15 import MAX_FRAME

box = st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(0.01, 1e4), st.floats(0.01, 1e4))
frame = st.dictionaries(st.integers(0, 2**53 - 1), box, max_size=4)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.integers(0, MAX_FRAME), frame, max_size=5), st.text(st.characters(codec="utf-8", categories=["L", "P"]), max_size=8))
def test_round_trip(frames: dict[int, dict[int, tuple[float, ...]]], name: str) -> None:
    given_ = {k: (np.array(list(f), dtype=np.int64), np.array(list(f.values())).reshape(-1, 4)) for k, f in frames.items()}
    with tempfile.TemporaryDirectory() as folder:
        write_annotations(Path(folder) / "a.xml", name, given_)
        again = read_annotations(Path(folder) / "a.xml")
        assert [p.name for p in Path(folder).iterdir()] == ["a.xml"]
    assert list(again) == sorted(given_)
    for k, (ids, boxes) in again.items():
        assert_array_equal(ids, given_[k][0])
        # The file has centres: half a width is added and taken off.
        assert_allclose(boxes, given_[k][1], rtol=1e-12, atol=1e-11)


def test_frames_count_from_0_and_boxes_are_centred(tmp_path: Path) -> None:
    write_annotations(tmp_path / "a.xml", "x", {0: (np.array([3]), np.array([[10.0, 20, 4, 6]]))})
    text = (tmp_path / "a.xml").read_text()
    assert '<frame number="0">' in text
    assert '<object id="3"><box h="6" w="4" xc="12" yc="23"/></object>' in text


def test_box_of_zero_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"frame 4: the box of id 3 is 0.0 x 6.0 px, needs more than 0"):
        write_annotations(tmp_path / "a.xml", "x", {4: (np.array([3]), np.array([[10.0, 20, 0, 6]]))})
    assert not list(tmp_path.iterdir())


def test_elements_that_stand_twice_are_merged_and_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "a.xml"
    one = '<object id="1"><box h="4" w="2" xc="1" yc="2"/></object>'
    frame = '<frame number="0"><objectlist>{}</objectlist></frame>'
    path.write_text(f"<dataset>{frame.format(one + one)}{frame.format(one)}</dataset>")
    ((ids, boxes),) = read_annotations(path).values()
    assert_array_equal(ids, [1])
    assert_array_equal(boxes, [[0, 0, 2, 4]])
    assert caplog.messages == [f"{path}: 2 repeated elements merged"]
    for body, message in (
        (frame.format(one + one.replace('w="2"', 'w="3"')), "object.id 1 occurs twice in frame 0, with two boxes"),
        (frame.format(one) + frame.format(""), "frame.number 0 occurs twice, with other boxes"),
    ):
        path.write_text(f"<dataset>{body}</dataset>")
        with pytest.raises(ValueError, match=message):
            read_annotations(path)
