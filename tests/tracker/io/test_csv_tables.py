"""Tables and arrays: round trips, reproducible bytes, and refusal of malicious files."""

import csv
import io
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tracker.io.csv_tables import BLOCK, read_arrays, read_numbered_table, read_table, write_arrays, write_table

COLUMNS: dict[str, type] = {"frame": int, "name": str, "x": float}
ROWS: list[list[object]] = [[0, "a", 0.1], [1, "b", -2.5e-9], [2, "c", 1 / 3]]


def test_csv_and_npz_hold_the_same_values(tmp_path: Path) -> None:
    write_table(tmp_path / "t.csv", list(COLUMNS), ROWS)
    for name in ("t.npz", "u.npz"):
        write_arrays(tmp_path / name, list(COLUMNS), ROWS)
    assert (tmp_path / "t.npz").read_bytes() == (tmp_path / "u.npz").read_bytes()
    table, arrays = read_table(tmp_path / "t.csv", COLUMNS), np.load(tmp_path / "t.npz", allow_pickle=False)
    assert table["name"].tolist() == arrays["name"].tolist() == ["a", "b", "c"]
    np.testing.assert_array_equal(table["frame"], arrays["frame"])
    np.testing.assert_allclose(table["x"], arrays["x"], rtol=1e-8)
    assert (arrays["frame"].dtype, arrays["x"].dtype, arrays["x"][2]) == (np.int64, np.float64, 1 / 3)


def test_text_is_quoted_where_necessary(tmp_path: Path) -> None:
    """As Python's own writer of CSV does it, cell by cell."""
    names = ["plain", "a,b", 'say "no"', "two\nlines", "cr\rhere", ""]
    rows = [[k, name, value] for k, name in enumerate(names) for value in (0.1, -0.0, 1e-300, np.float64(2) / 3, float("nan"))]
    write_table(tmp_path / "t.csv", list(COLUMNS), rows)
    with (tmp_path / "u.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([list(COLUMNS), *([k, name, f"{value:.9g}"] for k, name, value in rows)])
    assert (tmp_path / "t.csv").read_bytes() == (tmp_path / "u.csv").read_bytes()


def test_overlong_line_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "t.csv").open("wb") as file:
        file.truncate(8 << 30)  # a hole: 8 GiB that take no place
    begun = time.monotonic()
    with pytest.raises(ValueError, match=r"t\.csv:1: a line of more than 65536 characters"):
        read_table(tmp_path / "t.csv", COLUMNS)
    assert time.monotonic() - begun < 1


@pytest.mark.parametrize("shape", [(1 << 40,), (1 << 31, 1 << 31)])
def test_array_larger_than_its_data_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("heights.npy", header.getvalue() + bytes(800))
    with pytest.raises(ValueError, match=r"a\.npz: "):
        read_arrays(tmp_path / "a.npz", ("heights",))


def test_object_arrays_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", heights=np.array([{}, []], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
        read_arrays(tmp_path / "a.npz", ("heights",))


def test_blocks_and_blanks_change_no_value_line_number_or_type(tmp_path: Path) -> None:
    """The rows have blanks, blank lines, a cell in quotes, and more rows than a block."""
    count = BLOCK + 500
    lines = [f"{k - 7}, n_{k % 3} ,{k / 7 - 3:.9g}" + "\n" * (1 + (k % 50 == 0)) for k in range(count)]
    (tmp_path / "t.csv").write_text("frame,name,x\n" + "".join(lines).replace(" n_0 ", '"n_0"', 1))
    numbers, table = read_numbered_table(tmp_path / "t.csv", COLUMNS)
    assert numbers == [2 + k + (k + 49) // 50 for k in range(count)]
    np.testing.assert_array_equal(table["frame"], np.arange(count) - 7)
    assert table["name"].tolist() == [f"n_{k % 3}" for k in range(count)]
    np.testing.assert_allclose(table["x"], np.arange(count) / 7 - 3, rtol=1e-8, atol=1e-9)
    assert (table["frame"].dtype, table["x"].dtype) == (np.int64, np.float64)


@pytest.mark.parametrize("faulty", ["1_0,a,1", "1,a,nan", "1,a,1e61", f"{1 << 62},a,1", "1,a", "1.5,a,1", f"{1 << 70},a,1"])
def test_the_first_fault_is_named(tmp_path: Path, faulty: str) -> None:
    (tmp_path / "t.csv").write_text(f"frame,name,x\n0,b,0\n\n{faulty}\n1,b,oops\n")
    with pytest.raises(ValueError, match=r"t\.csv:4: (frame is|x is|2 values, needs 3)"):
        read_table(tmp_path / "t.csv", COLUMNS)
