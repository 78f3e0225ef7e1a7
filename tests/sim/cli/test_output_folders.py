"""Every command that writes: the output is checked before the work, and one process writes it at a time.

Read-only file systems, mount points and full disks are real ones, which need root; without root these tests are skipped.
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from sim.cli.main import _message, _parse
from tests.sim import stress_rows
from tests.sim.cli.test_surroundings import BOXES, CAMERA, ROOT
from tests.tracker import sequences
from tracker.datasets.validation import validate
from tracker.io.atomic import Kept
from tracker.io.file_lock import folder_lock, output_file_lock
from tracker.sequence.results import read_results

LONG = "4000"
"""Frames of work that would outlast every test."""
FOLDERS = {
    "demo": ["demo", "--frames", LONG, "--out", "OUT"],
    "generate": ["generate", "pilsun", "--frames", LONG, "--out", "OUT"],
    "twin": ["generate", "twin", "--annotations", "a.xml", "--calibration", "c", "--out", "OUT"],
    "track": ["track", "INPUT/pets", "--out", "OUT"],
    "track-graphs": ["track", "INPUT/pets", "--out", "OTHER", "--dump-graphs", "OUT"],
    "export": ["export", "INPUT/sequence", "--format", "tum", "--out", "OUT"],
    "stress": ["stress", "--frames", LONG, "--out", "OUT"],
    "study": ["study", "fig4", "--frames", LONG, "--out", "OUT"],
    "previews": ["worlds", "--preview", "OUT"],
    "train": ["place", "--train", "100000000", "--out", "OUT"],
}
FILES = {
    "scene": ["worlds", "pilsun", "--export", "OUT.glb"],
    "view": ["view", "INPUT/sequence", "--save", "OUT.rrd"],
    "report": ["report", "INPUT/stress", "--out", "OUT.html"],
    "compare": ["compare", "INPUT/stress", "--out", "OUT.png"],
    "place": ["place", "--episodes", "1000", "--picture", "OUT.png"],
}
NEEDS = {"train": "stable_baselines3", "view": "rerun"}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence, a PETS folder of one view and eight frames, and the rows of a stress test."""
    folder: Path = tmp_path_factory.mktemp("inputs")
    sequences.write(folder / "sequence")
    for name in ("calibration", "detections"):
        (folder / "pets" / name).mkdir(parents=True)
    (folder / "pets" / "calibration" / "View_001.xml").write_text(CAMERA)
    (folder / "pets" / "detections" / "View_001.txt").write_text(BOXES)
    stress_rows.write(folder / "stress", stress_rows.density(2))
    return folder


@dataclass(frozen=True)
class Output:
    """A command with its output. words: the command line."""

    words: list[str]
    path: Path
    is_file: bool

    def run(self) -> None:
        _parse(self.words).run()

    def refusal(self) -> str:
        """The line with which the command is refused."""
        with pytest.raises((ValueError, OSError)) as error:
            self.run()
        return _message(error.value)

    def locked(self) -> AbstractContextManager[None]:
        return output_file_lock(self.path) if self.is_file else folder_lock(self.path)


def output(name: str, inputs: Path, out: Path, other: Path) -> Output:
    """The command of this name that writes to `out`, without the ending of a file."""
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], reason=f"needs {NEEDS[name]}")
    words = (FOLDERS | FILES)[name]
    path = Path(str(out) + Path(next(word for word in words if word.startswith("OUT"))).suffix)
    values = {"INPUT": str(inputs), "OUT": str(out), "OTHER": str(other)}
    for key, value in values.items():
        words = [value + word.removeprefix(key) if word == key or word.startswith((f"{key}/", f"{key}.")) else word for word in words]
    return Output(words, path, name in FILES)


