"""Rendered panoramas of an episode: robots and people are bodies in the scene of its map."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.pedestrian import clothing, clothing_textures, gait, skeleton
from sim.placement.config import PlacementConfig
from sim.placement.episode import Episode
from sim.placement.map import PlacementMap
from sim.rendering.panorama import PanoramaRenderer
from sim.robots import rover
from sim.scenario import Scenario
from tracker.geometry import Array, Image, quaternion_from_rotation
from tracker.geometry.cameras import Panorama
from worlds.engine import mujoco


class CameraViews:
    """Renders the panoramas of robots. The scene of a map is compiled at its first panorama.

    `close` frees the OpenGL resources. They are never copied or pickled.
    """

    def __init__(self, config: PlacementConfig) -> None:
        self.config = config
        self._place: PlacementMap | None = None
        self._renderers: dict[int, PanoramaRenderer] = {}

    def render(self, episode: Episode, robots: list[int], width: int) -> list[Image]:
        """The panorama of each of these robots, (width / 2, width, 3) uint8 RGB. Raises GLUnavailable where there is no OpenGL."""
        if self._place is not episode.place:
            self.close()
            self._compile(episode.place)
        self._pose(episode)
        if width not in self._renderers:
            none = np.zeros(self._model.ngeom, dtype=np.uint16)
            self._renderers[width] = PanoramaRenderer(self._model, Panorama(width, width // 2), none)
        mount, poses = rover.camera_mount(self.config.camera_height), episode.mover.poses()
        return [frame.colour for frame in self._renderers[width].render(self._data, [poses[k] @ mount for k in robots])]

    def close(self) -> None:
        """Free the OpenGL resources. A later panorama opens them again."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers, self._place = {}, None

    def __getstate__(self) -> dict[str, Any]:
        return {"config": self.config}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["config"])  # type: ignore[misc]

    def _compile(self, place: PlacementMap) -> None:
        scenario, spec = Scenario(seed=place.key.seed), place.world.spec.copy()
        for k in range(self.config.robots):
            rover.add_rover(spec, f"robot_{k}", k, self.config.camera_height)
        clothing_textures.add_clothing_textures(spec, scenario.stream("fabrics"))
        for k, stature in enumerate(place.stature, start=1):
            rng = scenario.stream(f"person_{k}")
            skeleton.statures(rng, 1, 0.0)
            clothing.add_person(spec, f"person_{k}", float(stature), rng)
        self._model = clothing.compile_posed(spec)
        self._data, self._place = mujoco.MjData(self._model), place
        joints = [self._model.joint(f"robot_{k}").id for k in range(self.config.robots)]
        self._rows: Array = self._model.jnt_qposadr[joints][:, None] + np.arange(7)
        bodies = [[self._model.body(f"person_{k}/{limb}").mocapid[0] for limb in skeleton.LIMBS] for k in range(1, len(place.stature) + 1)]
        self._limbs = np.array(bodies, dtype=np.int64).reshape(-1, len(skeleton.LIMBS))

    def _pose(self, episode: Episode) -> None:
        place, crowd = episode.place, episode.mover.crowd
        for row, pose in zip(self._rows, episode.mover.poses(), strict=True):
            self._data.qpos[row] = [*pose.translation, *quaternion_from_rotation(pose.rotation)]
        if len(self._limbs):
            # Each person takes one step from standing: the episode keeps no history of gait.
            bodies = gait.Bodies(crowd.position, crowd.velocity, crowd.heading, place.stature)
            footing = gait.walk(gait.stand(crowd.position, crowd.heading, place.stature), bodies, 0.25)
            poses = skeleton.limb_poses(place.stature, footing, crowd.position, crowd.heading, place.world.terrain)
            self._data.mocap_pos[self._limbs], self._data.mocap_quat[self._limbs] = poses.position, poses.quaternion
        mujoco.mj_forward(self._model, self._data)
