"""A stress test in short: a handful of sentences, each under a word that says what question it answers."""

from __future__ import annotations

from collections import Counter

from sim.intervals import mean_interval
from sim.report_glossary import BROKEN
from sim.report_rows import Row, Rows
from sim.report_words import CAREFUL, REAL, Finding, at, change, chief, findings, listed, owner, plural, reasons, robots, spread

SCORE = (
    "MOTA is 1 where everybody is followed all the time. Each person missed, each one who is not there and each swapped identity is taken off it,"
    f" over how often somebody was there to be followed; below {BROKEN:g} a setting is called broken here."
)


def headline(rows: Rows) -> str:
    """The one sentence to read if only one is read."""
    found = findings(rows, rows.trackers[0])
    if not found:
        return "No run has a score: nothing can be said of the tracker, see what failed."
    first = found[0]
    if first.difference and first.difference.verdict == "one seed":
        ends = f"{first.high.mean:.2f} at {at(first.best)} and {first.low.mean:.2f} at {at(first.worst)}"
        return f"The tracking score MOTA (1 is perfect) is {ends}; one seed alone cannot say whether that is chance."
    if not first.fall:
        return f"In {plural(len(found), 'sweep')} no setting is worse than another for sure."
    said = f"{first.sweep.name.capitalize()} hurts most: the tracking score MOTA (1 is perfect) falls from {first.high.mean:.2f} at {at(first.best)}"
    said += f" to {first.low.mean:.2f} at {at(first.worst)}"
    most = chief(first.worst.of(first.tracker))
    return said + (f". The commonest error there: {most[0]}, {most[1]}." if most else ".")


def summary(rows: Rows) -> list[tuple[str, str]]:
    """Pairs of a heading and what is said under it, for the first tracker; others are told of where there are some."""
    tracker = rows.trackers[0]
    found = findings(rows, tracker)
    said = [("What was tested", tested(rows)), ("The score", SCORE)]
    if not found:
        return [*said, ("What broke", f"Every run failed, or none has a score: {chief_error(rows)}.")]
    worst, where = found[0].worst.of(tracker), at(found[0].worst)
    said += [("What broke first", broke(found)), ("Why", f"{reasons(worst, where)} {owner(worst, where)}".strip())]
    said += [("Robots", robots(found[0])), ("How far from the limits", limits(found[0]))]
    if len(rows.trackers) > 1:
        said.append(("Trackers", trackers(rows)))
    return [(heading, text) for heading, text in [*said, ("How sure", certainty(rows))] if text]


def tested(rows: Rows) -> str:
    sweeps, whole = rows.sweeps(), rows.rows
    settings, seeds = sum(len(sweep.settings) for sweep in sweeps), len({row.seed for row in whole})
    simulated = [row for row in whole if row.sweep != REAL]
    worlds = sorted({str(row.scenario["world"]) for row in simulated if "world" in row.scenario})
    frames = sorted({row.frames for row in simulated if row.frames})
    ours = [sweep for sweep in sweeps if sweep.name != REAL]
    names = listed(spread(sweep) for sweep in ours[:4]) + (f" and {len(ours) - 4} more" if len(ours) > 4 else "")
    said = "A tracker that follows people with the panoramic cameras of moving robots, in simulation, where the truth is known"
    said += f"{' (world' + 's' * (len(worlds) > 1) + ' ' + listed(worlds) + ')' if worlds else ''}; tracker: {listed(rows.trackers)}. "
    if ours:
        said += f"One thing is changed: {names}. " if len(ours) == 1 else f"{len(ours)} sweeps, each changing one thing: {names}. "
    said += "".join(f"Also {spread(sweep)}. " for sweep in sweeps if sweep.name == REAL)
    said += f"{plural(len(whole), 'run')} of {plural(settings, 'setting')} and {plural(seeds, 'seed')}"
    said += f", {' or '.join(map(str, frames))} frames each" if frames else ""
    if frames and len(simulated) < len(whole):
        said += ", the real sequence and its twin at their own length"
    rendered = {row.rendered for row in whole}
    drawn = {True: "images were rendered", False: "what cameras see was computed without rendering"}
    return f"{said}; {drawn[rendered.pop()] if len(rendered) == 1 else 'some were rendered, some not'}."


