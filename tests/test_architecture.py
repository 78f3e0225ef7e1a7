"""The house of the design: who may import whom, and which files there are."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FORBIDDEN = {"worlds": {"sim", "tracker"}, "tracker": {"sim", "worlds", "mujoco", "gymnasium"}}
TOP = {"sim", "tracker", "worlds", "tests"}


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.split(".")[0])
    return found


@pytest.mark.parametrize("house", FORBIDDEN)
def test_imports_go_one_way(house: str) -> None:
    files = list((ROOT / house).rglob("*.py"))
    assert files
    for path in files:
        assert not imports(path) & FORBIDDEN[house], path


def test_only_the_renderer_knows_gl_and_only_the_simulation_steps() -> None:
    for path in (ROOT / "sim").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if path.name not in ("gl.py", "painter.py"):
            assert "OpenGL" not in imports(path), path
            assert "mjr_" not in text, path
        if path.name != "simulation.py":
            assert "mj_step(" not in text, path


def test_tracker_runs_without_mujoco() -> None:
    names = ", ".join(f"tracker.{name}" for name in ("pipeline", "sources", "evaluation", "results", "exporting"))
    block = f"import sys; sys.modules['mujoco'] = None; import {names}"
    done = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr


def test_folders_at_the_top() -> None:
    tracked = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT, check=True).stdout.split()
    folders = {name.split("/")[0] for name in tracked if "/" in name}
    assert folders <= TOP | {".ci"}


@pytest.mark.parametrize("house", ["worlds", "tracker", "sim"])
def test_files_stay_small_and_are_named_after_things(house: str) -> None:
    for path in (ROOT / house).rglob("*.py"):
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 400, path
        assert path.stem not in {"utils", "util", "helpers", "common", "base", "misc", "manager", "core"}, path
