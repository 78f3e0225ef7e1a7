"""Many placement environments as one: `gymnasium.make_vec("pilsim/Placement-v0", num_envs=64)`.

    envs = gymnasium.make_vec("pilsim/Placement-v0", num_envs=64, vectorization_mode="vector_entry_point", robots=4, people=20)

The environments share arrays and maps. One compiled call advances the kinematic environments of a map that observe states, and threads divide
these calls. Each environment is a Placement: a seed gives the same episode in every mode of make_vec.
The number of threads does not change the results.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, create_empty_array

from sim.crowd.crowd import COLUMNS
from sim.parallel.pool import usable_cores
from sim.placement.config import DECISION_RATE
from sim.placement.env import Placement, checked_action
from sim.placement.episode import GOSPA, Episode, decide, reward_of, weighted
from sim.placement.information import TERMS, States
from sim.placement.observations import Observation, bounded, empty, observe
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
        self._states = States.begun(first.config, num_envs, COLUMNS)
        # Panoramas are drawn by OpenGL, which belongs to one thread.
        self._count = 1 if first.config.observation == "pixels" else min(threads or usable_cores(), num_envs)
        self._threads = ThreadPoolExecutor(self._count) if self._count > 1 else None

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode in every environment, with seeds seed, seed + 1, …, or those of a list. options: as of Placement.reset."""
        seeds = [None] * self.num_envs if seed is None else [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed has {len(seeds)} numbers, needs {self.num_envs}")
        begun = {k: self._begin(k, one, options) for k, one in enumerate(seeds)}
        self.steps[:], self._ended[:] = 0, False
        observation: Any = create_empty_array(self.single_observation_space, self.num_envs, np.zeros)
        return observation, self._infos({}, begun, observation)

    def step(self, actions: Array) -> tuple[Observation, Array, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all by one decision, with actions (num_envs, robots, 2). Raises as Placement.step does."""
        rows, kept = checked_action(actions, (self.num_envs, self.config.robots, 2)), np.flatnonzero(~self._ended).tolist()
        for k in kept:
            if self.envs[k].episode is None:
                self.envs[k].step(rows[k])
        begun = {k: self._begin(k, None, None) for k in np.flatnonzero(self._ended).tolist()}
        observation, terms = self._decide(kept, rows)
        terminated: np.ndarray = np.zeros(self.num_envs, dtype=bool)
        terminated[kept] = self._states.tipped[kept].all(axis=1)
        self.steps = np.where(self._ended, 0, self.steps + 1)
        truncated = ~self._ended & (self.steps >= (self.max_episode_steps or np.inf))
        self._ended = terminated | truncated
        return observation, self._rewards(kept, terms), terminated, truncated, self._infos(terms if kept else {}, begun, observation)

    def render(self) -> Any:
        """The picture of each environment, as of Placement.render."""
        return tuple(env.render() for env in self.envs)

    def close_extras(self, **options: Any) -> None:
        """End the threads, and free the OpenGL resources."""
        if self._threads is not None:
            self._threads.shutdown()
        for env in self.envs:
            env.close()

    def _begin(self, k: int, seed: int | None, options: dict[str, Any] | None) -> tuple[Observation, dict[str, Any]]:
        found = self.envs[k].reset(seed=seed, options=options)
        self._episode(k).move_to(self._states, k)
        return found

    def _decide(self, kept: list[int], rows: Array) -> tuple[Observation, dict[str, Array]]:
        """Advance the environments `kept`. Returns observations and terms, with 0 for all others."""
        by_map: dict[int, list[Episode]] = {}
        for k in kept:
            by_map.setdefault(id(self._episode(k).place), []).append(self._episode(k))
        out = empty(self.config, self.num_envs)

        def work(episodes: list[Episode]) -> None:
            decide(episodes, rows[[episode.row for episode in episodes]])
            observe(episodes, out)

        self._each(work, [part for group in by_map.values() for n in range(self._count) if (part := group[n :: self._count])])
        found, terms = bounded(out), {name: np.zeros(self.num_envs) for name in TERMS}
        if self.config.observation == "pixels":
            found["panoramas"] = np.zeros(self.observation_space["panoramas"].shape, dtype=np.uint8)  # type: ignore[index]
            for k in kept:
                found["panoramas"][k] = self.envs[k].panoramas(self._episode(k))
        for column, values in enumerate(terms.values()):
            values[kept] = self._states.terms[kept, column]
        if callable(self.envs[0].reward) or GOSPA in self.envs[0].reward:
            terms[GOSPA] = np.zeros(self.num_envs)
            terms[GOSPA][kept] = [self._episode(k).relative_gospa() for k in kept]
        return found, terms

    def _rewards(self, kept: list[int], terms: dict[str, Array]) -> Array:
        weights, reward = self.envs[0].reward, np.zeros(self.num_envs)
        if not callable(weights):
            return reward + weighted(weights, terms)
        reward[kept] = [reward_of(weights, {name: float(values[k]) for name, values in terms.items()}) for k in kept]
        return reward

    def _episode(self, k: int) -> Episode:
        episode = self.envs[k].episode
        assert episode is not None
        return episode

    def _each(self, work: Callable[[Any], Any], items: list[Any]) -> list[Any]:
        return list(map(work, items) if self._threads is None else self._threads.map(work, items))

    def _infos(self, terms: dict[str, Array], begun: dict[int, Any], observation: Observation) -> dict[str, Any]:
        """Arrays by name, and by _name the masks of environments with a value, as in gymnasium's vector environments.

        The first observations of new episodes are copied into `observation`.
        """
        seeds, new = np.zeros(self.num_envs, dtype=np.int64), np.zeros(self.num_envs, dtype=bool)
        for k, (first, info) in begun.items():
            seeds[k], new[k] = info["map_seed"], True
            for name, array in first.items():
                observation[name][k] = array
        found = terms | {f"_{name}": ~new for name in terms}
        return found | ({"map_seed": seeds, "_map_seed": new} if begun else {})
