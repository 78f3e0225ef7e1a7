"""Observations of a detector in a recording: boxes matched with true bodies in each view, second boxes and false boxes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from tracker.detector_models.bodies import MATCH, TrueBodies, bodies_in_view, intersections, nearest_overlap
from tracker.formats.opening import format_of
from tracker.formats.pets2009 import annotation_file, ground_truth, read_annotations
from tracker.geometry import Array, Ints, Mask, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.image_boxes import body_outlines, box_overlaps, clipped, edges_of
from tracker.recordings import FrameBoxes, Recording, RecordingCamera

INSIDE = 0.7
"""An unmatched box is a second box of a person if at least this share of it lies in the person's true box."""
MERGED_GAIN = 0.05
"""A box shows two people if its IoU with the box around both is at least MERGED. It is also higher by this than with each."""
MERGED = 0.5
MARGIN = 1.0
"""m: false boxes farther than this beyond the area are not judged, since truth may end there."""
FARTHEST = 60.0
"""m: distance that is assigned to farther false boxes, and to those whose lower edges do not meet the ground."""
NEAR = 0.5
"""Largest distance, in body heights, of a box that is matched with a body beside it, in views where such boxes are many."""
LEAST_NEAR = 0.1
"""Share of bodies from which such boxes are many. Errors of calibration displace them then, and not chance."""
NEAREST_SIZE = 0.4
"""Largest difference of the log heights of a body and a box that is matched with it at such a distance."""
NOBODY = -1


@dataclass(frozen=True, eq=False)
class TruePeople:
    """The true people of a recording: frame → ids (n,) and feet (n, 3) m.

    boxes: camera → frame → boxes (n, 4) px in the same order, where they are known. file: of the truth, "" where the recording holds it.
    heights: id → m, of people whose projected bodies are not of bodies.BODY.
    """

    places: Mapping[int, tuple[Ints, Array]]
    boxes: Mapping[str, Mapping[int, Array]]
    file: str = ""
    heights: Mapping[int, float] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """As DetectorModel.bodies, of cameras with boxes."""
        return "boxes" if self.boxes else "places"


@dataclass(frozen=True, eq=False)
class ViewFrame:
    """One view in one frame: true bodies, boxes (d, 4) as edges px with confidence (d,), and what was matched.

    match (n,): box of each person, NOBODY for none. merged (n,): person in whose box the person is merged, NOBODY for none.
    owner (d,): row of the person of whom a box that matches nobody is a second box, NOBODY for false boxes.
    """

    camera: str
    frame: int
    bodies: TrueBodies
    edges: Array
    confidence: Array
    match: Ints
    merged: Ints
    owner: Ints

    @property
    def free(self) -> Ints:
        """Boxes that match no person."""
        return np.setdiff1d(np.arange(len(self.edges)), self.match[self.match >= 0])


def true_people(path: Path, recording: Recording, cameras: Iterable[str] = ()) -> TruePeople:
    """The true people of a recording that was read from `path`; those of PETS 2009 with the boxes of View_001, outside the area, too.

    cameras: those that will be used. True boxes are used if they are known for all of them. Raises ValueError for a recording without truth.
    """
    names = list(cameras) or list(recording.detections)
    if recording.source.get("labels_as_detections"):
        raise ValueError(f"{path}: its boxes are labels and not of a detector, needs detections (--detections)")
    if format_of(path).name == "pets2009":
        first = int((recording.source.get("frames") or [0])[0])
        if (file := annotation_file(path)) is not None and "View_001" in recording.cameras:
            camera = recording.cameras["View_001"]
            content = {frame - first: one for frame, one in read_annotations(file).items() if 0 <= frame - first < recording.frames}
            places = ground_truth(content, camera.camera, camera.pose, recording.ground)
            boxes = {"View_001": {frame: box for frame, (_, box) in content.items()}}
            return TruePeople(places, boxes if names == ["View_001"] else {}, str(file))
    if not recording.truth:
        raise ValueError(f"{path}: has no truth, which a fit needs")
    return TruePeople(recording.truth, {})


