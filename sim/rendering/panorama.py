"""Offscreen rendering of a MuJoCo scene for any camera: colour, instances, semantic classes and range of the same MjData.

    with PanoramaRenderer(model, [Panorama(1024, 512), Tsai(...)], instance_of_geom) as renderer:
        images = renderer.render(data, [T_world_robot_camera, T_world_fixed_camera], which=[0, 1])

One renderer serves several cameras of any kind in tracker.geometry.cameras. Each image is sampled from perspective faces (sim.rendering.cubemap),
which are drawn into one buffer in one pass and read back at once.
`unoccluded` draws single bodies into the same faces, to find the pixels that they would cover without occlusion.
"""

from __future__ import annotations

import atexit
import weakref
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.rendering.coverage import BITS, UnoccludedExtent, covered
from sim.rendering.cubemap import Face, FaceTable, RenderedImage
from sim.rendering.draw_list import DrawList
from sim.rendering.gl_context import GLInformation, gl_information, open_context, watched
from sim.rendering.gl_objects import DriverTraffic
from sim.rendering.opengl_renderer import OpenGLRenderer
from sim.rendering.shaders import projection
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera
from worlds.engine import mujoco

NEAR = 0.02
"""m: near plane. The depth buffer is reversed floating point, so that a close near plane costs no precision."""


