"""The worst moments of a run: errors of consecutive frames that belong together, the longest first, with pictures.

A picture has a map of the surroundings, and crops of the two panoramas that show most of the person.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sim.stress.error_causes import Mistake, TrialEvidence
from sim.stress.trial_data import TrialData
from sim.visualization.overlays import body_box, colour_of, draw_text, save_png
from sim.visualization.plan_and_video import TerrainImage
from tracker.geometry import Array, Image, Pose, angles_from_bearing
from tracker.geometry.cameras import PanoramicCamera
from tracker.geometry.ground import Grid
from tracker.sequence.results import Results

MAX_MOMENTS = 10
"""Largest number of moments of a run."""

MAX_ALIKE = 4
"""Largest number of moments of one kind and cause."""

MAX_GAP = 2
"""Consecutive frames without the error that do not end a moment."""

MAX_PICTURES = 3
"""Largest number of moments of a run that have pictures."""

MAP_SIZE, MAP_RADIUS = 640, 5.0
"""Width of the map, pixels, and half of it, m."""

TRAIL = 9
"""Number of past frames that the map shows."""

CROP_SIZE, CROP_ANGLE = (640, 300), np.radians(80.0)
"""Width and height of a crop of a panorama, pixels, and the angle of its width, rad."""

INK, PAPER, TRUE, WRONG = (30, 30, 34), (250, 250, 247), (20, 20, 20), (214, 39, 40)


@dataclass(frozen=True)
class WorstMoment:
    """Errors of one kind, of one person or track, in nearly consecutive frames.

    middle: the error in the middle of those with the most frequent cause. weight: number of errors. first, last: frames.
    """

    middle: Mistake
    weight: int
    first: int
    last: int

    def to_row(self, pictures: Sequence[str]) -> dict[str, Any]:
        """The moment as JSON values."""
        m = self.middle
        position = [round(v, 3) for v in m.position]
        return {
            "frame": m.frame, "kind": m.kind, "cause": m.cause, "person": m.person, "position": position, "weight": self.weight,
            "pictures": list(pictures),
        }  # fmt: skip


def find_worst(found: Sequence[Mistake]) -> list[WorstMoment]:
    """At most MAX_MOMENTS moments, by weight, and at most MAX_ALIKE of one kind and cause. The cause of a moment is its most frequent one."""
    by_subject: dict[tuple[str, int | None], list[list[Mistake]]] = {}
    for mistake in found:
        runs = by_subject.setdefault((mistake.kind, mistake.track if mistake.kind == "false positive" else mistake.person), [])
        if runs and mistake.frame - runs[-1][-1].frame <= MAX_GAP + 1:
            runs[-1].append(mistake)
        else:
            runs.append([mistake])
    moments = [_moment(run) for runs in by_subject.values() for run in runs]
    moments.sort(key=lambda m: (-m.weight, m.middle.frame, m.middle.kind, m.middle.person or 0, m.middle.track or 0))
    seen: Counter[tuple[str, str]] = Counter()
    out = []
    for moment in moments:
        seen[moment.middle.kind, moment.middle.cause] += 1
        if seen[moment.middle.kind, moment.middle.cause] <= MAX_ALIKE:
            out.append(moment)
    return out[:MAX_MOMENTS]


def _moment(run: list[Mistake]) -> WorstMoment:
    cause = Counter(m.cause for m in run).most_common(1)[0][0]
    typical = [m for m in run if m.cause == cause]
    return WorstMoment(typical[len(typical) // 2], len(run), run[0].frame, run[-1].frame)


def file_stem(key: tuple[str, int, str]) -> str:
    """A file name for a run, without its suffix. key: id, seed, tracker."""
    return re.sub(r"[^A-Za-z0-9]+", "-", "-".join(map(str, key))).strip("-")


def draw_pictures(moments: Sequence[WorstMoment], evidence: TrialEvidence, data: TrialData, results: Results, stem: Path) -> list[dict[str, Any]]:
    """The moments as JSON values. The first MAX_PICTURES get pictures, `stem`-1.png and so on, with paths relative to the parent of their folder."""
    out = []
    for k, moment in enumerate(moments):
        pictures = []
        if k < MAX_PICTURES:
            stem.parent.mkdir(parents=True, exist_ok=True)
            path = stem.with_name(f"{stem.name}-{k + 1}.png")
            save_png(path, draw(moment, evidence, data, results))
            pictures.append(f"{stem.parent.name}/{path.name}")
        out.append(moment.to_row(pictures))
    return out


def draw(moment: WorstMoment, evidence: TrialEvidence, data: TrialData, results: Results) -> Image:
    """The map, beside crops of panoramas where there are images."""
    number = next(k for k, known in enumerate(evidence.frames) if known.index == moment.middle.frame)
    parts = [_draw_map(moment, number, evidence, data, results)]
    panels = _draw_crops(moment, number, data, results)
    if panels:
        column = np.full((MAP_SIZE, CROP_SIZE[0], 3), PAPER, np.uint8)
        for k, panel in enumerate(panels[:2]):
            column[k * (CROP_SIZE[1] + 20) : k * (CROP_SIZE[1] + 20) + CROP_SIZE[1]] = panel
        parts.append(column)
    m = moment.middle
    subject = f"person {m.person}" if m.person is not None else f"track {m.track}"
    count = f", {moment.weight} frames ({moment.first} to {moment.last})" if moment.weight > 1 else ""
    sheet = np.asarray(cv2.copyMakeBorder(np.hstack(parts), 36, 30, 8, 8, cv2.BORDER_CONSTANT, value=PAPER), dtype=np.uint8)
    _write(sheet, f"frame {m.frame}: {m.kind}, {m.cause}, {subject}{count}", (12, 24), 0.6, INK)
    legend = "rings: true people   discs: tracks   red ring: the error   arrows: robots, true grey, estimated red"
    if data.views[number]:
        legend += "   lines: cameras that see the person, blue with a box, grey without"
    if panels:
        legend += "   white: visible parts of people"
    _write(sheet, legend, (12, sheet.shape[0] - 10), 0.34, INK)
    return sheet


def _write(image: Image, text: str, at: tuple[int, int], size: float, colour: tuple[int, int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def _ground(data: TrialData, place: Array) -> TerrainImage:
    """A square map of the terrain around a place (2,) m, within the world where that is large enough. It is blank where the ground is a plane."""
    ground, scale = data.setup.ground, MAP_SIZE / (2 * MAP_RADIUS)
    if not isinstance(ground, Grid):
        return TerrainImage(np.full((MAP_SIZE, MAP_SIZE, 3), PAPER, np.uint8), place - MAP_RADIUS, scale)
    extent = (np.array(ground.heights.shape[::-1]) - 1) * ground.spacing
    low, high = ground.origin + MAP_RADIUS, ground.origin + extent - MAP_RADIUS
    corner = np.where(low < high, np.clip(place, low, high), (low + high) / 2) - MAP_RADIUS
    relief = TerrainImage.of(data.setup, (int(extent[0] * scale / 2), int(extent[1] * scale / 2)))
    # From pixels of the relief to those of the map: the same axes, another scale and origin.
    zoom, (x, y) = scale / relief.scale, (relief.origin - corner) * scale
    shift = MAP_SIZE - y - zoom * relief.image.shape[0]
    image = cv2.warpAffine(relief.image, np.array([[zoom, 0.0, x], [0.0, zoom, shift]]), (MAP_SIZE, MAP_SIZE), borderValue=PAPER)
    return TerrainImage(np.asarray(image, dtype=np.uint8), corner, scale)


def _draw_map(moment: WorstMoment, number: int, evidence: TrialEvidence, data: TrialData, results: Results) -> Image:
    m = moment.middle
    plan = _ground(data, np.array(m.position[:2]))
    image = plan.image
    _draw_views(plan, moment, number, data)
    for k in range(max(0, number - TRAIL), number + 1):
        known = evidence.frames[k]
        last = k == number
        for person, at in zip(known.person.tolist(), plan.pixels(known.feet).tolist(), strict=True):
            cv2.circle(image, at, 11 if last else 2, TRUE, 2 if last else -1, cv2.LINE_AA)
            if last:
                _write(image, f"person {person}", (at[0] + 14, at[1] - 8), 0.4, TRUE)
        for track, at in zip(known.track.tolist(), plan.pixels(known.place).tolist(), strict=True):
            cv2.circle(image, at, 7 if last else 3, tuple(int(0.8 * c) for c in colour_of(track)), -1, cv2.LINE_AA)
            if last:
                _write(image, f"track {track}", (at[0] + 12, at[1] + 16), 0.4, INK)
    _draw_robots(plan, number, data, results)
    cv2.circle(image, plan.pixels(np.array(m.position))[0].tolist(), 26, WRONG, 3, cv2.LINE_AA)
    _draw_scale(image)
    return image


def _draw_scale(image: Image) -> None:
    metre = round(MAP_SIZE / (2 * MAP_RADIUS))
    cv2.line(image, (16, MAP_SIZE - 16), (16 + metre, MAP_SIZE - 16), INK, 2)
    _write(image, "1 m", (20 + metre, MAP_SIZE - 12), 0.4, INK)


def _draw_views(plan: TerrainImage, moment: WorstMoment, number: int, data: TrialData) -> None:
    """A line from each camera that sees the person: thick where the view has a box of the person, otherwise thin."""
    person, tick, truth = moment.middle.person, data.ticks[number], data.truth[number]
    if person is None or not data.views[number] or person not in truth.person_id:
        return
    row = int(np.flatnonzero(truth.person_id == person)[0])
    for view in tick.views:
        true = data.views[number][view.camera]
        shown = true.boxes.visible[true.boxes.person == person].max(initial=0.0)
        if shown > 0:
            found = bool((data.true_persons(view.detections) == person).any())
            a, b = plan.pixels(np.stack([true.T_world_camera.translation, truth.feet[row]])).tolist()
            cv2.line(plan.image, a, b, (31, 119, 180) if found else (150, 150, 150), 2 if found else 1, cv2.LINE_AA)


def _draw_robots(plan: TerrainImage, number: int, data: TrialData, results: Results) -> None:
    nose = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]])

    def arrow(pose: Pose, colour: tuple[int, int, int], thick: int) -> list[int]:
        a, b = plan.pixels(pose.apply(nose)).tolist()
        cv2.arrowedLine(plan.image, a, b, colour, thick, cv2.LINE_AA, tipLength=0.4)
        return a

    for robot, pose in data.truth[number].T_world_robot.items():
        at = arrow(pose, (90, 90, 96), 5)
        _write(plan.image, robot.replace("_", " "), (at[0] - 20, at[1] + 24), 0.4, INK)
    for poses in results.poses.values():
        estimate = poses[number]
        if estimate is not None:
            arrow(estimate, WRONG, 2)


def _draw_crops(moment: WorstMoment, number: int, data: TrialData, results: Results) -> list[Image]:
    """Crops of the two panoramas that show most of the person, or are nearest, with true boxes and the boxes of tracks."""
    place = np.array(moment.middle.position)
    ranked = []
    for view in data.ticks[number].views:
        mount = data.setup.mounts[view.camera]
        if view.image is None or not isinstance(mount.camera, PanoramicCamera):
            continue
        true = data.views[number][view.camera]
        shown = float(true.boxes.visible[true.boxes.person == (moment.middle.person or 0)].max(initial=0.0))
        distance = float(np.linalg.norm(true.T_world_camera.translation - place))
        ranked.append((-shown, distance, view))
    out = []
    for _, _, view in sorted(ranked, key=lambda r: r[:2])[:2]:
        mount, true = data.setup.mounts[view.camera], data.views[number][view.camera]
        assert view.image is not None
        assert isinstance(mount.camera, PanoramicCamera)
        part = _Crop.about(mount.camera, true.T_world_camera, place)
        panel = part.apply(view.image)
        there = true.boxes.visible > 0
        for person, box in zip(true.boxes.person[there].tolist(), true.boxes.seen[there], strict=True):
            part.draw(panel, box, WRONG if person == moment.middle.person else (255, 255, 255), "")
        poses = results.poses.get(mount.robot)
        pose = poses[number] if poses else None
        if pose is not None:
            ids, places = results.tracks.get(data.truth[number].index, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
            for track, at in zip(ids.tolist(), places, strict=True):
                box = body_box(mount.camera, pose @ mount.T_body_camera, at)
                if box is not None:
                    part.draw(panel, box, colour_of(track), str(track))
        draw_text(panel, view.camera.replace("_", " "), (8, 20), 0.55, (255, 255, 255))
        out.append(panel)
    return out


@dataclass(frozen=True)
class _Crop:
    """A crop of a panorama of `width` px: `columns` and `rows` px from column `left` and row `top` on. It may cross the seam."""

    width: int
    left: int
    top: int
    columns: int
    rows: int

    @staticmethod
    def about(camera: PanoramicCamera, T_world_camera: Pose, place: Array) -> _Crop:
        """The crop whose middle is the middle of a person at a position (3,) m."""
        ray = T_world_camera.inverse().apply(place[None] + np.array([0.0, 0.0, 0.9]))
        azimuth, elevation = (float(a[0]) for a in angles_from_bearing(ray))
        columns = round(CROP_ANGLE / (2 * np.pi) * camera.width)
        rows = round(columns * CROP_SIZE[1] / CROP_SIZE[0])
        u, v = (np.pi - azimuth) * camera.width / (2 * np.pi), float(camera.rows_from_elevations(np.array(elevation)))
        top = int(np.clip(round(v - rows / 2), 0, camera.height - rows))
        return _Crop(camera.width, round(u - columns / 2), top, columns, rows)

    def apply(self, image: Image) -> Image:
        """The crop of an image, in CROP_SIZE."""
        part = image[self.top : self.top + self.rows][:, np.mod(np.arange(self.left, self.left + self.columns), self.width)]
        return np.asarray(cv2.resize(part, CROP_SIZE, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)

    def draw(self, panel: Image, box: Array, colour: tuple[int, int, int], name: str) -> None:
        """Draw a box (4,) px of the panorama on the crop."""
        scale = CROP_SIZE[0] / self.columns
        # The box may lie on the other side of the seam.
        middle = (box[0] + box[2]) / 2 - self.left - self.columns / 2
        shift = np.mod(middle + self.width / 2, self.width) - self.width / 2 - middle
        left, right = ((box[k] - self.left + shift) * scale for k in (0, 2))
        top, bottom = ((box[k] - self.top) * scale for k in (1, 3))
        a, b = (round(float(left)), round(float(top))), (round(float(right)), round(float(bottom)))
        cv2.rectangle(panel, a, b, colour, 2 if name or colour == WRONG else 1, cv2.LINE_AA)
        if name:
            draw_text(panel, name, (a[0] + 2, a[1] - 5), 0.45, colour)
