"""The planar SLAM filter compared with the posterior Cramér-Rao bound: all modes, as a Markdown table with 95 % intervals.

One robot drives four laps of a circle of 10 m at 1 m/s among 24 landmarks and sees 5 m far, at three levels of noise. Errors count from 10 s on.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tracker.planar_slam.event_schedule import PlanarParameters, initial_state, run_filter
from tracker.planar_slam.filter import BOUND, OUTPUT, ROBOT, SCAN, STEP, EventSchedule, FilterSettings

Array = NDArray[np.float64]

RADIUS, SPEED, LAPS, PERIOD, LANDMARKS, SIGHT = 10.0, 1.0, 4, 0.5, 24, 5.0
LEVELS = {"1°, 0.1 m": (1.0, 0.1, 0.1, 0.02), "3°, 0.2 m": (3.0, 0.2, 0.1, 0.06), "6°, 0.4 m": (6.0, 0.4, 0.2, 0.10)}
"""Noise of bearing (°), range (m), speed (m/s), turn (rad/s)."""
OFFSET = np.array([0.02, 0.05])
"""Constant offsets of bearing (rad) and range (m), in runs with offsets. Their signs are random."""
SETTLED = 20  # steps: 10 s


@dataclass(frozen=True, eq=False)
class Drive:
    """A run: true poses (n, 3), landmarks (24, 2), the measured events, and the same events without noise."""

    truth: Array
    landmarks: Array
    measured: EventSchedule
    exact: EventSchedule


def drive(level: str, offset: bool, seed: int) -> Drive:
    """One seeded run; the start is known."""
    rng = np.random.default_rng(seed)
    bearing, reach, sigma_v, sigma_w = LEVELS[level]
    sigma = np.array([reach, np.deg2rad(bearing)])
    steps = round(LAPS * 2 * np.pi * RADIUS / SPEED / PERIOD)
    angle = np.arange(steps + 1) * SPEED * PERIOD / RADIUS
    truth = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), angle + np.pi / 2], axis=1)
    radius = np.sqrt(rng.uniform((RADIUS - 5) ** 2, (RADIUS + 5) ** 2, LANDMARKS))
    around = rng.uniform(-np.pi, np.pi, LANDMARKS)
    landmarks = np.stack([radius * np.cos(around), radius * np.sin(around)], axis=1)
    motion = np.tile([SPEED * PERIOD, SPEED * PERIOD / RADIUS], (steps, 1))
    spread = np.array([sigma_v, sigma_w]) * PERIOD
    noisy = motion + spread * rng.normal(size=motion.shape)
    noise = np.tile([spread[0] ** 2, 0, spread[1] ** 2, 0, 0, 0, 0, 0], (steps, 1))
    shift = OFFSET * rng.choice([-1, 1], 2) if offset else np.zeros(2)
    z, subject, start = [], [], [0]
    for x, y, heading in truth:
        d = landmarks - (x, y)
        r = np.hypot(*d.T)
        seen = np.flatnonzero(r < SIGHT)
        z.append(np.stack([r[seen] + shift[1], np.arctan2(d[seen, 1], d[seen, 0]) - heading + shift[0]], axis=1))
        subject.append(1 + seen)
        start.append(start[-1] + len(seen))
    rows = np.concatenate(z)
    rows += sigma * rng.normal(size=rows.shape)
    kind = np.concatenate([[SCAN, OUTPUT], np.tile([STEP, SCAN, OUTPUT], steps)])
    item = np.concatenate([[0, 0], np.stack([np.arange(steps), np.arange(1, steps + 1), np.arange(1, steps + 1)], axis=1).ravel()])
    time = np.concatenate([[0, 0], np.repeat(np.arange(1, steps + 1) * PERIOD, 3)])
    still = np.zeros_like(kind)

    def schedule(moves: Array) -> EventSchedule:
        seen = (np.array(start), np.concatenate(subject), rows, np.tile(sigma, (len(rows), 1)))
        return EventSchedule(kind, still, item, moves, noise, *seen, time, steps + 1)

    return Drive(truth, landmarks, schedule(noisy), schedule(motion))


def estimate(run: Drive, parameters: PlanarParameters | None, correction: bool) -> tuple[Array, Array]:
    """Errors (n, 3) and covariances (n, 3, 3) of the filter, or of the bound where there are no parameters."""
    covariance = np.zeros((1, ROBOT, ROBOT))
    if correction:
        covariance[0, [3, 4], [3, 4]] = OFFSET**2
    begin = np.zeros((1, ROBOT))
    begin[0, :3] = run.truth[0]
    s = initial_state(begin, covariance, LANDMARKS)
    settings = FilterSettings(BOUND, 1, np.inf, 0.0, 1 << 40, (0.0, 0.0), run.landmarks) if parameters is None else parameters.settings()
    path, spread = run_filter(s, settings, run.exact if parameters is None else run.measured)
    error = path[:, 0] - run.truth
    error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return error[SETTLED:], spread[SETTLED:, 0]


@dataclass(frozen=True, eq=False)
class Row:
    """Results of n runs: mean squared position error (n,) m², mean NEES per degree of freedom (n,), and mean variance of the bound (n,) m².

    lost: the number of runs that diverged.
    """

    square: Array
    nees: Array
    bound: Array
    lost: int

    @staticmethod
    def of(runs: list[tuple[float, float, float]]) -> Row:
        """The row of runs, each with square, nees and bound, NaN where it diverged."""
        table = np.array(runs)
        whole = np.isfinite(table).all(axis=1)
        return Row(*table[whole].T, lost=int((~whole).sum()))

    @property
    def rmse(self) -> float:
        return float(np.sqrt(self.square.mean()))

    @property
    def efficiency(self) -> float:
        """The ratio of the RMSE to its bound."""
        return float(np.sqrt(self.square.mean() / self.bound.mean()))

    def interval(self, measure: str, draws: int = 2000) -> tuple[float, float]:
        """The 95 % bootstrap interval over runs of "nees" or "efficiency"."""
        rng = np.random.default_rng(0)
        pick = rng.integers(len(self.square), size=(draws, len(self.square)))
        ratio = self.square[pick].mean(axis=1) / self.bound[pick].mean(axis=1)
        values = self.nees[pick].mean(axis=1) if measure == "nees" else np.sqrt(ratio)
        low, high = np.quantile(values, [0.025, 0.975])
        return float(low), float(high)


def rows(level: str, offset: bool, modes: dict[str, PlanarParameters], runs: int) -> dict[str, Row]:
    """The rows of all modes on the same seeded runs. The bound is that of the state that the mode estimates."""
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in modes}
    for seed in range(runs):
        run = drive(level, offset, seed)
        bounds: dict[bool, float] = {}
        for name, parameters in modes.items():
            if parameters.correction not in bounds:
                _, P = estimate(run, None, parameters.correction)
                bounds[parameters.correction] = float(P[:, [0, 1], [0, 1]].sum(axis=1).mean())
            try:
                error, P = estimate(run, parameters, parameters.correction)
            except ValueError:
                found[name].append((np.nan, np.nan, np.nan))
                continue
            nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(P), error).mean() / 3
            found[name].append((float((error[:, :2] ** 2).sum(axis=1).mean()), float(nees), bounds[parameters.correction]))
    return {name: Row.of(values) for name, values in found.items()}


def modes() -> dict[str, PlanarParameters]:
    """Textbook filters, and ours, which adds process noise for curved steps and robust weights."""
    plain = {"robust": np.inf, "curvature": 0.0, "max_outlier_excess": 1 << 40}
    table = {
        "EKF": PlanarParameters("ekf", 1, **plain),
        "EKF, 2 iterations": PlanarParameters("iekf", 2, **plain),
        "EKF, 5 iterations": PlanarParameters("iekf", 5, **plain),
        "first estimates": PlanarParameters("fej", 1),
        "invariant, plain": PlanarParameters("invariant", 2, **plain),
        "invariant (default)": PlanarParameters(),
    }
    return {f"{name}, {'on' if on else 'off'}": replace(p, correction=on) for name, p in table.items() for on in (False, True)}


HEAD = """| noise | filter, correction factor | RMSE, m | over its bound | NEES per degree of freedom | gain | lost |
|---|---|---|---|---|---|---|"""


def show(level: str, table: dict[str, Row]) -> None:
    """Print lines below HEAD. Names end in ", on" or ", off"; the gain is that of the correction factor."""
    for name, row in table.items():
        (a, b), (c, d) = row.interval("efficiency"), row.interval("nees")
        nees = f"{row.nees.mean():.2f} ({c:.2f}–{d:.2f})"
        gain = f"{1 - row.rmse / table[name.replace(', on', ', off')].rmse:+.0%}" if name.endswith("on") else ""
        cells = (level, name, f"{row.rmse:.3f}", f"{row.efficiency:.2f} ({a:.2f}–{b:.2f})", nees, gain, str(row.lost or ""))
        print(f"| {' | '.join(cells)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_known_args()[0].runs
    for offset in (False, True):
        print(f"\n{'With' if offset else 'Without'} true offsets of ±{OFFSET[0]} rad and ±{OFFSET[1]} m, {runs} runs\n\n{HEAD}")
        for level in LEVELS:
            show(level, rows(level, offset, modes(), runs))


if __name__ == "__main__":
    main()
