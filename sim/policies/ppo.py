"""A learned policy: proximal policy optimisation (Schulman et al. 2017) by stable-baselines3, on the placement environment. Needs the extra `rl`.

All robots have one policy (parameter sharing, as in Yu et al. 2022, The surprising effectiveness of PPO in cooperative multi-agent games), which
chooses every 3 s between places around a robot by what is known of them (policies_choices). Each robot is rewarded for what it adds to its team.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.policies.policy import Briefing, to_places
from sim.policies.waypoints import CHOICES, HOLD, PARTS, Watch
from tracker.geometry import Array

MISSING = "stable-baselines3 is not installed, needs it to train or to run ppo: pip install 'pilsim[rl]'"


@dataclass(eq=False)
class Learned:
    """A trained model of stable-baselines3 that says where to go."""

    model: Any
    action: str = "waypoint"

    @staticmethod
    def read(file: str) -> Learned:
        """Raises ValueError where there is no such file, it is no model, or stable-baselines3 is missing."""
        ppo = needed()
        if not Path(file).is_file():
            raise ValueError(f"{file}: there is no such file of a trained policy")
        try:
            model = ppo.load(file, device="cpu")
        except Exception as error:
            raise ValueError(f"{file}: is no policy of stable-baselines3 ({type(error).__name__})") from None
        if model.observation_space.shape != (CHOICES * PARTS,):
            raise ValueError(f"{file}: is a policy over observations {model.observation_space.shape}, needs ({CHOICES * PARTS},)")
        return Learned(model)

    def begin(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._watch, self._count = Watch(briefing), 0
        self._goals: NDArray[np.int64] = np.zeros(len(briefing.robots), dtype=np.int64)

    def act(self, briefing: Briefing) -> Array:
        if self._count % HOLD == 0:
            known = self._watch.look(briefing).reshape(len(briefing.robots), -1)
            choice, _ = self.model.predict(known, deterministic=True)
            self._goals = self._watch.goals[np.arange(len(choice)), choice]
        self._count += 1
        return to_places(briefing.place, self._goals)


def needed() -> Any:
    """stable-baselines3's PPO. Raises ValueError where it is missing."""
    try:
        from stable_baselines3 import PPO
    except ImportError:
        raise ValueError(MISSING) from None
    return PPO
