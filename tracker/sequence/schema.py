"""The layout of a sequence on disk: columns of its tables, schema version, and the text of its README."""

from __future__ import annotations

from collections.abc import Iterable

from tracker.types import KEYPOINT_NAMES

SCHEMA = 3

READABLE_SCHEMAS = (2, 3)
"""Versions that can be read. Version 3 adds optional files: companions.csv, lossless images, range, classes, videos and a mesh."""

LAYERS = ("images", "instances", "range", "classes", "videos")
"""Folders of large files that are read one by one."""

POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]

UPPER_TRIANGLE = [(i, j) for i in range(6) for j in range(i, 6)]

ODOMETRY = {"frame": int, "robot": str, **dict.fromkeys(POSE, float), "up_x": float, "up_y": float, "up_z": float, "up_sigma": float} | {
    f"c{i}{j}": float for i, j in UPPER_TRIANGLE
}

DETECTIONS = {"frame": int, "camera": str} | dict.fromkeys(
    ["bearing_x", "bearing_y", "bearing_z", "width", "height", "confidence", "c00", "c01", "c11"], float
)

ROBOT_DETECTIONS = {"frame": int, "camera": str, "robot": str} | dict.fromkeys(["bearing_x", "bearing_y", "bearing_z", "c00", "c01", "c11"], float)
"""Columns of companions.csv, which is optional."""

ROBOTS: dict[str, type] = {"frame": int, "robot": str, **dict.fromkeys(POSE, float), "tipped": int}

BOXES: dict[str, type] = {"frame": int, "camera": str, "person": int} | dict.fromkeys(
    ["left", "top", "right", "bottom", "full_left", "full_top", "full_right", "full_bottom", "visible", "range"], float
)

CAMERAS: dict[str, type] = {"frame": int, "camera": str, **dict.fromkeys([*POSE, "ground", "normal_x", "normal_y", "normal_z"], float)}

KEYPOINTS: dict[str, type] = {"frame": int, "camera": str, "person": int} | {
    f"{name}_{axis}": float if axis != "visibility" else int for name in KEYPOINT_NAMES for axis in ("u", "v", "visibility")
}

JOINTS: dict[str, type] = {"frame": int, "person": int} | {f"{name}_{axis}": float for name in KEYPOINT_NAMES for axis in "xyz"}


_GYRO, _FORCE = [f"gyro_{axis}" for axis in "xyz"], [f"force_{axis}" for axis in "xyz"]

IMU: dict[str, type] = {"robot": str} | dict.fromkeys(["time", "stamp", *_GYRO, *_FORCE], float)
"""Columns of imu.csv, which is optional, as are the following tables."""

INERTIAL: dict[str, type] = {"robot": str} | dict.fromkeys(
    ["time", *_GYRO, *_FORCE, *(f"{name[:-1]}bias_{name[-1]}" for name in (*_GYRO, *_FORCE))], float
)
"""Columns of truth/inertial.csv: the samples of imu.csv without errors, and their biases."""

WHEEL_NAMES = ("front_left", "front_right", "rear_left", "rear_right")
WHEELS: dict[str, type] = {"robot": str} | dict.fromkeys(["time", "stamp", *WHEEL_NAMES], float)

STAMPS: dict[str, type] = {"frame": int, "clock": str, "time": float, "stamp": float}

CLOCKS: dict[str, type] = {"clock": str, "offset": float, "drift": float, "jitter": float}


EFFECTS: dict[str, type] = {"camera": str, "effect": str} | dict.fromkeys(["value", "u", "v", "radius"], float)
"""Columns of truth/effects.csv, which is optional."""

ROWS: dict[str, type] = {"frame": int, "camera": str, "first": int, "end": int} | dict.fromkeys(["time", *POSE], float)
"""Columns of truth/rows.csv, which is optional."""


SITS = "sits"
"""The last column of truth/people.csv, which is optional: 1 for a person who sits, else 0."""


def people_columns(cameras: Iterable[str], sits: bool = False) -> dict[str, type]:
    """Columns of truth/people.csv, with one for each camera. sits: whether the table says who sits."""
    own = {"frame": int, "person": int, "x": float, "y": float, "z": float} | {f"visible_{camera}": float for camera in cameras}
    return own | ({SITS: int} if sits else {})


