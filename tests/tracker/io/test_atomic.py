"""Atomic writing of files and folders."""

import errno
import os
import subprocess
from pathlib import Path

import pytest

from tracker.io.atomic import Kept, new_file, new_folder, unfinished_path, write_or_rescue, write_text


def test_folder_appears_when_complete(tmp_path: Path) -> None:
    with new_folder(tmp_path / "a" / "out") as folder:
        (folder / "file").write_text("x")
        assert not (tmp_path / "a" / "out").exists()
    assert (tmp_path / "a" / "out" / "file").read_text() == "x"
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["out"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_failure_leaves_no_folder(tmp_path: Path, error: type[BaseException]) -> None:
    def fail() -> None:
        with new_folder(tmp_path / "out") as folder:
            (folder / "file").write_text("x")
            raise error

    with pytest.raises(error):
        fail()
    assert not list(tmp_path.iterdir())


def test_existing_content_is_kept(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old").write_text("x")
    with pytest.raises(ValueError, match="out: is there already"), new_folder(tmp_path / "out"):
        pass
    assert (tmp_path / "out" / "old").exists()


def test_remains_of_an_interrupted_run_are_removed(tmp_path: Path) -> None:
    (tmp_path / ".out.partial").mkdir()
    (tmp_path / ".out.partial" / "half").write_text("x")
    with new_folder(tmp_path / "out") as folder:
        assert not list(folder.iterdir())


def test_text_replaces_a_file_or_leaves_it(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "é\n")
    write_text(tmp_path / "a.txt", "ü\n")
    assert (tmp_path / "a.txt").read_bytes() == "ü\n".encode()
    with pytest.raises(UnicodeEncodeError):
        write_text(tmp_path / "a.txt", "\ud800")
    assert (tmp_path / "a.txt").read_bytes() == "ü\n".encode()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_file_appears_when_complete(tmp_path: Path) -> None:
    file = tmp_path / "plot.png"
    file.write_text("old")
    with new_file(file) as part:
        part.write_text("new")
        assert part.suffix == ".png"
        assert file.read_text() == "old"
    assert file.read_text() == "new"

    def fail() -> None:
        with new_file(file) as part:
            part.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert file.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["plot.png"]


def test_a_failure_of_the_system_keeps_what_was_made(tmp_path: Path) -> None:
    def fill(path: Path) -> None:
        with new_folder(path) as partial:
            (partial / "file").write_text("x")
            raise OSError(errno.ENOSPC, "No space left on device", "file")

    for path in (tmp_path / "new", tmp_path / "empty"):
        (tmp_path / "empty").mkdir(exist_ok=True)
        with pytest.raises(Kept) as error:
            fill(path)
        partial = unfinished_path(path)
        assert (error.value.errno, error.value.filename) == (errno.ENOSPC, "file")
        assert error.value.strerror == f"No space left on device; what was made is in {partial}"
        assert (partial / "file").read_text() == "x"
        with new_folder(path) as partial:
            assert list(partial.iterdir()) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "new"]


def test_a_result_that_has_no_place_is_written_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "spare").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "spare"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "of another").touch()

    def write(folder: Path) -> None:
        with new_folder(folder) as partial:
            (partial / "result").write_text("x")

    with pytest.raises(Kept, match="out: is there already; the result is in ") as error:
        write_or_rescue(tmp_path / "out", write)
    assert (Path(str(error.value).rpartition(" is in ")[2]) / "result").read_text() == "x"
    write_or_rescue(tmp_path / "new", write)
    assert (tmp_path / "new" / "result").read_text() == "x"


@pytest.mark.command
def test_a_file_is_written_through_links_into_devices_and_over_mount_points(tmp_path: Path) -> None:
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    for text in ("a", "b"):
        write_text(tmp_path / "link.txt", text)
        assert (tmp_path / "link.txt").is_symlink()
        assert (tmp_path / "real.txt").read_text() == text
    write_text(Path(os.devnull), "nobody reads it")
    assert not Path(os.devnull).is_file()
    if os.geteuid() != 0:
        pytest.skip("needs root to mount a file")
    for name in ("outside", "inside"):
        (tmp_path / name).write_text("old")
    done = subprocess.run(["mount", "--bind", tmp_path / "outside", tmp_path / "inside"], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"needs the right to mount a file: {done.stderr.strip()}")
    try:
        write_text(tmp_path / "inside", "new")
        assert (tmp_path / "outside").read_text() == "new"
    finally:
        subprocess.run(["umount", tmp_path / "inside"], check=True)
