"""Boxes of fixed cameras as lines of sight, their feet on the ground, and the nearness of feet to people of the same frame.

A calibration is tested by its feet. If it is right, feet lie near people of the same frame, and boxes have the heights of bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from tracker.geometry import Array, Ints, Mask, set_array, set_ints
from tracker.geometry.camera_protocol import OPTICAL_FROM_CAMERA, Camera
from tracker.geometry.ground import Flat, Ground
from tracker.recordings.recording import FrameBoxes, Recording

NEAR = 0.4
"""m: standard deviation of the kernel exp(−d²/2σ²) of distances d. A body is 0.5 m wide."""
STANDING, FEET = 0.3, 0.17
"""m: standard errors of feet: STANDING of any person's place, FEET of a box's lower edge, a tenth of a body's height."""
FAR = 2.0
"""m: largest distance to a neighbour; the kernel is 0 beyond it."""
WIDEST = 9.0
"""m: the same where distances are divided by the error of the place, which is large for distant feet."""
APART = 20.0
"""m: distance of successive frames along the third axis of the search tree, so that no neighbour is found in another frame."""
REACH, REACH_TERRAIN = 1e6, 500.0
"""m: greatest length of a line of sight to flat ground and to terrain. Units may be wrong, so the former is long."""
BAND = 0.85
"""The lowest stature is multiplied, the highest divided by this: boxes err by some percent."""
CUT = 0.01
"""Boxes that end within this share of the image's height from its lower edge are left out: their feet are not in the image."""
MOST_BOXES, MOST_QUERIES, MOST_COMPARED = 300_000, 2_500, 12_000
"""Most boxes: of all cameras, from the first frame on; of one camera, compared with truth; of all cameras, compared with one another.
The compared boxes come from runs of frames that are spread over the recording."""
BLOCKS = 24
"""Blocks of time. Boxes of one block are not independent, so standard errors are those of the means of blocks."""

Extrinsics = tuple[Array, Array]
"""R (3, 3) and t (3,) m: x_camera = R x_world + t with optical axes."""


@dataclass(frozen=True, eq=False)
class BoxRays:
    """Boxes of one camera as unit lines of sight in optical axes. frame (n,) from 0. foot, head (n, 3): middles of the lower and upper edges."""

    frame: Ints
    foot: Array
    head: Array

    def __post_init__(self) -> None:
        set_ints(self, "frame", self.frame.shape)
        for name in ("foot", "head"):
            set_array(self, name, (len(self.frame), 3))

    @staticmethod
    def of(camera: Camera, boxes: FrameBoxes, end: float = np.inf) -> BoxRays:
        """The boxes of frames before `end`, without those that the lower edge of the image cuts."""
        frames = sorted(frame for frame in boxes if frame < end)
        box = np.concatenate([boxes[frame][0] for frame in frames] or [np.zeros((0, 4))])
        frame = np.repeat(np.array(frames, dtype=np.int64), [len(boxes[frame][0]) for frame in frames])
        kept = box[:, 1] + box[:, 3] < camera.height * (1 - CUT)
        frame, (left, top, width, height) = frame[kept], box[kept].T
        foot, head = (camera.bearings_from_pixels(np.column_stack([left + width / 2, v])) @ OPTICAL_FROM_CAMERA.T for v in (top + height, top))
        return BoxRays(frame, foot, head)

    def select(self, rows: Ints) -> BoxRays:
        """The boxes in `rows`."""
        return BoxRays(self.frame[rows], self.foot[rows], self.head[rows])


@dataclass(frozen=True, eq=False)
class Feet:
    """Feet of one camera on the ground. frame (n,). point (n, 2) m: NaN where a line of sight does not meet the ground. height, error (n,) m.

    height: of a body that stands there and reaches to the upper edge of the box; NaN as above.
    error: of the place, for a lower edge that misses the feet by a tenth of the body. It grows with the distance over the camera's height.
    """

    frame: Ints
    point: Array
    height: Array
    error: Array

    @property
    def grounded(self) -> Mask:
        """(n,) whether each line of sight meets the ground."""
        return np.asarray(np.isfinite(self.point[:, 0]))

    def select(self, rows: Mask | Ints | slice) -> Feet:
        """The feet in `rows`."""
        return Feet(self.frame[rows], self.point[rows], self.height[rows], self.error[rows])

    def plausible(self, band: tuple[float, float]) -> float:
        """Share of the boxes that stand on the ground with the height of a person, `band` m; 0 without boxes."""
        with np.errstate(invalid="ignore"):
            fits = (self.height > band[0] * BAND) & (self.height < band[1] / BAND)
        return float(fits.mean()) if len(fits) else 0.0


