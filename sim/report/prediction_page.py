"""The page of a prediction: scores and errors by cause of twins beside those of the real boxes, from the file of `pilsim predict`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim.confidence_intervals import Interval
from sim.prediction.predict import Predicted
from sim.prediction.record import KINDS, PredictionRecord, read_prediction
from sim.report.findings import CAUSES, GLOSSARY, listed, plural
from sim.report.page import PageFigure, PageSweep, PageTable, render
from sim.report.plots import Bars, Line, Plot, save
from tracker.io.atomic import write_text

SCORES = (("mota", "MOTA", 3), ("idf1", "IDF1", 3), ("hota", "HOTA", 3))
ERRORS = (("misses", "misses", 1), ("false_positives", "false positives", 1), ("switches", "switches", 1))
"""Name in the file, name on the page, and digits."""
OTHERS = (("motp_m", "MOTP [m]", 3), ("truths", "true positions", 1))
WORDS = ("MOTA", "IDF1", "MOTP", "Switch")
"""What the page takes of the glossary of stress tests."""
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
REAL = "real"


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
    folder = plots_folder(path)
    folder.mkdir(exist_ok=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    figures = {plot.name: PageFigure.of(plot.name, plot, save(plot, folder)) for plot in plots(record)}
    write_text(target, render(_names(record, figures)))
    return target


def plots_folder(path: Path) -> Path:
    """The folder of the plots of a prediction's file: NAME-report beside NAME.json."""
    return path.with_name(f"{path.stem}-report")


def plots(record: PredictionRecord) -> list[Plot]:
    """Scores by detector with intervals beside the real one, then errors by cause."""
    names, out = list(record.forecasts), list[Plot]()
    x = (*names, REAL) if record.real else tuple(names)
    for key, label, _ in SCORES:
        points = [_interval(record.forecasts[name].figures.get(key), len(record.seeds)) for name in names]
        lines = [Line("predicted", (*points, None) if record.real else tuple(points))]
        if record.real and math.isfinite(value := record.real.figures.get(key, math.nan)):
            lines.append(Line(REAL, (Interval(value, None, None, 1),) * len(x), limit=True))
        note = "Bars: where one more run would lie with 95 %." + (" Dashed: the real boxes." if record.real else "")
        out.append(Plot(key, label, x, "detector", f"{label} (1 is perfect)", tuple(lines), numeric=False, note=note))
    for kind in KINDS:
        parts = {cause: values for cause in _causes(record, kind) if any(values := tuple(_counts(record, kind, cause)))}
        if parts:
            title = f"{kind[:1].upper()}{kind[1:]} by cause"
            out.append(Plot(kind.replace(" ", "-"), title, x, "detector", kind, Bars(parts), numeric=False, note="Means over the twins."))
    return out


def _interval(value: Predicted | None, count: int) -> Interval | None:
    return None if value is None or not math.isfinite(value.mean) else Interval(value.mean, value.low, value.high, count)


def _causes(record: PredictionRecord, kind: str) -> list[str]:
    named = [cause for of in record.forecasts.values() for cause in of.causes[kind]]
    return list(dict.fromkeys([*named, *(record.real.causes[kind] if record.real else ())]))