REQUIRED_FILES = (
    "README.md",
    "calibration.json",
    "detections.csv",
    "odometry.csv",
    "scenario.json",
    "terrain.npz",
    "truth/boxes.csv",
    "truth/cameras.csv",
    "truth/joints.csv",
    "truth/keypoints.csv",
    "truth/people.csv",
    "truth/robots.csv",
)

README = """# A sequence made by pilsim

World: right-handed, z up, metres, seconds, radians; the origin is the world's own. Bodies and cameras: x forward, y left, z up.
Frames count from 0; time = frame · period. Pixels: u to the right, v down, counted from the image's corner: the first pixel's centre is (0.5, 0.5).
Panorama of width W and height H = W/2: azimuth = π − 2πu/W, elevation = π/2 − πv/H; ahead is the middle, the seam is behind.
Tsai's model (fixed cameras, PETS 2009) has the first pixel's centre at (0, 0) by its calibration: add 0.5 to what its formulas give.
Quaternions are wxyz. Poses are T_world_robot unless it says otherwise: x, y, z [m], qw, qx, qy, qz.

* `manifest.json`: schema version, versions of the programs, SHA-256 and size of every other file.
* `scenario.json`: all that made this sequence; `calibration.json`: period [s], cameras (panorama, or tsai with the parameters of its file) and
  where they sit on the robots (T_body_camera), where the robots start (pose and covariance 6×6 of the right tangent [translation m, rotation rad]),
  the band of people's heights [m]. A fixed camera is a robot that never moves: it has no rows in odometry.csv.
* `calibration/CAMERA.xml`: every fixed camera as PETS 2009 has it (Tsai; mm, radians; world to camera R = Rz Ry Rx, then t).
* `terrain.npz`: `heights` (rows, columns) m, row 0 at the lowest y, `origin` x, y of heights[0, 0], `spacing` m; between grid points two
  triangles a cell, split along (i, j)→(i+1, j+1). `tops`: the same grid with walls and furniture on it.
* `odometry.csv`: motion of a robot's body since the frame before (T_before_now), covariance c00…c55 (upper triangle, right tangent),
  up_x, up_y, up_z: up in the body's frame by the accelerometer, up_sigma its error [rad].
* `detections.csv`: what the detector reports: bearing of the box's middle in the camera's frame (unit), its spans of azimuth (width) and
  elevation (height) [rad], confidence, covariance of an edge [rad²] along azimuth and elevation.
* `companions.csv`: other robots that a robot's camera sees: bearing of the middle of the seen robot's camera in the frame of the camera that sees it
  (unit), covariance [rad²] along azimuth and elevation. Not there in sequences of older versions.
* `truth/robots.csv`: poses of the robots' bodies; tipped is 1 where a robot has tipped over, else 0.
* `truth/cameras.csv`: poses of the cameras (T_world_camera), ground [m]: the height of the terrain straight below, normal_x, normal_y, normal_z:
  its unit normal there.
* `truth/people.csv`: x, y, z [m] of the ground under the middle of the body and the visible fraction in each camera (pixels seen / pixels the body
  would cover alone). `truth/joints.csv`: the 17 key points of COCO in the world [m], to 0.1 mm; they lie inside the body.
* `truth/boxes.csv`: box [pixel] of what is seen (left, top, right, bottom; zeros where nothing is) and of the whole body (full_…); right may pass W
  where a box lies over the seam of a panorama; other cameras' boxes end at the image's edge. visible: fraction as above; range [m] from
  the camera to the middle between the hips. Who covers no pixel of a view, occluded or not, has no row in it.
* `truth/keypoints.csv`: the key points in the image, u and v [pixel] to 0.01, and visibility as COCO has it: 2 visible, 1 hidden by something
  or by the own body (by the instances and the range at that pixel), 0 not in the image (u = v = 0). The same people as in boxes.csv.
* `images/CAMERA/FRAME.jpg`, or `.png` where images without loss were asked for: RGB, 8 bit; FRAME has six digits and counts from 0.
* `instances/CAMERA/FRAME.png`: 16 bit, one channel; 0 nobody, else the person's id, which counts from 1 and is that of all tables.

Only where they were asked for:

* `range/CAMERA/FRAME.png`: 16 bit, one channel; distance from the camera along the ray of the pixel in units of 1/256 m; 0 where nothing is, or
  where it is 256 m away or more.
* `classes/CAMERA/FRAME.png`: 8 bit, one channel; the class of what is seen: its place, from 0, in the list `classes` of
  scenario.json; 0 (sky) where nothing is.
* `videos/CAMERA.mp4`: the images as MPEG-4, at the frame rate of the sequence; for looking at, they have lost more than the JPEG.
* `terrain.glb`: the place without people and robots, as triangles with textures (glTF 2.0: metres, y up: x, y, z here are x, -z, y of the world).
* `TABLE.npz` beside a large TABLE.csv: the same rows, an array a column, numbers in full (int64, float64) where the CSV has 9 digits.
"""

