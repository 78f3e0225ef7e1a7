"""Training of a policy by PPO with stable-baselines3, resumed after an interruption. Needs the extra `rl`."""

from __future__ import annotations

import csv
import json
import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sim.policies.learned import KIND, needed
from sim.policies.planning import FEATURES, PEOPLE_FEATURES
from sim.policies.waypoints import CHOICES, HOLD
from tracker.io.atomic import finish_folder, is_free, new_file, partial_path, unfinished_path, write_text
from tracker.io.csv_tables import read_table
from tracker.io.file_lock import folder_lock
from tracker.io.json_files import read_json
from tracker.io.progress import progress_bar
from tracker.io.resume import check_same

TEAMS, ROLLOUT_LENGTH = 24, 60
"""Number of teams that are simulated in parallel, and choices of each per update of the policy."""
BASELINES: tuple[str, ...] = ("static", "greedy", "predictive")
"""Policies whose rewards are drawn beside the learning curve."""
LEARNING_RATE = 3e-4
"""Initial learning rate, which decreases linearly to 0."""
MODEL, RUN, CURVE, EXPORTED = "ppo.zip", "order.json", "curve.csv", "policy.onnx"
OPSET = 17
CURVE_COLUMNS: dict[str, type] = {"decisions": int, "reward": float, "standard_error": float}


@dataclass(eq=False)
class Curve:
    """A learning curve.

    Each row has the number of decisions, the mean reward of the episodes that ended since the last row, and its standard error.
    """

    steps: int
    rows: list[tuple[int, float, float]] = field(default_factory=list)

    def add(self, decisions: int, rewards: list[float]) -> None:
        error = float(np.std(rewards, ddof=1) / np.sqrt(len(rewards))) if len(rewards) > 1 else 0.0
        self.rows.append((decisions, float(np.mean(rewards)), error))

    def write(self, file: Path) -> None:
        with new_file(file) as part, part.open("w", newline="", encoding="utf-8") as out:
            csv.writer(out).writerows([tuple(CURVE_COLUMNS), *self.rows])

    @staticmethod
    def read(file: Path, steps: int) -> Curve:
        """The curve that `write` wrote. Raises ValueError with file and line."""
        table = read_table(file, CURVE_COLUMNS)
        return Curve(steps, list(zip(*(table[name].tolist() for name in CURVE_COLUMNS), strict=True)))


def train(options: dict[str, Any], steps: int, folder: Path, seed: int = 0, varied: Mapping[str, Sequence[Any]] | None = None) -> Path:
    """Train for `steps` decisions. Writes policy.onnx, ppo.zip, curve.csv (the rows of Curve) and curve.png into a new or empty folder.

    varied: options that differ between teams, with their values. The same seed gives the same policy.
    Unfinished training is kept in a hidden folder in `folder`. After an interruption the same call resumes from the last saved model,
    with the episodes that follow.
    Returns the path of policy.onnx.
    Raises ValueError where stable-baselines3 is missing, the folder is not empty or holds another training, or another process uses it.
    """
    needed()
    if not is_free(folder):
        raise ValueError(f"{folder}: exists already, needs a new folder")
    with folder_lock(folder):
        _train(options, steps, folder, seed, dict(varied or {}))
    return folder / EXPORTED


def _train(options: dict[str, Any], steps: int, folder: Path, seed: int, varied: dict[str, Sequence[Any]]) -> None:
    import torch

    from sim.policies.vector_env import TeamVecEnv, options_of_teams

    # Versions up to 0.3.0 kept unfinished training beside the folder.
    part, run = partial_path(folder) if partial_path(folder).is_dir() else unfinished_path(folder), {"options": options, "steps": steps, "seed": seed}
    run |= {"teams": TEAMS, "version": KIND["version"], "varied": {name: list(values) for name, values in varied.items()}}
    if (part / RUN).exists():
        check_same(part, read_json(part / RUN), run, "another training, which was interrupted")
    torch.set_num_threads(1)
    teams = options_of_teams(options, varied, TEAMS)
    envs = TeamVecEnv(teams)
    model, curve = _new_or_resumed(envs, part, steps, seed)
    part.mkdir(parents=True, exist_ok=True)
    write_text(part / RUN, json.dumps(run))
    _learn(model, envs, curve, part)
    envs.close()
    _save(model, curve, part)
    export(model, part / EXPORTED)
    draw(curve, _baseline_rewards(teams), part / "curve.png")
    finish_folder(folder, part)


def _new_or_resumed(envs: Any, folder: Path, steps: int, seed: int) -> tuple[Any, Curve]:
    """A new model and curve, or those of an interrupted training."""
    ppo = needed()
    from sim.policies.vector_env import LENGTH, ChoicePolicy

    if (folder / MODEL).exists():
        model = ppo.load(folder / MODEL, env=envs, device="cpu", custom_objects={"policy_class": ChoicePolicy})
        # Loading seeds the random numbers anew, and the teams begin at their first episodes.
        model.set_random_seed(seed + model.num_timesteps)
        for team in envs.teams:
            team.played = model.num_timesteps // envs.num_envs * HOLD // LENGTH
        return model, Curve.read(folder / CURVE, steps)
    rates: dict[str, Any] = {"learning_rate": _learning_rate, "gamma": 0.95, "gae_lambda": 0.9, "ent_coef": 0.0, "n_epochs": 4, "target_kl": 0.02}
    shape = {"choices": CHOICES, "parts": FEATURES, "people": PEOPLE_FEATURES}
    batch = ROLLOUT_LENGTH * envs.num_envs // 8
    model = ppo(ChoicePolicy, envs, n_steps=ROLLOUT_LENGTH, batch_size=batch, policy_kwargs=shape, seed=seed, device="cpu", **rates)
    return model, Curve(steps)


