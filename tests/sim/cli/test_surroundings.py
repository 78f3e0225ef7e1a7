"""Outputs that are mount points, links or cannot be written, and files with a byte order mark."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim.datasets.presets import read_settings
from tests.commands import pilsim

ROOT = Path(__file__).parents[3]
BOM = "\ufeff"
CAMERA = """<Camera name="View_001">
<Geometry width="768" height="576" ncx="795" nfx="752" dx="4.85e-3" dy="4.65e-3" dpx="5.1273e-03" dpy="4.65e-03"/>
<Intrinsic focal="5.5549" kappa1="5.1113e-03" cx="324.22" cy="282.57" sx="1.09379"/>
<Extrinsic tx="828.73" ty="-3175.48" tz="35469.3" rx="2.04055" ry="-0.89338" rz="-0.43056"/>
</Camera>
"""
BOXES = "".join(f"{frame},-1,340,120,20,60,0.95,-1,-1,-1\n" for frame in range(1, 9))


@pytest.fixture
def pets(tmp_path: Path) -> Path:
    """A PETS folder of one view and eight frames."""
    for folder in ("calibration", "detections"):
        (tmp_path / "pets" / folder).mkdir(parents=True)
    (tmp_path / "pets" / "calibration" / "View_001.xml").write_text(CAMERA)
    (tmp_path / "pets" / "detections" / "View_001.txt").write_text(BOXES)
    return tmp_path / "pets"


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Path]:
    """A folder that is a mount point, as a volume of a container is."""
    if os.geteuid() != 0:
        pytest.skip("needs root to mount a file system")
    folder = tmp_path / "mounted"
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "none", str(folder)], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"needs the right to mount a file system: {done.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.command
def test_results_are_written_into_a_mount_point(pets: Path, mounted: Path) -> None:
    done = pilsim("track", str(pets), "--out", str(mounted))
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in mounted.iterdir()) == ["robots.csv", "run.json", "tracks.txt"]
    assert pilsim("track", str(pets), "--out", str(mounted)).returncode == 0


@pytest.mark.command
def test_results_are_written_through_a_link_and_into_the_current_folder(pets: Path, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    assert pilsim("track", str(pets), "--out", str(tmp_path / "link")).returncode == 0
    assert (tmp_path / "real" / "run.json").exists()
    (tmp_path / "here").mkdir()
    command = [sys.executable, "-m", "pilsim", "track", str(pets), "--out", "."]
    done = subprocess.run(command, cwd=tmp_path / "here", env=dict(os.environ, PYTHONPATH=str(ROOT)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "here" / "run.json").exists()


@pytest.mark.command
def test_what_cannot_be_written_is_said_before_the_work(pets: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = pilsim("track", str(pets), "--out", str(tmp_path / "file" / "out"))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert str(tmp_path / "file") in done.stderr


@pytest.mark.soak
def test_byte_order_marks(pets: Path, tmp_path: Path) -> None:
    (tmp_path / "a.clq").write_text(f"{BOM}p edge 3 2\ne 1 2\ne 2 3\n", encoding="utf-8")
    assert pilsim("clique", str(tmp_path / "a.clq"), "--seconds", "0.1").returncode == 0
    site = {"rate": 7, "area": [[-14, -14], [5, 2]], "terrain": None}
    (pets / "site.json").write_text(BOM + json.dumps(site), encoding="utf-8")
    assert pilsim("track", str(pets), "--out", str(tmp_path / "out")).returncode == 0
    run = (tmp_path / "out" / "run.json").read_text(encoding="utf-8")
    (tmp_path / "out" / "run.json").write_text(BOM + run, encoding="utf-8")
    robots = (tmp_path / "out" / "robots.csv").read_text(encoding="utf-8")
    (tmp_path / "out" / "robots.csv").write_text(BOM + robots, encoding="utf-8")
    assert pilsim("track", str(pets), "--out", str(tmp_path / "out")).returncode == 0
    for name, text in (("a.toml", "frames = 2\npeople = 2\n"), ("a.json", '{"frames": 2, "people": 2}')):
        (tmp_path / name).write_text(BOM + text, encoding="utf-8")
        assert read_settings(tmp_path / name) == {"frames": 2, "people": 2}


@pytest.mark.command
def test_detections_are_no_tracks(tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text("1,1,10,10,5,9,1,2,3,0\n")
    (tmp_path / "det.txt").write_text("\n1,-1,10,10,5,9,0.9,2,3,0\n")
    done = pilsim("score", "--truth", str(tmp_path / "gt.txt"), "--result", str(tmp_path / "det.txt"))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "det.txt:line 2: id is -1" in done.stderr


@pytest.mark.command
def test_an_infinite_weight_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.clq").write_text("p edge 2 1\nn 1 1e308\nn 2 1.7e308\ne 1 2\n")
    done = pilsim("clique", str(tmp_path / "a.clq"), "--seconds", "0.1", "--json")
    assert (done.returncode, done.stdout) == (2, "")
    assert "a.clq, line 2: weight is 1e308, needs at most" in done.stderr
