"""A small folder of each format of sources: twelve frames of three people who walk before two cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.tracker import sequences
from tests.tracker.planar_slam import mrclam
from tracker.formats.aicity.files import AiCityObject, write_ground_truth
from tracker.formats.aicity.files import write_calibration as write_aicity_calibration
from tracker.formats.jrdb.files import DETECTIONS, LABELS_2D, LABELS_3D, Label2d, Label3d, write_detections_2d, write_labels_2d, write_labels_3d
from tracker.formats.jrdb.reading import ABOVE_FLOOR
from tracker.formats.pets2009 import Site, write_annotations, write_site
from tracker.formats.wildtrack.files import WildtrackPosition, write_calibration, write_positions
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Cylinder, Pinhole, Tsai
from tracker.geometry.ground import Flat
from tracker.geometry.image_boxes import body_boxes
from tracker.io.mot15 import Mot15Rows, write_mot15
from tracker.io.tsai_xml import write_camera
from tracker.recordings import FrameBoxes, Recording, RecordingCamera
from tracker.recordings.degradation import projected_boxes
from tracker.recordings.folder import write_recording

FRAMES = 12
LENS = Pinhole(1280, 720, 900.0, 900.0, 639.5, 359.5)
UP = np.array([0.0, 0.0, 0.5])
"""Times the size of a box: from its lower side to its middle."""
AREA = ((0.0, 0.0), (8.0, 6.0))


def recording() -> Recording:
    """The scene with a box of each body in each view, without noise."""
    cameras = {
        "C1": RecordingCamera.looking_at(LENS, [-3.0, -2.0, 3.5], [4.0, 3.0, 0.5]),
        "C2": RecordingCamera.looking_at(LENS, [11.0, -2.0, 3.5], [4.0, 3.0, 0.5]),
    }
    ids = np.array([1, 2, 3])
    truth = {k: (ids, np.array([[2 + 0.2 * k, 2, 0], [6 - 0.2 * k, 4, 0], [4, 1.5 + 0.2 * k, 0]])) for k in range(FRAMES)}
    return projected_boxes(Recording(4.0, cameras, truth=truth, area=AREA))


def write_boxes(folder: Path, boxes: dict[str, FrameBoxes]) -> None:
    """detections/NAME.txt of each camera (MOT15)."""
    (folder / "detections").mkdir()
    for name, frames in boxes.items():
        number = np.concatenate([np.full(len(box), frame + 1) for frame, (box, _) in frames.items()])
        box, sure = (np.concatenate([of_frame[k] for of_frame in frames.values()]) for k in range(2))
        write_mot15(folder / "detections" / f"{name}.txt", Mot15Rows(number, np.full(len(number), -1), box, sure, np.full((len(number), 3), -1.0)))


def write_own(folder: Path) -> Path:
    folder.mkdir()
    write_recording(folder, recording())
    return folder


def write_multiviewx(folder: Path, names: tuple[str, str] = ("Camera1", "Camera2"), scale: float = 1.0, step: int = 1) -> Path:
    """names: of the cameras in the files. scale: units of translations in a metre. step: between the numbers of files."""
    folder.mkdir()
    scene, wildtrack = recording(), scale != 1.0
    for name, camera in zip(names, scene.cameras.values(), strict=True):
        scaled = replace(camera, pose=Pose(camera.pose.rotation, scale * camera.pose.translation))
        write_calibration(folder / "calibrations", name, scaled)
    (folder / "annotations_positions").mkdir()
    for frame, (ids, places) in (scene.truth or {}).items():
        # Points of 2.5 cm: MultiviewX has 1000 in a row from (0, 0), WILDTRACK 480 from (-3, -9).
        x, y = np.rint((places[:, :2] - (np.array([-3, -9]) if wildtrack else 0)) / 0.025).astype(int).T
        people = [
            WildtrackPosition(int(n), int(p), np.zeros((0, 4), dtype=np.int64))
            for n, p in zip(ids, x + (480 if wildtrack else 1000) * y, strict=True)
        ]
        write_positions(folder / "annotations_positions" / f"{step * frame:05d}.json", people)
    write_boxes(folder, dict(scene.detections))
    return folder


def write_wildtrack(folder: Path) -> Path:
    return write_multiviewx(folder, ("CVLab1", "CVLab2"), scale=100.0, step=5)


def write_jrdb(folder: Path) -> Path:
    """The same people around a robot at (4, 3) that stands."""
    for name in (LABELS_2D, LABELS_3D, DETECTIONS):
        (folder / name).mkdir(parents=True)
    camera = Cylinder(3760, 480, 210.7, 481.0)
    mounted = RecordingCamera.looking_at(camera, [4.0, 2.9, ABOVE_FLOOR], [5.0, 2.9, ABOVE_FLOOR])
    places: dict[int, Array] = {6 * frame: mounted.pose.inverse().apply(feet) for frame, (_, feet) in (recording().truth or {}).items()}
    boxes = {frame: body_boxes(camera, mounted.pose, mounted.pose.apply(feet)) for frame, feet in places.items()}
    size = np.array([0.5, 0.5, 1.75])
    labels = {f: [Label3d(n, at + size * UP, size, 0.0) for n, at in enumerate(feet, 1)] for f, feet in places.items()}
    write_labels_3d(folder / LABELS_3D / "scene.json", labels)
    write_labels_2d(folder / LABELS_2D / "scene.json", {f: [Label2d(n, b, b, 1.0) for n, b in enumerate(box, 1)] for f, box in boxes.items()}, 3760)
    write_detections_2d(folder / DETECTIONS / "scene.json", {f: (box, np.ones(len(box))) for f, box in boxes.items()})
    return folder


def write_aicity(folder: Path) -> Path:
    folder.mkdir()
    scene = recording()
    write_aicity_calibration(folder / "calibration.json", scene.rate, scene.cameras)
    size = np.array([0.6, 0.6, 1.75])
    people = {
        f: [AiCityObject("Person", int(n), at + size * UP, size, np.zeros(3)) for n, at in zip(*found, strict=True)]
        for f, found in (scene.truth or {}).items()
    }
    write_ground_truth(folder / "ground_truth.json", people)
    write_boxes(folder, dict(scene.detections))
    return folder


def write_pets(folder: Path) -> Path:
    scene, views = recording(), {"View_001": "C1", "View_002": "C2"}
    (folder / "calibration").mkdir(parents=True)
    (folder / "annotations").mkdir()
    lens = Tsai(LENS.width, LENS.height, LENS.fx * 0.01, 0.0, LENS.cx, LENS.cy, 1.0, 0.01, 0.01)
    for view, name in views.items():
        write_camera(folder / "calibration" / f"{view}.xml", view, lens, scene.cameras[name].pose)
    write_boxes(folder, {view: scene.detections[name] for view, name in views.items()})
    truth = {frame: (ids, scene.detections["C1"][frame][0]) for frame, (ids, _) in (scene.truth or {}).items()}
    write_annotations(folder / "annotations" / "scene-cropped.xml", "scene", truth)
    write_site(folder, Site(scene.rate, np.array(AREA), Flat()), None)
    return folder


def write_sequence(folder: Path) -> Path:
    sequences.write(folder)
    return folder


SOURCES: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "pilsim": ("pilsim", write_sequence),
    "own": ("recording", write_own),
    "utias": ("utias", mrclam.write_set),
    "wildtrack": ("wildtrack", write_wildtrack),
    "multiviewx": ("wildtrack", write_multiviewx),
    "jrdb": ("jrdb", write_jrdb),
    "aicity": ("aicity", write_aicity),
    "pets": ("pets2009", write_pets),
}
"""Kind → the name of its format in registry.SOURCES, and the writer of a folder of it that is not there yet."""
RECORDINGS = ("own", "wildtrack", "multiviewx", "jrdb", "aicity", "pets")
"""The kinds that have cameras and boxes and are read as a Recording."""
