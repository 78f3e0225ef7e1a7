"""MOT17 files: round trips and errors."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from tracker.formats.motchallenge import Mot17Rows, SeqInfo, read_mot17, read_seqinfo, write_mot17, write_seqinfo, write_seqmap

number = st.floats(-1e6, 1e6)
size = st.floats(0, 1e6)
whole = st.tuples(st.integers(1, 10**6), st.integers(0, 2**53 - 1), st.integers(0, 1), st.integers(1, 13))
row = st.tuples(whole, st.tuples(number, number, size, size), st.floats(0, 1), st.tuples(number, number, number))


@settings(max_examples=100, deadline=None)
@given(st.lists(row, max_size=12, unique_by=lambda r: r[0][:2]), st.booleans())
def test_round_trip(values: list[tuple[tuple[float, ...], ...]], places: bool) -> None:
    values = sorted(values)
    frame, ids, consider, category = np.array([v[0] for v in values], dtype=np.int64).reshape(-1, 4).T
    box, position = np.array([v[1] for v in values]).reshape(-1, 4), np.array([v[3] for v in values]).reshape(-1, 3)
    visibility = np.array([v[2] for v in values])
    rows = Mot17Rows(frame, ids, box, consider, category, visibility, position if places else None)
    with tempfile.TemporaryDirectory() as folder:
        write_mot17(Path(folder) / "gt.txt", rows)
        again = read_mot17(Path(folder) / "gt.txt")
        assert [p.name for p in Path(folder).iterdir()] == ["gt.txt"]
    for name in ("frame", "id", "box", "consider", "category", "visibility"):
        assert_array_equal(getattr(again, name), getattr(rows, name))
        assert getattr(again, name).dtype == getattr(rows, name).dtype
    if places and values:
        assert_array_equal(again.position, position)
    else:
        assert again.position is None


def test_rows_are_written_by_frame_then_id(tmp_path: Path) -> None:
    ones = np.ones(3, dtype=np.int64)
    rows = Mot17Rows(np.array([2, 1, 1]), np.array([1, 9, 4]), np.arange(12.0).reshape(3, 4), ones, ones, np.array([0.25, 1, 0]))
    write_mot17(tmp_path / "gt.txt", rows)
    assert (tmp_path / "gt.txt").read_text() == "1,4,8,9,10,11,1,1,0\n1,9,4,5,6,7,1,1,1\n2,1,0,1,2,3,1,1,0.25\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3,4,5,6,1,1", "line 1: 8 values, needs 9"),
        ("1,2,3,4,5,6,1,1,1\n1,2,3,4,5,7,1,1,1", "line 2: frame 1 holds id 2 twice"),
        ("0,2,3,4,5,6,1,1,1", "line 1: frame is 0, needs at least 1"),
        ("1,9007199254740993,3,4,5,6,1,1,1", "line 1: id is 9007199254740993, needs a whole number below"),
        ("1,2.5,3,4,5,6,1,1,1", "line 1: id is 2.5, needs a whole number"),
        ("1,2,3,4,5,-6,1,1,1", "line 1: height is -6.0, needs at least 0"),
        ("1,2,3,4,5,6,2,1,1", "line 1: consider is 2, needs 0 to 1"),
        ("1,2,3,4,5,6,1,14,1", "line 1: category is 14, needs 1 to 13"),
        ("1,2,3,4,5,6,1,1,1.5", "line 1: visibility is 1.5, needs 0 to 1"),
        ("1,2,3,4,5,nan,1,1,1", "line 1: height is nan, needs a finite number"),
    ],
)
def test_errors_name_the_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "gt.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        read_mot17(path)
    assert str(error.value).startswith(str(path))


@settings(max_examples=50, deadline=None)
@given(st.floats(0.1, 1000), st.integers(0, 10**9), st.integers(1, 10**5), st.sampled_from([".jpg", ".png"]))
def test_seqinfo(rate: float, frames: int, width: int, suffix: str) -> None:
    info = SeqInfo("pilsun-00000-view %", rate, frames, width, 2 * width, suffix)
    with tempfile.TemporaryDirectory() as folder:
        write_seqinfo(Path(folder) / "seqinfo.ini", info)
        assert read_seqinfo(Path(folder) / "seqinfo.ini") == info


def test_invalid_seqinfo_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "seqinfo.ini"
    with pytest.raises(ValueError, match="no such file"):
        read_seqinfo(path)
    for text in (
        "",
        "[Sequence]\nname=a\n",
        "no section",
        "[Sequence]\nname=a\nframeRate=x\nseqLength=1\nimWidth=1\nimHeight=1\nimExt=.jpg\nimDir=i\n",
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=str(path)):
            read_seqinfo(path)


def test_first_line_of_a_seqmap_is_name(tmp_path: Path) -> None:
    write_seqmap(tmp_path / "map.txt", ["b", "a"])
    assert (tmp_path / "map.txt").read_text() == "name\nb\na\n"
