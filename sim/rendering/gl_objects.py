"""Objects of OpenGL: programs, framebuffers, shadow maps and textures of a model, and counts of the traffic with the driver."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.rendering.gl_context import GLUnavailable
from worlds.engine import mujoco

NEEDED = ("GL_ARB_multi_draw_indirect", "GL_ARB_clip_control", "GL_ARB_base_instance", "GL_ARB_shading_language_420pack")


@dataclass
class DriverTraffic:
    """Traffic between the program and the driver: uploads of buffers, draw calls and read-backs, with their bytes.

    A read-back waits until the driver has drawn all that was asked before, so it is a point of synchronization.
    """

    uploads: int = 0
    uploaded_bytes: int = 0
    draws: int = 0
    read_backs: int = 0
    read_bytes: int = 0

    def upload(self, size: int) -> None:
        """Count one upload of `size` bytes."""
        self.uploads += 1
        self.uploaded_bytes += size

    def read_back(self, size: int) -> None:
        """Count one read-back of `size` bytes."""
        self.read_backs += 1
        self.read_bytes += size

    def since(self, before: DriverTraffic) -> DriverTraffic:
        """The difference to an earlier state."""
        return DriverTraffic(*(now - then for now, then in zip(astuple(self), astuple(before), strict=True)))


def check(GL: Any) -> None:
    """Raises GLUnavailable if the OpenGL of the current context is too old."""
    version = (GL.glGetString(GL.GL_VERSION) or b"").decode()
    has = {GL.glGetStringi(GL.GL_EXTENSIONS, k).decode() for k in range(GL.glGetIntegerv(GL.GL_NUM_EXTENSIONS))}
    missing = [name for name in NEEDED if name not in has]
    if missing:
        raise GLUnavailable(f"OpenGL {version} lacks {', '.join(missing)}: needs OpenGL 4.5, which Mesa has since 2020")


def program(GL: Any, vertex: str, pixel: str) -> int:
    """A program of a vertex and a fragment shader. Raises GLUnavailable with the driver's message if it does not compile."""
    made = GL.glCreateProgram()
    for kind, text in ((GL.GL_VERTEX_SHADER, vertex), (GL.GL_FRAGMENT_SHADER, pixel)):
        shader = GL.glCreateShader(kind)
        GL.glShaderSource(shader, text)
        GL.glCompileShader(shader)
        if not GL.glGetShaderiv(shader, GL.GL_COMPILE_STATUS):
            raise GLUnavailable(f"the driver does not compile a shader: {_line(GL.glGetShaderInfoLog(shader))}")
        GL.glAttachShader(made, shader)
    GL.glLinkProgram(made)
    if not GL.glGetProgramiv(made, GL.GL_LINK_STATUS):
        raise GLUnavailable(f"the driver does not link a program: {_line(GL.glGetProgramInfoLog(made))}")
    return int(made)


def framebuffer(GL: Any, size: tuple[int, int], colours: Sequence[int], depth: int | None) -> int:
    """A framebuffer with renderbuffers of these formats as draw buffers."""
    frame = int(GL.glGenFramebuffers(1))
    GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, frame)
    places = [GL.GL_COLOR_ATTACHMENT0 + k for k in range(len(colours))]
    for place, kind in [*zip(places, colours, strict=True), *([(GL.GL_DEPTH_ATTACHMENT, depth)] if depth is not None else [])]:
        buffer = GL.glGenRenderbuffers(1)
        GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
        GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, *size)
        GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, buffer)
    GL.glDrawBuffers(len(places), places)
    if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
        raise GLUnavailable(f"the driver cannot make a buffer of {size[0]} x {size[1]} px")
    return frame


def shadow_map(GL: Any, unit: int, side: int) -> int:
    """A depth framebuffer, side x side, with its texture on that unit for interpolated shadow lookups."""
    GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
    texture = GL.glGenTextures(1)
    GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
    GL.glTexStorage2D(GL.GL_TEXTURE_2D, 1, GL.GL_DEPTH_COMPONENT32F, side, side)
    # Outside of the map there is no shadow.
    for name, value in (
        (GL.GL_TEXTURE_WRAP_S, GL.GL_CLAMP_TO_BORDER),
        (GL.GL_TEXTURE_WRAP_T, GL.GL_CLAMP_TO_BORDER),
        (GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR),
        (GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR),
        (GL.GL_TEXTURE_COMPARE_MODE, GL.GL_COMPARE_REF_TO_TEXTURE),
        (GL.GL_TEXTURE_COMPARE_FUNC, GL.GL_LEQUAL),
    ):
        GL.glTexParameteri(GL.GL_TEXTURE_2D, name, value)
    GL.glTexParameterfv(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_BORDER_COLOR, np.ones(4, np.float32))
    frame = int(GL.glGenFramebuffers(1))
    GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, frame)
    GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_TEXTURE_2D, texture, 0)
    GL.glDrawBuffer(GL.GL_NONE)
    return frame


def texture_of(GL: Any, model: mujoco.MjModel, number: int) -> int:
    """A texture of the model, with mip maps. 2-D textures repeat."""
    height, width, channels = (int(of[number]) for of in (model.tex_height, model.tex_width, model.tex_nchannel))
    start = int(model.tex_adr[number])
    pixels = model.tex_data[start : start + height * width * channels].reshape(height, width, channels)
    flat = model.tex_type[number] == mujoco.mjtTexture.mjTEXTURE_2D
    target = GL.GL_TEXTURE_2D if flat else GL.GL_TEXTURE_CUBE_MAP
    GL.glActiveTexture(GL.GL_TEXTURE0)
    GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
    texture, kind = int(GL.glGenTextures(1)), {1: GL.GL_RED, 3: GL.GL_RGB, 4: GL.GL_RGBA}[channels]
    GL.glBindTexture(target, texture)
    for side, part in _sides(GL, bool(flat), pixels):
        GL.glTexImage2D(side, 0, GL.GL_RGBA8, part.shape[1], part.shape[0], 0, kind, GL.GL_UNSIGNED_BYTE, np.ascontiguousarray(part))
    GL.glGenerateMipmap(target)
    wrap = GL.GL_REPEAT if flat else GL.GL_CLAMP_TO_EDGE
    # The sky needs no mip maps: its distance does not change.
    sky = model.tex_type[number] == mujoco.mjtTexture.mjTEXTURE_SKYBOX
    smoothing = GL.GL_LINEAR if sky else GL.GL_LINEAR_MIPMAP_LINEAR
    for name, value in ((GL.GL_TEXTURE_WRAP_S, wrap), (GL.GL_TEXTURE_WRAP_T, wrap), (GL.GL_TEXTURE_MIN_FILTER, smoothing)):
        GL.glTexParameteri(target, name, value)
    return texture


def _sides(GL: Any, flat: bool, pixels: NDArray[np.uint8]) -> Iterable[tuple[int, NDArray[np.uint8]]]:
    """Targets and pixels: one for a 2-D texture, six for a cube texture. A cube texture with a single square repeats it on all sides."""
    if flat:
        return [(GL.GL_TEXTURE_2D, pixels)]
    side = pixels.shape[1]
    return [(GL.GL_TEXTURE_CUBE_MAP_POSITIVE_X + k, pixels[k * side : (k + 1) * side] if len(pixels) == 6 * side else pixels) for k in range(6)]


def _line(words: bytes | str) -> str:
    return " ".join((words.decode() if isinstance(words, bytes) else words).split())[:200]
