"""The report of a stress test: one page with findings, plots and pictures, from the rows that `stress` wrote.

Texts, tables and figures are put into the template that lies beside this file. The page is HTML that is well-formed XML as well.
It is one file, runs no scripts and loads nothing from a network. Pictures and videos are small JPEG and animated WebP files as data URIs.
"""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup, escape

from sim.report.findings import (
    CAUSES,
    GLOSSARY,
    REAL,
    at,
    at_row,
    breaking,
    causes_of,
    change,
    finding,
    findings,
    headline,
    moments,
    owner,
    plural,
    predicted,
    reasons,
    robots,
    spread,
    stages,
    summary,
)
from sim.report.plots import Plot, name_of, overview, plots_of, save, shortened
from sim.report.rows import Row, Rows, Setting, SweepRows, read_beside
from sim.stress.ablation import STAGES
from sim.stress.result_rows import RESULTS
from sim.stress.sweeps import KNOWN_SWEEPS
from tracker.geometry import Image
from tracker.io.atomic import write_text
from tracker.io.image_files import MOST_PIXELS, decode_image, image_size
from tracker.io.progress import progress_bar

WIDTH = 1000
"""The greatest width in px."""
BUDGET = 1_600_000
"""Bytes of all pictures together, before base64. The page then stays below 3 MB."""
QUALITIES = (80, 65, 50, 35, 20)
TEMPLATE = Path(__file__).with_suffix(".html.j2")
MOST_FAILED = 30
"""The greatest number of failed runs that are listed."""
KIND_NAMES = {"miss": "a missed person", "false positive": "a false person", "switch": "an identity switch"}
"""Kinds of errors as the page names them."""
ABOUT_MOMENTS = (
    "The longest errors, each at its middle frame, on a plan ten metres wide. Rings are the true positions of people, with the paths behind them."
    " Coloured dots are the tracks. The red ring is the error. Arrows are robots: grey at the true pose, red at the estimated pose."
    " Lines lead from robots to people whom they see: blue where the detector reported a box, grey where it did not."
)
ABOUT_COMMANDS = "In another folder, the same command makes the same rows. In the same folder, it continues after the last whole row."
COLUMNS = (
    ("mota", "MOTA", 3), ("idf1", "IDF1", 3), ("hota", "HOTA", 3), ("misses", "misses", 0), ("false_positives", "false", 0),
    ("switches", "switches", 0), ("ate_m", "ATE [m]", 3),
)  # fmt: skip
OPTIONAL_PARTS = ("worst_figures", "overview_figures", "sweeps", "moments", "failed", "failed_unlisted", "causes", "provenance", "plots_beside")
"""Names that the template uses and that a page may leave out."""
FIRST_HEADINGS = {"short": "In short", "contents": "On this page"}
LAST_HEADINGS = {"figures": "All figures", "words": "Glossary", "again": "How to reproduce it"}
"""Anchor → heading of the sections that every page has, before and after its own."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture or a video, its size in px, and the type of its data."""

    data: bytes
    width: int
    height: int
    type: str = "jpeg"

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return f"data:image/{self.type};base64," + base64.b64encode(self.data).decode("ascii")


@dataclass(frozen=True, eq=False)
class Entry:
    """A moment of a run with its pictures, and the names of pictures that are missing."""

    row: Row
    moment: dict[str, Any]
    pictures: tuple[Picture, ...]
    missing: tuple[str, ...]


def album_of(folder: Path, moments: Sequence[tuple[Row, dict[str, Any]]]) -> list[Entry]:
    """Read the pictures of moments and shrink them, all at the best JPEG quality with which they fit into BUDGET.

    Raises ValueError for a picture outside the folder, and for a file that is no image.
    """
    read = [(row, moment, _images(folder, row, moment)) for row, moment in moments]
    images = [image for _, _, (found, _) in read for image in found]
    for quality in QUALITIES:
        encoded = [jpeg(image, quality) for image in images]
        if sum(len(picture.data) for picture in encoded) <= BUDGET:
            break
    left = iter(encoded)
    return [Entry(row, moment, tuple(next(left) for _ in found), tuple(missing)) for row, moment, (found, missing) in read]


