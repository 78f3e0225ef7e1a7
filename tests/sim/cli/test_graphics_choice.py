"""MUJOCO_GL that this computer cannot load: what draws nothing works, what draws says in one line what is missing."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
HIDE = 'for f in $(ldconfig -p | sed -n "s/.*libOSMesa.* => //p"); do mount --bind /dev/null "$(readlink -f "$f")" || exit 99; done; exec "$@"'
"""A shell that hides libOSMesa from its own namespace of mounts, and runs the words after it."""
NO_LIBRARY = ["unshare", "-m" if os.name == "posix" and os.geteuid() == 0 else "-rm", "bash", "-c", HIDE, "hide"]


def python(*words: str, backend: str, before: list[str] | None = None) -> subprocess.CompletedProcess[str]:
    kept = {key: value for key, value in os.environ.items() if key not in ("PYOPENGL_PLATFORM", "DISPLAY", "WAYLAND_DISPLAY")}
    command = [*(before or []), sys.executable, *words]
    return subprocess.run(command, cwd=ROOT, env=kept | {"MUJOCO_GL": backend}, capture_output=True, text=True, check=False)


def without_osmesa(*words: str) -> subprocess.CompletedProcess[str]:
    """Python with MUJOCO_GL=osmesa where that library is hidden."""
    done = python(*words, backend="osmesa", before=NO_LIBRARY)
    if done.returncode == 99 or "unshare" in done.stderr:
        pytest.skip(f"needs the right to make a namespace of mounts (root), or libOSMesa to be absent: {done.stderr.strip()}")
    return done


IMPORTS = "import sim.recording.record, worlds.catalogue, os; from worlds.engine import mujoco; print(os.environ['MUJOCO_GL'], mujoco.mj_version())"


@pytest.mark.command
@pytest.mark.parametrize("backend", ["wgl", "glfw", "off"])
def test_imports_draw_nothing(backend: str) -> None:
    done = python("-c", IMPORTS, backend=backend)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(backend)


@pytest.mark.command
def test_imports_work_without_the_library() -> None:
    done = without_osmesa("-c", f"{IMPORTS}; assert 'PYOPENGL_PLATFORM' not in os.environ")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("osmesa ")


@pytest.mark.command
def test_a_world_is_exported_under_any_name(tmp_path: Path) -> None:
    done = python("-m", "pilsim", "worlds", "tunnel", "--export", str(tmp_path / "tunnel.glb"), backend="crayon")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "tunnel.glb").stat().st_size > 0


@pytest.mark.command
@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("clique a.clq --seconds 0.1", 0),
        pytest.param("worlds tunnel --preview OUT", 2, marks=pytest.mark.command),
        pytest.param("generate pilsun --frames 2 --people 1 --robots 1 --fixed-cameras 0 --width 128 --out OUT", 2, marks=pytest.mark.command),
        pytest.param("doctor", 0, marks=pytest.mark.command),
    ],
)
def test_commands_without_the_library(words: str, code: int, tmp_path: Path) -> None:
    (tmp_path / "a.clq").write_text("p edge 2 1\ne 1 2\n")
    places = {"OUT": str(tmp_path / "out"), "a.clq": str(tmp_path / "a.clq")}
    done = without_osmesa("-m", "pilsim", *(places.get(word, word) for word in words.split()))
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    if code or words == "doctor":
        lines = [line for line in (done.stderr or done.stdout).splitlines() if "libosmesa6" in line]
        assert len(lines) == 1, done.stderr
        assert "its library is not found" in lines[0]
    if code:
        assert re.fullmatch(r"(frames: .*\n)*error: no OpenGL: .*\n", done.stderr), done.stderr


@pytest.mark.command
def test_the_benchmark_says_so_in_one_line() -> None:
    done = without_osmesa("-m", "tests.benchmarks", "panorama")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "libosmesa6" in done.stderr


@pytest.mark.command
def test_a_backend_of_another_system_is_named() -> None:
    done = python("-m", "tests.benchmarks", "panorama", backend="wgl")
    assert (done.returncode, done.stderr) == (
        2,
        "error: MUJOCO_GL is 'wgl', needs one of egl, osmesa, glfw, cgl, or nothing for a choice to be made\n",
    )


def test_mujoco_is_taken_from_one_place() -> None:
    """A module that imports MuJoCo by itself fails where MUJOCO_GL cannot be loaded."""
    paths = [path for house in ("worlds", "sim") for path in (ROOT / house).rglob("*.py") if path.name != "engine.py"]
    assert not [path for path in paths if re.search(r"^\s*(import|from) mujoco\b", path.read_text(encoding="utf-8"), re.M)]