def _counts(record: PredictionRecord, kind: str, cause: str) -> list[float]:
    """Numbers of errors of a cause: of each detector, then of the real boxes."""
    found = [_finite(of.causes[kind][cause].mean) if cause in of.causes[kind] else 0.0 for of in record.forecasts.values()]
    return found + ([_finite(record.real.causes[kind].get(cause, 0.0))] if record.real else [])


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _names(record: PredictionRecord, figures: dict[str, PageFigure]) -> dict[str, Any]:
    """The names that the template uses, and what they hold."""
    kinds = [kind for kind in KINDS if kind.replace(" ", "-") in figures]
    sections = {f"errors-{kind.replace(' ', '-')}": f"{kind[:1].upper()}{kind[1:]}" for kind in kinds}
    ends = {"figures": "All figures", "words": "Glossary", "again": "How to reproduce it"}
    occurring = {cause for kind in KINDS for cause in _causes(record, kind) if any(_counts(record, kind, cause))}
    return {
        "title": f"Prediction: {Path(record.source).name}",
        "kicker": "pilsim prediction",
        "heading": "What the tracker would score on these cameras",
        "headline": headline(record),
        "headings": {"short": "In short", "contents": "On this page", **sections, **ends},
        "summary": summary(record),
        "worst_figures": [],
        "overview_figures": [figures[key] for key, _, _ in SCORES if key in figures],
        "sweeps": [PageSweep(f"errors-{kind.replace(' ', '-')}", sentences(record, kind), [figures[kind.replace(" ", "-")]]) for kind in kinds],
        "moments": [],
        "failed": None,
        "tables": tables(record),
        "glossary": [*(pair for pair in GLOSSARY if pair[0] in WORDS), *GLOSSARY_OF_PREDICTIONS],
        "causes": [(cause, meaning) for cause, meaning in CAUSES.items() if cause in occurring],
        "about_commands": ABOUT_COMMANDS,
        "commands": f"{record.command} --out {record.path.name}\npilsim report {record.path.name}",
        "provenance": _provenance(record),
        "made_from": f"{plural(len(record.seeds), 'twin')} a detector",
    }


def headline(record: PredictionRecord) -> str:
    """Predicted and real MOTA and IDF1 of the first detector, in one or two sentences."""
    name, *_ = record.forecasts
    text = f"Predicted by {name}: " + " and ".join(f"{label} {_text(record, name, key, digits)}" for key, label, digits in SCORES[:2]) + "."
    if record.real is None:
        return f"{text} There are no real boxes to compare with."
    real = " and ".join(f"{label} {_number(record.real.figures.get(key, math.nan), digits)}" for key, label, digits in SCORES[:2])
    return f"{text} The real boxes have {real}."


def summary(record: PredictionRecord) -> list[tuple[str, str]]:
    """Pairs of a heading and its text."""
    first, end = record.frames
    seen = f"{plural(record.people, 'person') if record.people == 1 else f'{record.people} people'} in frames {first} to {end - 1}"
    text = f"{record.source}: {seen} of {listed(record.cameras)}, tracker {record.tracker}. People walk their true paths before the real cameras."
    if record.fit_frames is not None:
        text += f" Models are fitted to frames {record.fit_frames[0]} to {record.fit_frames[1] - 1}."
    out = [("What was predicted", text)]
    if record.real:
        out += [(f"{name[:1].upper()}{name[1:]}, predicted less real", _verdicts(record, name)) for name in record.forecasts]
        if largest := _largest(record):
            out.append(("Largest difference of a cause", largest))
    return [*out, ("Certainty", _certainty(record))]


def _verdicts(record: PredictionRecord, name: str) -> str:
    """A sentence: the differences of scores, predicted less real, and which real ones are within the intervals."""
    assert record.real is not None
    differences, within, beyond = list[str](), list[str](), list[str]()
    for key, label, digits in SCORES:
        found, real = record.forecasts[name].figures.get(key), record.real.figures.get(key, math.nan)
        if found is None or not math.isfinite(found.mean - real):
            continue
        differences.append(f"{label} {found.mean - real:+.{digits}f}".replace("-", "−"))
        if found.low is not None and found.high is not None:
            (within if found.low <= real <= found.high else beyond).append(label)
    text = f"{', '.join(differences) or 'Nothing is known'}."
    text += f" Within the interval of one run: {listed(within)}." if within else ""
    return text + (f" Beyond it: {listed(beyond)}." if beyond else "")


def _largest(record: PredictionRecord) -> str:
    """A sentence on the cause of errors that the first detector predicts worst."""
    every = [(kind, cause, *_ends(record, kind, cause)) for kind in KINDS for cause in _causes(record, kind)]
    kind, cause, predicted, real = max(every, key=lambda one: abs(one[2] - one[3]), default=("", "", 0.0, 0.0))
    if predicted == real:
        return ""
    name, *_ = record.forecasts
    return f"{kind[:1].upper()}{kind[1:]}, {cause}: {predicted:.1f} predicted by {name}, {real:.0f} real."


