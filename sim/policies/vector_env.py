"""The vectorized environment and the network that stable-baselines3 trains. Needs PyTorch.

Each robot of several teams is one environment, and all share one policy. One network scores every choice from its own features, from those
of all people at this choice, and from the other choices. People are a set (Zaheer et al. 2017, Deep sets) of any order and number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from sim.placement.config import SEEDS_PER_MAP
from sim.placement.env import Placement
from sim.placement.episode import Episode, Reward, reward_of
from sim.policies.planning import FEATURES, PEOPLE_FEATURES, ChoiceFeatures
from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import CHOICES, HOLD, POINT_FEATURES
from tracker.geometry import Array

TRAINING_SEED = 100_000
"""The first seed of training episodes, far from the seeds of evaluation."""
LENGTH = 240
"""Decisions per episode."""
WIDTH, PERSON_WIDTH = 48, 16
"""Units of a hidden layer, and of a hidden layer of the network that encodes a person."""
PEOPLE_SCALE = 10.0
"""Divisor of sums over people: for this number of people, the sum becomes the mean."""
PRIOR = 9.0
"""Initial weight of the value of a choice: a choice that is better by 2 nats is then preferred by a factor of e³."""


class Team:
    """The robots of one placement environment, through episodes on one map after another."""

    def __init__(self, options: dict[str, Any], number: int, teams: int) -> None:
        """number: of this team. teams: the number of teams in training."""
        self.env = gymnasium.make("pilsim/Placement-v0", **options, action="waypoint", max_episode_steps=LENGTH)
        placement = self.env.unwrapped
        assert isinstance(placement, Placement)
        self.placement, self.number, self.teams, self.rewards = placement, number, teams, [0.0]
        self.played = 0

    @property
    def episode(self) -> Episode:
        assert self.placement.episode is not None
        return self.placement.episode

    def reset(self) -> NDArray[np.float32]:
        """Begin the next episode. Returns the features of each robot's choices, (r, n)."""
        observation, _ = self.env.reset(seed=training_seed(self.number, self.played, self.teams))
        self.played, self.rewards = self.played + 1, []
        self.features = ChoiceFeatures(TeamKnowledge.of(self.episode, observation))
        return self._choice_features(observation)

    def step(self, choice: NDArray[np.int64]) -> tuple[NDArray[np.float32], Array, bool, bool]:
        """Advance by HOLD decisions with choices (r,).

        Returns features, mean difference rewards (r,), and whether the episode terminated or was truncated.
        """
        action = waypoint_action(self.episode.place, self.features.chosen(choice))
        values, terminated, truncated = np.zeros(len(choice)), False, False
        episode = self.episode
        for _ in range(HOLD):
            observation, reward, terminated, truncated, terms = self.env.step(action)
            values += difference_rewards(episode, self.placement.reward, terms)
            self.rewards.append(float(reward))
            if terminated or truncated:
                break
        features: NDArray[np.float32] = np.zeros((len(choice), row_length(episode.config.people)), dtype=np.float32)
        if not terminated:
            features = self._choice_features(observation)
        return features, values / HOLD, terminated, truncated

    def _choice_features(self, observation: Mapping[str, Array]) -> NDArray[np.float32]:
        choices, people = self.features.update(TeamKnowledge.of(self.episode, dict(observation)))
        out: NDArray[np.float32] = np.zeros((len(choices), row_length(self.episode.config.people)), dtype=np.float32)
        found = np.concatenate([choices.reshape(len(choices), -1), people.reshape(len(choices), -1)], axis=1)
        out[:, : found.shape[1]] = found
        return out