def _images(folder: Path, row: Row, moment: dict[str, Any]) -> tuple[list[Any], list[str]]:
    found, missing = [], []
    names = moment.get("pictures") or []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"{row.where}: pictures of a moment is no list of names")
    for name in names:
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise ValueError(f"{row.where}: picture {name[:80]!r} lies outside the folder")
        path = folder / name
        if not path.is_file():
            missing.append(name)
            continue
        data = path.read_bytes()
        size = image_size(data)
        if size is None or size[0] * size[1] > MOST_PIXELS:
            raise ValueError(f"{path}: not an image, or torn" if size is None else f"{path}: {size} pixels, needs at most {MOST_PIXELS}")
        try:
            found.append(decode_image(data, size, cv2.IMREAD_COLOR))
        except ValueError as error:
            raise ValueError(f"{path}: not an image, or torn: {error}") from None
    return found, missing


def video(frames: Sequence[Image], seconds: float, quality: int) -> Picture:
    """Frames (h, w, 3) RGB as an animated WebP, which browsers show in a loop. seconds: duration of a frame."""
    animation = cv2.Animation()
    animation.frames = [cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) for frame in frames]
    animation.durations = [round(1000 * seconds)] * len(frames)
    data = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, quality])[1]
    return Picture(bytes(data), frames[0].shape[1], frames[0].shape[0], "webp")


def jpeg(image: Any, quality: int) -> Picture:
    """An image (BGR) as a JPEG of at most WIDTH px."""
    height, width = image.shape[:2]
    if width > WIDTH:
        height, width = round(height * WIDTH / width), WIDTH
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    ok, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1])
    if not ok:
        raise ValueError(f"an image of {width} × {height} px cannot be written as JPEG")
    return Picture(data.tobytes(), width, height)


@dataclass(frozen=True, eq=False)
class PageFigure:
    """A plot on the page: its anchor, the SVG element, and the caption."""

    anchor: str
    svg: Markup
    caption: str

    @staticmethod
    def of(plot: Plot, svg: str) -> PageFigure:
        # A screen reader reads the label, and not the single letters within the picture.
        labelled = svg.replace("<svg", f'<svg role="img" aria-label="{escape(plot.in_words())}"', 1)
        return PageFigure(f"plot-{plot.name}", Markup(labelled), f"{plot.note} File: {plot.name}.")