def _ends(record: PredictionRecord, kind: str, cause: str) -> tuple[float, float]:
    counts = _counts(record, kind, cause)
    return counts[0], counts[-1]


def _certainty(record: PredictionRecord) -> str:
    seeds = len(record.seeds)
    if seeds == 1:
        text = "One twin a detector has no interval."
    else:
        text = f"{seeds} twins a detector: an interval is where one more run would lie with 95 %."
    return f"{text} Intervals do not hold the uncertainty of the fit. The real boxes are one run of one part of a recording."


def sentences(record: PredictionRecord, kind: str) -> list[str]:
    """Sentences on one kind of error: a detector each, with the cause that differs most from the real one."""
    key, out = kind.replace(" ", "_"), list[str]()
    if record.real:
        truths, real = record.real.figures.get("truths", math.nan), record.real.figures.get(key, math.nan)
        out.append(f"Real: {_number(real, 0)} {kind} at {_number(truths, 0)} true positions.")
    for k, name in enumerate(record.forecasts):
        text = f"{name} predicts {_text(record, name, key, 1)}."
        every = [(cause, _counts(record, kind, cause)) for cause in _causes(record, kind)]
        if record.real and every:
            cause, counts = max(every, key=lambda one: abs(one[1][k] - one[1][-1]))
            if counts[k] != counts[-1]:
                text += f" The largest difference is “{cause}”: {counts[k]:.1f} predicted, {counts[-1]:.0f} real."
        out.append(text)
    return out


def tables(record: PredictionRecord) -> list[tuple[str, list[PageTable]]]:
    """Headings with tables: scores, errors by cause, and the single runs of each detector."""
    names = list(record.forecasts)
    head = (*names, REAL) if record.real else tuple(names)
    scores = []
    for key, label, digits in (*SCORES, *ERRORS, *OTHERS):
        cells = [_text(record, name, key, digits) for name in names]
        if record.real:
            cells.append(_number(record.real.figures.get(key, math.nan), 0 if digits == 1 else digits))
        scores.append((label, *cells))
    causes = []
    for kind in KINDS:
        for cause in _causes(record, kind):
            if any(_counts(record, kind, cause)):
                cells = [_shown(of.causes[kind].get(cause), 1) for of in record.forecasts.values()]
                causes.append((f"{kind}: {cause}", *cells, *([f"{record.real.causes[kind].get(cause, 0.0):.0f}"] if record.real else [])))
    out = [("Scores", [PageTable("Means over twins, with intervals of one run", ("figure", *head), tuple(scores))])]
    if causes:
        out.append(("Errors by cause", [PageTable("Means over twins, with intervals of one run", ("cause", *head), tuple(causes))]))
    return [*out, ("Single twins", [_runs(record, name) for name in names])]


def _runs(record: PredictionRecord, name: str) -> PageTable:
    shown = (*SCORES, *ERRORS)
    body = [
        (str(seed), *(_number(run.get(key, math.nan), 0 if digits == 1 else digits) for key, _, digits in shown))
        for seed, run in zip(record.seeds, record.forecasts[name].runs, strict=False)
    ]
    return PageTable(f"Twins of {name}", ("seed", *(label for _, label, _ in shown)), tuple(body))


def _provenance(record: PredictionRecord) -> list[PageTable]:
    rows: Sequence[tuple[str, str]] = tuple(record.versions.items())
    options = ", ".join(f"{key} = {value}" for key, value in record.options.items()) or "defaults"
    versions = PageTable("Versions", ("part", "version"), tuple(rows))
    return [*([versions] if rows else []), PageTable("Tracker", ("name", "options"), ((record.tracker, options),))]


def _text(record: PredictionRecord, name: str, key: str, digits: int) -> str:
    return _shown(record.forecasts[name].figures.get(key), digits)


def _shown(value: Predicted | None, digits: int) -> str:
    if value is None or not math.isfinite(value.mean):
        return "–"
    return Interval(value.mean, value.low, value.high, 0).text(digits)


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace("-", "−") if math.isfinite(value) else "–"
