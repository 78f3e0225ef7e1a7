"""TUM trajectories."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tracker.formats.tum import read_tum, write_tum
from tracker.geometry import Pose


def test_round_trip(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    poses = [Pose.exp(rng.normal(0, 2, 6)) for _ in range(50)] + [Pose.identity(), Pose.exp([0, 0, 0, np.pi, 0, 0])]
    times = np.cumsum(rng.uniform(0.01, 1, len(poses)))
    write_tum(tmp_path / "t.tum", times, poses)
    again, read = read_tum(tmp_path / "t.tum")
    assert_array_equal(again, times)
    for a, b in zip(read, poses, strict=True):
        assert_array_equal(a.translation, b.translation)
        assert_allclose(a.rotation, b.rotation, atol=1e-12)
    assert [p.name for p in tmp_path.iterdir()] == ["t.tum"]


def test_the_quaternion_is_xyzw(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("# comment\n0.5 1 2 3 0 0 1 0  # a half turn about z\n")
    times, (pose,) = read_tum(tmp_path / "t.tum")
    assert_array_equal(times, [0.5])
    assert_array_equal(pose.translation, [1, 2, 3])
    assert_allclose(pose.rotation, np.diag([-1, -1, 1]), atol=1e-15)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("1 2 3 4 0 0 0", "7 values, needs 8"),
        ("1 2 3 4 0 0 0 one", "qw is 'one', needs a number"),
        ("1 2 nan 4 0 0 0 1", "ty is nan, needs a finite number"),
        ("1 2 3 4 0 0 0 0", "length 0, needs 1"),
        ("-1 2 3 4 0 0 0 1", "timestamp is -1.0 after 0.0 in line 1, needs steps back of less than 0.5 s"),
        ("0 2 3 4 0 0 0 1", "timestamp is 0.0 for a second time, with another pose"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, line: str, text: str) -> None:
    path = tmp_path / "t.tum"
    path.write_text("0 0 0 0 0 0 0 1\n\n" + line)
    with pytest.raises(ValueError, match=text) as error:
        read_tum(path)
    assert str(error.value).startswith(f"{path}:line 3: ")


def test_lengths_and_encoding_are_checked(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="has 1 poses, needs 2"):
        write_tum(tmp_path / "t.tum", [0.0, 1.0], [Pose.identity()])
    (tmp_path / "t.tum").write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match="not UTF-8"):
        read_tum(tmp_path / "t.tum")


def test_rows_a_little_out_of_order_are_sorted_and_repeated_rows_merged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "t.tum"
    path.write_text("".join(f"{t} {x} 0 0 0 0 0 1\n" for t, x in ((0, 0), (0.2, 2), (0.1, 1), (0.3, 3), (0.3, 3))))
    times, poses = read_tum(path)
    assert_array_equal(times, [0, 0.1, 0.2, 0.3])
    assert_array_equal([pose.translation[0] for pose in poses], [0, 1, 2, 3])
    assert caplog.messages == [f"{path}: 1 row out of order by up to 0.10 s sorted, 1 repeated row merged"]
