"""A watchdog over calls into the OpenGL driver: one that does not come back ends the process with a line that says so.

A call that hangs in a driver cannot be interrupted from within, so there is nothing to go on with: better an end than an endless wait.

The door to OpenGL without a screen: which backend to use, a context of it, and who draws.

Three things must name the same backend: MUJOCO_GL, which libmujoco reads when its first rendering context is made,
PYOPENGL_PLATFORM, which PyOpenGL reads when it is imported, and the class that makes the context. `choose_gl` sets the first,
mujoco's own backend modules set the second, `open_context` takes the third from the first. It does not matter whether mujoco
itself was imported before.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

TIME_LIMIT = 120.0
"""What the slowest computer takes for one picture, many times over."""

STATUS = 2

_watchdog: _Watchdog | None = None


class _Watchdog(threading.Thread):
    """Looks now and then whether the deadline of what goes on has passed."""

    def __init__(self) -> None:
        super().__init__(name="watchdog", daemon=True)
        self.process, self.operation, self.deadline = os.getpid(), "", float("inf")

    def run(self) -> None:
        while True:
            left = self.deadline - time.monotonic()
            if left <= 0:
                said = f"error: the OpenGL driver hangs: {self.operation} took more than {TIME_LIMIT:g} s\n"
                # Past Python's buffers, whose locks another thread may hold.
                os.write(2, said.encode())
                os._exit(STATUS)
            time.sleep(min(left, TIME_LIMIT / 10, 1.0))


@contextmanager
def watched(operation: str) -> Iterator[None]:
    """What is done in this context takes at most SECONDS, else the process ends with one line on its standard error and exit status 2.

    The calls within must let other threads run, as those of ctypes do, by which PyOpenGL calls the driver.
    """
    global _watchdog
    if _watchdog is None or _watchdog.process != os.getpid():
        _watchdog = _Watchdog()
        _watchdog.start()
    watchdog, before = _watchdog, (_watchdog.operation, _watchdog.deadline)
    watchdog.operation, watchdog.deadline = operation, time.monotonic() + TIME_LIMIT
    try:
        yield
    finally:
        watchdog.operation, watchdog.deadline = before


BACKENDS = ("egl", "osmesa", "glfw", "cgl")

INSTALL = "no OpenGL: install libegl1 and libgl1-mesa-dri (EGL), or libosmesa6 (OSMesa), or set MUJOCO_GL to a backend that works"

SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software rasterizer", "swiftshader")

PROBE = "from mujoco.{0} import GLContext; context = GLContext(8, 8); context.make_current(); context.free()"

PROBE_SECONDS = 20.0


class GLUnavailable(RuntimeError):  # noqa: N818  it is a state of the computer
    """No OpenGL context can be made; the message is one line and says what to install."""


@dataclass(frozen=True)
class GLInformation:
    """Who draws: the driver's own words, and whether they name a GPU."""

    vendor: str
    renderer: str
    version: str
    is_gpu: bool


def choose_gl() -> str:
    """The backend to draw with, left in os.environ["MUJOCO_GL"] for this process and those that it starts.

    A MUJOCO_GL that is set is believed. Else EGL, then OSMesa, is tried by making a context in a process of its own (0.3 s):
    a driver that crashes or hangs does not take this process with it, and PyOpenGL stays free to load for the other.
    Raises GLUnavailable where neither works.
    """
    chosen = os.environ.get("MUJOCO_GL", "").strip()
    if chosen:
        return chosen
    failures = []
    for backend in ("egl", "osmesa"):
        failure = _failure_of(backend)
        if failure is None:
            os.environ["MUJOCO_GL"] = backend
            return backend
        failures.append(f"{backend}: {failure}")
    raise GLUnavailable(f"{INSTALL} ({'; '.join(failures)})")


def _failure_of(backend: str) -> str | None:
    """Why a context of `backend` cannot be made, in one line, or None where it can."""
    environment = {key: value for key, value in os.environ.items() if key != "PYOPENGL_PLATFORM"} | {"MUJOCO_GL": backend}
    command = [sys.executable, "-c", PROBE.format(backend)]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PROBE_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return f"the driver did not answer within {PROBE_SECONDS:.0f} s"
    if done.returncode == 0:
        return None
    said = done.stderr.strip().splitlines()
    return said[-1][:200] if said else f"exit status {done.returncode}"


def open_context() -> Any:
    """A fresh, current OpenGL context of the chosen backend, to be freed by its own `free()`.

    What is drawn goes to buffers of MuJoCo's, so the context's own is 16 x 16. Raises GLUnavailable.
    """
    backend = choose_gl().lower()
    if backend not in BACKENDS:
        raise GLUnavailable(f"MUJOCO_GL is {backend!r}, needs one of {', '.join(BACKENDS)}, or nothing for a choice to be made")
    try:
        context = importlib.import_module(f"mujoco.{backend}").GLContext(16, 16)
        context.make_current()
    # The backends raise ImportError, RuntimeError, AttributeError or PyOpenGL's own errors, according to what is missing.
    except Exception as error:
        raise GLUnavailable(f"{INSTALL} (MUJOCO_GL={backend}: {' '.join(str(error).split())[:200]})") from error
    _check(backend)
    return context


def _check(backend: str) -> None:
    """Raises GLUnavailable where the current context answers nothing, or where PyOpenGL, imported before, is bound to another platform."""
    from OpenGL import GL, platform

    if GL.glGetString(GL.GL_VERSION) is None:
        raise GLUnavailable(f"{INSTALL} (MUJOCO_GL={backend}: its context is dead)")
    bound = type(platform.PLATFORM).__name__.removesuffix("Platform")
    if backend in ("egl", "osmesa") and bound.lower() != backend:
        raise GLUnavailable(f"PyOpenGL was imported before and is bound to {bound}: set PYOPENGL_PLATFORM={backend} before it is imported")


def gl_information(context: Any) -> GLInformation:
    """What the driver behind `context` says of itself. The context is current afterwards."""
    context.make_current()
    from OpenGL import GL  # only now does PYOPENGL_PLATFORM fit

    vendor, renderer, version = ((GL.glGetString(name) or b"unknown").decode() for name in (GL.GL_VENDOR, GL.GL_RENDERER, GL.GL_VERSION))
    return GLInformation(vendor, renderer, version, not any(word in renderer.lower() for word in SOFTWARE))


def largest_buffer(context: Any) -> int:
    """The greatest width and height in pixels that a buffer of `context` may have. The context is current afterwards."""
    context.make_current()
    from OpenGL import GL

    return int(min(GL.glGetIntegerv(GL.GL_MAX_RENDERBUFFER_SIZE), *GL.glGetIntegerv(GL.GL_MAX_VIEWPORT_DIMS)))


def use_reversed_depth() -> None:
    """Let depth run from 0 to 1 in the current context, so that floating point is finest far away, where a picture needs it."""
    from OpenGL import GL, platform

    arguments = GL.GL_LOWER_LEFT, GL.GL_ZERO_TO_ONE
    if GL.glClipControl:
        GL.glClipControl(*arguments)
    else:
        # libOSMesa has the function, but does not list it: it must be asked for.
        address = platform.PLATFORM.getExtensionProcedure(b"glClipControl")
        ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(address)(*(int(argument) for argument in arguments))
