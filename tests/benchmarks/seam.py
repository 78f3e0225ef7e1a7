"""People across the seam of panoramas: recall of our detector where they stand, and where the panorama is turned until each stands on the seam.

    python -m tests.benchmarks.detectors --seam [--held-out DIR] [--people 300] [--model FILE.onnx]

Panoramas are those of the held-out worlds of `train-detector`, seeds 2000 to 2004, which are rendered into a temporary folder.
`--held-out` takes or makes them in the folder of a training. People are seen by half at least, and 20 to 256 px high.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.training.evaluation import HEIGHTS, SEEN
from sim.training.scene_rendering import PANORAMAS, ImageSet, SceneTask
from sim.training.training import TrainingPlan
from tracker.geometry import Array, Image
from tracker.geometry.cameras import Panorama
from tracker.geometry.image_boxes import box_overlaps
from tracker.io.progress import progress_bar
from tracker.metrics.box_detection import IOU
from tracker.person_detector.detector import CameraPlace, PersonDetector

BOUND = 0.03
"""Largest difference of the recalls that is wanted."""
RESAMPLES = 2000
Person = tuple[Image, Array]
"""A panorama (H, W, 3), and the box (4,) of a person in it: left, top, right, bottom px."""


@dataclass(frozen=True, eq=False)
class SeamRecall:
    """Of people (n,): whether each is found where it stands and on the seam, and the number of boxes that it has on the seam."""

    elsewhere: Array
    across: Array
    boxes: Array

    @property
    def difference(self) -> tuple[float, float, float]:
        """Recall across the seam less that elsewhere, and bounds of its interval of 95 % by bootstrap of the pairs."""
        change, rng = self.across - self.elsewhere, np.random.default_rng(0)
        means = change[rng.integers(len(change), size=(RESAMPLES, len(change)))].mean(axis=1)
        low, high = np.quantile(means, (0.025, 0.975))
        return float(change.mean()), float(low), float(high)


def seam_recall(detector: PersonDetector, people: Iterator[Person], least: float = 0.0) -> SeamRecall:
    """Recall of people where they stand and on the seam. least: lowest probability of a box. People whose own box crosses the seam are left out."""
    rows: list[tuple[int, int, int]] = []
    for image, box in people:
        width = image.shape[1]
        if box[0] < 0 or box[2] > width:
            continue
        turn = -round(float(box[0] + box[2]) / 2)
        found = [_overlapping(detector, np.roll(image, by, axis=1), box + by * np.array([1, 0, 1, 0]), least) for by in (0, turn)]
        rows.append((found[0] > 0, found[1] > 0, found[1]))
    return SeamRecall(*np.array(rows, dtype=np.float64).reshape(-1, 3).T)


def _overlapping(detector: PersonDetector, image: Image, box: Array, least: float) -> int:
    """Number of boxes found that overlap a box (4,) px of a panorama by IOU."""
    found = detector.find(np.ascontiguousarray(image), CameraPlace(Panorama(image.shape[1], image.shape[0])))
    edges = np.concatenate([found.box[:, :2], found.box[:, :2] + found.box[:, 2:]], axis=1)[found.score >= least]
    return int((box_overlaps(box[None], edges, float(image.shape[1])) >= IOU).sum())


def held_out_people(tasks: list[SceneTask], most: int) -> Iterator[Person]:
    """At most `most` people of the panoramas of scenes, which are rendered where they are not on disk; the same share of each scene."""
    for task in tasks:
        task.folder.parent.mkdir(parents=True, exist_ok=True)
        task.run()
    scenes = [ImageSet.read(task.folder, PANORAMAS) for task in tasks]
    wanted = []
    for scene in scenes:
        height = scene.boxes[:, 3] - scene.boxes[:, 1]
        inside = (scene.boxes[:, 1] >= 0) & (scene.boxes[:, 3] <= scene.instances.shape[1])
        wanted += [(scene, k) for k in np.flatnonzero(inside & (scene.visible >= SEEN) & (height >= HEIGHTS[0]) & (height < HEIGHTS[1]))]
    for index in np.unique(np.linspace(0, len(wanted) - 1, min(most, len(wanted))).astype(int)).tolist():
        scene, k = wanted[index]
        yield np.asarray(scene.colour[scene.image[k]]), scene.boxes[k]


def run(model: Path | None, held_out: Path | None, most: int) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        people = held_out_people(TrainingPlan().tasks(held_out or Path(folder))["held-out"], most)
        recall = seam_recall(PersonDetector(model), iter(progress_bar(people, total=most, desc="people", unit="person")))
    change, low, high = recall.difference
    print("| people | recall elsewhere | across the seam | difference | with more than one box there |\n" + "|---" * 5 + "|")
    interval = f"{change:+.3f} ({low:+.3f} to {high:+.3f})"
    print(f"| {len(recall.across)} | {recall.elsewhere.mean():.3f} | {recall.across.mean():.3f} | {interval} | {int((recall.boxes > 1).sum())} |")
    print(f"\nThe bound is {BOUND} in size.")
