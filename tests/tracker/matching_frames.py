"""Sequences for the metrics of tracking: written as tables of letters, or random."""

from __future__ import annotations

import itertools

import numpy as np

from tracker.metrics.matching import MatchingFrame


def table(truth: dict[str, str], estimates: dict[str, str], counts: dict[str, str] | None = None) -> list[MatchingFrame]:
    """A sequence from text: a row per person or estimate, a letter per frame. `.` is absent, and `0` in counts is ignored.

    A capital letter is a position (A at x = 0 m, B at 10 m, …). The small letter lies 0.4 m beside it.
    """

    def place(letter: str) -> list[float]:
        return [10.0 * (ord(letter.upper()) - ord("A")) + 0.4 * letter.islower(), 0.0]

    frames = []
    for k in range(len(next(iter({**truth, **estimates}.values())))):
        t = [(i, row[k], (counts or {}).get(name, "1" * 99)[k]) for i, (name, row) in enumerate(truth.items()) if row[k] != "."]
        e = [(i, row[k]) for i, row in enumerate(estimates.values()) if row[k] != "."]
        frames.append(
            MatchingFrame(
                np.array([i for i, _, _ in t], dtype=int),
                np.array([place(c) for _, c, _ in t]).reshape(-1, 2),
                np.array([i for i, _ in e], dtype=int),
                np.array([place(c) for _, c in e]).reshape(-1, 2),
                None if counts is None else np.array([c != "0" for _, _, c in t], dtype=bool),
            )
        )
    return frames


def random_frames(rng: np.random.Generator, *, apart: float = 0.0, gaps: bool = True, length: int = 14) -> list[MatchingFrame]:
    """People on random walks with births, deaths and gaps; estimates with noise, misses, clutter and exchanged ids.

    With `apart` > 0 people stand on a grid that wide, and noise and clutter leave every match unambiguous.
    """
    n, side = int(rng.integers(1, 6)), rng.uniform(2, 8)
    home = np.stack([apart * np.arange(n), np.zeros(n)], axis=1) if apart else rng.uniform(0, side, (n, 2))
    first, last = rng.integers(0, length // 2, n), rng.integers(length // 2, length + 1, n)
    names, sigma, miss, clutter = list(range(10, 10 + n)), rng.uniform(0.05, 0.5), rng.choice([0.1, 0.3, 0.9]), rng.uniform(0, 1)
    fresh, place, frames = itertools.count(50), home.copy(), []
    for k in range(length):
        place = home + np.clip(rng.normal(0, 0.1, (n, 2)), -0.4, 0.4) if apart else place + rng.normal(0, 0.3, (n, 2))
        here = (first <= k) & (k < last) & ((rng.random(n) > 0.15) | (not gaps))
        if rng.random() < 0.2:
            i = int(rng.integers(n))
            names[i] = next(fresh)
        if rng.random() < 0.2:
            i, j = rng.integers(n, size=2)
            names[i], names[j] = names[j], names[i]
        seen = here & (rng.random(n) > miss)
        noise = np.clip(rng.normal(0, sigma, (n, 2)), -0.3, 0.3) if apart else rng.normal(0, sigma, (n, 2))
        wrong = rng.poisson(clutter) if gaps or not apart else 1 + rng.poisson(clutter)
        where = rng.uniform(0, side, (wrong, 2)) + ([0, 50] if apart else [0, 0])
        ids = np.array([names[i] for i in np.flatnonzero(seen)] + [next(fresh) for _ in range(wrong)], dtype=int)
        order = rng.permutation(len(ids))
        estimate = np.concatenate([(place + noise)[seen], where])
        frames.append(MatchingFrame(np.flatnonzero(here) + 1, place[here], ids[order], estimate[order]))
    return frames
