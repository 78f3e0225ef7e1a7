"""Findings of a stress test in sentences: how far each sweep lowers the scores, for which causes, and how certain that is.

A difference is reported only where the 95 % interval of the paired differences over seeds excludes 0. Where the best and the worst of
n settings are compared, the interval is corrected for all n (n − 1) / 2 pairs (Bonferroni).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sim.confidence_intervals import Interval, paired, student_interval
from sim.report.rows import KINDS, STAGES, Row, Rows, Setting, SweepRows
from sim.stress.sweeps import KNOWN_SWEEPS

REAL = "pets"
"""The sweep that compares a real sequence, PETS 2009 S2.L1, with its simulated twin."""
CAREFUL = 5
"""The page warns of wide intervals where there are fewer seeds than this."""
BROKEN = 0.5
"""A setting is called broken where the mean MOTA is below this number: errors are then more than half as many as true positions."""
GLOSSARY = (
    ("MOTA", "tracking accuracy: 1 is perfect. Missed people, false people and switched identities lower it; it can be below 0."),
    ("IDF1", "the F1 score of identities, from 0 to 1: how consistently each person keeps one identity."),
    ("ATE", "absolute trajectory error of the robots, in metres: the root mean square distance from their true positions, without alignment."),
    ("Ghost", "a mapped landmark that is half a metre or more from every true one, or a duplicate of another."),
    ("MOTP", "the mean distance of tracks from the people whom they follow, in metres."),
    ("Broken", f"the mean MOTA is below {BROKEN:g}."),
    (
        "0.61 (0.55 to 0.67)",
        "a mean over seeds with its 95 % confidence interval, cut at the bounds of the figure. It is a bootstrap interval (BCa) from 6 seeds on,"
        " and Student's t for fewer.",
    ),
    ("Falls, no difference", "paired differences of the best and the worst setting over seeds, by Student's t with a Bonferroni correction."),
    ("Seed", "the start of the random numbers. Another seed gives other people on other paths; all settings use the same seeds."),
    ("Switch", "an identity switch: a person is tracked under one identity and then under another."),
    ("Limit", "no tracker can follow people whom no robot sees, and no filter is more precise than the Cramér-Rao bound."),
    ("Perfect input", "the run repeated with the truth given to one or more stages. Shapley values divide the loss among the stages."),
)  # fmt: skip
"""Words of a report with their meanings, for readers who have never scored a tracker."""

CAUSES = {
    "nobody saw it": "no part of the person was visible in any camera.",
    "occluded": "less than a fifth of the person was visible, even in the best view.",
    "detector missed": "the person was visible, but no box was reported.",
    "not yet believed": "boxes were reported, but the tracker had not yet confirmed the new track.",
    "gated out": "boxes of a tracked person were reported, but the tracker did not assign them to the track.",
    "pose error": "pose errors of the robots that saw the person shifted it by more than half a metre on the ground.",
    "merged": "two people stood near each other, and one track covered both.",
    "clutter": "a track of no person, started by false boxes.",
    "duplicate": "a second track of a person who was tracked already.",
    "coasting": "a track that was predicted onwards without boxes, away from its person.",
    "misplaced": "a track more than a metre from its person, who therefore counts as missed.",
    "wrong association": "the track of one person continued on another.",
    "after occlusion": "the person was occluded for a while and came back under a new identity.",
    "after detector misses": "no box was reported for a while, and the person came back under a new identity.",
    "new track": "the person got a new identity without having been lost.",
}
"""Causes of errors, by the names in the rows."""


@dataclass(frozen=True, eq=False)
class Finding:
    """The effect of a sweep on the MOTA of one tracker.

    best, worst: the settings with the highest and the lowest mean. high, low: their means. difference: worst less best, paired over seeds, or None
    where they share no seed. broken: the settings whose mean is below BROKEN.
    """

    sweep: SweepRows
    tracker: str
    best: Setting
    worst: Setting
    high: Interval
    low: Interval
    difference: Interval | None
    broken: tuple[Setting, ...]

    @property
    def fall(self) -> float:
        """The fall of the score, at least 0. It is 0 where the interval of the difference does not exclude 0."""
        return -self.difference.mean if self.difference and self.difference.verdict == "lower" else 0.0


def finding(sweep: SweepRows, tracker: str) -> Finding | None:
    """The finding of a sweep for one tracker. None where no setting has a score."""
    scored = _means(sweep, tracker, "mota")
    if not scored:
        return None
    (best, high), (worst, low) = max(scored, key=lambda pair: pair[1].mean), min(scored, key=lambda pair: pair[1].mean)
    broken = tuple(s for s, interval in scored if interval.mean < BROKEN)
    return Finding(sweep, tracker, best, worst, high, low, _difference(best, worst, tracker, "mota", len(scored)), broken)


def _means(sweep: SweepRows, tracker: str, name: str) -> list[tuple[Setting, Interval]]:
    """The settings that have a score, with its means."""
    return [(s, mean) for s in sweep.ordered() if (mean := s.mean(tracker, name))]


def _difference(first: Setting, second: Setting, tracker: str, name: str, count: int) -> Interval | None:
    """The paired difference of a score between the extremes of `count` settings; None for the same setting."""
    confidence = 1 - 0.05 / max(count * (count - 1) // 2, 1)
    return paired(first.scores(tracker, name), second.scores(tracker, name), confidence) if first is not second else None


def findings(rows: Rows, tracker: str) -> list[Finding]:
    """The findings of all sweeps except REAL: the largest significant fall first, then the others by the difference of their means."""
    found = [f for sweep in rows.sweeps() if sweep.name != REAL and (f := finding(sweep, tracker))]
    return sorted(found, key=lambda f: (-f.fall, f.low.mean - f.high.mean))


def at(setting: Setting) -> str:
    """A setting in words, for instance "100 people", or "people = 100" where the sweep or the kind of its value is unknown."""
    return at_row(setting.rows[0])


def at_row(row: Row) -> str:
    """The setting of one run in words, as `at` gives it."""
    value, known = row.value, KNOWN_SWEEPS.get(row.sweep)
    if known and isinstance(value, str) == isinstance(known.values[0], str):
        return known.wording.format(value)
    return f"{row.parameter} = {f'{value:g}' if isinstance(value, float) else value}"


def listed(names: Iterable[str]) -> str:
    """Names as a list in words, for instance "a, b and c"."""
    *most, last = list(names) or ["nothing"]
    return f"{', '.join(most)} and {last}" if most else last


def plural(count: int, name: str) -> str:
    """A count with its noun, for instance "1 run" or "3 runs"."""
    return f"{count} {name}" if count == 1 else f"{count} {name}s"


def spread(sweep: SweepRows) -> str:
    """The values of a sweep in words, for instance "people from 5 to 150" or "terrain exact, coarse or flat"."""
    if sweep.name == REAL:
        return "a real sequence, PETS 2009 S2.L1, compared with its simulated twin"
    values = [f"{v:g}" if isinstance(v := s.value, float) else str(v) for s in sweep.ordered()]
    if len(values) == 1:
        return at(sweep.settings[0])
    if sweep.numeric:
        return f"{sweep.parameter} from {values[0]} to {values[-1]}"
    return f"{sweep.parameter} {', '.join(values[:-1])} or {values[-1]}"


def change(found: Finding, name: str = "MOTA") -> str:
    """A sentence on how MOTA changes over the sweep."""
    if found.difference is None:
        only = found.best is found.worst
        return f"{name} is {found.high.text()} at {at(found.best)}" + (", the only setting with a score." if only else "; no seeds to compare.")
    ends = f"{found.high.text()} at {at(found.best)} and {found.low.text()} at {at(found.worst)}"
    if found.difference.verdict == "lower":
        return f"{name} falls from {found.high.text()} at {at(found.best)} to {found.low.text()} at {at(found.worst)}."
    if found.difference.verdict == "one seed":
        return f"{name} is {ends}. One seed alone cannot show whether the difference is due to chance."
    if found.difference.verdict == "identical":
        return f"{name} is the same at all settings, {found.high.text()}."
    return f"No significant difference is seen: {name} is {ends}."


def breaking(found: Finding) -> str:
    """A sentence on the settings at which MOTA is below BROKEN."""
    if not found.broken:
        return f"It stays above {BROKEN:g} at every setting."
    scored = [s for s in found.sweep.ordered() if s.scores(found.tracker, "mota")]
    if len(found.broken) == len(scored):
        return f"It is below {BROKEN:g} at every setting, so the tracker is broken before the sweep begins."
    places = [scored.index(s) for s in found.broken]
    if found.sweep.numeric and len(places) > 1 and places in (list(range(places[0], len(scored))), list(range(places[-1] + 1))):
        edge, way = (found.broken[0], "up") if places[0] else (found.broken[-1], "down")
        return f"It is below {BROKEN:g} from {at(edge)} {way}."
    return f"It is below {BROKEN:g} at {listed(at(s) for s in found.broken)}."


def causes_of(rows: Sequence[Row]) -> dict[str, Counter[str]]:
    """Kind of error → cause → count, summed over rows."""
    out: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    for row in rows:
        for kind, counts in row.causes.items():
            out.setdefault(kind, Counter()).update({cause: int(n) for cause, n in counts.items() if n})
    return {kind: counts for kind, counts in out.items() if counts}


def chief(rows: Sequence[Row]) -> tuple[str, str, float] | None:
    """The most frequent pair of a kind of error and its cause, with its share of all errors. None where no error was counted."""
    causes = causes_of(rows)
    pairs = {(kind, cause): n for kind, counts in causes.items() for cause, n in counts.items()}
    if not pairs:
        return None
    (kind, cause), count = max(pairs.items(), key=lambda pair: pair[1])
    return kind, cause, count / sum(pairs.values())


def reasons(rows: Sequence[Row], where: str) -> str:
    """Sentences on the shares of the kinds of errors, and on the most frequent cause. Empty where no error was counted."""
    causes, most = causes_of(rows), chief(rows)
    if most is None:
        return ""
    numbers = {kind: sum(counts.values()) for kind, counts in causes.items()}
    total = sum(numbers.values())
    parts = listed(f"{100 * numbers[kind] / total:.0f} % {kind}" for kind in sorted(numbers, key=lambda kind: -numbers[kind]))
    text = f"Of {plural(total, 'error')} at {where}, {parts}. The most frequent cause is {most[1]} ({most[0]}), {100 * most[2]:.0f} % of all errors"
    return f"{text}: {CAUSES[most[1]]}" if most[1] in CAUSES else f"{text}."


def stages(rows: Sequence[Row], measure: str = "mota") -> dict[str, Interval]:
    """Stage, or "total" → what perfect input to it would recover of a measure: the mean over the runs that have an ablation."""
    ablations = [row.ablation[measure] for row in rows if measure in row.ablation]
    known = [stage for stage in (*STAGES, "total") if any(stage in one for one in ablations)]
    return {stage: student_interval([one[stage] for one in ablations if stage in one]) for stage in known}


def owner(rows: Sequence[Row], where: str) -> str:
    """Sentences on the stages that cause most of the loss of MOTA. Empty where there is no ablation."""
    shares = stages(rows)
    total = shares.pop("total", None)
    if total is None or len(shares) < 2:
        return ""
    first, second = sorted(shares, key=lambda stage: -shares[stage].mean)[:2]
    low, high = ({row.seed: row.ablation["mota"][stage] for row in rows if stage in row.ablation.get("mota", {})} for stage in (second, first))
    separated = paired(low, high)
    lost = 1 - float(np.mean([row.scores["mota"] for row in rows if "mota" in row.ablation and "mota" in row.scores] or [0.0]))
    text = f"The loss of MOTA at {where} is {lost:.2f}. Perfect input to {listed(shares)} together would recover {total.text()}"
    if total.mean < 0.01 or shares[first].mean <= 0:
        return f"{text}: next to nothing, so other stages cause the loss."
    text += f". The largest shares are {first} with {shares[first].text()} and {second} with {shares[second].text()}"
    return text + ("." if separated and separated.verdict == "higher" else "; the difference between these two is not significant.")


def robots(found: Finding) -> str:
    """Sentences on the robots' ATE at the best and the worst setting, with dead reckoning and the bound. Empty where no ATE is known."""
    known = _means(found.sweep, found.tracker, "ate_m")
    if not known:
        return ""
    (least, low), (most, high) = min(known, key=lambda pair: pair[1].mean), max(known, key=lambda pair: pair[1].mean)
    difference = _difference(least, most, found.tracker, "ate_m", len(known))
    if difference and difference.verdict == "higher":
        text = f"The ATE of the robots is {low.text(3)} m at {at(least)} and {high.text(3)} m at {at(most)}"
    else:
        text = f"The ATE of the robots is {high.text(3)} m at {at(most)}" + ("; no other setting is significantly better" if len(known) > 1 else "")
    odometry, bound = "it is {} m by dead reckoning alone", "no filter can be better than {} m (the Cramér-Rao bound)"
    for name, words in (("dead_reckoning_m", odometry), ("ate_bound_m", bound)):
        if values := most.scores(found.tracker, name):
            text += "; " + words.format(f"{float(np.mean(list(values.values()))):.3f}")
    return text + "."


def predicted(sweep: SweepRows, tracker: str) -> str:
    """Sentences on how well the simulated twin of a real sequence predicts its scores. Empty where one of the two is missing."""
    by_value = {str(s.value): s for s in sweep.settings}
    sentences = []
    for name, label in (("mota", "MOTA"), ("idf1", "IDF1")):
        means = [float(np.mean(list(v.values()))) for v in (by_value[k].scores(tracker, name) for k in ("real", "twin") if k in by_value) if v]
        if len(means) == 2:
            sentences.append(f"{label} is {means[0]:.3f} on the real sequence and {means[1]:.3f} on its simulated twin ({means[1] - means[0]:+.3f})")
    if not sentences:
        return ""
    return f"{'; '.join(sentences)}. One sequence cannot show how well simulation predicts other sequences.".replace("(-", "(−")
