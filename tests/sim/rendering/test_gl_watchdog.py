"""The watchdog on calls that really hang: in the C library, and in an OpenGL driver with an endless shader loop."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim.rendering.gl_context import watched

ROOT = Path(__file__).parents[3]
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


def run(program: str) -> subprocess.CompletedProcess[str]:
    body = "\n".join("    " + line for line in program.strip().splitlines())
    head = "from sim.rendering import gl_context\ngl_context.TIME_LIMIT = 1.0\nwith gl_context.watched('drawing'):"
    text = f"{head}\n{body}\nprint('came back')"
    return subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, timeout=50, check=False)


@pytest.mark.parametrize("program", [STALLED, ENDLESS], ids=["library", "driver"])
def test_a_hanging_call_ends_the_process_with_one_line(program: str) -> None:
    done = run(program)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.strip() == "error: the OpenGL driver hangs: drawing took more than 1 s"


def test_a_call_within_the_time_limit_returns() -> None:
    done = run("import time; time.sleep(0.2)")
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "came back", "")


def test_time_between_two_calls_is_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.rendering.gl_context.TIME_LIMIT", 0.3)
    for _ in range(3):
        with watched("drawing"):
            pass
        time.sleep(0.4)
