"""Findings and summary of a stress test in sentences: how far each sweep lowers the scores, for which causes, and how certain that is.

A difference is reported only where the 95 % interval of the paired differences over seeds excludes 0. Where the best and the worst of
n settings are compared, the interval is corrected for all n (n − 1) / 2 pairs (Bonferroni).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sim.confidence_intervals import Interval, bounds_of, mean_interval, paired, student_interval
from sim.prediction import KINDS
from sim.report.rows import Row, Rows, Setting, SweepRows
from sim.stress.ablation import STAGES
from sim.stress.sweeps import KNOWN_SWEEPS, RECORDING_SWEEPS

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
    "not yet confirmed": "boxes were reported, but the tracker had not yet confirmed the new track.",
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
SCORE = (
    "MOTA is 1 less the sum of misses, false positives and identity switches, divided by the number of true positions."
    f" A setting is called broken where the mean MOTA is below {BROKEN:g}."
)


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
    """The settings that have the score `name`, with its mean."""
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


def real(rows: Rows) -> str:
    """Sentences on the scores of a real sequence and its twin. Empty where neither has one."""
    tracker = rows.trackers[0]
    found = [f for sweep in rows.sweeps() if sweep.name == REAL and (f := finding(sweep, tracker))]
    return " ".join(predicted(one.sweep, tracker) or change(one) for one in found)


def headline(rows: Rows) -> str:
    """The most important finding, in one or two sentences."""
    found = findings(rows, rows.trackers[0])
    if not found:
        return real(rows) or "No run has a score, so there is no finding. See the runs that failed."
    first = found[0]
    if first.difference and first.difference.verdict == "one seed":
        ends = f"{first.high.mean:.2f} at {at(first.best)} and {first.low.mean:.2f} at {at(first.worst)}"
        return f"MOTA (1 is perfect) is {ends}. One seed alone cannot show whether the difference is due to chance."
    if not first.fall:
        return f"In {plural(len(found), 'sweep')}, no setting is significantly worse than another."
    text = f"{first.sweep.name.capitalize()} has the largest effect: MOTA (1 is perfect) falls from {first.high.mean:.2f} at {at(first.best)}"
    text += f" to {first.low.mean:.2f} at {at(first.worst)}"
    most = chief(first.worst.of(first.tracker))
    return text + (f". The most frequent errors there: {most[0]} ({most[1]})." if most else ".")


def summary(rows: Rows) -> list[tuple[str, str]]:
    """Pairs of a heading and its text, for the first tracker. Other trackers are named where there are some."""
    tracker = rows.trackers[0]
    found = findings(rows, tracker)
    sections = [("What was tested", tested(rows)), ("The score", SCORE)]
    if not found:
        if scored := real(rows):
            return [*sections, ("Results", scored), ("Certainty", certainty(rows))]
        return [*sections, ("Results", f"Every run failed or has no score: {chief_error(rows)}.")]
    worst, where = found[0].worst.of(tracker), at(found[0].worst)
    sections += [("Largest effect", broke(found)), ("Causes", f"{reasons(worst, where)} {owner(worst, where)}".strip())]
    sections += [("Robots", robots(found[0])), ("Distance from the limits", limits(found[0]))]
    if len(rows.trackers) > 1:
        sections.append(("Trackers", trackers(rows)))
    return [(heading, text) for heading, text in [*sections, ("Certainty", certainty(rows))] if text]


def tested(rows: Rows) -> str:
    """What was tested: worlds, trackers, sweeps, and the number of runs."""
    sweeps, whole = rows.sweeps(), rows.rows
    settings, seeds = sum(len(sweep.settings) for sweep in sweeps), len({row.seed for row in whole})
    recorded = [row for row in whole if row.sweep in RECORDING_SWEEPS]
    simulated = [row for row in whole if row.sweep not in (REAL, *RECORDING_SWEEPS)]
    worlds = sorted({str(row.scenario["world"]) for row in simulated if "world" in row.scenario})
    frames = sorted({row.frames for row in simulated + recorded if row.frames})
    ours = [sweep for sweep in sweeps if sweep.name != REAL]
    names = listed(spread(sweep) for sweep in ours[:4]) + (f" and {len(ours) - 4} more" if len(ours) > 4 else "")
    seen = ["the cameras of a recording with known truth"] if recorded else []
    if simulated:
        named = f" (world{'s' * (len(worlds) > 1)} {listed(worlds)})" if worlds else ""
        seen = [f"{cameras_of(simulated)}, in simulation with known truth{named}", *seen]
    text = f"Tracking of people{f' by {listed(seen)}' if seen else ''}; tracker: {listed(rows.trackers)}. "
    if ours:
        text += f"One parameter is varied: {names}. " if len(ours) == 1 else f"{len(ours)} sweeps, each of one parameter: {names}. "
    text += "".join(f"{'Also a' if ours else 'A'}{spread(sweep)[1:]}. " for sweep in sweeps if sweep.name == REAL)
    text += f"{plural(len(whole), 'run')} of {plural(settings, 'setting')} and {plural(seeds, 'seed')}"
    # A recording may be shorter.
    text += f", {'at most ' * bool(recorded)}{' or '.join(map(str, frames))} frames each" if frames else ""
    if frames and len(ours) < len(sweeps):
        text += ", the real sequence and its twin at their own length"
    if not simulated:
        return f"{text}."
    rendered = {row.rendered for row in whole if row.sweep not in RECORDING_SWEEPS}
    rendering = {True: "images were rendered", False: "detections were simulated without rendering"}
    return f"{text}; {rendering[rendered.pop()] if len(rendered) == 1 else 'some were rendered, some not'}."


def cameras_of(simulated: list[Row]) -> str:
    """Which cameras see the people of simulated runs: those of robots, and fixed ones where there are no robots."""
    driven = {bool(row.scenario.get("robots", True)) for row in simulated} or {True}
    return listed(["panoramic cameras of moving robots"] * (True in driven) + ["fixed cameras"] * (False in driven))


def broke(found: list[Finding]) -> str:
    """The sweep with the largest effect, the other falls, and the settings at which the tracker is broken."""
    first = found[0]
    text = f"{first.sweep.name.capitalize()}{', the largest fall' if len(found) > 1 and first.fall else ''}: {change(first)}"
    falls = [f for f in found[1:] if f.fall]
    if falls:
        text += f" Then {listed(f'{f.sweep.name} (−{f.fall:.2f})' for f in falls[:4])}."
    still = [f.sweep.name for f in found if not f.fall]
    if first.fall and still:
        text += f" No significant fall is seen in {listed(still)}."
    broken = [f for f in found if f.broken]
    if not broken:
        return text + f" No setting is broken (mean MOTA below {BROKEN:g})."
    return text + f" Broken (mean MOTA below {BROKEN:g}): {'; '.join(', '.join(at(s) for s in f.broken) for f in broken)}."


def limits(first: Finding) -> str:
    """Scores at the worst setting compared with their bounds."""
    rows = first.worst.of(first.tracker)
    sentences = []
    seen = [row.limits["visible_recall"] for row in rows if "visible_recall" in row.limits]
    if seen:
        # Scenarios of rooms have no robots, and the cameras of a recording are not those of its scenario.
        who = "cameras" if first.sweep.name in RECORDING_SWEEPS or not any(row.scenario.get("robots", True) for row in rows) else "robots"
        sentences.append(f"At {at(first.worst)}, {who} see {100 * np.mean(seen):.0f} % of the true positions; no tracker can find more.")
        every = [row.scores["mota_all"] for row in rows if "mota_all" in row.scores]
        if every:
            sentences.append(f"Over all people, seen or not, MOTA is {mean_interval(every, bounds=bounds_of('mota_all')).text()}.")
    ratio = [row.scores["efficiency"] for row in rows if "efficiency" in row.scores]
    if ratio:
        sentences.append(f"The ATE of the robots is {mean_interval(ratio, bounds=bounds_of('efficiency')).text(1)} times the Cramér-Rao bound.")
    charted = [row.scores for row in rows if row.scores.get("map_aligned_m")]
    if charted:
        error = mean_interval([scores["map_aligned_m"] for scores in charted], bounds=bounds_of("map_aligned_m")).text()
        # Unknown where no landmark was seen often.
        share = [scores["map_complete"] for scores in charted if "map_complete" in scores]
        mapped = f"; {100 * np.mean(share):.0f} % of those seen often are mapped" if share else ""
        sentences.append(f"The error of landmarks is {error} m{mapped}.")
        sentences.append(f"Ghosts are {100 * np.mean([scores['map_ghosts'] for scores in charted]):.0f} % of the map.")
    places = [(row.scores["motp_m"], row.limits["target_bound_m"]) for row in rows if "motp_m" in row.scores and "target_bound_m" in row.limits]
    if places:
        errors, least = zip(*places, strict=True)
        error = mean_interval(errors, bounds=bounds_of("motp_m")).text()
        sentences.append(f"The mean error of people's positions is {error} m; the Cramér-Rao bound is {np.mean(least):.2f} m.")
    gaps = [row.limits["clique_gap"] for row in rows if "clique_gap" in row.limits]
    if gaps and not any(gaps):
        sentences.append("The search for the best set of tracks found the exact optimum.")
    elif gaps:
        sentences.append(f"The search for the best set of tracks stayed {100 * np.mean(gaps):.2g} % below the optimum.")
    return " ".join(sentences)


def trackers(rows: Rows) -> str:
    """The mean MOTA of every tracker over all settings."""
    means = []
    for tracker in rows.trackers:
        values = [row.scores["mota"] for row in rows.rows if row.tracker == tracker and "mota" in row.scores]
        means.append(f"{tracker} {np.mean(values):.2f} over {plural(len(values), 'run')}" if values else f"{tracker} without a score")
    paired = "" if rows.several else f"; `pilsim compare {rows.folder.name}` shows paired differences"
    return f"Mean MOTA: {listed(means)}. The text above is about {rows.trackers[0]}{paired}."


def certainty(rows: Rows) -> str:
    """How far the intervals can be trusted, and what is missing from the means."""
    seeds = len({row.seed for row in rows.rows})
    text = (
        f"{plural(seeds, 'seed')} a setting" if seeds > 1 else "One seed a setting: there are no intervals, and any difference may be due to chance"
    )
    if 1 < seeds < CAREFUL:
        text += f": fewer than {CAREFUL}, so intervals are wide and small differences do not show"
    text += "."
    if rows.failed:
        text += f" {plural(len(rows.failed), 'run')} of {len(rows.rows)} failed and {'is' if len(rows.failed) == 1 else 'are'} left out of all means"
        text += f" ({chief_error(rows)})."
        text += " Where runs fail at hard settings, the curves overstate the tracker."
    if rows.torn:
        text += " The last row was cut off and is left out; the same command continues from there."
    if len({str(sorted(row.versions.items())) for row in rows.rows}) > 1:
        text += " The runs were made with different versions, which the end of the page lists."
    return text


def chief_error(rows: Rows) -> str:
    """The most frequent error of the failed runs, with its count."""
    errors: Counter[str] = Counter(str(row.error) for row in rows.failed)
    if not errors:
        return "no error was recorded"
    (text, count), *_ = errors.most_common(1)
    return f"{count} × {text[:160]}"


def moments(rows: Rows, count: int = 10) -> list[tuple[Row, dict[str, object]]]:
    """The worst moments of all runs by weight: at most three of one kind and cause, and at most two of one run."""
    every = [(row, moment) for row in rows.rows for moment in row.moments]
    every.sort(key=lambda pair: -_weight(pair[1]))
    kinds: Counter[tuple[str, str]] = Counter()
    runs: Counter[str] = Counter()
    chosen: list[tuple[Row, dict[str, object]]] = []
    for row, moment in every:
        kind = (str(moment.get("kind")), str(moment.get("cause")))
        if len(chosen) < count and kinds[kind] < 3 and runs[row.where] < 2:
            chosen.append((row, moment))
            kinds[kind] += 1
            runs[row.where] += 1
    return chosen


def _weight(moment: dict[str, object]) -> float:
    weight = moment.get("weight")
    return float(weight) if isinstance(weight, (int, float)) else 0.0
