"""The gymnasium environment `pilsim/Placement-v0`: where robots should stand and go so that people stay seen.

    import gymnasium, sim
    env = gymnasium.make("pilsim/Placement-v0", world="ruins", robots=4, people=10)
    observation, info = env.reset(seed=7)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

Decisions are made twice a second. Observations are those of placement_observation.space_of, `info` holds every term of placement_terms.TERMS.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from sim.placement import rewards
from sim.placement.camera_views import Pictures
from sim.placement.config import DECISIONS, PlacementConfig
from sim.placement.episode import Episode
from sim.placement.observations import Arrays, observe, space_of
from sim.placement.plan_view import plan
from sim.placement.rewards import Reward
from tracker.geometry import Array


class Placement(gymnasium.Env[Arrays, Array]):
    """Robots that are to keep people in view; options are the fields of placement_config.PlacementConfig.

    density: a preset of placement_config.DENSITIES, below the options given beside it. reward: weights by term, or a function of all terms.
    render_mode: "rgb_array" or None. Actions: Box (robots, 2) in [−1, 1]; velocity: ahead and turn (to the left), over the highest; waypoint: a place
    over the extent of the world, east and north, which is driven to on the nearest ground where a robot can stand.
    An episode ends (terminated) when all robots have tipped over; it is cut off (truncated) by the TimeLimit of its registration.
    Raises ValueError, with name, value and bound, for options that do not fit, and gymnasium's errors for what it checks itself.
    """

    # gymnasium declares it as a variable of instances.
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": int(DECISIONS)}  # noqa: RUF012

    def __init__(self, density: str | None = None, reward: Reward | None = None, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode is {render_mode!r}, needs rgb_array or None")
        self.config, self.reward, self.render_mode = PlacementConfig.of(options, density), rewards.checked(reward), render_mode
        self.observation_space = space_of(self.config)  # type: ignore[assignment]
        self.action_space = spaces.Box(-1.0, 1.0, (self.config.robots, 2), np.float32)  # type: ignore[assignment]
        self.episode: Episode | None = None
        self._key = Episode.key(self.config, 0)
        self._pictures = Pictures(self.config)

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Arrays, dict[str, Any]]:
        """Begin an episode; options: {"starts": (robots, 3) x, y m and yaw rad}. Without a seed, the map stays and all else is new.

        Raises ValueError for unknown options, for starts that are not free, and where robots or people do not fit in.
        """
        super().reset(seed=seed)
        unknown = sorted(set(options or {}) - {"starts"})
        if unknown:
            raise ValueError(f"reset has no options {', '.join(map(str, unknown))}, knows starts")
        if seed is not None:
            self._key = Episode.key(self.config, seed)
        self.episode = Episode.begin(self.config, self._key, self.np_random, (options or {}).get("starts"))
        return self._observation(self.episode), {"map_seed": self._key.seed}

    def step(self, action: Array) -> tuple[Arrays, float, bool, bool, dict[str, Any]]:
        """A decision later. Raises ResetNeeded before `reset` and after the end, ValueError for an action of another shape or that is not finite."""
        episode = self.episode
        if episode is None:
            raise ResetNeeded("step is called before reset, or after the end of the episode: call reset first")
        terms = episode.step(checked_action(action, self.config.robots))
        reward = rewards.worth(self.reward, terms)
        observation, lost = self._observation(episode), episode.lost
        if lost:
            self.episode = None
        return observation, reward, lost, False, dict(terms)

    def render(self) -> np.ndarray | None:
        """(H, W, 3) uint8 RGB: the plan, or the panorama of the robot that was asked for; None without a render_mode."""
        if self.render_mode is None:
            gymnasium.logger.warn("render is called without a render_mode: make it with render_mode='rgb_array'")
            return None
        if self.episode is None:
            raise ResetNeeded("render is called before reset: call reset first")
        if self.config.panorama is None:
            return plan(self.episode)
        return self._pictures.take(self.episode, [self.config.panorama], 1024)[0]

    def close(self) -> None:
        """Free what OpenGL holds."""
        self._pictures.close()

    def _observation(self, episode: Episode) -> Arrays:
        out = observe(episode)
        if self.config.observation == "pixels":
            out["panoramas"] = np.concatenate(self._pictures.take(episode, list(range(self.config.robots)), self.config.width))
        return out


def checked_action(action: Any, robots: int) -> Array:
    """An action as (robots, 2) within [−1, 1]: what is farther out is taken for the border. Raises ValueError for another shape or NaN."""
    rows = np.asarray(action, dtype=np.float64)
    if rows.shape != (robots, 2):
        raise ValueError(f"action has shape {rows.shape}, needs ({robots}, 2)")
    if not np.isfinite(rows).all():
        raise ValueError(f"action is {rows.tolist()}, needs finite numbers in [-1, 1]")
    return np.clip(rows, -1.0, 1.0)
