"""Boxes of a camera for the calibration: one row per box, whole bodies marked, linked to tracklets in the image.

Only the image is used here, because the camera is unknown. The unit of lengths is the height of a body, about 1.72 m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import isotonic_regression, linear_sum_assignment

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.image_boxes import box_overlaps, edges_of
from tracker.recordings.clocks import CameraClock
from tracker.recordings.recording import FrameBoxes

EDGE, NEAR_EDGE = 0.01, 0.07
"""Boxes nearer to the image border than this share of its height are cut by it. Tracklets nearer than this share of their boxes' heights may be.

Errors of boxes are 0.03 of their heights. A choice by its own edges would favour boxes whose errors point away from the border.
"""
SMOOTH = 1.0
"""s over which edges of a tracklet are averaged, so that errors of single boxes do not affect their selection and weight."""
HIDDEN = 0.2
"""Share of the lower or upper third of a box covered by nearer boxes, above which that edge is not trusted."""
SECOND = 0.6
"""IoU from which the box of the lower confidence is a second box of the same body."""
LEAST_HEIGHT = 12.0
"""px: smaller boxes are left out, as their edges say little."""
ASPECT = (1.2, 6.0)
"""Height over width of upright bodies."""
STEP, SPEED = 0.1, 0.9
"""Gate of a link in body heights: constant part, and part per second, for 1.5 m/s."""
GROWTH = (0.12, 0.6)
"""Gate of the change of the logarithm of a box's height: constant part, and part per second."""
COASTING = 0.8
"""s without a box after which a tracklet ends; at least two frames."""
SLOWEST = 1.0
"""s: longest period of a camera whose boxes are linked."""
SMOOTHING = 0.3
"""s over which velocities in the image are averaged."""
WALKING = (1.5, 0.5)
"""s, and body heights in the image: least duration and extent of the tracklet of a walking person."""
SUREST, LEAST_SHARE = 0.1, 0.25
"""Share of boxes with the highest confidences. Others need at least LEAST_SHARE of the share of walking people among these."""
CLEARLY = 2.0
"""Least ratio of the second lowest cost to that of a link; below it, the tracklet ends."""


@dataclass(frozen=True, eq=False)
class LinkedBoxes:
    """The n boxes of one camera: frame (n,) from 0, time (n,) s; middle, top, bottom, width (n,) px. whole (n,): whether feet and head are visible.

    track (n,): tracklet of each box, from 0. In an image that wraps, the middle is in [0, W).
    """

    frame: Ints
    time: Array
    middle: Array
    top: Array
    bottom: Array
    width: Array
    whole: Mask
    track: Ints

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def height(self) -> Array:
        """Heights (n,) px."""
        return np.asarray(self.bottom - self.top)

    def select(self, rows: Ints | Mask) -> LinkedBoxes:
        """The boxes in `rows`."""
        return LinkedBoxes(*(getattr(self, name)[rows] for name in LinkedBoxes.__dataclass_fields__))


def linked_boxes(camera: Camera, boxes: FrameBoxes, rate: float, clock: CameraClock | None = None) -> LinkedBoxes:
    """The boxes of a camera at `rate` frames/s, or at the times of its own clock, linked to tracklets. Probably false ones are left out."""
    parts = [(frame, *_of_frame(camera, *boxes[frame])) for frame in sorted(boxes) if len(boxes[frame][0])]
    edges = np.concatenate([part[1] for part in parts] or [np.zeros((0, 4))])
    whole = np.concatenate([part[2] for part in parts] or [np.zeros(0, dtype=bool)])
    frame = np.repeat(np.array([part[0] for part in parts], dtype=np.int64), [len(part[1]) for part in parts])
    middle, width = (edges[:, 0] + edges[:, 2]) / 2, edges[:, 2] - edges[:, 0]
    if camera.wraps:
        middle = np.mod(middle, camera.width)
    time = frame / rate if clock is None else np.array([clock.time(one, rate) for one in frame.tolist()], dtype=np.float64)
    table = LinkedBoxes(frame, time, middle, edges[:, 1], edges[:, 3], width, whole, np.zeros(len(frame), dtype=np.int64))
    period = camera.width if camera.wraps else 0
    table = replace(table, track=_linked(table, rate, period))
    people = _of_people(table, np.concatenate([part[3] for part in parts] or [np.zeros(0)]))
    if not people.all():
        table = table.select(people)
        table = replace(table, track=_linked(table, rate, period))
    return replace(table, whole=table.whole & _inside(camera, table))


