"""What the rows of a stress test say, in sentences: what was tested, what broke first, why, how far from the limits, how sure it is.

Every sentence follows from a rule that is stated here, and says no more than the numbers do: a difference is one only where the 95 % interval of
the paired differences over seeds leaves out 0; where the best and the worst of n settings are compared, the interval is that of all
n (n − 1) / 2 pairs together (Bonferroni).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sim.intervals import Interval, mean_interval, paired
from sim.report_glossary import BROKEN, CAUSES
from sim.report_rows import KINDS, STAGES, Row, Rows, Setting, Sweep
from sim.stress import SWEEPS

REAL = "pets"
"""The sweep that sets a real sequence, PETS 2009 S2.L1, beside its simulated twin."""
CAREFUL = 5
"""Seeds below which the page warns that intervals are wide."""


@dataclass(frozen=True, eq=False)
class Finding:
    """What a sweep does to one tracker's score: the settings with the highest and the lowest mean, and their difference (lowest less highest)."""

    sweep: Sweep
    tracker: str
    best: Setting
    worst: Setting
    high: Interval
    low: Interval
    difference: Interval | None
    broken: tuple[Setting, ...]

    @property
    def fall(self) -> float:
        """How far the score falls, 0 where that is not seen for sure."""
        return -self.difference.mean if self.difference and self.difference.verdict == "lower" else 0.0


