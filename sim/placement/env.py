"""The gymnasium environment `pilsim/Placement-v0`: robots move so that people stay visible.

    import gymnasium, sim
    env = gymnasium.make("pilsim/Placement-v0", world="ruins", robots=4, people=10)
    observation, info = env.reset(seed=7)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

An action is taken twice per second. Observations are those of observations.space_of. `info` holds every term of rewards.TERMS.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from sim.placement import rewards
from sim.placement.camera_views import CameraViews
from sim.placement.config import DECISION_RATE, PlacementConfig
from sim.placement.episode import Episode
from sim.placement.map import map_of
from sim.placement.observations import Observation, observe, space_of
from sim.placement.plan_view import draw_plan
from sim.placement.rewards import Reward
from tracker.geometry import Array


class Placement(gymnasium.Env[Observation, Array]):
    """The environment. Its options are the fields of config.PlacementConfig.

    density: a preset of config.DENSITIES; other options override it. reward: weights by term, or a function of all terms.
    render_mode: "rgb_array" or None.

    Actions: Box (robots, 2) in [−1, 1]. A velocity action is the forward speed and the yaw rate (positive to the left), each divided by its
    maximum. A waypoint action is a point, east and north over the extent of the world. The robot drives to the nearest node of the roadmap.

    An episode terminates when all robots have tipped over. The TimeLimit of the registration truncates it.
    With a map_seed, the map is built here, so that environments in forked processes share its memory.
    Raises ValueError, with name, value and bound, for invalid options, and gymnasium's own errors.
    """

    # gymnasium declares it as a variable of instances.
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": int(DECISION_RATE)}  # noqa: RUF012

    def __init__(self, density: str | None = None, reward: Reward | None = None, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode is {render_mode!r}, needs rgb_array or None")
        self.config, self.reward, self.render_mode = PlacementConfig.of(options, density), rewards.checked_reward(reward), render_mode
        self.observation_space = space_of(self.config)  # type: ignore[assignment]
        self.action_space = spaces.Box(-1.0, 1.0, (self.config.robots, 2), np.float32)  # type: ignore[assignment]
        self.episode: Episode | None = None
        self._key = Episode.key(self.config, 0)
        if self.config.map_seed is not None:
            # Gymnasium makes one environment before it forks the processes of make_vec: their map is in the memory that they share.
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
        return self._observation(self.episode), {"map_seed": self._key.seed}

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one decision. Raises ResetNeeded before `reset` and after the end, and ValueError for a wrong shape or an infinite action."""
        episode = self.episode
        if episode is None:
            raise ResetNeeded("step is called before reset, or after the end of the episode: call reset first")
        terms = episode.step(checked_action(action, self.config.robots))
        reward = rewards.reward_of(self.reward, terms)
        observation, terminated = self._observation(episode), episode.all_tipped
        if terminated:
            self.episode = None
        return observation, reward, terminated, False, dict(terms)

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
        out = observe(episode)
        if self.config.observation == "pixels":
            out["panoramas"] = np.concatenate(self._camera_views.render(episode, list(range(self.config.robots)), self.config.width))
        return out


def checked_action(action: Any, robots: int) -> Array:
    """The action as (robots, 2), clipped to [−1, 1]. Raises ValueError for another shape or values that are not finite."""
    rows = np.asarray(action, dtype=np.float64)
    if rows.shape != (robots, 2):
        raise ValueError(f"action has shape {rows.shape}, needs ({robots}, 2)")
    if not np.isfinite(rows).all():
        raise ValueError(f"action is {rows.tolist()}, needs finite numbers in [-1, 1]")
    return np.clip(rows, -1.0, 1.0)
