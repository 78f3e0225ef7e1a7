"""Overlays of boxes and ids on images, contact sheets, and PNG files."""

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
"""m: width and height of the box that stands for a person."""
STANDING = 0.25
"""m: height above the terrain from which something is drawn as an object."""


def colour_of(identity: int) -> tuple[int, int, int]:
    """RGB colour of an id. Consecutive ids have very different hues."""
    hue = (identity * 0.61803398875) % 1.0
    rgb = matplotlib.colors.hsv_to_rgb((hue, 0.75, 1.0))
    return int(255 * rgb[0]), int(255 * rgb[1]), int(255 * rgb[2])


def draw_boxes(image: Image, camera: Camera, T_world_camera: Pose, ids: Iterable[int], places: Array) -> Image:
    """Draw the id of every estimate and the box of a person at its place (n, 3) m, world. Boxes may cross the seam of an image that wraps.

    People who are out of view of the camera, or partly behind it, are not drawn. A contiguous image is drawn on in place.
    """
    out = np.ascontiguousarray(image)
    width, thick = camera.width, max(1, camera.width // 512)
    for identity, place in zip(ids, places, strict=True):
        sight = place - T_world_camera.translation
        side = np.cross([0.0, 0.0, 1.0], sight / max(float(np.linalg.norm(sight)), 1e-6)) * BODY[0] / 2
        corners = np.array([place + s * side + [0.0, 0.0, h] for s in (-1, 1) for h in (0.0, BODY[1])])
        bearings = T_world_camera.inverse().apply(corners)
        pixels, inside = camera.pixels_from_bearings(bearings / np.linalg.norm(bearings, axis=1, keepdims=True))
        if not (inside.any() and np.isfinite(pixels).all()):
            continue
        # OpenCV draws with 32-bit numbers; a corner beside the camera may lie farther out.
        pixels = np.clip(pixels, -16 * width, 16 * width)
        u = pixels[:, 0]
        if camera.wraps:
            u = u[0] + np.mod(u - u[0] + width / 2, width) - width / 2
        low, high = np.array([u.min(), pixels[:, 1].min()]), np.array([u.max(), pixels[:, 1].max()])
        for shift in (-width, 0, width) if camera.wraps else (0,):
            a, b = ((corner + np.array([shift, 0.0])).round().astype(int).tolist() for corner in (low, high))
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
    """Camera → panorama of this tick with the estimates, projected by the estimated poses of the robots."""
    out = {}
    ids, places = results.tracks.get(tick.index, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
    for view in tick.views:
        mount: Mount = sequence.setup.mounts[view.camera]
        pose = results.poses[mount.robot][tick.index]
        if view.image is not None and pose is not None and mount.camera.wraps:
            out[view.camera] = draw_boxes(view.image, mount.camera, pose @ mount.T_body_camera, ids.tolist(), places)
    return out


def contact_sheet(images: dict[str, Image], caption: str) -> Image:
    """One image with all panoramas in two columns, their names, and a caption."""
    tiles = []
    for name, image in images.items():
        tile = cv2.copyMakeBorder(image, 34, 6, 4, 4, cv2.BORDER_CONSTANT, value=(24, 24, 28))
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
