"""A picture of a recording's calibration: the plan, and for each camera the ground grid, the horizon, true people and boxes in its image."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.collections
import matplotlib.figure
import matplotlib.layout_engine
import matplotlib.patches
import matplotlib.patheffects
import numpy as np

from sim.visualization.overlays import BODY, COLOURS, INK, body_corners, save_figure
from tracker.geometry import Array, Image, Ints, Mask
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.calibration_check import CalibrationReport, CameraCheck
from tracker.recordings.calibration_feet import CalibrationCase

TRUTH, SKY, FLOOR = "#1a1a1a", "#eef2f6", "#d9d7d0"
MOST_VIEWS = 12
"""Largest number of cameras whose images are drawn."""
COLUMNS, ROWS = 72, 48
"""Numbers of pixels across and down at which the footprint of a camera is sampled."""
LINE_STEP = 0.1
"""m along a grid line."""
MOST_LINES = 60
"""Grid lines each way; wider areas have a wider grid."""
FARTHEST = 1.6
"""Cameras farther from the middle of the bounds than so many diagonals are left out of the plan."""
MOST_FEET = 3000
"""Largest number of feet per camera that are drawn."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Data that the panels share. colours: by camera. bounds (2, 2) m: where the grid is drawn. frame: shown in views."""

    recording: Recording
    case: CalibrationCase
    colours: dict[str, str]
    bounds: Array
    frame: int
    paths: tuple[Array, ...] = ()


