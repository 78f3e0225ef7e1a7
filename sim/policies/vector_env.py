"""Robots of many teams that learn side by side: each robot an environment of stable-baselines3's, all with one policy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from sim.placement import rewards
from sim.placement.env import Placement
from sim.placement.episode import Episode
from sim.placement.rewards import Reward
from sim.policies.policy import Briefing, to_places
from sim.policies.waypoints import CHOICES, HOLD, PARTS, Watch
from tracker.geometry import Array

TRAINING_SEED = 100_000
"""The first seed of training episodes: far from those that policies are tried on."""
MAPS = 16
"""Maps on which they learn; as many as are kept."""
LENGTH = 240
"""Decisions of an episode."""


class Team:
    """Robots of one environment through episodes of its own, map after map."""

    def __init__(self, options: dict[str, Any], number: int) -> None:
        self.env = gymnasium.make("pilsim/Placement-v0", **options, action="waypoint", max_episode_steps=LENGTH)
        core = self.env.unwrapped
        assert isinstance(core, Placement)
        self.core, self.number, self.rewards = core, number, [0.0]

    @property
    def episode(self) -> Episode:
        assert self.core.episode is not None
        return self.core.episode

    def reset(self) -> NDArray[np.float32]:
        """What each robot knows of its choices, (r, CHOICES · PARTS)."""
        # Ten seeds in a row share a map: teams start on maps of their own, and go on to others.
        k = self.number
        shown, _ = self.env.reset(seed=TRAINING_SEED + 10 * (k % MAPS) + (k // MAPS) % 10)
        self.number, self.rewards = k + 5, []
        self.watch = Watch(Briefing.of(self.episode, shown))
        return self._look(shown)

    def step(self, choice: Array) -> tuple[NDArray[np.float32], Array, bool, bool]:
        """HOLD decisions later: what the robots know, what each was worth to the team in them (r,), and whether the episode ended, or was cut."""
        action = to_places(self.episode.place, self.watch.goals[np.arange(len(choice)), choice])
        worth, over, cut = np.zeros(len(choice)), False, False
        episode = self.episode
        for _ in range(HOLD):
            shown, reward, over, cut, terms = self.env.step(action)
            worth += own_worth(episode, self.core.reward, terms)
            self.rewards.append(float(reward))
            if over or cut:
                break
        known: NDArray[np.float32] = np.zeros((len(choice), CHOICES * PARTS), dtype=np.float32)
        if not over:
            known = self._look(shown)
        return known, worth / HOLD, over, cut

    def _look(self, shown: Mapping[str, Array]) -> NDArray[np.float32]:
        return self.watch.look(Briefing.of(self.episode, dict(shown))).reshape(self.core.config.robots, -1)


def own_worth(episode: Episode, reward: Reward, terms: Mapping[str, float]) -> Array:
    """(r,) what each robot was worth to its team in the last decision: the reward less what it would be if that robot had not looked, nor been
    stopped or spent its share of energy. Wolpert and Tumer 2001, Optimal payoff functions for members of collectives: difference rewards.
    """
    seen, people = episode.now.seen > 0, max(episode.config.people, 1)
    views, robots = seen.sum(axis=0), len(seen)
    whole = rewards.worth(reward, terms)
    out = np.zeros(robots)
    for k in range(robots):
        left = views - seen[k]
        without = {
            "seen": float((left >= 1).sum() / people),
            "seen_twice": float((left >= 2).sum() / people),
            "collisions": terms["collisions"] - float(episode.now.stopped[k] > 0),
            "near_misses": terms["near_misses"] * (1 - 1 / robots),
            "energy": terms["energy"] * (1 - 1 / robots),
        }
        out[k] = whole - rewards.worth(reward, dict(terms) | without)
    return out


class TeamVecEnv(VecEnv):
    """All robots of some teams, side by side; `finished` holds the mean reward a decision of each episode that has ended."""

    def __init__(self, options: dict[str, Any], teams: int) -> None:
        self.teams = [Team(options, number) for number in range(teams)]
        self.robots = self.teams[0].core.config.robots
        self.finished: list[float] = []
        box = spaces.Box(-np.inf, np.inf, (CHOICES * PARTS,), np.float32)
        super().__init__(teams * self.robots, box, spaces.Discrete(CHOICES))

    def reset(self) -> Array:
        return np.concatenate([team.reset() for team in self.teams])

    def step_async(self, actions: Array) -> None:
        self._actions = np.asarray(actions).reshape(len(self.teams), self.robots)

    def step_wait(self) -> Any:
        known, worth, done, infos = [], [], [], []
        for team, action in zip(self.teams, self._actions, strict=True):
            rows, values, over, cut = team.step(action)
            infos += [{"TimeLimit.truncated": cut and not over, **({"terminal_observation": row} if over or cut else {})} for row in rows]
            if over or cut:
                self.finished.append(float(np.mean(team.rewards)))
                rows = team.reset()
            known.append(rows)
            worth.append(values)
            done += [over or cut] * self.robots
        return np.concatenate(known), np.concatenate(worth).astype(np.float32), np.array(done), infos

    def close(self) -> None:
        for team in self.teams:
            team.env.close()

    # What stable-baselines3 may ask of its environments, but these do not have.
    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(f"{attr_name} of robots that learn cannot be set")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **options: Any) -> list[Any]:
        raise AttributeError(f"robots that learn have no method {method_name}")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None) -> list[bool]:
        return [False] * self.num_envs

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Episodes have seeds of their own, whatever the learner asks for."""
        return [None] * self.num_envs
