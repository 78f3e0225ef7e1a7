"""Training of the person detector in one call: scenes are rendered, the network is trained, exported, calibrated and scored. Needs the extra `train`.

Every step keeps what it has made in the folder, so that the same call continues after an interruption.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.parallel.pool import Pool
from sim.training.augmentation import CropSampler
from sim.training.evaluation import MIN_SCORE, ROOM, Calibration, FoundImage, calibrate, feet_errors, figures, found_images, heights_of
from sim.training.scene_rendering import PANORAMAS, PINHOLES, PLACES, ROOMS, ImageSet, SceneTask, scene_tasks
from tracker.io.atomic import write_text
from tracker.io.file_lock import folder_lock
from tracker.io.json_files import read_json
from tracker.io.progress import progress_bar
from tracker.io.resume import check_same, holds_run
from tracker.person_detector.detector import PersonDetector
from worlds.scenes import meeting_room

HELD_OUT_SEED = 2000
"""Seed of the first held-out worlds. Training and calibration have seeds from 10,000 on."""
SEEDS_A_RUN, CALIBRATION_SEEDS = 10_000, 5_000
"""Distance of the first seeds of two runs, and of the first scenes of calibration from those of training."""
JUDGED = {"moments": 4, "panoramas": 1, "pinholes": 2}
"""Sizes of the scenes of calibration and evaluation."""
ORDER, DATA, MODEL, FIGURES, CURVES, FRAMES = "order.json", "data", "person_detector.onnx", "figures.json", "curves.png", "frames.png"
SHOWN_FRAMES = 10
MOST_ROOMS, JUDGED_ROOMS = 30, JUDGED | {"moments": 2}
"""Largest number of held-out meeting rooms, and their sizes. A room holds few people, so that figures of few rooms vary."""
OFF = {"rich": None, "rooms": None, "judged_rooms": None, "start": None, "earlier": None}
"""Entries of an order that are left out where their option is off."""
UNCALIBRATED = {"version": 1, "calibration": [[-10.0, 0.0], [10.0, 1.0]], "min_score": 0.0, "nms_iou": 1.0}
"""Metadata of the model during its calibration."""
RANGE_BATCHES = 12
"""Number of batches of crops, after those of the training, that set the ranges of activations."""
OPEN_FILES = 1 << 16
"""Number of files that are open at most; rendered scenes stay on disk."""
NEEDED = ("torch", "onnx", "onnxruntime")
"""Packages of the extra `train`."""


@dataclass(frozen=True)
class TrainingPlan:
    """A training. seed: of all draws. scenes, moments: rendered scenes, and moments of each. steps: of the optimizer.

    calibration, held_out: number of scenes for the calibration and for the evaluation. workers: number of processes; it changes no result.
    rich: whether scenes, except the held-out worlds, have people in groups, sitters, varied clothing and wet ground.
    It also adds meeting rooms, to the held-out scenes, too. start: a model with the initial weights, None for random weights.
    earlier: folders of trainings whose rendered scenes are used, too. Raises ValueError for a number out of bounds.
    """

    seed: int = 0
    scenes: int = 96
    moments: int = 10
    steps: int = 12_000
    calibration: int = 18
    held_out: int = 35
    workers: int = 2
    rich: bool = True
    start: Path | None = None
    earlier: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        bounds = {"seed": (0, 10**6), "scenes": (1, 5000), "moments": (1, 1000), "steps": (1, 10**7)}
        for name, (low, high) in (bounds | {"calibration": (1, 5000), "held_out": (1, 5000), "workers": (1, 1024)}).items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name} is {value}, needs {low} to {high}")

    @property
    def order(self) -> dict[str, Any]:
        """The options that decide the result, as JSON values. Newer options appear only where they are on, so that older orders stay valid.

        Raises OSError or ValueError where the model to start from or an earlier training cannot be read.
        """
        numbers = {name: value for name, value in dataclasses.asdict(self).items() if name not in ("workers", "rich", "start", "earlier")}
        start = {} if self.start is None else {"start": hashlib.sha256(self.start.read_bytes()).hexdigest()}
        earlier = {"earlier": [read_json(folder / ORDER) for folder in self.earlier]} if self.earlier else {}
        return numbers | ({"rich": True, "rooms": ROOMS, "judged_rooms": self.rooms} if self.rich else {}) | start | earlier

    @property
    def rooms(self) -> int:
        """Number of held-out rooms."""
        return min(self.held_out, MOST_ROOMS) if self.rich else 0

    def scenes_of(self, folder: Path) -> list[Path]:
        """Folders of the rendered scenes, those of earlier trainings first.

        Raises ValueError for an earlier training whose scenes are not all there.
        """
        out = []
        for source, count in (*((earlier, read_json(earlier / ORDER)["scenes"]) for earlier in self.earlier), (folder, self.scenes)):
            scenes = sorted(one.parent for one in (source / DATA).glob(f"scene-*/{PINHOLES}.npz"))
            if len(scenes) != count and source != folder:
                raise ValueError(f"{source}: has {len(scenes)} of its {count} scenes, needs all; finish its training first")
            out += scenes
        return out

    def tasks(self, folder: Path) -> dict[str, list[SceneTask]]:
        """The scenes to be rendered, by their purpose: data, calibration, held-out and, of meeting rooms, rooms."""
        first, names = SEEDS_A_RUN * (self.seed + 1), PLACES
        places = [(HELD_OUT_SEED + k // len(names), names[k % len(names)]) for k in range(self.held_out)]
        unseen = folder / "held-out"
        rooms = [(HELD_OUT_SEED + k, meeting_room.NAME) for k in range(self.rooms)]
        return {
            "data": scene_tasks(folder / DATA, self.scenes, first, {"moments": self.moments}, self.rich),
            "calibration": scene_tasks(folder / "calibration", self.calibration, first + CALIBRATION_SEEDS, JUDGED, self.rich),
            "held-out": [SceneTask(unseen / f"{world}-{seed}", seed, world, **JUDGED, plain=True, rich=False) for seed, world in places],
            "rooms": [SceneTask(unseen / f"{world}-{seed}", seed, world, **JUDGED_ROOMS, plain=False, rich=True) for seed, world in rooms],
        }


def check_needed() -> None:
    """Raises ValueError, with the way to install it, where a package of the extra `train` is missing."""
    for name in NEEDED:
        if importlib.util.find_spec(name) is None:
            raise ValueError(f"training needs {name}: pip install 'pilsim[train]'")


def train_detector(plan: TrainingPlan, folder: Path) -> dict[str, Any]:
    """Make the model in `folder` and return its figures. Files: person_detector.onnx, figures.json, curve.csv, curves.png, frames.png.

    The same plan gives the same figures on the same machine. Raises ValueError where a package is missing, or where the folder holds another
    training or other files. Raises OSError where a worker is lost.
    """
    check_needed()
    _check_folder(plan, folder)
    plan.scenes_of(folder)
    _allow_open_files()
    with folder_lock(folder):
        _check_folder(plan, folder)
        if (folder / FIGURES).exists():
            return dict(read_json(folder / FIGURES))
        write_text(folder / ORDER, json.dumps(plan.order, indent=1) + "\n")
        tasks = plan.tasks(folder)
        _render([task for some in tasks.values() for task in some], plan.workers)
        scenes = plan.scenes_of(folder)
        sampler = CropSampler(_sets(scenes, PANORAMAS), _sets(scenes, PINHOLES), plan.seed)
        if not sampler.panoramas and not sampler.pinholes:
            raise ValueError(f"scenes is {plan.scenes}: no camera saw a person, needs more scenes")
        return _trained(plan, folder, tasks, sampler)


def _check_folder(plan: TrainingPlan, folder: Path) -> None:
    if holds_run(folder, ORDER, (".*",)):
        check_same(folder, read_json(folder / ORDER), OFF | plan.order, "another training")


def _allow_open_files() -> None:
    """Raise the number of files that this process and its workers may open: four of each scene are mapped."""
    if importlib.util.find_spec("resource") is None:
        # Windows has no such limit.
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard == resource.RLIM_INFINITY:
        hard = OPEN_FILES
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, OPEN_FILES)), hard))


def _render(tasks: list[SceneTask], workers: int) -> None:
    missing = [task for task in tasks if not task.complete]
    if not missing:
        return
    for folder in {task.folder.parent for task in missing}:
        folder.mkdir(parents=True, exist_ok=True)
    done = Pool(workers).as_completed(SceneTask.run, ((task,) for task in missing))
    for _ in progress_bar(done, total=len(missing), desc="scenes", unit="scene"):
        pass


def _sets(scenes: list[Path], kind: str) -> list[ImageSet]:
    """The images of a kind of all scenes, by their folders, that have some."""
    return [images for scene in scenes if len((images := ImageSet.read(scene, kind)).colour)]


def _trained(plan: TrainingPlan, folder: Path, tasks: dict[str, list[SceneTask]], sampler: CropSampler) -> dict[str, Any]:
    from sim.training.network import parameter_count
    from sim.training.onnx_model import describe, export
    from sim.training.optimization import optimize

    network = optimize(sampler, plan.steps, folder, plan.workers - 1, plan.start)
    bodies = sum(len(images.boxes) for images in (*sampler.panoramas, *sampler.pinholes))
    pictures = sum(len(images.colour) for images in (*sampler.panoramas, *sampler.pinholes))
    data = {"images": pictures, "bodies": bodies, **plan.order}
    # The scores are not calibrated yet, but the graph is what will be shipped.
    model = folder / MODEL
    export(network, model, (sampler.batch(plan.steps + k)["picture"] for k in range(RANGE_BATCHES)))
    describe(model, UNCALIBRATED)
    detector = PersonDetector(model)
    calibration = calibrate([image for kind in (PANORAMAS, PINHOLES) for image in _found(detector, tasks["calibration"], kind)])
    kinds = {title: _found(detector, own, kind) for title, (own, kind) in _judged(tasks).items()}
    result = _figures(kinds, calibration) | {"parameters": parameter_count(network), "data": data, "nms_iou": calibration.nms_iou}
    _draw(folder, kinds, _judged(tasks), calibration)
    describe(model, _entry(plan, calibration, data, result))
    write_text(folder / FIGURES, json.dumps(result, indent=1) + "\n")
    return result


def _judged(tasks: dict[str, list[SceneTask]]) -> dict[str, tuple[list[SceneTask], str]]:
    """Title of each part of the figures → its scenes and the kind of its images."""
    parts = {"": tasks["held-out"], ROOM: tasks["rooms"]}
    return {f"{where}{kind}": (own, kind) for where, own in parts.items() for kind in (PANORAMAS, PINHOLES) if own}


def _found(detector: PersonDetector, tasks: list[SceneTask], kind: str) -> list[FoundImage]:
    sets = ((task.world, ImageSet.read(task.folder, kind)) for task in tasks)
    return found_images(detector, progress_bar(sets, total=len(tasks), desc=f"{kind}s", unit="scene"), kind == PANORAMAS)


def _figures(kinds: dict[str, list[FoundImage]], calibration: Calibration) -> dict[str, Any]:
    """By title: average precisions, number of bodies, and mean and standard deviation of the feet's error over the height."""
    out: dict[str, Any] = {}
    for kind, images in kinds.items():
        feet = feet_errors(images, calibration.nms_iou, heights_of(kind))
        spread = {"feet, mean": float(feet.mean()), "feet, deviation": float(feet.std())} if len(feet) else {}
        named = figures(images, calibration.nms_iou, heights_of(kind)) | {name: round(value, 4) for name, value in spread.items()}
        # JSON has no NaN: figures without bodies are left out.
        out[kind] = {name: value for name, value in named.items() if np.isfinite(value)}
    return out


