"""Models of COLMAP: cameras, images with poses, and points, as text and as binary files (colmap.github.io/format.html).

COLMAP's pixels count from the image's corner: the first pixel's centre is (0.5, 0.5).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tracker.formats.camera_parameters import OPTICAL, CameraParameters, ExportedView, camera_notes, faces
from tracker.formats.exported_sequence import RecordedSequence
from tracker.geometry import Array, Pose, quaternion_from_rotation
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Grid
from tracker.io.atomic import write_text
from tracker.io.json_files import json_text

MODELS = {"PINHOLE": (1, 4), "OPENCV": (4, 8), "OPENCV_FISHEYE": (5, 8), "FULL_OPENCV": (6, 12)}
"""Name of a model → its number in binary files, and how many parameters it has."""
COLUMNS = {
    "cameras": "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]",
    "images": "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]",
    "points3D": "POINT3D_ID X Y Z R G B ERROR TRACK[]",
}
"""File of a model → the column names in its first line."""
COLOR = (158, 143, 117)
"""R, G, B of the points."""


@dataclass(frozen=True)
class ColmapCamera:
    """A camera: model of MODELS, size px, and parameters fx, fy, cx, cy px and distortion."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class ColmapImage:
    """An image: name below the folder of images, number of its camera from 1, and T_optical_world (x right, y down, z ahead).

    Raises ValueError for a name with a blank, which ends a name in COLMAP's text files.
    """

    name: str
    camera: int
    T_optical_world: Pose

    def __post_init__(self) -> None:
        if len(self.name.split()) != 1:
            raise ValueError(f"name of an image is {self.name!r}, needs one without blanks for COLMAP")

    @property
    def numbers(self) -> list[float]:
        """Quaternion w, x, y, z and translation m."""
        return [*quaternion_from_rotation(self.T_optical_world.rotation).tolist(), *self.T_optical_world.translation.tolist()]


def write_model(folder: Path, cameras: Sequence[ColmapCamera], images: Sequence[ColmapImage], points: Array) -> None:
    """Write cameras, images and points3D as .txt and as .bin, numbered from 1 in their order. Reading gives the same float64.

    points (n, 3) m: they have COLOR and no observations.
    """
    rows: dict[str, list[tuple[str, bytes]]] = {name: [] for name in COLUMNS}
    for k, c in enumerate(cameras, 1):
        number, count = MODELS[c.model]
        binary = struct.pack(f"<IiQQ{count}d", k, number, c.width, c.height, *c.parameters)
        rows["cameras"].append((f"{k} {c.model} {c.width} {c.height} {_text(c.parameters)}", binary))
    for k, image in enumerate(images, 1):
        # The second line of an image lists its points: none.
        binary = struct.pack("<I7dI", k, *image.numbers, image.camera) + image.name.encode() + b"\0" + struct.pack("<Q", 0)
        rows["images"].append((f"{k} {_text(image.numbers)} {image.camera} {image.name}\n", binary))
    for k, point in enumerate(points.tolist(), 1):
        binary = struct.pack("<Q3d3BdQ", k, *point, *COLOR, 0.0, 0)
        rows["points3D"].append((f"{k} {_text(point)} {' '.join(map(str, COLOR))} 0", binary))
    for name, columns in COLUMNS.items():
        write_text(folder / f"{name}.txt", "".join(f"{line}\n" for line in (f"# {columns}", *(text for text, _ in rows[name]))))
        (folder / f"{name}.bin").write_bytes(struct.pack("<Q", len(rows[name])) + b"".join(binary for _, binary in rows[name]))


def _text(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(x) + 0.0) for x in numbers)


README = """
    SEQUENCE/images/CAMERA/000000.jpg      images as in the sequence (JPEG or PNG), frames from 0
    SEQUENCE/images/CAMERA_FACE/000000.jpg faces of a panorama: front, left, back, right, up, down
    SEQUENCE/sparse/0/cameras.txt, .bin    number from 1, model, width, height [px], parameters
    SEQUENCE/sparse/0/images.txt, .bin     number from 1, QW QX QY QZ, TX TY TZ [metres], number of the camera, name; then an empty line
    SEQUENCE/rig_config.json               which images are of one robot, and how they sit (for `colmap rig_configurator`)
    SEQUENCE/sparse/0/points3D.txt, .bin   points of the terrain, walls and furniture: number from 1, X Y Z [metres], R G B, error 0

The text and the binary files hold the same. `colmap gui --import_path SEQUENCE/sparse/0 --image_path SEQUENCE/images`, or in Python
`pycolmap.Reconstruction("SEQUENCE/sparse/0")`, opens them. The poses are true: `colmap point_triangulator` finds points for them.

The world is pilsim's: right-handed, z up, metres. The quaternion and T map the world to the camera: x right, y down, z ahead.
Parameters [px] are fx, fy, cx, cy and OpenCV's distortion; COLMAP's first pixel has its centre at (0.5, 0.5). PINHOLE has no distortion, OPENCV
k1, k2, p1, p2, FULL_OPENCV k1, k2, p1, p2, k3 and zeros, OPENCV_FISHEYE k1 to k4.
A panorama is six pinholes of 90°, a cylinder the four level ones (black above and below its image), sampled bilinearly from its pixels. All have its
centre; each face turns about it alone. rig_config.json: quaternion w, x, y, z and translation [metres] from the first view of a robot to each other.
People walk and robots drive through the images: masks are in the export coco.
The points are grid points of the height map, thinned to at most 20,000. They have no color of their own, and no image observes them.
"""
MOST_POINTS = 20_000