def _of_people(table: LinkedBoxes, confidence: Array) -> Mask:
    """Boxes (n,) with confidences at which the share of walking people is at least LEAST_SHARE of that at the highest confidences.

    Only the order of confidences counts. Furniture that a detector takes for people has low confidences and does not move.
    """
    if not len(table):
        return np.ones(0, dtype=bool)
    extent = extents(table, np.column_stack([table.time, table.middle, table.bottom]))
    tall = np.bincount(table.track, table.height) / np.bincount(table.track)
    walks = (extent[:, 0] >= WALKING[0]) & (extent[:, 1:].max(axis=1) >= WALKING[1] * tall)
    of = np.unique(confidence, return_inverse=True)[1]
    boxes = np.bincount(of)
    share = np.asarray(isotonic_regression(np.bincount(of, walks[table.track]) / boxes, weights=boxes).x)[of]
    surest = float(share[confidence >= np.quantile(confidence, 1 - SUREST)].mean())
    return np.asarray(share >= LEAST_SHARE * surest)


def extents(table: LinkedBoxes, values: Array) -> Array:
    """Greatest less least (tracklets, k) of values (n, k) of the boxes of each tracklet; −inf for a number that no tracklet has."""
    count = int(table.track.max(initial=0)) + 1
    low, high = np.full((count, values.shape[1]), np.inf), np.full((count, values.shape[1]), -np.inf)
    np.minimum.at(low, table.track, values)
    np.maximum.at(high, table.track, values)
    return high - low


def smoothed(table: LinkedBoxes, values: Array, width: float = SMOOTH) -> Array:
    """Means (n, k) of values (n, k) of the boxes of a tracklet within `width` / 2 s."""
    order = np.lexsort([table.time, table.track])
    # All tracklets are put on one time axis, one after the other with gaps.
    time = table.time[order] + table.track[order] * (float(np.ptp(table.time)) + 2 * width if len(table) else 0.0)
    low, high = np.searchsorted(time, time - width / 2), np.searchsorted(time, time + width / 2, side="right")
    total = np.vstack([np.zeros(values.shape[1]), np.cumsum(values[order], axis=0)])
    out = np.empty(values.shape)
    out[order] = (total[high] - total[low]) / (high - low)[:, None]
    return out


def _inside(camera: Camera, table: LinkedBoxes) -> Mask:
    """Boxes (n,) whose smoothed edges are inside the image, not near its border."""
    half = table.width / 2
    edges = smoothed(table, np.column_stack([table.top, table.bottom, table.middle - half, table.middle + half]))
    low, margin = camera.pixel_centre - 0.5, NEAR_EDGE * (edges[:, 1] - edges[:, 0])
    inside = (edges[:, 0] > low + margin) & (edges[:, 1] < low + camera.height - margin)
    if not camera.wraps:
        inside &= (edges[:, 2] > low + margin) & (edges[:, 3] < low + camera.width - margin)
    return np.asarray(inside)


def _of_frame(camera: Camera, box: Array, confidence: Array) -> tuple[Array, Mask, Array]:
    """Edges (k, 4) px of a frame's boxes without second boxes, which of these (k,) show whole bodies, and confidences (k,)."""
    edges = edges_of(box)
    ratio = box[:, 3] / np.maximum(box[:, 2], 1e-6)
    kept = np.flatnonzero((box[:, 3] > LEAST_HEIGHT) & (box[:, 2] > 0))
    edges, ratio, order = edges[kept], ratio[kept], np.argsort(-confidence[kept], kind="stable")
    overlap = box_overlaps(edges, edges, camera.width if camera.wraps else None)
    first = np.ones(len(edges), dtype=bool)
    for row in order.tolist():
        if first[row]:
            first &= (overlap[row] < SECOND) | (np.arange(len(edges)) == row)
    edges, ratio, confidence = edges[first], ratio[first], confidence[kept][first]
    low = camera.pixel_centre - 0.5
    margin = EDGE * camera.height
    whole = (edges[:, 1] > low + margin) & (edges[:, 3] < low + camera.height - margin) & (ratio > ASPECT[0]) & (ratio < ASPECT[1])
    if not camera.wraps:
        whole &= (edges[:, 0] > low + margin) & (edges[:, 2] < low + camera.width - margin)
    return edges, whole & ~_hidden(edges), confidence


