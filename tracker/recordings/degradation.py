"""Degradation of detections for tests of robustness: boxes are dropped, false boxes are added, positions get noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Ground

HEIGHTS = (1.5, 2.0)
"""m: lowest and highest stature for false boxes."""
WIDTH = 0.4
"""Width of a false box over its height."""
MAX_TRIES = 20
"""Most positions that are drawn for a false box until one lies in the image."""

Boxes = Mapping[int, tuple[Array, Array]]
"""Frame from 0 → boxes (n, 4) left, top, width, height px and confidence (n,)."""


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
        given: dict[str, float] = {}
        names = [f.name for f in fields(Degradation)]
        for part in filter(None, (p.strip() for p in text.split(","))):
            name, _, value = part.partition("=")
            if name not in names or name in given:
                raise ValueError(f"--degrade has {part!r}, needs {', '.join(n + '=…' for n in names)}, each once")
            try:
                given[name] = int(value) if name == "clutter" else float(value)
            except ValueError:
                raise ValueError(f"--degrade has {part!r}, needs a {'whole ' if name == 'clutter' else ''}number") from None
        return Degradation(given.get("drop", 0.0), int(given.get("clutter", 0)), given.get("noise", 0.0))

    def apply(
        self,
        boxes: Boxes,
        frames: int,
        view: tuple[Camera, Pose],
        place: tuple[Array | None, Ground],
        rng: np.random.Generator,
    ) -> Boxes:
        """The degraded boxes of the first `frames` frames of a view (camera model, T_world_camera).

        place: area (2, 2) m and ground. False boxes have feet uniform in the area on the ground, and statures uniform in HEIGHTS.
        Their confidences are drawn from those of the given boxes, of at least 0.5 where possible.
        A position outside the image is drawn again, up to MAX_TRIES times.
        """
        likely = np.concatenate([c for _, c in boxes.values()] or [np.ones(1)])
        # Detectors report many false boxes of low confidence. The added boxes must look like true ones, so low confidences are left out.
        likely = likely[likely >= 0.5] if (likely >= 0.5).any() else likely
        degraded: dict[int, tuple[Array, Array]] = {}
        for frame in range(frames):
            box, confidence = boxes.get(frame, (np.zeros((0, 4)), np.zeros(0)))
            kept = rng.random(len(box)) >= self.drop
            box = box[kept] + np.column_stack([rng.normal(0.0, 1.0, (int(kept.sum()), 2)) * self.noise, np.zeros((int(kept.sum()), 2))])
            false = [b for _ in range(self.clutter) if (b := _false_box(view, place, rng)) is not None]
            degraded[frame] = (
                np.concatenate([box, np.array(false).reshape(-1, 4)]),
                np.concatenate([confidence[kept], rng.choice(likely, len(false))]),
            )
        return degraded


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