def training_seed(team: int, episode: int, teams: int) -> int:
    """The seed of an episode of a team. A team plays SEEDS_PER_MAP episodes on a map, and goes on to another; no two teams share maps."""
    return TRAINING_SEED + SEEDS_PER_MAP * (team + teams * (episode // SEEDS_PER_MAP)) + episode % SEEDS_PER_MAP


def row_length(people: int) -> int:
    """Length of an observation of one robot: features of the choices, then of each person at each choice."""
    return CHOICES * (FEATURES + people * PEOPLE_FEATURES)


def options_of_teams(options: dict[str, Any], varied: Mapping[str, Sequence[Any]], teams: int) -> list[dict[str, Any]]:
    """The options of each team. The values of a varied option have about as many teams each, and are paired with those of others at random.

    Raises ValueError for an option without values, or with more values than teams.
    """
    for name, values in varied.items():
        if not 1 <= len(values) <= teams:
            raise ValueError(f"{name} has {len(values)} values that differ between teams, needs 1 to {teams}")
    rng = np.random.default_rng(TRAINING_SEED)
    columns = {name: [varied[name][k % len(varied[name])] for k in rng.permutation(teams)] for name in sorted(varied)}
    return [options | {name: column[k] for name, column in columns.items()} for k in range(teams)]


def difference_rewards(episode: Episode, reward: Reward, terms: Mapping[str, float]) -> Array:
    """Difference reward (r,) of each robot in the last decision (Wolpert and Tumer 2001, Optimal payoff functions for members of collectives).

    It is the team's reward minus the reward without that robot's views, its stop, and its share of near misses and energy. Information is that
    without any view of the robot since the start. Without the last views alone, robots gained by losing people and finding them again.
    """
    seen, people = episode.now.seen > 0, max(episode.config.people, 1)
    views, robots = seen.sum(axis=0), len(seen)
    whole = reward_of(reward, terms)
    out = np.zeros(robots)
    for k in range(robots):
        others = views - seen[k]
        without = {
            "information": terms["information"] - float(episode.states.added[episode.row, k]),
            "seen": float((others >= 1).sum() / people),
            "seen_twice": float((others >= 2).sum() / people),
            "collisions": terms["collisions"] - float(episode.now.stopped[k] > 0),
            "near_misses": terms["near_misses"] * (1 - 1 / robots),
            "energy": terms["energy"] * (1 - 1 / robots),
        }
        out[k] = whole - reward_of(reward, dict(terms) | without)
    return out


class TeamVecEnv(VecEnv):
    """All robots of several teams. `finished` holds the mean reward per decision of each episode that ended."""

    def __init__(self, options: Sequence[dict[str, Any]]) -> None:
        """options: of each team."""
        self.teams = [Team(one, number, len(options)) for number, one in enumerate(options)]
        sizes = [team.placement.config.robots for team in self.teams]
        self.ends = np.cumsum(sizes)[:-1]
        self.length = row_length(max(team.placement.config.people for team in self.teams))
        self.finished: list[float] = []
        super().__init__(sum(sizes), spaces.Box(-np.inf, np.inf, (self.length,), np.float32), spaces.Discrete(CHOICES))

    def reset(self) -> Array:
        return np.concatenate([self._padded(team.reset()) for team in self.teams])

    def step_async(self, actions: Array) -> None:
        self._actions = np.split(np.asarray(actions, dtype=np.int64), self.ends)

    def step_wait(self) -> Any:
        features, values, done, infos = [], [], [], []
        for team, action in zip(self.teams, self._actions, strict=True):
            rows, contribution, terminated, truncated = team.step(action)
            ended = terminated or truncated
            more = [{"terminal_observation": row} if ended else {} for row in self._padded(rows)]
            infos += [{"TimeLimit.truncated": truncated and not terminated, **one} for one in more]
            if ended:
                self.finished.append(float(np.mean(team.rewards)))
                rows = team.reset()
            features.append(self._padded(rows))
            values.append(contribution)
            done += [ended] * len(action)
        return np.concatenate(features), np.concatenate(values).astype(np.float32), np.array(done), infos

    def _padded(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Rows (r, length): teams with fewer people have rows of zeros for the others."""
        return np.pad(rows, ((0, 0), (0, self.length - rows.shape[1])))

    def close(self) -> None:
        for team in self.teams:
            team.env.close()

    # stable-baselines3 requires these methods. The robots have no attributes or methods of their own.
    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(f"{attr_name} cannot be set on the robots of a team")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **options: Any) -> list[Any]:
        raise AttributeError(f"the robots of a team have no method {method_name}")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: Any = None) -> list[bool]:
        return [False] * self.num_envs

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Ignore the learner's seed: episodes have fixed seeds."""
        return [None] * self.num_envs


class ChoiceNetwork(nn.Module):
    """Maps observations (n, row_length) to logits (n, choices) of the actor and to features (n, WIDTH) of the critic.

    people: number of features of a person; 0 for the networks of versions up to 0.4.0, which have features of points alone, and no prior.
    The prior adds a multiple of the value of each choice, so that an untrained network takes the choice that ChoicePlan values most.
    """

    def __init__(self, choices: int, parts: int, people: int) -> None:
        super().__init__()
        self.shape, self.people = (choices, parts), people
        self.latent_dim_pi, self.latent_dim_vf = choices, WIDTH
        self.prior = nn.Linear(parts, 1, bias=False) if parts > POINT_FEATURES else None
        if self.prior is not None:
            nn.init.zeros_(self.prior.weight)
            self.prior.weight.data[0, -1] = PRIOR
        if people:
            self.person = nn.Sequential(nn.Linear(people, PERSON_WIDTH), nn.Tanh(), nn.Linear(PERSON_WIDTH, PERSON_WIDTH), nn.Tanh())
            parts += 2 * PERSON_WIDTH
        last = nn.Linear(WIDTH, 1)
        # Small weights make all choices about equally probable at first.
        nn.init.normal_(last.weight, std=0.01)
        # The names of these modules are keys of saved models.
        self.each = nn.Sequential(nn.Linear(3 * parts, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh(), last)
        self.moment = nn.Sequential(nn.Linear(3 * parts, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh())

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        rows = self._rows(features)
        return self.score(rows), self._moment(rows)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        return self.score(self._rows(features))

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        return self._moment(self._rows(features))

    def with_people(self, choices: torch.Tensor, people: torch.Tensor) -> torch.Tensor:
        """Choices (n, c, parts), each extended by the sum and the maximum of encodings of all people (n, k, c, features)."""
        found = self.person(people) * people[..., :1]
        # A padding row adds 0 to the sum. The maximum includes a row of zeros, so that it exists without people.
        nobody = torch.zeros_like(choices[:, :, :1]).unsqueeze(1).expand(-1, -1, -1, PERSON_WIDTH)
        most = torch.cat([found, nobody], dim=1).amax(dim=1)
        return torch.cat([choices, found.sum(dim=1) / PEOPLE_SCALE, most], dim=2)

    def score(self, rows: torch.Tensor) -> torch.Tensor:
        """Logits (n, c) of rows (n, c, parts)."""
        beside = torch.cat([rows[:, :1], rows.amax(dim=1, keepdim=True)], dim=2).expand(-1, self.shape[0], -1)
        logits = self.each(torch.cat([rows, beside], dim=2))
        return (logits if self.prior is None else logits + self.prior(rows[..., : self.shape[1]])).squeeze(2)

    def _rows(self, features: torch.Tensor) -> torch.Tensor:
        own = self.shape[0] * self.shape[1]
        choices = features[:, :own].reshape(-1, *self.shape)
        if not self.people:
            return choices
        return self.with_people(choices, features[:, own:].reshape(len(features), -1, self.shape[0], self.people))

    def _moment(self, rows: torch.Tensor) -> torch.Tensor:
        return self.moment(torch.cat([rows[:, 0], rows.amax(dim=1), rows.mean(dim=1)], dim=1))


class ChoicePolicy(ActorCriticPolicy):
    """Actor and critic over a flat observation of `choices` rows of `parts` features, then of features of people."""

    mlp_extractor: Any

    def __init__(self, *args: Any, choices: int, parts: int, people: int = 0, **options: Any) -> None:
        self._sizes = choices, parts, people
        super().__init__(*args, **options)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | dict(zip(("choices", "parts", "people"), self._sizes, strict=True))

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = ChoiceNetwork(*self._sizes)

    def _build(self, lr_schedule: Any) -> None:
        self.ortho_init = False
        super()._build(lr_schedule)
        self.action_net = nn.Identity()
        self.optimizer = torch.optim.Adam(self.parameters(), lr=lr_schedule(1), eps=1e-5)