def _hidden(edges: Array) -> Mask:
    """Boxes (k,) whose lower or upper third is covered by boxes of nearer people, which end lower in the image."""
    height = (edges[:, 3] - edges[:, 1])[:, None]
    nearer = edges[None, :, 3] > edges[:, 3, None]
    across = np.minimum(edges[:, 2, None], edges[None, :, 2]) - np.maximum(edges[:, 0, None], edges[None, :, 0])
    share = np.clip(across / np.maximum(edges[:, 2] - edges[:, 0], 1e-6)[:, None], 0.0, 1.0)
    out = np.zeros(len(edges), dtype=bool)
    for top, bottom in ((edges[:, 1, None], edges[:, 1, None] + height / 3), (edges[:, 3, None] - height / 3, edges[:, 3, None])):
        down = np.clip(np.minimum(bottom, edges[None, :, 3]) - np.maximum(top, edges[None, :, 1]), 0.0, None) / np.maximum(height / 3, 1e-6)
        out |= (np.where(nearer, share * down, 0.0)).max(axis=1, initial=0.0) > HIDDEN
    return out


def _linked(table: LinkedBoxes, rate: float, period: int) -> Ints:
    """Tracklet (n,) of each box: boxes of successive frames that are mutually nearest after prediction, and clearly nearer than any other.

    period: px after which the image wraps, 0 for none.
    """
    track = np.full(len(table), -1, dtype=np.int64)
    state = np.column_stack([table.middle, table.bottom, table.height])
    live = np.zeros((0, 2), dtype=np.int64)  # row of the last box, number of the tracklet
    velocity, count = np.zeros((0, 2)), 0
    starts = np.flatnonzero(np.diff(table.frame, prepend=-1))
    # A camera may be slower than the recording. Boxes that are seconds apart are no path.
    periods = np.diff(table.time[starts])
    coasting = max(COASTING, 2.5 * min(float(np.median(periods)), SLOWEST) if len(periods) else 2.5 / rate)
    for first, end in zip(starts.tolist(), [*starts[1:].tolist(), len(table)], strict=True):
        now, rows = table.time[first], np.arange(first, end)
        recent = now - table.time[live[:, 0]] <= coasting + 1e-9
        live, velocity = live[recent], velocity[recent]
        taken, new_velocity = np.full(end - first, -1, dtype=np.int64), np.zeros((end - first, 2))
        if len(live):
            matched, lost = _matches(state[live[:, 0]], velocity, now - table.time[live[:, 0]], state[rows], period)
            for k, j in matched:
                taken[j] = k
                passed = now - table.time[live[k, 0]]
                moved = state[first + j, :2] - state[live[k, 0], :2]
                moved[0] -= period * np.round(moved[0] / period) if period else 0
                share = passed / (passed + SMOOTHING)
                new_velocity[j] = (1 - share) * velocity[k] + share * moved / passed
        fresh = np.flatnonzero(taken < 0)
        track[rows] = live[taken, 1] if len(live) else 0
        track[rows[fresh]] = count + np.arange(len(fresh))
        count += len(fresh)
        left = np.flatnonzero(lost) if len(live) else np.zeros(0, dtype=np.int64)
        live = np.concatenate([live[left], np.column_stack([rows, track[rows]])])
        velocity = np.concatenate([velocity[left], new_velocity])
    return track


def _matches(before: Array, velocity: Array, passed: Array, now: Array, period: int) -> tuple[list[tuple[int, int]], Mask]:
    """Pairs of a tracklet and a box, and which tracklets have no box in their gate. Tracklets in neither, with an ambiguous box, end."""
    expected = before[:, :2] + velocity * passed[:, None]
    apart = now[None, :, :2] - expected[:, None]
    if period:
        apart[..., 0] -= period * np.round(apart[..., 0] / period)
    size = np.sqrt(before[:, None, 2] * now[None, :, 2])
    growth = np.abs(np.log(now[None, :, 2] / before[:, None, 2]))
    moved = np.hypot(apart[..., 0], apart[..., 1]) / size / (STEP + SPEED * passed)[:, None]
    cost = np.hypot(moved, growth / (GROWTH[0] + GROWTH[1] * passed)[:, None])
    usable = np.where(cost < 1.0, cost, 10.0)
    pairs = [(k, j) for k, j in zip(*(part.tolist() for part in linear_sum_assignment(usable)), strict=True) if cost[k, j] < 1.0]
    out = []
    for k, j in pairs:
        others = np.concatenate([np.delete(cost[k], j), np.delete(cost[:, j], k)])
        if others.min(initial=np.inf) > CLEARLY * cost[k, j] + 0.1:
            out.append((k, j))
    return out, np.asarray(cost.min(axis=1) >= 1.0)