SITTING_README = """
Only where people sit: the last column `sits` of `truth/people.csv` is 1 for a person who sits, else 0. Boxes, key points and joints are those of the
sitting body; x, y, z is the ground under the hips.
"""

SENSORS_README = """
The robots' own sensors, only where they were asked for:

* `sensors.json`: `imu` has the part, its rate [Hz], where it sits (T_body_imu), gravity [m/s²] in the world, and the errors of its kind: densities
  of white noise (gyro_noise [rad/s/√Hz], force_noise [m/s²/√Hz]) and of the bias's random walk (gyro_walk [rad/s²/√Hz], force_walk [m/s³/√Hz]),
  and one sigma of the bias at switching on. A sample's noise has standard deviation density·√rate; a step of the bias has walk/√rate. `wheels` has
  the rate [Hz], names, radius [m], positions in the body's frame [m], and the encoder's counts a turn.
* `imu.csv`: angular velocity gyro [rad/s] and specific force [m/s²] (about +9.81 along up at rest) in the robot's body frame. A sample is the mean
  over the physics steps since the sample before; time [s] is the true time at its end, stamp [s] the same on the robot's clock.
* `wheels.csv`: total angle of each wheel [rad], in whole counts of its encoder, at time [s]; stamp [s] is that time on the robot's clock.
* `stamps.csv`: time [s] of each frame, and stamp [s] by the clock of each camera (of its image) and of each robot (of its odometry).
* `truth/inertial.csv`: the samples of imu.csv without errors, and the biases that are in them. imu.csv is their sum and white noise.
* `truth/clocks.csv`: offset [s], drift [ppm] and jitter [s, one sigma] of each clock: stamp = time·(1 + drift·1e-6) + offset + jitter·normal.
  Without this table every stamp is the true time.
"""

EFFECTS_README = """
Errors of the cameras, only where they were asked for; `scenario.json` has their text (`effects`), each with a number in the unit below:

* `truth/effects.csv`: what was done to the images of each lens: readout [s], shutter [s], subframes, chromatic [px], defocus [px], vignette [stops],
  seam [stops of this lens], gain [dB], halos, jpeg [quality], mount_angle [degrees], mount_shift [m]; a row for each speck (dust) and each drop:
  value is its opacity, u, v [pixel] its middle and radius [pixel]. u, v and radius are 0 elsewhere.
* `truth/rows.csv`: rolling shutter and motion blur: rows first to end - 1 of a lens, the time [s] of the middle of their exposure, and the camera's
  pose at that time. The time of a frame is the end of the exposure of its last row. Instances, range, classes and boxes of a row are those at its
  own time; `truth/cameras.csv`, `robots.csv`, `people.csv`, `joints.csv` and `keypoints.csv` are those at the time of the frame.
* `truth/calibration.json`: where the cameras really are, where `calibration.json` was made wrong (mount_angle, mount_shift).
* Of a camera with two lenses, CAMERA_front and CAMERA_back are the lenses, and CAMERA is the panorama stitched of them. A pixel of it has the
  instance, class and range of the lens with the larger share of it; range is along the ray of that lens.
"""

ROBOTS_README = """
Only where robots of your own drive:

* `own_body` of a camera in `calibration.json`: rows of 0 and 1 over all directions, as in a panorama; 1 where it sees the robot that carries it.
* `T_body_imu_of_robots` in `sensors.json`, entry `imu`: where the IMU of each robot sits; its samples are along the IMU's axes. It holds in place of
  `T_body_imu`.
"""

PLACE_FILE = "place.toml"
"""The choices for a place of a user's file, in a sequence in it."""
PLACE_README = """
* `place.toml`: the file that the place was made of, with its SHA-256, and all choices for it; its first lines say what was read, guessed or left out.
"""
