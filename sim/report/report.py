"""The report of a stress test: one page with findings, plots and pictures, from the rows that `stress` wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sim.report.page import PageContent, page
from sim.report.pictures import Album
from sim.report.plots import Plot, save
from sim.report.rows import Rows, read_beside
from sim.report.series import overview, plots_of
from sim.report.summary import moments
from tracker.io.atomic import write_text
from tracker.io.progress import progress_bar


def write_report(folder: Path, out: Path | None = None, others: Sequence[Path] = ()) -> Path:
    """Write the page to `out` (default: FOLDER/report.html), and each plot as PNG and CSV into FOLDER/report. Returns the path of the page.

    others: other folders, whose runs are shown beside those of the first.
    Raises ValueError as `read_beside` does, and where a picture lies outside the folder.
    """
    rows = read_beside([folder, *others])
    target = out or folder / "report.html"
    if target.is_dir():
        raise ValueError(f"{target}: is a folder, needs a file name")
    album = Album.of(folder, moments(rows))
    plots = _plots(rows)
    beside = folder / "report"
    beside.mkdir(exist_ok=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    drawn = {plot.name: save(plot, beside) for plot in progress_bar(plots, desc="plots", unit="plot", disable=len(plots) < 8)}
    text = page(PageContent(rows, {plot.name: (plot, drawn[plot.name]) for plot in plots}, album))
    write_text(target, text)
    return target


def _plots(rows: Rows) -> list[Plot]:
    return [*overview(rows), *(plot for sweep in rows.sweeps() for plot in plots_of(sweep, rows.trackers))]
