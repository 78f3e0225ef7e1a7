"""The samples of a fit: a row for each true body in a view, and a row for each false box."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from tracker.detector_models.bodies import TrueBodies, features_of, nearest_overlap
from tracker.detector_models.observations import ViewFrame, ground_place, judged
from tracker.detector_models.processes import Pairs, pairs_of
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.image_boxes import box_overlaps
from tracker.recordings import Recording

SITE_BOXES, SITE_TIME = 5, 2.0
"""Fewest boxes of a standing false box, and the least time from the first to the last, s."""
SITE_SHARE = 0.1
"""Least share of the frames between them in which a standing false box is present."""
SITE_IOU = 0.5
"""Least IoU of a false box with the mean box of the place where it stands."""


@dataclass(frozen=True, eq=False)
class PeopleSamples:
    """A row for each true body in a view and frame, ordered by view, person and frame; n rows.

    view, person, frame (n,). size: log2 of body height over image height. visible, cut (n,) as in TrueBodies. place (n, 2): the middle of the box
    over the size of the image. detected, merged (n,). overlap (n,): with the nearer person whose box overlaps most, 0 for none.
    near_detected (n,): whether that person has a box. hidden_in, border_in (n, 4): shift of an edge inward, in body
    heights, by occlusion, and by the border.
    moved (n, 4): shift inward of the edges of the found box. confidence (n,), NaN without a box. seconds (n,): number of second boxes.
    whole_error (n, 4): of edges from the whole body, in body heights.
    """

    view: Ints
    person: Ints
    frame: Ints
    size: Array
    visible: Array
    cut: Array
    place: Array
    detected: Mask
    merged: Mask
    overlap: Array
    near_detected: Mask
    hidden_in: Array
    border_in: Array
    moved: Array
    confidence: Array
    seconds: Ints
    whole_error: Array

    def __len__(self) -> int:
        return len(self.view)

    def features(self, sizes: tuple[float, float]) -> Array:
        """Features (n, 5), as bodies.features_of."""
        return features_of(self.visible, self.size, self.cut, sizes)


@dataclass(frozen=True, eq=False)
class FalseSamples:
    """A row for each false box that is judged: view, frame, site (n,), −1 for new ones; edges (n, 4) px; confidence (n,).

    size (n, 3) m: distance, height, width. unjudged: number of boxes beyond the area. frames: by view, the number of frames.
    seconds (m, 10): rows of second boxes, with person, four errors, confidence, visible share, 1 where the person has no first box, view, frame.
    Errors are from the first box, or else from the whole body.
    """

    view: Ints
    frame: Ints
    site: Ints
    edges: Array
    size: Array
    confidence: Array
    unjudged: int
    frames: Ints
    seconds: Array


Rows = TypeVar("Rows")


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the people and of the false boxes; period s; cameras: names by number of the view."""

    people: PeopleSamples
    false: FalseSamples
    period: float
    cameras: tuple[str, ...]

    @cached_property
    def pairs(self) -> Pairs:
        """Pairs of rows of the same person in the same view, by lag."""
        people = self.people
        return pairs_of(people.view, people.person, people.frame, self.period)


def samples_of(recording: Recording, frames: Iterable[ViewFrame], everywhere: bool = False) -> Samples:
    """The samples of matched views. everywhere: whether truth is complete beyond the area, too. Raises ValueError where no frame has truth."""
    frames = list(frames)
    if not frames:
        raise ValueError("too little truth: no frame has both truth and detections")
    names = tuple(dict.fromkeys(one.camera for one in frames))
    number = {name: k for k, name in enumerate(names)}
    rows, seconds = list[tuple[Any, ...]](), [np.zeros((0, 10))]
    boxes: dict[str, list[tuple[int, Array, float]]] = {name: [] for name in names}
    for one in frames:
        camera = recording.cameras[one.camera].camera
        rows.append(_rows(one, number[one.camera], camera))
        for box in one.free.tolist():
            if one.owner[box] >= 0:
                owner = int(one.owner[box])
                # Errors of the calibration displace both boxes of a person alike, so errors are from the first box.
                first = one.match[owner]
                base = one.bodies.whole[owner] if first < 0 else one.edges[first]
                error = (one.edges[box] - base) / one.bodies.height[owner]
                kind = one.bodies.visible[owner], float(one.match[owner] < 0)
                seconds.append(np.array([[one.bodies.person[owner], *error, one.confidence[box], *kind, number[one.camera], one.frame]]))
            else:
                boxes[one.camera].append((one.frame, one.edges[box], float(one.confidence[box])))
    people, first = _people(rows), min(one.frame for one in frames)
    counts = np.array([sum(one.camera == name for one in frames) for name in names], dtype=np.int64)
    false = _false(recording, boxes, counts, np.concatenate(seconds), everywhere)
    # Frames count from the first one with truth, as false.frames is the number of those.
    people, false = replace(people, frame=people.frame - first), replace(false, frame=false.frame - first)
    return Samples(people, false, 1 / recording.rate, names)


def joined(parts: Sequence[Samples]) -> Samples:
    """The samples of several recordings as one; people of different recordings are different. Raises ValueError where their rates differ."""
    if len({round(1 / part.period, 6) for part in parts}) > 1:
        raise ValueError(f"rates are {', '.join(f'{1 / part.period:g}' for part in parts)} frames/s, needs one for sources that are fitted together")
    people, false, views, persons, sites = [], [], 0, 0, 0
    for part in parts:
        p, f = part.people, part.false
        people.append(replace(p, view=p.view + views, person=np.unique(p.person, return_inverse=True)[1] + persons))
        second = f.seconds + np.array([0.0] * 8 + [views, 0.0])
        false.append(replace(f, view=f.view + views, site=np.where(f.site >= 0, f.site + sites, -1), seconds=second))
        views, persons = views + len(part.cameras), persons + len(np.unique(p.person))
        sites += int(f.site.max(initial=-1)) + 1
    names = tuple(name for part in parts for name in part.cameras)
    return Samples(concatenated(people), concatenated(false), parts[0].period, names)


