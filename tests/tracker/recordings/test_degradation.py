"""Projected and degraded boxes: amount, reproducibility, and plausible false boxes."""

import numpy as np
import pytest

from tracker.geometry import Pose
from tracker.geometry.cameras import Pinhole, pinhole
from tracker.geometry.ground import Flat
from tracker.geometry.image_boxes import body_boxes
from tracker.recordings import FrameBoxes, Recording, RecordingCamera, RecordingRobot
from tracker.recordings.degradation import HEIGHTS, BoxNoise, Degradation, projected_boxes

FRAMES = 400
AREA = np.array([[3.0, -2.0], [9.0, 2.0]])
PINHOLE = Pinhole(1920, 1080, 1000, 1000, 960, 540, (-0.1, 0.02, 0.001, 0.001, 0))
LOOKING_DOWN = Pose(Pose.exp([0, 0, 0, 0, 0.3, 0]).rotation, np.array([0.0, 0.0, 2.5]))
"""A camera 2.5 m above the ground that looks along x and 0.3 rad down."""
VIEW = (pinhole(640, 480, np.radians(90)), Pose.planar(0.0, 0.0, 0.0, 1.5))


def boxes() -> FrameBoxes:
    rng = np.random.default_rng(0)
    return {k: (rng.uniform(20, 200, (5, 4)), rng.uniform(0.6, 1, 5)) for k in range(FRAMES)}


def worse(degradation: Degradation, seed: int = 1) -> FrameBoxes:
    return degradation.apply(boxes(), range(FRAMES), VIEW, (AREA, Flat()), np.random.default_rng(seed))


def test_boxes_are_dropped_and_moved() -> None:
    kept = sum(len(b) for b, _ in worse(Degradation(drop=0.3)).values())
    assert abs(kept / (5 * FRAMES) - 0.7) < 4 * np.sqrt(0.21 / (5 * FRAMES))
    moved = np.concatenate([b - a for (a, _), (b, _) in zip(boxes().values(), worse(Degradation(noise=3.0)).values(), strict=True)])
    assert np.all(moved[:, 2:] == 0)
    np.testing.assert_allclose(moved[:, :2].std(axis=0), 3.0, rtol=0.08)


def test_false_boxes_have_feet_in_the_area() -> None:
    camera, pose = VIEW
    for box, confidence in worse(Degradation(drop=1.0, clutter=2)).values():
        assert len(box) == len(confidence) == 2
        foot = np.stack([box[:, 0] + box[:, 2] / 2, box[:, 1] + box[:, 3]], axis=1)
        sight = camera.bearings_from_pixels(foot) @ pose.rotation.T
        point, hit = Flat().intersect(np.tile(pose.translation, (2, 1)), sight, 50.0)
        assert hit.all()
        assert np.all((point[:, :2] > AREA[0] - 1e-6) & (point[:, :2] < AREA[1] + 1e-6))
        head = camera.bearings_from_pixels(np.stack([foot[:, 0], box[:, 1]], axis=1)) @ pose.rotation.T
        height = pose.translation[2] + np.hypot(*point[:, :2].T) * head[:, 2] / np.hypot(head[:, 0], head[:, 1])
        assert np.all((height > HEIGHTS[0] - 1e-6) & (height < HEIGHTS[1] + 1e-6))
        assert np.all(confidence >= 0.6)


def test_same_seed_gives_same_boxes() -> None:
    asked = Degradation(0.2, 1, 1.0)
    same = zip(worse(asked).values(), worse(asked).values(), strict=True)
    assert all(np.array_equal(a, b) for (a, _), (b, _) in same)
    assert not all(np.array_equal(a, b) for (a, _), (b, _) in zip(worse(asked).values(), worse(asked, 2).values(), strict=True))


def test_round_trip() -> None:
    assert Degradation.parse("drop=0.3, clutter=2") == Degradation(0.3, 2)
    assert Degradation.parse("") == Degradation()
    for text, message in (("drop=x", "needs a number"), ("clutter=1.5", "whole number"), ("fog=1", "needs drop=…"), ("drop=2", "drop is 2.0")):
        with pytest.raises(ValueError, match=message):
            Degradation.parse(text)


def crowd(frames: int = 40) -> Recording:
    rng = np.random.default_rng(1)
    truth = {k: (np.arange(30), np.column_stack([rng.uniform([6, -3], [14, 3], (30, 2)), np.zeros(30)])) for k in range(frames)}
    cameras = {"A": RecordingCamera(PINHOLE, LOOKING_DOWN), "B": RecordingCamera(pinhole(1920, 1080, 1.2), LOOKING_DOWN)}
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
        np.testing.assert_allclose(spread.std(axis=0), 0.02, rtol=0.1)
        assert np.abs(np.corrcoef(spread.T) - np.eye(4)).max() < 0.1
    again = projected_boxes(recording, BoxNoise(0.0, 0.02), seed=3)
    for name in recording.cameras:
        for frame, (boxes, _) in moved.detections[name].items():
            np.testing.assert_array_equal(again.detections[name][frame][0], boxes)
    assert moved.source["projected_boxes"] == {"height": 1.75, "width": 0.5, "misses": 0.0, "edges": 0.02, "seed": 3}


def test_a_camera_has_the_same_boxes_beside_others_and_alone() -> None:
    noise = BoxNoise(0.3, 0.05)
    both, alone = projected_boxes(crowd(), noise), projected_boxes(crowd().choose(["B"]), noise)
    for frame, (boxes, _) in alone.detections["B"].items():
        np.testing.assert_array_equal(both.detections["B"][frame][0], boxes)


def test_a_camera_on_a_robot_moves_with_its_true_pose() -> None:
    feet = np.array([[8.0, 1.0, 0.0]])
    truth = {k: (np.array([1]), feet) for k in range(3)}
    poses = {0: Pose.planar(0.0, 0.0, 0.0), 2: Pose.planar(3.0, 0.5, 0.2)}
    on_robot = RecordingCamera(PINHOLE, LOOKING_DOWN, "r0")
    found = projected_boxes(Recording(2.0, {"A": on_robot}, truth=truth, robots={"r0": RecordingRobot(None, truth=poses)})).detections["A"]
    for frame, pose in poses.items():
        np.testing.assert_allclose(found[frame][0], body_boxes(PINHOLE, pose @ LOOKING_DOWN, feet))
    assert found[2][0][0, 3] > 1.3 * found[0][0][0, 3]
    assert len(found[1][0]) == 0
