"""A sheet of people who are found, people who are missed and false boxes, for each world, cut out of the images of the sources."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from sim.visualization.overlays import draw_text, save_png
from tracker.formats.opening import open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, Image, Ints
from tracker.metrics.box_detection import ImageBoxes, WantedBodies, outcome_of

TILE, ACROSS, MARGIN = (96, 144), 12, 0.35
"""px of a cut-out, across and down; cut-outs of a row; what is shown around a box, as a share of its height."""
KINDS = {"found": (90, 200, 90), "missed": (240, 150, 40), "false": (230, 60, 60)}
"""Kind → RGB of its boxes."""
DARK, LIGHT = 24, (235, 235, 235)


@dataclass(frozen=True, eq=False)
class CutOut:
    """A box to show: source, camera, frame from 0, edges (4,) px, and its text."""

    source: int
    camera: str
    frame: int
    edges: Array
    text: str


def draw_sheet(sources: Mapping[Path, Sequence[ImageBoxes]], wanted: WantedBodies, min_score: float, file: Path) -> None:
    """Write the sheet as PNG. Rows of each world: found boxes from the surest to the least sure, the largest missed bodies, the surest false boxes.

    sources: path → its images, as images_of gives them. Raises ValueError for sources without images, as MOT15 files.
    """
    rows = list(_rows(sources, wanted, min_score))
    tiles = _tiles(list(sources), [one for _, _, cuts in rows for one in cuts])
    strips = []
    for world, kind, cuts in rows:
        pictures = [_framed(tiles.get(id(one)), one, KINDS[kind]) for one in cuts]
        pictures += [np.full((TILE[1], TILE[0], 3), DARK, np.uint8)] * (ACROSS - len(pictures))
        strip = cv2.copyMakeBorder(np.hstack(pictures), 22, 4, 4, 4, cv2.BORDER_CONSTANT, value=(DARK,) * 3)
        draw_text(strip, f"{world}: {kind}", (8, 16), 0.5, KINDS[kind])
        strips.append(strip)
    save_png(file, np.asarray(np.vstack(strips), dtype=np.uint8))


def _rows(sources: Mapping[Path, Sequence[ImageBoxes]], wanted: WantedBodies, min_score: float) -> Iterator[tuple[str, str, list[CutOut]]]:
    """World, kind and boxes of each row."""
    for world in sorted({image.world for images in sources.values() for image in images}):
        every: dict[str, list[tuple[float, CutOut]]] = {kind: [] for kind in KINDS}
        for k, images in enumerate(sources.values()):
            for image in images:
                if image.world != world or image.frame < 0:
                    continue
                outcome = outcome_of(image, min_score, wanted)
                for kind, boxes in (("found", outcome.found), ("false", outcome.false)):
                    every[kind] += [(image.score[i], _cut(k, image, image.found[i], f"{image.score[i]:.2f}")) for i in boxes.tolist()]
                every["missed"] += [(one.edges[3] - one.edges[1], one) for one in _missed(k, image, outcome.missed)]
        for kind, cuts in every.items():
            order = sorted(range(len(cuts)), key=lambda i: -cuts[i][0])
            # Found boxes are many, so a sample from the surest to the least sure is shown.
            chosen = order[:: max(1, len(order) // ACROSS)] if kind == "found" else order
            yield world, kind, [cuts[i][1] for i in chosen[:ACROSS]]


def _missed(source: int, image: ImageBoxes, rows: Ints) -> list[CutOut]:
    shares = ["" if np.isnan(seen) else f"seen {seen:.2f}" for seen in image.visible[rows]]
    return [_cut(source, image, image.truth[i], share) for i, share in zip(rows.tolist(), shares, strict=True)]


def _cut(source: int, image: ImageBoxes, edges: Array, text: str) -> CutOut:
    return CutOut(source, image.camera, image.frame, edges, text)


def _tiles(paths: list[Path], cuts: list[CutOut]) -> dict[int, Image]:
    """Images of cut-outs by their `id`: the part of the image around each box, at the size of a tile."""
    out = {}
    for k, path in enumerate(paths):
        if path.is_file():
            raise ValueError(f"{path}: has no images, which --sheet needs, as folders of recordings and sequences have")
        wanted = [one for one in cuts if one.source == k]
        sequence = open_sequence(path, SourceOptions.parse(images=True, pixels=True), calibrated=False)
        for tick in sequence.ticks:
            for view in tick.views:
                for one in wanted:
                    if (one.frame, one.camera) == (tick.index, view.camera) and view.image is not None:
                        out[id(one)] = _part(view.image, one.edges, sequence.setup.mounts[view.camera].camera.wraps)
            if tick.index >= max((one.frame for one in wanted), default=0):
                break
    return out


def _part(image: Image, edges: Array, wraps: bool) -> Image:
    """The surroundings of a box at the size of a tile, with the box drawn."""
    left, top, right, bottom = edges
    half = max((bottom - top) * (0.5 + MARGIN), (right - left) * 0.75 * TILE[1] / TILE[0], 8.0)
    across, x, y = half * TILE[0] / TILE[1], (left + right) / 2, (top + bottom) / 2
    columns = np.arange(round(x - across), max(round(x + across), round(x - across) + 1))
    rows = np.clip(np.arange(round(y - half), round(y + half)), 0, len(image) - 1)
    columns = columns % image.shape[1] if wraps else np.clip(columns, 0, image.shape[1] - 1)
    tile = cv2.resize(np.ascontiguousarray(image[rows][:, columns]), TILE, interpolation=cv2.INTER_AREA)
    scale = TILE[1] / (2 * half)
    corners = [(round((u - x + across) * scale), round((v - y + half) * scale)) for u, v in ((left, top), (right, bottom))]
    cv2.rectangle(tile, corners[0], corners[1], LIGHT, 1)
    return np.asarray(tile, np.uint8)


def _framed(tile: Image | None, one: CutOut, colour: tuple[int, int, int]) -> Image:
    """A tile with its border and text; dark where the source has no image of that moment."""
    picture = np.full((TILE[1], TILE[0], 3), DARK, np.uint8) if tile is None else np.array(tile)
    cv2.rectangle(picture, (0, 0), (TILE[0] - 1, TILE[1] - 1), colour, 2)
    draw_text(picture, one.text, (5, TILE[1] - 7), 0.38, LIGHT)
    return picture
