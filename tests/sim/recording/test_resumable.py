"""A sequence has the same bytes with any number of drawing workers, and after it was killed and resumed."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sim.parallel.pool import WorkerLost
from sim.recording.drawing import DrawnScene, drawing_workers
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
