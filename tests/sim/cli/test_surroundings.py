"""Files with a byte order mark, and files that are not what a command reads."""

import json
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


@pytest.mark.soak
def test_byte_order_marks(tmp_path: Path) -> None:
    pets = tmp_path / "pets"
    for folder, name, text in (("calibration", "View_001.xml", CAMERA), ("detections", "View_001.txt", BOXES)):
        (pets / folder).mkdir(parents=True)
        (pets / folder / name).write_text(text)
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
    assert "det.txt:2: id is -1" in done.stderr


@pytest.mark.command
def test_an_infinite_weight_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.clq").write_text("p edge 2 1\nn 1 1e308\nn 2 1.7e308\ne 1 2\n")
    done = pilsim("clique", str(tmp_path / "a.clq"), "--seconds", "0.1", "--json")
    assert (done.returncode, done.stdout) == (2, "")
    assert "a.clq, line 2: weight is 1e308, needs at most" in done.stderr
