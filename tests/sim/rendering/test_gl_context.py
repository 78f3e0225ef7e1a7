"""OpenGL contexts: choice of the backend, messages without OpenGL, any order of imports, and the watchdog on calls that really hang."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim.rendering.gl_context import BACKENDS, GLUnavailable, choose_gl, gl_information, largest_buffer, open_context, watched

pytestmark = pytest.mark.command
ROOT = Path(__file__).parents[3]
INFORM = "context = sim.rendering.gl_context.open_context(); print(sim.rendering.gl_context.gl_information(context)); context.free()"
STALLED = "import ctypes; ctypes.CDLL(None).sleep(60)"
ENDLESS = """
import sim.rendering.gl_context, numpy as np
context = sim.rendering.gl_context.open_context()
from OpenGL import GL
from OpenGL.GL import shaders
# Mesa ends a loop after 65535 rounds: hence one in one in one, and many of them.
head = "#version 430\\nlayout(local_size_x=1) in; layout(binding=0) buffer B { int n; };"
loop = head + "void main() { while (n < 2) while (n < 3) while (n < 4) n = n % 2; }"
shader = GL.glCreateShader(GL.GL_COMPUTE_SHADER); GL.glShaderSource(shader, loop); GL.glCompileShader(shader)
program = GL.glCreateProgram(); GL.glAttachShader(program, shader); GL.glLinkProgram(program); GL.glUseProgram(program)
GL.glBindBufferBase(GL.GL_SHADER_STORAGE_BUFFER, 0, GL.glGenBuffers(1))
GL.glBufferData(GL.GL_SHADER_STORAGE_BUFFER, 4, np.zeros(1, np.int32), GL.GL_DYNAMIC_COPY)
GL.glDispatchCompute(60000, 1000, 1); GL.glFinish()
"""


def python(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a program in a new process with only the given GL settings."""
    kept = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "PYOPENGL_PLATFORM", "WAYLAND_DISPLAY")}
    return subprocess.run([sys.executable, "-c", program], env=kept | environment, cwd=ROOT, capture_output=True, text=True, check=False)


def test_a_given_backend_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert choose_gl() == "osmesa"


def test_the_chosen_backend_is_inherited_by_child_processes() -> None:
    done = python("import os, sim.rendering.gl_context; print(sim.rendering.gl_context.choose_gl(), os.environ['MUJOCO_GL'])")
    first, second = done.stdout.split()
    assert first == second in BACKENDS


@pytest.mark.parametrize(
    "imports",
    [
        "import mujoco, sim.rendering.gl_context",
        "import sim.rendering.panorama, sim.rendering.gl_context",
    ],
)
def test_any_order_of_imports(imports: str) -> None:
    done = python(f"{imports}; {INFORM}")
    assert done.stdout.startswith("GLInformation("), done.stderr
    assert not done.stderr


def test_without_any_opengl_one_line_says_what_to_install() -> None:
    broken = "from sim.rendering import gl_context as gl; gl.PROBE = 'raise SystemExit(\"lib{0}.so is not there\")'; gl.choose_gl()"
    said = python(broken).stderr.strip().splitlines()[-1]
    assert "GLUnavailable: no OpenGL: install libegl1" in said
    assert "libosmesa6" in said
    assert "libegl.so is not there" in said
    assert "libosmesa.so is not there" in said


def test_a_hanging_driver_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("sim.rendering.gl_context.PROBE", "import time; time.sleep(60)")
    monkeypatch.setattr("sim.rendering.gl_context.PROBE_SECONDS", 0.1)
    with pytest.raises(GLUnavailable, match="did not answer within"):
        choose_gl()
    assert "MUJOCO_GL" not in os.environ


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "osmesa"}, "PYOPENGL_PLATFORM"),
        ({"MUJOCO_GL": "glfw", "DISPLAY": ""}, "no OpenGL: install"),
        ({"MUJOCO_GL": "crayon"}, "needs one of egl, osmesa"),
    ],
)
def test_settings_that_cannot_work(environment: dict[str, str], message: str) -> None:
    said = python("import sim.rendering.gl_context; sim.rendering.gl_context.open_context()", **environment).stderr.strip().splitlines()[-1]
    assert said.startswith("sim.rendering.gl_context.GLUnavailable: ")
    assert message in said


def test_pyopengl_bound_elsewhere_is_named() -> None:
    said = python("import OpenGL.GL, sim.rendering.gl_context; sim.rendering.gl_context.open_context()").stderr
    assert "PyOpenGL was imported before and is bound to" in said or "no OpenGL" in said


def test_information_and_limits() -> None:
    context = open_context()
    try:
        information = gl_information(context)
        assert information.version[0].isdigit()
        assert information.is_gpu != any(word in information.renderer.lower() for word in ("llvmpipe", "softpipe"))
        assert largest_buffer(context) >= 2048
    finally:
        context.free()


def guarded(program: str) -> str:
    """The program within a guarded operation of at most 1 s."""
    body = "\n".join("    " + line for line in program.strip().splitlines())
    head = "from sim.rendering import gl_context\ngl_context.TIME_LIMIT = 1.0\nwith gl_context.watched('drawing'):"
    return f"{head}\n{body}\nprint('came back')"


@pytest.mark.parametrize("program", [STALLED, ENDLESS], ids=["library", "driver"])
def test_a_hanging_call_ends_the_process_with_one_line(program: str) -> None:
    done = python(guarded(program))
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.strip() == "error: the OpenGL driver hangs: drawing took more than 1 s"


def test_a_call_within_the_time_limit_returns() -> None:
    done = python(guarded("import time; time.sleep(0.2)"))
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "came back", "")


def test_time_between_two_calls_is_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.rendering.gl_context.TIME_LIMIT", 0.3)
    for _ in range(3):
        with watched("drawing"):
            pass
        time.sleep(0.4)