def broke(found: list[Finding]) -> str:
    """The sweep that costs most, and those in which the tracker breaks."""
    first = found[0]
    said = f"{first.sweep.name.capitalize()}{', the largest fall' if len(found) > 1 and first.fall else ''}: {change(first)}"
    falls = [f for f in found[1:] if f.fall]
    if falls:
        said += f" Then {listed(f'{f.sweep.name} (−{f.fall:.2f})' for f in falls[:4])}."
    still = [f.sweep.name for f in found if not f.fall]
    if first.fall and still:
        said += f" No fall is seen for sure in {listed(still)}."
    broken = [f for f in found if f.broken]
    if not broken:
        return said + f" No setting is broken (mean MOTA below {BROKEN:g})."
    return said + f" Broken (mean MOTA below {BROKEN:g}): {'; '.join(', '.join(at(s) for s in f.broken) for f in broken)}."


def limits(first: Finding) -> str:
    """Beside what is possible, at the worst setting."""
    rows = first.worst.of(first.tracker)
    said = []
    seen = [row.limits["visible_recall"] for row in rows if "visible_recall" in row.limits]
    if seen:
        said.append(f"At {at(first.worst)} robots see {100 * mean_interval(seen).mean:.0f} % of where people are: nobody can find more.")
        every = [row.scores["mota_all"] for row in rows if "mota_all" in row.scores]
        if every:
            said.append(f"Over everybody, seen or not, MOTA is {mean_interval(every).text()}.")
    ratio = [row.scores["efficiency"] for row in rows if "efficiency" in row.scores]
    if ratio:
        said.append(f"The robots' error is {mean_interval(ratio).text(1)} times the Cramér-Rao bound.")
    charted = [(row.scores["map_aligned_m"], row.scores["map_complete"], row.scores["map_ghosts"]) for row in rows if row.scores.get("map_aligned_m")]
    if charted:
        off, share, ghosts = (mean_interval(list(values)) for values in zip(*charted, strict=True))
        said.append(f"Landmarks are {off.text()} m off; {100 * share.mean:.0f} % of those to be had are there, ghosts are {100 * ghosts.mean:.0f} %.")
    places = [(row.scores["motp_m"], row.limits["target_bound_m"]) for row in rows if "motp_m" in row.scores and "target_bound_m" in row.limits]
    if places:
        off, bound = (mean_interval(list(values)) for values in zip(*places, strict=True))
        said.append(f"People are told {off.text()} m off, and nobody could do better than {bound.mean:.2f} m.")
    gaps = [row.limits["clique_gap"] for row in rows if "clique_gap" in row.limits]
    if gaps and not any(gaps):
        said.append("The search for the best set of tracks found the exact optimum.")
    elif gaps:
        said.append(f"The search for the best set of tracks stayed {100 * mean_interval(gaps).mean:.2g} % below the optimum.")
    return " ".join(said)


def trackers(rows: Rows) -> str:
    """MOTA of every tracker over all settings, and where the differences stand."""
    means = []
    for tracker in rows.trackers:
        values = [row.scores["mota"] for row in rows.rows if row.tracker == tracker and "mota" in row.scores]
        means.append(f"{tracker} {mean_interval(values).mean:.2f} over {plural(len(values), 'run')}" if values else f"{tracker} without a score")
    return f"Mean MOTA: {listed(means)}. What is said above is of {rows.trackers[0]}; `pilsim compare {rows.folder.name}` has the paired differences."


def certainty(rows: Rows) -> str:
    seeds = len({row.seed for row in rows.rows})
    said = f"{plural(seeds, 'seed')} a setting" if seeds > 1 else "One seed a setting: there are no intervals, and any difference may be chance"
    if 1 < seeds < CAREFUL:
        said += f": fewer than {CAREFUL}, so intervals are wide and small differences cannot be seen"
    said += "."
    if rows.failed:
        said += f" {plural(len(rows.failed), 'run')} of {len(rows.rows)} failed and {'is' if len(rows.failed) == 1 else 'are'} in no mean"
        said += f" ({chief_error(rows)})."
        said += " Where hard settings fail, the curves look better than the tracker is."
    if rows.torn:
        said += " The last row was cut off and is left out; the same command goes on from there."
    if len({str(sorted(row.versions.items())) for row in rows.rows}) > 1:
        said += " The runs were made with different versions: see the end."
    return said


def chief_error(rows: Rows) -> str:
    errors: Counter[str] = Counter(str(row.error) for row in rows.failed)
    if not errors:
        return "no error was written down"
    (text, count), *_ = errors.most_common(1)
    return f"{count} × {text[:160]}"


def moments(rows: Rows, count: int = 10) -> list[tuple[Row, dict[str, object]]]:
    """The worst moments of all runs, by weight, no more than three of one kind and cause, and no more than two of one run."""
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
