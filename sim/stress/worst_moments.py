"""The worst moments of a run: mistakes that belong together, the heaviest first.

Pictures of the worst moments: the plan about the place, and what the robots had before them.
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
from sim.stress.footage import TrialData
from sim.visualization.overlays import BODY, colour_of, save_png
from sim.visualization.plan_and_video import Relief
from tracker.geometry import Array, Image, Pose, angles_from_bearing
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Grid
from tracker.sequence.results import Results
from tracker.types import Sequence as Recorded

KEPT = 10
"""Moments of a run."""

ALIKE = 4
"""At most so many of one kind and cause."""

PAUSE = 2
"""Frames without the mistake that do not end a moment."""


@dataclass(frozen=True)
class WorstMoment:
    """Mistakes of one kind about one person or track, in frames that hang together: the one in the middle, and how many there are of each frame."""

    middle: Mistake
    weight: int
    first: int
    last: int

    def told(self, pictures: Sequence[str]) -> dict[str, Any]:
        """As it stands in a row."""
        m = self.middle
        position = [round(v, 3) for v in m.position]
        return {
            "frame": m.frame, "kind": m.kind, "cause": m.cause, "person": m.person, "position": position, "weight": self.weight,
            "pictures": list(pictures),
        }  # fmt: skip


def worst(found: Sequence[Mistake]) -> list[WorstMoment]:
    """At most KEPT moments, the heaviest first, at most ALIKE of one kind and cause; a moment's cause is that of most of its mistakes."""
    rows: dict[tuple[str, int | None], list[list[Mistake]]] = {}
    for mistake in found:
        runs = rows.setdefault((mistake.kind, mistake.track if mistake.kind == "false positive" else mistake.person), [])
        if runs and mistake.frame - runs[-1][-1].frame <= PAUSE + 1:
            runs[-1].append(mistake)
        else:
            runs.append([mistake])
    moments = [_moment(run) for runs in rows.values() for run in runs]
    moments.sort(key=lambda m: (-m.weight, m.middle.frame, m.middle.kind, m.middle.person or 0, m.middle.track or 0))
    seen: Counter[tuple[str, str]] = Counter()
    out = []
    for moment in moments:
        seen[moment.middle.kind, moment.middle.cause] += 1
        if seen[moment.middle.kind, moment.middle.cause] <= ALIKE:
            out.append(moment)
    return out[:KEPT]


