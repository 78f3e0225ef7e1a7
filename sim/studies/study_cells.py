"""What all studies share: cells that are run once and kept in a CSV file, their table, and their plot.

A cell is a dataclass of texts and numbers: `data`, the settings, `repetition`, then what was measured. Fields up to `repetition` are its key.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from tracker.geometry import Array
from tracker.io.atomic import new_file
from tracker.io.text_files import read_lines

Cells = Sequence[Any]


@dataclass(frozen=True)
class StudyForm:
    """A study: the class and file of its cells, and titles of settings (the first is the x axis) and measures by field.

    notes: lines about the cells of one data set.
    """

    kind: type[Any]
    file: str
    settings: dict[str, str]
    measures: dict[str, str]
    notes: Callable[[Cells], Iterable[str]]

    def key(self, cell: Any) -> tuple[Any, ...]:
        """Data set, settings and repetition."""
        return astuple(cell)[: len(self.settings) + 2]

    def values(self, cells: Cells, field: str) -> list[Any]:
        """Distinct values of a setting, in the order of the cells."""
        return list(dict.fromkeys(getattr(cell, field) for cell in cells))

    def panel(self, cells: Cells, measure: str) -> Array:
        """Mean, minimum and maximum over repetitions: (values of a setting, ..., 3); NaN where nothing is finite."""
        names = [self.values(cells, field) for field in self.settings]
        out = np.full((*map(len, names), 3), np.nan)
        for at in np.ndindex(out.shape[:-1]):
            wanted = tuple(of[k] for of, k in zip(names, at, strict=True))
            here = [getattr(cell, measure) for cell in cells if self.key(cell)[1:-1] == wanted]
            known = [value for value in here if np.isfinite(value)]
            if known:
                out[at] = np.mean(known), min(known), max(known)
        return out

    def resumed(self, folder: Path, choices: Iterable[tuple[Any, ...]], run: Callable[..., Any]) -> Iterator[Any]:
        """The cell of each key: of the file in the folder, or run now and written.

        Raises ValueError naming the line that is no cell.
        """
        path = folder / self.file
        known = {self.key(cell): cell for cell in read_cells(path, self.kind)}
        for choice in choices:
            if choice not in known:
                known[choice] = run(*choice)
                write_cells(path, list(known.values()))
            yield known[choice]

    def summary(self, cells: Cells) -> str:
        """A table for each data set, then its notes. Values are means over repetitions, with minimum and maximum."""
        lines = []
        for data in self.values(cells, "data"):
            own = [cell for cell in cells if cell.data == data]
            panels = [self.panel(own, measure) for measure in self.measures]
            lines += [data, f"  {', '.join(self.settings.values()):32}" + "".join(f"{title:>30}" for title in self.measures.values())]
            names = [self.values(own, field) for field in self.settings]
            for at in np.ndindex(panels[0].shape[:-1]):
                numbers = ["{:.4f} ({:.4f} to {:.4f})".format(*panel[at]) if np.isfinite(panel[at][0]) else "–" for panel in panels]
                setting = ", ".join(str(of[k]) for of, k in zip(names, at, strict=True))
                lines.append(f"  {setting:32}" + "".join(f"{text:>30}" for text in numbers))
            lines += [f"  {line}" for line in self.notes(own)]
        return "\n".join(lines)

    def draw(self, cells: Cells, path: Path) -> None:
        """Write a plot: a row for each data set, a column for each measure, a line for each value of any second setting.

        Points are means, whiskers minimum and maximum over repetitions.
        """
        from matplotlib.figure import Figure

        data = self.values(cells, "data")
        figure = Figure(figsize=(4.2 * len(self.measures), 3.4 * len(data)), layout="constrained")
        axes = figure.subplots(len(data), len(self.measures), squeeze=False)
        for row, name in enumerate(data):
            own = [cell for cell in cells if cell.data == name]
            for axis, (measure, title) in zip(axes[row], self.measures.items(), strict=True):
                self._lines(axis, own, measure)
                axis.set(ylabel=title, title=name)
            if len(self.settings) > 1:
                axes[row, 0].legend()
        with new_file(path) as part:
            figure.savefig(part, dpi=110)

    def _lines(self, axis: Any, cells: Cells, measure: str) -> None:
        (x_field, x_title), *second = self.settings.items()
        x, found = self.values(cells, x_field), self.panel(cells, measure)
        lines = [f"{title} {value}" for field, title in second for value in self.values(cells, field)] or [""]
        places = np.arange(len(x)) if isinstance(x[0], str) else np.array(x)
        for label, of in zip(lines, found.reshape(len(x), len(lines), 3).swapaxes(0, 1), strict=True):
            mean, low, high = of.T
            axis.errorbar(places, mean, [mean - low, high - mean], marker="o", ms=4, capsize=3, label=label)
        axis.set_xlabel(x_title)
        if isinstance(x[0], str):
            axis.set_xticks(places, x, rotation=30, ha="right")
        axis.ticklabel_format(axis="y", useOffset=False)
        axis.grid(alpha=0.3)


def read_cells(path: Path, kind: type[Any]) -> list[Any]:
    """The cells of a file, none where there is no file. Raises ValueError naming the line that is no cell."""
    if not path.is_file():
        return []
    columns = get_type_hints(kind)
    lines = read_lines(path)
    names = next((line.split(",") for _, line in lines), [])
    out = []
    for number, line in lines:
        row = dict(zip(names, next(csv.reader([line])), strict=False))
        try:
            out.append(kind(**{name: column(row[name]) for name, column in columns.items()}))
        except (KeyError, TypeError, ValueError):
            raise ValueError(f"{path}:line {number}: is no cell, needs {', '.join(columns)}") from None
    return out


def write_cells(path: Path, cells: Cells) -> None:
    """Write all cells atomically."""
    with new_file(path) as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(get_type_hints(type(cells[0]))))
        writer.writeheader()
        writer.writerows(asdict(cell) for cell in cells)
