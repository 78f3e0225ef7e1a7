"""The policy trained by proximal policy optimization (Schulman et al. 2017) with stable-baselines3. Needs the extra `rl`.

All robots share one policy (parameter sharing, as in Yu et al. 2022, The surprising effectiveness of PPO in cooperative multi-agent games).
It chooses a waypoint for each robot every 3 s (waypoints.py). The reward of a robot is a difference reward (vector_env.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import CHOICES, FEATURES, HOLD, WaypointFeatures
from tracker.geometry import Array

MISSING = "stable-baselines3 is not installed, training and ppo need it: pip install 'pilsim[rl]'"


@dataclass(eq=False)
class Learned:
    """A policy that follows a trained model of stable-baselines3."""

    model: Any
    action: str = "waypoint"

    @staticmethod
    def read(file: str) -> Learned:
        """Read a model. Raises ValueError for a missing file, a file that is no such model, and where stable-baselines3 is missing."""
        ppo = needed()
        if not Path(file).is_file():
            raise ValueError(f"{file}: no such file")
        from sim.policies.vector_env import ChoicePolicy

        try:
            # Files name the module of the policy at the time when they were written.
            model = ppo.load(file, device="cpu", custom_objects={"policy_class": ChoicePolicy})
        except Exception as error:
            raise ValueError(f"{file}: not a policy of stable-baselines3 ({type(error).__name__})") from None
        if model.observation_space.shape != (CHOICES * FEATURES,):
            raise ValueError(f"{file}: the policy takes observations of shape {model.observation_space.shape}, needs ({CHOICES * FEATURES},)")
        return Learned(model)

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        self._features, self._count = WaypointFeatures(knowledge), 0
        self._goals: NDArray[np.int64] = np.zeros(len(knowledge.robots), dtype=np.int64)

    def act(self, knowledge: TeamKnowledge) -> Array:
        if self._count % HOLD == 0:
            known = self._features.update(knowledge).reshape(len(knowledge.robots), -1)
            choice, _ = self.model.predict(known, deterministic=True)
            self._goals = self._features.goals[np.arange(len(choice)), choice]
        self._count += 1
        return waypoint_action(knowledge.place, self._goals)


def needed() -> Any:
    """stable-baselines3's PPO. Raises ValueError where it is missing."""
    try:
        from stable_baselines3 import PPO
    except ImportError:
        raise ValueError(MISSING) from None
    return PPO
