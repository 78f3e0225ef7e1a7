"""Atomic writing of files and folders."""

from pathlib import Path

import pytest

from tracker.io.atomic import new_file, new_folder, write_text


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


def test_empty_folder_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with new_folder(tmp_path / "out") as folder:
        (folder / "file").write_text("x")
    assert (tmp_path / "out" / "file").exists()
