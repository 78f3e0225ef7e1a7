"""Panoramas of a MuJoCo scene without a screen: colour, instances and range, all three from the same data.

Six faces of a cube are drawn into one buffer and read back at once, first in colour, then with one code a geom, whose depth is the
range. `alone` draws single bodies into the same faces, pixel for pixel, to learn what they would cover if nothing hid them.
MuJoCo's camera frame (looking along forward, with up) does not leave this file.
"""

from __future__ import annotations

import atexit
import weakref
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.cubemap import FACES, CubeTable, half_tangent
from sim.drawlist import DrawList
from sim.gl import GLInformation, GLUnavailable, draw_list, gl_information, largest_buffer, open_context
from sim.windows import Window, around, columns, layers, tight
from tracker.cameras import Panorama
from tracker.geometry import Array, Pose

NEAR = 0.02
"""m: nothing nearer to the camera is drawn. The depth buffer is floating point and reversed, so that this costs no precision."""
QUALITY = {"offsamples": 0, "shadowsize": 1024, "numslices": 12, "numstacks": 8}
"""Faster and, at these sizes, nearer to a supersampled reference than MuJoCo's defaults (DESIGN 7)."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One panorama: colour (H, W, 3) RGB, instances (H, W) with 0 for the background, range (H, W) m along the ray, inf where nothing is."""

    colour: NDArray[np.uint8]
    instances: NDArray[np.uint16]
    range: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Alone:
    """What one instance covers where nothing else is there.

    pixels: their number; box (4,) u0, v0, u1, v1 px around them with u0 in [0, W) and u1 in (u0, u0 + W], beyond W where it goes over
    the seam; NaN where no pixel is covered.
    """

    pixels: int
    box: Array


