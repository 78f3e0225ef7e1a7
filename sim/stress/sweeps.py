"""What the tracker is tried on: sweeps of one parameter each, as data. An id like `density/3` names one value of one sweep for good.

A case is a change of a Scenario, troubles on the way to the tracker, and options of the tracker; with a seed it is one reproducible run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from sim.scenario import Scenario
from sim.stress.faults import KNOWLEDGE, Faults

Value = int | float | str

OWN_GOALS = "own goals"
POLICIES = (OWN_GOALS, "random", "static", "lloyd", "greedy")
"""Who sends the robots: nobody, each tours goals of its own, as in all other sweeps; or a policy of placement_trial."""


@dataclass(frozen=True)
class Sweep:
    """A row of cases that differ in one parameter. about: what it asks, one line; parameter: what is varied; values: of it, mild to harsh as they
    come; said: a value in words, as str.format takes it; unit of the values; world: where, else that of the runs.
    """

    name: str
    about: str
    parameter: str
    values: tuple[Value, ...]
    said: str
    unit: str = ""
    world: str | None = None


SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep("density", "more and more people, who hide each other", "people", (5, 10, 20, 40, 80, 150), "{} people", world="ruins"),
        Sweep("difficulty", "rougher ground, more clutter", "difficulty", (0.0, 0.25, 0.5, 0.75, 1.0), "difficulty {}"),
        Sweep("robots", "from one view to a team of seven", "robots", (7, 5, 4, 3, 2, 1), "a team of {}"),
        Sweep("dropout", "views that stay away, in spells of about five frames", "dropout", (0.0, 0.1, 0.3, 0.5, 0.7),
            "{:.0%} of views away", "share of frames"),
        Sweep("misses", "people in sight whom the detector does not report", "misses", (0.0, 0.1, 0.3, 0.5, 0.7), "{:.0%} not reported", "share"),
        Sweep("clutter", "boxes where nobody is", "clutter", (0.0, 0.5, 1.0, 2.0, 5.0), "{:g} false boxes a view", "boxes a view and frame"),
        Sweep("box_noise", "edges of boxes that stray", "bearing_noise", (0.0, 0.15, 0.5, 1.0, 2.0), "edges {:g}° off", "degrees"),
        Sweep("rate", "the same ten seconds in fewer frames", "rate", (12.0, 6.0, 3.0, 2.0, 1.0), "{:g} frames a second", "frames a second"),
        Sweep("slip", "wheels that slip more than the odometry says", "slip", (0.0, 0.05, 0.1, 0.2, 0.4), "{:.0%} of slip", "share of the way"),
        Sweep("skew", "every second robot's clock is late", "skew", (0, 1, 2, 4), "clocks {} frames late", "frames"),
        Sweep("terrain", "what is known of the terrain", "terrain", KNOWLEDGE, "terrain known: {}"),
        Sweep("kidnapped", "one robot is carried away, blind, its wheels still", "kidnapped", (0.0, 1.0, 2.0, 4.0), "{:g} s carried", "seconds"),
        Sweep("filter", "the filter of the robots' places and its correction factor", "slam", (
            "fej, 2 iterations, correction", "fej, 2 iterations", "invariant, 2 iterations, correction", "invariant, 2 iterations",
            "iekf, 2 iterations, correction", "iekf, 2 iterations",
            "ekf, correction", "ekf",
        ), "filter: {}"),
        Sweep("hypotheses", "K_H, global hypotheses that are kept", "k_h", (1, 5, 10, 15, 20, 25, 30), "K_H = {}"),
        Sweep("moves", "moves of the clique search at most", "i_bls_max", (500, 1000, 2000), "{} moves"),
        Sweep("placement", "who decides where the robots stand", "policy", POLICIES, "policy {}", world="ruins"),
    )
}  # fmt: skip

DISTURBED = ("dropout", "slip", "skew", "terrain", "kidnapped")
FILTERED = ("filter", "hypotheses", "moves")


@dataclass(frozen=True)
class Case:
    """One value of one sweep: a Scenario whose seed is still to be set, troubles, and options of the tracker (Contender) as JSON values.

    policy: who sends the robots, of POLICIES, in the sweep over it; "" in all others.
    source: "" for a simulated run; else "pets" or "twin", of the PETS 2009 folder in `folder`.
    """

    id: str
    sweep: str
    parameter: str
    value: Value
    scenario: Scenario
    troubles: Faults = field(default_factory=Faults)
    options: dict[str, Value] = field(default_factory=dict)
    policy: str = ""
    source: str = ""
    folder: str = ""

    def of_seed(self, seed: int) -> Case:
        """The same with the scenario's seed set."""
        return replace(self, scenario=replace(self.scenario, seed=seed))

    def to_json(self) -> str:
        """One line of JSON, for another process."""
        plain = {name: getattr(self, name) for name in ("id", "sweep", "parameter", "value", "options", "policy", "source", "folder")}
        return json.dumps(plain | {"scenario": json.loads(self.scenario.to_json()), "troubles": self.troubles.to_dict()})

    @staticmethod
    def from_json(text: str) -> Case:
        """What to_json wrote."""
        content = json.loads(text)
        scenario, troubles = Scenario.from_json(json.dumps(content.pop("scenario"))), Faults(**content.pop("troubles"))
        return Case(**content, scenario=scenario, troubles=troubles)


