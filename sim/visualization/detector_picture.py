"""Pictures of detectors: a page of an error model, with intervals, and the reliability and precision of scores."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure
import matplotlib.layout_engine
import numpy as np

from sim.visualization.overlays import COLOURS, INK, save_figure
from tracker.detector_models.bodies import OVERLAPS
from tracker.detector_models.comparison import miss_runs
from tracker.detector_models.fit import edge_errors
from tracker.detector_models.fitting import Fit, places_note
from tracker.detector_models.model import EDGES
from tracker.detector_models.samples import Samples
from tracker.geometry import Array
from tracker.metrics.box_detection import BINS, JudgedBoxes, reliability

REAL, MODEL, OTHER = "#1a1a1a", "#d55e00", "#999999"
LONGEST = 8.0
"""s: the longest lag of an autocorrelation."""


def draw_detector(found: Fit, path: Path) -> None:
    """Write the page of a model as PNG: misses, edges, confidences, second and false boxes, each with its interval.

    Raises OSError where the file cannot be written.
    """
    model = found.model
    layout = matplotlib.layout_engine.ConstrainedLayoutEngine(rect=(0, 0.04, 1, 0.96))
    figure: Any = matplotlib.figure.Figure(figsize=(17, 12.5), layout=layout)
    c, (share, low, high) = model.counts, model.figures["misses.share"]
    figure.suptitle(
        f"{model.name}: {c['found']} of {c['bodies']} bodies of {c['people']} people found, misses {share:.3f} [{low:.3f}, {high:.3f}]",
        fontsize=14, x=0.01, ha="left", color=INK,
    )  # fmt: skip
    figure.text(0.01, 0.008, _note(found), fontsize=9, color=INK)
    axes = figure.subplots(3, 4)
    _misses(axes[0, 0], found, "visible", "visible share of the body")
    _misses(axes[0, 1], found, "height", "height of the body / of the image")
    _places(axes[0, 2], found)
    _runs(axes[0, 3], found)
    _edge_bars(axes[1, 0], found)
    _edge_curves(axes[1, 1], found)
    _autocorrelations(axes[1, 2], found)
    _confidences(axes[1, 3], found)
    _rates(axes[2, 0], found)
    _border(axes[2, 1], found)
    _standing(axes[2, 2], found)
    _distances(axes[2, 3], found)
    for axis in axes.flat:
        axis.title.set_size(10)
        axis.tick_params(labelsize=8)
    save_figure(path, figure)


def _note(found: Fit) -> str:
    model = found.model
    text = "Bars: 95 % intervals, by a bootstrap over people and blocks of 5 s. "
    text += "Black: real boxes; orange: boxes that the model simulates on the same people."
    if model.bodies == "places":
        text += f"\n{places_note(model)}"
    if model.counts["unjudged"]:
        text += f" {model.counts['unjudged']} boxes beyond the area are not judged."
    return text


def _bars(axis: Any, labels: Sequence[str], figures: Sequence[tuple[float, float, float]]) -> None:
    values = np.array(figures).reshape(-1, 3)
    spread = np.abs(np.stack([values[:, 0] - np.minimum(values[:, 1], values[:, 0]), np.maximum(values[:, 2], values[:, 0]) - values[:, 0]]))
    axis.errorbar(range(len(values)), values[:, 0], yerr=spread, fmt="o", color=REAL, capsize=3, ms=4)
    axis.set_xticks(range(len(labels)), labels, rotation=20, ha="right")
    axis.grid(axis="y", alpha=0.3)


def _group(found: Fit, prefix: str) -> dict[str, tuple[float, float, float]]:
    return {name.removeprefix(prefix): value for name, value in found.model.figures.items() if name.startswith(prefix)}


def _misses(axis: Any, found: Fit, group: str, label: str) -> None:
    rows = _group(found, f"misses.{group}.")
    _bars(axis, list(rows), list(rows.values()))
    axis.set_ylim(0, None)
    axis.set(title=f"Misses by {label}", ylabel="share of bodies")


def _places(axis: Any, found: Fit) -> None:
    rows, grid = _group(found, "misses.place."), np.full((3, 3), np.nan)
    for r, row in enumerate(("top", "middle", "bottom")):
        for c, column in enumerate(("left", "centre", "right")):
            if (one := rows.get(f"{row} {column}")) is not None:
                grid[r, c] = one[0]
                axis.text(c, r, f"{one[0]:.2f}\n[{one[1]:.2f}, {one[2]:.2f}]", ha="center", va="center", fontsize=8, color=INK)
    axis.imshow(grid, cmap="Oranges", vmin=0, vmax=max(0.3, float(np.nanmax(grid, initial=0.0)) * 1.6), aspect="auto")
    axis.set_xticks(range(3), ("left", "centre", "right"))
    axis.set_yticks(range(3), ("top", "middle", "bottom"))
    axis.set(title="Misses by place of the body's middle in the image")


def _runs(axis: Any, found: Fit) -> None:
    for samples, colour, label in ((found.real, REAL, "real"), (found.simulated, MODEL, "model")):
        runs = np.sort(miss_runs(samples.people, samples.period))
        if len(runs):
            axis.step(runs, 1 - np.arange(len(runs)) / len(runs), where="post", color=colour, label=f"{label}, {len(runs)} runs")
    axis.set(title="How long misses last", xlabel="s", ylabel="share of runs that last as long", yscale="log")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)


def _edge_bars(axis: Any, found: Fit) -> None:
    f = found.model.figures
    labels, rows = [], []
    for edge in EDGES:
        labels += [f"{edge}, mean", "deviation"]
        rows += [f[f"edges.{edge}.mean"], f[f"edges.{edge}.deviation"]]
    _bars(axis, labels, rows)
    axis.axhline(0, color=INK, lw=0.6)
    axis.set(title="Errors of edges", ylabel="heights of the body")


def _edge_curves(axis: Any, found: Fit) -> None:
    filled = (found.model.edges.hidden, found.model.edges.border)
    for samples, style in ((found.real, "-"), (found.simulated, ":")):
        error = edge_errors(samples.people, *filled)
        for k, edge in enumerate(EDGES):
            _distribution(axis, error[:, k], style, COLOURS[k], edge)
    axis.set_xlim(-0.4, 0.4)
    axis.set(title="Errors of edges; dotted: model", xlabel="heights of the body", ylabel="share of boxes below")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)


def _distribution(axis: Any, value: Array, style: str, colour: str, label: str) -> None:
    """The cumulative distribution of the finite values. Dotted curves have no label."""
    value = np.sort(value[np.isfinite(value)])
    if len(value):
        axis.plot(value, np.linspace(0, 1, len(value)), style, color=colour, lw=1.2, label=label if style == "-" else None)


def _autocorrelations(axis: Any, found: Fit) -> None:
    filled = (found.model.edges.hidden, found.model.edges.border)
    for samples, style in ((found.real, "-"), (found.simulated, ":")):
        error = edge_errors(samples.people, *filled)
        for k, edge in enumerate(EDGES):
            lags, values = _autocorrelation(error[:, k], samples)
            axis.plot(lags, values, style, color=COLOURS[k], lw=1.2, label=edge if style == "-" else None)
    f = found.model.figures
    said = ", ".join(f"{edge} {f[f'edges.{edge}.lasting'][0]:.2f}" for edge in EDGES)
    axis.axhline(0, color=INK, lw=0.6)
    axis.set(title=f"Autocorrelation of edges; lasting share:\n{said}", xlabel="lag, s")
    axis.grid(alpha=0.3)


def _autocorrelation(value: Array, samples: Samples) -> tuple[list[float], list[float]]:
    centred, lags, values = value - np.nanmean(value), list[float](), list[float]()
    for lag, first, then in samples.pairs:
        product = centred[first] * centred[then]
        if lag <= LONGEST and np.isfinite(product).sum() >= 30:
            lags.append(lag)
            values.append(float(np.nanmean(product) / np.nanmean(centred**2)))
    return lags, values


def _confidences(axis: Any, found: Fit) -> None:
    for samples, style in ((found.real, "-"), (found.simulated, ":")):
        false = samples.false
        kinds = (
            ("people", samples.people.confidence, COLOURS[0]),
            ("second", false.seconds[:, 5], COLOURS[1]),
            ("new false", false.confidence[false.site < 0], COLOURS[2]),
            ("standing false", false.confidence[false.site >= 0], COLOURS[3]),
        )
        for label, value, colour in kinds:
            _distribution(axis, value, style, colour, f"{label}, {np.isfinite(value).sum()}")
    axis.set(title="Confidences; dotted: model", xlabel="confidence", ylabel="share of boxes below")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)


def _rates(axis: Any, found: Fit) -> None:
    f = found.model.figures
    _bars(
        axis,
        ["second\na person", "new\na view", "standing\na view", *(f"merged,\n{low:g}+" for low in OVERLAPS)],
        [f["second.rate"], f["false.rate"], f["standing.rate"], *(f[f"merges.{low:g}"] for low in OVERLAPS)],
    )
    axis.set_ylim(0, None)
    axis.set(title="Second and false boxes; merges by overlap", ylabel="boxes in a frame; share merged")


def _border(axis: Any, found: Fit) -> None:
    f = found.model.figures
    rows = {f"missed,\n{label}": value for label, value in _group(found, "misses.border.").items()}
    rows |= {"hidden part\nin the box": f["edges.hidden"], "part beyond\nborder in it": f["edges.border"]}
    _bars(axis, list(rows), list(rows.values()))
    axis.set_ylim(-0.05, 1.05)
    axis.set(title="Bodies that the border or things cut", ylabel="share")


def _standing(axis: Any, found: Fit) -> None:
    false, drawn = found.real.false, 0
    for site in np.unique(false.site[false.site >= 0]).tolist():
        mine = false.site == site
        left, top, right, bottom = np.median(false.edges[mine], axis=0)
        colour = COLOURS[int(false.view[mine][0]) % len(COLOURS)]
        axis.plot([left, right, right, left, left], [top, top, bottom, bottom, top], color=colour, lw=1)
        drawn += 1
    new = false.site < 0
    middle = (false.edges[new, :2] + false.edges[new, 2:]) / 2
    axis.plot(*middle.T, ".", color=OTHER, ms=2, zorder=0)
    if not axis.yaxis_inverted():
        axis.invert_yaxis()
    sites = found.model.figures["standing.sites"]
    axis.set(title=f"{drawn} standing false boxes, colours by view; dots: new ones\nplaces a view {sites[0]:.2f} [{sites[1]:.2f}, {sites[2]:.2f}]")
    axis.set(xlabel="px", ylabel="px")


def _distances(axis: Any, found: Fit) -> None:
    names = list(found.distances["this model"])
    for (label, column), colour, shift in zip(found.distances.items(), (MODEL, OTHER), (0.2, -0.2), strict=True):
        axis.barh(np.arange(len(names)) - shift, [column[name] for name in names], 0.38, color=colour, label=label)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()
    axis.set_xlim(0, 1)
    axis.set(title="Distance of simulated boxes from real ones")
    axis.legend(fontsize=8)


def draw_reliability(judged: JudgedBoxes, path: Path) -> None:
    """Write the picture as PNG. judged: boxes at an IoU of 0.5. Raises OSError where the file cannot be written."""
    figure: Any = matplotlib.figure.Figure(figsize=(10, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    found = reliability(judged)
    if found is None:
        left.text(0.5, 0.5, "scores are no probabilities", ha="center", va="center", transform=left.transAxes)
    else:
        middles = (np.arange(BINS) + 0.5) / BINS
        left.plot([0, 1], [0, 1], color="0.6", linewidth=1)
        left.bar(middles, found.boxes / max(found.boxes.max(), 1), 0.9 / BINS, color=OTHER, alpha=0.35, label="boxes, most common = 1")
        left.plot(found.score, found.share, "o-", color=COLOURS[0], label="share of boxes that are bodies")
        left.legend(loc="upper left")
        left.set(title=f"reliability, expected calibration error {found.expected_error:.3f}")
    left.set(xlabel="score", ylabel="share", xlim=(0, 1), ylim=(0, 1.02))
    order = np.argsort(-judged.score, kind="stable")
    hits = np.cumsum(judged.hit[order])
    right.plot(hits / max(judged.bodies.sum(), 1), hits / np.arange(1, len(order) + 1), color=COLOURS[0])
    title = f"average precision {judged.average_precision():.3f} at IoU 0.5"
    right.set(xlabel="recall", ylabel="precision", xlim=(0, 1), ylim=(0, 1.02), title=title)
    for axis in (left, right):
        axis.grid(alpha=0.25)
    save_figure(path, figure)
