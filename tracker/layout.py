"""The layout of a Sequence on disk: columns of its tables, schema version, and the README that lies in every one."""

from __future__ import annotations

SCHEMA = 1
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
UPPER = [(i, j) for i in range(6) for j in range(i, 6)]
ODOMETRY = {"frame": int, "robot": str, **dict.fromkeys(POSE, float), "up_x": float, "up_y": float, "up_z": float, "up_sigma": float} | {
    f"c{i}{j}": float for i, j in UPPER
}
DETECTIONS = {"frame": int, "camera": str} | dict.fromkeys(
    ["bearing_x", "bearing_y", "bearing_z", "width", "height", "confidence", "c00", "c01", "c11"], float
)
ROBOTS = {"frame": int, "robot": str, **dict.fromkeys(POSE, float)}
BOXES = {"frame": int, "camera": str, "person": int} | dict.fromkeys(
    ["left", "top", "right", "bottom", "full_left", "full_top", "full_right", "full_bottom", "visible"], float
)

NEEDED = (
    "README.md",
    "calibration.json",
    "detections.csv",
    "odometry.csv",
    "scenario.json",
    "terrain.npz",
    "truth/boxes.csv",
    "truth/people.csv",
    "truth/robots.csv",
)

README = """# A sequence made by pilsim

World: right-handed, z up, metres, seconds, radians; the origin is the world's own. Bodies and cameras: x forward, y left, z up.
Frames count from 0; time = frame · period. Pixels: u to the right, v down, the first pixel's centre at (0.5, 0.5).
Panorama of width W and height H = W/2: azimuth = π − 2πu/W, elevation = π/2 − πv/H; ahead is the middle, the seam is behind.
Quaternions are wxyz. Poses are T_world_robot unless it says otherwise: x, y, z [m], qw, qx, qy, qz.

* `manifest.json`: schema version, versions of the programs, SHA-256 and size of every other file.
* `scenario.json`: all that made this sequence; `calibration.json`: period [s], cameras and where they sit on the robots
  (T_body_camera), where the robots start (pose and covariance 6×6 of the right tangent [translation m, rotation rad]),
  the band of people's heights [m].
* `terrain.npz`: `heights` (rows, columns) m, row 0 at the lowest y, `origin` x, y of heights[0, 0], `spacing` m; between grid points two
  triangles a cell, split along (i, j)→(i+1, j+1). `tops`: the same grid with walls and furniture on it.
* `odometry.csv`: motion of a robot's body since the frame before (T_before_now), covariance c00…c55 (upper triangle, right tangent),
  up_x, up_y, up_z: up in the body's frame by the accelerometer, up_sigma its error [rad].
* `detections.csv`: what the detector reports: bearing of the box's middle in the camera's frame (unit), its spans of azimuth (width) and
  elevation (height) [rad], confidence, covariance of an edge [rad²] along azimuth and elevation.
* `truth/robots.csv`: poses of the robots' bodies. `truth/people.csv`: x, y, z [m] of the ground under the middle of the body and the
  visible fraction in each camera (pixels seen / pixels the body would cover alone). `truth/boxes.csv`: box [pixel] of what is seen (left, top, right,
  bottom) and of the whole body (full_…); right may pass W where a box lies over the seam.
* `images/CAMERA/FRAME.jpg`: RGB. `instances/CAMERA/FRAME.png`: 16 bit, 0 nobody, else the person's id.
"""
