"""Does the reward rank placements as the tracker does? Spearman's correlation of its terms with HOTA, over random placements in all worlds.

    python -m tests.benchmarks.placement_reward [PLACEMENTS [DRAWS [DECISIONS]]]

Four robots stand still at random free places among 20 people. HOTA is that of the default tracker with a delay of 5 frames and SLAM, the detector
is fairmot. HOTA and terms are means of DRAWS episodes with other people. By default there are 64 placements, one draw and 40 decisions.
"""

from __future__ import annotations

import sys

import gymnasium
import numpy as np
from scipy.stats import spearmanr

import sim  # noqa: F401
from sim.placement.map import MapKey, map_of
from worlds import catalogue

TERMS = ("information", "seen", "seen_twice")
FIRST_SEED = 7000
RESAMPLES = 2000


def placed(world: str, number: int, draws: int, decisions: int) -> list[float]:
    """HOTA and means of TERMS of one random placement."""
    place = map_of(MapKey(world, 0.5, FIRST_SEED, 20))
    starts = place.draw_starts(np.random.default_rng([FIRST_SEED, number]), 4)
    env = gymnasium.make("pilsim/Placement-v0", world=world, people=20, map_seed=FIRST_SEED, observation="tracks", detector_model="fairmot").unwrapped
    rows = []
    for draw in range(draws):
        env.reset(seed=FIRST_SEED + 100 * number + draw, options={"starts": starts})
        infos = [env.step(np.zeros((4, 2)))[4] for _ in range(decisions)]
        scores = env.episode.tracking.scores()  # type: ignore[attr-defined]
        rows.append([scores["hota"], *(float(np.mean([info[name] for info in infos])) for name in TERMS)])
    return list(np.mean(rows, axis=0))


def main(placements: int = 64, draws: int = 1, decisions: int = 40) -> None:
    worlds = sorted(catalogue.WORLDS)
    rows = []
    for k in range(placements):
        rows.append(placed(worlds[k % len(worlds)], k, draws, decisions))
        print(f"{worlds[k % len(worlds)]:8s} {k:4d} " + " ".join(f"{value:.3f}" for value in rows[-1]), flush=True)
    table = np.array(rows)
    rng = np.random.default_rng(0)
    again = [rng.integers(placements, size=placements) for _ in range(RESAMPLES)]
    print(f"\nSpearman's correlation with HOTA over {placements} placements in {len(worlds)} worlds, {draws} draw(s) of {decisions} decisions")
    for k, name in enumerate(TERMS, start=1):
        found = spearmanr(table[:, 0], table[:, k]).statistic
        low, high = np.nanquantile([spearmanr(table[rows, 0], table[rows, k]).statistic for rows in again], [0.025, 0.975])
        within = [spearmanr(table[n :: len(worlds), 0], table[n :: len(worlds), k]).statistic for n in range(len(worlds))]
        print(f"{name:12s} {found:.3f} ({low:.3f} to {high:.3f}); in each world {np.nanmean(within):.3f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