def finding(sweep: Sweep, tracker: str) -> Finding | None:
    """None where no setting has a score."""
    scored = [(s, mean_interval(list(known.values()))) for s in sweep.ordered() if (known := s.scores(tracker, "mota"))]
    if not scored:
        return None
    (best, high), (worst, low) = max(scored, key=lambda pair: pair[1].mean), min(scored, key=lambda pair: pair[1].mean)
    pairs = max(len(scored) * (len(scored) - 1) // 2, 1)
    difference = paired(best.scores(tracker, "mota"), worst.scores(tracker, "mota"), 1 - 0.05 / pairs) if best is not worst else None
    broken = tuple(s for s, interval in scored if interval.mean < BROKEN)
    return Finding(sweep, tracker, best, worst, high, low, difference, broken)


def findings(rows: Rows, tracker: str) -> list[Finding]:
    """Of all sweeps but REAL, which is no trouble, the largest fall first; those without a sure fall after them, by their means."""
    found = [f for sweep in rows.sweeps() if sweep.name != REAL and (f := finding(sweep, tracker))]
    return sorted(found, key=lambda f: (-f.fall, f.low.mean - f.high.mean))


def at(setting: Setting) -> str:
    """As in "100 people", or "people = 100" where the sweep is none of ours, or its value none that it takes."""
    return at_row(setting.rows[0])


def at_row(row: Row) -> str:
    """The same of one run."""
    value, known = row.value, SWEEPS.get(row.sweep)
    if known and isinstance(value, str) == isinstance(known.values[0], str):
        return known.said.format(value)
    return f"{row.parameter} = {f'{value:g}' if isinstance(value, float) else value}"


def listed(names: Iterable[str]) -> str:
    """As in "a, b and c"."""
    *most, last = list(names) or ["nothing"]
    return f"{', '.join(most)} and {last}" if most else last


def plural(count: int, name: str) -> str:
    return f"{count} {name}" if count == 1 else f"{count} {name}s"


def spread(sweep: Sweep) -> str:
    """As in "people from 5 to 150", or "terrain exact, coarse or flat"."""
    if sweep.name == REAL:
        return "a real sequence, PETS 2009 S2.L1, beside its simulated twin"
    values = [f"{v:g}" if isinstance(v := s.value, float) else str(v) for s in sweep.ordered()]
    if len(values) == 1:
        return at(sweep.settings[0])
    if sweep.numeric:
        return f"{sweep.parameter} from {values[0]} to {values[-1]}"
    return f"{sweep.parameter} {', '.join(values[:-1])} or {values[-1]}"


def change(found: Finding, name: str = "MOTA") -> str:
    """One sentence on what the sweep does to MOTA."""
    if found.difference is None:
        only = found.best is found.worst
        return f"{name} is {found.high.text()} at {at(found.best)}" + (", the only setting with a score." if only else "; no seeds to compare.")
    ends = f"{found.high.text()} at {at(found.best)} and {found.low.text()} at {at(found.worst)}"
    if found.difference.verdict == "lower":
        return f"{name} falls from {found.high.text()} at {at(found.best)} to {found.low.text()} at {at(found.worst)}."
    if found.difference.verdict == "one seed":
        return f"{name} is {ends}; one seed alone cannot say whether that is chance."
    if found.difference.verdict == "identical":
        return f"{name} is the same at all settings, {found.high.text()}."
    return f"No difference is seen for sure: {name} is {ends}."


def breaking(found: Finding) -> str:
    """Where the sweep falls below BROKEN, or that it does not."""
    if not found.broken:
        return f"It stays above {BROKEN:g} at every setting."
    scored = [s for s in found.sweep.ordered() if s.scores(found.tracker, "mota")]
    if len(found.broken) == len(scored):
        return f"It is below {BROKEN:g} at every setting: the sweep starts from a tracker that is broken already."
    places = [scored.index(s) for s in found.broken]
    if found.sweep.numeric and len(places) > 1 and places in (list(range(places[0], len(scored))), list(range(places[-1] + 1))):
        edge, way = (found.broken[0], "up") if places[0] else (found.broken[-1], "down")
        return f"It is below {BROKEN:g} from {at(edge)} {way}."
    return f"It is below {BROKEN:g} at {listed(at(s) for s in found.broken)}."


def causes_of(rows: Sequence[Row]) -> dict[str, Counter[str]]:
    """Kind of error → cause → count, over rows."""
    out: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    for row in rows:
        for kind, counts in row.causes.items():
            out.setdefault(kind, Counter()).update({cause: int(n) for cause, n in counts.items() if n})
    return {kind: counts for kind, counts in out.items() if counts}


def chief(rows: Sequence[Row]) -> tuple[str, str, float] | None:
    """The commonest pair of a kind of error and its cause, and its share of all errors; None where nothing was counted."""
    causes = causes_of(rows)
    pairs = {(kind, cause): n for kind, counts in causes.items() for cause, n in counts.items()}
    if not pairs:
        return None
    (kind, cause), count = max(pairs.items(), key=lambda pair: pair[1])
    return kind, cause, count / sum(pairs.values())


def reasons(rows: Sequence[Row], where: str) -> str:
    """Which kind of error there is most of, and the commonest cause; empty where nothing was counted."""
    causes, most = causes_of(rows), chief(rows)
    if most is None:
        return ""
    numbers = {kind: sum(counts.values()) for kind, counts in causes.items()}
    total = sum(numbers.values())
    parts = listed(f"{100 * numbers[kind] / total:.0f} % {kind}" for kind in sorted(numbers, key=lambda kind: -numbers[kind]))
    said = f"Of {plural(total, 'error')} at {where}, {parts}; the commonest cause: {most[1]} ({most[0]}), {100 * most[2]:.0f} % of all errors"
    return f"{said}: {CAUSES[most[1]]}" if most[1] in CAUSES else f"{said}."


def stages(rows: Sequence[Row], measure: str = "mota") -> dict[str, Interval]:
    """Stage → its share of the loss, mean over runs that have a ladder; "total" among them."""
    ladders = [row.ladder[measure] for row in rows if measure in row.ladder]
    known = [stage for stage in (*STAGES, "total") if any(stage in one for one in ladders)]
    return {stage: mean_interval([one[stage] for one in ladders if stage in one]) for stage in known}


def owner(rows: Sequence[Row], where: str) -> str:
    """Which stage owns most of the loss of MOTA; empty where no ladder was climbed."""
    shares = stages(rows)
    total = shares.pop("total", None)
    if total is None or len(shares) < 2:
        return ""
    first, second = sorted(shares, key=lambda stage: -shares[stage].mean)[:2]
    low, high = ({row.seed: row.ladder["mota"][stage] for row in rows if stage in row.ladder.get("mota", {})} for stage in (second, first))
    sure = paired(low, high)
    lost = 1 - mean_interval([row.scores["mota"] for row in rows if "mota" in row.ladder and "mota" in row.scores] or [0.0]).mean
    said = f"Of the MOTA lost at {where}, {lost:.2f}, perfect input to all of {listed(shares)} would win back {total.text()}"
    if total.mean < 0.01 or shares[first].mean <= 0:
        return f"{said}: next to nothing, so what is lost is lost elsewhere."
    said += f"; of this {first} own {shares[first].text()} and {second} {shares[second].text()}"
    return said + ("." if sure and sure.verdict == "higher" else "; which of the two owns more is not sure.")


def robots(found: Finding) -> str:
    """How far the robots are off, best and worst setting, beside dead reckoning and the bound; empty where nothing is known."""
    known = [(s, mean_interval(list(v.values()))) for s in found.sweep.ordered() if (v := s.scores(found.tracker, "ate_m"))]
    if not known:
        return ""
    (least, low), (most, high) = min(known, key=lambda pair: pair[1].mean), max(known, key=lambda pair: pair[1].mean)
    pairs = max(len(known) * (len(known) - 1) // 2, 1)
    difference = paired(least.scores(found.tracker, "ate_m"), most.scores(found.tracker, "ate_m"), 1 - 0.05 / pairs) if least is not most else None
    if difference and difference.verdict == "higher":
        said = f"Robots are {low.text(3)} m off at {at(least)} and {high.text(3)} m at {at(most)}"
    else:
        said = f"Robots are {high.text(3)} m off at {at(most)}" + (", no other setting is better for sure" if len(known) > 1 else "")
    wheels, bound = "by wheels alone it would be {} m", "no filter can be better than {} m (the Cramér-Rao bound)"
    for name, words in (("dead_reckoning_m", wheels), ("ate_bound_m", bound)):
        if values := most.scores(found.tracker, name):
            said += "; " + words.format(f"{mean_interval(list(values.values())).mean:.3f}")
    return said + "."


def predicted(sweep: Sweep, tracker: str) -> str:
    """Whether the twin of a real sequence foretells its scores; empty where one of the two is not there."""
    by_value = {str(s.value): s for s in sweep.settings}
    said = []
    for name, label in (("mota", "MOTA"), ("idf1", "IDF1")):
        means = [mean_interval(list(v.values())).mean for v in (by_value[k].scores(tracker, name) for k in ("real", "twin") if k in by_value) if v]
        if len(means) == 2:
            said.append(f"{label} is {means[0]:.3f} on the real sequence and {means[1]:.3f} on its simulated twin ({means[1] - means[0]:+.3f})")
    if not said:
        return ""
    return f"{'; '.join(said)}. One sequence shows how near the two are there; it cannot say how near they are elsewhere.".replace("(-", "(−")