def project(rays: BoxRays, extrinsics: Extrinsics, ground: Ground) -> Feet:
    """The feet of boxes under the given extrinsics."""
    R, t = extrinsics
    centre, foot, head = -R.T @ t, rays.foot @ R, rays.head @ R
    reach = REACH if isinstance(ground, Flat) else REACH_TERRAIN
    above = centre[2] > ground.height_at(centre[None])[0]
    point, hit = ground.intersect(np.broadcast_to(centre, foot.shape), foot, reach)
    hit = hit & above
    across = np.maximum(np.hypot(head[:, 0], head[:, 1]), 1e-9)
    distance = np.hypot(*(point - centre)[:, :2].T)
    height = centre[2] - point[:, 2] + distance * head[:, 2] / across
    error = np.hypot(STANDING, FEET * distance / np.maximum(centre[2] - point[:, 2], STANDING))
    return Feet(rays.frame, np.where(hit[:, None], point[:, :2], np.nan), np.where(hit, height, np.nan), error)


@dataclass(frozen=True, eq=False)
class People:
    """People at places: frame (m,) from 0, id (m,), point (m, 2) m. Two points of one frame with one id are the same person."""

    frame: Ints
    id: Ints
    point: Array

    @staticmethod
    def of_truth(truth: Mapping[int, tuple[Ints, Array]]) -> People | None:
        """The true people; None where there are none."""
        frames = [frame for frame in sorted(truth) if len(truth[frame][0])]
        if not frames:
            return None
        counts = [len(truth[frame][0]) for frame in frames]
        ids, points = (np.concatenate([truth[frame][k] for frame in frames]) for k in (0, 1))
        return People(np.repeat(np.array(frames, dtype=np.int64), counts), ids, points[:, :2])


@dataclass(frozen=True, eq=False)
class Reference:
    """Points of people to compare feet with. frames: sorted frames that have points. centre (2,) m: median of the points."""

    frame: Ints
    point: Array
    frames: Ints = field(init=False)
    centre: Array = field(init=False)
    tree: cKDTree = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", np.unique(self.frame))
        object.__setattr__(self, "centre", np.median(self.point, axis=0) if len(self.point) else np.zeros(2))
        object.__setattr__(self, "tree", cKDTree(np.column_stack([self.point, APART * self.frame])))

    def distances(self, frame: Ints, point: Array, most: float = FAR) -> Array:
        """Distance (n,) m of each point (n, 2) m to the nearest of its frame; inf beyond `most` m, and for NaN."""
        return self.nearest(frame, point, most)[0]

    def nearest(self, frame: Ints, point: Array, most: float = FAR) -> tuple[Array, Ints]:
        """Distances as above, and the rows (n,) of the nearest points; the row is the number of points where there is none."""
        known = np.isfinite(point[:, 0])
        distance, row = self.tree.query(np.column_stack([np.where(known[:, None], point, 0.0), APART * frame]), distance_upper_bound=most)
        return np.where(known, distance, np.inf), np.where(known, row, len(self.frame))

    def far_frames(self, frame: Ints, part: float) -> Ints:
        """Frames (n,) with points, later by the share `part` of the recording, cyclically."""
        row = np.minimum(np.searchsorted(self.frames, frame), len(self.frames) - 1)
        return self.frames[(row + int(part * len(self.frames))) % len(self.frames)]


