"""The policy trained by proximal policy optimization (Schulman et al. 2017): an ONNX file that onnxruntime runs, and its features of people.

All robots share one policy (parameter sharing, as in Yu et al. 2022, The surprising effectiveness of PPO in cooperative multi-agent games).
It chooses a waypoint for each robot every 3 s. It takes any number of people and robots.
Inputs: `choices` (n, CHOICES, FEATURES) of waypoints.py and `people` (n, k, CHOICES, PEOPLE_FEATURES) of `people_features`, float32.
Output: `scores` (n, CHOICES). The metadata has an entry `pilsim`, a JSON object: kind "placement", version 1.
Models of stable-baselines3, as 0.3.0 and 0.4.0 wrote them, are read, too; they need the extra `rl`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.placement.information import nats, predict_person, update_person
from sim.policies.planning import PeopleAhead, information_from
from sim.policies.policy import TeamKnowledge, waypoint_action
from sim.policies.waypoints import CHOICES, FEATURES, HOLD, WaypointFeatures
from tracker.geometry import Array
from tracker.geometry.compilation import njit

AHEAD = 3.0
"""Time ahead for which people are predicted, s: as long as a choice holds."""
PEOPLE_FEATURES = 5
"""Number of features of a person at a choice."""
NATS_SCALE, DISTANCE_SCALE = 6.0, 12.0
"""Nats and metres that are scaled to 1."""


Features = NDArray[np.float32]
MISSING = "stable-baselines3 is not installed, training and policies of it need it: pip install 'pilsim[rl]'"
KIND = {"kind": "placement", "version": 1}
LARGEST_MODEL = 1 << 24
"""Bytes of a model file, since a file of unknown origin may take the memory."""
Scores = Callable[[Features, Features], Array]
"""Features of choices and of people → scores (n, CHOICES) of the choices."""


def people_features(knowledge: TeamKnowledge, choices: NDArray[np.int64], bound_for: NDArray[np.int64]) -> NDArray[np.float32]:
    """Features (r, k, c, PEOPLE_FEATURES) of k people at the choices (r, c) of each robot. Choices and bound_for (r,) are nodes of the roadmap.

    While a robot chooses, the others are counted at the nodes that they are bound for.

    * 0: 1, so that rows of 0 are nobody. 1: nats about the person if the robot goes there. 2: of which it adds so many. 3: nats of now.
    * 4: distance of the person from the choice over 12 m.
    """
    ahead = PeopleAhead.of(knowledge, np.array([AHEAD]))
    used, rows = np.unique(np.concatenate([choices.ravel(), bound_for]), return_inverse=True)
    table = information_from(knowledge, used, ahead)[:, 0]
    out = np.zeros((len(choices), len(ahead.bounds), choices.shape[1], PEOPLE_FEATURES), dtype=np.float32)
    _fill(
        out,
        (ahead.bounds, ahead.feet[0], knowledge.place.roadmap.nodes[used]),
        table,
        (rows[: choices.size].reshape(choices.shape), rows[choices.size :]),
    )
    return out


class ChoiceFeatures:
    """The features of the choices of a team during an episode, and the nodes (r,) that the robots are bound for."""

    def __init__(self, knowledge: TeamKnowledge) -> None:
        self._waypoints = WaypointFeatures(knowledge)
        self.bound_for = knowledge.place.roadmap.nearest(knowledge.robots[:, :2])

    def update(self, knowledge: TeamKnowledge) -> tuple[Features, Features]:
        """Features (r, CHOICES, FEATURES) of the new choices, and (r, k, CHOICES, PEOPLE_FEATURES) of k known people at them.

        At most as many people are taken as there are, those known best first.
        """
        choices = self._waypoints.update(knowledge)
        people = people_features(knowledge, self._waypoints.goals, self.bound_for)
        if people.shape[1] > knowledge.config.people:
            best = np.argsort(-people[0, :, 0, 3], kind="stable")[: knowledge.config.people]
            people = people[:, best]
        return choices, people

    def chosen(self, choice: NDArray[np.int64]) -> NDArray[np.int64]:
        """The nodes (r,) of the choices (r,), which the robots are bound for from now on."""
        self.bound_for = self._waypoints.goals[np.arange(len(choice)), choice]
        return self.bound_for


@njit(cache=True)
def _fill(out, where, table, rows):  # type: ignore[no-untyped-def]
    (bounds, feet, nodes), (choices, bound_for), P = where, rows, np.empty((4, 4))
    for k in range(len(bounds)):
        P[:] = bounds[k]
        now = nats(P)
        predict_person(P, AHEAD)
        for r in range(len(choices)):
            others = np.zeros((2, 2))
            for q in range(len(choices)):
                if q != r:
                    others += 3.0 * table[bound_for[q], k]
            alone = P.copy()
            update_person(alone, others)
            for c in range(choices.shape[1]):
                after = alone.copy()
                update_person(after, 3.0 * table[choices[r, c], k])
                found, node = nats(after), nodes[choices[r, c]]
                out[r, k, c, 0], out[r, k, c, 1] = 1.0, found / NATS_SCALE
                out[r, k, c, 2], out[r, k, c, 3] = (found - nats(alone)) / NATS_SCALE, now / NATS_SCALE
                out[r, k, c, 4] = np.sqrt((node[0] - feet[k, 0]) ** 2 + (node[1] - feet[k, 1]) ** 2) / DISTANCE_SCALE


def shipped_policy() -> Path:
    """The policy that is shipped with the package."""
    return Path(__file__).with_name("placement_policy.onnx")


@dataclass(eq=False)
class Learned:
    """A policy that takes the choices of the highest scores."""

    scores: Scores
    action: str = "waypoint"

    @staticmethod
    def read(file: str) -> Learned:
        """Read a model. Raises ValueError for a missing file, a file that is no such model, and where stable-baselines3 is missing for one of it."""
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
    from sim.policies.vector_env import ChoicePolicy

    try:
        # Files name the module of the policy at the time when they were written.
        model = ppo.load(path, device="cpu", custom_objects={"policy_class": ChoicePolicy})
    except Exception as error:
        raise ValueError(f"{path}: not a policy of stable-baselines3 ({type(error).__name__})") from None
    size = model.observation_space.shape[0]
    if size % CHOICES or (size // CHOICES - FEATURES) % PEOPLE_FEATURES:
        raise ValueError(
            f"{path}: the policy takes observations of length {size}, needs {CHOICES * FEATURES} and {CHOICES * PEOPLE_FEATURES} a person"
        )
    return network_scores(model.policy.mlp_extractor)


def network_scores(network: Any) -> Scores:
    """The scores of a network of vector_env.ChoiceNetwork. Networks of 0.4.0 and before do not look at people."""
    import torch

    def scores(choices: Features, people: Features) -> Array:
        with torch.no_grad():
            rows = torch.as_tensor(choices)
            return np.asarray(network.score(network.with_people(rows, torch.as_tensor(people)) if network.people else rows).numpy())

    return scores


def needed() -> Any:
    """stable-baselines3's PPO. Raises ValueError where it is missing."""
    try:
        from stable_baselines3 import PPO
    except ImportError:
        raise ValueError(MISSING) from None
    return PPO
