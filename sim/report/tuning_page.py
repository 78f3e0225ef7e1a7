"""The page of a search of parameters: its curve, importance of parameters, gain on other cases by kind, and the worst cases."""

from __future__ import annotations

import io
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import matplotlib.figure
import matplotlib.patches
import numpy as np

from sim.confidence_intervals import Interval, bounds_of, mean_interval
from sim.report.findings import plural
from sim.report.page import PageFigure, PageMoment, PageSweep, PageTable, Picture, draw_figures, jpeg, more, render
from sim.report.plots import Bars, Line, Plot
from sim.tuning.case_file import PopulationCase
from sim.tuning.search import SearchPlan
from sim.tuning.space import SearchRange
from sim.tuning.tuned import ALL, HeldOut, TunedResult, gain_text
from tracker.geometry import Array
from tracker.io.atomic import new_file, write_text
from tracker.recordings import RecordingCamera

PAGE, PLOTS, PICTURES = "index.html", "plots", "worst"
QUALITY = 70
FAILED, MOST_FAILED = "Trials and runs of other cases that failed", 30
PARTS = 8
"""Parts of the range of a parameter in which trials are averaged."""
FIGURES = (("hota", "HOTA"), ("mota", "MOTA"), ("idf1", "IDF1"))
GLOSSARY = (
    ("Trial", "one set of parameters, tried on case after case until it is clearly worse than the best one, or on all of them."),
    (
        "Ended early",
        "a trial with a lower objective, found worse by Wilcoxon's test (p < 0.05). Its value is estimated from common cases.",
    ),
    ("Importance", "the share of the variance of the objective that a parameter explains, by the forests of fANOVA (Hutter et al. 2014)."),
    ("Other cases", "cases of the same population that the search has not seen."),
    ("Gain", "best less default parameters, case by case. The interval is Student's t with 95 %. Where it holds 0, no gain is seen."),
    ("HOTA, MOTA, IDF1", "scores on the ground with distances of at most 1 m. People whom no camera sees do not count."),
)
ABOUT_WORST = (
    "The other cases in which the best parameters score lowest. Plans have the true paths; orange dots are people, triangles are cameras."
    " In the images, boxes have their confidences, and crosses are feet of people at the poses that the tracker is told."
)

COLUMNS = 3
"""Panels per row in the picture of a case."""
MOST_VIEWS = 5
"""Largest number of cameras that are drawn."""


def write_tuning_page(plan: SearchPlan, found: TunedResult, command: str) -> Path:
    """Write index.html into the folder of a search, with its plots as PNG and CSV and pictures of the worst cases. Returns the path of the page.

    command: the command line that continues the search.
    """
    target = plan.folder / PAGE
    write_text(target, render(_names(plan, found, draw_figures(_plots(plan, found), plan.folder / PLOTS)) | {"commands": command}))
    return target


def _plots(plan: SearchPlan, found: TunedResult) -> Iterator[Plot]:
    numbers, best = zip(*found.curve, strict=True)
    points = tuple(_point(value) for value in best)
    lines = [Line("best so far", points)]
    if math.isfinite(found.default_value):
        lines.append(Line("default", (_point(found.default_value),) * len(points), limit=True))
    yield Plot("curve", "Best objective", numbers, "trial", plan.objective, tuple(lines), note="Trials that were tried on all cases.")
    if found.importance:
        shares = {"share of the variance": tuple(found.importance.values())}
        names = tuple(found.importance)
        yield Plot("importance", "Importance of parameters", names, "parameter", "share", Bars(shares), numeric=False, note="fANOVA.")
    if found.held_out is not None and (gains := found.held_out.gains()):
        zero = Line("none", (_point(0.0),) * len(gains), limit=True)
        drawn = (Line("best less default", tuple(gains.values())), zero)
        note = "Paired differences on other cases, with intervals of 95 %."
        yield Plot("gains", "Gain by kind of case", tuple(gains), "kind of case", found.held_out.figure, drawn, numeric=False, note=note)
    for one in plan.space:
        if (plot := _slice(one, plan, found)) is not None:
            yield plot


def _point(value: float) -> Interval:
    return Interval(value, None, None, 1)