class PanoramaRenderer:
    """Renders a scene for cameras at given poses. It is a context manager; `close` frees the OpenGL context.

    model: compiled; it is not changed. cameras: one or several. instance_of_geom (ngeom,) uint16: 0 is the background.
    class_of_geom: (ngeom,) uint8; 0 for all where None.
    Geom groups 0 to 3 are drawn, sites and other decoration are not.
    Raises ValueError for arrays of another shape or type, GLUnavailable without OpenGL.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        cameras: Camera | Sequence[Camera],
        instance_of_geom: NDArray[np.uint16],
        class_of_geom: NDArray[np.uint8] | None = None,
    ) -> None:
        self._instance_of_code = _table_by_code(model, "instance_of_geom", instance_of_geom, np.uint16)
        kinds = np.zeros(model.ngeom, np.uint8) if class_of_geom is None else class_of_geom
        self._class_of_code = _table_by_code(model, "class_of_geom", kinds, np.uint8)
        self.cameras: tuple[Camera, ...] = tuple(cameras) if isinstance(cameras, Sequence) else (cameras,)
        if not self.cameras:
            raise ValueError("there are 0 cameras, needs at least 1")
        self._tables = [FaceTable.make(camera) for camera in self.cameras]
        self._planes = [np.stack([face.planes for face in table.faces]) for table in self._tables]
        self._resolution = [max(face.resolution for face in table.faces) for table in self._tables]
        self._draw_list = DrawList(model)
        self._far = float(model.vis.map.zfar * model.stat.extent)
        self._gl = open_context()
        # The finalizer refers to the context only: a reference to self would keep the renderer alive. It must also run before the
        # exit handler of the backend, which the first context registered. Exit handlers run in reverse order: hence the one below.
        self._finalizer = weakref.finalize(self, self._gl.free)
        self._finalizer.atexit = False
        atexit.register(self._finalizer)
        size = max(table.width for table in self._tables), max(table.height for table in self._tables)
        try:
            with watched("uploading the scene"):
                self._renderer = OpenGLRenderer(self._gl, model, self._draw_list, size)
        except Exception:
            self.close()
            raise

    def __enter__(self) -> PanoramaRenderer:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the context and its buffers. A second call does nothing."""
        self._finalizer()
        atexit.unregister(self._finalizer)

    @property
    def information(self) -> GLInformation:
        """Vendor, renderer and version of the driver."""
        self._make_current()
        return gl_information(self._gl)

    @property
    def traffic(self) -> DriverTraffic:
        """Traffic between this renderer and the driver since the scene was uploaded."""
        return replace(self._renderer.traffic)

    def render(self, data: mujoco.MjData, poses: Sequence[Pose], which: Sequence[int] | None = None) -> list[RenderedImage]:
        """Images of cameras at `poses` (T_world_camera). `data` must be up to date (mj_forward, mj_step or mj_kinematics).

        which: index in `cameras` for each pose; the first camera for all where None.
        """
        indices = self._camera_indices(poses, which)
        self._make_current()
        self._draw_list.update(data)
        with watched("drawing"):
            self._renderer.update(data)
        return [self._render_camera(pose, index) for pose, index in zip(poses, indices, strict=True)]

    def unoccluded(
        self, data: mujoco.MjData, poses: Sequence[Pose], instances: Sequence[int], which: Sequence[int] | None = None
    ) -> list[list[UnoccludedExtent]]:
        """Extents of `instances` without occlusion, per pose and per instance. which: as in `render`.

        The faces and the arithmetic are those of `render`: a pixel where `render` shows an instance is always in its extent.
        """
        for instance in instances:
            if not 0 < instance < 1 << 16:
                raise ValueError(f"instance is {instance}, needs 1 to {(1 << 16) - 1}")
        indices = self._camera_indices(poses, which)
        self._make_current()
        self._draw_list.update(data)
        groups = [list(instances[k : k + BITS]) for k in range(0, len(instances), BITS)]
        out: list[list[UnoccludedExtent]] = [[] for _ in poses]
        owner = self._instance_of_code[self._draw_list.records["code"]]
        for group in groups:
            slots = np.zeros(len(owner), np.uint32)
            for k, instance in enumerate(group):
                slots[owner == instance] = 1 << k
            # The bits of a group are uploaded once for all cameras.
            with watched("drawing"):
                self._renderer.upload_slots(slots)
            marked = np.flatnonzero(slots)
            for extents, pose, index in zip(out, poses, indices, strict=True):
                extents += self._unoccluded(pose, marked, len(group), index)
        return out

    def _camera_indices(self, poses: Sequence[Pose], which: Sequence[int] | None) -> Sequence[int]:
        indices = [0] * len(poses) if which is None else which
        if len(indices) != len(poses) or any(not 0 <= index < len(self.cameras) for index in indices):
            raise ValueError(f"which is {list(indices)}, needs {len(poses)} numbers of cameras, 0 to {len(self.cameras) - 1}")
        return indices

    def _make_current(self) -> None:
        if not self._finalizer.alive:
            raise ValueError("renderer is closed, needs to be open")
        self._gl.make_current()

    def _render_camera(self, pose: Pose, index: int) -> RenderedImage:
        table, renderer = self._tables[index], self._renderer
        draw_commands = self._draw_list.visible_from(pose, self._planes[index], self._resolution[index])
        with watched("drawing"):
            renderer.begin(pose.translation)
            starts = renderer.upload_faces(draw_commands)
            for face, listed, start in zip(table.faces, draw_commands, starts, strict=True):
                edges = np.concatenate([face.low, face.high])
                renderer.draw(_viewport(face), self._projection(pose, face), listed, start)
                renderer.draw_sky(_viewport(face), (face.axes @ pose.rotation.T).T, edges)
            atlas = renderer.read(table.width, table.height)
        return table.sample(atlas, (NEAR, self._far), (self._instance_of_code, self._class_of_code))

    def _unoccluded(self, pose: Pose, marked: NDArray[np.int64], bodies: int, index: int) -> list[UnoccludedExtent]:
        """Extents of `bodies` bodies for a camera. marked: the records that are drawn, which have the bits of the bodies."""
        table, camera = self._tables[index], self.cameras[index]
        draw_commands = self._draw_list.visible_from(pose, self._planes[index], self._resolution[index], marked)
        faces = [(_viewport(face), self._projection(pose, face), of) for face, of in zip(table.faces, draw_commands, strict=True) if len(of.commands)]
        with watched("drawing"):
            bits = self._renderer.coverage_bits(faces, (table.width, table.height))
        return covered(bits, table.nearest, bodies, camera.wraps)

    def _projection(self, pose: Pose, face: Face) -> Array:
        return projection(pose, face.axes, np.concatenate([face.low, face.high]), (NEAR, self._far))


def _viewport(face: Face) -> tuple[int, int, int, int]:
    return 0, face.row, face.width, face.height


def _table_by_code(model: mujoco.MjModel, name: str, of_geom: NDArray[Any], kind: type) -> NDArray[Any]:
    """Lookup table from code to value: 0 for code 0, then the values of the geoms in order."""
    values = np.asarray(of_geom)
    if values.shape != (model.ngeom,) or values.dtype != kind:
        raise ValueError(f"{name} is {values.dtype} of shape {values.shape}, needs {np.dtype(kind)} of shape ({model.ngeom},)")
    return np.concatenate([np.zeros(1, kind), values])
