"""Many placement environments as one: `gymnasium.make_vec("pilsim/Placement-v0", num_envs=64)`.

    envs = gymnasium.make_vec("pilsim/Placement-v0", num_envs=64, vectorization_mode="vector_entry_point", robots=4, people=20)

All environments live in this process, share maps, and step in threads: their compiled parts need no lock of the interpreter.
Each is a Placement, so that the same seed gives the same episode as in every other mode of make_vec. The number of threads changes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from sim.parallel.pool import usable_cores
from sim.placement.config import DECISION_RATE
from sim.placement.env import Placement, checked_action
from sim.placement.observations import Observation
from tracker.geometry import Array


class PlacementVector(VectorEnv[Observation, Array, Array]):
    """num_envs environments. max_episode_steps: decisions after which an episode is truncated. threads: None for all cores.

    An environment whose episode has ended begins another one in the next step (AutoresetMode.NEXT_STEP), as in gymnasium's SyncVectorEnv.
    Options and errors are those of sim.placement.env.Placement.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": int(DECISION_RATE),
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(self, num_envs: int = 1, max_episode_steps: int | None = None, threads: int | None = None, **options: Any) -> None:
        for name, value in (("num_envs", num_envs), ("max_episode_steps", max_episode_steps or 1), ("threads", threads or 1)):
            if not isinstance(value, int) or value < 1:
                raise ValueError(f"{name} is {value!r}, needs a whole number of at least 1")
        self.num_envs, self.max_episode_steps = num_envs, max_episode_steps
        self.envs = [Placement(**options) for _ in range(num_envs)]
        first = self.envs[0]
        self.config, self.render_mode = first.config, first.render_mode
        self.single_observation_space, self.single_action_space = first.observation_space, first.action_space
        self.observation_space, self.action_space = batch_space(first.observation_space, num_envs), batch_space(first.action_space, num_envs)
        self.steps: np.ndarray = np.zeros(num_envs, dtype=np.int64)
        self._ended = np.zeros(num_envs, dtype=bool)
        # Panoramas are drawn by OpenGL, which belongs to one thread.
        count = 1 if first.config.observation == "pixels" else min(threads or usable_cores(), num_envs)
        self._groups = np.array_split(np.arange(num_envs), count)
        self._threads = ThreadPoolExecutor(count) if count > 1 else None

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode everywhere, with seeds seed, seed + 1, …, or one of a list each. options: as of Placement.reset."""
        seeds = [None] * self.num_envs if seed is None else [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed has {len(seeds)} numbers, needs {self.num_envs}")
        found = [env.reset(seed=one, options=options) for env, one in zip(self.envs, seeds, strict=True)]
        self.steps[:], self._ended[:] = 0, False
        return self._stacked([observation for observation, _ in found]), self._infos([info for _, info in found])

    def step(self, actions: Array) -> tuple[Observation, Array, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all by one decision, with actions (num_envs, robots, 2). Raises as Placement.step does."""
        rows = checked_action(actions, (self.num_envs, self.config.robots, 2))

        def work(group: np.ndarray) -> list[Any]:
            return [self._step(k, rows[k]) for k in group.tolist()]

        parts = map(work, self._groups) if self._threads is None else self._threads.map(work, self._groups)
        found = [one for part in parts for one in part]
        self.steps = np.where(self._ended, 0, self.steps + 1)
        terminated = np.array([one[2] for one in found])
        truncated = ~self._ended & (self.steps >= (self.max_episode_steps or np.inf))
        self._ended = terminated | truncated
        reward = np.array([one[1] for one in found])
        return self._stacked([one[0] for one in found]), reward, terminated, truncated, self._infos([one[4] for one in found])

    def render(self) -> Any:
        """The picture of each environment, as of Placement.render."""
        return tuple(env.render() for env in self.envs)

    def close_extras(self, **options: Any) -> None:
        """End the threads, and free the OpenGL resources."""
        if self._threads is not None:
            self._threads.shutdown()
        for env in self.envs:
            env.close()

    def _step(self, k: int, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        if not self._ended[k]:
            return self.envs[k].decide(action) if self.envs[k].episode is not None else self.envs[k].step(action)
        observation, info = self.envs[k].reset()
        return observation, 0.0, False, False, info

    def _stacked(self, observations: list[Observation]) -> Observation:
        return {name: np.stack([one[name] for one in observations]) for name in observations[0]}

    def _infos(self, infos: list[dict[str, Any]]) -> dict[str, Any]:
        """Arrays by name, and by _name whether an environment has it, as gymnasium's vector environments give them."""
        if any(info.keys() != infos[0].keys() for info in infos):
            out: dict[str, Any] = {}
            for k, info in enumerate(infos):
                out = self._add_info(out, info, k)
            return out
        values = {name: np.array([info[name] for info in infos]) for name in infos[0]}
        return values | {f"_{name}": np.ones(self.num_envs, dtype=bool) for name in infos[0]}