def standard(frames: int = 60, width: int = 512) -> Scenario:
    """What every case starts from: ten seconds of ten people and four rovers in the lab."""
    return Scenario(frames=frames, width=width)


def cases(names: Iterable[str], start: Scenario) -> list[Case]:
    """All cases of the sweeps `names`, which may be single cases as in density/3; all sweeps where there is none.

    Raises ValueError for an unknown name and lists those that there are.
    """
    out: dict[str, Case] = {}
    for name in list(names) or list(SWEEPS):
        sweep, _, number = name.partition("/")
        if sweep not in SWEEPS:
            raise ValueError(f"--sweep is {name!r}, needs one of {', '.join(SWEEPS)}")
        count = len(SWEEPS[sweep].values)
        if number and not (number.isdecimal() and int(number) < count):
            raise ValueError(f"--sweep is {name!r}, needs {sweep}/0 to {sweep}/{count - 1}")
        for k in [int(number)] if number else range(count):
            out[f"{sweep}/{k}"] = _case(SWEEPS[sweep], k, start)
    return list(out.values())


def _case(sweep: Sweep, number: int, start: Scenario) -> Case:
    value = sweep.values[number]
    scenario, troubles, options = start, Faults(), dict[str, Value]()
    if sweep.world:
        scenario = replace(scenario, world=sweep.world)
    if sweep.name in DISTURBED:
        troubles = Faults(**{sweep.parameter: value})  # type: ignore[arg-type]
    elif sweep.name in FILTERED:
        options = _options(sweep.name, value)
    elif sweep.name == "placement":
        return Case(f"{sweep.name}/{number}", sweep.name, sweep.parameter, value, scenario, policy=str(value))
    elif sweep.name == "rate":
        scenario = replace(scenario, rate=float(value), frames=max(2, round(start.frames * float(value) / start.rate)))
    elif sweep.name == "box_noise":
        scenario = replace(scenario, bearing_noise=float(np.radians(float(value))))
    else:
        scenario = replace(scenario, **{sweep.parameter: value})  # type: ignore[arg-type]
    return Case(f"{sweep.name}/{number}", sweep.name, sweep.parameter, value, scenario, troubles, options)


def _options(sweep: str, value: Value) -> dict[str, Value]:
    """Options of the tracker at a value of a sweep over it."""
    if sweep == "filter":
        mode, *rest = str(value).split(", ")
        out: dict[str, Value] = {"slam": mode, "correction": "on" if "correction" in rest else "off"}
        return out | ({"iterations": 2} if mode != "ekf" else {})
    return {"hypotheses": "multiple", "k_h" if sweep == "hypotheses" else "i_bls_max": value}


def pets_cases(folder: str, start: Scenario) -> list[Case]:
    """A PETS 2009 sequence and its twin."""
    sources = {"real": "pets", "twin": "twin"}
    return [Case(f"pets/{name}", "pets", "source", name, start, source=source, folder=folder) for name, source in sources.items()]
