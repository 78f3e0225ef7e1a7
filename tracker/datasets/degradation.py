"""Detections made worse on purpose: boxes lost, false boxes added, edges moved. Seeded; written as drop=P,clutter=N,noise=PX."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera

HEIGHTS = (1.5, 2.0)
"""m, heights of people who are not there."""
WIDTH = 0.4
"""Width of a false box over its height."""
TRIES = 20
"""Places that are drawn for a false box until one lies in the image."""

Boxes = dict[int, tuple[Array, Array]]
"""Frame → boxes (n, 4) left, top, width, height px and confidence (n,)."""


@dataclass(frozen=True)
class Degradation:
    """drop: share of boxes that is lost; clutter: false boxes a view and frame; noise: standard deviation of a box's place, px an axis."""

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
        """drop=P,clutter=N,noise=PX in any order, each at most once. Raises ValueError that names the part that is none."""
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

    def applied(self, boxes: Boxes, frames: int, view: tuple[Camera, Pose], area: Array, rng: np.random.Generator) -> Boxes:
        """The boxes of `frames` frames of a view (model, T_world_camera), frames from 1, made worse.

        False boxes: feet uniform in `area` (2, 2) m on the plane z = 0, heights uniform in HEIGHTS, confidence drawn from the true boxes'. A place
        outside the image is drawn again, up to TRIES times.
        """
        sure = np.concatenate([c for _, c in boxes.values()] or [np.ones(1)])
        # Most boxes of a detector are rubbish of low confidence: false ones shall look like true ones.
        sure = sure[sure >= 0.5] if (sure >= 0.5).any() else sure
        out: Boxes = {}
        for frame in range(1, frames + 1):
            box, confidence = boxes.get(frame, (np.zeros((0, 4)), np.zeros(0)))
            kept = rng.random(len(box)) >= self.drop
            box = box[kept] + np.column_stack([rng.normal(0.0, 1.0, (int(kept.sum()), 2)) * self.noise, np.zeros((int(kept.sum()), 2))])
            false = [b for _ in range(self.clutter) if (b := _false(view, area, rng)) is not None]
            out[frame] = (
                np.concatenate([box, np.array(false).reshape(-1, 4)]),
                np.concatenate([confidence[kept], rng.choice(sure, len(false))]),
            )
        return out


def _false(view: tuple[Camera, Pose], area: Array, rng: np.random.Generator) -> Array | None:
    """A box (4,) px of somebody who is not there; None where no place that was drawn lies in the image."""
    camera, pose = view
    for _ in range(TRIES):
        x, y = rng.uniform(area[0], area[1])
        sight = np.array([[x, y, 0.0], [x, y, rng.uniform(*HEIGHTS)]]) - pose.translation
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        pixels, inside = camera.pixels_from_bearings(sight @ pose.rotation)
        tall = pixels[0, 1] - pixels[1, 1]
        if inside.all() and tall > 1:
            return np.array([pixels[0, 0] - WIDTH * tall / 2, pixels[1, 1], WIDTH * tall, tall])
    return None
