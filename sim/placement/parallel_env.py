"""The PettingZoo environment of placement: a ParallelEnv with one agent per robot, over the same episodes as env.py.

    from sim.placement.parallel_env import parallel_env
    env = parallel_env(world="ruins", robots=4, people=10)
    observations, infos = env.reset(seed=7)

It needs the extra `rl`. All agents share the reward. Each observes its own row of the team's observation, and the team's beliefs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from sim.placement.env import Placement
from sim.placement.observations import Observation
from tracker.geometry import Array

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError("sim.placement.parallel_env needs pettingzoo: pip install 'pilsim[rl]'") from error

SHARED = ("beliefs",)
"""Arrays that all agents share. Each agent gets its own row of every other array."""


class ParallelPlacement(ParallelEnv[str, Observation, Array]):
    """Agents robot_0, robot_1 …; actions Box (2,) in [−1, 1]. `state` is the whole observation of the team, as one vector.

    The options are those of sim.placement.env.Placement. max_cycles: number of decisions after which an episode is truncated.
    Raises ValueError as Placement does.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "pilsim_placement_v0", "render_modes": ["rgb_array"], "is_parallelizable": True, "render_fps": 2}

    def __init__(self, max_cycles: int = 240, **options: Any) -> None:
        if not isinstance(max_cycles, int) or max_cycles < 1:
            raise ValueError(f"max_cycles is {max_cycles!r}, needs a whole number of at least 1")
        self.team, self.max_cycles = Placement(**options), max_cycles
        self.render_mode = self.team.render_mode
        self.possible_agents = [f"robot_{k}" for k in range(self.team.config.robots)]
        self.agents: list[str] = []
        boxes: dict[str, Any] = dict(self.team.observation_space.spaces)  # type: ignore[attr-defined]
        own = {name: self._own_space(name, box) for name, box in boxes.items()}
        self.observation_spaces = {agent: spaces.Dict(dict(own)) for agent in self.possible_agents}
        self.action_spaces = {agent: spaces.Box(-1.0, 1.0, (2,), np.float32) for agent in self.possible_agents}
        size = sum(int(np.prod(box.shape)) for name, box in boxes.items() if name != "panoramas")
        self.state_space = spaces.Box(-1.0, 1.0, (size,), np.float32)
        self._observation: Observation = {}
        self._cycles = 0

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode. options: {"starts": …} as in Placement.reset. Others are ignored, because PettingZoo's own tests pass some."""
        known = {name: value for name, value in (options or {}).items() if name == "starts"}
        self._observation, info = self.team.reset(seed=seed, options=known)
        self.agents, self._cycles = list(self.possible_agents), 0
        return self._observations(), {agent: dict(info) for agent in self.agents}

    def step(
        self, actions: dict[str, Array]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Advance by one decision. Raises ValueError where an agent has no action."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"actions lack {', '.join(missing)}, need one of every agent")
        self._observation, reward, terminated, _, info = self.team.step(np.stack([actions[agent] for agent in self.agents]))
        self._cycles += 1
        agents, truncated = list(self.agents), self._cycles >= self.max_cycles
        observations = self._observations()
        if terminated or truncated:
            self.agents = []
        return (
            observations,
            dict.fromkeys(agents, reward),
            dict.fromkeys(agents, terminated),
            dict.fromkeys(agents, truncated),
            {agent: dict(info) for agent in agents},
        )

    def state(self) -> Array:
        """(n,) float32: the observation of the team without panoramas, as one vector."""
        return np.concatenate([array.ravel() for name, array in sorted(self._observation.items()) if name != "panoramas"])

    def render(self) -> Any:
        return self.team.render()

    def close(self) -> None:
        self.team.close()

    def _own_space(self, name: str, box: spaces.Box) -> spaces.Box:
        if name in SHARED:
            return box
        rows = len(box.low) // self.team.config.robots
        low, high = (edge[:rows] if rows > 1 else edge[0] for edge in (box.low, box.high))
        return spaces.Box(low, high, dtype=box.dtype.type)

    def _observations(self) -> dict[str, Observation]:
        return {agent: {name: self._row(name, array, k) for name, array in self._observation.items()} for k, agent in enumerate(self.possible_agents)}

    def _row(self, name: str, array: np.ndarray, k: int) -> np.ndarray:
        if name in SHARED:
            return array.copy()
        rows = len(array) // self.team.config.robots
        return array[k * rows : (k + 1) * rows].copy() if rows > 1 else array[k].copy()


parallel_env = ParallelPlacement
"""The environment under the name that PettingZoo's modules use."""
