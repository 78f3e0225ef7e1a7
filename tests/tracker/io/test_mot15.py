"""MOT15 files: round trips and errors."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from tracker.io.mot15 import Mot15Rows, place_of_row, read_mot15, rows_from_tracks, write_mot15

GOOD = "1,3,10.5,20,30,40,1,1.5,-2.5,0\n"

number = st.floats(-1e6, 1e6)
size = st.floats(0, 1e6)
row = st.tuples(st.integers(1, 10**6), st.integers(0, 10**9), number, number, size, size, number, number, number, number)


@settings(max_examples=100, deadline=None)
@given(st.lists(row, max_size=12, unique_by=lambda r: (r[0], r[1])))
def test_round_trip(values: list[tuple[float, ...]]) -> None:
    t = np.array(sorted(values), dtype=np.float64).reshape(-1, 10)
    rows = Mot15Rows(t[:, 0].astype(int), t[:, 1].astype(int), t[:, 2:6], t[:, 6], t[:, 7:])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tracks.txt"
        write_mot15(path, rows)
        again = read_mot15(path)
        assert [p.name for p in Path(folder).iterdir()] == ["tracks.txt"]
    for name in ("frame", "id", "box", "confidence"):
        assert_array_equal(getattr(again, name), getattr(rows, name))
    # An x or y of exactly 0 means "absent" to the 3-D kit: it is written as 1e-9 m.
    nudged = rows.position.copy()
    nudged[:, :2][nudged[:, :2] == 0] = 1e-9
    assert_array_equal(again.position, nudged)
    assert_array_equal(again.has_position, rows.has_position)


def test_rows_are_written_by_frame_then_id(tmp_path: Path) -> None:
    rows = Mot15Rows([2, 1, 1], [1, 9, 4], np.full((3, 4), -1.0), np.ones(3), np.full((3, 3), -1.0))
    write_mot15(tmp_path / "t.txt", rows)
    again = read_mot15(tmp_path / "t.txt")
    assert_array_equal(again.frame, [1, 1, 2])
    assert_array_equal(again.id, [4, 9, 1])
    assert not again.has_position.any()
    assert not again.has_box.any()
    assert {f: k.tolist() for f, k in again.by_frame().items()} == {1: [0, 1], 2: [2]}


def test_tracks_become_rows() -> None:
    rows = rows_from_tracks({2: (np.array([7, 5]), np.array([[1.0, 2, 3], [4, 5, 6]])), 1: (np.array([5]), np.zeros((1, 3)))})
    assert_array_equal(rows.frame, [1, 2, 2])
    assert_array_equal(rows.id, [5, 7, 5])
    assert_array_equal(rows.position, [[0, 0, 0], [1, 2, 3], [4, 5, 6]])
    assert not rows.has_box.any()
    assert len(rows_from_tracks({})) == 0


def test_an_empty_file_has_no_rows(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("\n  \n")
    rows = read_mot15(tmp_path / "t.txt")
    assert len(rows) == 0
    assert rows.by_frame() == {}


def test_whole_numbers_as_floats_and_byte_order_marks_are_read(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_bytes(b"\xef\xbb\xbf1.0, -1, 1e1,20,30,40,1,-1,-1,-1\r\n1,-1,10,20,30,40,0.5,-1,-1,-1\r\n")
    rows = read_mot15(tmp_path / "t.txt")
    assert_array_equal(rows.id, [-1, -1])
    assert_array_equal(rows.box[0], rows.box[1])


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("1,2,3,4,5,6,7,8,9", "9 values, needs 10"),
        ("1,2,3,4,nan,6,7,8,9,10", "width is nan"),
        ("1,2,3,4,5,six,7,8,9,10", "height is 'six'"),
        ("0,2,3,4,5,6,7,8,9,10", "frame is 0, needs at least 1"),
        ("1.5,2,3,4,5,6,7,8,9,10", "frame is 1.5, needs a whole number"),
        ("1,2.5,3,4,5,6,7,8,9,10", "id is 2.5, needs a whole number"),
        ("1,2,3,4,-5,6,7,8,9,10", "width is -5.0, needs at least 0"),
        ("1,3,3,4,5,6,7,8,9,10", "frame 1 holds id 3 twice"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, line: str, text: str) -> None:
    path = tmp_path / "t.txt"
    path.write_text(GOOD + "\n" + line + "\n" + GOOD.replace("1,3", "9,9"))
    with pytest.raises(ValueError, match=r"needs|twice") as error:
        read_mot15(path)
    assert str(error.value).startswith(f"{path}:3: ")
    assert text in str(error.value)


def test_real_files_are_read(data: Any) -> None:
    folder = data("pets2009", "S2.L1", "mot15")
    lengths = {name: len(read_mot15(folder / name)) for name in ("gt.txt", "det.txt", "cem_result.txt")}
    assert lengths == {"gt.txt": 4650, "det.txt": 4359, "cem_result.txt": 4477}
    truth = read_mot15(folder / "gt.txt")
    assert (truth.frame.min(), truth.frame.max(), len(np.unique(truth.id)), int((truth.confidence == 0).sum())) == (1, 795, 19, 174)


def test_rows_that_stand_twice_are_merged_and_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "t.txt"
    path.write_text(
        "2,-1,1,2,3,4,0.9,-1,-1,-1\n1,7,1,2,3,4,1,-1,-1,-1\n2,-1,1.0,2,3,4,0.90,-1,-1,-1\n\n1,7,1,2,3,4,1,-1,-1,-1\n1,8,1,2,3,4,1,-1,-1,-1\n"
    )
    rows = read_mot15(path)
    assert_array_equal(rows.id, [-1, 7, 8])
    assert caplog.messages == [f"{path}: 2 repeated rows merged"]
    assert place_of_row(path, 2) == f"{path}:6"
    # Two rows that differ in anything are two detections, or an error where they share an id.
    path.write_text("2,-1,1,2,3,4,0.9,-1,-1,-1\n2,-1,1,2,3,4,0.8,-1,-1,-1\n")
    assert len(read_mot15(path)) == 2
    path.write_text("2,1,1,2,3,4,0.9,-1,-1,-1\n2,1,1,2,3,4,0.8,-1,-1,-1\n")
    with pytest.raises(ValueError, match=":2: frame 2 holds id 1 twice"):
        read_mot15(path)
