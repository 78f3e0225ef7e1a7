"""The simulated detectors of all views of a run, by a detector model. Each has its own random stream.

They give the same detections with and without rendering where the truth of the views is the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import final

import numpy as np

from sim.scenario import Scenario
from tracker.detections.boxes import detections_from_boxes
from tracker.detector_models.bodies import BODY, LEAST_IN_IMAGE, Place, TrueBodies, outlined
from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import DetectorModel, Model, model_of
from tracker.detector_models.sampler import ViewSampler
from tracker.geometry import Array, Ints
from tracker.geometry.cameras import Camera
from tracker.geometry.image_boxes import body_outlines
from tracker.types import Detections, Mount, ViewTruth

BORDER = 1.0
"""px: the border of the image cuts an edge of a box that is nearer to it than this."""


def view_detectors(scenario: Scenario, mounts: Mapping[str, Mount], persons: Iterable[int]) -> dict[str, ViewDetector]:
    """Camera → its simulated detector, by the `detector_model` of a scenario. persons: ids of all people of the run."""
    errors = IndependentErrors(scenario.misses, scenario.clutter, scenario.bearing_noise, scenario.min_visible)
    model, people = model_of(scenario.detector_model, errors), list(persons)
    return {
        name: ViewDetector(model, mount.camera, (mount.period or scenario.period, people), scenario.stream(f"detector/{name}"))
        for name, mount in mounts.items()
    }


@final
class ViewDetector:
    """The simulated detector of one view by a model: call `detect` once a frame.

    run: period s, and ids of all people of the run. rng: the random stream of the view.
    """

    def __init__(self, model: Model, camera: Camera, run: tuple[float, Iterable[int]], rng: np.random.Generator) -> None:
        self.model, self.camera, self.rng = model, camera, rng
        self.sampler = None if isinstance(model, IndependentErrors) else ViewSampler(model, camera, *run, rng)

    def detect(self, view: ViewTruth, persons: Ints, feet: Array) -> Detections:
        """Detections of the next frame; arguments as in `true_bodies`."""
        if isinstance(self.model, IndependentErrors):
            return self.model.detect(self.camera, view, self.rng)
        assert self.sampler is not None
        bodies = true_bodies(self.model, self.camera, view, persons, feet)
        made = self.sampler.step(bodies, Place(view.T_world_camera, view.ground))
        return detections_from_boxes(self.camera, made.boxes, made.confidence)


def true_bodies(model: DetectorModel, camera: Camera, view: ViewTruth, persons: Ints, feet: Array) -> TrueBodies:
    """The bodies in a view, as the model's errors refer to them: true boxes, or projected bodies of one stature.

    persons (m,) and feet (m, 3) m of all people who are present. The visible parts are those of the true boxes.
    """
    boxes = view.boxes
    row_of = {int(person): k for k, person in enumerate(persons)}
    at = np.array([row_of[int(person)] for person in boxes.person], dtype=np.int64)
    rows, low, high = body_outlines(camera, view.T_world_camera, np.asarray(feet)[at].reshape(-1, 3), BODY)
    shift = camera.pixel_centre - 0.5
    full, seen = boxes.full[rows] + shift, boxes.seen[rows] + shift
    if camera.wraps:
        full, seen = (_turned(edges, (low + high)[:, 0] / 2, camera.width) for edges in (full, seen))
    whole, part, cut = outlined(camera, low, high)
    if model.bodies == "boxes":
        whole = _beyond_border(full, whole, camera)
        _, part, cut = outlined(camera, whole[:, :2], whole[:, 2:])
    size = np.maximum(full[:, 2:] - full[:, :2], 1e-9)
    lost = np.clip(np.concatenate([(seen[:, :2] - full[:, :2]) / size, (seen[:, 2:] - full[:, 2:]) / size], axis=1), -1.0, 1.0)
    shown = part + lost * np.tile(part[:, 2:] - part[:, :2], (1, 2))
    shown[boxes.visible[rows] <= 0] = 0.0
    kept = cut <= 1.0 - LEAST_IN_IMAGE
    r = rows[kept]
    return TrueBodies(boxes.person[r], whole[kept], shown[kept], boxes.visible[r], cut[kept], boxes.range[r])


def _beyond_border(full: Array, whole: Array, camera: Camera) -> Array:
    """True boxes (n, 4). Their edges at the border of the image are replaced by those of projected bodies that reach beyond it."""
    first = camera.pixel_centre - 0.5
    low, high = np.full(2, first + BORDER), np.array([first + camera.width - BORDER, first + camera.height - BORDER])
    if camera.wraps:
        low[0], high[0] = -np.inf, np.inf
    at = np.concatenate([full[:, :2] <= low, full[:, 2:] >= high], axis=1)
    farther = np.concatenate([np.minimum(full[:, :2], whole[:, :2]), np.maximum(full[:, 2:], whole[:, 2:])], axis=1)
    return np.where(at, farther, full)


def _turned(edges: Array, middle: Array, width: int) -> Array:
    """Boxes of a panorama moved by full turns to the nearest of the middles (n,) px."""
    turn = np.round((middle - edges[:, [0, 2]].mean(axis=1)) / width) * width
    return np.asarray(edges + turn[:, None] * np.array([1.0, 0.0, 1.0, 0.0]))