def observed(recording: Recording, truth: TruePeople, detections: Mapping[str, FrameBoxes] | None = None, near: float = 0.0) -> Iterator[ViewFrame]:
    """The views of all frames with truth. detections: in place of those of the recording. near: as in `match_frame`."""
    given = recording.detections if detections is None else detections
    for name, boxes in given.items():
        camera = recording.cameras[name]
        for frame, (person, feet) in sorted(truth.places.items()):
            pose = recording.pose_at(camera, frame)
            if pose is None or not 0 <= frame < recording.frames or frame not in recording.searched.get(name, (frame,)):
                continue
            known = truth.boxes.get(name, {}).get(frame)
            bodies = bodies_in_view((camera.camera, pose), person, feet, recording.pillars, known, truth.heights)
            box, confidence = boxes.get(frame, (np.zeros((0, 4)), np.zeros(0)))
            yield match_frame(name, frame, bodies, (edges_of(box), confidence), camera.camera, near)


def matched(recording: Recording, truth: TruePeople) -> tuple[list[ViewFrame], float]:
    """The frames of a recording's only view, and `near`: NEAR where calibration moves many boxes by more than their width, else 0."""
    frames, moved = list(observed(recording, truth)), list(observed(recording, truth, near=NEAR))
    bodies = sum(len(one.match) for one in frames)
    more = sum(int((one.match >= 0).sum()) for one in moved) - sum(int((one.match >= 0).sum()) for one in frames)
    return (moved, NEAR) if more >= LEAST_NEAR * max(bodies, 1) else (frames, 0.0)


def match_frame(name: str, frame: int, bodies: TrueBodies, found: tuple[Array, Array], camera: Camera, near: float = 0.0) -> ViewFrame:
    """Match boxes (edges (d, 4) px, confidences (d,)) with bodies by the largest sum of IoU (Hungarian method).

    near: if above 0, unmatched bodies are then matched with false boxes of similar height whose feet are at most so many body heights away.
    This is for errors of a calibration, which displace boxes of far people by more than their width.
    """
    edges, confidence = found
    edges = edges.reshape(-1, 4)
    inside, whole = clipped(edges[:, :2], edges[:, 2:], camera), clipped(bodies.whole[:, :2], bodies.whole[:, 2:], camera)
    if camera.wraps and len(edges) and len(whole):
        inside, edges = _unwrapped(inside, whole, camera.width), _unwrapped(edges, whole, camera.width)
    n, match = len(whole), np.full(len(whole), NOBODY)
    alike = np.maximum(box_overlaps(whole, inside), box_overlaps(bodies.seen, inside))
    for person, box in zip(*linear_sum_assignment(np.where(alike >= MATCH, alike, 0.0), maximize=True), strict=True):
        if alike[person, box] >= MATCH:
            match[person] = box
    merged, owner = np.full(n, NOBODY), np.full(len(edges), NOBODY)
    other, _ = nearest_overlap(bodies)
    for k in np.flatnonzero(other >= 0):
        front = int(other[k])
        one = match[front] if match[front] >= 0 and match[k] < 0 else match[k] if match[k] >= 0 and match[front] < 0 else NOBODY
        if one >= 0 and _shows_both(inside[one], whole[front], whole[k]):
            merged[k], match[front], match[k] = front, one, NOBODY
    free = np.setdiff1d(np.arange(len(edges)), match[match >= 0])
    if n and len(free):
        again = box_overlaps(inside[free], whole)
        common, area, _ = intersections(inside[free], whole)
        part = common / area
        best = np.argmax(np.maximum(again, part), axis=1)
        mine = (again[np.arange(len(free)), best] >= MATCH) | (part[np.arange(len(free)), best] >= INSIDE)
        owner[free[mine]] = best[mine]
    if near > 0:
        _match_near(match, (owner, merged), (bodies, inside), near)
    return ViewFrame(name, frame, bodies, edges, np.asarray(confidence), match, merged, owner)