def concatenated(parts: Sequence[Rows]) -> Rows:
    """Rows of several values of a dataclass as one; numbers are added."""
    columns = {name: [vars(part)[name] for part in parts] for name in vars(parts[0])}
    return type(parts[0])(**{name: sum(v) if isinstance(v[0], int) else np.concatenate(v) for name, v in columns.items()})


def _rows(one: ViewFrame, view: int, camera: Camera) -> tuple[Any, ...]:
    """Columns of PeopleSamples of a view and frame."""
    bodies: TrueBodies = one.bodies
    n, height = len(bodies.person), bodies.height[:, None]
    detected, merged = one.match >= 0, one.merged >= 0
    held = np.zeros(n, dtype=bool)
    held[one.merged[merged]] = True
    inward = np.array([1.0, 1.0, -1.0, -1.0])
    part, seen = bodies.parts(camera)
    hidden_in, border_in = inward * (seen - part) / height, inward * (part - bodies.whole) / height
    error, confidence = np.full((n, 4), np.nan), np.full(n, np.nan)
    error[detected] = (one.edges[one.match[detected]] - bodies.whole[detected]) / height[detected]
    confidence[detected] = one.confidence[one.match[detected]]
    # A merged box is no evidence of the edges of one of its people.
    error[held] = np.nan
    confidence[held] = np.nan
    other, most = nearest_overlap(bodies)
    seconds = np.bincount(one.owner[one.owner >= 0], minlength=n)
    near = detected[np.maximum(other, 0)] & (other >= 0) if n else detected
    overlap = np.where(other >= 0, most, 0.0)
    place, size = bodies.placed(camera)
    return (
        np.full(n, view), bodies.person, np.full(n, one.frame), size, bodies.visible, bodies.cut, place, detected, merged, overlap, near,
        hidden_in, border_in, inward * error, confidence, seconds, error,
    )  # fmt: skip


def _people(rows: list[tuple[Any, ...]]) -> PeopleSamples:
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    order = np.lexsort((columns[2], columns[1], columns[0]))
    return PeopleSamples(*(column[order] for column in columns))


def _false(recording: Recording, boxes: dict[str, list[tuple[int, Array, float]]], frames: Ints, seconds: Array, everywhere: bool) -> FalseSamples:
    out, unjudged, first = list[tuple[Any, ...]](), 0, 0
    for view, (name, found) in enumerate(boxes.items()):
        if not found:
            continue
        camera = recording.cameras[name]
        frame, edges, confidence = np.array([f for f, *_ in found]), np.array([e for _, e, _ in found]), np.array([c for *_, c in found])
        feet, size, distance = np.zeros((len(frame), 3)), np.zeros((len(frame), 2)), np.zeros(len(frame))
        for each in np.unique(frame).tolist():
            pose, mine = recording.pose_at(camera, each), frame == each
            assert pose is not None
            feet[mine], size[mine] = ground_place(recording, camera, pose, edges[mine])
            distance[mine] = np.linalg.norm(feet[mine, :2] - pose.translation[:2], axis=1)
        kept = (judged(recording, feet) | everywhere) & np.isfinite(size).all(axis=1)
        unjudged += int((~kept).sum())
        site = _sites(frame[kept], edges[kept], recording.rate) if camera.robot is None else np.full(int(kept.sum()), -1)
        site = np.where(site >= 0, site + first, -1)
        first = max(first, int(site.max(initial=-1)) + 1)
        out.append((np.full(int(kept.sum()), view), frame[kept], site, edges[kept], np.column_stack([distance, size])[kept], confidence[kept]))
    empty = (np.zeros(0, dtype=np.int64),) * 3 + (np.zeros((0, 4)), np.zeros((0, 3)), np.zeros(0))
    view_, frame_, site_, edges_, size_, confidence_ = (np.concatenate(column) for column in zip(empty, *out, strict=True))
    return FalseSamples(view_, frame_, site_, edges_, size_, confidence_, unjudged, frames, seconds)


def _sites(frame: Ints, edges: Array, rate: float) -> Ints:
    """The place (n,) where each false box stands, −1 for none. In the order of frames, each box joins the place whose mean box overlaps it most."""
    mean, count, site = np.zeros((0, 4)), list[int](), np.zeros(len(frame), dtype=np.int64)
    for k in np.argsort(frame, kind="stable"):
        alike = box_overlaps(edges[k : k + 1], mean)[0]
        best = int(np.argmax(alike)) if len(alike) else -1
        if best < 0 or alike[best] < SITE_IOU:
            mean, best = np.concatenate([mean, edges[k : k + 1]]), len(mean)
            count.append(0)
        count[best] += 1
        mean[best] += (edges[k] - mean[best]) / min(count[best], 20)
        site[k] = best
    out, stands = np.full(len(frame), -1), 0
    for each in range(len(mean)):
        mine = site == each
        span = int(frame[mine].max() - frame[mine].min())
        if mine.sum() >= SITE_BOXES and span / rate >= SITE_TIME and mine.sum() >= SITE_SHARE * span:
            out[mine] = stands
            stands += 1
    return out