@dataclass(frozen=True, eq=False)
class Nearness:
    """Nearness of feet to people, above chance.

    gain (n,): kernel of the distance minus `chance`, its mean for mirrored places in other frames. NaN for boxes in frames without people.
    block (n,): block of time of each box.
    """

    gain: Array
    block: Ints
    chance: Array

    @property
    def mean(self) -> float:
        """Mean gain: about 0 for a wrong calibration, up to 1 − chance for a right one; 0 without boxes."""
        return float(np.nanmean(self.gain)) if np.isfinite(self.gain).any() else 0.0

    @property
    def boxes(self) -> int:
        """Number of boxes in frames with people."""
        return int(np.isfinite(self.gain).sum())

    @property
    def agreement(self) -> float:
        """The mean gain over its maximum, 1 − chance: 0 for a wrong calibration, up to 1 for a right one, whatever the number of people."""
        known = np.isfinite(self.gain)
        return self.mean / max(1 - float(self.chance[known].mean()), 1e-3) if known.any() else 0.0

    def __add__(self, other: Nearness) -> Nearness:
        """Both sets of boxes."""
        gain, chance = (np.concatenate(part) for part in ((self.gain, other.gain), (self.chance, other.chance)))
        return Nearness(gain, np.concatenate([self.block, other.block]), chance)

    def better_than(self, other: Nearness) -> tuple[float, float]:
        """Difference of the means, and its standard error from blocks of time."""
        means = np.full((2, BLOCKS), np.nan)
        for k, one in enumerate((self, other)):
            known = np.isfinite(one.gain)
            count = np.bincount(one.block[known], minlength=BLOCKS)
            total = np.bincount(one.block[known], one.gain[known], minlength=BLOCKS)
            means[k] = np.where(count > 0, total / np.maximum(count, 1), 0.0 if k else np.nan)
        apart = (means[0] - means[1])[np.isfinite(means[0])]
        return self.mean - other.mean, float(apart.std(ddof=1) / np.sqrt(len(apart))) if len(apart) > 2 else np.inf


def nearness(feet: Feet, reference: Reference, frame: Ints | None = None, by_error: bool = False) -> Nearness:
    """Compare feet with people of the same frame. frame (n,): frames of the feet in the numbering of `reference`; None for their own.

    by_error: whether distances are divided by the error of the place instead of NEAR m.
    """
    frame = feet.frame if frame is None else frame
    scale, most = (feet.error, WIDEST) if by_error else (np.full(len(frame), NEAR), FAR)
    span = feet.frame.max() - feet.frame.min() + 1 if len(feet.frame) else 1
    block = (feet.frame - feet.frame.min()) * BLOCKS // span if len(feet.frame) else feet.frame
    if not len(reference.frames):
        return Nearness(np.full(len(frame), np.nan), block, np.zeros(len(frame)))
    opposite = 2 * reference.centre - feet.point

    def kernel(frames: Ints, places: Array) -> Array:
        return np.asarray(np.exp(-((reference.distances(frames, places, most) / scale) ** 2) / 2))

    chance = np.mean([kernel(reference.far_frames(frame, part), opposite) for part in (1 / 3, 2 / 3)], axis=0)
    gain = kernel(frame, feet.point) - chance
    return Nearness(np.where(np.isin(frame, reference.frames), gain, np.nan), block, chance)


