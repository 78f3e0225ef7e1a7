"""Validation of a dataset or a sequence on disk: files against manifests, tables against each other, truth against images.

Files are of unknown origin: sizes are checked before memory is allocated for their content.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.datasets.validation_tables import Progress, inconsistencies, sensor_faults
from tracker.geometry.cameras import Tsai
from tracker.io.atomic import is_temporary
from tracker.io.json_files import read_json
from tracker.io.tsai_xml import read_camera
from tracker.sequence import dataset
from tracker.sequence.dataset import FILE, MANIFEST, read_dataset
from tracker.sequence.manifest import check_file, manifest_checksum, read_manifest
from tracker.sequence.reader import read_contents
from tracker.types import Sequence

PICTURE = "twin.png"
"""A picture of the synthetic twin of PETS 2009, which its manifest does not name."""


@dataclass(frozen=True)
class Fault:
    """A fault of a file, in one line."""

    file: Path
    reason: str

    def __str__(self) -> str:
        return f"{self.file}: {self.reason}"

    @staticmethod
    def of(error: ValueError, file: Path) -> Fault:
        """A fault from an error whose message begins with a path; of `file` where it does not."""
        name, colon, reason = " ".join(str(error).split()).partition(": ")
        if not colon or "/" not in name:
            return Fault(file, " ".join(str(error).split()))
        at = re.fullmatch(r"(.*?):(?:line )?(\d+)", name)
        return Fault(Path(at[1]), f"line {at[2]}: {reason}") if at else Fault(Path(name), reason)


def validate(folder: Path, progress: Progress | None = None) -> Iterator[Fault]:
    """Yield all faults of a sequence or a dataset. Raises ValueError where `folder` is neither."""
    if (folder / MANIFEST).exists():
        yield from _sequence_faults(folder, progress)
        return
    if not (folder / FILE).exists():
        raise ValueError(f"{folder}: neither a sequence ({MANIFEST}) nor a dataset ({FILE})")
    try:
        wanted = read_dataset(folder)
    except ValueError as error:
        yield Fault.of(error, folder / FILE)
        return
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") and (path.name.endswith(".partial") or ".part." in path.name):
            yield Fault(path, "left by a run that is unfinished or was interrupted; generate into this folder again")
    for number, name in enumerate(wanted.sequences):
        if not (folder / name / MANIFEST).exists():
            yield Fault(folder / name, "this sequence is missing; generate into this folder again")
            continue
        yield from _scenario_faults(folder / name, wanted, number)
        yield from _sequence_faults(folder / name, progress)
    for name in ("README.md", "croissant.json"):
        if not (folder / name).is_file():
            yield Fault(folder / name, "missing; generate into this folder again")


def _scenario_faults(folder: Path, wanted: dataset.Dataset, number: int) -> Iterator[Fault]:
    """Faults of a sequence whose scenario differs from that of its dataset."""
    path = folder / "scenario.json"
    try:
        scenario = read_json(path)
    except (ValueError, OSError):
        return  # reported with the other files
    expected = wanted.scenario | {"preset": wanted.preset, "views": wanted.views}
    seed = wanted.scenario.get("seed")
    expected["seed"] = seed + number if isinstance(seed, int) else None
    for name, value in expected.items():
        if not isinstance(scenario, dict) or scenario.get(name) != value:
            there = scenario.get(name) if isinstance(scenario, dict) else None
            yield Fault(path, f"{name} is {str(there)[:80]}, {FILE} says {value}")


def _sequence_faults(folder: Path, progress: Progress | None) -> Iterator[Fault]:
    try:
        manifest = read_manifest(folder)
    except (ValueError, OSError) as error:
        yield Fault.of(ValueError(error), folder / MANIFEST)
        return
    if manifest["schema"] > 2 and manifest.get("sum") != manifest_checksum(manifest):
        yield Fault(folder / MANIFEST, "its checksum does not match its content: edited by hand")
    files = manifest["files"]
    damaged = set()
    for name, entry in progress(files.items(), f"{folder.name}: files", len(files)) if progress else files.items():
        try:
            check_file(folder, name, entry)
        except (ValueError, OSError) as error:
            damaged.add(name)
            yield Fault.of(ValueError(error), folder / name)
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_file() and name not in files and name not in (MANIFEST, PICTURE) and not is_temporary(path.name):
            yield Fault(path, "the manifest does not name it")
    try:
        sequence = read_contents(folder, files)
        yield from _calibration_faults(folder, sequence, files)
        for file, reason in inconsistencies(folder, sequence, set(files) - damaged, progress):
            yield Fault(file, reason)
        for file, reason in sensor_faults(folder, sequence, set(files) - damaged):
            yield Fault(file, reason)
    except (ValueError, OSError) as error:
        fault = Fault.of(ValueError(error), folder)
        # Damaged files are reported above; a table that matches the manifest may still be invalid.
        if not (fault.file.is_relative_to(folder) and fault.file.relative_to(folder).as_posix() in damaged):
            yield fault


def _calibration_faults(folder: Path, sequence: Sequence, files: dict[str, Any]) -> Iterator[Fault]:
    """Faults of PETS 2009 calibration files that differ from calibration.json."""
    for name, mount in sequence.setup.mounts.items():
        path = folder / "calibration" / f"{name}.xml"
        start = sequence.setup.starts[mount.robot]
        if not isinstance(mount.camera, Tsai) or start is None or not sequence.setup.is_fixed(mount.robot):
            continue
        if path.relative_to(folder).as_posix() not in files:
            yield Fault(path, "missing, though the camera is fixed")
            continue
        try:
            _, camera, pose = read_camera(path)
        except (ValueError, OSError) as error:
            yield Fault.of(ValueError(error), path)
            continue
        difference = pose.inverse() @ start.T_world_robot @ mount.T_body_camera
        # The file has 15 significant digits.
        same = np.allclose(astuple(camera), astuple(mount.camera), rtol=1e-12, atol=0.0)
        if not same or float(abs(difference.log()).max()) > 1e-6:
            yield Fault(path, "differs from the camera in calibration.json")
