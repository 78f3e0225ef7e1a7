"""Functions that pictures share: colours, the box of a person in an image, text on images, contact sheets, and PNG files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np

from tracker.geometry import Array, Image, Pose
from tracker.geometry.cameras import Camera
from tracker.io.atomic import new_file
from tracker.sequence.results import Results
from tracker.types import Mount, Sequence, Tick

BODY = (0.55, 1.75)
"""m: width and height of the body that stands for a person."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#6a3d9a", "#8c510a")
"""Colours of cameras or other lists, in turn: those of Okabe and Ito (2008) that are dark enough on white, and three more."""
INK = "#30343a"
"""Colour of text in figures."""
DPI = 110
"""Pixels per inch of figures."""
STANDING = 0.25
"""m: height above the terrain from which something is drawn as an object."""


def colour_of(identity: int) -> tuple[int, int, int]:
    """RGB colour of an id. Consecutive ids have very different hues."""
    hue = (identity * 0.61803398875) % 1.0
    rgb = matplotlib.colors.hsv_to_rgb((hue, 0.75, 1.0))
    return int(255 * rgb[0]), int(255 * rgb[1]), int(255 * rgb[2])


def body_corners(T_world_camera: Pose, place: Array) -> Array:
    """Corners (4, 3) m, world, of an upright body at a place (3,) m that faces the camera: right low, right high, left low, left high."""
    x, y, _ = place - T_world_camera.translation
    side = np.array([-y, x, 0.0]) / max(float(np.hypot(x, y)), 1e-6) * BODY[0] / 2
    return np.array([place + s * side + [0.0, 0.0, h] for s in (-1, 1) for h in (0.0, BODY[1])])


def body_box(camera: Camera, T_world_camera: Pose, place: Array) -> Array | None:
    """Left, top, right, bottom px of a person who stands at a place (3,) m, world. It may reach beyond the seam of an image that wraps.

    None for people who are out of view of the camera, or partly behind it.
    """
    bearings = T_world_camera.inverse().apply(body_corners(T_world_camera, place))
    pixels, inside = camera.pixels_from_bearings(bearings / np.linalg.norm(bearings, axis=1, keepdims=True))
    if not (inside.any() and np.isfinite(pixels).all()):
        return None
    # OpenCV draws with 32-bit numbers; a corner beside the camera may lie farther out.
    u, v = np.clip(pixels, -16 * camera.width, 16 * camera.width).T
    if camera.wraps:
        u = u[0] + np.mod(u - u[0] + camera.width / 2, camera.width) - camera.width / 2
    return np.array([u.min(), v.min(), u.max(), v.max()])


def draw_boxes(image: Image, camera: Camera, T_world_camera: Pose, ids: Iterable[int], places: Array) -> Image:
    """Draw the id of every estimate and the box of a person at its place (n, 3) m, world. Boxes may cross the seam of an image that wraps.

    People who are out of view of the camera, or partly behind it, are not drawn. A contiguous image is drawn on in place.
    """
    out = np.ascontiguousarray(image)
    width, thick = camera.width, max(1, camera.width // 512)
    for identity, place in zip(ids, places, strict=True):
        box = body_box(camera, T_world_camera, place)
        if box is None:
            continue
        for shift in (-width, 0, width) if camera.wraps else (0,):
            a, b = (box + np.array([shift, 0.0, shift, 0.0])).round().astype(int).reshape(2, 2).tolist()
            if b[0] >= 0 and a[0] < width:
                cv2.rectangle(out, a, b, colour_of(identity), thick, cv2.LINE_AA)
                draw_text(out, str(identity), (a[0], a[1] - 4), 0.5 * camera.width / 1024, colour_of(identity))
    return out


def draw_text(image: Any, text: str, at: tuple[int, int], size: float, colour: tuple[int, int, int]) -> None:
    # A thicker font would be wider. Hence the dark outline is the same text, shifted by a pixel.
    for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        cv2.putText(image, text, (at[0] + dx, at[1] + dy), cv2.FONT_HERSHEY_SIMPLEX, size, (0, 0, 0), 1, cv2.LINE_AA)
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def annotated(sequence: Sequence, results: Results, tick: Tick) -> dict[str, Image]:
    """Camera → image of this tick with the estimates, projected by the estimated poses of the robots and the known ones of fixed cameras."""
    out = {}
    ids, places = results.tracks.get(tick.index, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
    for view in tick.views:
        mount: Mount = sequence.setup.mounts[view.camera]
        start = sequence.setup.starts[mount.robot]
        fixed = start.T_world_robot if start is not None and sequence.setup.is_fixed(mount.robot) else None
        pose = fixed or results.poses[mount.robot][tick.index]
        if view.image is not None and pose is not None:
            out[view.camera] = draw_boxes(view.image, mount.camera, pose @ mount.T_body_camera, ids.tolist(), places)
    return out


def contact_sheet(images: dict[str, Image], caption: str) -> Image:
    """One image with all images in two columns, their names, and a caption."""
    tiles = []
    height, width = (max((image.shape[axis] for image in images.values()), default=64) for axis in (0, 1))
    for name, image in images.items():
        below, beside = height - image.shape[0], width - image.shape[1]
        tile = cv2.copyMakeBorder(image, 34, 6 + below, 4, 4 + beside, cv2.BORDER_CONSTANT, value=(24, 24, 28))
        draw_text(tile, name.replace("_", " "), (12, 24), 0.7, (235, 235, 235))
        tiles.append(tile)
    if len(tiles) % 2:
        tiles.append(np.full_like(tiles[0], 24))
    rows = [np.hstack(tiles[k : k + 2]) for k in range(0, len(tiles), 2)]
    sheet = cv2.copyMakeBorder(np.vstack(rows), 0, 40, 0, 0, cv2.BORDER_CONSTANT, value=(24, 24, 28))
    draw_text(sheet, caption, (12, sheet.shape[0] - 14), 0.7, (235, 235, 235))
    return np.asarray(sheet, dtype=np.uint8)


def save_png(path: Path, image: Image) -> None:
    """Write an RGB image atomically. Raises ValueError if it cannot be encoded."""
    ok, data = cv2.imencode(".png", image[:, :, ::-1])
    if not ok:
        raise ValueError(f"{path}: this image cannot be written as PNG")
    with new_file(path) as part:
        part.write_bytes(data.tobytes())


def save_figure(path: Path, figure: Any) -> None:
    """Write a figure of matplotlib as PNG on white, atomically. Raises OSError where the file cannot be written."""
    # The layout settles in the second of two passes.
    figure.draw_without_rendering()
    with new_file(path) as part:
        figure.savefig(part, format="png", dpi=DPI, facecolor="white", metadata={"Software": None})
