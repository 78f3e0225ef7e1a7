"""Paired comparison of trackers on the same runs: differences of scores between runs of the same setting and seed.

Paired runs share their people and their paths, so the difficulty of a scenario cancels in the difference. Settings of one seed share
their crowd, so only seeds are independent: over all settings, the differences of one seed are averaged first. Intervals are Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sim.confidence_intervals import Interval, difference_bounds_of, student_interval
from sim.report.rows import Row, Rows, read_beside
from tracker.io.atomic import new_file

Pair = tuple[str, int, dict[str, float], dict[str, float]]
"""Setting, seed, and the scores of the reference and of the other tracker."""
EVERY = "all settings"
"""The id of a difference over all settings."""


@dataclass(frozen=True)
class ComparedMeasure:
    """A score that is compared: its name in the rows, its label, whether more is better, and the digits that are shown."""

    name: str
    label: str
    more_is_better: bool = True
    digits: int = 3


MEASURES = (
    ComparedMeasure("mota", "MOTA"),
    ComparedMeasure("idf1", "IDF1"),
    ComparedMeasure("ate_m", "ATE [m]", more_is_better=False, digits=4),
)


@dataclass(frozen=True, eq=False)
class ScoreDifference:
    """The difference of one measure at one setting, or over EVERY setting.

    reference, compared: means of the two trackers over the pairs. interval: compared less reference; its count is the number of seeds.
    pairs: number of pairs of runs.
    """

    id: str
    measure: ComparedMeasure
    reference: float
    compared: float
    interval: Interval
    pairs: int

    @property
    def verdict(self) -> str:
        """One of better, worse, no difference seen, identical, and one seed (which has no interval)."""
        verdict = self.interval.verdict
        if verdict in ("higher", "lower"):
            return "better" if (verdict == "higher") == self.measure.more_is_better else "worse"
        return verdict


@dataclass(frozen=True, eq=False)
class ComparedPair:
    """A tracker compared with the reference.

    unpaired: number of rows that only the reference has, and number that only the tracker has. failed: pairs in which a run failed.
    """

    tracker: str
    unpaired: tuple[int, int]
    failed: int
    differences: tuple[ScoreDifference, ...] = field(default=())


@dataclass(frozen=True, eq=False)
class PairedComparison:
    """Every other tracker compared with the reference, which is the first."""

    reference: str
    pairs: tuple[ComparedPair, ...]


def compare_paired(folders: Sequence[Path]) -> PairedComparison:
    """Compare the trackers of several result folders, or of one. The first tracker is the reference.

    Raises ValueError where there is only one tracker, where no runs can be paired, and where one id and seed names two scenarios.
    """
    rows = read_beside(folders)
    reference, *others = rows.trackers
    if not others:
        raise ValueError(f"{folders[0]}: holds one tracker ({reference}), needs another folder or tracker beside it")
    return PairedComparison(reference, tuple(_compare(rows, reference, other) for other in others))


def _compare(rows: Rows, first: str, second: str) -> ComparedPair:
    """A tracker, the second, compared with the first, which is the reference."""
    reference, other = ({(row.id, row.seed): row for row in rows.rows if row.tracker == name} for name in (first, second))
    both = [key for key in reference if key in other]
    if not both:
        named = [", ".join(f"{id} of seed {seed}" for id, seed in sorted(one)[:2]) for one in (reference, other)]
        raise ValueError(f"{first} and {second} share no setting and seed: {named[0]} …, but {named[1]} …")
    for key in both:
        _check_same(reference[key], other[key])
    whole = [key for key in both if reference[key].error is None and other[key].error is None]
    unpaired = len(reference) - len(both), len(other) - len(both)
    ids = list(dict.fromkeys(id for id, _ in whole))
    groups = [*([EVERY] if len(ids) > 1 else []), *ids]
    pairs = [(*key, reference[key].scores, other[key].scores) for key in whole]
    found = [_difference(group, measure, pairs) for group in groups for measure in MEASURES]
    return ComparedPair(second, unpaired, len(both) - len(whole), tuple(one for one in found if one))


def _check_same(first: Row, second: Row) -> None:
    """Raises ValueError where two rows of one id and seed are not the same run."""
    where = f"{second.where} beside {first.where}: {first.id}, seed {first.seed}"
    for name in ("parameter", "value", "rendered"):
        if getattr(first, name) != getattr(second, name):
            raise ValueError(f"{where} is another scenario: {name} is {getattr(first, name)} and {getattr(second, name)}")
    for name in sorted({*first.scenario, *second.scenario}):
        if first.scenario.get(name) != second.scenario.get(name):
            raise ValueError(f"{where} is another scenario: {name} is {first.scenario.get(name)} and {second.scenario.get(name)}")


def _difference(group: str, measure: ComparedMeasure, pairs: list[Pair]) -> ScoreDifference | None:
    chosen = [(seed, a, b) for id, seed, a, b in pairs if group in (EVERY, id)]
    known = [(seed, a[measure.name], b[measure.name]) for seed, a, b in chosen if measure.name in a and measure.name in b]
    if not known:
        return None
    by_seed: dict[int, list[float]] = {}
    for seed, a, b in known:
        by_seed.setdefault(seed, []).append(b - a)
    interval = student_interval([float(np.mean(values)) for values in by_seed.values()], bounds=difference_bounds_of(measure.name))
    before, after = (float(np.mean([row[k] for row in known])) for k in (1, 2))
    return ScoreDifference(group, measure, before, after, interval, len(known))


def comparison_text(found: PairedComparison) -> str:
    """The comparison as a text of several lines."""
    lines = []
    for pair in found.pairs:
        lines += ["", f"{pair.tracker}, compared with {found.reference}{_unpaired(found, pair)}"]
        wide = max(len(one.id) for one in pair.differences) if pair.differences else 0
        for one in pair.differences:
            digits = one.measure.digits
            numbers = f"{one.reference:8.{digits}f} → {one.compared:7.{digits}f}   {one.interval.text(digits, signed=True):31s}"
            seeds = f"{one.interval.count} seed{'s' * (one.interval.count != 1)}"
            lines.append(f"  {one.id:{wide}s}  {one.measure.label:7s} {numbers} {one.verdict} ({seeds})")
        if not pair.differences:
            lines.append("  no pair of runs in which both have scores")
    note = "Differences from the reference: mean and 95 % interval (Student's t over seeds). More MOTA and IDF1 are better; less ATE is better."
    return "\n".join([*lines[1:], "", note, *_by_chance(found)])


def _unpaired(found: PairedComparison, pair: ComparedPair) -> str:
    names = found.reference, pair.tracker
    parts = [f"{n} run{'s' * (n != 1)} of {name} without a partner" for n, name in zip(pair.unpaired, names, strict=True) if n]
    parts += [f"{pair.failed} pair{'s' * (pair.failed != 1)} with a failed run left out"] if pair.failed else []
    return f" ({'; '.join(parts)})" if parts else ""


def _by_chance(found: PairedComparison) -> list[str]:
    """How many of the intervals exclude 0, and how many would by chance alone. No line where there is no interval."""
    every = [one for pair in found.pairs for one in pair.differences]
    judged = sum(one.interval.low is not None and one.verdict != "identical" for one in every)
    excluding = sum(one.verdict in ("better", "worse") for one in every)
    return [f"{excluding} of {judged} intervals exclude 0; by chance alone about {judged / 20:.1f} would."] if judged else []


def to_json(found: PairedComparison) -> dict[str, Any]:
    """The comparison as JSON values: `entrant` is a compared tracker, and `alone` counts rows without a partner."""

    def plain(one: ScoreDifference) -> dict[str, Any]:
        means = {"id": one.id, "measure": one.measure.name, "reference": one.reference, "entrant": one.compared, "pairs": one.pairs}
        interval = one.interval
        return means | {"difference": interval.mean, "low": interval.low, "high": interval.high, "seeds": interval.count, "verdict": one.verdict}

    entrants = [
        {"name": pair.tracker, "alone": list(pair.unpaired), "failed": pair.failed, "differences": [plain(one) for one in pair.differences]}
        for pair in found.pairs
    ]
    return {"reference": found.reference, "interval": "Student's t over seeds, 95 %", "entrants": entrants}


def draw_comparison(found: PairedComparison, path: Path) -> None:
    """Write a PNG of paired differences, each with its interval, beside the line of no difference. Right is better.

    Each measure has a panel, each setting a line, each tracker a colour.
    Raises ValueError where no pair of runs has scores.
    """
    import matplotlib.figure

    from sim.report.plots import STYLE, shortened

    ids = list(dict.fromkeys(one.id for pair in found.pairs for one in pair.differences))
    if not ids:
        raise ValueError(f"{path}: no pair of runs has scores, so there is nothing to draw")
    with matplotlib.rc_context(STYLE):
        figure = matplotlib.figure.Figure(figsize=(13, 1.9 + 0.42 * len(ids) * max(1, 0.6 * len(found.pairs))), layout="constrained")
        figure.suptitle(f"Difference from {found.reference} with 95 % interval; filled: the interval excludes 0", fontsize=12, x=0.01, ha="left")
        panels = figure.subplots(1, len(MEASURES), sharey=True)
        for axes, measure in zip(panels, MEASURES, strict=True):
            _differences(axes, found, measure, ids)
        panels[0].set_yticks(range(len(ids)), [shortened(id) for id in ids])
        panels[0].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=3, frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        with new_file(path) as part:
            figure.savefig(part, dpi=120, metadata={"Software": None})


def _differences(axes: Any, found: PairedComparison, measure: ComparedMeasure, ids: list[str]) -> None:
    from sim.report.plots import MARKERS, PALETTE

    axes.axvline(0, color="#222222", linewidth=1.2)
    axes.grid(axis="y", visible=False)
    for k, pair in enumerate(found.pairs):
        shift = 0.5 * ((k + 0.5) / len(found.pairs) - 0.5)
        style = {"color": PALETTE[k % len(PALETTE)], "marker": MARKERS[k % len(MARKERS)], "markersize": 7, "linestyle": "none"}
        axes.plot([], [], label=pair.tracker, **style)
        for one in pair.differences:
            if one.measure is measure:
                place, interval = ids.index(one.id) + shift, one.interval
                if interval.low is not None and interval.high is not None:
                    axes.hlines(place, interval.low, interval.high, color=style["color"], linewidth=3 if one.id == EVERY else 1.8)
                certain = one.verdict in ("better", "worse")
                axes.plot([interval.mean], [place], fillstyle="full" if certain else "none", markeredgewidth=1.8, **style)
    if not measure.more_is_better:
        axes.invert_xaxis()
    axes.set(title=measure.label, xlabel="worse ←   difference   → better")
