"""Reading a PETS 2009 folder as a sequence: cameras, detections and ground truth."""

from __future__ import annotations

import hashlib
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tracker.datasets.degradation import Degradation
from tracker.detections.boxes import detections_from_boxes
from tracker.formats.pets2009 import AREA, FILE, RATE, TERRAIN, Site, ground_truth, read_annotations, read_camera, read_detections, read_site
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera
from tracker.types import Mount, Sequence, Setup, Start, Tick, TicksInMemory, Truth, View

PETS_AREA, PETS_RATE = AREA, RATE

PETS_VIEWS = (1, 5, 7)
"""Default views of S2.L1."""

MAX_FRAMES = 1_000_000


@dataclass(frozen=True, eq=False)
class PetsOptions:
    """How a PETS 2009 folder is read.

    detections: view number → another file of detections. degradation: of all detections, with a seed.
    """

    detections: Mapping[int, Path] = field(default_factory=dict)
    degradation: Degradation = Degradation()
    seed: int = 0

    @property
    def is_default(self) -> bool:
        """Whether the folder is read without changes."""
        return not self.detections and self.degradation == Degradation()

    @staticmethod
    def parse(detections: Iterable[str], degrade: str, seed: int) -> PetsOptions:
        """Parse command line options. detections: each VIEW=FILE. degrade: see Degradation.parse. Raises ValueError for an invalid value."""
        files: dict[int, Path] = {}
        for text in detections:
            number, _, file = text.partition("=")
            if not number.isdecimal() or not file or int(number) in files:
                raise ValueError(f"--detections is {text!r}, needs VIEW=FILE, each view once")
            if not Path(file).is_file():
                raise ValueError(f"{file}: no such file")
            files[int(number)] = Path(file)
        if seed < 0:
            raise ValueError(f"--seed is {seed}, needs 0 or more")
        return PetsOptions(files, Degradation.parse(degrade), seed)

    def to_run(self) -> dict[str, Any]:
        """As entries of run.json; none for the default."""
        if self.is_default:
            return {}
        d = self.degradation
        files = [f"{number}={file.resolve()}" for number, file in self.detections.items()]
        return {"detections": files, "degrade": f"drop={d.drop},clutter={d.clutter},noise={d.noise}", "seed": self.seed}

    @staticmethod
    def of_run(run: dict[str, Any]) -> PetsOptions:
        """The options that to_run wrote. Raises ValueError for other content."""
        detections, degrade, seed = run.get("detections", []), run.get("degrade", ""), run.get("seed", 0)
        if not isinstance(detections, list) or not isinstance(degrade, str) or not isinstance(seed, int):
            raise ValueError("run.json: detections, degrade and seed need to be a list, a text and a whole number")
        return PetsOptions.parse(map(str, detections), degrade, seed)


def read_pets(path: Path, wanted: list[int], options: PetsOptions) -> Sequence:
    """Read a PETS 2009 folder; calibration/ lies in it or beside it. wanted: view numbers, empty for all.

    Raises ValueError with the path for missing or invalid content.
    """
    calibration = next((p for p in (path / "calibration", path.parent / "calibration") if p.is_dir()), None)
    if calibration is None:
        raise ValueError(f"{path}: no calibration/ in it or beside it")
    found = _detection_files(path, wanted, options)
    cameras: dict[str, tuple[Camera, Pose]] = {}
    boxes: dict[str, dict[int, tuple[Array, Array]]] = {}
    for number in wanted or list(found):
        name = f"View_{number:03d}"
        _, camera, pose = read_camera(calibration / f"{name}.xml")
        cameras[name], boxes[name] = (camera, pose), read_detections(found[number])
    site = read_site(path)
    truth = _pets_truth(path, calibration, len(cameras), site)
    frames = max([max(by_frame, default=0) for by_frame in boxes.values()] + [len(truth or ())])
    if frames > MAX_FRAMES:
        raise ValueError(f"{path}: frame {frames}, needs at most {MAX_FRAMES}")
    if options.degradation != Degradation():
        for name, view in cameras.items():
            rng = np.random.default_rng([options.seed, zlib.crc32(name.encode())])
            boxes[name] = options.degradation.apply(boxes[name], frames, view, site.area, rng)
    mounts = {name: Mount(camera, Pose.identity(), name) for name, (camera, _) in cameras.items()}
    starts: dict[str, Start | None] = {name: Start(pose, np.zeros((6, 6))) for name, (_, pose) in cameras.items()}
    setup = Setup(mounts, site.ground, starts, 1 / site.rate, area=site.area, occluders=site.occluders, pillars=site.pillars)
    ticks = TicksInMemory(tuple(_pets_tick(index, index / site.rate, cameras, boxes) for index in range(frames)), mounts)
    files = [found[n] for n in wanted or found] + sorted((path / "annotations").glob("*-cropped.xml"))
    files += [file for file in (path / FILE, path / TERRAIN) if file.is_file()]
    sums = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in files}
    provenance: dict[str, object] = {"source": "PETS 2009", "views": list(cameras), "files": sums}
    if options.degradation != Degradation():
        provenance |= {"degradation": asdict(options.degradation), "seed": options.seed}
    return Sequence(setup, ticks, truth, provenance)


def _detection_files(path: Path, wanted: list[int], options: PetsOptions) -> dict[int, Path]:
    """View number → file of its detections, of all views. Raises ValueError where the file of a wanted view is missing."""
    found = {int(m[1]): p for p in sorted((path / "detections").glob("*.txt")) if (m := re.fullmatch(r"View_0*(\d+)\.txt", p.name))}
    for number, file in options.detections.items():
        if wanted and number not in wanted:
            raise ValueError(f"--detections names view {number}, --views has {','.join(map(str, wanted))}")
        found[number] = file
    for number in wanted:
        if number not in found:
            raise ValueError(f"{path / 'detections' / f'View_{number:03d}.txt'}: no such file; there are views {','.join(map(str, found))}")
    if not found:
        raise ValueError(f"{path / 'detections'}: no View_00N.txt")
    return found


def _pets_tick(index: int, time: float, cameras: dict[str, tuple[Camera, Pose]], boxes: dict[str, dict[int, tuple[Array, Array]]]) -> Tick:
    views = []
    for name, (camera, _) in cameras.items():
        box, confidence = boxes[name].get(index + 1, (np.zeros((0, 4)), np.zeros(0)))
        views.append(View(name, detections_from_boxes(camera, box, confidence)))
    return Tick(index, time, tuple(views))


def _pets_truth(path: Path, calibration: Path, cameras: int, site: Site) -> tuple[Truth, ...] | None:
    """Ground truth from the cropped annotation, which is in the image of View_001."""
    files = sorted((path / "annotations").glob("*-cropped.xml"))
    if not files:
        return None
    if len(files) > 1:
        raise ValueError(f"{path / 'annotations'}: {len(files)} files *-cropped.xml, needs one")
    _, camera, pose = read_camera(calibration / "View_001.xml")
    people = ground_truth(read_annotations(files[0]), camera, pose, site.ground)
    out = []
    last = max(people, default=-1)
    if last >= MAX_FRAMES:
        raise ValueError(f"{files[0]}: frame {last}, needs less than {MAX_FRAMES}")
    for index in range(last + 1):
        ids, feet = people.get(index, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
        out.append(Truth(index, {}, ids, feet, np.ones((len(ids), cameras))))
    return tuple(out)
