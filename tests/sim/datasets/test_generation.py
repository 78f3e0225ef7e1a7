"""Generation of datasets by the command: complete sequences, reproducible bytes, resumption, and one run at a time in a folder."""

import hashlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tyro

from sim.cli.generate import Generate
from tests.commands import pilsim
from tracker.datasets.validation import validate
from tracker.formats.summary import summarize, summary_text
from tracker.io.file_lock import file_lock
from tracker.recordings.folder import read_recording
from tracker.sequence.dataset import sequences

PILSIM = Path(sys.executable).parent / "pilsim"
SMALL = ["--frames", "3", "--width", "128", "--robots", "1", "--people", "2", "--fixed-cameras", "4", "--count", "2"]
SMALL += ["--detector-model", "faster-rcnn"]


def sums(folder: Path) -> dict[str, str]:
    """Path → SHA-256 of every file of a dataset except croissant.json, which contains the name of the folder."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "croissant.json"]
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def last_line(done: subprocess.CompletedProcess[str]) -> str:
    """The last line that a failed command prints, after its progress."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr.replace("\r", "\n").strip().splitlines()[-1]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("generated") / "D"
    done = pilsim("generate", "pilsun", *SMALL, "--workers", 2, "--range", "--classes", "--video", "--out", folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.command
def test_a_dataset_is_complete_and_valid(dataset: Path) -> None:
    assert [path.name for path in sequences(dataset)] == ["pilsun-00000", "pilsun-00001"]
    assert [str(fault) for fault in validate(dataset)] == []
    assert not [path for path in dataset.iterdir() if path.name.startswith(".")]
    scenarios = [json.loads((path / "scenario.json").read_text()) for path in sequences(dataset)]
    assert [scenario["seed"] for scenario in scenarios] == [0, 1]
    assert scenarios[0]["paper"]["K_H"] == 25
    for path in sequences(dataset):
        names = {p.relative_to(path).as_posix() for p in path.rglob("*") if p.is_file()}
        assert {"terrain.glb", "calibration/View_004.xml", "range/View_001/000002.png", "videos/robot_0_camera.mp4"} <= names


@pytest.mark.command
def test_the_summary_counts(dataset: Path) -> None:
    found = summarize(dataset)
    assert found["total"]["sequences"] == 2
    assert found["total"]["frames"] == 6
    assert found["total"]["images"] == 6 * 5
    assert found["total"]["bytes"] < sum(path.stat().st_size for path in dataset.rglob("*") if path.is_file()) < found["total"]["bytes"] + 300_000
    assert "2 sequences, 6 frames, 30 images" in summary_text(found)


@pytest.mark.command
def test_missing_sequences_are_made_again_with_the_same_bytes(dataset: Path) -> None:
    """One worker replaces two, and the files of a killed run are in the folder."""
    before, kept = sums(dataset), (dataset / "pilsun-00000" / "manifest.json").stat().st_mtime_ns
    shutil.rmtree(dataset / "pilsun-00001")
    (dataset / ".pilsun-00001.partial" / "images").mkdir(parents=True)
    (dataset / ".pilsun-00001.lock").write_text("1\n")
    done = pilsim("generate", "pilsun", *SMALL, "--range", "--classes", "--video", "--out", dataset)
    assert done.returncode == 0, done.stderr
    assert "2 sequences, 1 new" in done.stdout
    assert sums(dataset) == before
    assert (dataset / "pilsun-00000" / "manifest.json").stat().st_mtime_ns == kept


def generate(*arguments: str, out: Path) -> None:
    """Run the command in this process."""
    tyro.cli(Generate, args=[*arguments, "--out", str(out)]).run()


@pytest.mark.command
def test_another_dataset_or_run_in_the_folder_is_refused(dataset: Path, tmp_path: Path) -> None:
    same = ["pilsun", *SMALL, "--range", "--classes", "--video"]
    with pytest.raises(ValueError, match=r"holds another dataset \(seed 0 there, 5 asked for\)"):
        generate(*same, "--seed", "5", out=dataset)
    with pytest.raises(ValueError, match="is a dataset of 2 sequences, --count is 1"):
        generate(*same, "--count", "1", out=dataset)
    with file_lock(dataset / ".lock"), pytest.raises(ValueError, match=rf"is being written by another pilsim \(process {os.getpid()} on "):
        generate(*same, out=dataset)
    (tmp_path / "diary.txt").write_text("dear diary")
    with pytest.raises(ValueError, match=r"and no dataset\.json; choose another --out"):
        generate(*same, out=tmp_path)
    with pytest.raises(ValueError, match="is a file, needs a folder"):
        generate(*same, out=tmp_path / "diary.txt")


@pytest.mark.command
def test_check_by_command(dataset: Path, tmp_path: Path) -> None:
    (dataset / "pilsun-00000" / "terrain.glb").rename(tmp_path / "t")
    done = pilsim("check", dataset, "--json")
    (tmp_path / "t").rename(dataset / "pilsun-00000" / "terrain.glb")
    assert last_line(done) == f"error: {dataset}: 1 fault"
    fault = {"file": str(dataset / "pilsun-00000" / "terrain.glb"), "reason": "missing, though the manifest names it"}
    assert json.loads(done.stdout) == {"faults": [fault], "count": 1}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pilsun", "--frames", "0"], "frames is 0, needs a whole number in [1, "),
        (["pilsun", "--count", "0"], "count is 0, needs 1 to 100000"),
        (["pilsun", "--robots", "0", "--fixed-cameras", "0"], "robots and views are 0, needs one of them above 0"),
        (["pilsun", "--workers", "0"], "workers is 0, needs 1 to 1024"),
        (["pilsun", "--cameras", "C1"], "--cameras names cameras of a twin, and pilsun is none"),
        (["pilsun", "--fixed-cameras", "99"], "views is 99, needs a whole number in [0, 32]"),
        (["pilsun", "--config", "none.toml"], "none.toml: no such file"),
        (["pilsun", "--config", "/"], "/: is a folder, needs a file"),
        (["pilsun", "--world", "mars"], "world is 'mars', needs one of campus, forest, "),
        (["twin", "--annotations", "a", "--calibration", "b", "--no-mesh"], "a twin takes --cameras and --detector-model, --difficulty"),
        (["pilsun", "--imu", "bmi088@50"], "imu is 50 Hz, needs 100 to 400 Hz"),
        (["pilsun", "--fixed-cameras", "2", "--clock", "View_003:offset=1"], "clock names 'View_003', but the fixed cameras are View_001, View_002"),
        (["twin", "--annotations", "a", "--calibration", "b", "--imu", "ideal"], "a twin takes --cameras and --detector-model, --difficulty"),
        (["pilsun", "--annotations", "a.xml"], "--annotations and --calibration are for a twin"),
        (["pilsun", "a"], "a: the preset pilsun has no source; pilsim generate twin a makes its twin"),
        (["twin", "nowhere"], "nowhere: no such folder"),
        (["twin", "nowhere", "--annotations", "a", "--calibration", "b"], "a twin needs SOURCE, or --annotations"),
        (["twin"], "a twin needs SOURCE, or --annotations FILE and --calibration DIR"),
        (["twin", "--annotations", "a", "--calibration", "b", "--people", "3"], "a twin takes --cameras and --detector-model, --difficulty"),
    ],
)
def test_invalid_arguments_are_refused(arguments: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        generate(*arguments, out=tmp_path / "D")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.command
def test_without_rendering_robots_are_in_the_recording(tmp_path: Path) -> None:
    few = ["--robots", "2", "--fixed-cameras", "0", "--people", "3", "--frames", "5"]
    generate("pilsun", "--no-render", "--world", "hall", *few, out=tmp_path / "D")
    sequence = read_recording(tmp_path / "D").sequence()
    assert sequence.setup.moving_robots == ("robot_0", "robot_1")
    assert sequence.truth is not None
    errors = [np.linalg.norm(sequence.setup.starts[name].T_world_robot.translation - sequence.truth[0].T_world_robot[name].translation)
              for name in sequence.setup.moving_robots]  # fmt: skip
    assert max(errors) < 0.1
    views = [view for tick in sequence.ticks for view in tick.views]
    assert sum(view.odometry is not None for view in views) == 8, "two robots, four frames after the first"
    assert any(len(view.detections) for view in views)


def test_a_wrong_setting_is_reported_with_its_file(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("framse = 3")
    with pytest.raises(ValueError, match=re.escape("mine.toml: setting is 'framse' (frames?), needs one of views, ")):
        generate("pilsun", "--config", str(tmp_path / "mine.toml"), out=tmp_path / "D")
    assert not (tmp_path / "D").exists()


SENSORS = ["--imu", "bmi088", "--wheels", "49.5", "--clock", "offset=±0.05,jitter=0.001;View_002:drift=20"]


@pytest.mark.command
def test_sensors_add_tables_and_change_no_other(dataset: Path, tmp_path: Path) -> None:
    """By options or by a file; a folder without them is another dataset."""
    out, small = tmp_path / "D", [*SMALL[:-4], "--count", "1", *SMALL[-2:]]
    done = pilsim("generate", "pilsun", *small, *SENSORS, "--out", out)
    assert done.returncode == 0, done.stderr
    assert [str(fault) for fault in validate(out)] == []
    before = sums(out)
    added = {"imu.csv", "wheels.csv", "stamps.csv", "sensors.json", "truth/inertial.csv", "truth/clocks.csv"}
    files, plain = (json.loads((root / "pilsun-00000" / "manifest.json").read_text())["files"] for root in (out, dataset))
    assert added <= set(files)
    same = [name for name in files if name not in added | {"README.md", "scenario.json"}]
    assert len(same) > 20
    assert [name for name in same if files[name] != plain[name]] == []
    for arguments, said in (([], "(imu bmi088 there, null asked for)"), ([*SENSORS, "--imu", "ideal"], "(imu bmi088 there, ideal asked for)")):
        with pytest.raises(ValueError, match=re.escape(said)):
            generate("pilsun", *small, *arguments, out=out)
    shutil.rmtree(out / "pilsun-00000")
    (tmp_path / "mine.toml").write_text('imu = "bmi088"\nwheels = 49.5\nclock = "offset=±0.05,jitter=0.001;View_002:drift=20"\n', encoding="utf-8")
    done = pilsim("generate", "pilsun", *small, "--config", tmp_path / "mine.toml", "--out", out)
    assert "1 sequence, 1 new" in done.stdout, done.stderr
    assert sums(out) == before
    assert "IMU bmi088 at 198 Hz, wheels at 49.5 Hz, 6 clocks with errors" in pilsim("info", out).stdout


@pytest.mark.command
def test_an_invalid_cluster_leaves_the_folder_free(tmp_path: Path) -> None:
    done = pilsim("generate", "pilsun", *SMALL, "--cluster", "nonsense", "--out", tmp_path / "D")
    assert "--cluster is 'nonsense', needs an address as tcp://HOST:PORT" in last_line(done)
    assert not (tmp_path / "D").exists()


def small_files(limit: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))


@pytest.mark.command
def test_a_full_disk_is_one_line_and_leaves_no_sequence(tmp_path: Path) -> None:
    command = [PILSIM, "generate", "pilsun", *SMALL, "--out", tmp_path / "D"]
    done = subprocess.run(command, preexec_fn=small_files(20_000), capture_output=True, text=True, check=False)
    assert "File too large" in last_line(done)
    assert not (tmp_path / "D").exists()


@pytest.mark.soak
def test_a_cluster_gives_the_same_bytes_though_a_worker_is_killed(dataset: Path, tmp_path: Path, cluster: Any) -> None:
    pids = [worker.pid for worker in cluster.workers.values()]
    arguments = [PILSIM, "generate", "pilsun", *SMALL, "--range", "--classes", "--video", "--cluster", cluster.scheduler_address, "--out"]
    run = subprocess.Popen([*arguments, tmp_path / "D"], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 200
    while not list(tmp_path.glob("D/.pilsun-*.partial/images/robot_0_camera/000000.jpg")):
        assert time.monotonic() < deadline
        assert run.poll() is None
        time.sleep(0.05)
    holders = [int(path.read_text().split()[0]) for path in tmp_path.glob("D/.pilsun-*.lock.pid")]
    assert set(holders) <= set(pids)
    os.kill(holders[0], signal.SIGKILL)
    _, said = run.communicate(timeout=400)
    assert run.returncode == 0, said
    assert sums(tmp_path / "D") == sums(dataset)