@contextmanager
def mount(folder: Path, *options: str) -> Iterator[Path]:
    """A file system in memory at this folder."""
    if os.geteuid() != 0:
        pytest.skip("needs root to mount a file system")
    folder.mkdir(exist_ok=True)
    done = subprocess.run(["mount", "-t", "tmpfs", *options, "none", str(folder)], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"needs the right to mount a file system: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextmanager
def held(one: Output) -> Iterator[None]:
    """Another thread holds the lock of the output, as another process would."""
    ready, done = threading.Event(), threading.Event()

    def hold() -> None:
        with one.locked():
            ready.set()
            done.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    assert ready.wait(10)
    try:
        yield
    finally:
        done.set()
        thread.join()


@pytest.mark.parametrize("name", [*FOLDERS, *FILES])
def test_a_second_writer_is_refused_before_the_work(name: str, inputs: Path, tmp_path: Path) -> None:
    one = output(name, inputs, tmp_path / "out", tmp_path / "other")
    with held(one):
        line = one.refusal()
    assert line.startswith(f"{one.path}: is being written by another pilsim (process {os.getpid()} on ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [*FOLDERS, *FILES])
def test_a_file_in_the_place_of_a_folder_is_named_before_the_work(name: str, inputs: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    one = output(name, inputs, tmp_path / "file" / "out", tmp_path / "other")
    assert str(tmp_path / "file") in one.refusal()
    if name in FOLDERS:
        assert "file" in output(name, inputs, tmp_path / "file", tmp_path / "other").refusal()
    else:
        one = output(name, inputs, tmp_path / "out", tmp_path / "other")
        one.path.mkdir()
        assert str(one.path) in one.refusal()
        one.path.rmdir()
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("file", "kept")]


@pytest.mark.command
def test_a_read_only_file_system_is_named_before_the_work(inputs: Path, tmp_path: Path) -> None:
    with mount(tmp_path / "mounted", "-o", "ro") as folder:
        for name in [*FOLDERS, *FILES]:
            if name == "train":
                continue  # its library may be missing
            one = output(name, inputs, folder / "new" / "out", tmp_path / "other")
            line = one.refusal()
            assert line.startswith(f"{one.path}: cannot be written"), line
            if name in FOLDERS:
                line = output(name, inputs, folder, tmp_path / "other").refusal()
                assert line.startswith(f"{folder}: cannot be written"), line
    assert [path.name for path in tmp_path.iterdir()] == ["mounted"]


@pytest.mark.command
def test_results_are_kept_where_the_disk_is_full(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "spare").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "spare"))
    # Two pages: one for the holder of the lock, and one for the first file of the results.
    with mount(tmp_path / "full", "-o", "size=8k") as folder:
        with pytest.raises(Kept) as error:
            output("track", inputs, folder / "out", tmp_path / "other").run()
        (spare,) = (tmp_path / "spare").glob("*/results")
        assert _message(error.value).endswith(f"No space left on device; the result is in {spare}")
        assert read_results(spare).frames == 8
        assert list(folder.rglob("*")) == []
        with pytest.raises(Kept, match="what was made is in") as error:
            output("export", inputs, folder / "out", tmp_path / "other").run()
        assert f"what was made is in {folder / 'out' / '.partial'}" in _message(error.value)
        assert (folder / "out" / ".partial").is_dir()


@pytest.mark.command
def test_a_recording_is_refused_where_the_disk_is_nearly_full(inputs: Path, tmp_path: Path) -> None:
    with mount(tmp_path / "full", "-o", "size=8m") as folder:
        one = output("view", inputs, folder / "a", tmp_path / "other")
        assert one.refusal() == f"{one.path}: No space left on device (less than 16 MiB are free)"
        assert list(folder.iterdir()) == []


@pytest.mark.command
def test_a_mount_point_in_a_folder_that_cannot_be_written(inputs: Path, tmp_path: Path) -> None:
    """As the volume of a container whose file system is read-only."""
    with mount(tmp_path / "parent") as parent, mount(parent / "out") as out:
        subprocess.run(["mount", "-o", "remount,ro", str(parent)], check=True)
        for name in ("track", "export"):
            output(name, inputs, out, tmp_path / "other").run()
            assert not [path for path in out.iterdir() if path.name.startswith(".")]
            subprocess.run(f"rm -r {out}/*", shell=True, check=True)