def _entry(plan: TrainingPlan, calibration: Calibration, data: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    """The metadata of the model."""
    headline = {title: part.get("ap50") for title, part in result.items() if title.endswith((PANORAMAS, PINHOLES))}
    corners = [list(corner) for corner in calibration.corners]
    fixed = {"version": 1, "calibration": corners, "min_score": MIN_SCORE, "nms_iou": calibration.nms_iou}
    return fixed | {"seed": plan.seed, "data": data, "time": f"{plan.steps} steps", "figures": headline}


def _draw(folder: Path, kinds: dict[str, list[FoundImage]], judged: dict[str, tuple[list[SceneTask], str]], calibration: Calibration) -> None:
    from sim.training.curves import draw_curves, draw_frames
    from sim.training.optimization import CHECKPOINT, TrainingState

    logits, probabilities = np.array(calibration.corners).T
    known = (logits, probabilities, calibration.nms_iou)
    draw_curves(TrainingState.read(folder / CHECKPOINT, 0).rows, kinds, known, folder / CURVES)
    shown = []
    for title, images in kinds.items():
        tasks, kind = judged[title]
        places = [(of, index) for task in tasks for of in [ImageSet.read(task.folder, kind)] for index in range(len(of.colour))]
        for k in np.unique(np.linspace(0, len(places) - 1, min(SHOWN_FRAMES // 2, len(places))).astype(int)).tolist():
            shown.append((*places[k], images[k]))
    if shown:
        draw_frames(shown, known, folder / FRAMES)
