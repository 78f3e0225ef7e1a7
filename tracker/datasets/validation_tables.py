"""Consistency of a sequence: its tables agree with each other, and its ground truth agrees with its images.

Boxes must match the instance images to the pixel. Key points must be the projected joints, and visible key points must lie on their person.
The robots' own sensors must agree with sensors.json in rates, times, stamps, noise and the resolution of encoders.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.ekf.gaussian import mahalanobis2
from tracker.ekf.measurement_models import residual
from tracker.geometry import Array, Ints
from tracker.geometry.cameras import Camera
from tracker.io.image_files import decode_image
from tracker.sequence.reader import read_robot_detections
from tracker.sequence.robot_sensors import SENSOR_TABLES, read_imu, read_sensor_setup, read_stamps, read_wheels, sensor_tables
from tracker.sequence.schema import LAYERS
from tracker.sequence.truth_tables import read_joints, read_views
from tracker.types import VISIBLE, ImuSamples, SensorSetup, Sequence, Setup, Truth, ViewTruth

Finding = tuple[Path, str]
Progress = Callable[[Iterable[Any], str, int], Iterable[Any]]
"""Wraps an iterable, with its name and length, to show progress."""
LARGEST_ID = (1 << 16) - 1
LAYER_TYPES: dict[str, type] = {"instances": np.uint16, "range": np.uint16, "classes": np.uint8}
JOINT_STEP = 1e-4
"""m: rounding of joints in their table."""
PIXEL_STEP = 0.01
"""px: rounding of key points in their table."""
MAX_BEARING_DEVIATION = 7.0
"""Largest error of a bearing to another robot, in standard deviations."""
PIXEL_TOLERANCE = 2
"""px: largest distance of a visible key point from the pixels of its person, rounding included."""
MAX_DEVIATION = 8.0
"""Largest error of a sample or a stamp, in standard deviations."""
MISSING = "missing, though sensors.json or truth/clocks.csv tells of it"
UNTOLD = "sensors.json and truth/clocks.csv tell of no such table"
_DIGITS = 1e-8
"""Relative rounding of numbers in a table: 9 digits."""


@dataclass(frozen=True, eq=False)
class _Tables:
    """The ground truth of a sequence."""

    truth: tuple[Truth, ...]
    views: dict[tuple[int, str], ViewTruth]
    joints: dict[int, tuple[Ints, Array]]

    @cached_property
    def columns(self) -> dict[str, int]:
        """Camera → its column of the visible fractions."""
        return {name: k for k, name in enumerate(dict.fromkeys(camera for _, camera in self.views))}


def inconsistencies(folder: Path, sequence: Sequence, files: Collection[str], progress: Progress | None = None) -> Iterator[Finding]:
    """Yield inconsistent files of a sequence and the reasons. files: names of the undamaged files.

    Raises ValueError with the path for a table that cannot be read.
    """
    tables = _Tables(sequence.truth or (), read_views(folder), read_joints(folder))
    frames = range(len(tables.truth))
    cameras = {name: mount.camera for name, mount in sequence.setup.mounts.items()}
    yield from _poses(folder, tables)
    if "companions.csv" in files:
        yield from _robot_detections(folder, tables, sequence.setup)
    wanted = {(k, name) for k in frames for name in cameras}
    for k, name in sorted(wanted ^ set(tables.views)):
        there = "has no row" if (k, name) in wanted else "is not of the sequence"
        yield folder / "truth" / "cameras.csv", f"frame {k} of {name} {there}"
    folders = [layer for layer in LAYERS[:4] if any(name.startswith(f"{layer}/") for name in files)]
    for k in progress(frames, f"{folder.name}: frames", len(frames)) if progress else frames:
        yield from _people(folder, tables, k)
        for name, camera in cameras.items():
            images = {}
            for layer in {"images": 0, "instances": 0} | dict.fromkeys(folders):
                path, image, fault = _image(folder, f"{layer}/{name}/{k:06d}", camera, files)
                if fault:
                    yield path, fault
                elif image is not None:
                    images[layer] = image
            if (k, name) in tables.views:
                yield from _view(folder, tables, (k, name), camera, images.get("instances"))


def _poses(folder: Path, tables: _Tables) -> Iterator[Finding]:
    """Rotations must be orthonormal."""
    poses = [(k, robot, pose, "robots.csv") for k, frame in enumerate(tables.truth) for robot, pose in frame.T_world_robot.items()]
    poses += [(k, camera, view.T_world_camera, "cameras.csv") for (k, camera), view in tables.views.items()]
    for k, name, pose, file in poses:
        if not np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-6):
            yield folder / "truth" / file, f"frame {k} of {name} has a quaternion that is not of length 1"


def _robot_detections(folder: Path, tables: _Tables, setup: Setup) -> Iterator[Finding]:
    """Detections of other robots must agree with the true poses."""
    for (k, camera), seen in read_robot_detections(folder / "companions.csv", setup, range(len(tables.truth))).items():
        poses, mount = tables.truth[k].T_world_robot, setup.mounts[camera]
        positions = np.array([(poses[robot] @ setup.mount_of(robot).T_body_camera).translation for robot in seen.robot])
        offset = (poses[mount.robot] @ mount.T_body_camera).inverse().apply(positions)
        error = residual(seen.bearing, offset / np.linalg.norm(offset, axis=1, keepdims=True))
        for robot, d2 in zip(seen.robot, mahalanobis2(error, seen.covariance), strict=True):
            if not d2 < MAX_BEARING_DEVIATION**2:
                yield folder / "companions.csv", f"frame {k} of {camera}: {robot} is {np.sqrt(d2):.0f} standard deviations off its true position"


def _image(folder: Path, stem: str, camera: Camera, files: Collection[str]) -> tuple[Path, NDArray[Any] | None, str]:
    """Path, image and fault of one image of a view. Image and fault are both empty where the file is reported as damaged elsewhere."""
    name = next((stem + ending for ending in (".png", ".jpg") if stem + ending in files), None)
    if name is None:
        there = any((folder / (stem + ending)).exists() for ending in (".png", ".jpg"))
        return folder / f"{stem}.png", None, "" if there else "missing"
    layer = stem.split("/")[0]
    try:
        image = decode_image((folder / name).read_bytes(), (camera.height, camera.width), cv2.IMREAD_UNCHANGED)
    except (ValueError, cv2.error) as error:
        return folder / name, None, " ".join(str(error).split())
    expected = (np.dtype(np.uint8), 3) if layer == "images" else (np.dtype(LAYER_TYPES[layer]), 2)
    if (image.dtype, image.ndim) != expected:
        return folder / name, None, f"{image.dtype} of shape {image.shape}, needs {expected[0]} with {'3 channels' if expected[1] == 3 else 'one'}"
    return folder / name, image, ""


def _people(folder: Path, tables: _Tables, k: int) -> Iterator[Finding]:
    """Ids and visible fractions must be in bounds, and people.csv and joints.csv must hold the same people."""
    frame = tables.truth[k]
    ids = frame.person_id
    if len(ids) and not (ids.min() >= 1 and ids.max() <= LARGEST_ID):
        yield folder / "truth" / "people.csv", f"frame {k} has an id that is not in 1 to {LARGEST_ID}"
    if sorted(tables.joints.get(k, (np.zeros(0, np.int64),))[0].tolist()) != sorted(ids.tolist()):
        yield folder / "truth" / "joints.csv", f"frame {k} has other people than people.csv"
    if ((frame.visible < 0) | (frame.visible > 1)).any():
        yield folder / "truth" / "people.csv", f"frame {k} has a visible fraction that is not in [0, 1]"


def _view(folder: Path, tables: _Tables, key: tuple[int, str], camera: Camera, instances: NDArray[np.uint16] | None) -> Iterator[Finding]:
    """Boxes and key points of a view must agree with people.csv and with the instance image, where it can be read."""
    (k, name), view = key, tables.views[key]
    where, boxes = f"frame {k} of {name}", view.boxes
    present = set(tables.truth[k].person_id.tolist())
    if not set(boxes.person.tolist()) <= present:
        yield folder / "truth" / "boxes.csv", f"{where} has a person who is not in people.csv"
        return
    if ((boxes.visible < 0) | (boxes.visible > 1)).any() or not (boxes.range > 0).all() or (boxes.full[:, :2] > boxes.full[:, 2:]).any():
        yield folder / "truth" / "boxes.csv", f"{where} has a visible fraction not in [0, 1], a range not above 0, or an edge beyond the other"
    if view.keypoints.person.tolist() != boxes.person.tolist():
        yield folder / "truth" / "keypoints.csv", f"{where} has other people than boxes.csv"
        return
    if not np.isin(view.keypoints.visibility, (0, 1, 2)).all():
        yield folder / "truth" / "keypoints.csv", f"{where} has a visibility that is none of 0, 1, 2"
    row = {person: i for i, person in enumerate(tables.truth[k].person_id.tolist())}
    of_people = np.array([tables.truth[k].visible[row[p], tables.columns[name]] for p in boxes.person.tolist()])
    if not np.allclose(of_people, boxes.visible, atol=1e-8):
        yield folder / "truth" / "people.csv", f"{where} has other visible fractions than boxes.csv"
    yield from _projected(folder, tables, key, camera)
    if instances is not None:
        yield from _on_instances(folder, view, where, camera, instances)


def _projected(folder: Path, tables: _Tables, key: tuple[int, str], camera: Camera) -> Iterator[Finding]:
    """Key points must be the projected joints, up to rounding."""
    view, (persons, joints) = tables.views[key], tables.joints.get(key[0], (np.zeros(0, np.int64), np.zeros((0, 17, 3))))
    rows = {person: i for i, person in enumerate(persons.tolist())}
    for person, pixels, visibility in zip(view.keypoints.person.tolist(), view.keypoints.pixels, view.keypoints.visibility, strict=True):
        if person not in rows:
            continue
        seen = visibility > 0
        points = view.T_world_camera.inverse().apply(joints[rows[person]][seen])
        expected, _ = camera.pixels_from_bearings(points / np.linalg.norm(points, axis=1, keepdims=True))
        deviation = np.abs(expected + 0.5 - camera.pixel_centre - pixels[seen])
        if camera.wraps:
            deviation[:, 0] = np.minimum(deviation[:, 0], camera.width - deviation[:, 0])
        focal = camera.width / (2 * np.pi) if camera.wraps else camera.width
        # Columns of a panorama are narrower towards its poles.
        distance = np.maximum(np.hypot(points[:, 0], points[:, 1]), 0.05) if camera.wraps else np.maximum(points[:, 0], 0.05)
        if not (deviation <= (PIXEL_STEP + 4 * focal * JOINT_STEP / distance)[:, None]).all():
            where = f"frame {key[0]} of {key[1]}"
            yield folder / "truth" / "keypoints.csv", f"{where}: person {person} is {np.nanmax(deviation):.2f} px from the projection of joints.csv"


def _on_instances(folder: Path, view: ViewTruth, where: str, camera: Camera, instances: NDArray[np.uint16]) -> Iterator[Finding]:
    """Boxes must bound the pixels of the same people, and visible key points must lie on their person."""
    path = folder / "truth" / "boxes.csv"
    shown = set(np.unique(instances).tolist()) - {0}
    boxes = view.boxes
    if shown != set(boxes.person[boxes.visible > 0].tolist()):
        yield path, f"{where}: instances show {sorted(shown)[:20]}, boxes.csv {sorted(boxes.person[boxes.visible > 0].tolist())[:20]}"
        return
    for person, box, pixels, visibility in zip(boxes.person, boxes.seen, view.keypoints.pixels, view.keypoints.visibility, strict=True):
        if person not in shown:
            continue
        mask = instances == person
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if camera.wraps:
            columns = np.mod(columns - box[0], camera.width) + box[0]
        if [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1] != box.tolist():
            yield path, f"{where}: the box of person {person} is not that of the instances"
        u, v = np.floor(pixels[visibility == VISIBLE]).astype(np.int64).T
        for x, y in zip(u.tolist(), v.tolist(), strict=True):
            across = np.arange(x - PIXEL_TOLERANCE, x + PIXEL_TOLERANCE + 1)
            across = across % camera.width if camera.wraps else across[(across >= 0) & (across < camera.width)]
            if not mask[max(y - PIXEL_TOLERANCE, 0) : y + PIXEL_TOLERANCE + 1, across].any():
                yield folder / "truth" / "keypoints.csv", f"{where}: a visible key point of person {person} at ({x}, {y}) is not on that person"
                break


def sensor_faults(folder: Path, sequence: Sequence, files: Collection[str]) -> Iterator[Finding]:
    """Yield inconsistent tables of the robots' own sensors and the reasons. files: names of the undamaged files.

    Raises ValueError with the path for a table that cannot be read.
    """
    sensors = read_sensor_setup(folder)
    robots = [robot for robot in sequence.setup.starts if not sequence.setup.is_fixed(robot)]
    seconds = (len(sequence.truth or ()) - 1) * sequence.setup.period
    wanted = {f"{name}.csv" for name in sensor_tables(sensors)}
    for name in sorted(wanted | {f"{name}.csv" for name in SENSOR_TABLES}):
        if (name in wanted) != (folder / name).exists():
            yield folder / name, MISSING if name in wanted else UNTOLD
    files = wanted & set(files)
    if {"imu.csv", "truth/inertial.csv"} <= files:
        yield from _imu(folder, robots, seconds, sensors.description["imu"], sensors)
    if "wheels.csv" in files:
        yield from _wheels(folder, robots, seconds, sensors.description["wheels"], sensors)
    if "stamps.csv" in files:
        yield from _frames(folder, [*robots, *sequence.setup.mounts], sequence, sensors)


def _imu(folder: Path, robots: list[str], seconds: float, entry: Mapping[str, float], sensors: SensorSetup) -> Iterator[Finding]:
    path, rate, samples = folder / "imu.csv", entry["rate"], read_imu(folder)
    yield from _names(path, robots, samples)
    for robot, found in samples.items():
        wanted = np.arange(1, math.floor(seconds * rate + 1e-6) + 1) / rate
        yield from _times(path, robot, found.time, found.stamp, wanted, sensors)
        yield from _noise(path, robot, found, entry)


def _noise(path: Path, robot: str, found: ImuSamples, entry: Mapping[str, float]) -> Iterator[Finding]:
    """Samples minus their truth and biases must be within the noise of the sensor."""
    for name, measured, true, bias in (
        ("gyro", found.gyro, found.true_gyro, found.gyro_bias),
        ("force", found.force, found.true_force, found.force_bias),
    ):
        sigma = entry[f"{name}_noise"] * math.sqrt(entry["rate"])
        error = np.abs(measured - true - bias) - _DIGITS * (np.abs(measured) + np.abs(true) + np.abs(bias))
        if (error > MAX_DEVIATION * sigma).any():
            row = int(np.argmax(error.max(axis=1)))
            yield path, f"{name} of {robot} at {found.time[row]:g} s is {error[row].max():.3g} off truth/inertial.csv, one sigma is {sigma:.3g}"


def _wheels(folder: Path, robots: list[str], seconds: float, entry: Mapping[str, float], sensors: SensorSetup) -> Iterator[Finding]:
    path, samples, count = folder / "wheels.csv", read_wheels(folder), 2 * math.pi / entry["counts"]
    yield from _names(path, robots, samples)
    for robot, found in samples.items():
        wanted = np.arange(math.floor(seconds * entry["rate"] + 1e-6) + 1) / entry["rate"]
        yield from _times(path, robot, found.time, found.stamp, wanted, sensors)
        counts = found.angle / count
        if (np.abs(counts - counts.round()) > 1e-3 + _DIGITS * np.abs(counts)).any():
            yield path, f"an angle of {robot} is no whole count of {count:.6g} rad"


def _names(path: Path, robots: Collection[str], there: Collection[str]) -> Iterator[Finding]:
    for name in sorted(set(robots) ^ set(there)):
        yield path, f"{name[:60]} {'has no row' if name in robots else 'is not of the sequence'}"


def _times(path: Path, name: str, time: Array, stamp: Array, wanted: Array, sensors: SensorSetup) -> Iterator[Finding]:
    """True times must be the wanted ones, and stamps those of the clock."""
    if len(time) != len(wanted):
        yield path, f"{name} has {len(time)} samples, needs {len(wanted)}"
        return
    off = np.abs(time - wanted) > 1e-9 + _DIGITS * wanted
    if off.any():
        row = int(np.argmax(off))
        yield path, f"sample {row} of {name} is at {time[row]:g} s, needs {wanted[row]:g} s"
        return
    if sensors.clocks and name not in sensors.clocks:
        yield path.parent / "truth" / "clocks.csv", f"has no clock of {name[:60]}"
        return
    offset, drift, jitter = sensors.clocks.get(name, (0.0, 0.0, 0.0))
    error = np.abs(stamp - (time * (1 + drift * 1e-6) + offset)) - _DIGITS * (np.abs(stamp) + time) - 1e-9
    if (error > MAX_DEVIATION * jitter).any():
        yield path, f"a stamp of {name} is {error.max():.3g} s off its clock, whose jitter is {jitter:g} s"


def _frames(folder: Path, names: list[str], sequence: Sequence, sensors: SensorSetup) -> Iterator[Finding]:
    path, stamps = folder / "stamps.csv", read_stamps(folder)
    yield from _names(path, names, stamps)
    frames = np.arange(len(sequence.truth or ()), dtype=np.float64)
    for name, rows in stamps.items():
        if rows[:, 0].tolist() != frames.tolist():
            yield path, f"{name[:60]} has other frames than 0 to {len(frames) - 1}"
            continue
        yield from _times(path, name, rows[:, 1], rows[:, 2], frames * sequence.setup.period, sensors)
