"""Boxes of bodies at true places, and errors that are added to given boxes: losses, false boxes, and noise of places or edges."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Ground
from tracker.geometry.image_boxes import body_boxes, boxes_from_edges, clipped
from tracker.io.text_files import named_values
from tracker.recordings.recording import FrameBoxes, Recording

HEIGHTS = (1.5, 2.0)
"""m: lowest and highest stature for false boxes."""
BODY = 1.75, 0.5
"""m: height and width of the cylinder that stands for a body."""
WIDTH = 0.4
"""Width of a false box over its height."""
MAX_TRIES = 20
"""Most positions that are drawn for a false box until one lies in the image."""
CONFIDENCE = 1.0
"""Confidence of projected boxes. The projection does not model the confidence of a detector."""


def stream(seed: int, name: str) -> np.random.Generator:
    """The random stream of a name, of a camera for instance, seeded by (seed, crc32(name))."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def _parsed(text: str, kinds: Mapping[str, type], option: str) -> dict[str, Any]:
    """Parse NAME=NUMBER,... in any order, each at most once. kinds: name → int or float. Raises ValueError that names the invalid part."""
    given: dict[str, Any] = {}
    for name, value in named_values(text, kinds, f"{option} has", f"{', '.join(n + '=…' for n in kinds)}, each once").items():
        try:
            given[name] = kinds[name](value)
        except ValueError:
            raise ValueError(f"{option} has '{name}={value}', needs a {'whole ' if kinds[name] is int else ''}number") from None
    return given


@dataclass(frozen=True)
class BoxNoise:
    """Errors of boxes. misses: probability that a box is missing. edges: standard deviation of each edge, as a share of the box's width or height.

    The errors of all boxes and edges are independent. Raises ValueError for a value out of bounds.
    """

    misses: float = 0.0
    edges: float = 0.0

    def __post_init__(self) -> None:
        for name in ("misses", "edges"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} is {getattr(self, name)}, needs 0 to 1")

    @staticmethod
    def parse(text: str) -> BoxNoise:
        """Parse misses=P,edges=S in any order, each at most once. Raises ValueError that names the invalid part."""
        return BoxNoise(**_parsed(text, {"misses": float, "edges": float}, "--project"))

    def __str__(self) -> str:
        return f"misses={self.misses},edges={self.edges}"

    def apply(self, boxes: FrameBoxes, camera: Camera, rng: np.random.Generator) -> dict[int, tuple[Array, Array]]:
        """The boxes with misses and noise, within the image."""
        out = {}
        for frame, (box, confidence) in sorted(boxes.items()):
            kept = rng.random(len(box)) >= self.misses
            box, confidence = box[kept], confidence[kept]
            noise = self.edges * rng.normal(size=(len(box), 4)) * box[:, [2, 3, 2, 3]]
            low, high = box[:, :2] + noise[:, :2], box[:, :2] + box[:, 2:] + noise[:, 2:]
            out[frame] = boxes_from_edges(camera, clipped(np.minimum(low, high), np.maximum(low, high), camera)), confidence
        return out


def projected_boxes(recording: Recording, noise: BoxNoise | None = None, seed: int = 0) -> Recording:
    """The recording with the boxes of upright bodies at its true positions in place of its detections, in all cameras.

    Occlusion is ignored. A box is the part of a body's box in the image.
    Each camera has a random stream of its own, by its name and `seed`. Cameras on robots need the robots' true poses.
    Raises ValueError for a recording without truth, and for a camera on a robot without true poses.
    """
    if recording.truth is None:
        raise ValueError("the recording has no truth, which projected boxes need")
    detections = {}
    for name, camera in recording.cameras.items():
        if camera.robot is not None and recording.robots[camera.robot].truth is None:
            raise ValueError(f"camera {name} is on robot {camera.robot}, which has no true poses (robot_truth.csv), which projected boxes need")
        boxes: dict[int, tuple[Array, Array]] = {}
        for frame, (_, feet) in sorted(recording.truth_of(name).items()):
            pose = recording.pose_at(camera, frame)
            box = np.zeros((0, 4)) if pose is None else body_boxes(camera.camera, pose, feet, BODY)
            boxes[frame] = box, np.full(len(box), CONFIDENCE)
        detections[name] = boxes
    noisy = noisy_boxes(replace(recording, detections=detections, appearances={}, covariances={}, visible_parts={}), noise, seed)
    made = {"height": BODY[0], "width": BODY[1], **noisy.source["noisy_boxes"]}
    return replace(noisy, source={**recording.source, "projected_boxes": made})


