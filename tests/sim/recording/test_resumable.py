"""A sequence has the same bytes with any number of drawing workers, and after it was killed and resumed."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sim.parallel.pool import WorkerLost
from sim.recording.drawing import DrawnScene
from sim.recording.drawing_workers import drawing_workers
from sim.recording.frame_journal import NAME
from sim.recording.frames import simulated_frames
from sim.recording.record import SimulatedSequence, record, write_sequence
from sim.recording.shots import ShotPlan
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.io.atomic import partial_path
from tracker.sequence.writer import ImageForm

pytestmark = pytest.mark.render
SCENARIO = Scenario(seed=7, robots=1, people=3, frames=4, width=128)


def checksum(folder: Path) -> str:
    return str(json.loads((folder / "manifest.json").read_text())["sum"])


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("alone") / "s"
    record(SCENARIO, folder)
    return folder


def cut(folder: Path, line: int, more: bytes) -> Path:
    """What a kill leaves after `line` lines of the journal and some bytes: the images of later frames, partly written, without their lines."""
    with pytest.raises(KeyboardInterrupt):
        record(SCENARIO, folder, interrupted)
    partial = partial_path(folder)
    lines = (partial / NAME).read_bytes().split(b"\n")
    (partial / NAME).write_bytes(b"".join(one + b"\n" for one in lines[: line + 1]) + more)
    (partial / "images" / "robot_0_camera" / "000003.jpg").write_bytes(b"torn")
    return partial


def interrupted(frames, total):  # type: ignore[no-untyped-def]
    """As a progress bar that is interrupted in the last frame."""
    for k, frame in enumerate(frames):
        if k == total - 1:
            raise KeyboardInterrupt
        yield frame


def test_an_interrupted_sequence_is_resumed(alone: Path, tmp_path: Path) -> None:
    partial = cut(tmp_path / "s", 2, b'{"frame": 2, "files"')
    first = partial / "images" / "robot_0_camera" / "000000.jpg"
    number = first.stat().st_ino, first.stat().st_mtime_ns
    record(SCENARIO, tmp_path / "s")
    kept = (tmp_path / "s" / "images" / "robot_0_camera" / "000000.jpg").stat()
    assert (kept.st_ino, kept.st_mtime_ns) == number, "frame 0 was drawn again"
    assert checksum(tmp_path / "s") == checksum(alone)
    assert not partial.exists()


def test_damaged_images_and_other_scenarios_are_not_resumed(alone: Path, tmp_path: Path) -> None:
    partial = cut(tmp_path / "s", 3, b"")
    (partial / "instances" / "robot_0_camera" / "000001.png").write_bytes(b"")
    record(SCENARIO, tmp_path / "s")
    assert checksum(tmp_path / "s") == checksum(alone)
    with pytest.raises(KeyboardInterrupt):
        record(replace(SCENARIO, seed=8), tmp_path / "t", interrupted)
    record(SCENARIO, tmp_path / "t")
    assert checksum(tmp_path / "t") == checksum(alone)


@pytest.mark.command
def test_bytes_do_not_depend_on_workers(alone: Path, tmp_path: Path) -> None:
    record(SCENARIO, tmp_path / "s", workers=3)
    assert checksum(tmp_path / "s") == checksum(alone)


@pytest.mark.command
@pytest.mark.parametrize(
    "changes",
    [
        {"exposure": 0.3, "image_noise": 2.0},
        {"camera": "dual-fisheye:baseline=0.05", "effects": "readout=0.02,shutter=0.01,gain=12,dust=3,jpeg=60,mount_angle=2", "image_noise": 0.0},
    ],
)
def test_what_is_random_in_images_is_resumed(changes: dict[str, Any], tmp_path: Path) -> None:
    """Random numbers are drawn in the order of the frames, by any number of workers."""
    scenario = replace(SCENARIO, **changes)
    record(scenario, tmp_path / "a", workers=2)
    with pytest.raises(KeyboardInterrupt):
        record(scenario, tmp_path / "b", interrupted)
    assert partial_path(tmp_path / "b").exists()
    record(scenario, tmp_path / "b")
    assert checksum(tmp_path / "b") == checksum(tmp_path / "a")


def test_a_sequence_with_videos_starts_anew(tmp_path: Path) -> None:
    scenario = replace(SCENARIO, frames=2)

    def write(progress: Any = None) -> None:
        write_sequence(replace(SimulatedSequence.of(scenario), form=ImageForm(video=True)), tmp_path / "s", progress)

    with pytest.raises(KeyboardInterrupt):
        write(interrupted)
    assert not partial_path(tmp_path / "s").exists()
    write()
    assert len(list((tmp_path / "s" / "videos").iterdir())) == 1
    assert len(list((tmp_path / "s" / "images" / "robot_0_camera").iterdir())) == 2


@pytest.mark.command
@pytest.mark.render
def test_a_killed_worker_is_one_line() -> None:
    simulation = Simulation(SCENARIO)
    setup = make_setup(simulation)
    plan = ShotPlan(simulation, setup)
    moments = [plan.moment(state) for state in simulated_frames(simulation, setup)]
    with drawing_workers(2) as workers:
        assert workers is not None
        drawn = workers.draw(DrawnScene.of(simulation, plan, ImageForm(), raw=False), moments * 50)
        assert next(drawn) is not None
        os.kill(workers.executor.submit(os.getpid).result(), signal.SIGKILL)
        with pytest.raises(WorkerLost, match=r"^a worker was killed, .*; repeat the command$"):
            list(drawn)


@pytest.mark.soak
def test_killed_at_random_moments(tmp_path: Path) -> None:
    """The command is killed some times in one sequence, then completes it with the same bytes; no process is left."""
    words = ["generate", "pilsun", "--frames", "20", "--width", "256", "--robots", "1", "--people", "3", "--fixed-cameras", "0", "--workers"]
    command = [sys.executable, "-m", "pilsim", *words]
    assert subprocess.run([*command, "1", "--out", tmp_path / "whole"], capture_output=True, check=False).returncode == 0
    chance, folder = random.Random(38), tmp_path / "killed"
    images = folder / ".pilsun-00000.partial" / "images" / "robot_0_camera"
    for _ in range(2):
        run = subprocess.Popen([*command, "2", "--out", folder], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        before = len(list(images.glob("*")))
        while run.poll() is None and len(list(images.glob("*"))) < before + chance.randint(1, 6):
            time.sleep(0.02)
        time.sleep(chance.uniform(0.0, 0.2))
        run.kill()
        run.wait()
    assert subprocess.run([*command, "2", "--out", folder], capture_output=True, check=False).returncode == 0
    assert checksum(folder / "pilsun-00000") == checksum(tmp_path / "whole" / "pilsun-00000")
    assert not list(folder.glob(".*partial"))
    shutil.rmtree(folder)
