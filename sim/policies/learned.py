"""The policy trained by proximal policy optimization (Schulman et al. 2017): an ONNX file that onnxruntime runs.

All robots share one policy (parameter sharing, as in Yu et al. 2022, The surprising effectiveness of PPO in cooperative multi-agent games).
It chooses a waypoint for each robot every second, from choices that predictive control has valued. It takes any number of people and robots.
Inputs: `choices` (n, CHOICES, FEATURES) and `people` (n, k, CHOICES, PEOPLE_FEATURES) of planning.py, float32.
Output: `scores` (n, CHOICES). The metadata has an entry `pilsim`, a JSON object: kind "placement", version 2.
Models of stable-baselines3, which versions 0.3.0 and 0.4.0 wrote, can be read with the extra `rl`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.policies.planning import FEATURES, PEOPLE_FEATURES, ChoiceFeatures, Features
from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import CHOICES, HOLD, POINT_FEATURES
from tracker.geometry import Array

MISSING = "stable-baselines3 is not installed, training and policies of it need it: pip install 'pilsim[rl]'"
KIND = {"kind": "placement", "version": 2}
LARGEST_MODEL = 1 << 24
"""Largest model file that is read, bytes: a file of unknown origin must not exhaust the memory."""
Scores = Callable[[Features, Features], Array]
"""Features of choices and of people → scores (n, CHOICES) of the choices."""


def shipped_policy() -> Path:
    """The policy that is shipped with the package."""
    return Path(__file__).with_name("placement_policy.onnx")


@dataclass(eq=False)
class Learned:
    """A policy that takes the choices with the highest scores."""

    scores: Scores
    action: str = "waypoint"

    @staticmethod
    def read(file: str) -> Learned:
        """Read a model. Raises ValueError for a missing file, another kind of file, and where a model needs stable-baselines3 and it is missing."""
        path = Path(file)
        if not path.is_file():
            raise ValueError(f"{file}: no such file")
        return Learned(_read_onnx(path) if path.suffix == ".onnx" else _read_stable_baselines(path))

    def begin(self, knowledge: TeamKnowledge, rng: np.random.Generator) -> None:
        self._features, self._count = ChoiceFeatures(knowledge), 0
        self._goals: NDArray[np.int64] = np.zeros(len(knowledge.robots), dtype=np.int64)

    def act(self, knowledge: TeamKnowledge) -> Array:
        if self._count % HOLD == 0:
            self._goals = self._features.chosen(self.scores(*self._features.update(knowledge)).argmax(axis=1))
        self._count += 1
        return waypoint_action(knowledge.place, self._goals)


def _read_onnx(path: Path) -> Scores:
    import onnxruntime

    if path.stat().st_size > LARGEST_MODEL:
        raise ValueError(f"{path}: has {path.stat().st_size} bytes, needs {LARGEST_MODEL} at most")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        about = json.loads(session.get_modelmeta().custom_metadata_map.get("pilsim", "{}"))
    except Exception as error:
        raise ValueError(f"{path}: not a model of onnxruntime ({type(error).__name__})") from None
    if {name: about.get(name) for name in KIND} != KIND:
        raise ValueError(f"{path}: is no placement policy of version {KIND['version']}, as `pilsim place --train` writes it")
    return lambda choices, people: np.asarray(session.run(["scores"], {"choices": choices, "people": people})[0])


def _read_stable_baselines(path: Path) -> Scores:
    ppo = needed()
    import torch

    from sim.policies.vector_env import ChoicePolicy

    try:
        # Files name the module of the policy at the time when they were written.
        model = ppo.load(path, device="cpu", custom_objects={"policy_class": ChoicePolicy})
    except Exception as error:
        raise ValueError(f"{path}: not a policy of stable-baselines3 ({type(error).__name__})") from None
    size = model.observation_space.shape[0]
    if size != CHOICES * POINT_FEATURES and (size % CHOICES or (size // CHOICES - FEATURES) % PEOPLE_FEATURES):
        raise ValueError(
            f"{path}: the policy takes observations of length {size}, needs {CHOICES * FEATURES} and {CHOICES * PEOPLE_FEATURES} a person"
        )
    network = model.policy.mlp_extractor

    def scores(choices: Features, people: Features) -> Array:
        # Networks of versions up to 0.4.0 have no inputs for people and for values.
        with torch.no_grad():
            rows = torch.as_tensor(choices[..., : network.shape[1]])
            return np.asarray(network.score(network.with_people(rows, torch.as_tensor(people)) if network.people else rows).numpy())

    return scores


def needed() -> Any:
    """stable-baselines3's PPO. Raises ValueError where it is missing."""
    try:
        from stable_baselines3 import PPO
    except ImportError:
        raise ValueError(MISSING) from None
    return PPO