def _slice(one: SearchRange, plan: SearchPlan, found: TunedResult) -> Plot | None:
    """The objective by the values of a parameter; None where all trials have one value."""
    values = [params[one.name] for params, _ in found.slices]
    scores = np.array([score for _, score in found.slices])
    if one.choices or len(set(values)) <= PARTS:
        distinct = sorted(set(values), key=lambda value: (str(type(value)), value))
        groups = [(value, scores[[k for k, other in enumerate(values) if other == value]]) for value in distinct]
    else:
        order = np.argsort(values, kind="stable")
        groups = [(float(np.mean([values[k] for k in part])), scores[part]) for part in np.array_split(order, PARTS)]
    if len(groups) < 2:
        return None
    bounds = bounds_of(plan.objective.removesuffix("-worst"))
    points = tuple(mean_interval(part.tolist(), bounds) for _, part in groups)
    numeric = not one.choices
    x = tuple(float(f"{value:.3g}") if numeric else str(value) for value, _ in groups)
    note = "Means of the trials in each part of the values, with intervals of 95 %. Other parameters differ, too."
    return Plot(f"slice-{one.name}", one.name, x, one.name, plan.objective, (Line("trials", points),), numeric=numeric, note=note)


def _names(plan: SearchPlan, found: TunedResult, figures: dict[str, PageFigure]) -> dict[str, Any]:
    """Name → value of each variable of the template."""
    sections = {"gains": "Gain on other cases"} if "gains" in figures else {}
    slices = [figure for name, figure in figures.items() if name.startswith("slice-")]
    sections |= {"slices": "Parameters"} if slices else {}
    moments = [] if found.held_out is None else list(_worst(plan, found.held_out))
    ends = {"moments": "Worst cases"} if moments else {}
    ends |= {"failed": "What failed"} if found.errors else {}
    return {
        "title": f"Search: {plan.folder.resolve().name}",
        "kicker": "pilsim tune",
        "heading": "Which parameters are best, and where",
        "headline": _headline(plan, found),
        "headings": sections | ends,
        "summary": _summary(plan, found),
        "overview_figures": [figures[name] for name in ("curve", "importance") if name in figures],
        "sweeps": [
            PageSweep(anchor, _sentences(found, anchor), [figures["gains"]] if anchor == "gains" else slices) for anchor in sections
        ],
        "about_moments": ABOUT_WORST,
        "moments": moments,
        "failed": failed if (failed := PageTable(FAILED, ("error",), tuple((error,) for error in found.errors[:MOST_FAILED]))).body else None,
        "failed_unlisted": more(len(found.errors) - MOST_FAILED, "study.db"),
        "tables": _tables(plan, found),
        "glossary": GLOSSARY,
        "about_commands": "The same command continues the search. With one worker, it makes the same trials in another folder.",
        "plots_beside": True,
        "made_by": "pilsim tune",
        "made_from": plural(found.trials, "trial"),
    }  # fmt: skip


def _headline(plan: SearchPlan, found: TunedResult) -> str:
    text = f"Trial {found.number} of {found.trials} is best: {plan.objective} {found.value:.3f} on {plan.cases} cases"
    text += f", where the default parameters have {found.default_value:.3f}." if math.isfinite(found.default_value) else "."
    return text if found.held_out is None else f"{text} {gain_text(found.held_out).capitalize()}."


def _summary(plan: SearchPlan, found: TunedResult) -> list[tuple[str, str]]:
    who = "population" if plan.source.user is None else plan.source.user.name
    default = f", and {found.default_worst:.3f} for the default parameters" if math.isfinite(found.default_worst) else ""
    out = [
        ("What was searched", f"{plural(len(plan.space), 'parameter')} of the tracker {plan.tracker or 'default'}, sampler {plan.sampler}."),
        ("Where", f"{plan.cases} cases of the {who}, seed {plan.source.seed}."),
        ("Trials", f"{found.trials} ended, {found.early} of them early, and {found.failed} failed."),
        ("Worst tenth", f"The mean of the worst tenth of the cases is {found.worst:.3f} for the best trial{default}."),
    ]
    if found.importance:
        name, share = next(iter(found.importance.items()))
        out.append(("What matters most", f"{name}, with {100 * share:.0f} % of the variance of the objective."))
    return out


def _sentences(found: TunedResult, anchor: str) -> list[str]:
    if anchor != "gains" or found.held_out is None:
        return ["Each plot has all trials with a value, estimated ones included."]
    said = {"higher": "a gain", "lower": "a loss", "no difference seen": "no gain is seen", "identical": "the same", "one seed": "one case alone"}
    return [f"{kind}: {gain.text(3, signed=True)}, {said[gain.verdict]}." for kind, gain in found.held_out.gains().items()]


def _worst(plan: SearchPlan, tried: HeldOut) -> Iterator[PageMoment]:
    """The worst cases, each with its picture, which is written beside the page, too."""
    folder = plan.folder / PICTURES
    folder.mkdir(exist_ok=True)
    for case in tried.worst():
        drawn = _case_picture(plan.source.case(case))
        with new_file(folder / f"case-{case:05d}.png") as partial:
            partial.write_bytes(drawn)
        picture: Picture = jpeg(cv2.imdecode(np.frombuffer(drawn, dtype=np.uint8), cv2.IMREAD_COLOR), QUALITY)
        best, default = tried.best[case], tried.default[case]
        scores = ", ".join(f"{label} {best[name]:.3f} (default {default[name]:.3f})" for name, label in FIGURES)
        sentence = f"{scores}; {best['misses']:.0f} misses, {best['false_positives']:.0f} false positives, {best['switches']:.0f} switches."
        yield PageMoment(f"{tried.kinds[case]} {case}", sentence, (picture,), (f"Plan and boxes of case {case}",), ())


