"""A prediction as lines of text: scores and errors by cause, predicted beside real."""

from __future__ import annotations

import math
from collections.abc import Iterator

from sim.prediction.predict import Predicted, Prediction

ROWS = (("MOTA", "mota"), ("IDF1", "idf1"), ("HOTA", "hota"), ("misses", "misses"), ("false positives", "false_positives"), ("switches", "switches"))
"""Title and name of the figures that are shown."""
WIDE = 28


def lines(found: Prediction) -> Iterator[str]:
    """The table: a row for each score, then for each cause of errors that occurs. Columns are detectors, and the real boxes."""
    names = list(found.twins)
    yield f"{'':{WIDE}}" + "".join(f"{name[:WIDE]:>{WIDE}}" for name in names) + (f"{'real':>10}" if found.real else "")
    predicted = {name: found.predicted(name) for name in names}
    for title, key in ROWS:
        digits = 3 if key in ("mota", "idf1", "hota") else 1
        real = "" if found.real is None else _number(found.real.figures[key], 3 if digits == 3 else 0)
        yield _row(title, [predicted[name][key] for name in names], digits, real)
    causes = {name: found.causes(name) for name in names}
    for kind, of in causes[names[0]].items():
        for cause in of:
            values = [causes[name][kind][cause] for name in names]
            count = 0 if found.real is None else found.real.causes[kind][cause]
            if count or any(value.mean for value in values):
                yield _row(f"  {kind}: {cause}", values, 1, "" if found.real is None else str(count))


def _row(title: str, values: list[Predicted], digits: int, real: str) -> str:
    return f"{title:{WIDE}}" + "".join(f"{_text(value, digits):>{WIDE}}" for value in values) + (f"{real:>10}" if real else "")


def _text(value: Predicted, digits: int) -> str:
    interval = "" if value.low is None or value.high is None else f" [{value.low:.{digits}f}, {value.high:.{digits}f}]"
    return _number(value.mean, digits) + interval


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
