"""Boxes of upright bodies at the true positions, and boxes with misses and noise, for data that come with truth and without a detector's boxes."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np

from tracker.geometry import Array, Ints, Pose
from tracker.geometry.camera_protocol import Camera
from tracker.recordings import FrameBoxes, Recording, RecordingCamera

CORNERS = 16
"""Points around each end of the cylinder that stands for a body."""
LEAST_VISIBLE = 0.25
"""Bodies of which a smaller share of the box lies in the image have no box."""
CONFIDENCE = 1.0
"""Of all boxes: the projection knows nothing of how sure a detector would be."""


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
        given: dict[str, float] = {}
        for part in filter(None, (p.strip() for p in text.split(","))):
            name, _, value = part.partition("=")
            try:
                number = float(value)
            except ValueError:
                number = float("nan")
            if name not in ("misses", "edges") or name in given or not 0 <= number <= 1:
                raise ValueError(f"--project has {part!r}, needs misses=P,edges=S, each once and from 0 to 1")
            given[name] = number
        return BoxNoise(**given)

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
            noisy = clipped(np.minimum(low, high), np.maximum(low, high), camera)
            out[frame] = np.column_stack([_in_turn(noisy[:, :1], camera), noisy[:, 1:2], noisy[:, 2:] - noisy[:, :2]]), confidence
        return out


def projected_boxes(recording: Recording, noise: BoxNoise | None = None, seed: int = 0, body: tuple[float, float] = (1.75, 0.5)) -> Recording:
    """The recording with the boxes of upright bodies at its true positions in place of its detections, in all cameras.

    body: height and width, m, of the cylinder that stands for a body. Bodies hide nobody. A box is the part of a body's box in the image.
    Each camera has a random stream of its own, by its name and `seed`. Cameras on robots need the robots' true poses.
    Raises ValueError for a recording without truth, and for a camera on a robot without true poses.
    """
    if recording.truth is None:
        raise ValueError("the recording has no truth, which projected boxes need")
    for name, camera in recording.cameras.items():
        if camera.robot is not None and recording.robots[camera.robot].truth is None:
            raise ValueError(f"camera {name} is on robot {camera.robot}, which has no true poses (robot_truth.csv), which projected boxes need")
    detections = {}
    for name, camera in recording.cameras.items():
        boxes: dict[int, tuple[Array, Array]] = {}
        for frame, (_, feet) in sorted(recording.truth.items()):
            pose = pose_at(recording, camera, frame)
            box = np.zeros((0, 4)) if pose is None else body_boxes(camera.camera, pose, feet, body)
            boxes[frame] = box, np.full(len(box), CONFIDENCE)
        detections[name] = boxes
    noisy = noisy_boxes(replace(recording, detections=detections), noise, seed)
    made = {"height": body[0], "width": body[1], **noisy.source["noisy_boxes"]}
    return replace(noisy, source={**recording.source, "projected_boxes": made})


def noisy_boxes(recording: Recording, noise: BoxNoise | None = None, seed: int = 0) -> Recording:
    """The recording with errors of its detections, for instance of labelled boxes.

    Each camera has a random stream of its own, by its name and `seed`.
    """
    noise, detections = noise or BoxNoise(), {}
    for name, boxes in recording.detections.items():
        rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        detections[name] = noise.apply(boxes, recording.cameras[name].camera, rng)
    source = {**recording.source, "noisy_boxes": {"misses": noise.misses, "edges": noise.edges, "seed": seed}}
    return replace(recording, detections=detections, source=source)


def pose_at(recording: Recording, camera: RecordingCamera, frame: int) -> Pose | None:
    """T_world_camera in a frame, None where the true pose of its robot is not known."""
    if camera.robot is None:
        return camera.pose
    truth = recording.robots[camera.robot].truth or {}
    return truth[frame] @ camera.pose if frame in truth else None


def body_boxes(camera: Camera, T_world_camera: Pose, feet: Array, body: tuple[float, float] = (1.75, 0.5)) -> Array:
    """Boxes (m, 4) left, top, width, height px of the bodies in the image, of bodies at feet (k, 3) m, world.

    body: height and width, m, of an upright cylinder. Bodies with a point that the camera cannot project (behind it, or beyond the fold) have none.
    Boxes of panoramas have left in [0, W), and left + width may exceed W.
    """
    _, low, high = body_outlines(camera, T_world_camera, feet, body)
    seen = clipped(low, high, camera)
    size, whole = seen[:, 2:] - seen[:, :2], high - low
    shown = np.prod(size, axis=1) > LEAST_VISIBLE * np.prod(whole, axis=1)
    boxes = np.concatenate([_in_turn(seen[:, :1], camera), seen[:, 1:2], size], axis=1)
    return np.asarray(boxes[shown])


def body_outlines(
    camera: Camera, T_world_camera: Pose, feet: Array, body: tuple[float | Array, float] = (1.75, 0.5)
) -> tuple[Ints, Array, Array]:
    """Outlines of bodies, also where they lie beyond the image: rows (m,) of `feet`, and lowest and highest corner (m, 2) px of each.

    feet (k, 3) m, world. body: height, of all or (k,), and width, m, of upright cylinders.
    Bodies with a point that the camera cannot project are left out.
    Outlines in panoramas are not brought into [0, W).
    """
    height, width = body
    around = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    ring = width / 2 * np.column_stack([np.cos(around), np.sin(around), np.zeros(CORNERS)])
    # The last point, in the middle, tells on which side of the seam of a panorama the body is.
    level = np.concatenate([ring, ring, np.zeros((1, 3))])
    up = np.concatenate([np.zeros(CORNERS), np.ones(CORNERS), [0.5]])[:, None] * np.array([0.0, 0.0, 1.0])
    cylinders = level + np.reshape(height, (-1, 1, 1)) * up
    points = (np.asarray(feet, dtype=np.float64).reshape(-1, 1, 3) + cylinders).reshape(-1, 3)
    rays = T_world_camera.inverse().apply(points)
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9)
    pixels = camera.pixels_from_bearings(rays)[0].reshape(-1, len(level), 2)
    rows = np.flatnonzero(np.isfinite(pixels).all(axis=(1, 2)))
    pixels = pixels[rows]
    if camera.wraps:
        apart = pixels[:, :, 0] - pixels[:, -1:, 0]
        pixels[:, :, 0] = pixels[:, -1:, 0] + np.mod(apart + camera.width / 2, camera.width) - camera.width / 2
    return rows, pixels[:, :-1].min(axis=1), pixels[:, :-1].max(axis=1)


def clipped(low: Array, high: Array, camera: Camera) -> Array:
    """Corners low and high (n, 2) px → edges left, top, right, bottom (n, 4) px of the part in the image; panoramas have no left and right end."""
    first = camera.pixel_centre - 0.5
    least, most = np.array([first, first]), np.array([first + camera.width, first + camera.height])
    if camera.wraps:
        least[0], most[0] = -np.inf, np.inf
    return np.concatenate([np.clip(low, least, most), np.clip(high, least, most)], axis=1)


def _in_turn(left: Array, camera: Camera) -> Array:
    return np.asarray(np.mod(left, camera.width)) if camera.wraps else left
