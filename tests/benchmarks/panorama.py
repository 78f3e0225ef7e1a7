"""Panoramas compared with the common alternative: six faces by mujoco.Renderer at its defaults, joined by py360convert.

Both render the same scene (pilsun, four robots) at 1024 x 512 with colour and instances, by EGL and by OSMesa, on one thread. The table shows
processor time per panorama, ms, the minimum of some runs. PSNR compares both with MuJoCo's own picture at four times the resolution.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.rendering.cubemap import CUBE
from sim.rendering.gl_context import GLUnavailable, open_context
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from worlds.engine import mujoco

CAMERA = Panorama(1024, 512)
SIDE, FINE = 256, 4
DEFAULTS = {"shadowsize": 4096, "offsamples": 4, "numslices": 28, "numstacks": 16, "numquads": 4}
PEOPLE, SIZES = (1, 10, 50, 100, 200), (512, 1024, 2048, 4096)


class Faces:
    """The six faces of a cube, rendered by mujoco.Renderer."""

    def __init__(self, simulation: Simulation, side: int) -> None:
        model = simulation.model
        model.vis.global_.offwidth = model.vis.global_.offheight = side
        for name, value in DEFAULTS.items():
            setattr(model.vis.quality, name, value)
        self.data, self.far = simulation.data, model.vis.map.zfar * model.stat.extent
        self.renderer = mujoco.Renderer(model, side, side, max_geom=model.ngeom + 1000)
        self.option = mujoco.MjvOption()
        self.option.geomgroup[:] = (1, 1, 1, 1, 0, 0)

    def take(self, pose: Pose, labels: bool) -> list[NDArray[Any]]:
        """Render the faces in the order of CUBE: (side, side, 3) colours, or (side, side) geom + 1."""
        (self.renderer.enable_segmentation_rendering if labels else self.renderer.disable_segmentation_rendering)()
        out = []
        for axes in CUBE @ pose.rotation.T:
            self.renderer.update_scene(self.data, mujoco.MjvCamera(), self.option)
            scene = self.renderer.scene
            for camera in scene.camera:
                camera.pos, camera.forward, camera.up = pose.translation, axes[0], axes[2]
                camera.frustum_center, camera.frustum_width, camera.orthographic = 0, 0.02, 0
                camera.frustum_bottom, camera.frustum_top, camera.frustum_near, camera.frustum_far = -0.02, 0.02, 0.02, self.far
            for light in scene.lights[: scene.nlight]:
                light.pos = pose.translation if light.headlight else light.pos
            picture = self.renderer.render()
            out.append(picture[..., 0] + 1 if labels else picture.copy())
        return out


def joined(faces: list[NDArray[Any]], mode: str) -> NDArray[Any]:
    """The panorama that py360convert makes of six faces."""
    import py360convert

    side = len(faces[0])
    dice = np.zeros((3 * side, 4 * side, *faces[0].shape[2:]), faces[0].dtype)
    ahead, left, behind, right, up, down = faces
    for row, column, face in ((1, 1, ahead), (1, 0, left), (1, 3, behind), (1, 2, right), (0, 1, up), (2, 1, down)):
        dice[row * side : (row + 1) * side, column * side : (column + 1) * side] = face
    return np.asarray(py360convert.c2e(dice, CAMERA.height, CAMERA.width, mode=mode, cube_format="dice"))


def reference(simulation: Simulation, pose: Pose) -> NDArray[np.float64]:
    """The panorama as MuJoCo renders it, each pixel the mean of FINE x FINE."""
    side = SIDE * 3 // 2 * FINE
    faces = Faces(simulation, side)
    pictures = faces.take(pose, False)
    faces.renderer.close()
    u, v = np.meshgrid((np.arange(CAMERA.width * FINE) + 0.5) / FINE, (np.arange(CAMERA.height * FINE) + 0.5) / FINE)
    rays = CAMERA.bearings_from_pixels(np.stack([u.ravel(), v.ravel()], axis=1))
    number = np.argmax(rays @ CUBE[:, 0].T, axis=1).reshape(u.shape)
    fine = np.zeros((*u.shape, 3), np.uint8)
    for k, (axes, picture) in enumerate(zip(CUBE, pictures, strict=True)):
        at = rays @ axes.T
        x, y = (((1 + sign * at[:, j] / at[:, 0]) * side / 2 - 0.5).reshape(u.shape).astype(np.float32) for j, sign in ((1, 1), (2, -1)))
        sampled = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        fine[number == k] = sampled[number == k]
    return np.asarray(fine.reshape(CAMERA.height, FINE, CAMERA.width, FINE, 3).mean(axis=(1, 3)))


def psnr(picture: NDArray[Any], truth: NDArray[np.float64]) -> float:
    return float(10 * np.log10(255**2 / ((picture - truth) ** 2).mean()))


def in_turn(actions: Sequence[Callable[[], Any]], runs: int = 3) -> list[float]:
    """Processor time of each action, ms: the minimum of some runs after a warm-up.

    The actions run by turns, so that other work on the computer affects all of them.
    """
    spent: list[list[float]] = [[] for _ in actions]
    for _ in range(runs + 1):
        for action, times in zip(actions, spent, strict=True):
            started = time.process_time()
            action()
            times.append(time.process_time() - started)
    return [1000 * min(times[1:]) for times in spent]


def milliseconds(action: Callable[[], Any], runs: int = 3) -> float:
    """Processor time of an action, ms: the minimum of some runs after a warm-up."""
    return in_turn([action], runs)[0]


def compare_renderers(backend: str) -> None:
    """Print time and PSNR of our renderer and of the peer, with 10 and 74 people."""
    for people in (10, 74):
        # pilsun has no room for 200 people.
        simulation = Simulation(Scenario(people=people, world="pilsun" if people <= 100 else "campus"))
        poses = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
        owners = simulation.person_of_geom.astype(np.uint16)
        peer = Faces(simulation, SIDE)
        pose = poses[0]
        picture, truth = joined(peer.take(pose, False), "bilinear"), reference(simulation, pose)
        with PanoramaRenderer(simulation.model, CAMERA, owners) as renderer:
            theirs, ours, single = in_turn(
                [
                    lambda: (joined(peer.take(pose, False), "bilinear"), joined(peer.take(pose, True), "nearest")),  # noqa: B023
                    lambda: renderer.render(simulation.data, poses),  # noqa: B023
                    lambda: renderer.render(simulation.data, poses[:1]),  # noqa: B023
                ],
                5,
            )
            ours /= len(poses)
            (shot,) = renderer.render(simulation.data, poses[:1])
        peer.renderer.close()
        print(
            f"{backend:7} {people:3} people   ours {ours:6.1f} ms (one robot alone {single:6.1f})  {psnr(shot.colour, truth):5.2f} dB"
            f"   six faces {theirs:7.1f} ms  {psnr(picture, truth):5.2f} dB   {theirs / ours:5.1f} x",
            flush=True,
        )


def rates() -> None:
    """Print panoramas per second of our renderer against the number of people and against size: colour, instances and range."""
    for people, width in [*((n, 1024) for n in PEOPLE), *((10, w) for w in SIZES)]:
        # pilsun has no room for 200 people.
        simulation = Simulation(Scenario(people=people, world="pilsun" if people <= 100 else "campus"))
        poses = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
        owners, ids = simulation.person_of_geom.astype(np.uint16), simulation.persons.tolist()
        with PanoramaRenderer(simulation.model, Panorama(width, width // 2), owners) as renderer:
            drawn = milliseconds(lambda: renderer.render(simulation.data, poses), 2) / len(poses)  # noqa: B023
            unoccluded = milliseconds(lambda: renderer.unoccluded(simulation.data, poses, ids), 2) / len(poses)  # noqa: B023
        size = f"{width:4} x {width // 2:4}"
        print(f"{people:3} people {size}   {1000 / drawn:5.1f} panoramas/s   unoccluded pixels of each person: {unoccluded:6.1f} ms", flush=True)


def main() -> None:
    if len(sys.argv) > 1 and sys.argv[1] in ("egl", "osmesa"):
        if importlib.util.find_spec("py360convert") is None:
            print("py360convert is not installed: pip install --no-deps py360convert")
            return
        try:
            open_context().free()
        except GLUnavailable as error:
            print(f"{sys.argv[1]}: {error}")
            return
        compare_renderers(sys.argv[1])
        return
    open_context().free()
    kept = {key: value for key, value in os.environ.items() if key != "PYOPENGL_PLATFORM"} | {"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    for backend in ("egl", "osmesa"):
        subprocess.run([sys.executable, "-m", "tests.benchmarks.panorama", backend], env=kept | {"MUJOCO_GL": backend}, check=False)
    os.environ["LP_NUM_THREADS"] = "1"
    rates()


if __name__ == "__main__":
    main()
