"""Datasets with a detector model: the same bytes with one worker and two."""

import subprocess
import sys
from pathlib import Path

import pytest

PILSIM = Path(sys.executable).parent / "pilsim"
SMALL = ("--frames", "3", "--people", "4", "--robots", "1", "--width", "128", "--views", "1", "--count", "2", "--detector-model", "faster-rcnn")


@pytest.mark.slow
def test_one_worker_and_two_give_the_same_bytes(tmp_path):
    for workers in (1, 2):
        command = [PILSIM, "generate", "pilsun", *SMALL, "--workers", str(workers), "--out", "set"]
        (tmp_path / str(workers)).mkdir()
        subprocess.run(command, cwd=tmp_path / str(workers), check=True, capture_output=True, timeout=200)
    one, two = ({p.relative_to(tmp_path / w): p.read_bytes() for p in sorted((tmp_path / w).rglob("*")) if p.is_file()} for w in ("1", "2"))
    assert list(one) == list(two)
    assert len(one) > 20
    for name in one:
        assert one[name] == two[name], name
    assert any(b'"detector_model": "faster-rcnn"' in content for name, content in one.items() if name.name == "scenario.json")
