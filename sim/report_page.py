"""The page itself: HTML that is well-formed XML too, one file, no scripts, nothing from a network."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from sim.intervals import mean_interval
from sim.report_glossary import CAUSES, GLOSSARY
from sim.report_pictures import Album, Entry
from sim.report_plots import Plot, shortened
from sim.report_rows import STAGES, Row, Rows, Setting, Sweep
from sim.report_series import name_of
from sim.report_style import STYLE
from sim.report_summary import headline, summary
from sim.report_words import (
    REAL,
    at,
    at_row,
    breaking,
    causes_of,
    change,
    finding,
    findings,
    owner,
    plural,
    predicted,
    reasons,
    robots,
    spread,
    stages,
)
from sim.stress import SWEEPS

MOST_FAILED = 30
"""Failed runs that are listed one by one."""
KINDS_SAID = {"miss": "a person missed", "false positive": "somebody who is not there", "switch": "a swapped identity"}
"""Kinds of a moment for a person to read."""
MOMENTS_SAID = (
    "The longest mistakes, each at its middle frame: the plan seen from above, ten metres wide. Rings are people as they truly are, with the way they"
    " came; coloured dots are what the tracker tells of them; the red ring is the mistake. Arrows are robots, grey where they are, red where they"
    " believe to be. Lines come from robots that have the person in sight, blue with a box about the person, grey without."
)
COLUMNS = (
    ("mota", "MOTA", 3), ("idf1", "IDF1", 3), ("hota", "HOTA", 3), ("misses", "misses", 0), ("false_positives", "false", 0),
    ("switches", "switches", 0), ("ate_m", "ATE [m]", 3),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Page:
    """All that stands on it: rows, plots by name with their SVG, pictures."""

    rows: Rows
    plots: dict[str, tuple[Plot, str]]
    album: Album

    def figures(self, prefix: str) -> str:
        """The plots whose names begin so, side by side where there is room."""
        own = [(name, plot, svg) for name, (plot, svg) in self.plots.items() if name.startswith(prefix)]
        return tag("div", "".join(_figure(*one) for one in own), class_="plots") if own else ""


def tag(name: str, inner: str, **attributes: str) -> str:
    """An element; `inner` is HTML already, attributes are escaped (class_ for class)."""
    written = "".join(f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items())
    return f"<{name}{written}>{inner}</{name}>"


def text(name: str, words: str, **attributes: str) -> str:
    return tag(name, escape(words), **attributes)


def page(content: Page) -> str:
    """The whole document."""
    rows = content.rows
    parts = [("moments", "Worst moments", _moments(content.album))] if content.album.entries else []
    parts = [
        *((f"sweep-{name_of(s.name)}", _title(s), _sweep(content, s)) for s in rows.sweeps()),
        *parts,
        *([("failed", "Runs that failed", _failed(rows.failed))] if rows.failed else []),
        ("figures", "All figures", "".join(_table(s, t) for s in rows.sweeps() for t in rows.trackers)),
        ("words", "What the words mean", _glossary(rows)),
        ("again", "To do it again", _again(rows)),
    ]
    links = "".join(tag("li", text("a", title, href=f"#{anchor}")) for anchor, title, _ in parts)
    sections = "".join(tag("section", text("h2", title, id=anchor) + body, aria_labelledby=anchor) for anchor, title, body in parts)
    title = f"Stress test: {rows.folder.resolve().name}"
    header = tag("header", text("p", "pilsim stress test", class_="kicker") + text("h1", "Where the tracker breaks, and why"))
    header = header.replace("</header>", text("p", headline(rows), class_="lead") + "</header>")
    short = tag("section", text("h2", "In short", id="short") + _summary(content), aria_labelledby="short", class_="short")
    contents = tag("nav", text("h2", "On this page", id="contents") + tag("ul", links), aria_labelledby="contents")
    body = text("a", "Skip to the summary", href="#short", class_="skip") + header + tag("main", short + contents + sections)
    body += tag("footer", text("p", f"Made by pilsim report from {plural(len(rows.rows), 'run')}. Plots lie beside this page as PNG and CSV."))
    head = (
        '<meta charset="utf-8"/><meta name="viewport" content="width=device-width, initial-scale=1"/>'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\"/>"
        f"{text('title', title)}<style>{STYLE}</style>"
    )
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def _title(sweep: Sweep) -> str:
    name = "Real" if sweep.name == REAL else sweep.name.replace("_", " ").capitalize()
    words = spread(sweep)
    return f"{name}: {words}" if len(words) < 70 else name


def _summary(content: Page) -> str:
    said = "".join(tag("div", text("dt", heading) + text("dd", words)) for heading, words in summary(content.rows))
    worst = findings(content.rows, content.rows.trackers[0])[:1]
    figures = "".join(content.figures(f"first-{name_of(f.sweep.name)}") for f in worst) + content.figures("overview")
    return tag("div", tag("dl", said) + tag("div", figures), class_="beside")


def _figure(name: str, plot: Plot, svg: str) -> str:
    # The words for those who do not see the picture; the picture's own letters are then not read out one by one.
    labelled = svg.replace("<svg", f'<svg role="img" aria-label="{escape(plot.in_words())}"', 1)
    return tag("figure", labelled + text("figcaption", f"{plot.note} File: {name}."), id=f"plot-{name}")


def _sweep(content: Page, sweep: Sweep) -> str:
    said = [f"What is tried: {SWEEPS[sweep.name].about}."] if sweep.name in SWEEPS else []
    for tracker in content.rows.trackers:
        found = finding(sweep, tracker)
        if found is None:
            said.append(f"No run of {tracker} has a score.")
            continue
        worst = found.worst.of(tracker)
        name = f"{tracker}: MOTA" if len(content.rows.trackers) > 1 else "MOTA"
        if sweep.name == REAL:
            said += [part for part in (predicted(sweep, tracker),) if part]
            continue
        where = at(found.worst)
        said += [part for part in (f"{change(found, name)} {breaking(found)}", reasons(worst, where), owner(worst, where), robots(found)) if part]
    return tag("ul", "".join(text("li", words) for words in said)) + content.figures(name_of(sweep.name) + "-")


def _moments(album: Album) -> str:
    return text("p", MOMENTS_SAID) + tag("ol", "".join(tag("li", _moment(k, entry)) for k, entry in enumerate(album.entries, 1)), class_="moments")


def _moment(k: int, entry: Entry) -> str:
    row, moment = entry.row, entry.moment
    said = str(moment.get("kind"))
    heading = f"{KINDS_SAID.get(said, said)}: {moment.get('cause', 'cause unknown')}"
    where = f"{at_row(row)}, seed {row.seed}, frame {moment.get('frame')}, tracker {row.tracker}"
    if moment.get("person") is not None:
        where += f"; person {moment['person']}"
    if isinstance(place := moment.get("position"), Sequence) and not isinstance(place, str):
        where += f" at ({', '.join(f'{round(float(v), 1) + 0.0:.1f}' for v in place)}) m"
    meaning = CAUSES.get(str(moment.get("cause")), "")
    said = f"{_capital(meaning)} {_capital(where)} ({row.id}).".strip()
    out = text("h3", _capital(heading)) + text("p", said)
    for number, picture in enumerate(entry.pictures, 1):
        alt = f"Moment {k}, picture {number} of {len(entry.pictures)}: {heading}; {where}"
        out += f'<img src="{picture.uri}" alt="{escape(alt)}" width="{picture.width}" height="{picture.height}"/>'
    return out + "".join(text("p", f"The picture {name} is missing.", class_="note") for name in entry.missing)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def table(caption: str, head: Iterable[str], body: Iterable[Sequence[str]]) -> str:
    """A table whose first cell of each row names it. Narrow screens show it as a list of cards, so cells carry their heads."""
    names = list(head)
    cells = "".join(text("th", name, scope="col", role="columnheader") for name in names)
    lines = ""
    for first, *rest in body:
        line = text("th", first, scope="row", role="rowheader")
        line += "".join(text("td", value, data_label=name, role="cell") for name, value in zip(names[1:], rest, strict=True))
        lines += tag("tr", line, role="row")
    inner = text("caption", caption) + tag("thead", tag("tr", cells, role="row"), role="rowgroup") + tag("tbody", lines, role="rowgroup")
    return tag("table", inner, role="table")


def _table(sweep: Sweep, tracker: str) -> str:
    settings = [s for s in sweep.ordered() if any(row.tracker == tracker for row in s.rows)]
    if not settings:
        return ""
    head = [sweep.parameter, "runs", *(label for _, label, _ in COLUMNS)]
    out = text("h3", f"{sweep.name}, tracker {tracker}")
    out += table(f"Means over seeds, with 95 % intervals: {sweep.name}, {tracker}", head, [_figures_of(s, tracker) for s in settings])
    shares = {s.id: stages(s.of(tracker)) for s in settings}
    if any(shares.values()):
        names = (*STAGES, "total")
        body = [[shortened(s.value), *(shares[s.id][name].text(3) if name in shares[s.id] else "–" for name in names)] for s in settings]
        out += table(f"MOTA that perfect input would win back: {sweep.name}, {tracker}", [sweep.parameter, *names], body)
    return out


def _figures_of(setting: Setting, tracker: str) -> list[str]:
    failed = sum(row.tracker == tracker and row.error is not None for row in setting.rows)
    cells = [shortened(setting.value), str(len(setting.of(tracker))) + (f" (+ {failed} failed)" if failed else "")]
    for name, _, digits in COLUMNS:
        values = list(setting.scores(tracker, name).values())
        interval = mean_interval(values) if values else None
        cells.append("–" if interval is None else interval.text(digits) if digits else f"{interval.mean:.1f}")
    return cells


def _failed(failed: Sequence[Row]) -> str:
    body = [(row.id, shortened(row.value), str(row.seed), row.tracker, str(row.error)) for row in failed[:MOST_FAILED]]
    out = table("Runs without scores, and what ended them", ("setting", "value", "seed", "tracker", "error"), body)
    rest = len(failed) - MOST_FAILED
    return out + (text("p", f"{rest} more are in results.jsonl.") if rest > 0 else "")


def _glossary(rows: Rows) -> str:
    told = {cause for counts in causes_of(rows.rows).values() for cause in counts}
    causes = [(cause, meaning) for cause, meaning in CAUSES.items() if cause in told]
    out = _meanings(GLOSSARY)
    return out + (text("h3", "Causes of errors") + _meanings(causes) if causes else "")


def _meanings(words: Iterable[tuple[str, str]]) -> str:
    return tag("dl", "".join(tag("div", text("dt", word) + text("dd", meaning)) for word, meaning in words), class_="two")


def _again(rows: Rows) -> str:
    commands = [*dict.fromkeys(row.command for row in rows.rows), f"pilsim report {rows.folder}"]
    out = text("p", "The same command in another folder makes the same rows again; in the same folder it goes on from what is there.")
    out += tag("pre", text("code", "\n".join(commands)), tabindex="0")
    versions: dict[str, dict[str, None]] = {}
    for row in rows.rows:
        for name, version in row.versions.items():
            versions.setdefault(name, {})[version if isinstance(version, str) else json.dumps(version)] = None
    out += table("Versions", ("part", "version"), [(name, " and ".join(seen)) for name, seen in versions.items()]) if versions else ""
    options = {row.tracker: row.options for row in rows.rows if row.options}
    return out + (table("Trackers", ("name", "options"), [(n, _options(o)) for n, o in options.items()]) if options else "")


def _options(options: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in options.items())
