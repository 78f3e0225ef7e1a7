"""Does the reward rank placements as the tracker does, and how much could the best placement win?

    python -m tests.benchmarks.placement_reward [PLACEMENTS [DRAWS [DECISIONS]]]
    python -m tests.benchmarks.placement_reward oracle [SEEDS [TRACKED [DECISIONS]]]

Four robots drive to random places and stand there, among 20 people. (Robots that never moved have attitudes with errors of 0.4°, which information
does not hold: at 12 m, people are then misplaced by 0.7 m.) HOTA is that of the default tracker with a delay of 5 frames and SLAM, the detector
is fairmot. The first table has Spearman's correlations of terms of the reward with HOTA over all worlds. HOTA and terms are means of DRAWS episodes
with other people. By default there are 64 placements, one draw and 40 decisions.

The oracle knows where people will walk. It takes the TRACKED placements of 200 whose robots, with their drive, have the most information in the very
episode, in two worlds.
By default it has ten seeds, one placement tracked and 60 decisions. Policies play the same episodes.
"""

from __future__ import annotations

import sys
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

import sim  # noqa: F401
from sim.placement.config import SEEDS_PER_MAP
from sim.placement.map import MapKey, PlacementMap, map_of
from sim.policies.policy import TeamKnowledge, assign_goals, waypoint_action
from sim.policies.rollouts import EpisodeResult, differences, run_episodes, table, text
from worlds import catalogue

TERMS = ("information", "seen", "seen_twice")
FIRST_SEED = 7000
RESAMPLES = 2000
HELD_OUT, ORACLE_SEED, SEARCHED = ("campus", "ruins"), 4000, 200
POLICIES, MEASURED = ("static", "greedy", "predictive"), ("information", "hota", "idf1", "mota", "seen", "seen_twice")


def options(world: str, **more: Any) -> dict[str, Any]:
    return {"world": world, "people": 20, "detector_model": "fairmot", **more}


def made(world: str, observation: str, **more: Any) -> Any:
    return gymnasium.make("pilsim/Placement-v0", **options(world, observation=observation, action="waypoint", **more)).unwrapped


def drawn(place: PlacementMap, *seed: int) -> NDArray[np.int64]:
    """A random placement: four nodes of the roadmap."""
    return place.roadmap.nearest(place.draw_starts(np.random.default_rng(seed), 4)[:, :2])


def stand(env: Any, seed: int, nodes: NDArray[np.int64], decisions: int) -> dict[str, float]:
    """Means of TERMS, and HOTA where the tracker is in the loop, of robots that drive to nodes (r,) and stand there."""
    observation, _ = env.reset(seed=seed)
    rows = []
    for _ in range(decisions):
        action = waypoint_action(env.episode.place, assign_goals(TeamKnowledge.of(env.episode, observation), nodes))
        observation, *_, info = env.step(action)
        rows.append([info[name] for name in TERMS])
    return dict(zip(TERMS, np.mean(rows, axis=0).tolist(), strict=True)) | (env.episode.tracking.scores() if env.episode.tracking else {})


def placed(world: str, number: int, draws: int, decisions: int) -> list[float]:
    """HOTA and means of TERMS of one random placement."""
    env = made(world, "tracks", map_seed=FIRST_SEED)
    nodes = drawn(map_of(MapKey(world, 0.5, FIRST_SEED, 20)), FIRST_SEED, number)
    rows = [stand(env, FIRST_SEED + 100 * number + draw, nodes, decisions) for draw in range(draws)]
    return [float(np.mean([row[name] for row in rows])) for name in ("hota", *TERMS)]


def oracle(seeds: int = 10, tracked: int = 1, decisions: int = 60) -> None:
    """Print the scores of the oracle's placements, of the placement of median information, and of policies, with differences from the oracle."""
    for world in HELD_OUT:
        results: list[EpisodeResult] = []
        quick, full = made(world, "state"), made(world, "tracks")
        for seed in range(ORACLE_SEED, ORACLE_SEED + seeds):
            place = map_of(MapKey(world, 0.5, seed // SEEDS_PER_MAP, 20))
            nodes = [drawn(place, seed, k) for k in range(SEARCHED)]
            order = np.argsort([-stand(quick, seed, one, decisions)["information"] for one in nodes])
            found = {"oracle": order[:tracked], "median": order[[SEARCHED // 2]]}
            rows = {name: [stand(full, seed, nodes[k], decisions) for k in chosen] for name, chosen in found.items()}
            rows |= {name: [run_episodes(name, [seed], options(world, observation="tracks"), decisions)[0].values] for name in POLICIES}
            results += [EpisodeResult(name, seed, {m: float(np.mean([one[m] for one in of])) for m in MEASURED}) for name, of in rows.items()]
            print(world, seed, *(f"{one.policy} {one.values['hota']:.3f}" for one in results[-len(rows) :]), flush=True)
        print(text(table(results), differences(results)))


def correlations(placements: int = 64, draws: int = 1, decisions: int = 40) -> None:
    worlds = sorted(catalogue.WORLDS)
    rows = []
    for k in range(placements):
        rows.append(placed(worlds[k % len(worlds)], k, draws, decisions))
        print(f"{worlds[k % len(worlds)]:8s} {k:4d} " + " ".join(f"{value:.3f}" for value in rows[-1]), flush=True)
    found = np.array(rows)
    rng = np.random.default_rng(0)
    again = [rng.integers(placements, size=placements) for _ in range(RESAMPLES)]
    print(f"\nSpearman's correlation with HOTA over {placements} placements in {len(worlds)} worlds, {draws} draw(s) of {decisions} decisions")
    for k, name in enumerate(TERMS, start=1):
        overall = spearmanr(found[:, 0], found[:, k]).statistic
        low, high = np.nanquantile([spearmanr(found[rows, 0], found[rows, k]).statistic for rows in again], [0.025, 0.975])
        within = [spearmanr(found[n :: len(worlds), 0], found[n :: len(worlds), k]).statistic for n in range(len(worlds))]
        print(f"{name:12s} {overall:.3f} ({low:.3f} to {high:.3f}); in each world {np.nanmean(within):.3f}")


if __name__ == "__main__":
    chosen = oracle if sys.argv[1:2] == ["oracle"] else correlations
    chosen(*map(int, sys.argv[2 if chosen is oracle else 1 :]))