@pytest.mark.command
def test_links_and_the_current_folder(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A link may lead to nothing yet: its target is made."""
    for name, marker in (("track", "run.json"), ("export", "README.md")):
        (tmp_path / f"{name}-link").symlink_to(tmp_path / f"{name}-real")
        output(name, inputs, tmp_path / f"{name}-link", tmp_path / "other").run()
        assert (tmp_path / f"{name}-link").is_symlink()
        assert (tmp_path / f"{name}-real" / marker).is_file()
        (tmp_path / f"{name}-here").mkdir()
        monkeypatch.chdir(tmp_path / f"{name}-here")
        output(name, inputs, Path("."), tmp_path / "other").run()
        assert (tmp_path / f"{name}-here" / marker).is_file()
    (tmp_path / "page.html").symlink_to(tmp_path / "real.html")
    output("report", inputs, tmp_path / "page", tmp_path / "other").run()
    assert (tmp_path / "page.html").is_symlink()
    assert (tmp_path / "real.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_graphs_inside_the_results_are_refused(inputs: Path, tmp_path: Path) -> None:
    one = output("track-graphs", inputs, tmp_path / "out" / "graphs", tmp_path / "out")
    assert one.refusal() == f"{tmp_path / 'out' / 'graphs'}: lies in {tmp_path / 'out'}, needs a place outside it for the graphs"


SMALL = ["--robots", "1", "--people", "2", "--width", "64"]


@pytest.mark.soak
@pytest.mark.parametrize(
    ("words", "marker", "times"),
    [
        (["demo", "--frames", "3", *SMALL], "video.mp4", 2),
        (["generate", "pilsun", "--frames", "2", *SMALL], "README.md", 1),
        (["stress", "--sweep", "robots/0", "--frames", "6", "--no-render"], "results.jsonl", 2),
        (["study", "graphs", "--frames", "4", "--repetitions", "1"], "graphs.png", 1),
        (["worlds", "pilsun", "--preview"], "pilsun.png", 1),
    ],
)
def test_experiments_write_into_a_mount_point(words: list[str], marker: str, times: int, tmp_path: Path) -> None:
    """The folder above it cannot be written. A second command finds what the first one wrote, and no file of the lock stays."""
    with mount(tmp_path / "parent") as parent, mount(parent / "out") as out:
        subprocess.run(["mount", "-o", "remount,ro", str(parent)], check=True)
        command = [sys.executable, "-m", "pilsim", *words, *([] if words[-1] == "--preview" else ["--out"]), str(out)]
        for _ in range(times):
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=500)
            assert done.returncode == 0, done.stderr
            assert (out / marker).is_file()
            assert not [path for path in out.rglob("*") if path.name.startswith(".")]


@pytest.mark.soak
def test_a_demo_that_was_killed_continues_and_two_at_once_do_not_disturb_each_other(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pilsim", "demo", "--frames", "100", *SMALL, "--out", "OUT"]

    def images() -> int:
        return len(list(tmp_path.glob("OUT/.sequence.partial/images/*/*.jpg")))

    def started() -> subprocess.Popen[str]:
        """Waits for new images: those of a run that was killed are there before the next one holds the lock."""
        before = images()
        run = subprocess.Popen(command, cwd=tmp_path, env=dict(os.environ, PYTHONPATH=str(ROOT)), stderr=subprocess.PIPE, text=True)
        while images() < before + 4:
            assert run.poll() is None
            time.sleep(0.05)
        return run

    with started() as killed:
        killed.kill()
    with started() as first:
        second = subprocess.run(command, cwd=tmp_path, env=dict(os.environ, PYTHONPATH=str(ROOT)), capture_output=True, text=True, check=False)
        assert second.returncode == 2
        assert second.stderr.startswith(f"error: OUT: is being written by another pilsim (process {first.pid} on ")
        assert second.stderr.count("\n") == 1
        _, said = first.communicate(timeout=500)
        assert first.returncode == 0, said
    assert sorted(path.name for path in (tmp_path / "OUT").iterdir()) == [
        "contact_sheet.png", "plan.png", "scores.json", "sequence", "track", "video.mp4",
    ]  # fmt: skip
    assert len(list((tmp_path / "OUT" / "sequence" / "images" / "robot_0_camera").iterdir())) == 100
    assert not list(validate(tmp_path / "OUT" / "sequence"))


@pytest.mark.soak
def test_a_demo_on_a_full_disk_names_what_it_kept(tmp_path: Path) -> None:
    with mount(tmp_path / "full", "-o", "size=1m") as folder:
        command = [sys.executable, "-m", "pilsim", "demo", "--frames", "60", *SMALL[:-1], "256", "--out", str(folder / "out")]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=500)
        assert done.returncode == 2, done.stderr
        line = done.stderr.splitlines()[-1]
        assert "No space left on device; what was made" in line, line
        assert Path(line.rpartition(" is in ")[2]).is_dir()