def draw_calibration(recording: Recording, report: CalibrationReport, path: Path, paths: tuple[Array, ...] = ()) -> None:
    """Write the picture as PNG. paths: of people (n, 2) m each, as a calibration found them, drawn on the plan.

    Raises ValueError where images cannot be read, OSError where the file cannot be written.
    """
    scene = replace(_scene(recording), paths=paths)
    shown = report.cameras[:MOST_VIEWS]
    columns = 1 if len(shown) == 1 else 2 if len(shown) <= 8 else 3
    rows = max(1, -(-len(shown) // columns))
    layout = matplotlib.layout_engine.ConstrainedLayoutEngine(rect=(0, 0.03, 1, 0.97))
    figure: Any = matplotlib.figure.Figure(figsize=(7.5 + 4.3 * columns, max(5.5, 2.75 * rows) + 0.9), layout=layout)
    figure.suptitle(_title(report), fontsize=13, x=0.01, ha="left", color="#a01010" if report.findings else INK)
    figure.text(0.99, 0.005, _key(scene), ha="right", va="bottom", fontsize=9, color=INK)
    plan, views = figure.subfigures(1, 2, width_ratios=(7.5, 4.3 * columns))
    _plan(plan.add_subplot(), scene)
    for k, check in enumerate(shown):
        _view(views.add_subplot(rows, columns, k + 1), scene, check)
    save_figure(path, figure)


def _key(scene: Scene) -> str:
    bodies = f"; dashed: bodies of {BODY[1]} m at true places" if scene.recording.truth else ""
    return f"Views of frame {scene.frame + 1}: boxes and their feet{bodies}; ground grid of {_cell(scene.bounds):g} m; blue: horizon"


def _cell(bounds: Array) -> float:
    """m: spacing of the ground grid."""
    side = float(max(bounds[1] - bounds[0]))
    return next((cell for cell in (1.0, 2.0, 5.0, 10.0, 50.0, 100.0) if side / cell <= MOST_LINES), side / MOST_LINES)


def _title(report: CalibrationReport) -> str:
    if not report.findings:
        return "Nothing looks wrong" if any(one.boxes for one in report.cameras) else "No boxes: the calibration cannot be tested"
    return "\n".join(f"Looks wrong: {_wrapped(finding.words)}" for finding in report.findings[:3])


def _wrapped(words: str) -> str:
    return words if len(words) <= 130 else f"{words[:129].rsplit(' ', 1)[0]} …"


def _scene(recording: Recording) -> Scene:
    recording = recording.in_step()
    case = CalibrationCase.of(recording)
    colours = {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(recording.fixed)}
    places = np.array([camera.pose.translation[:2] for camera in recording.fixed.values()]).reshape(-1, 2)
    if case.area is not None:
        bounds = case.area
    else:
        points = [case.truth.point] if case.truth is not None else [case.feet(name).point for name in case.lenses]
        known = np.concatenate([p[np.isfinite(p[:, 0])] for p in points] + [places])
        bounds = np.percentile(known, [2, 98], axis=0) if len(known) else np.array([[-5.0, -5.0], [5.0, 5.0]])
        bounds = np.stack([np.floor(bounds[0] - 0.5), np.ceil(bounds[1] + 0.5)])
    return Scene(recording, case, colours, bounds, _busiest(recording))


def _busiest(recording: Recording) -> int:
    """The frame with the most boxes, counting at most 12 per camera, among the frames with true people where there are some."""
    counts = dict.fromkeys(range(recording.frames), 0)
    for name in recording.fixed:
        for frame, (boxes, _) in recording.detections.get(name, {}).items():
            counts[frame] += min(len(boxes), 12)
    if recording.truth:
        known = [frame for frame in counts if frame in recording.truth and len(recording.truth[frame][0])]
        counts = {frame: counts[frame] for frame in known} or counts
    return max(counts, key=lambda frame: (counts[frame], -frame), default=0)


def _plan(axes: Any, scene: Scene) -> None:
    """Ground from above: footprints and feet of cameras in their colours, true paths, and the area."""
    case = scene.case
    for name, camera in scene.recording.fixed.items():
        # Fields of view are drawn as far as the farthest corner of the bounds.
        reach = float(np.linalg.norm(np.abs(scene.bounds - camera.pose.translation[:2]).max(axis=0)))
        outline = footprint(camera, case, reach)
        if len(outline):
            axes.add_patch(matplotlib.patches.Polygon(outline, facecolor=scene.colours[name], alpha=0.07, zorder=1))
            axes.add_patch(matplotlib.patches.Polygon(outline, fill=False, edgecolor=scene.colours[name], linewidth=0.9, alpha=0.8, zorder=2))
        point = case.sampled_feet(name).point
        axes.scatter(*point[:: 1 + len(point) // MOST_FEET].T, s=5, color=scene.colours[name], alpha=0.45, linewidths=0, zorder=4)
    if case.truth is not None:
        paths = [case.truth.point[rows] for rows in _paths(case.truth.id, case.truth.frame)]
        axes.add_collection(matplotlib.collections.LineCollection(paths, colors=TRUTH, linewidths=0.6, alpha=0.5, zorder=3))
    if scene.paths:
        axes.add_collection(matplotlib.collections.LineCollection(scene.paths, colors=TRUTH, linewidths=0.6, alpha=0.6, zorder=5))
    if case.area is not None:
        axes.add_patch(
            matplotlib.patches.Rectangle(case.area[0], *(case.area[1] - case.area[0]), fill=False, edgecolor=INK, linestyle="--", zorder=5)
        )
    near, far = _near_cameras(scene)
    corners = np.concatenate([scene.bounds, *(camera.pose.translation[None, :2] for camera in near.values())])
    for name, camera in near.items():
        _camera(axes, camera, name, scene.colours[name], 0.03 * float(np.ptp(corners, axis=0).max()) + 0.1)
    if far:
        axes.text(0.01, 0.01, f"outside the plan: {', '.join(far)}", transform=axes.transAxes, fontsize=9, color=INK, zorder=9)
    margin = 0.08 * np.ptp(corners, axis=0).max() + 0.3
    axes.set_xlim(corners[:, 0].min() - margin, corners[:, 0].max() + margin)
    axes.set_ylim(corners[:, 1].min() - margin, corners[:, 1].max() + margin)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.grid(color="#e3e5e8", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    truth = "; black: paths of people" if scene.paths else "; black: true paths" if case.truth is not None else ""
    axes.set_title(f"Plan: dots are feet of boxes{truth}{'; dashed: area' if case.area is not None else ''}", fontsize=10, loc="left", color=INK)


def _near_cameras(scene: Scene) -> tuple[dict[str, RecordingCamera], list[str]]:
    """The cameras that stand near the bounds, and the names of the others, which would make the plan small."""
    low, high = scene.bounds
    most = FARTHEST * float(np.linalg.norm(high - low))
    near = {name: camera for name, camera in scene.recording.fixed.items() if np.linalg.norm(camera.pose.translation[:2] - (low + high) / 2) < most}
    return near, [name for name in scene.recording.fixed if name not in near]


def _paths(ids: Ints, frame: Ints) -> Iterable[Ints]:
    """Rows of each person in the order of frames, split where frames are missing."""
    step = max(1, int(np.diff(np.unique(frame)).min(initial=1 << 30))) if len(np.unique(frame)) > 1 else 1
    order = np.lexsort([frame, ids])
    cut = np.flatnonzero((np.diff(ids[order]) != 0) | (np.diff(frame[order]) > step)) + 1
    return np.split(order, cut)


def _camera(axes: Any, camera: RecordingCamera, name: str, colour: str, size: float) -> None:
    """A wedge of `size` m at the camera's place that opens where it looks, and its name."""
    place, ahead = camera.pose.translation[:2], (camera.pose.rotation @ [1.0, 0.0, 0.0])[:2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    left = np.array([-ahead[1], ahead[0]])
    shape = [place - 0.4 * size * ahead, place + size * (ahead + 0.55 * left), place + size * (ahead - 0.55 * left)]
    axes.add_patch(matplotlib.patches.Polygon(shape, facecolor=colour, edgecolor="white", linewidth=1.0, zorder=7))
    text = axes.annotate(name, place - 1.1 * size * ahead, color=colour, fontsize=10, fontweight="bold", ha="center", va="center", zorder=8)
    text.set_path_effects([matplotlib.patheffects.withStroke(linewidth=2.5, foreground="white")])
    text.set_clip_on(True)


def footprint(camera: RecordingCamera, case: CalibrationCase, reach: float) -> Array:
    """Outline (n, 2) m of the ground that a camera sees within `reach` m; empty where it sees none."""
    lens, origin = camera.camera, camera.pose.translation
    if origin[2] <= case.ground.height_at(origin[None])[0]:
        return np.zeros((0, 2))
    u, v = np.meshgrid(np.linspace(0, lens.width, COLUMNS), np.linspace(0, lens.height, ROWS))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays = lens.bearings_from_pixels(pixels) @ camera.pose.rotation.T
    point, hit = case.ground.intersect(np.broadcast_to(origin, rays.shape), rays, 50 * reach)
    hit &= ~lens.blind(pixels)
    away = point[:, :2] - origin[:2]
    distance = np.where(hit, np.hypot(*away.T), np.nan).reshape(ROWS, COLUMNS)
    seen = np.flatnonzero((np.isfinite(distance) & (distance < reach)).any(axis=0))
    if len(seen) < 2:
        return np.zeros((0, 2))
    toward = (away / np.maximum(np.hypot(*away.T), 1e-9)[:, None]).reshape(ROWS, COLUMNS, 2)
    # Each column of the image sees ground from its first to its last row that meets it.
    ground = np.isfinite(distance[:, seen])
    first, last = ground.argmax(axis=0), ROWS - 1 - ground[::-1].argmax(axis=0)
    edges = [origin[:2] + np.minimum(distance[row, seen], reach)[:, None] * toward[row, seen] for row in (first, last)]
    return np.concatenate([edges[0], edges[1][::-1]])


def _view(axes: Any, scene: Scene, check: CameraCheck) -> None:
    """The image of a camera, or an empty canvas, with grid, horizon, true people and boxes."""
    name, camera = check.name, scene.recording.fixed[check.name]
    lens = camera.camera
    image = _image(scene, name)
    if image is not None:
        axes.imshow(image, extent=(0, lens.width, lens.height, 0), zorder=0, alpha=0.8)
    else:
        axes.set_facecolor(FLOOR)
        _sky(axes, camera)
    light = image is None
    lines = _grid_lines(scene, camera)
    axes.add_collection(matplotlib.collections.LineCollection(lines, colors="#8f948c" if light else "#ffe14d", linewidths=0.5, alpha=0.8, zorder=2))
    axes.add_collection(matplotlib.collections.LineCollection(_horizon(camera), colors="#3b7dd8", linewidths=1.2, zorder=2))
    _bodies(axes, scene, camera, TRUTH if light else "#ffffff")
    boxes, _ = scene.recording.detections.get(name, {}).get(scene.frame, (np.zeros((0, 4)), None))
    for left, top, width, height in boxes.tolist():
        axes.add_patch(matplotlib.patches.Rectangle((left, top), width, height, fill=False, edgecolor=scene.colours[name], linewidth=1.3, zorder=5))
    axes.scatter(
        boxes[:, 0] + boxes[:, 2] / 2, boxes[:, 1] + boxes[:, 3], s=14, color=scene.colours[name], edgecolors="white", linewidths=0.6, zorder=6
    )
    axes.set_xlim(0, lens.width)
    axes.set_ylim(lens.height, 0)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(scene.colours[name])
        spine.set_linewidth(1.6)
    axes.set_title(_caption(check), fontsize=9, loc="left", color=scene.colours[name])


def _caption(check: CameraCheck) -> str:
    if check.distance is None:
        return f"{check.name}: no feet to compare"
    return f"{check.name}: feet {check.distance:.2f} m from {'truth' if check.compared == 'truth' else 'those of other cameras'} (median)"


def _image(scene: Scene, name: str) -> Image | None:
    source, camera = scene.recording.images.get(name), scene.recording.cameras[name].camera
    if source is None:
        return None
    with closing(source.cut(scene.frame, scene.frame + 1).images(1, (camera.height, camera.width))) as images:  # type: ignore[type-var]
        return next(images, None)


def _runs(pixels: Array, inside: Mask, width: int) -> list[Array]:
    """The parts of a curve of pixels (n, 2) in the image, split where it leaves the image or crosses the seam."""
    out = []
    joined = inside[1:] & inside[:-1] & (np.abs(np.diff(pixels[:, 0])) < width / 2)
    for rows in np.split(np.arange(len(pixels)), np.flatnonzero(~joined) + 1):
        if len(rows) > 1:
            out.append(pixels[rows])
    return out


def _projected(camera: RecordingCamera, points: Array) -> tuple[Array, Mask]:
    """World points (n, 3) m → pixels (n, 2) and whether each is in the image."""
    sight = (points - camera.pose.translation) @ camera.pose.rotation
    pixels, inside = camera.camera.pixels_from_bearings(sight / np.maximum(np.linalg.norm(sight, axis=1), 1e-9)[:, None])
    return pixels, inside & np.isfinite(pixels).all(axis=1)


def _grid_lines(scene: Scene, camera: RecordingCamera) -> list[Array]:
    """The grid of 1 m on the ground, as curves of pixels; of 2, 5, 10 ... m where the area is wide."""
    low, high = scene.bounds
    cell = _cell(scene.bounds)
    out: list[Array] = []
    for axis in (0, 1):
        along = np.linspace(low[1 - axis], high[1 - axis], min(2000, 2 + int((high - low)[1 - axis] / (LINE_STEP * cell))))
        for value in np.arange(np.ceil(low[axis] / cell) * cell, high[axis] + 1e-9, cell):
            plane = np.column_stack([np.full_like(along, value), along][:: 1 if axis == 0 else -1])
            points = np.column_stack([plane, scene.case.ground.height_at(plane)])
            out += _runs(*_projected(camera, points), camera.camera.width)
    return out


def _horizon(camera: RecordingCamera) -> list[Array]:
    """The parts of the horizon in the image, as curves of pixels (n, 2)."""
    azimuth = np.linspace(-np.pi, np.pi, 1441)
    level = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)]) * 1e6 + camera.pose.translation
    return _runs(*_projected(camera, level), camera.camera.width)


def _sky(axes: Any, camera: RecordingCamera) -> None:
    """Fill an empty canvas above the horizon, by the elevation of its pixels."""
    lens = camera.camera
    u, v = np.meshgrid((np.arange(160) + 0.5) * lens.width / 160, (np.arange(90) + 0.5) * lens.height / 90)
    up = (lens.bearings_from_pixels(np.column_stack([u.ravel(), v.ravel()])) @ camera.pose.rotation.T)[:, 2].reshape(u.shape)
    axes.contourf(u, v, up, levels=[0.0, 2.0], colors=[SKY], zorder=0.5)


def _bodies(axes: Any, scene: Scene, camera: RecordingCamera, colour: str) -> None:
    """Upright bodies at the true places of the frame."""
    if not scene.recording.truth or scene.frame not in scene.recording.truth:
        return
    for place in scene.recording.truth[scene.frame][1]:
        around = body_corners(camera.pose, place)[[0, 2, 3, 1]]
        pixels, inside = _projected(camera, np.array([*around, place]))
        if inside[4] and np.isfinite(pixels).all() and np.ptp(pixels[:, 0]) < camera.camera.width / 2:
            axes.add_patch(matplotlib.patches.Polygon(pixels[:4], fill=False, edgecolor=colour, linewidth=1.0, linestyle=(0, (3, 2)), zorder=4))
            axes.scatter(*pixels[4], s=16, marker="x", color=colour, linewidths=1.2, zorder=4)
