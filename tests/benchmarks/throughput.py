"""Speed of the SLAM filter of the team against the numbers of landmarks and robots, without SIFT; and the speed of SIFT.

The table shows processor time per frame, ms. Each robot sees 30 landmarks per frame, identified by descriptors. The whole map is present from the
start, in one joint covariance.
"""

from __future__ import annotations

import time
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tracker.ekf.odometry_biases import BiasModel
from tracker.geometry import Pose, perturbed_bearings
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.pipeline import Parameters
from tracker.slam.features import FeatureParameters, extract
from tracker.slam.filter import Slam
from tracker.types import Detections, Mount, Odometry, Setup, Sightings, Start, Tick, View

Array = NDArray[np.float64]

LANDMARKS = (50, 100, 200, 500, 1000, 2000)
ROBOTS = (1, 2, 4, 8)
SEEN, DIMENSIONS, FRAMES = 30, 128, 5
SIGMA, PLACED = 0.002, 0.03
"""Standard deviations of a bearing, rad, and of a landmark, m."""
BIASES = BiasModel()
STEP = Pose(np.eye(3), np.array([0.1, 0.0, 0.0]))
NOISE = np.diag([0.01, 0.005, 0.005, 0.002, 0.002, 0.004]) ** 2
CAMERA = Panorama(1024, 512)


def per_frame(landmarks: int, robots: int) -> float:
    """Median time of a frame, ms. Odometry has the biases that the filter models."""
    rng = np.random.default_rng([landmarks, robots])
    points = np.stack([*rng.uniform(-20, 20, (2, landmarks)), rng.uniform(0.3, 3.0, landmarks)], axis=1)
    descriptors = rng.normal(size=(landmarks, DIMENSIONS)).astype(np.float32)
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    poses = [Pose.planar(3 * np.cos(a), 3 * np.sin(a), a, 0.3) for a in 2 * np.pi * np.arange(robots) / robots]
    mounts = {f"c{i}": Mount(CAMERA, Pose.identity(), f"r{i}") for i in range(robots)}
    setup = Setup(mounts, Flat(0.0), {f"r{i}": Start(pose, NOISE) for i, pose in enumerate(poses)}, 0.2)
    slam = Slam(setup, replace(Parameters().slam, capacity=landmarks + 16))
    odometry_bias = BIASES.sigma_ratios[:6] * rng.normal(size=(robots, 6))
    spent, given = [], 0
    for k in range(FRAMES + 1):
        poses = [pose @ STEP for pose in poses]
        # The first frame initializes the robots; the map is added after it.
        seen = rng.choice(landmarks, (robots, SEEN)) if k else np.zeros((robots, 0), dtype=np.int64)
        error = np.sqrt(np.diag(NOISE)) * (odometry_bias + np.sqrt(BIASES.white_shares[:6]) * rng.normal(size=(robots, 6)))
        shown = [np.unique(row) for row in seen]
        views = tuple(_view(f"c{i}", pose, points[shown[i]], descriptors[shown[i]], error[i], rng) for i, pose in enumerate(poses))
        tick = Tick(k, 0.2 * k, views)
        given += sum(len(v.sightings) for v in views if v.sightings is not None)
        began = time.process_time()
        slam.step(tick)
        spent.append(1000 * (time.process_time() - began))
        if k == 0:
            state, landmark_map = slam.state
            for n, point in enumerate(points):
                state.add_landmark(point + PLACED * rng.normal(size=3), np.zeros(0, dtype=np.intp), np.zeros((3, 0)), np.eye(3) * PLACED**2)
                landmark_map.add(-1, descriptors[n], n % robots, 0, 10)
    assert len(slam.landmarks()) >= landmarks
    assert slam.counters["matched"] + slam.counters.get("on a robot", 0) > 0.9 * given
    return float(np.median(spent[1:]))


def _view(camera: str, pose: Pose, points: Array, descriptors: NDArray[np.float32], error: Array, rng: np.random.Generator) -> View:
    bearing, n = pose.inverse().apply(points), len(points)
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    bearing = perturbed_bearings(bearing, SIGMA * rng.normal(size=(n, 2)))
    descriptor = descriptors + np.float32(0.2 / np.sqrt(DIMENSIONS)) * rng.normal(size=descriptors.shape).astype(np.float32)
    seen = Sightings(bearing, np.full(n, np.nan), np.full(n, -1), descriptor, np.tile(np.eye(2) * SIGMA**2, (n, 1, 1)))
    return View(camera, Detections.none(), seen, Odometry(STEP @ Pose.exp(error), NOISE, pose.rotation[2], 0.02))


def sift_time() -> tuple[float, int]:
    """Median time to extract features from a panorama, ms, and their number. The panorama is noise at all scales."""
    rng, picture = np.random.default_rng(0), np.zeros((CAMERA.height, CAMERA.width))
    for scale in (1, 2, 4, 8, 16, 32):
        coarse = rng.normal(size=(CAMERA.height // scale, CAMERA.width // scale))
        picture += cv2.resize(coarse, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_CUBIC)
    grey = np.clip(128 + 20 * picture, 0, 255).astype(np.uint8)
    image, spent = np.repeat(grey[:, :, None], 3, axis=2), []
    for _ in range(FRAMES + 1):
        began = time.process_time()
        found = extract(image, CAMERA, np.array([0.0, 0.0, 1.0]), Detections.none(), FeatureParameters()).sightings()
        spent.append(1000 * (time.process_time() - began))
    return float(np.median(spent[1:])), len(found)


def main() -> None:
    per_frame(50, 2)
    print(f"ms per frame of the whole team, {SEEN} sightings per robot\n")
    print("| landmarks | " + " | ".join(f"{r} robot{'s' * (r > 1)}" for r in ROBOTS) + " |")
    print("|---" * (len(ROBOTS) + 1) + "|")
    for landmarks in LANDMARKS:
        print(f"| {landmarks} | " + " | ".join(f"{per_frame(landmarks, robots):.1f}" for robots in ROBOTS) + " |", flush=True)
    spent, found = sift_time()
    print(f"\nSIFT of a panorama {CAMERA.width} × {CAMERA.height}: {spent:.0f} ms, {found} features")


if __name__ == "__main__":
    main()