def _moment(run: list[Mistake]) -> WorstMoment:
    cause = Counter(m.cause for m in run).most_common(1)[0][0]
    of_it = [m for m in run if m.cause == cause]
    return WorstMoment(of_it[len(of_it) // 2], len(run), run[0].frame, run[-1].frame)


def stem(key: tuple[str, int, str]) -> str:
    """A file name for a run."""
    return re.sub(r"[^A-Za-z0-9]+", "-", "-".join(map(str, key))).strip("-")


PICTURED = 3
"""Moments of a run that have pictures."""

PLAN = 640
"""px of the plan; it shows REACH m about the place each way."""

REACH = 5.0

TAIL = 9
"""Frames of the past that are drawn."""

PANEL = (640, 300)
"""px of what is cut from a panorama; it spans ACROSS rad."""

ACROSS = np.radians(80.0)

INK, PAPER, TRUE, WRONG = (30, 30, 34), (250, 250, 247), (20, 20, 20), (214, 39, 40)


def pictured(
    moments: Sequence[WorstMoment], evidence: TrialEvidence, scene: tuple[TrialData, Results], folder: Path, name: str
) -> list[dict[str, Any]]:
    """The moments as they stand in a row; the first PICTURED have pictures, files `name`-1.png and so on in `folder`, named from the one above."""
    out = []
    for k, moment in enumerate(moments):
        pictures = []
        if k < PICTURED:
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / f"{name}-{k + 1}.png"
            save_png(path, draw(moment, evidence, scene))
            pictures.append(f"{folder.name}/{path.name}")
        out.append(moment.told(pictures))
    return out


def draw(moment: WorstMoment, evidence: TrialEvidence, scene: tuple[TrialData, Results]) -> Image:
    """The plan about the place, and beside it, where there are panoramas, what the two robots that saw most of it had before them."""
    footage, results = scene
    number = next(k for k, known in enumerate(evidence.frames) if known.index == moment.middle.frame)
    parts = [_plan(moment, number, evidence, footage, results)]
    panels = _panels(moment, number, footage, results)
    if panels:
        column = np.full((PLAN, PANEL[0], 3), PAPER, np.uint8)
        for k, panel in enumerate(panels[:2]):
            column[k * (PANEL[1] + 20) : k * (PANEL[1] + 20) + PANEL[1]] = panel
        parts.append(column)
    m = moment.middle
    who = f"person {m.person}" if m.person is not None else f"track {m.track}"
    count = f", {moment.weight} frames ({moment.first} to {moment.last})" if moment.weight > 1 else ""
    sheet = np.asarray(cv2.copyMakeBorder(np.hstack(parts), 36, 30, 8, 8, cv2.BORDER_CONSTANT, value=PAPER), dtype=np.uint8)
    _write(sheet, f"frame {m.frame}: {m.kind}, {m.cause}, {who}{count}", (12, 24), 0.6, INK)
    legend = "rings: true people   colours: tracks   red ring: the mistake   arrows: robots, true grey, believed red"
    if footage.views[number]:
        legend += "   lines: views of the person, blue with a box, grey without"
    if panels:
        legend += "   white: what shows of people"
    _write(sheet, legend, (12, sheet.shape[0] - 10), 0.34, INK)
    return sheet


def _write(image: Image, text: str, at: tuple[int, int], size: float, colour: tuple[int, int, int]) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


@dataclass(frozen=True, eq=False)
class _Map:
    """The square of the plan: its image and its middle (2,) m."""

    image: Image
    middle: Array

    def pixels(self, places: Array) -> list[tuple[int, int]]:
        p = (np.atleast_2d(places)[:, :2] - self.middle) / (2 * REACH) * PLAN
        return [(round(PLAN / 2 + x), round(PLAN / 2 - y)) for x, y in p.tolist()]


def _middle(footage: TrialData, place: Array) -> Array:
    """The middle of the plan: the place, or so far beside it that the plan stays within the world."""
    ground = footage.setup.ground
    if not isinstance(ground, Grid):
        return place
    high = ground.origin + (np.array(ground.heights.shape[::-1]) - 1) * ground.spacing
    low, high = ground.origin + REACH, high - REACH
    return np.where(low < high, np.clip(place, low, high), (low + high) / 2)


def _ground(footage: TrialData, middle: Array) -> _Map:
    """The terrain and what stands there, within REACH of a place; paper where the ground is a plane."""
    image = np.full((PLAN, PLAN, 3), PAPER, np.uint8)
    if isinstance(footage.setup.ground, Grid):
        grid = footage.setup.ground
        wide = (np.array(grid.heights.shape[::-1]) - 1) * grid.spacing
        size = (int(wide[0] / (2 * REACH) * PLAN / 2), int(wide[1] / (2 * REACH) * PLAN / 2))
        relief = Relief.of(Recorded(footage.setup, footage.in_memory(), None, {}), size)
        # From the relief's pixels to the plan's: the same turn, another scale and corner.
        scale = PLAN / (2 * REACH) / relief.scale
        corner = relief.origin + np.array([0.0, relief.image.shape[0] / relief.scale])
        shift = PLAN / 2 + (corner - middle) * np.array([1.0, -1.0]) * PLAN / (2 * REACH)
        turn = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
        image = np.asarray(cv2.warpAffine(relief.image, turn, (PLAN, PLAN), borderValue=PAPER), dtype=np.uint8)
    return _Map(image, middle)


def _plan(moment: WorstMoment, number: int, evidence: TrialEvidence, footage: TrialData, results: Results) -> Image:
    m = moment.middle
    plan = _ground(footage, _middle(footage, np.array(m.position[:2])))
    image = plan.image
    _draw_sights(plan, moment, number, footage)
    for k in range(max(0, number - TAIL), number + 1):
        known = evidence.frames[k]
        last = k == number
        for person, at in zip(known.person.tolist(), plan.pixels(known.feet) if len(known.feet) else [], strict=True):
            cv2.circle(image, at, 11 if last else 2, TRUE, 2 if last else -1, cv2.LINE_AA)
            if last:
                _write(image, f"person {person}", (at[0] + 14, at[1] - 8), 0.4, TRUE)
        for track, at in zip(known.track.tolist(), plan.pixels(known.place) if len(known.place) else [], strict=True):
            cv2.circle(image, at, 7 if last else 3, tuple(int(0.8 * c) for c in colour_of(track)), -1, cv2.LINE_AA)
            if last:
                _write(image, f"track {track}", (at[0] + 12, at[1] + 16), 0.4, INK)
    _draw_robots(plan, number, footage, results)
    cv2.circle(image, plan.pixels(np.array(m.position))[0], 26, WRONG, 3, cv2.LINE_AA)
    _draw_scale(image)
    return image


def _draw_scale(image: Image) -> None:
    metre = round(PLAN / (2 * REACH))
    cv2.line(image, (16, PLAN - 16), (16 + metre, PLAN - 16), INK, 2)
    _write(image, "1 m", (20 + metre, PLAN - 12), 0.4, INK)


def _draw_sights(plan: _Map, moment: WorstMoment, number: int, footage: TrialData) -> None:
    """From each camera to the person: whole where the view has a box of the person, thin where it shows the person, none else."""
    person, tick, truth = moment.middle.person, footage.ticks[number], footage.truth[number]
    if person is None or not footage.views[number] or person not in truth.person_id:
        return
    row = int(np.flatnonzero(truth.person_id == person)[0])
    for view in tick.views:
        true = footage.views[number][view.camera]
        shown = true.boxes.visible[true.boxes.person == person].max(initial=0.0)
        if shown > 0:
            found = bool((footage.whose(view.detections) == person).any())
            a, b = plan.pixels(np.stack([true.T_world_camera.translation, truth.feet[row]]))
            cv2.line(plan.image, a, b, (31, 119, 180) if found else (150, 150, 150), 2 if found else 1, cv2.LINE_AA)


def _draw_robots(plan: _Map, number: int, footage: TrialData, results: Results) -> None:
    nose = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]])

    def arrow(pose: Pose, colour: tuple[int, int, int], thick: int) -> tuple[int, int]:
        a, b = plan.pixels(pose.apply(nose))
        cv2.arrowedLine(plan.image, a, b, colour, thick, cv2.LINE_AA, tipLength=0.4)
        return a

    for robot, pose in footage.truth[number].T_world_robot.items():
        at = arrow(pose, (90, 90, 96), 5)
        _write(plan.image, robot.replace("_", " "), (at[0] - 20, at[1] + 24), 0.4, INK)
    for poses in results.poses.values():
        estimate = poses[number]
        if estimate is not None:
            arrow(estimate, WRONG, 2)


