"""The page of a prediction: scores and errors by cause of twins beside those of the real boxes, from the file of `pilsim predict`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from sim.confidence_intervals import Interval
from sim.prediction import ERRORS, KINDS, REAL, SCORES, Cells, Prediction, PredictionRecord, interval_text, number_text, read_prediction
from sim.report.findings import CAUSES, GLOSSARY, listed, plural
from sim.report.page import PageFigure, PageSweep, PageTable, draw_figures, render
from sim.report.plots import Bars, Line, Plot
from tracker.io.atomic import write_text

WORDS = ("MOTA", "IDF1", "MOTP", "Switch")
"""Entries of the glossary of stress tests that the page uses."""
GLOSSARY_OF_PREDICTIONS = (
    ("HOTA", "the geometric mean of detection and association accuracy over distances, from 0 to 1."),
    ("Twin", "the true people before the real cameras, with boxes that a detector model makes in place of the real ones."),
    ("Fitted", "a model of the detector's errors in each view, fitted to the frames of the fit."),
    ("Independent", "the detector whose errors are independent of each other from frame to frame, with its default rates."),
    (
        "0.61 (0.55 to 0.67)",
        "the mean over the twins, and where one more run would lie with 95 %, by Student's t. It does not hold the uncertainty of the fit.",
    ),
)
ABOUT_COMMANDS = "The same command makes the same file, on any number of processes."


def write_prediction_page(path: Path, out: Path | None = None) -> Path:
    """Write the page of a prediction to `out` (default: its name with .html), and each plot as PNG and CSV into `plots_folder`.

    Returns the path of the page. Raises ValueError as `read_prediction`, and where the page would replace the file.
    """
    record = read_prediction(path)
    target = out or path.with_suffix(".html")
    if target.is_dir():
        raise ValueError(f"{target}: is a folder, needs a file name")
    if target.resolve() == path.resolve():
        raise ValueError(f"{target}: is the file of the prediction, needs another name")
    target.parent.mkdir(parents=True, exist_ok=True)
    write_text(target, render(_names(path, record, draw_figures(plots(record.found), plots_folder(path)))))
    return target


def plots_folder(path: Path) -> Path:
    """The folder of the plots of a prediction's file: NAME-report beside NAME.json."""
    return path.with_name(f"{path.stem}-report")


def plots(found: Prediction) -> list[Plot]:
    """Scores by detector with intervals beside the real one, then errors by cause."""
    out, x = list[Plot](), found.head("")[1:]
    for key, label, _ in SCORES:
        points = [one if one and math.isfinite(one.mean) else None for one in (of.figures.get(key) for of in found.forecasts.values())]
        lines = [Line("predicted", (*points, None) if found.real else tuple(points))]
        if found.real and math.isfinite(value := found.real.figures.get(key, math.nan)):
            lines.append(Line(REAL, (Interval(value, None, None, 1),) * len(x), limit=True))
        note = "Bars: where one more run would lie with 95 %." + (" Dashed: the real boxes." if found.real else "")
        out.append(Plot(key, label, x, "detector", f"{label} (1 is perfect)", tuple(lines), numeric=False, note=note))
    for kind in KINDS:
        if parts := {cause: tuple(numbers) for cause, numbers in found.counts(kind).items()}:
            title = f"{kind[:1].upper()}{kind[1:]} by cause"
            out.append(Plot(kind.replace(" ", "-"), title, x, "detector", kind, Bars(parts), numeric=False, note="Means over the twins."))
    return out


def _names(path: Path, record: PredictionRecord, figures: dict[str, PageFigure]) -> dict[str, Any]:
    """Name → value of each variable of the template."""
    found = record.found
    kinds = [kind for kind in KINDS if kind.replace(" ", "-") in figures]
    sections = {f"errors-{kind.replace(' ', '-')}": f"{kind[:1].upper()}{kind[1:]}" for kind in kinds}
    occurring = {cause for kind in KINDS for cause in found.counts(kind)}
    return {
        "title": f"Prediction: {Path(record.source).name}",
        "kicker": "pilsim prediction",
        "heading": "What the tracker would score on these cameras",
        "headline": headline(found),
        "headings": sections,
        "summary": summary(record),
        "overview_figures": [figures[key] for key, _, _ in SCORES if key in figures],
        "sweeps": [PageSweep(f"errors-{kind.replace(' ', '-')}", sentences(found, kind), [figures[kind.replace(" ", "-")]]) for kind in kinds],
        "tables": tables(record),
        "glossary": [*(pair for pair in GLOSSARY if pair[0] in WORDS), *GLOSSARY_OF_PREDICTIONS],
        "causes": [(cause, meaning) for cause, meaning in CAUSES.items() if cause in occurring],
        "about_commands": ABOUT_COMMANDS,
        "commands": f"{record.command} --out {path.name}\npilsim report {path.name}",
        "provenance": _provenance(record),
        "plots_beside": True,
        "made_by": "pilsim report",
        "made_from": f"{plural(len(record.seeds), 'twin')} a detector",
    }


def headline(found: Prediction) -> str:
    """Predicted and real MOTA and IDF1 of the first detector, in one or two sentences."""
    name, *_ = found.forecasts
    text = f"Predicted by {name}: " + " and ".join(f"{label} {_text(found, name, key, digits)}" for key, label, digits in SCORES[:2]) + "."
    if found.real is None:
        return f"{text} There are no real boxes to compare with."
    real = " and ".join(f"{label} {number_text(found.real.figures.get(key, math.nan), digits)}" for key, label, digits in SCORES[:2])
    return f"{text} The real boxes have {real}."