def noisy_boxes(recording: Recording, noise: BoxNoise | None = None, seed: int = 0) -> Recording:
    """The recording with errors of its detections, for instance of labelled boxes.

    Each camera has a random stream of its own, by its name and `seed`.
    """
    noise = noise or BoxNoise()
    detections = {name: noise.apply(boxes, recording.cameras[name].camera, stream(seed, name)) for name, boxes in recording.detections.items()}
    source = {**recording.source, "noisy_boxes": {"misses": noise.misses, "edges": noise.edges, "seed": seed}}
    return replace(recording, detections=detections, appearances={}, covariances={}, visible_parts={}, source=source)


@dataclass(frozen=True)
class Degradation:
    """drop: probability that a box is dropped. clutter: false boxes per view and frame. noise: standard deviation of the position, px per axis.

    Raises ValueError for a value out of bounds.
    """

    drop: float = 0.0
    clutter: int = 0
    noise: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.drop <= 1:
            raise ValueError(f"drop is {self.drop}, needs 0 to 1")
        if not 0 <= self.clutter <= 1000:
            raise ValueError(f"clutter is {self.clutter}, needs 0 to 1000")
        if not 0 <= self.noise < np.inf:
            raise ValueError(f"noise is {self.noise} px, needs 0 or more")

    @staticmethod
    def parse(text: str) -> Degradation:
        """Parse drop=P,clutter=N,noise=PX in any order, each at most once. Raises ValueError that names the invalid part."""
        return Degradation(**_parsed(text, {"drop": float, "clutter": int, "noise": float}, "--degrade"))

    def apply(
        self,
        boxes: FrameBoxes,
        frames: Iterable[int],
        view: tuple[Camera, Pose],
        place: tuple[Array | None, Ground],
        rng: np.random.Generator,
    ) -> FrameBoxes:
        """The degraded boxes of the frames of a view (camera model, T_world_camera).

        place: area (2, 2) m and ground. False boxes have feet uniform in the area on the ground, and statures uniform in HEIGHTS.
        Their confidences are drawn from those of the given boxes, of at least 0.5 where possible.
        A position outside the image is drawn again, up to MAX_TRIES times.
        """
        likely = np.concatenate([c for _, c in boxes.values()] or [np.ones(1)])
        # Detectors report many false boxes of low confidence. The added boxes must look like true ones, so low confidences are left out.
        likely = likely[likely >= 0.5] if (likely >= 0.5).any() else likely
        degraded: dict[int, tuple[Array, Array]] = {}
        for frame in frames:
            box, confidence = boxes.get(frame, (np.zeros((0, 4)), np.zeros(0)))
            kept = rng.random(len(box)) >= self.drop
            box = box[kept] + np.column_stack([rng.normal(0.0, 1.0, (int(kept.sum()), 2)) * self.noise, np.zeros((int(kept.sum()), 2))])
            false = [b for _ in range(self.clutter) if (b := _false_box(view, place, rng)) is not None]
            degraded[frame] = (
                np.concatenate([box, np.array(false).reshape(-1, 4)]),
                np.concatenate([confidence[kept], rng.choice(likely, len(false))]),
            )
        return degraded


def degraded_boxes(recording: Recording, degradation: Degradation, seed: int) -> Recording:
    """The recording with degraded detections. Each camera with detections has a random stream of its own, by its name and `seed`.

    Raises ValueError for false boxes without an area, or with cameras on robots.
    """
    area: Any = recording.area
    if degradation.clutter and (area is None or recording.robots):
        raise ValueError("--degrade clutter needs fixed cameras and an area for the false people")
    detections = {}
    for name, given in recording.detections.items():
        camera = recording.cameras[name]
        view, place = (camera.camera, camera.pose), (area, recording.ground)
        frames = recording.own_frames(name)
        detections[name] = degradation.apply(given, frames, view, place, stream(seed, name))
    return replace(recording.with_detections(detections), searched=recording.searched)


def _false_box(view: tuple[Camera, Pose], place: tuple[Array | None, Ground], rng: np.random.Generator) -> Array | None:
    """A false box (4,) px; None where no drawn position lies in the image."""
    (camera, pose), (area, ground) = view, place
    if area is None:
        raise ValueError("area is unknown, needs one for false boxes")
    for _ in range(MAX_TRIES):
        x, y = rng.uniform(area[0], area[1])
        z = float(ground.height_at([[x, y]])[0])
        rays = np.array([[x, y, z], [x, y, z + rng.uniform(*HEIGHTS)]]) - pose.translation
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        pixels, inside = camera.pixels_from_bearings(rays @ pose.rotation)
        height = pixels[0, 1] - pixels[1, 1]
        if inside.all() and height > 1:
            return np.array([pixels[0, 0] - WIDTH * height / 2, pixels[1, 1], WIDTH * height, height])
    return None
