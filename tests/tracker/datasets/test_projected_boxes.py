"""Boxes of bodies at true positions: tight around the body in every camera model, whole over the seam, cut at the image, degraded as asked."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tracker.datasets.projected_boxes import BoxNoise, body_boxes, projected_boxes
from tracker.geometry import Array, Pose
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.cameras import Cylinder, Fisheye, Panorama, Pinhole, pinhole
from tracker.recordings import Recording, RecordingCamera, RecordingRobot

LOOKING_DOWN = Pose(Pose.exp([0, 0, 0, 0, 0.3, 0]).rotation, np.array([0.0, 0.0, 2.5]))
"""A camera 2.5 m above the ground that looks along x and 0.3 rad down."""
CAMERAS: dict[str, Camera] = {
    "pinhole": Pinhole(1920, 1080, 1000, 1000, 960, 540, (-0.1, 0.02, 0.001, 0.001, 0)),
    "fisheye": Fisheye(1000, 1000, 300, 300, 500, 500, (0.01, 0, 0, 0)),
    "panorama": Panorama(2048, 1024),
    "cylinder": Cylinder(3760, 480, 210.7, 481),
    "tsai": pinhole(1920, 1080, 1.2),
}


def surface(feet: Array, height: float, width: float) -> Array:
    """Many points of the upright cylinder, (n, 3) m."""
    angle, z = (a.ravel() for a in np.meshgrid(np.linspace(0, 2 * np.pi, 720), np.linspace(0, height, 50)))
    return np.asarray(feet + np.column_stack([width / 2 * np.cos(angle), width / 2 * np.sin(angle), z]))


@pytest.mark.parametrize("name", CAMERAS)
def test_a_box_is_tight_around_the_body(name: str) -> None:
    camera = CAMERAS[name]
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 1.0])) if camera.wraps else LOOKING_DOWN
    feet = np.array([[7.0, 1.5, 0.0], [9.0, -1.0, 0.0]])
    boxes = body_boxes(camera, pose, feet)
    assert len(boxes) == 2
    for foot, (left, top, width, height) in zip(feet, boxes, strict=True):
        rays = pose.inverse().apply(surface(foot, 1.75, 0.5))
        pixels = camera.pixels_from_bearings(rays / np.linalg.norm(rays, axis=1, keepdims=True))[0]
        size = pixels.max(axis=0) - pixels.min(axis=0)
        assert_allclose([left, top], pixels.min(axis=0), atol=0.02 * size.max())
        assert_allclose([width, height], size, atol=0.02 * size.max())


@pytest.mark.parametrize("name", ["panorama", "cylinder"])
def test_a_body_over_the_seam_has_one_box(name: str) -> None:
    """The same body ahead and behind: the box is shifted by half the image."""
    camera, pose = CAMERAS[name], Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))
    ahead, behind = body_boxes(camera, pose, np.array([[5.0, 0.1, 0.0], [-5.0, -0.1, 0.0]]))
    assert_allclose(behind[1:], ahead[1:], atol=1e-9)
    assert_allclose((behind[0] - ahead[0]) % camera.width, camera.width / 2)
    assert behind[0] < camera.width < behind[0] + behind[2]


def test_a_box_ends_at_the_image_and_slivers_have_none() -> None:
    """A camera that looks level from 1 m sees no feet nearer than 1 / tan(half the field)."""
    camera, pose = pinhole(400, 400, np.pi / 2), Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))
    near, far = body_boxes(camera, pose, np.array([[0.9, 0.0, 0.0], [5.0, 0.0, 0.0]]), body=(1.75, 0.2))
    assert_allclose(near[1] + near[3], 399.5)
    assert far[1] + far[3] < 399
    # Behind the camera, beside the image, and with less than a quarter of the box in it.
    assert len(body_boxes(camera, pose, np.array([[-5.0, 0.0, 0.0], [5.0, 9.0, 0.0], [5.0, 5.2, 0.0]]))) == 0


def crowd(frames: int = 40) -> Recording:
    rng = np.random.default_rng(1)
    truth = {k: (np.arange(30), np.column_stack([rng.uniform([6, -3], [14, 3], (30, 2)), np.zeros(30)])) for k in range(frames)}
    cameras = {"A": RecordingCamera(CAMERAS["pinhole"], LOOKING_DOWN), "B": RecordingCamera(CAMERAS["tsai"], LOOKING_DOWN)}
    return Recording(2.0, cameras, truth=truth)


def test_misses_and_edges_are_as_asked_and_repeatable() -> None:
    recording = crowd()
    exact, noisy = projected_boxes(recording), projected_boxes(recording, BoxNoise(0.2, 0.0), seed=3)
    for name in recording.cameras:
        count = [sum(len(boxes) for boxes, _ in one.detections[name].values()) for one in (exact, noisy)]
        assert abs(count[1] / count[0] - 0.8) < 4 * np.sqrt(0.2 * 0.8 / count[0])
    moved = projected_boxes(recording, BoxNoise(0.0, 0.02), seed=3)
    for name in recording.cameras:
        errors = []
        for frame, (boxes, _) in exact.detections[name].items():
            other = moved.detections[name][frame][0]
            inside = (boxes[:, 0] > 40) & (boxes[:, 0] + boxes[:, 2] < 1880) & (boxes[:, 1] > 40) & (boxes[:, 1] + boxes[:, 3] < 1040)
            low, high = other[:, :2] - boxes[:, :2], other[:, :2] + other[:, 2:] - boxes[:, :2] - boxes[:, 2:]
            errors.append(np.concatenate([low / boxes[:, 2:], high / boxes[:, 2:]], axis=1)[inside])
        spread = np.concatenate(errors)
        assert_allclose(spread.std(axis=0), 0.02, rtol=0.1)
        assert np.abs(np.corrcoef(spread.T) - np.eye(4)).max() < 0.1
    again = projected_boxes(recording, BoxNoise(0.0, 0.02), seed=3)
    for name in recording.cameras:
        for frame, (boxes, _) in moved.detections[name].items():
            assert_array_equal(again.detections[name][frame][0], boxes)
    assert moved.source["projected_boxes"] == {"height": 1.75, "width": 0.5, "misses": 0.0, "edges": 0.02, "seed": 3}


def test_a_camera_has_the_same_boxes_beside_others_and_alone() -> None:
    noise = BoxNoise(0.3, 0.05)
    both, alone = projected_boxes(crowd(), noise), projected_boxes(crowd().choose(["B"]), noise)
    for frame, (boxes, _) in alone.detections["B"].items():
        assert_array_equal(both.detections["B"][frame][0], boxes)


def test_a_camera_on_a_robot_moves_with_its_true_pose() -> None:
    feet = np.array([[8.0, 1.0, 0.0]])
    truth = {k: (np.array([1]), feet) for k in range(3)}
    poses = {0: Pose.planar(0.0, 0.0, 0.0), 2: Pose.planar(3.0, 0.5, 0.2)}
    on_robot = RecordingCamera(CAMERAS["pinhole"], LOOKING_DOWN, "r0")
    found = projected_boxes(Recording(2.0, {"A": on_robot}, truth=truth, robots={"r0": RecordingRobot(None, truth=poses)})).detections["A"]
    for frame, pose in poses.items():
        assert_allclose(found[frame][0], body_boxes(CAMERAS["pinhole"], pose @ LOOKING_DOWN, feet))
    assert found[2][0][0, 3] > 1.3 * found[0][0][0, 3]
    assert len(found[1][0]) == 0


def test_bounds_and_missing_truth() -> None:
    with pytest.raises(ValueError, match=r"misses is 1\.5, needs 0 to 1"):
        BoxNoise(misses=1.5)
    with pytest.raises(ValueError, match="has no truth, which projected boxes need"):
        projected_boxes(Recording(2.0, crowd().cameras))
