"""Opening what is to be tracked: a Sequence of pilsim's, or a folder of PETS 2009."""

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
"""Of the views of S2.L1, those that are used where nothing is said."""

MAX_FRAMES = 1_000_000


@dataclass(frozen=True, eq=False)
class Choice:
    """What of a PETS folder is read: other detection files of views (number → file), and how all detections are made worse, from which seed."""

    detections: Mapping[int, Path] = field(default_factory=dict)
    degradation: Degradation = Degradation()
    seed: int = 0

    @property
    def plain(self) -> bool:
        """Whether the folder is read as it is."""
        return not self.detections and self.degradation == Degradation()

    @staticmethod
    def parse(detections: Iterable[str], degrade: str, seed: int) -> Choice:
        """detections: each VIEW=FILE; degrade: see Degradation.parse. Raises ValueError that names what is wrong."""
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
        return Choice(files, Degradation.parse(degrade), seed)

    def to_run(self) -> dict[str, Any]:
        """As values of run.json; nothing where the folder is read as it is."""
        if self.plain:
            return {}
        d = self.degradation
        files = [f"{number}={file.resolve()}" for number, file in self.detections.items()]
        return {"detections": files, "degrade": f"drop={d.drop},clutter={d.clutter},noise={d.noise}", "seed": self.seed}

    @staticmethod
    def of_run(run: dict[str, Any]) -> Choice:
        """What to_run wrote. Raises ValueError where that is not what it is."""
        detections, degrade, seed = run.get("detections", []), run.get("degrade", ""), run.get("seed", 0)
        if not isinstance(detections, list) or not isinstance(degrade, str) or not isinstance(seed, int):
            raise ValueError("run.json: detections, degrade and seed need to be a list, a text and a whole number")
        return Choice.parse(map(str, detections), degrade, seed)


def _read_pets(path: Path, wanted: list[int], choice: Choice) -> Sequence:
    """Cameras, detections and cropped truth of a PETS 2009 folder; calibration/ lies in it or beside it."""
    calibration = next((p for p in (path / "calibration", path.parent / "calibration") if p.is_dir()), None)
    if calibration is None:
        raise ValueError(f"{path}: no calibration/ in it or beside it")
    found = {int(m[1]): p for p in sorted((path / "detections").glob("*.txt")) if (m := re.fullmatch(r"View_0*(\d+)\.txt", p.name))}
    for number, file in choice.detections.items():
        if wanted and number not in wanted:
            raise ValueError(f"--detections names view {number}, --views has {','.join(map(str, wanted))}")
        found[number] = file
    for number in wanted:
        if number not in found:
            raise ValueError(f"{path / 'detections' / f'View_{number:03d}.txt'}: no such file; there are views {','.join(map(str, found))}")
    if not found:
        raise ValueError(f"{path / 'detections'}: no View_00N.txt")
    cameras: dict[str, tuple[Camera, Pose]] = {}
    boxes: dict[str, dict[int, tuple[Array, Array]]] = {}
    for number in wanted or list(found):
        name = f"View_{number:03d}"
        _, camera, pose = read_camera(calibration / f"{name}.xml")
        cameras[name], boxes[name] = (camera, pose), read_detections(found[number])
    site = read_site(path)
    truth = _pets_truth(path, calibration, len(cameras), site)
    frames = max([max(frames, default=0) for frames in boxes.values()] + [len(truth or ())])
    if frames > MAX_FRAMES:
        raise ValueError(f"{path}: frame {frames}, needs at most {MAX_FRAMES}")
    if choice.degradation != Degradation():
        for name, view in cameras.items():
            rng = np.random.default_rng([choice.seed, zlib.crc32(name.encode())])
            boxes[name] = choice.degradation.applied(boxes[name], frames, view, site.area, rng)
    mounts = {name: Mount(camera, Pose.identity(), name) for name, (camera, _) in cameras.items()}
    starts: dict[str, Start | None] = {name: Start(pose, np.zeros((6, 6))) for name, (_, pose) in cameras.items()}
    setup = Setup(mounts, site.ground, starts, 1 / site.rate, area=site.area, occluders=site.occluders, pillars=site.pillars)
    ticks = TicksInMemory(tuple(_pets_tick(index, index / site.rate, cameras, boxes) for index in range(frames)), mounts)
    read = [found[n] for n in wanted or found] + sorted((path / "annotations").glob("*-cropped.xml"))
    read += [file for file in (path / FILE, path / TERRAIN) if file.is_file()]
    sums = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in read}
    made: dict[str, object] = {"source": "PETS 2009", "views": list(cameras), "files": sums}
    if choice.degradation != Degradation():
        made |= {"degradation": asdict(choice.degradation), "seed": choice.seed}
    return Sequence(setup, ticks, truth, made)


def _pets_tick(index: int, time: float, cameras: dict[str, tuple[Camera, Pose]], boxes: dict[str, dict[int, tuple[Array, Array]]]) -> Tick:
    views = []
    for name, (camera, _) in cameras.items():
        box, confidence = boxes[name].get(index + 1, (np.zeros((0, 4)), np.zeros(0)))
        views.append(View(name, detections_from_boxes(camera, box, confidence)))
    return Tick(index, time, tuple(views))


def _pets_truth(path: Path, calibration: Path, cameras: int, site: Site) -> tuple[Truth, ...] | None:
    """Where the people of the cropped annotation stand, by View_001, in which they were annotated."""
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
