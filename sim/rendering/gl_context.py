"""Offscreen OpenGL: choice of the backend, contexts, driver information, and a watchdog over driver calls.

Three settings must name the same backend. MUJOCO_GL is read by libmujoco when it makes its first rendering context; `choose_gl` sets it.
PYOPENGL_PLATFORM is read by PyOpenGL when it is imported; mujoco's backend modules set it.
The third is the class of the context, which `open_context` takes from MUJOCO_GL. mujoco may have been imported earlier.

A call that hangs in a driver cannot be interrupted from Python. The watchdog ends the process with one line instead.
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
"""s that one guarded operation may take: many times what the slowest computer takes for one image."""

STATUS = 2

_watchdog: _Watchdog | None = None


class _Watchdog(threading.Thread):
    """Ends the process once the deadline of the current operation has passed."""

    def __init__(self) -> None:
        super().__init__(name="watchdog", daemon=True)
        self.process, self.operation, self.deadline = os.getpid(), "", float("inf")

    def run(self) -> None:
        while True:
            left = self.deadline - time.monotonic()
            if left <= 0:
                said = f"error: the OpenGL driver hangs: {self.operation} took more than {TIME_LIMIT:g} s\n"
                # os.write bypasses Python's buffers, whose locks another thread may hold.
                os.write(2, said.encode())
                os._exit(STATUS)
            time.sleep(min(left, TIME_LIMIT / 10, 1.0))


@contextmanager
def watched(operation: str) -> Iterator[None]:
    """Guard an operation: after TIME_LIMIT s the process ends with one line on standard error and exit status 2.

    The calls within must release the interpreter lock. PyOpenGL's calls do, since it calls the driver by ctypes.
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
    """Vendor, renderer and version as the driver reports them, and whether the renderer is a GPU."""

    vendor: str
    renderer: str
    version: str
    is_gpu: bool


def choose_gl() -> str:
    """The backend for rendering, stored in os.environ["MUJOCO_GL"] for this process and its children.

    A given MUJOCO_GL is kept. Otherwise a child process (0.3 s) tries to make a context of EGL, then one of OSMesa.
    A driver that crashes or hangs then leaves this process unharmed, and PyOpenGL is not bound to a backend yet.
    Raises GLUnavailable if neither works.
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
    """Why a context of `backend` cannot be made, in one line; None if it can."""
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
    """A new, current OpenGL context of the chosen backend; free it by its method `free()`.

    Rendering uses framebuffer objects, so the context's own buffer is only 16 x 16. Raises GLUnavailable.
    """
    backend = choose_gl().lower()
    if backend not in BACKENDS:
        raise GLUnavailable(f"MUJOCO_GL is {backend!r}, needs one of {', '.join(BACKENDS)}, or nothing for a choice to be made")
    try:
        context = importlib.import_module(f"mujoco.{backend}").GLContext(16, 16)
        context.make_current()
    # Depending on what is missing, backends raise ImportError, RuntimeError, AttributeError or errors of PyOpenGL.
    except Exception as error:
        raise GLUnavailable(f"{INSTALL} (MUJOCO_GL={backend}: {_reason(error)})") from error
    _check(backend)
    return context


def _reason(error: Exception) -> str:
    """Why a backend cannot be loaded, in one line. PyOpenGL takes functions of None where it finds no library."""
    said = " ".join(str(error).split())
    return "its library is not found" if isinstance(error, AttributeError) and "NoneType" in said else said[:200]


def _check(backend: str) -> None:
    """Raises GLUnavailable if the current context does not respond, or if PyOpenGL is already bound to another platform."""
    from OpenGL import GL, platform

    if GL.glGetString(GL.GL_VERSION) is None:
        raise GLUnavailable(f"{INSTALL} (MUJOCO_GL={backend}: its context does not respond)")
    bound = type(platform.PLATFORM).__name__.removesuffix("Platform")
    if backend in ("egl", "osmesa") and bound.lower() != backend:
        raise GLUnavailable(f"PyOpenGL was imported before and is bound to {bound}: set PYOPENGL_PLATFORM={backend} before it is imported")


def gl_information(context: Any) -> GLInformation:
    """The information that the driver of `context` reports. The context becomes current."""
    context.make_current()
    from OpenGL import GL  # PYOPENGL_PLATFORM is set only once a context exists

    vendor, renderer, version = ((GL.glGetString(name) or b"unknown").decode() for name in (GL.GL_VENDOR, GL.GL_RENDERER, GL.GL_VERSION))
    return GLInformation(vendor, renderer, version, not any(word in renderer.lower() for word in SOFTWARE))


def largest_buffer(context: Any) -> int:
    """The largest width and height in pixels of a buffer of `context`. The context becomes current."""
    context.make_current()
    from OpenGL import GL

    return int(min(GL.glGetIntegerv(GL.GL_MAX_RENDERBUFFER_SIZE), *GL.glGetIntegerv(GL.GL_MAX_VIEWPORT_DIMS)))


def use_reversed_depth() -> None:
    """Set the depth range of the current context to [0, 1], so that reversed depth has the finest resolution far away."""
    from OpenGL import GL, platform

    arguments = GL.GL_LOWER_LEFT, GL.GL_ZERO_TO_ONE
    if GL.glClipControl:
        GL.glClipControl(*arguments)
    else:
        # libOSMesa has the function but does not list it among its extensions.
        address = platform.PLATFORM.getExtensionProcedure(b"glClipControl")
        ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(address)(*(int(argument) for argument in arguments))
