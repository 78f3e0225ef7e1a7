"""A small sequence with consistent images and truth: two people as discs in a panorama on a robot and in a fixed camera."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.templates import copied
from tests.tracker.sequences import add_images
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Camera, Panorama, pinhole
from tracker.geometry.ground import Grid
from tracker.sequence.writer import ImageForm, SequenceWriter
from tracker.types import (
    HIDDEN,
    KEYPOINT_NAMES,
    VISIBLE,
    Boxes,
    Detections,
    ImuSamples,
    Keypoints,
    Mount,
    Odometry,
    RobotDetections,
    SensorSamples,
    SensorSetup,
    Setup,
    Start,
    Tick,
    Truth,
    View,
    ViewTruth,
    WheelSamples,
)

FRAMES = 3
CAMERAS: dict[str, Camera] = {"robot_0_camera": Panorama(128, 64), "View_001": pinhole(96, 72, 1.3)}
FIXED = Pose.planar(-4.0, 0.0, 0.0, 1.4)
MIDDLE, RADIUS = 1.0, 0.4
"""m: height of the centre above the feet, and radius, of the disc that models a person."""


def setup() -> Setup:
    ground = Grid(np.zeros((41, 41)), np.array([-10.0, -10.0]), 0.5)
    mounts = {"robot_0_camera": Mount(CAMERAS["robot_0_camera"], Pose.planar(0, 0, 0, 1.3), "robot_0")}
    mounts["View_001"] = Mount(CAMERAS["View_001"], Pose.identity(), "View_001")
    starts: dict[str, Start | None] = {"robot_0": Start(Pose.planar(0, 0, 0.3), 1e-4 * np.eye(6)), "View_001": Start(FIXED, np.zeros((6, 6)))}
    return Setup(mounts, ground, starts, 1 / 6)


def robots(k: int) -> dict[str, Pose]:
    return {"robot_0": Pose.planar(0.1 * k, 0.0, 0.3), "View_001": FIXED}


def joints(k: int) -> Array:
    """Joints (2, 17, 3) m: person 1 is in front of the fixed camera, person 2 behind the robot, across the seam of its panorama."""
    feet = np.array([[1.0, 1.5 + 0.2 * k, 0.0], [-2.5, -0.7, 0.0]])
    spread = np.linspace(-0.25, 0.25, len(KEYPOINT_NAMES))
    return (feet[:, None] + np.stack([0 * spread, 0 * spread, MIDDLE + spread], axis=1)).round(4)


def instance_image(camera: Camera, T: Pose, points: Array) -> NDArray[np.uint16]:
    """The instance image: pixels whose ray passes the centre of a person within RADIUS; the nearer person occludes the other."""
    v, u = np.indices((camera.height, camera.width)).reshape(2, -1) + camera.pixel_centre
    rays = camera.bearings_from_pixels(np.column_stack([u, v])) @ T.rotation.T
    image = np.zeros(camera.height * camera.width, np.uint16)
    middles = points.mean(axis=1) - T.translation
    for person in np.argsort(-np.linalg.norm(middles, axis=1)):
        along = rays @ middles[person]
        image[(along > 0) & (np.linalg.norm(middles[person] - along[:, None] * rays, axis=1) < RADIUS)] = person + 1
    return image.reshape(camera.height, camera.width)


def view_truth(k: int, name: str, image: NDArray[np.uint16]) -> ViewTruth:
    camera, mount = CAMERAS[name], setup().mounts[name]
    T = robots(k)[mount.robot] @ mount.T_body_camera
    shown = [p for p in (1, 2) if (image == p).any()]
    boxes, pixels, visibility = [], np.zeros((len(shown), 17, 2)), np.zeros((len(shown), 17), np.int64)
    for row, person in enumerate(shown):
        ys, xs = np.nonzero(image == person)
        over = isinstance(camera, Panorama) and np.ptp(xs) > camera.width / 2
        xs = np.where(over & (xs < camera.width / 2), xs + camera.width, xs)
        boxes.append([xs.min(), ys.min(), xs.max() + 1, ys.max() + 1])
        at = T.inverse().apply(joints(k)[person - 1])
        pixels[row] = camera.pixels_from_bearings(at / np.linalg.norm(at, axis=1, keepdims=True))[0] + 0.5 - camera.pixel_centre
        inside = (pixels[row] >= 0).all(axis=1) & (pixels[row] < [camera.width, camera.height]).all(axis=1)
        pixels[row][~inside] = 0.0
        x, y = np.floor(pixels[row]).astype(int).T
        visibility[row] = np.where(inside, np.where(image[y, x] == person, VISIBLE, HIDDEN), 0)
    ids = np.array(shown, dtype=np.int64)
    edges, far = np.array(boxes, dtype=np.float64).reshape(-1, 4), np.full(len(shown), 3.0)
    return ViewTruth(T, 0.0, np.array([0.0, 0.0, 1.0]), Boxes(ids, edges, edges, np.ones(len(shown)), far), Keypoints(ids, pixels, visibility))


def robot_detections(poses: dict[str, Pose]) -> RobotDetections:
    """The robot detects the fixed camera. poses: camera → T_world_camera."""
    sight = poses["robot_0_camera"].inverse().apply(poses["View_001"].translation)
    return RobotDetections(sight[None] / np.linalg.norm(sight), ("View_001",), 1e-5 * np.eye(2)[None])


SENSORS = SensorSetup(
    {"imu": {"name": "test", "rate": 198.0, "gyro_noise": 1e-4, "force_noise": 2e-3}, "wheels": {"rate": 49.5, "counts": 1024}},
    {"robot_0": (0.25, 100.0, 1e-3), "robot_0_camera": (0.0, 0.0, 0.0), "View_001": (-1.0, 0.0, 1e-4)},
)
"""Sensors of the robot, with clocks."""


def samples(k: int) -> SensorSamples:
    """Samples of frame k of those sensors."""
    rng = np.random.default_rng(k)

    def stamps(name: str, time: Array) -> Array:
        offset, drift, jitter = SENSORS.clocks[name]
        return time * (1 + drift * 1e-6) + offset + rng.normal(0.0, jitter, len(time))

    time = (33 * (k - 1) + np.arange(1, 34)) / 198
    true, bias = rng.normal(0.0, 1.0, (33, 6)), np.full((33, 6), 0.01)
    measured = true + bias + rng.normal(0.0, 1.0, (33, 6)) * np.repeat([1e-4, 2e-3], 3) * np.sqrt(198)
    parts = [each[:, axes] for each in (measured, true, bias) for axes in (slice(3), slice(3, 6))]
    steps = np.arange(33 * (k - 1) + 1, 33 * k + 1) if k else np.zeros(1)
    turned = steps[steps % 4 == 0] / 198
    angle = np.floor(turned[:, None] * [10.0, 11.0, 12.0, -13.0]) * 2 * np.pi / 1024
    return SensorSamples(
        {"robot_0": ImuSamples(time, stamps("robot_0", time), *parts)} if k else {},
        {"robot_0": WheelSamples(turned, stamps("robot_0", turned), angle)},
        {name: (k / 6, float(stamps(name, np.array([k / 6]))[0])) for name in SENSORS.clocks},
    )


def write(folder: Path, form: ImageForm | None = None, sensors: SensorSetup | None = None) -> None:
    """Copy the sequence to `folder`, with the samples of SENSORS where sensors are given."""
    copied(folder, ("discs", form, sensors is not None), partial(_write, form=form, sensors=sensors))


def _write(folder: Path, form: ImageForm | None, sensors: SensorSetup | None) -> None:
    rng = np.random.default_rng(3)
    tops = setup().ground
    assert isinstance(tops, Grid)
    with SequenceWriter(folder, setup(), tops, form, sensors) as writer:
        for k in range(FRAMES):
            poses = {name: robots(k)[mount.robot] @ mount.T_body_camera for name, mount in setup().mounts.items()}
            instances = {name: instance_image(camera, poses[name], joints(k)) for name, camera in CAMERAS.items()}
            truths = {name: view_truth(k, name, instances[name]) for name in CAMERAS}
            colours = {name: cv2.resize(rng.integers(0, 255, (9, 12, 3), np.uint8), image.shape[::-1]) for name, image in instances.items()}
            still = Odometry(Pose.planar(0.1, 0, 0), 1e-4 * np.eye(6)) if k else None
            robot = View(
                "robot_0_camera", Detections.none(), odometry=still, image=colours["robot_0_camera"], robot_detections=robot_detections(poses)
            )
            views = [robot, View("View_001", Detections.none(), image=colours["View_001"])]
            visible = np.array([[float(p in truths[n].boxes.person) for n in CAMERAS] for p in (1, 2)])
            truth = Truth(k, robots(k), np.array([1, 2]), joints(k)[:, 0] * [1, 1, 0], visible, joints(k))
            ranges = {n: np.where(i > 0, 3.0, np.inf).astype(np.float32) for n, i in instances.items()}
            classes = {n: (i > 0).astype(np.uint8) for n, i in instances.items()}
            tick = Tick(k, k / 6, tuple(views))
            add_images(writer, tick, instances, ranges, classes)
            writer.add(tick, truth, truths)
            if sensors:
                writer.add_samples(k, samples(k))
        writer.finish({"world": "painted", "seed": 0, "frames": FRAMES}, {"pilsim": "test"})