class PanoramaRenderer:
    """Draws what panoramas at given poses see of a scene. A context manager; `close` frees what the driver holds.

    model: compiled; it is left as it was. camera: the panorama. instance_of_geom (ngeom,) uint16: 0 is the background.
    face: texels of a cube's face, ⅜ of the width where None. Geom groups 0 to 3 are drawn, sites and other decoration are not.
    Raises ValueError for what does not fit, GLUnavailable where there is no OpenGL.
    """

    def __init__(self, model: mujoco.MjModel, camera: Panorama, instance_of_geom: NDArray[np.uint16], *, face: int | None = None) -> None:
        instances = np.asarray(instance_of_geom)
        if instances.shape != (model.ngeom,) or instances.dtype != np.uint16:
            raise ValueError(f"instance_of_geom is {instances.dtype} of shape {instances.shape}, needs uint16 of shape ({model.ngeom},)")
        self.camera = camera
        self._table = CubeTable.make(camera, round(camera.width * 3 / 8) if face is None else face)
        self._list = DrawList(model, instances.copy(), self._table.face)
        self._far = float(model.vis.map.zfar * model.stat.extent)
        side = self._table.face
        self._gl = open_context()
        self._mjr: Any = None
        # Bound to neither self nor its methods, or the renderer would never be collected. It must also run before the backend's own
        # exit handler, which was registered when the first context was made: hence a handler of ours, registered now.
        self._finalizer = weakref.finalize(self, _free, self._gl, held := [])
        self._finalizer.atexit = False
        atexit.register(self._finalizer)
        limit = largest_buffer(self._gl)
        if 6 * side > limit:
            self.close()
            raise ValueError(f"panorama of {camera.width} px has faces of {side} px, six of which need {6 * side} px; OpenGL's limit is {limit} px")
        self._codes = np.zeros((6 * side, side, 3), np.uint8)
        self._depth = np.zeros((6 * side, side), np.float32)
        self._mjr = _drawing_context(model, side)
        held.append(self._mjr)
        # MuJoCo finds a height field's display list by its number after a base: ours have numbers beyond those of its own.
        base = self._mjr.baseHField
        self._list.name_tiles([[draw_list(tile.corners, tile.normals) - base for tile in tiles] for tiles in self._list.tiles])

    def __enter__(self) -> PanoramaRenderer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Free the context and its buffers; a second call does nothing."""
        self._finalizer()
        atexit.unregister(self._finalizer)

    @property
    def information(self) -> GLInformation:
        """Who draws."""
        self._enter()
        return gl_information(self._gl)

    def render(self, data: mujoco.MjData, poses: Sequence[Pose]) -> list[Shot]:
        """What cameras at `poses` (T_world_camera) see of `data`, which has been brought up to date (mj_forward, mj_step or mj_kinematics)."""
        self._enter()
        self._list.update(data)
        return [self._shot(pose) for pose in poses]

    def alone(self, data: mujoco.MjData, poses: Sequence[Pose], instances: Sequence[int]) -> list[list[Alone]]:
        """Per pose and per instance, what the instance would cover if nothing else were there.

        The faces are drawn as in `render`, by the same numbers: a pixel where `render` shows the instance is always among them.
        """
        for instance in instances:
            if not 0 < instance < 1 << 16:
                raise ValueError(f"instance is {instance}, needs 1 to {(1 << 16) - 1}")
        self._enter()
        self._list.update(data)
        return [self._alone(pose, instances) for pose in poses]

    def _enter(self) -> None:
        if not self._finalizer.alive:
            raise ValueError("renderer is closed, needs to be open")
        self._gl.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._mjr)

    def _shot(self, pose: Pose) -> Shot:
        drawing = self._list.seen_from(pose)
        whole = self._rectangle(range(6))
        for face in range(6):
            self._draw(pose, face, drawing.coloured[face], coded=False)
        mujoco.mjr_readPixels(self._codes, None, whole, self._mjr)
        colour = self._table.colour(self._codes)
        for face in range(6):
            self._draw(pose, face, drawing.seen[face], coded=True)
        mujoco.mjr_readPixels(self._codes, self._depth, whole, self._mjr)
        instances, distance = self._table.geometry(self._codes, self._depth, self._list.instance_of_code, NEAR, self._far)
        return Shot(colour, instances, distance)

    def _alone(self, pose: Pose, instances: Sequence[int]) -> list[Alone]:
        seen, side, width = self._list.seen_from(pose).seen, self._table.face, self.camera.width
        windows = [around(*self._list.balls(pose, instance), self.camera) for instance in instances]
        found: dict[int, Alone] = {}
        for layer in layers(windows, width):
            members = np.concatenate([self._list.geoms_of(instances[k]) for k in layer])
            for face in range(6):
                block, shown = self._codes[face * side : (face + 1) * side], np.intersect1d(seen[face], members, assume_unique=True)
                if len(shown):
                    self._draw(pose, face, shown, coded=True)
                    mujoco.mjr_readPixels(block, None, self._rectangle([face]), self._mjr)
                else:
                    block.fill(0)
            for k in layer:
                mask = self._mask(instances[k], windows[k])
                found[k] = Alone(int(mask.sum()), tight(mask, windows[k], width))
        return [found[k] for k in range(len(instances))]

    def _mask(self, instance: int, window: Window) -> NDArray[np.bool_]:
        """Which pixels of a window show an instance, by the codes read last."""
        texels = self._table.nearest[window[1] : window[3]].take(columns(window, self.camera.width), axis=1)
        codes = self._codes.reshape(-1, 3).take(texels.ravel(), axis=0).astype(np.int32) @ np.array([1, 256, 65536], np.int32)
        return np.asarray(self._list.instance_of_code[codes].reshape(texels.shape) == instance)

    def _rectangle(self, faces: Iterable[int]) -> mujoco.MjrRect:
        listed, side = list(faces), self._table.face
        return mujoco.MjrRect(0, listed[0] * side, side, len(listed) * side)

    def _draw(self, pose: Pose, face: int, shown: NDArray[np.int64], coded: bool) -> None:
        """Draw the listed geoms as seen through one face into its place of the buffer."""
        forward, _, up = FACES[face] @ pose.rotation.T
        half = NEAR * half_tangent(self._table.face)
        for camera in self._list.scene.camera:
            camera.pos, camera.forward, camera.up = pose.translation, forward, up
            camera.frustum_center, camera.frustum_width, camera.orthographic = 0.0, half, 0
            camera.frustum_bottom, camera.frustum_top = -half, half
            camera.frustum_near, camera.frustum_far = NEAR, self._far
        self._list.show(pose, shown, coded)
        mujoco.mjr_render(self._rectangle([face]), self._list.scene, self._mjr)


def _drawing_context(model: mujoco.MjModel, side: int) -> Any:
    """MuJoCo's drawing context on the current OpenGL context. Sizes and quality go in through the model, which is set back."""
    wanted = [(model.vis.global_, "offwidth", side), (model.vis.global_, "offheight", 6 * side)]
    wanted += [(model.vis.quality, name, value) for name, value in QUALITY.items()]
    before = [getattr(owner, name) for owner, name, _ in wanted]
    for owner, name, value in wanted:
        setattr(owner, name, value)
    try:
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
    except mujoco.FatalError as error:
        raise GLUnavailable(f"MuJoCo cannot draw with this OpenGL: {error}") from error
    finally:
        for (owner, name, _), value in zip(wanted, before, strict=True):
            setattr(owner, name, value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR.value
    return context


def _free(gl: Any, held: list[Any]) -> None:
    """Free MuJoCo's context while its OpenGL context is current, then that one."""
    if held:
        gl.make_current()
        held.pop().free()
    gl.free()