@dataclass(frozen=True, eq=False)
class CalibrationCase:
    """The input of the tests of a calibration: fixed cameras, their boxes, and true people or None.

    rate: frames per second. lenses, extrinsics, rays: by camera. area: (2, 2) m or None. band: lowest and highest stature, m.
    occluders: height map of walls and furniture, or None. later: camera → median delay of its pictures by its clock, in frames.
    limit: the boxes of frames before it are used.
    """

    rate: float
    lenses: Mapping[str, Camera]
    extrinsics: Mapping[str, Extrinsics]
    boxes: Mapping[str, FrameBoxes]
    rays: Mapping[str, BoxRays]
    truth: People | None
    ground: Ground
    area: Array | None
    band: tuple[float, float]
    occluders: Ground | None = None
    later: Mapping[str, float] = field(default_factory=dict)
    limit: float = np.inf

    @staticmethod
    def of(recording: Recording) -> CalibrationCase:
        """The fixed cameras of a recording with their boxes, up to the frame in which there are MOST_BOXES."""
        apart = {name: recording.apart(name) * recording.rate for name in recording.clocks}
        later = {name: float(np.median(frames)) for name, frames in apart.items() if len(frames)}
        recording = recording.in_step()
        fixed = recording.fixed
        counts = np.zeros(recording.frames + 1, dtype=np.int64)
        for name in fixed:
            for frame, (box, _) in recording.detections.get(name, {}).items():
                counts[frame] += len(box)
        end = int(np.searchsorted(np.cumsum(counts), MOST_BOXES)) + 1
        boxes = {name: recording.detections.get(name, {}) for name in fixed}
        return CalibrationCase(
            recording.rate,
            {name: camera.camera for name, camera in fixed.items()},
            {name: camera.opencv_extrinsics for name, camera in fixed.items()},
            boxes,
            {name: BoxRays.of(camera.camera, boxes[name], end) for name, camera in fixed.items()},
            None if recording.truth is None else People.of_truth(recording.truth),
            recording.ground,
            None if recording.area is None else np.asarray(recording.area),
            recording.height,
            recording.occluders,
            later,
            end,
        )

    @property
    def end(self) -> int:
        """The frame after the last one whose boxes are used."""
        return max((int(rays.frame.max()) + 1 for rays in self.rays.values() if len(rays.frame)), default=0)

    @cached_property
    def _true_people(self) -> Reference | None:
        return None if self.truth is None else Reference(self.truth.frame, self.truth.point)

    def reference(self, name: str) -> Reference:
        """What the feet of a camera are compared with: the true people, or without truth the feet of all other cameras."""
        return self.others(name) if self._true_people is None else self._true_people

    def feet(self, name: str) -> Feet:
        """The feet of all boxes of a camera."""
        return project(self.rays[name], self.extrinsics[name], self.ground)

    def sample(self, name: str) -> Ints:
        """Rows of at most MOST_QUERIES boxes of a camera, in runs of successive frames that are spread over the recording."""
        frame = self.rays[name].frame
        return np.flatnonzero(self._spread(frame, -(-len(frame) // MOST_QUERIES)))

    def _spread(self, frame: Ints, divisor: int) -> Mask:
        """Which boxes (n,) are in BLOCKS runs of frames over the recording. The runs hold one `divisor`-th of all frames."""
        return np.asarray(frame * BLOCKS * divisor // max(self.end, 1) % max(divisor, 1) == 0)

    def part(self) -> CalibrationCase:
        """The case with at most about MOST_COMPARED boxes, the same frames in all cameras."""
        divisor = -(-sum(len(rays.frame) for rays in self.rays.values()) // MOST_COMPARED)
        if divisor <= 1:
            return self
        return replace(self, rays={name: rays.select(np.flatnonzero(self._spread(rays.frame, divisor))) for name, rays in self.rays.items()})

    def sampled_feet(self, name: str) -> Feet:
        """The feet of a sample of the boxes."""
        rays = self.rays[name].select(self.sample(name))
        return project(rays, self.extrinsics[name], self.ground)

    def others(self, name: str) -> Reference:
        """The feet of all other cameras."""
        return reference_of([self.feet(other) for other in self.lenses if other != name])

    def with_extrinsics(self, changed: Mapping[str, Extrinsics]) -> CalibrationCase:
        """The case with other extrinsics of some cameras."""
        return replace(self, extrinsics={**self.extrinsics, **changed})

    def with_boxes_of(self, names: Mapping[str, str]) -> CalibrationCase:
        """The case where the camera KEY has the boxes of the camera VALUE."""
        boxes = {**self.boxes, **{name: self.boxes[other] for name, other in names.items()}}
        rays = {**self.rays, **{name: BoxRays.of(self.lenses[name], boxes[name], self.end) for name in names}}
        return replace(self, boxes=boxes, rays=rays)

    def with_changed_boxes(self, names: Iterable[str], change: Callable[[Array, Camera], Array]) -> CalibrationCase:
        """The case with changed boxes (n, 4) px of some cameras."""
        boxes = {name: {f: (change(box, self.lenses[name]), score) for f, (box, score) in self.boxes[name].items()} for name in names}
        rays = {name: BoxRays.of(self.lenses[name], boxes[name], self.limit) for name in names}
        return replace(self, boxes={**self.boxes, **boxes}, rays={**self.rays, **rays})

    def with_frames(self, changed: Mapping[str, Ints]) -> CalibrationCase:
        """The case with other frames (n,) of the boxes of some cameras."""
        return replace(self, rays={**self.rays, **{name: replace(self.rays[name], frame=frame) for name, frame in changed.items()}})


def reference_of(feet: list[Feet]) -> Reference:
    """The feet of several cameras that meet the ground, as a reference."""
    frame = np.concatenate([one.frame[one.grounded] for one in feet] or [np.zeros(0, dtype=np.int64)])
    point = np.concatenate([one.point[one.grounded] for one in feet] or [np.zeros((0, 2))])
    return Reference(frame, point)
