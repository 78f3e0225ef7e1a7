"""Renderer in OpenGL: uploads a model's shapes, textures and lights, and draws faces into one framebuffer.

One pass draws the colour, the geom code and the depth of a face. All commands of one surface are one indirect draw call.
It needs OpenGL 4.3 and clip control, which Mesa's software renderers support.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.rendering import gl_objects, shaders
from sim.rendering.cubemap import Atlas
from sim.rendering.draw_list import COMMAND, CUBE_MAPPED, RECORD, Batch, DrawCommands, DrawList
from sim.rendering.gl_context import largest_buffer, use_reversed_depth
from sim.rendering.shaders import Lights
from tracker.geometry import Array
from worlds.engine import mujoco

SHADOW_SIZE = 2048
"""Texels along the edge of a shadow map. It is drawn once a frame for all cameras."""
SHADOW_BIAS = 1.5
"""Texels of the shadow map by which a surface is moved along its normal before the lookup, against self-shadowing."""

Place = tuple[int, int, int, int]
"""Viewport in the buffer: left, bottom, width, height, px."""


class OpenGLRenderer:
    """Draws a model with one OpenGL context, which must be current in every call. Freeing the context frees its objects.

    size: width and height of the buffer, px. Raises GLUnavailable for an OpenGL that is too old, ValueError for a size beyond its limit.
    """

    def __init__(self, context: Any, model: mujoco.MjModel, drawn: DrawList, size: tuple[int, int]) -> None:
        limit = largest_buffer(context)
        if max(size) > limit:
            raise ValueError(f"the faces of the cameras need a buffer of {size[0]} x {size[1]} px; OpenGL's limit is {limit} px")
        from OpenGL import GL

        self._gl: Any = GL
        self.traffic = gl_objects.DriverTraffic()
        gl_objects.check(GL)
        self._model, self._draw_list, self._size = model, drawn, size
        self.lights = Lights.of(model)
        self._uniform_locations: dict[tuple[int, str], int] = {}
        self._atlas_buffers: dict[tuple[int, int], Atlas] = {}
        self._upload_shapes()
        texts = shaders.programs(len(self.lights.index), self.lights.shadows)
        self._programs = {kind: gl_objects.program(GL, *text) for kind, text in texts.items()}
        self._depth_program = gl_objects.program(GL, shaders.INPUTS + shaders.DEPTH_VERTEX, shaders.DEPTH_FRAGMENT)
        self._mark_program = gl_objects.program(GL, shaders.INPUTS + shaders.MARK_VERTEX, shaders.MARK_FRAGMENT)
        self._sky_program = gl_objects.program(GL, shaders.SKY_VERTEX, shaders.SKY_FRAGMENT)
        self._textures = [gl_objects.texture_of(GL, model, k) for k in range(model.ntex)]
        skies = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
        self._sky = self._textures[skies[0]] if len(skies) else None
        self._make_framebuffers()

    def update(self, data: mujoco.MjData) -> None:
        """Upload the current records of the draw list, and draw the shadow maps."""
        GL = self._gl
        self._upload(GL.GL_ARRAY_BUFFER, self._record_buffer, self._draw_list.records)
        self._data = data
        self._cast_shadows(data)

    def begin(self, eye: Array) -> None:
        """Clear the buffer, and set the lights for a camera at `eye` (3,) m, world."""
        GL = self._gl
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        GL.glViewport(0, 0, *self._size)
        GL.glClearBufferfv(GL.GL_COLOR, 0, np.zeros(4, np.float32))
        GL.glClearBufferuiv(GL.GL_COLOR, 1, np.zeros(4, np.uint32))
        GL.glClearBufferfv(GL.GL_DEPTH, 0, np.zeros(1, np.float32))
        parameters = self.lights.parameters_at(self._data, eye)
        parameters[: self.lights.shadows, 2, 3] = self._shadow_biases
        for program in self._programs.values():
            GL.glUseProgram(program)
            GL.glUniform4fv(self._uniform_location(program, "lights"), parameters.size // 4, parameters)
            GL.glUniform4f(self._uniform_location(program, "eye"), *eye, self.lights.ambient)
            if self.lights.shadows:
                GL.glUniformMatrix4fv(self._uniform_location(program, "shadows"), self.lights.shadows, GL.GL_TRUE, self._shadow_matrices)

    def upload_faces(self, faces: Sequence[DrawCommands]) -> list[int]:
        """Upload the commands of all faces of a camera at once. Returns the number of the first command of each face."""
        counts = [len(face.commands) for face in faces]
        if sum(counts):
            self._upload_commands(np.concatenate([face.commands for face in faces]))
        return [sum(counts[:k]) for k in range(len(counts))]

    def draw(self, place: Place, matrix: Array, draw_commands: DrawCommands, start: int) -> None:
        """Draw a face into the viewport `place` (left, bottom, width, height); matrix (4, 4): projection from world to clip space.

        start: number of the face's first command, of `upload_faces`.
        """
        GL = self._gl
        GL.glViewport(*place)
        blending, kind, placed = False, -1, set[int]()
        for batch in draw_commands.batches:
            if batch.blended and not blending:
                blending = True
                GL.glEnablei(GL.GL_BLEND, 0)
                GL.glBlendFunc(GL.GL_SRC_ALPHA, GL.GL_ONE_MINUS_SRC_ALPHA)
            if batch.kind != kind:
                kind = batch.kind
                self._use_program(self._programs[kind], None if kind in placed else matrix)
                placed.add(kind)
            if batch.texture >= 0:
                GL.glActiveTexture(GL.GL_TEXTURE0)
                target = GL.GL_TEXTURE_CUBE_MAP if batch.kind == CUBE_MAPPED else GL.GL_TEXTURE_2D
                GL.glBindTexture(target, self._textures[batch.texture])
            self._draw_batch(batch, start)
        if blending:
            GL.glDisablei(GL.GL_BLEND, 0)

    def draw_sky(self, place: Place, axes: Array, edges: Array) -> None:
        """Fill the empty texels of `place` with the sky. axes (3, 3): columns forward, right, up, world. edges (4,): as in `projection`."""
        if self._sky is None:
            return
        GL = self._gl
        GL.glViewport(*place)
        GL.glUseProgram(self._sky_program)
        GL.glUniformMatrix3fv(self._uniform_location(self._sky_program, "ways"), 1, GL.GL_TRUE, np.ascontiguousarray(axes, dtype=np.float32))
        GL.glUniform4f(self._uniform_location(self._sky_program, "window"), *edges)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        GL.glBindTexture(GL.GL_TEXTURE_CUBE_MAP, self._sky)
        GL.glDepthFunc(GL.GL_EQUAL)
        self.traffic.draws += 1
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
        GL.glDepthFunc(GL.GL_GREATER)

    def read(self, width: int, height: int) -> Atlas:
        """Read back the lower left of the buffer. The arrays are valid until the next call."""
        GL = self._gl
        if (width, height) not in self._atlas_buffers:
            arrays = np.empty((height, width, 4), np.uint8), np.empty((height, width), np.uint32), np.empty((height, width), np.float32)
            self._atlas_buffers[width, height] = Atlas(*arrays)
        atlas = self._atlas_buffers[width, height]
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0)
        GL.glReadPixels(0, 0, width, height, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, atlas.colour)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT1)
        GL.glReadPixels(0, 0, width, height, GL.GL_RED_INTEGER, GL.GL_UNSIGNED_INT, atlas.codes)
        GL.glReadPixels(0, 0, width, height, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT, atlas.depth)
        for array in (atlas.colour, atlas.codes, atlas.depth):
            self.traffic.read_back(array.nbytes)
        return atlas

    def upload_slots(self, slots: NDArray[np.uint32]) -> None:
        """Upload the current records of the draw list with the bit of every record, slots (m,), for `coverage_bits`."""
        self._draw_list.records["slot"] = slots
        self._upload(self._gl.GL_ARRAY_BUFFER, self._record_buffer, self._draw_list.records)

    def coverage_bits(self, faces: Sequence[tuple[Place, Array, DrawCommands]], size: tuple[int, int]) -> NDArray[np.uint32]:
        """Bits (height, width) of all bodies that cover a texel at any depth. Call `upload_slots` before.

        faces: viewport, projection and commands of each face, as in `draw`.
        """
        GL = self._gl
        starts = self.upload_faces([face[2] for face in faces])
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._mark_framebuffer)
        GL.glClearBufferuiv(GL.GL_COLOR, 0, np.zeros(4, np.uint32))
        GL.glDisable(GL.GL_DEPTH_TEST)
        GL.glEnable(GL.GL_COLOR_LOGIC_OP)
        GL.glLogicOp(GL.GL_OR)
        for (place, matrix, draw_commands), start in zip(faces, starts, strict=True):
            GL.glViewport(*place)
            self._use_program(self._mark_program, matrix)
            self._draw_batch(Batch(0, -1, False, 0, len(draw_commands.commands)), start)
        GL.glDisable(GL.GL_COLOR_LOGIC_OP)
        GL.glEnable(GL.GL_DEPTH_TEST)
        bits = np.empty(size[::-1], np.uint32)
        GL.glReadPixels(0, 0, *size, GL.GL_RED_INTEGER, GL.GL_UNSIGNED_INT, bits)
        self.traffic.read_back(bits.nbytes)
        return bits

    def _cast_shadows(self, data: mujoco.MjData) -> None:
        """Draw the shadow maps of the current frame."""
        GL, drawn = self._gl, self._draw_list
        bounded = drawn.present & ~drawn.infinite
        signs = np.mgrid[-1:2:2, -1:2:2, -1:2:2].reshape(3, -1).T
        around = drawn.centres[bounded] + signs[:, None] * np.abs(drawn.halves[bounded]).sum(axis=2)
        corners = around.reshape(-1, 3)
        casting = np.flatnonzero(drawn.casts_shadow & bounded)
        self._shadow_matrices, self._shadow_biases = np.zeros((self.lights.shadows, 4, 4), np.float32), np.zeros(self.lights.shadows, np.float32)
        for k in range(self.lights.shadows):
            light = int(self.lights.index[k])
            beam = None if self.lights.directional[k] else float(np.radians(self._model.light_cutoff[light]))
            matrix = shaders.shadow_view(np.concatenate([data.light_xpos[light], data.light_xdir[light]]), beam, corners)
            per_metre = SHADOW_SIZE / 2 * np.linalg.norm(matrix[:2, :3], axis=1).max()
            self._shadow_biases[k] = SHADOW_BIAS / per_metre if beam is None else 0.01
            self._shadow_matrices[k] = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]]) @ matrix
            GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._shadow_frames[k])
            GL.glViewport(0, 0, SHADOW_SIZE, SHADOW_SIZE)
            GL.glClearBufferfv(GL.GL_DEPTH, 0, np.ones(1, np.float32))
            self._use_program(self._depth_program, matrix)
            # Thin sheets cast shadows from either side, so that back faces are drawn, too.
            GL.glDisable(GL.GL_CULL_FACE)
            GL.glDepthFunc(GL.GL_LESS)
            self._upload_commands(drawn.commands(casting, drawn.radius[casting] * per_metre / SHADOW_BIAS / 2))
            self._draw_batch(Batch(0, -1, False, 0, len(casting)), 0)
            GL.glDepthFunc(GL.GL_GREATER)
            GL.glEnable(GL.GL_CULL_FACE)

    def _upload_commands(self, commands: NDArray[np.void]) -> None:
        self._upload(self._gl.GL_DRAW_INDIRECT_BUFFER, self._command_buffer, np.ascontiguousarray(commands))

    def _upload(self, target: int, buffer: int, content: NDArray[np.void]) -> None:
        """Replace the content of a buffer, and leave it bound."""
        GL = self._gl
        GL.glBindBuffer(target, buffer)
        GL.glBufferData(target, content.nbytes, content, GL.GL_STREAM_DRAW)
        self.traffic.upload(content.nbytes)

    def _draw_batch(self, batch: Batch, start: int) -> None:
        GL = self._gl
        if batch.last > batch.first:
            self.traffic.draws += 1
            offset = ctypes.c_void_p((start + batch.first) * COMMAND.itemsize)
            GL.glMultiDrawElementsIndirect(GL.GL_TRIANGLES, GL.GL_UNSIGNED_INT, offset, batch.last - batch.first, COMMAND.itemsize)

    def _use_program(self, program: int, matrix: Array | None) -> None:
        """Use a program. matrix: its projection, unchanged where None."""
        GL = self._gl
        GL.glUseProgram(program)
        if matrix is not None:
            GL.glUniformMatrix4fv(self._uniform_location(program, "projection"), 1, GL.GL_TRUE, np.ascontiguousarray(matrix, dtype=np.float32))

    def _uniform_location(self, program: int, name: str) -> int:
        key = program, name
        if key not in self._uniform_locations:
            self._uniform_locations[key] = self._gl.glGetUniformLocation(program, name)
        return self._uniform_locations[key]

    def _upload_shapes(self) -> None:
        """Upload vertices and indices, and set the layout of vertices and records."""
        GL, buffers = self._gl, self._draw_list.buffers
        GL.glBindVertexArray(GL.glGenVertexArrays(1))
        vertices, indices, self._record_buffer, self._command_buffer = (int(name) for name in GL.glGenBuffers(4))
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, vertices)
        GL.glBufferData(GL.GL_ARRAY_BUFFER, buffers.vertices.nbytes, buffers.vertices, GL.GL_STATIC_DRAW)
        for place, (size, start) in enumerate(((4, 0), (3, 4), (2, 7))):
            GL.glEnableVertexAttribArray(place)
            GL.glVertexAttribPointer(place, size, GL.GL_FLOAT, False, 36, ctypes.c_void_p(4 * start))
        GL.glBindBuffer(GL.GL_ELEMENT_ARRAY_BUFFER, indices)
        GL.glBufferData(GL.GL_ELEMENT_ARRAY_BUFFER, buffers.indices.nbytes, buffers.indices, GL.GL_STATIC_DRAW)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._record_buffer)
        for place in range(3, 11):
            GL.glEnableVertexAttribArray(place)
            GL.glVertexAttribDivisor(place, 1)
            offset = ctypes.c_void_p(16 * (place - 3))
            if place < 10:
                GL.glVertexAttribPointer(place, 4, GL.GL_FLOAT, False, RECORD.itemsize, offset)
            else:
                GL.glVertexAttribIPointer(place, 2, GL.GL_UNSIGNED_INT, RECORD.itemsize, offset)

    def _make_framebuffers(self) -> None:
        """Make the framebuffers, and set the state that stays constant."""
        GL = self._gl
        self._framebuffer = gl_objects.framebuffer(GL, self._size, [GL.GL_RGBA8, GL.GL_R32UI], GL.GL_DEPTH_COMPONENT32F)
        self._mark_framebuffer = gl_objects.framebuffer(GL, self._size, [GL.GL_R32UI], None)
        self._shadow_frames = [gl_objects.shadow_map(GL, 1 + k, SHADOW_SIZE) for k in range(self.lights.shadows)]
        for program in self._programs.values():
            GL.glUseProgram(program)
            if self.lights.shadows:
                GL.glUniform1iv(self._uniform_location(program, "hidden"), self.lights.shadows, np.arange(1, 1 + self.lights.shadows, dtype=np.int32))
        use_reversed_depth()
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthFunc(GL.GL_GREATER)
        GL.glEnable(GL.GL_CULL_FACE)
        GL.glEnable(GL.GL_TEXTURE_CUBE_MAP_SEAMLESS)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
