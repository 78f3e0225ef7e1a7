"""The summary of a stress test: a few sentences, each under a heading."""

from __future__ import annotations

from collections import Counter

import numpy as np

from sim.confidence_intervals import bounds_of, mean_interval
from sim.report.findings import BROKEN, CAREFUL, REAL, Finding, at, change, chief, findings, listed, owner, plural, reasons, robots, spread
from sim.report.rows import Row, Rows

SCORE = (
    "MOTA is 1 less the sum of misses, false positives and identity switches, divided by the number of true positions."
    f" A setting is called broken where the mean MOTA is below {BROKEN:g}."
)


def headline(rows: Rows) -> str:
    """The most important finding, in one or two sentences."""
    found = findings(rows, rows.trackers[0])
    if not found:
        return "No run has a score, so there is no finding. See the runs that failed."
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
    simulated = [row for row in whole if row.sweep != REAL]
    worlds = sorted({str(row.scenario["world"]) for row in simulated if "world" in row.scenario})
    frames = sorted({row.frames for row in simulated if row.frames})
    ours = [sweep for sweep in sweeps if sweep.name != REAL]
    names = listed(spread(sweep) for sweep in ours[:4]) + (f" and {len(ours) - 4} more" if len(ours) > 4 else "")
    text = f"Tracking of people by {cameras_of(simulated)}, in simulation with known truth"
    text += f"{' (world' + 's' * (len(worlds) > 1) + ' ' + listed(worlds) + ')' if worlds else ''}; tracker: {listed(rows.trackers)}. "
    if ours:
        text += f"One parameter is varied: {names}. " if len(ours) == 1 else f"{len(ours)} sweeps, each of one parameter: {names}. "
    text += "".join(f"Also {spread(sweep)}. " for sweep in sweeps if sweep.name == REAL)
    text += f"{plural(len(whole), 'run')} of {plural(settings, 'setting')} and {plural(seeds, 'seed')}"
    text += f", {' or '.join(map(str, frames))} frames each" if frames else ""
    if frames and len(simulated) < len(whole):
        text += ", the real sequence and its twin at their own length"
    rendered = {row.rendered for row in whole}
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
        sentences.append(f"At {at(first.worst)}, robots see {100 * np.mean(seen):.0f} % of the true positions; no tracker can find more.")
        every = [row.scores["mota_all"] for row in rows if "mota_all" in row.scores]
        if every:
            sentences.append(f"Over all people, seen or not, MOTA is {mean_interval(every, bounds=bounds_of('mota_all')).text()}.")
    ratio = [row.scores["efficiency"] for row in rows if "efficiency" in row.scores]
    if ratio:
        sentences.append(f"The ATE of the robots is {mean_interval(ratio, bounds=bounds_of('efficiency')).text(1)} times the Cramér-Rao bound.")
    charted = [(row.scores["map_aligned_m"], row.scores["map_complete"], row.scores["map_ghosts"]) for row in rows if row.scores.get("map_aligned_m")]
    if charted:
        errors, share, ghosts = zip(*charted, strict=True)
        error = mean_interval(errors, bounds=bounds_of("map_aligned_m")).text()
        sentences.append(f"The error of landmarks is {error} m; {100 * np.mean(share):.0f} % of those seen often are mapped.")
        sentences.append(f"Ghosts are {100 * np.mean(ghosts):.0f} % of the map.")
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