@dataclass(frozen=True, eq=False)
class PageTable:
    """A table of strings; the first cell of each row of the body names the row."""

    caption: str
    head: tuple[str, ...]
    body: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class PageMoment:
    """A worst moment: its heading, what happened, pictures with their alternative texts, and names of pictures that are missing."""

    heading: str
    sentence: str
    pictures: tuple[Picture, ...]
    alternatives: tuple[str, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PageSweep:
    """The section of one sweep: its anchor, sentences and figures."""

    anchor: str
    sentences: list[str]
    figures: list[PageFigure]


def draw_figures(plots: Iterable[Plot], folder: Path) -> dict[str, PageFigure]:
    """Write each plot as PNG and CSV into a folder, and return the figures of a page by the names of the plots."""
    folder.mkdir(exist_ok=True)
    return {plot.name: PageFigure.of(plot, save(plot, folder)) for plot in plots}


def write_report(folder: Path, out: Path | None = None, others: Sequence[Path] = ()) -> Path:
    """Write the page to `out` (default: FOLDER/report.html), and each plot as PNG and CSV into FOLDER/report. Returns the path of the page.

    others: other folders, whose runs are shown beside those of the first.
    Raises ValueError as `read_beside` does, and where a picture lies outside the folder.
    """
    rows = read_beside([folder, *others])
    target = out or folder / "report.html"
    if target.is_dir():
        raise ValueError(f"{target}: is a folder, needs a file name")
    album = album_of(folder, moments(rows))
    plots = [*overview(rows), *(plot for sweep in rows.sweeps() for plot in plots_of(sweep, rows.trackers))]
    target.parent.mkdir(parents=True, exist_ok=True)
    figures = draw_figures(progress_bar(plots, desc="plots", unit="plot", disable=len(plots) < 8), folder / "report")
    command = shlex.join(["pilsim", "report", str(rows.folder), *(["--beside", *map(str, others)] if others else [])])
    write_text(target, render(_names(rows, figures, album) | {"commands": "\n".join([*dict.fromkeys(row.command for row in rows.rows), command])}))
    return target


def render(names: dict[str, Any]) -> str:
    """Render a document from the names that the template uses; those of OPTIONAL_PARTS may be missing.

    headings: anchor → heading of the page's own sections, in the order of the page.
    """
    headings = FIRST_HEADINGS | names["headings"] | LAST_HEADINGS
    # The page is written without a server, so an undefined name must fail here and not leave a hole in the text.
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    return template.render(page=dict.fromkeys(OPTIONAL_PARTS, ()) | names | {"headings": headings}).lstrip()


def _names(rows: Rows, figures: Mapping[str, PageFigure], album: list[Entry]) -> dict[str, Any]:
    """Name → value of each variable of the template."""
    sections = {_anchor(sweep): _title(sweep) for sweep in rows.sweeps()}
    sections |= {"moments": "Worst moments"} if album else {}
    worst = findings(rows, rows.trackers[0])[:1]
    occurring = {cause for counts in causes_of(rows.rows).values() for cause in counts}
    return {
        "title": f"Stress test: {rows.folder.resolve().name}",
        "kicker": "pilsim stress test",
        "heading": "Where the tracker breaks, and why",
        "headline": headline(rows),
        "headings": sections | ({"failed": "Runs that failed"} if rows.failed else {}),
        "summary": summary(rows),
        "worst_figures": [figure for f in worst for figure in _beginning(figures, f"first-{name_of(f.sweep.name)}")],
        "overview_figures": _beginning(figures, "overview"),
        "sweeps": [_sweep(sweep, rows.trackers, _beginning(figures, name_of(sweep.name) + "-")) for sweep in rows.sweeps()],
        "about_moments": ABOUT_MOMENTS,
        "moments": [_moment(k, entry) for k, entry in enumerate(album, 1)],
        "failed": _failed(rows.failed),
        "failed_unlisted": more(len(rows.failed) - MOST_FAILED, RESULTS),
        "tables": [found for sweep in rows.sweeps() for tracker in rows.trackers if (found := _tables(sweep, tracker))],
        "glossary": GLOSSARY,
        "causes": [(cause, meaning) for cause, meaning in CAUSES.items() if cause in occurring],
        "about_commands": ABOUT_COMMANDS,
        "provenance": _provenance(rows),
        "plots_beside": True,
        "made_by": "pilsim report",
        "made_from": plural(len(rows.rows), "run"),
    }


def _beginning(figures: Mapping[str, PageFigure], prefix: str) -> list[PageFigure]:
    """The figures whose names begin with `prefix`."""
    return [figure for name, figure in figures.items() if name.startswith(prefix)]


def _anchor(sweep: SweepRows) -> str:
    return f"sweep-{name_of(sweep.name)}"


def _title(sweep: SweepRows) -> str:
    name = "Real" if sweep.name == REAL else sweep.name.replace("_", " ").capitalize()
    words = spread(sweep)
    return f"{name}: {words}" if len(words) < 70 else name


def _sweep(sweep: SweepRows, trackers: list[str], figures: list[PageFigure]) -> PageSweep:
    sentences = [f"The sweep: {KNOWN_SWEEPS[sweep.name].about}."] if sweep.name in KNOWN_SWEEPS else []
    for tracker in trackers:
        found = finding(sweep, tracker)
        if found is None:
            sentences.append(f"No run of {tracker} has a score.")
            continue
        worst = found.worst.of(tracker)
        name = f"MOTA of {tracker}" if len(trackers) > 1 else "MOTA"
        if sweep.name == REAL:
            sentences.append(predicted(sweep, tracker) or change(found, name))
            continue
        where = at(found.worst)
        sentences += [
            part for part in (f"{change(found, name)} {breaking(found)}", reasons(worst, where), owner(worst, where), robots(found)) if part
        ]
    return PageSweep(_anchor(sweep), sentences, figures)


def _moment(k: int, entry: Entry) -> PageMoment:
    row, moment = entry.row, entry.moment
    kind = str(moment.get("kind"))
    heading = f"{KIND_NAMES.get(kind, kind)}: {moment.get('cause', 'cause unknown')}"
    where = f"{at_row(row)}, seed {row.seed}, frame {moment.get('frame')}, tracker {row.tracker}"
    if moment.get("person") is not None:
        where += f"; person {moment['person']}"
    if isinstance(place := moment.get("position"), Sequence) and not isinstance(place, str):
        where += f" at ({', '.join(f'{round(float(v), 1) + 0.0:.1f}' for v in place)}) m"
    meaning = CAUSES.get(str(moment.get("cause")), "")
    sentence = f"{_capital(meaning)} {_capital(where)} ({row.id}).".strip()
    count = len(entry.pictures)
    alternatives = tuple(f"Moment {k}, picture {number} of {count}: {heading}; {where}" for number in range(1, count + 1))
    return PageMoment(_capital(heading), sentence, entry.pictures, alternatives, entry.missing)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _tables(sweep: SweepRows, tracker: str) -> tuple[str, list[PageTable]] | None:
    """A heading with the tables of one sweep and tracker; None where the tracker did not run."""
    settings = [s for s in sweep.ordered() if any(row.tracker == tracker for row in s.rows)]
    if not settings:
        return None
    head = (sweep.parameter, "runs", *(label for _, label, _ in COLUMNS))
    caption = f"Means over seeds, with 95 % intervals: {sweep.name}, {tracker}"
    tables = [PageTable(caption, head, tuple(_figures_of(s, tracker) for s in settings))]
    shares = {s.id: stages(s.of(tracker)) for s in settings}
    if any(shares.values()):
        names = (*STAGES, "total")
        body = tuple((shortened(s.value), *(shares[s.id][name].text(3) if name in shares[s.id] else "–" for name in names)) for s in settings)
        tables.append(PageTable(f"MOTA that perfect input would recover: {sweep.name}, {tracker}", (sweep.parameter, *names), body))
    return f"{sweep.name}, tracker {tracker}", tables


def _figures_of(setting: Setting, tracker: str) -> tuple[str, ...]:
    failed = sum(row.tracker == tracker and row.error is not None for row in setting.rows)
    cells = [shortened(setting.value), str(len(setting.of(tracker))) + (f" (+ {failed} failed)" if failed else "")]
    for name, _, digits in COLUMNS:
        interval = setting.mean(tracker, name)
        cells.append("–" if interval is None else interval.text(digits) if digits else f"{interval.mean:.1f}")
    return tuple(cells)


def _failed(failed: Sequence[Row]) -> PageTable | None:
    """The first runs that failed; None where none did."""
    body = tuple((row.id, shortened(row.value), str(row.seed), row.tracker, str(row.error)) for row in failed[:MOST_FAILED])
    caption = "Runs without scores, with their errors"
    return PageTable(caption, ("setting", "value", "seed", "tracker", "error"), body) if body else None


def more(count: int, file: str) -> str:
    """A sentence on failures that are not listed. Empty where there are none."""
    return f"{count} more are in {file}." if count > 0 else ""


def _provenance(rows: Rows) -> list[PageTable]:
    """Versions of the parts, and options of the trackers, where the rows name them."""
    versions: dict[str, dict[str, None]] = {}
    for row in rows.rows:
        for name, version in row.versions.items():
            versions.setdefault(name, {})[version if isinstance(version, str) else json.dumps(version)] = None
    options = {row.tracker: row.options for row in rows.rows if row.options}
    parts = tuple((name, " and ".join(seen)) for name, seen in versions.items())
    trackers = tuple((name, ", ".join(f"{key} = {value}" for key, value in chosen.items())) for name, chosen in options.items())
    tables = (PageTable("Versions", ("part", "version"), parts), PageTable("Trackers", ("name", "options"), trackers))
    return [table for table in tables if table.body]