def _tables(plan: SearchPlan, found: TunedResult) -> list[tuple[str, list[PageTable]]]:
    rows = []
    for name, value in found.best.items():
        share = f"{found.importance[name]:.3f}" if name in found.importance else "–"
        rows.append((name, str(value), str(plan.defaults.get(name, "–")), share))
    out = [("Parameters", [PageTable("Best and default values", ("parameter", "best", "default", "importance"), tuple(rows))])]
    if found.held_out is None:
        return out
    tried, body = found.held_out, list[Sequence[str]]()
    for kind in (ALL, *sorted(set(tried.kinds.values()))):
        chosen = [case for case, of in tried.kinds.items() if kind in (ALL, of)]
        cells = [f"{np.nanmean([one[k][name] for k in chosen]):.3f}" for name, _ in FIGURES for one in (tried.default, tried.best)]
        body.append((kind, str(len(chosen)), *cells))
    head = ("kind", "cases", *(f"{label}, {which}" for _, label in FIGURES for which in ("default", "best")))
    return [*out, ("Other cases", [PageTable("Means over the cases of a kind", head, tuple(tuple(row) for row in body))])]


def _case_picture(case: PopulationCase) -> bytes:
    """A PNG of the middle frame: a plan with true paths, and the boxes of each camera."""
    recording, frame = case.recording, case.recording.frames // 2
    cameras = list(recording.cameras.items())[:MOST_VIEWS]
    rows = -(-(1 + len(cameras)) // COLUMNS)
    figure = matplotlib.figure.Figure(figsize=(10.0, 3.2 * rows), layout="constrained")
    _draw_plan(figure.add_subplot(rows, COLUMNS, 1), case, frame)
    for k, (name, camera) in enumerate(cameras):
        _draw_view(figure.add_subplot(rows, COLUMNS, k + 2), case, (name, camera), frame)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=90, metadata={"Software": None})
    return out.getvalue()


def _draw_plan(axes: Any, case: PopulationCase, frame: int) -> None:
    recording, paths = case.recording, defaultdict[int, list[Array]](list)
    for ids, feet in (recording.truth or {}).values():
        for person, place in zip(ids.tolist(), feet, strict=True):
            paths[person].append(place[:2])
    for places in paths.values():
        axes.plot(*np.array(places).T, linewidth=0.6, color="#888888")
    for x, y, radius, _, _ in recording.pillars:
        axes.add_patch(matplotlib.patches.Circle((x, y), radius, color="#cccccc"))
    axes.scatter(*(recording.truth or {})[frame][1][:, :2].T, s=12, color="#D55E00", zorder=3)
    for camera in recording.cameras.values():
        pose = recording.pose_at(camera, frame)
        if pose is not None:
            ahead = np.stack([pose.translation[:2], pose.translation[:2] + pose.rotation[:2, 0]])
            axes.plot(*ahead.T, color="#0072B2", marker="^", markevery=[0], markersize=5)
    axes.set(title=f"{case.name}, frame {frame}", aspect="equal", xlabel="m")
    axes.title.set_fontsize(9)


def _draw_view(axes: Any, case: PopulationCase, named: tuple[str, RecordingCamera], frame: int) -> None:
    """Boxes with their confidences. Crosses are true feet, projected with the camera pose that the tracker gets."""
    recording, (name, camera) = case.recording, named
    boxes, confidence = recording.detections[name].get(frame, (np.zeros((0, 4)), np.zeros(0)))
    for (left, top, width, height), sure in zip(boxes.tolist(), confidence.tolist(), strict=True):
        axes.add_patch(matplotlib.patches.Rectangle((left, top), width, height, fill=False, color="#0072B2", linewidth=0.8))
        axes.text(left, top, f"{sure:.2g}", fontsize=5)
    pose, feet = recording.pose_at(camera, frame), (recording.truth or {})[frame][1]
    if pose is not None and len(feet):
        away = pose.inverse().apply(feet)
        pixels, inside = camera.camera.pixels_from_bearings(away / np.linalg.norm(away, axis=1, keepdims=True))
        axes.plot(*pixels[inside].T, "+", color="#D55E00", markersize=5)
    axes.set(title=name, xlim=(0, camera.camera.width), ylim=(camera.camera.height, 0), aspect="equal")
    axes.title.set_fontsize(9)
    axes.tick_params(labelsize=6)
