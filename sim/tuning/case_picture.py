"""A picture of a case: a plan with true paths, and the boxes of each camera in one frame."""

from __future__ import annotations

import io
from collections import defaultdict
from typing import Any

import matplotlib.figure
import matplotlib.patches
import numpy as np

from sim.tuning.case_file import PopulationCase
from tracker.geometry import Array
from tracker.recordings import RecordingCamera

COLUMNS = 3
MOST_VIEWS = 5
"""Cameras that are drawn."""


def draw_case_picture(case: PopulationCase) -> bytes:
    """A PNG of the middle frame."""
    recording, frame = case.recording, case.recording.frames // 2
    cameras = list(recording.cameras.items())[:MOST_VIEWS]
    rows = -(-(1 + len(cameras)) // COLUMNS)
    figure = matplotlib.figure.Figure(figsize=(10.0, 3.2 * rows), layout="constrained")
    _plan(figure.add_subplot(rows, COLUMNS, 1), case, frame)
    for k, (name, camera) in enumerate(cameras):
        _view(figure.add_subplot(rows, COLUMNS, k + 2), case, (name, camera), frame)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=90, metadata={"Software": None})
    return out.getvalue()


def _plan(axes: Any, case: PopulationCase, frame: int) -> None:
    recording, paths = case.recording, defaultdict[int, list[Array]](list)
    for ids, feet in (recording.truth or {}).values():
        for person, place in zip(ids.tolist(), feet, strict=True):
            paths[person].append(place[:2])
    for places in paths.values():
        axes.plot(*np.array(places).T, linewidth=0.6, color="#888888")
    for x, y, radius, _, _ in recording.pillars:
        axes.add_patch(matplotlib.patches.Circle((x, y), radius, color="#cccccc"))
    axes.scatter(*(recording.truth or {})[frame][1][:, :2].T, s=12, color="#D55E00", zorder=3)
    for camera in recording.cameras.values():
        pose = recording.pose_at(camera, frame)
        if pose is not None:
            ahead = np.stack([pose.translation[:2], pose.translation[:2] + pose.rotation[:2, 0]])
            axes.plot(*ahead.T, color="#0072B2", marker="^", markevery=[0], markersize=5)
    axes.set(title=f"{case.name}, frame {frame}", aspect="equal", xlabel="m")
    axes.title.set_fontsize(9)


def _view(axes: Any, case: PopulationCase, named: tuple[str, RecordingCamera], frame: int) -> None:
    """Boxes with their confidences; crosses are true feet where the tracker is told that they are."""
    recording, (name, camera) = case.recording, named
    boxes, confidence = recording.detections[name].get(frame, (np.zeros((0, 4)), np.zeros(0)))
    for (left, top, width, height), sure in zip(boxes.tolist(), confidence.tolist(), strict=True):
        axes.add_patch(matplotlib.patches.Rectangle((left, top), width, height, fill=False, color="#0072B2", linewidth=0.8))
        axes.text(left, top, f"{sure:.2g}", fontsize=5)
    pose, feet = recording.pose_at(camera, frame), (recording.truth or {})[frame][1]
    if pose is not None and len(feet):
        away = pose.inverse().apply(feet)
        pixels, inside = camera.camera.pixels_from_bearings(away / np.linalg.norm(away, axis=1, keepdims=True))
        axes.plot(*pixels[inside].T, "+", color="#D55E00", markersize=5)
    axes.set(title=name, xlim=(0, camera.camera.width), ylim=(camera.camera.height, 0), aspect="equal")
    axes.title.set_fontsize(9)
    axes.tick_params(labelsize=6)