def export_colmap(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write a model for each sequence. Returns notes on missing images and on fitted distortions."""
    notes = []
    for recording in recordings:
        root = out / recording.name
        model, images = root / "sparse" / "0", root / "images"
        model.mkdir(parents=True)
        views = [view for name, camera in recording.cameras.items() for view in faces(name, camera)]
        listed, pictured = [], [view for view in views if recording.has_images(view.source)]
        for view in pictured:
            (images / view.name).mkdir(parents=True)
        for frame in recording.frames():
            for number, view in enumerate(views, 1):
                suffix = recording.image_suffix(view.source)
                name = f"{view.name}/{frame:06d}{suffix}"
                listed.append(_image(recording, frame, view, number, name))
                if view in pictured:
                    (images / name).write_bytes(view.image(recording, frame, suffix))
        write_model(model, [colmap_camera(view.camera) for view in views], listed, _points(recording))
        write_text(root / "rig_config.json", json_text(rig_configuration(recording, views), indent=1) + "\n")
        notes += camera_notes(recording, recording.cameras, "their poses are here")
    return notes


def _image(recording: RecordedSequence, frame: int, view: ExportedView, number: int, name: str) -> ColmapImage:
    mount = recording.setup.mounts[view.source]
    T_world_optical = recording.truth[frame].T_world_robot[mount.robot] @ mount.T_body_camera @ view.T_camera_view @ OPTICAL
    return ColmapImage(name, number, T_world_optical.inverse())


def rig_configuration(recording: RecordedSequence, views: list[ExportedView]) -> list[dict[str, Any]]:
    """A rig for each robot with cameras. The first view is the reference; each other view has the transform from the reference to its own frame."""
    rigs: dict[str, list[dict[str, Any]]] = {}
    first: dict[str, Pose] = {}
    for view in views:
        mount = recording.setup.mounts[view.source]
        seat = mount.T_body_camera @ view.T_camera_view @ OPTICAL
        entry: dict[str, Any] = {"image_prefix": f"{view.name}/"}
        if mount.robot not in first:
            first[mount.robot] = seat
            entry["ref_sensor"] = True
        else:
            place = seat.inverse() @ first[mount.robot]
            entry["cam_from_rig_rotation"] = quaternion_from_rotation(place.rotation).tolist()
            entry["cam_from_rig_translation"] = place.translation.tolist()
        rigs.setdefault(mount.robot, []).append(entry)
    return [{"cameras": cameras} for cameras in rigs.values()]


def colmap_camera(camera: Camera) -> ColmapCamera:
    """A pinhole or fisheye in the simplest model of COLMAP that holds it. Raises ValueError for a panorama."""
    p = CameraParameters.of(camera)
    plain = (p.fx, p.fy, p.cx + 0.5, p.cy + 0.5)
    if p.model == "fisheye":
        return ColmapCamera("OPENCV_FISHEYE", camera.width, camera.height, (*plain, *p.distortion))
    if p.model != "pinhole":
        raise ValueError(f"camera is {p.model}, needs a pinhole or a fisheye")
    if not any(p.distortion):
        return ColmapCamera("PINHOLE", camera.width, camera.height, plain)
    if not p.distortion[4]:
        return ColmapCamera("OPENCV", camera.width, camera.height, (*plain, *p.distortion[:4]))
    return ColmapCamera("FULL_OPENCV", camera.width, camera.height, (*plain, *p.distortion, 0.0, 0.0, 0.0))


def _points(recording: RecordedSequence) -> Array:
    """Points (n, 3) m of the height map with walls and furniture, or of the ground; none where it is a plane."""
    ground = recording.setup.occluders or recording.setup.ground
    if not isinstance(ground, Grid):
        return np.zeros((0, 3))
    step = max(1, int(np.ceil(np.sqrt(ground.heights.size / MOST_POINTS))))
    z = ground.heights[::step, ::step]
    x, y = np.meshgrid(np.arange(z.shape[1]) * step * ground.spacing, np.arange(z.shape[0]) * step * ground.spacing)
    return np.column_stack([x.ravel() + ground.origin[0], y.ravel() + ground.origin[1], z.ravel()])
