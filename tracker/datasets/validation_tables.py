"""Whether the tables of a sequence agree with each other and its truth with its images: what no checksum can tell.

Boxes are those of the instances to the pixel, key points are the joints seen by the cameras, and visible ones lie on their own person.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.ekf.gaussian import mahalanobis2
from tracker.ekf.measurement_models import residual
from tracker.geometry import Array, Ints
from tracker.geometry.cameras import Camera, Panorama
from tracker.io.image_files import decode
from tracker.sequence.reader import read_companions
from tracker.sequence.schema import LAYERS
from tracker.sequence.truth_tables import read_joints, read_views
from tracker.types import VISIBLE, Sequence, Setup, Truth, ViewTruth

Finding = tuple[Path, str]
Progress = Callable[[Iterable[Any], str, int], Iterable[Any]]
LARGEST_ID = (1 << 16) - 1
KINDS: dict[str, type] = {"instances": np.uint16, "range": np.uint16, "classes": np.uint8}
JOINT_STEP = 1e-4
"""m, to which joints are written; and px, to which key points are."""
PIXEL_STEP = 0.01
ASTRAY = 7.0
"""Standard deviations of a bearing that none of a sequence is off."""
BESIDE = 2
"""px: a visible key point is at most so far from its person, the step of its column included."""


@dataclass(frozen=True, eq=False)
class _Tables:
    """What is read of a sequence beside its images."""

    truth: tuple[Truth, ...]
    views: dict[tuple[int, str], ViewTruth]
    joints: dict[int, tuple[Ints, Array]]


def inconsistencies(folder: Path, sequence: Sequence, files: Collection[str], progress: Progress | None = None) -> Iterator[Finding]:
    """Files of a sequence and what is wrong with them; files: names of those that are there and whole.

    Raises ValueError, with the file's name, for a table that cannot be read.
    """
    tables = _Tables(sequence.truth or (), read_views(folder), read_joints(folder))
    frames = range(len(tables.truth))
    cameras = {name: mount.camera for name, mount in sequence.setup.mounts.items()}
    yield from _poses(folder, tables)
    if "companions.csv" in files:
        yield from _companions(folder, tables, sequence.setup)
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
    """Poses are rotations."""
    poses = [(k, robot, pose, "robots.csv") for k, frame in enumerate(tables.truth) for robot, pose in frame.T_world_robot.items()]
    poses += [(k, camera, view.T_world_camera, "cameras.csv") for (k, camera), view in tables.views.items()]
    for k, name, pose, file in poses:
        if not np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-6):
            yield folder / "truth" / file, f"frame {k} of {name} has a quaternion that is not of length 1"


def _companions(folder: Path, tables: _Tables, setup: Setup) -> Iterator[Finding]:
    """Robots are seen where they are."""
    for (k, camera), seen in read_companions(folder, setup, len(tables.truth)).items():
        poses, mount = tables.truth[k].T_world_robot, setup.mounts[camera]
        places = np.array([(poses[robot] @ setup.mount_of(robot).T_body_camera).translation for robot in seen.robot])
        sight = (poses[mount.robot] @ mount.T_body_camera).inverse().apply(places)
        error = residual(seen.bearing, sight / np.linalg.norm(sight, axis=1, keepdims=True))
        for robot, d2 in zip(seen.robot, mahalanobis2(error, seen.covariance), strict=True):
            if not d2 < ASTRAY**2:
                yield folder / "companions.csv", f"frame {k} of {camera}: {robot} is {np.sqrt(d2):.0f} standard deviations off its place in truth"


def _image(folder: Path, stem: str, camera: Camera, files: Collection[str]) -> tuple[Path, NDArray[Any] | None, str]:
    """Path, image and fault of one of a view's images; neither image nor fault where it has been found damaged before."""
    name = next((stem + ending for ending in (".png", ".jpg") if stem + ending in files), None)
    if name is None:
        there = any((folder / (stem + ending)).exists() for ending in (".png", ".jpg"))
        return folder / f"{stem}.png", None, "" if there else "missing"
    layer = stem.split("/")[0]
    try:
        image = decode((folder / name).read_bytes(), (camera.height, camera.width), cv2.IMREAD_UNCHANGED)
    except (ValueError, cv2.error) as error:
        return folder / name, None, " ".join(str(error).split())
    expected = (np.dtype(np.uint8), 3) if layer == "images" else (np.dtype(KINDS[layer]), 2)
    if (image.dtype, image.ndim) != expected:
        return folder / name, None, f"{image.dtype} of shape {image.shape}, needs {expected[0]} with {'3 channels' if expected[1] == 3 else 'one'}"
    return folder / name, image, ""