def _match_near(match: Ints, taken: tuple[Ints, Ints], seen: tuple[TrueBodies, Array], near: float) -> None:
    """Match the bodies and boxes that `match_frame` leaves unmatched, in place. taken: owner (d,) and merged (n,)."""
    (owner, merged), (bodies, inside) = taken, seen
    distance = _distances(bodies, inside)
    # A second box that may be another person's displaced box is no evidence of second boxes.
    for box in np.flatnonzero(owner >= 0).tolist():
        if (np.delete(distance[:, box], owner[box]) < near).any():
            owner[box] = NOBODY
    boxes = np.setdiff1d(np.flatnonzero(owner < 0), match[match >= 0])
    people = np.flatnonzero((match < 0) & (merged < 0))
    if not len(boxes) or not len(people):
        return
    cost = distance[np.ix_(people, boxes)]
    for row, column in zip(*linear_sum_assignment(np.minimum(cost, near)), strict=True):
        if cost[row, column] < near:
            match[people[row]] = boxes[column]


def _distances(bodies: TrueBodies, inside: Array) -> Array:
    """Distance (n, d) of the feet of bodies and boxes, across or down, in heights of the body; infinite where their heights differ much."""
    a, b, height = inside[None], bodies.whole[:, None], bodies.height[:, None]
    across, down = np.abs(a[..., 0] + a[..., 2] - b[..., 0] - b[..., 2]) / 2 / height, np.abs(a[..., 3] - b[..., 3]) / height
    like = np.abs(np.log(np.maximum(a[..., 3] - a[..., 1], 1.0) / height)) <= NEAREST_SIZE
    return np.asarray(np.where(like, np.maximum(across, down), np.inf))


def _shows_both(box: Array, first: Array, second: Array) -> bool:
    both = np.concatenate([np.minimum(first[:2], second[:2]), np.maximum(first[2:], second[2:])])
    alike = box_overlaps(box[None], np.array([both, first, second]))[0]
    return bool(alike[0] >= MERGED and alike[0] > alike[1:].max() + MERGED_GAIN)


def _unwrapped(edges: Array, whole: Array, width: int) -> Array:
    """Boxes of a panorama, shifted by multiples of its width to the nearest true box."""
    middle, true = edges[:, [0, 2]].mean(axis=1), whole[:, [0, 2]].mean(axis=1)
    turns = np.round((true[None] - middle[:, None]) / width) * width
    apart = np.abs(middle[:, None] + turns - true[None])
    turn = turns[np.arange(len(edges)), np.argmin(apart, axis=1)]
    return np.asarray(edges + turn[:, None] * np.array([1.0, 0.0, 1.0, 0.0]))


def ground_place(recording: Recording, camera: RecordingCamera, pose: Pose, edges: Array) -> tuple[Array, Array]:
    """Feet (n, 3) m of boxes (n, 4) px on the ground, and sizes (n, 2) m, height and width; feet at most FARTHEST away.

    The feet of a box whose lower edge does not meet the ground are taken to be at distance FARTHEST.
    """
    lens = camera.camera
    pixels = np.stack([edges[:, [0, 2]].mean(axis=1), edges[:, 3]], axis=1)
    if lens.wraps:
        pixels[:, 0] = np.mod(pixels[:, 0], lens.width)
    rays = lens.bearings_from_pixels(pixels) @ pose.rotation.T
    feet, hit = recording.ground.intersect(np.broadcast_to(pose.translation, rays.shape), rays, FARTHEST)
    level = rays[:, :2] / np.maximum(np.linalg.norm(rays[:, :2], axis=1, keepdims=True), 1e-9)
    far = np.column_stack([pose.translation[:2] + FARTHEST * level, np.full(len(rays), pose.translation[2])])
    feet = np.where((hit & np.isfinite(feet).all(axis=1))[:, None], feet, far)
    # The size of a body of 1 m at these feet gives metres a pixel.
    sizes = np.full((len(edges), 2), np.nan)
    rows, low, high = body_outlines(lens, pose, feet, (1.0, 0.5))
    scale = np.maximum(high[:, 1] - low[:, 1], 1e-6)
    sizes[rows, 0] = (edges[rows, 3] - edges[rows, 1]) / scale
    sizes[rows, 1] = (edges[rows, 2] - edges[rows, 0]) / scale
    return feet, sizes


def judged(recording: Recording, feet: Array) -> Mask:
    """Whether false boxes with feet (n, 3) m are within MARGIN of the area, where truth is complete."""
    if recording.area is None:
        return np.ones(len(feet), dtype=np.bool_)
    low, high = np.asarray(recording.area)
    return np.asarray(((feet[:, :2] >= low - MARGIN) & (feet[:, :2] <= high + MARGIN)).all(axis=1))
