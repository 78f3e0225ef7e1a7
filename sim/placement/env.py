"""The gymnasium environment `pilsim/Placement-v0`: robots move so that people stay visible.

    import gymnasium, sim
    env = gymnasium.make("pilsim/Placement-v0", world="ruins", robots=4, people=10)
    observation, info = env.reset(seed=7)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

An action is taken twice per second. Observations are those of observations.space_of. `info` holds every term of episode.TERMS.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from sim.pedestrian import clothing, clothing_textures, gait, skeleton
from sim.placement.config import DECISION_RATE, PlacementConfig
from sim.placement.episode import GOSPA, Episode, Reward, checked_reward, reward_of
from sim.placement.map import PlacementMap, map_of
from sim.placement.observations import Observation, bounded, empty, observe, space_of
from sim.placement.plan_view import draw_plan
from sim.rendering.panorama import PanoramaRenderer
from sim.robots import rover
from sim.scenario import Scenario
from tracker.geometry import Array, Image, quaternion_from_rotation
from tracker.geometry.cameras import Panorama
from worlds.engine import mujoco


class Placement(gymnasium.Env[Observation, Array]):
    """The environment. Its options are the fields of config.PlacementConfig.

    density: a preset of config.DENSITIES; other options override it. reward: weights by term, or a function of all terms.
    render_mode: "rgb_array" or None.

    Actions: Box (robots, 2) in [−1, 1]. A velocity action is the forward speed and the yaw rate (positive to the left), each divided by its
    maximum. A waypoint action is a point, east and north over the extent of the world. The robot drives to the nearest node of the roadmap.

    An episode terminates when all robots have tipped over. gymnasium's TimeLimit truncates it.
    With a map_seed, the constructor builds the map, so that environments in forked processes share its memory.
    Raises ValueError, with name, value and bound, for invalid options, and gymnasium's own errors.
    """

    # gymnasium declares it as a variable of instances.
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": int(DECISION_RATE)}  # noqa: RUF012

    def __init__(self, density: str | None = None, reward: Reward | None = None, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode is {render_mode!r}, needs rgb_array or None")
        self.config, self.reward, self.render_mode = PlacementConfig.of(options, density), checked_reward(reward), render_mode
        self.observation_space = space_of(self.config)  # type: ignore[assignment]
        self.action_space = spaces.Box(-1.0, 1.0, (self.config.robots, 2), np.float32)  # type: ignore[assignment]
        self.episode: Episode | None = None
        self._ended = False
        self._key = Episode.key(self.config, 0)
        if self.config.map_seed is not None:
            # Gymnasium makes one environment before it forks the processes of make_vec, which then share the memory of this map.
            map_of(self._key)
        self._camera_views = CameraViews(self.config)

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode. options: {"starts": (robots, 3) x, y m and yaw rad}. Without a seed, the map stays the same.

        Raises ValueError for unknown options, for starts that are not free, and where robots or people do not fit into the world.
        """
        super().reset(seed=seed)
        unknown = sorted(set(options or {}) - {"starts"})
        if unknown:
            raise ValueError(f"reset has no options {', '.join(map(str, unknown))}, knows starts")
        if seed is not None:
            self._key = Episode.key(self.config, seed)
        self.episode = Episode.begin(self.config, self._key, self.np_random, (options or {}).get("starts"))
        self._ended = False
        return self._observation(self.episode), {"map_seed": self._key.seed}

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one decision. Raises ResetNeeded before `reset` and after the end, and ValueError for a wrong shape or an infinite action."""
        episode = self.episode
        if episode is None or self._ended:
            raise ResetNeeded("step is called before reset, or after the end of the episode: call reset first")
        terms = episode.step(checked_action(action, (self.config.robots, 2)))
        if callable(self.reward) or GOSPA in self.reward:
            terms = terms | {GOSPA: episode.relative_gospa()}
        reward = reward_of(self.reward, terms)
        # The last situation can still be drawn.
        observation, self._ended = self._observation(episode), episode.all_tipped
        return observation, reward, self._ended, False, dict(terms)

    def render(self) -> np.ndarray | None:
        """(H, W, 3) uint8 RGB: the plan view, or the panorama of robot `panorama`. None without a render_mode."""
        if self.render_mode is None:
            gymnasium.logger.warn("render is called without a render_mode: make it with render_mode='rgb_array'")
            return None
        if self.episode is None:
            raise ResetNeeded("render is called before reset: call reset first")
        if self.config.panorama is None:
            return draw_plan(self.episode)
        return self._camera_views.render(self.episode, [self.config.panorama], 1024)[0]

    def close(self) -> None:
        """Free the OpenGL resources."""
        self._camera_views.close()

    def _observation(self, episode: Episode) -> Observation:
        rows = empty(self.config, 1)
        observe([episode], rows)
        out = {name: array[0] for name, array in bounded(rows).items()}
        if self.config.observation == "pixels":
            out["panoramas"] = self.panoramas(episode)
        return out

    def panoramas(self, episode: Episode) -> Image:
        """The panoramas of all robots as one image, as in observations.space_of."""
        return np.concatenate(self._camera_views.render(episode, list(range(self.config.robots)), self.config.width))


class CameraViews:
    """Renders the panoramas of robots. Robots and people are bodies in the scene of the map, which is compiled at the first panorama.

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


def checked_action(action: Any, shape: tuple[int, ...]) -> Array:
    """The action as an array of this shape, clipped to [−1, 1]. Raises ValueError for another shape or values that are not finite."""
    rows = np.asarray(action, dtype=np.float64)
    if rows.shape != shape:
        raise ValueError(f"action has shape {rows.shape}, needs {shape}")
    if not np.isfinite(rows).all():
        raise ValueError(f"action is {rows.tolist()}, needs finite numbers in [-1, 1]")
    return rows.clip(-1.0, 1.0)
