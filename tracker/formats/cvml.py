"""Truth in the image of one camera as PETS 2009 and CAVIAR have it (CVML, XML): frames from 0, boxes by their centres.

Pixels are those of the camera's calibration: their centres lie at whole numbers.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from tracker.atomic import write_text
from tracker.formats.markup import Element, parse
from tracker.formats.motchallenge import Ints, number
from tracker.geometry import Array

Annotations = dict[int, tuple[Ints, Array]]


def read_annotations(path: str | os.PathLike[str]) -> Annotations:
    """A CVML file → frame (from 0) → ids (m,) and boxes (m, 4) left, top, width, height px; frames without people are there, empty.

    The box's centre is spelled xc, yc or, as the older CAVIAR files have it, x, y. Raises ValueError naming file, line and field: not
    XML, a frame twice, an id twice in a frame, a size that is not above 0, a number that is none.
    """
    out: Annotations = {}
    for frame in parse(path, "dataset").every("frame"):
        number = frame.whole("number")
        if number < 0 or number in out:
            fault = "comes twice" if number in out else "is below 0"
            raise ValueError(f"{path}:line {frame.line}: field frame.number {number} {fault}")
        objects = [o for group in frame.every("objectlist") for o in group.every("object")]
        ids: list[int] = []
        for item in objects:
            ids.append(item.whole("id"))
            if ids[-1] in ids[:-1]:
                raise ValueError(f"{path}:line {item.line}: field object.id {ids[-1]} comes twice in frame {number}")
        boxes = np.array([_box(item.find("box")) for item in objects]).reshape(-1, 4)
        out[number] = np.array(ids, dtype=np.int64), boxes
    return dict(sorted(out.items()))


def _box(box: Element) -> list[float]:
    w, h = box.number("w"), box.number("h")
    for name, size in (("w", w), ("h", h)):
        if not size > 0:
            raise ValueError(f"{box.where}:line {box.line}: field box.{name} is {size}, needs more than 0")
    return [box.number("xc", "x") - w / 2, box.number("yc", "y") - h / 2, w, h]


def write_annotations(path: Path, name: str, annotations: Annotations) -> None:
    """The file that read_annotations reads, of a dataset of that name. Raises ValueError naming frame and id for a size that is not above 0."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<dataset name={quoteattr(name)}>"]
    for frame, (ids, boxes) in sorted(annotations.items()):
        lines += [f'  <frame number="{frame}">', "    <objectlist>"]
        for person, (left, top, w, h) in zip(ids.tolist(), np.asarray(boxes).tolist(), strict=True):
            if not (w > 0 and h > 0):
                raise ValueError(f"frame {frame}: the box of id {person} is {w} x {h} px, needs more than 0")
            size, centre = f'h="{number(h)}" w="{number(w)}"', f'xc="{number(left + w / 2)}" yc="{number(top + h / 2)}"'
            lines.append(f'      <object id="{person}"><box {size} {centre}/></object>')
        lines += ["    </objectlist>", "  </frame>"]
    write_text(path, "\n".join([*lines, "</dataset>", ""]))
