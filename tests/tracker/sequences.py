"""A small sequence for tests: two robots with small panoramas on a slope, and two people who walk."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.templates import copied
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Grid
from tracker.sequence.writer import SequenceWriter, view_name
from tracker.types import Boxes, Detections, Keypoints, Mount, Odometry, RobotDetections, Setup, Start, Tick, Truth, View, ViewTruth

FRAMES = 3
CAMERA = Panorama(64, 32)


def setup() -> Setup:
    heights = np.add.outer(np.zeros(21), 0.05 * np.arange(21))
    mounts = {f"robot_{k}_camera": Mount(CAMERA, Pose.planar(0, 0, 0.0, 1.3), f"robot_{k}") for k in range(2)}
    starts: dict[str, Start | None] = {f"robot_{k}": Start(Pose.planar(k, 2 * k, 0.3 * k), 0.01 * np.eye(6)) for k in range(2)}
    return Setup(mounts, Grid(heights, np.array([-5.0, -5.0]), 0.5), starts, 1 / 6)


def robot_detections(k: int, camera: str) -> RobotDetections:
    """Each robot detects the other at its true position, except the second robot in the first frame."""
    if camera == "robot_1_camera" and k == 0:
        return RobotDetections.none()
    poses, mount = truth(k).T_world_robot, setup().mounts[camera]
    other = next(robot for robot in poses if robot != mount.robot)
    sight = (poses[mount.robot] @ mount.T_body_camera).inverse().apply((poses[other] @ mount.T_body_camera).translation)
    return RobotDetections(sight[None] / np.linalg.norm(sight), (other,), np.array([[[2e-6, 1e-7], [1e-7, 3e-6]]]))


def tick(k: int, rng: np.random.Generator) -> Tick:
    views = []
    for name in setup().mounts:
        bearing = rng.normal(size=(k + 1, 3))
        bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
        n = len(bearing)
        covariance = np.tile(np.array([[2e-5, 1e-6], [1e-6, 3e-5]]), (n, 1, 1))
        found = Detections(bearing, rng.uniform(0.1, 0.5, (n, 2)), rng.uniform(0.5, 1, n), covariance, np.zeros((n, 0)))
        odometry = Odometry(Pose.exp(rng.normal(0, 0.1, 6)), 0.001 * np.eye(6), np.array([0.0, 0.0, 1.0]), 0.01) if k else None
        image = rng.integers(0, 255, (32, 64, 3), dtype=np.uint8)
        views.append(View(name, found, odometry=odometry, image=image, robot_detections=robot_detections(k, name)))
    return Tick(k, k / 6, tuple(views))


def truth(k: int) -> Truth:
    robots = {f"robot_{r}": Pose.planar(r + 0.1 * k, 2 * r, 0.3 * r) for r in range(2)}
    feet = np.array([[1.0 + k, 2.0, 0.5], [3.0, 1.0 - k, 0.25]])
    joints = feet[:, None] + np.linspace(0, 1.7, 17)[:, None] * np.array([0.0, 0.1, 1.0])
    return Truth(k, robots, np.array([4, 9]), feet, np.array([[0.5, 1.0], [0.0, 0.125]]), joints, frozenset({"robot_1"} if k == 1 else ()))


def view_truth(k: int, name: str) -> ViewTruth:
    mount = setup().mounts[name]
    box = np.array([[60.0, 10.0, 66.0, 20.0], [0.0, 0.0, 0.0, 0.0]])
    boxes = Boxes(np.array([4, 9]), box, box + 1.0, np.array([0.5, 0.0]), np.array([3.25, 8.0 + k]))
    pixels = np.arange(2 * 17 * 2).reshape(2, 17, 2) + 0.25
    keypoints = Keypoints(np.array([4, 9]), pixels, np.arange(34).reshape(2, 17) % 3)
    return ViewTruth(truth(k).T_world_robot[mount.robot] @ mount.T_body_camera, 0.1 * k, np.array([0.0, 0.6, 0.8]), boxes, keypoints)


def write(folder: Path, seed: int = 0) -> list[Tick]:
    """Copy the sequence to `folder`; returns its ticks."""
    return copied(folder, ("sequence", seed), partial(write_anew, seed=seed))


def write_anew(folder: Path, seed: int = 0) -> list[Tick]:
    """Write the sequence into `folder`; returns its ticks."""
    rng = np.random.default_rng(seed)
    ticks = [tick(k, rng) for k in range(FRAMES)]
    tops = setup().ground
    assert isinstance(tops, Grid)
    with SequenceWriter(folder, setup(), Grid(tops.heights + 0.5, tops.origin, tops.spacing)) as writer:
        for k, one in enumerate(ticks):
            instances = {name: np.full((32, 64), 4, np.uint16) for name in setup().mounts}
            add_images(writer, one, instances)
            writer.add(one, truth(k), {name: view_truth(k, name) for name in setup().mounts})
        writer.finish({"seed": seed}, {"pilsim": "test"})
    return ticks


def add_images(writer: SequenceWriter, tick: Tick, instances: dict[str, Any], ranges: dict[str, Any] | None = None, classes: Any = None) -> None:
    """Write the images of a tick's views. instances, ranges, classes: camera → image; a form without a layer needs none of it."""
    for view in tick.views:
        assert view.image is not None
        writer.add_image(tick.index, view.camera, view.image)
        layers = (instances[view.camera], *((images or {}).get(view.camera) for images in (ranges, classes)))
        for name, pixels, how in writer.form.layer_files(view_name(view.camera, tick.index), *layers):
            writer.images.put(name, pixels, how)
