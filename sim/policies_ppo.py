"""A learned policy: proximal policy optimisation by stable-baselines3, trained on the placement environment. Needs the extra `rl`."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from sim.policies import Briefing
from tracker.geometry import Array

MISSING = "stable-baselines3 is not installed, needs it to train or to run ppo: pip install 'pilsim[rl]'"
TRAINING_SEED = 100_000
"""The first seed of training episodes: far from those that policies are tried on."""
MAPS = 16
"""Maps on which it is trained."""


@dataclass(eq=False)
class Learned:
    """A trained model of stable-baselines3 that says where to go."""

    model: Any
    action: str = "waypoint"

    @staticmethod
    def read(file: str) -> Learned:
        """Raises ValueError where there is no such file, it is no model, or stable-baselines3 is missing."""
        ppo = _ppo()
        if not Path(file).is_file():
            raise ValueError(f"{file}: there is no such file of a trained policy")
        try:
            return Learned(ppo.load(file, device="cpu"))
        except Exception as error:
            raise ValueError(f"{file}: is no policy of stable-baselines3 ({type(error).__name__})") from None

    def begin(self, briefing: Briefing, rng: np.random.Generator) -> None:
        return

    def act(self, briefing: Briefing) -> Array:
        """Raises ValueError where the model was trained for other shapes."""
        try:
            action, _ = self.model.predict(briefing.shown, deterministic=True)
        except ValueError as error:
            raise ValueError(f"the policy was trained for other robots, people or observations: {str(error).splitlines()[0]}") from None
        return np.asarray(action, dtype=np.float64)


class Training(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Episodes of their own seeds, map after map, whatever seed the learner asks for."""

    def __init__(self, env: gymnasium.Env[Any, Any], first: int) -> None:
        super().__init__(env)
        self._next = first

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        number = self._next
        self._next += 1
        # An episode of another map with each reset: ten seeds in a row share one.
        return self.env.reset(seed=TRAINING_SEED + 10 * (number % MAPS) + (number // MAPS) % 10, options=options)


def train(options: dict[str, Any], steps: int, folder: Path, seed: int = 0) -> Path:
    """Train for so many decisions; leaves ppo.zip, curve.csv (decisions, mean reward of one) and curve.png in `folder`, which must not be there.

    Raises ValueError where stable-baselines3 is missing or the folder is there.
    """
    ppo = _ppo()
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    if folder.exists():
        raise ValueError(f"{folder}: is there already")

    def make(number: int) -> Any:
        return Monitor(Training(gymnasium.make("pilsim/Placement-v0", **options, action="waypoint"), 7 * number))

    envs = DummyVecEnv([partial(make, number) for number in range(4)])
    model = ppo("MultiInputPolicy", envs, n_steps=240, batch_size=240, gamma=0.97, ent_coef=0.003, learning_rate=3e-4, seed=seed, device="cpu")
    curve = _learn(model, steps)
    unfinished = folder.with_name(f".{folder.name}.partial")
    unfinished.mkdir(parents=True, exist_ok=True)
    model.save(unfinished / "ppo.zip")
    with (unfinished / "curve.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("decisions", "reward"), *curve])
    _draw(curve, unfinished / "curve.png")
    unfinished.rename(folder)
    return folder / "ppo.zip"


def _learn(model: Any, steps: int) -> list[tuple[int, float]]:
    """Learn with a bar of progress; (decisions, mean reward a decision of the last episodes) after each round."""
    from stable_baselines3.common.callbacks import BaseCallback
    from tqdm import tqdm

    curve: list[tuple[int, float]] = []

    class Progress(BaseCallback):
        def _on_training_start(self) -> None:
            self.bar = tqdm(total=steps, unit=" decisions")

        def _on_step(self) -> bool:
            self.bar.update(min(self.num_timesteps, steps) - self.bar.n)
            return True

        def _on_rollout_end(self) -> None:
            if self.model.ep_info_buffer:
                episodes = list(self.model.ep_info_buffer)[-40:]
                curve.append((self.num_timesteps, float(np.mean([e["r"] / e["l"] for e in episodes]))))

        def _on_training_end(self) -> None:
            self.bar.close()

    model.learn(steps, callback=Progress())
    return curve


def _draw(curve: list[tuple[int, float]], file: Path) -> None:
    """The learning curve as a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), dpi=120, layout="constrained")
    axes = figure.subplots()
    if curve:
        axes.plot(*np.array(curve).T, color="#1e69d6", linewidth=1.8)
    axes.set_xlabel("decisions")
    axes.set_ylabel("reward a decision, mean of 40 episodes")
    axes.set_title("PPO on pilsim/Placement-v0", loc="left")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file)


def _ppo() -> Any:
    try:
        from stable_baselines3 import PPO
    except ImportError:
        raise ValueError(MISSING) from None
    return PPO