def summary(record: PredictionRecord) -> list[tuple[str, str]]:
    """Pairs of a heading and its text."""
    found = record.found
    first, end = found.frames
    seen = f"{plural(found.people, 'person') if found.people == 1 else f'{found.people} people'} in frames {first} to {end - 1}"
    text = f"{record.source}: {seen} of {listed(found.cameras)}, tracker {record.tracker}."
    simulated = " --world " in record.command
    text += " People walk simulated paths, others with each seed." if simulated else " People walk their true paths before the real cameras."
    if found.fit_frames is not None:
        text += f" Models are fitted to frames {found.fit_frames[0]} to {found.fit_frames[1] - 1}."
    out = [("What was predicted", text)]
    if found.real:
        out += [(f"{name[:1].upper()}{name[1:]}, predicted less real", _verdicts(found, name)) for name in found.forecasts]
        if largest := _largest(found):
            out.append(("Largest difference of a cause", largest))
    seeds = len(record.seeds)
    several = f"{seeds} twins a detector: an interval is where one more run would lie with 95 %."
    certain = several if seeds > 1 else "One twin a detector has no interval."
    certain += " Intervals do not hold the uncertainty of the fit. The real boxes are one run of one part of a recording."
    return [*out, ("Certainty", certain)]


def _verdicts(found: Prediction, name: str) -> str:
    """A sentence: the differences of scores, predicted less real, and which real ones are within the intervals."""
    assert found.real is not None
    differences, within, beyond = list[str](), list[str](), list[str]()
    for key, label, digits in SCORES:
        predicted, real = found.forecasts[name].figures.get(key), found.real.figures.get(key, math.nan)
        if predicted is None or not math.isfinite(predicted.mean - real):
            continue
        differences.append(f"{label} {predicted.mean - real:+.{digits}f}".replace("-", "−"))
        if predicted.low is not None and predicted.high is not None:
            (within if predicted.low <= real <= predicted.high else beyond).append(label)
    text = f"{', '.join(differences) or 'Nothing is known'}."
    text += f" Within the interval of one run: {listed(within)}." if within else ""
    return text + (f" Beyond it: {listed(beyond)}." if beyond else "")


def _largest(found: Prediction) -> str:
    """A sentence on the cause of errors that the first detector predicts worst."""
    every = [(kind, cause, numbers[0], numbers[-1]) for kind in KINDS for cause, numbers in found.counts(kind).items()]
    kind, cause, predicted, real = max(every, key=lambda one: abs(one[2] - one[3]), default=("", "", 0.0, 0.0))
    if predicted == real:
        return ""
    name, *_ = found.forecasts
    return f"{kind[:1].upper()}{kind[1:]}, {cause}: {predicted:.1f} predicted by {name}, {real:.0f} real."


def sentences(found: Prediction, kind: str) -> list[str]:
    """Sentences on one kind of error: a detector each, with the cause that differs most from the real one."""
    key, out, every = kind.replace(" ", "_"), list[str](), found.counts(kind)
    if found.real:
        truths, real = (number_text(found.real.figures.get(name, math.nan), 0) for name in ("truths", key))
        out.append(f"Real: {real} {kind} at {truths} true positions.")
    for k, name in enumerate(found.forecasts):
        text = f"{name} predicts {_text(found, name, key, 1)}."
        if found.real and every:
            cause, counts = max(every.items(), key=lambda one: abs(one[1][k] - one[1][-1]))
            if counts[k] != counts[-1]:
                text += f" The largest difference is “{cause}”: {counts[k]:.1f} predicted, {counts[-1]:.0f} real."
        out.append(text)
    return out


def tables(record: PredictionRecord) -> list[tuple[str, list[PageTable]]]:
    """Headings with tables: scores, errors by cause, and the single runs of each detector."""
    found, caption = record.found, "Means over twins, with intervals of one run"
    out = [("Scores", [PageTable(caption, found.head("figure"), tuple(found.score_lines()))])]
    if causes := found.cause_lines():
        out.append(("Errors by cause", [PageTable(caption, found.head("cause"), tuple(causes))]))
    return [*out, ("Single twins", [_runs(record, name) for name in found.forecasts])]


def _runs(record: PredictionRecord, name: str) -> PageTable:
    shown, body = (*SCORES, *ERRORS), list[Cells]()
    for seed, run in zip(record.seeds, record.found.forecasts[name].runs, strict=False):
        body.append((str(seed), *(number_text(run.get(key, math.nan), 0 if digits == 1 else digits) for key, _, digits in shown)))
    return PageTable(f"Twins of {name}", ("seed", *(label for _, label, _ in shown)), tuple(body))


def _provenance(record: PredictionRecord) -> list[PageTable]:
    options = ", ".join(f"{key} = {value}" for key, value in record.options.items()) or "defaults"
    versions = [PageTable("Versions", ("part", "version"), tuple(record.versions.items()))] if record.versions else []
    return [*versions, PageTable("Tracker", ("name", "options"), ((record.tracker, options),))]


def _text(found: Prediction, name: str, key: str, digits: int) -> str:
    return interval_text(found.forecasts[name].figures.get(key), digits)