def _panels(moment: WorstMoment, number: int, footage: TrialData, results: Results) -> list[Image]:
    """Cut-outs about the place, of the panoramas that show most of the person, or are nearest to it, with true boxes and those of the tracks."""
    place = np.array(moment.middle.position)
    ranked = []
    for view in footage.ticks[number].views:
        mount = footage.setup.mounts[view.camera]
        if view.image is None or not isinstance(mount.camera, Panorama):
            continue
        true = footage.views[number][view.camera]
        shown = float(true.boxes.visible[true.boxes.person == (moment.middle.person or 0)].max(initial=0.0))
        distance = float(np.linalg.norm(true.T_world_camera.translation - place))
        ranked.append((-shown, distance, view))
    out = []
    for _, _, view in sorted(ranked, key=lambda r: r[:2])[:2]:
        mount, true = footage.setup.mounts[view.camera], footage.views[number][view.camera]
        assert view.image is not None
        assert isinstance(mount.camera, Panorama)
        part = _Cut.about(mount.camera, true.T_world_camera, place)
        panel = part.of(view.image)
        there = true.boxes.visible > 0
        for person, box in zip(true.boxes.person[there].tolist(), true.boxes.seen[there], strict=True):
            part.draw(panel, box, WRONG if person == moment.middle.person else (255, 255, 255), "")
        poses = results.poses.get(mount.robot)
        pose = poses[number] if poses else None
        if pose is not None:
            ids, places = results.tracks.get(footage.truth[number].index, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
            for track, at in zip(ids.tolist(), places, strict=True):
                part.draw(panel, _standing(mount.camera, pose @ mount.T_body_camera, at), colour_of(track), str(track))
        _write(panel, view.camera.replace("_", " "), (9, 21), 0.55, (0, 0, 0))
        _write(panel, view.camera.replace("_", " "), (8, 20), 0.55, (255, 255, 255))
        out.append(panel)
    return out


def _standing(camera: Panorama, T_world_camera: Pose, place: Array) -> Array:
    """Left, top, right, bottom px of a body that stands there."""
    sight = place - T_world_camera.translation
    side = np.cross([0.0, 0.0, 1.0], sight / max(float(np.linalg.norm(sight)), 1e-6)) * BODY[0] / 2
    corners = T_world_camera.inverse().apply(np.array([place + s * side + [0.0, 0.0, h] for s in (-1, 1) for h in (0.0, BODY[1])]))
    pixels, _ = camera.pixels_from_bearings(corners / np.linalg.norm(corners, axis=1, keepdims=True))
    u = pixels[0, 0] + np.mod(pixels[:, 0] - pixels[0, 0] + camera.width / 2, camera.width) - camera.width / 2
    return np.array([u.min(), pixels[:, 1].min(), u.max(), pixels[:, 1].max()])


@dataclass(frozen=True)
class _Cut:
    """A part of a panorama `width` px round: from column `left`, row `top` on, so many columns and rows."""

    width: int
    left: int
    top: int
    columns: int
    rows: int

    @staticmethod
    def about(camera: Panorama, T_world_camera: Pose, place: Array) -> _Cut:
        """ACROSS rad about a person's middle over a place."""
        sight = T_world_camera.inverse().apply(place[None] + np.array([0.0, 0.0, 0.9]))
        azimuth, elevation = (float(a[0]) for a in angles_from_bearing(sight))
        columns = round(ACROSS / (2 * np.pi) * camera.width)
        rows = round(columns * PANEL[1] / PANEL[0])
        u, v = (np.pi - azimuth) * camera.width / (2 * np.pi), (np.pi / 2 - elevation) * camera.height / np.pi
        top = int(np.clip(round(v - rows / 2), 0, camera.height - rows))
        return _Cut(camera.width, round(u - columns / 2), top, columns, rows)

    def of(self, image: Image) -> Image:
        """This part of an image, in the size of a panel."""
        part = image[self.top : self.top + self.rows][:, np.mod(np.arange(self.left, self.left + self.columns), self.width)]
        return np.asarray(cv2.resize(part, PANEL, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)

    def draw(self, panel: Image, box: Array, colour: tuple[int, int, int], name: str) -> None:
        """A box of the panorama (4,) px on the panel."""
        scale = PANEL[0] / self.columns
        # Around the seam, to where the cut is.
        middle = (box[0] + box[2]) / 2 - self.left - self.columns / 2
        shift = np.mod(middle + self.width / 2, self.width) - self.width / 2 - middle
        left, right = ((box[k] - self.left + shift) * scale for k in (0, 2))
        top, bottom = ((box[k] - self.top) * scale for k in (1, 3))
        a, b = (round(float(left)), round(float(top))), (round(float(right)), round(float(bottom)))
        cv2.rectangle(panel, a, b, colour, 2 if name or colour == WRONG else 1, cv2.LINE_AA)
        if name:
            _write(panel, name, (a[0] + 3, a[1] - 4), 0.45, (0, 0, 0))
            _write(panel, name, (a[0] + 2, a[1] - 5), 0.45, colour)
