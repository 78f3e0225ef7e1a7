"""Valid files of every format, small, each written into an empty folder."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from sim.datasets.presets import PRESETS
from sim.policies.training import Curve
from tests.sim import stress_rows
from tests.tracker import disc_sequence, sequences
from tests.tracker.formats.ros.robot_bag import RobotBag
from tests.tracker.planar_slam.mrclam import write_set
from tracker.clique import Graph
from tracker.clique.dimacs import write_graph
from tracker.formats import pets2009
from tracker.formats.aicity import files as aicity
from tracker.formats.jrdb import files as jrdb
from tracker.formats.wildtrack import files as wildtrack
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Panorama, Pinhole, Tsai, pinhole
from tracker.geometry.ground import Flat, Grid
from tracker.io.mot15 import Mot15Rows, read_mot15, write_mot15
from tracker.io.tsai_xml import write_camera
from tracker.io.video_files import VideoWriters
from tracker.planar_slam.trajectories import PlanarTrajectories, write_trajectories
from tracker.recordings import Recording, RecordingCamera, RecordingRobot
from tracker.recordings.folder import write_recording
from tracker.sequence.dataset import Dataset
from tracker.sequence.results import Results, write_results
from tracker.types import Estimate, MapSnapshot, Odometry, Start

RNG_SEED = 5
SIZE = (24, 32)
"""Height and width of the images, px."""


def camera() -> Tsai:
    """A camera of PETS 2009 with barrel distortion."""
    return Tsai(96, 72, 5.5549, 5.1113e-03, 40.6, 35.4, 1.09379, 8 * 5.1273e-03, 8 * 4.65e-03)


def pose() -> Pose:
    """T_world_camera of a camera 5 m above the ground that looks down."""
    return Pose.planar(-12.0, -4.0, 0.2, 5.0) @ Pose.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.35, 0.0]))


def mot15(file: Path, detections: bool = False, boxes: bool = True) -> None:
    """Three people, or boxes without ids, in three frames."""
    rng = np.random.default_rng(RNG_SEED)
    frame, person = np.repeat(np.arange(1, 4), 3), np.tile([4, 9, 17], 3)
    box = np.column_stack([rng.uniform(12, 75, 9), rng.uniform(20, 50, 9), np.full(9, 5.0), np.full(9, 12.0)])
    place = np.column_stack([rng.uniform(-5, 4, (9, 2)), np.zeros(9)])
    ids = np.full(9, -1) if detections else person
    rows = Mot15Rows(frame, ids, box if boxes else np.full((9, 4), -1.0), rng.uniform(0.5, 1, 9), np.full((9, 3), -1.0) if detections else place)
    write_mot15(file, rows)


def annotations(file: Path) -> None:
    boxes = np.array([[37.0, 30.0, 5.0, 15.0], [50.5, 27.0, 4.5, 12.25]])
    pets2009.write_annotations(file, "PETS", {k: (np.array([1, 2]), boxes + k) for k in range(3)})


def terrain(file: Path) -> None:
    heights = np.add.outer(np.zeros(9), 0.05 * np.arange(9))
    np.savez(file, heights=heights, origin=np.array([-20.0, -20.0]), spacing=5.0, tops=heights)


def site(folder: Path) -> None:
    area = np.array([[-14.0, -14.0], [4.0, 4.0]])
    terrain(folder / "made.npz")
    pets2009.write_site(folder, pets2009.Site(7.0, area, Flat(), pillars=np.array([[1.0, 2.0, 0.1, 0.0, 2.5]])), folder / "made.npz")
    (folder / "made.npz").unlink()


def pets(folder: Path) -> None:
    """A PETS 2009 folder with one view."""
    for name in ("calibration", "detections", "annotations"):
        (folder / name).mkdir()
    write_camera(folder / "calibration" / "View_001.xml", "View_001", camera(), pose())
    mot15(folder / "detections" / "View_001.txt", detections=True)
    annotations(folder / "annotations" / "PETS-cropped.xml")
    site(folder)


def dimacs(file: Path) -> None:
    write_graph(file, Graph.from_conflicts([1.5, 2.0, 3.0, 4.0], [[0, 3], [1, 3]]))


def wildtrack_folder(folder: Path) -> None:
    """Annotation, calibration, and configuration of two views."""
    grid = wildtrack.GroundGrid(np.array([-3.0, -2.0]), 5, 4, 0.5)
    boxes = np.array([[10, 20, 30, 40], [-1, -1, -1, -1]])
    people = [wildtrack.WildtrackPosition(7, 3, boxes, np.array([1.0, 2.0, 0.0])), wildtrack.WildtrackPosition(9, 8, boxes[::-1])]
    wildtrack.write_positions(folder / "00000.json", people)
    eye = wildtrack.opencv_camera(camera(), pose())[0]
    wildtrack.write_calibration(folder, "Camera1", eye)
    wildtrack.write_config(folder / "config.json", grid, 1, 3, (72, 96))


def jrdb_files(folder: Path) -> None:
    box = np.array([60.0, 10.0, 8.0, 20.0])
    jrdb.write_labels_2d(folder / "2d.json", {0: [jrdb.Label2d(4, box, box, 0.5)], 1: []}, 64)
    jrdb.write_labels_3d(folder / "3d.json", {0: [jrdb.Label3d(4, np.array([1.0, 2.0, 0.5]), np.array([0.5, 0.5, 1.7]), 0.3)]})


def sequence(folder: Path) -> None:
    (folder / "s").parent.mkdir(exist_ok=True)
    sequences.write(folder / "s")


def sensors(folder: Path) -> None:
    """A sequence whose robot has an IMU, wheel encoders and clocks."""
    disc_sequence.write(folder / "s", sensors=disc_sequence.SENSORS)


def dataset(folder: Path) -> None:
    form = {"png": False, "range": False, "classes": False, "video": False, "mesh": False}
    (folder / "dataset.json").write_text(Dataset("pilsun", json.loads(PRESETS["pilsun"].scenario.to_json()), 2, form, ("s",)).to_json())
    sequence(folder)


def recording(folder: Path) -> None:
    """Two cameras, one of them on a robot, terrain, truth and images."""
    motion = {k: Odometry(Pose.planar(0.1, 0.0, 0.02), np.eye(6) * 1e-4, np.array([0.0, 0.0, 1.0])) for k in range(3)}
    robot = RecordingRobot(Start(Pose.planar(1.0, 1.0, 0.5), np.eye(6) * 1e-3), motion, {k: Pose.planar(1.0 + 0.1 * k, 1.0, 0.5) for k in range(3)})
    cameras = {
        "C1": RecordingCamera(Pinhole(64, 48, 50.0, 50.0, 31.5, 23.5, (0.05, -0.01, 0.001, 0.002, 0.0)), pose()),
        "P": RecordingCamera(Panorama(64, 32), Pose(np.eye(3), np.array([0.1, 0.0, 0.5])), "r0"),
    }
    boxes = {k: (np.array([[10.0, 25.0, 4.0, 9.0], [30.0, 24.0, 3.0, 8.0]]), np.array([0.9, 0.7])) for k in range(3)}
    people = {k: (np.array([4, 7]), np.array([[1.0 + 0.1 * k, 2.0, 0.0], [3.0, 1.0 / 3.0, 0.0]])) for k in range(3)}
    heights = Grid(np.zeros((6, 6)), np.array([-20.0, -20.0]), 10.0)
    whole = Recording(5.0, cameras, {"C1": boxes, "P": {}}, people, area=[[-9, -9], [9, 9]], ground=heights, robots={"r0": robot})
    write_recording(folder, whole)
    (folder / "images" / "P").mkdir(parents=True)
    for k in range(3):
        cv2.imwrite(str(folder / "images" / "P" / f"{k + 1:06d}.png"), np.full((32, 64, 3), 40 * k, dtype=np.uint8))


def visible_parts(folder: Path) -> None:
    """A recording with the visible parts of its boxes."""
    recording(folder)
    boxes = read_mot15(folder / "detections" / "C1.txt")
    parts = boxes.box * [1.0, 1.0, 1.0, 0.5]
    write_mot15(folder / "detections" / "C1.visible.txt", replace(boxes, box=parts, confidence=np.linspace(0.25, 1.0, len(boxes))))


def aicity_scene(folder: Path) -> None:
    """A camera, two people and their detections, and results."""
    ahead = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    eye = RecordingCamera.of_opencv(Pinhole(128, 72, 90.0, 90.0, 64.0, 36.0), ahead, -ahead @ [0.0, 0.0, 3.0])
    people = [aicity.AiCityObject("Person", k, np.array([5.0 + k, 0.0, 0.9]), np.array([0.5, 0.5, 1.8]), np.zeros(3)) for k in (1, 2)]
    aicity.write_calibration(folder / "calibration.json", 30.0, {"Camera": eye})
    aicity.write_ground_truth(folder / "ground_truth.json", {0: people, 2: people[:1]})
    (folder / "detections").mkdir()
    mot15(folder / "detections" / "Camera.txt", detections=True)


def aicity_results(file: Path) -> None:
    n = 4
    people, frames = np.array([7, 9, 7, 9]), np.array([0, 0, 1, 1])
    where, size = np.column_stack([np.arange(n), np.ones(n), np.full(n, 0.9)]), np.tile([0.6, 0.6, 1.75], (n, 1))
    aicity.write_results(file, aicity.AiCityRows(np.ones(n, dtype=np.int64), np.zeros(n, dtype=np.int64), people, frames, where, size, np.zeros(n)))


def jrdb_folder(folder: Path) -> None:
    """Labels and detections of three frames with the note of pilsim."""
    for kind in (jrdb.LABELS_2D, jrdb.LABELS_3D, jrdb.DETECTIONS):
        (folder / kind).mkdir(parents=True)
    box = np.array([60.0, 10.0, 8.0, 20.0])
    note = jrdb.PanoramaNote(2.5, 128, 64, 1.0)
    jrdb.write_labels_2d(folder / jrdb.LABELS_2D / "s.json", {k: [jrdb.Label2d(4, box, box, 0.5)] for k in range(3)}, 128, note)
    space = jrdb.Label3d(4, np.array([3.0, 2.0, -0.1]), np.array([0.5, 0.5, 1.7]), 0.3)
    jrdb.write_labels_3d(folder / jrdb.LABELS_3D / "s.json", {k: [space] for k in range(3)})
    jrdb.write_detections_2d(folder / jrdb.DETECTIONS / "s.json", dict.fromkeys(range(3), (box[None], np.array([0.9]))))


def results(folder: Path) -> None:
    """Results of three frames with a robot, targets and landmarks."""
    out = []
    for k in range(3):
        chart = MapSnapshot(np.array([7, 9]), np.array([[7.0, 0.0, 0.0], [9.0, 0.0, 0.0]]), {"robot_0": np.array([9, 7])})
        P = {"robot_0": 0.01 * np.eye(6) + 0.001}
        place: Array = np.arange(6.0).reshape(2, 3) + 0.5
        out.append(Estimate(k, {"robot_0": Pose.planar(k, 1.0, 0.2)}, P, np.arange(2), place, np.zeros((2, 3, 3)), map_snapshot=chart))
    write_results(folder / "r", Results.of(out, {"source": "here", "views": [1, 2], "parameters": {}}))


def planar(folder: Path) -> None:
    poses = {n: np.column_stack([np.arange(3.0), np.full(3, n), np.zeros(3)]) for n in (1, 2)}
    spread = {n: np.tile(0.01 * np.eye(3), (3, 1, 1)) for n in (1, 2)}
    write_trajectories(folder / "r", PlanarTrajectories(np.arange(3.0), poses, spread, {6: np.array([1.0, 2.0])}, {"map": "known"}))


def utias(folder: Path) -> None:
    write_set(folder / "u", rate=2.0)


def settings_toml(file: Path) -> None:
    sensors = 'imu = "bmi088@198"\nwheels = 66\nclock = "offset=0.1,jitter=0.01;View_001:drift=20"\n'
    file.write_text('world = "pilsun"\npeople = 5\nframes = 12\nrate = 6.0\nseed = 3\nviews = 2\nchildren = 0.25\n' + sensors)


def settings_json(file: Path) -> None:
    file.write_text(json.dumps({"world": "pilsun", "people": 5, "frames": 12, "rate": 6.0, "seed": 3, "views": 2}, indent=1) + "\n")


def stress(folder: Path) -> None:
    """Rows of a stress test with one moment."""
    picture = np.full((*SIZE, 3), 90, np.uint8)
    (folder / "moments").mkdir()
    cv2.imwrite(str(folder / "moments" / "m.png"), picture)
    moment = {
        "frame": 3,
        "kind": "switch",
        "cause": "merged",
        "person": 4,
        "position": [1.0, 2.0, 0.25],
        "weight": 3.0,
        "pictures": ["moments/m.png"],
    }
    stress_rows.write(folder, [*stress_rows.density(2)[:3], stress_rows.terrain(1)[0] | {"moments": [moment]}])


@cache
def picture(depth: int) -> np.ndarray:
    return np.random.default_rng(RNG_SEED).integers(0, 256, SIZE if depth == 16 else (*SIZE, 3)).astype(np.uint16 if depth == 16 else np.uint8)


def image(file: Path) -> None:
    """A picture of 8 bits, 3 channels; one of 16 bits where the name says instances."""
    cv2.imwrite(str(file), picture(16 if "instances" in file.name else 8))


def video(folder: Path) -> None:
    writers = VideoWriters(folder / "video", 5.0)
    for k in range(3):
        writers.put("View_001", np.roll(np.kron(picture(8), np.ones((4, 4, 1), np.uint8)), k, axis=1))
    writers.finish()


def cells(file: Path) -> None:
    file.write_text("data,k_h,i_bls_max,repetition,seconds,mota\nreal,5,500,0,1.25,0.9\nsynthetic,10,500,1,1.5,0.8\n")


def curve(file: Path) -> None:
    out = Curve(100)
    out.add(10, [0.5, 0.7])
    out.add(20, [0.6])
    out.write(file)


def tsai(file: Path) -> None:
    write_camera(file, "View_001", camera(), pose())


def plain_camera(file: Path) -> None:
    write_camera(file, "View_002", pinhole(320, 240, 1.2), pose())


def bag(folder: Path, form: str) -> None:
    """A second of a robot's bag: walk/walk.mcap, walk/walk.db3 or walk.bag."""
    RobotBag(seconds=1.0).write(folder / "walk", form)