def _learning_rate(remaining: float) -> float:
    return LEARNING_RATE * remaining


def _save(model: Any, curve: Curve, folder: Path) -> None:
    curve.write(folder / CURVE)
    with new_file(folder / MODEL) as part:
        model.save(part)


def export(model: Any, file: Path) -> None:
    """Write the actor of a model of stable-baselines3 as the ONNX file of learned.py."""
    import onnx
    import torch

    class Actor(torch.nn.Module):
        def __init__(self, network: Any) -> None:
            super().__init__()
            self.network = network

        def forward(self, choices: torch.Tensor, people: torch.Tensor) -> torch.Tensor:
            return self.network.score(self.network.with_people(choices, people))

    axes = {"choices": {0: "robots"}, "people": {0: "robots", 1: "people"}, "scores": {0: "robots"}}
    example = torch.zeros(2, CHOICES, FEATURES), torch.zeros(2, 3, CHOICES, PEOPLE_FEATURES)
    with new_file(file) as part, warnings.catch_warnings():
        # The tracing exporter gives a plain graph, and warns that a newer exporter exists.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            Actor(model.policy.mlp_extractor).eval(), example, part, dynamo=False, opset_version=OPSET,
            input_names=["choices", "people"], output_names=["scores"], dynamic_axes=axes,
        )  # fmt: skip
        graph = onnx.load(part)
        onnx.helper.set_model_props(graph, {"pilsim": json.dumps(KIND)})
        onnx.save(graph, part)


def _learn(model: Any, envs: Any, curve: Curve, folder: Path, pause: float = 20.0) -> None:
    """Learn, with a progress bar. Adds a row to the curve whenever as many episodes as teams have ended, and saves every `pause` s."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Progress(BaseCallback):
        def _on_training_start(self) -> None:
            self.bar = progress_bar(total=curve.steps, unit=" decisions")
            self.saved = time.monotonic()

        def _on_step(self) -> bool:
            decisions = self.num_timesteps // envs.num_envs * HOLD * len(envs.teams)
            self.bar.update(min(decisions, curve.steps) - self.bar.n)
            if len(envs.finished) >= len(envs.teams):
                curve.add(decisions, envs.finished)
                self.bar.set_postfix(reward=f"{curve.rows[-1][1]:.3f}")
                envs.finished = []
                if time.monotonic() - self.saved > pause:
                    _save(self.model, curve, folder)
                    self.saved = time.monotonic()
            return True

        def _on_training_end(self) -> None:
            self.bar.close()

    remaining = math.ceil(curve.steps / (HOLD * len(envs.teams))) * envs.num_envs - model.num_timesteps
    if remaining > 0:
        model.learn(remaining, callback=Progress(), reset_num_timesteps=model.num_timesteps == 0)


def _baseline_rewards(teams: Sequence[dict[str, Any]]) -> dict[str, float]:
    """The mean reward per decision of the baseline policies in the first episode of each team."""
    from sim.policies.rollouts import run_episodes
    from sim.policies.vector_env import LENGTH, training_seed

    rows = []
    # Teams are in the outer loop: all policies play on a map while it exists.
    for k, one in enumerate(progress_bar(teams, unit=" teams")):
        rows.append([run_episodes(name, [training_seed(k, 0, len(teams))], one, LENGTH)[0].values["reward"] for name in BASELINES])
    return dict(zip(BASELINES, np.mean(rows, axis=0).tolist(), strict=True))


def draw(curve: Curve, others: dict[str, float], file: Path) -> None:
    """Plot the learning curve as a PNG, with a band of two standard errors. others: rewards of other policies by name, as lines."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.2), dpi=120, layout="constrained")
    axes = figure.subplots()
    end = curve.rows[-1][0] if curve.rows else 1
    if curve.rows:
        decisions, reward, error = np.array(curve.rows).T
        axes.fill_between(decisions, reward - 2 * error, reward + 2 * error, color="#1e69d6", alpha=0.18, linewidth=0)
        axes.plot(decisions, reward, color="#1e69d6", linewidth=1.8)
    for value in others.values():
        axes.axhline(value, color="#666666", linewidth=1.0, linestyle=(0, (5, 3)))
    gap, last = 0.045 * (axes.get_ylim()[1] - axes.get_ylim()[0]), -np.inf
    for name, value in sorted(others.items(), key=lambda item: item[1]):
        # Labels of close lines are kept apart.
        last = max(value, last + gap)
        axes.annotate(name, (end * 1.015, last), va="center", fontsize=8.5, color="#444444", annotation_clip=False)
    axes.set_xlim(0, end)
    axes.set_xlabel("decisions")
    axes.set_ylabel("reward per decision")
    axes.set_title("PPO on pilsim/Placement-v0: mean over maps ± 2 standard errors", loc="left", fontsize=10)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file)