def _people(folder: Path, tables: _Tables, k: int) -> Iterator[Finding]:
    """Ids, and that the same people are in people.csv and joints.csv; visible fractions."""
    frame = tables.truth[k]
    ids = frame.person_id
    if len(ids) and not (ids.min() >= 1 and ids.max() <= LARGEST_ID):
        yield folder / "truth" / "people.csv", f"frame {k} has an id that is not in 1 to {LARGEST_ID}"
    if sorted(tables.joints.get(k, (np.zeros(0, np.int64),))[0].tolist()) != sorted(ids.tolist()):
        yield folder / "truth" / "joints.csv", f"frame {k} has other people than people.csv"
    if ((frame.visible < 0) | (frame.visible > 1)).any():
        yield folder / "truth" / "people.csv", f"frame {k} has a visible fraction that is not in [0, 1]"


def _view(folder: Path, tables: _Tables, key: tuple[int, str], camera: Camera, instances: NDArray[np.uint16] | None) -> Iterator[Finding]:
    """One view's boxes and key points, against the instances where they can be read."""
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
    column = list(dict.fromkeys(camera for _, camera in tables.views)).index(name)
    row = {person: i for i, person in enumerate(tables.truth[k].person_id.tolist())}
    of_people = np.array([tables.truth[k].visible[row[p], column] for p in boxes.person.tolist()])
    if not np.allclose(of_people, boxes.visible, atol=1e-8):
        yield folder / "truth" / "people.csv", f"{where} has other visible fractions than boxes.csv"
    yield from _projected(folder, tables, key, camera)
    if instances is not None:
        yield from _on_instances(folder, view, where, camera, instances)


def _projected(folder: Path, tables: _Tables, key: tuple[int, str], camera: Camera) -> Iterator[Finding]:
    """Key points in the image are where the camera sees the joints, to what they are written with."""
    view, (persons, joints) = tables.views[key], tables.joints.get(key[0], (np.zeros(0, np.int64), np.zeros((0, 17, 3))))
    rows = {person: i for i, person in enumerate(persons.tolist())}
    for person, pixels, visibility in zip(view.keypoints.person.tolist(), view.keypoints.pixels, view.keypoints.visibility, strict=True):
        if person not in rows:
            continue
        seen = visibility > 0
        points = view.T_world_camera.inverse().apply(joints[rows[person]][seen])
        expected, _ = camera.pixels_from_bearings(points / np.linalg.norm(points, axis=1, keepdims=True))
        apart = np.abs(expected + 0.5 - camera.pixel_centre - pixels[seen])
        if isinstance(camera, Panorama):
            apart[:, 0] = np.minimum(apart[:, 0], camera.width - apart[:, 0])
        focal = camera.height / np.pi if isinstance(camera, Panorama) else camera.width
        # Columns of a panorama are narrower towards its poles.
        flat = np.maximum(np.hypot(points[:, 0], points[:, 1]), 0.05) if isinstance(camera, Panorama) else np.maximum(points[:, 0], 0.05)
        if not (apart <= (PIXEL_STEP + 4 * focal * JOINT_STEP / flat)[:, None]).all():
            where = f"frame {key[0]} of {key[1]}"
            yield folder / "truth" / "keypoints.csv", f"{where}: person {person} is {np.nanmax(apart):.2f} px from where joints.csv projects to"


def _on_instances(folder: Path, view: ViewTruth, where: str, camera: Camera, instances: NDArray[np.uint16]) -> Iterator[Finding]:
    """Boxes are those of the pixels, nobody else has any, and visible key points lie on their person."""
    panorama, path = isinstance(camera, Panorama), folder / "truth" / "boxes.csv"
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
        if panorama:
            columns = np.mod(columns - box[0], camera.width) + box[0]
        if [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1] != box.tolist():
            yield path, f"{where}: the box of person {person} is not that of the instances"
        u, v = np.floor(pixels[visibility == VISIBLE]).astype(np.int64).T
        for x, y in zip(u.tolist(), v.tolist(), strict=True):
            across = np.arange(x - BESIDE, x + BESIDE + 1)
            across = across % camera.width if panorama else across[(across >= 0) & (across < camera.width)]
            if not mask[max(y - BESIDE, 0) : y + BESIDE + 1, across].any():
                yield folder / "truth" / "keypoints.csv", f"{where}: a visible key point of person {person} at ({x}, {y}) is not on that person"
                break
