"""Export to MCAP with ROS 2 messages: images, calibrations, detections, odometry, transforms, true poses, people and terrain."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from tracker.formats.camera_parameters import OPTICAL, PANORAMAS, camera_notes
from tracker.formats.exported_sequence import RecordedSequence, ltwh_from_edges
from tracker.formats.ros.bag import BagWriter, Topic
from tracker.formats.ros.markers import boxes_marker, people_markers, person_color, terrain_marker
from tracker.formats.ros.messages import (
    Message,
    camera_info,
    composed_covariance,
    compressed_image,
    detections_message,
    direction_messages,
    fixed_axes,
    header,
    imu_message,
    map_message,
    odometry_message,
    pose_message,
    robots_message,
    start_message,
    transform,
    up_message,
    wheels_message,
)
from tracker.geometry import Array, Pose
from tracker.geometry.ground import Grid
from tracker.sequence.schema import WHEEL_NAMES
from tracker.types import Detections, Odometry

WORLD = "world"
IMAGE_MARKER = "visualization_msgs/ImageMarker"
ROUNDING = 500
"""ns: times of samples in the tables are rounded by less."""
README = f"""
    SEQUENCE/SEQUENCE.mcap   a bag of ROS 2 (CDR, chunks of zstd, index, statistics) with the definitions of all messages
    SEQUENCE/metadata.yaml   makes the folder a bag of rosbag2

Open the .mcap in Foxglove, or play it: `ros2 bag play SEQUENCE --clock`. `mcap info SEQUENCE.mcap` lists the topics. vision_msgs must be installed
for `ros2 bag play` to offer the boxes. Ten lines of Python read it (pip install mcap-ros2-support):

    from mcap_ros2.reader import read_ros2_messages
    for message in read_ros2_messages("SEQUENCE.mcap"):
        print(message.channel.topic, message.log_time_ns, message.ros_msg.header if hasattr(message.ros_msg, "header") else "")

| topic | type | content |
|---|---|---|
| /tf | tf2_msgs/TFMessage | true poses: world → ROBOT/base_link, of robots that move |
| /tf_static | tf2_msgs/TFMessage | ROBOT/base_link → CAMERA/camera → CAMERA/optical; world → base_link of fixed cameras; world → ROBOT/odom |
| /CAMERA/image/compressed | sensor_msgs/CompressedImage | the sequence's own JPEG or PNG, in CAMERA/optical |
| /CAMERA/camera_info | sensor_msgs/CameraInfo | calibration, with each image |
| /CAMERA/detections | vision_msgs/Detection2DArray | boxes [px] of the detector, score: its confidence |
| /CAMERA/robots | vision_msgs/Detection2DArray | other robots that it sees, as points [px] without a size; id: the robot |
| /CAMERA/truth/detections | vision_msgs/Detection2DArray | boxes [px] of what is seen, id: the person's, score: visible share of the body |
| /CAMERA/detections/markers, /CAMERA/truth/detections/markers | visualization_msgs/ImageMarker | the same boxes as lines on the image |
| /ROBOT/odom | nav_msgs/Odometry | odometry from the start: ROBOT/odom → ROBOT/base_link as the robot believes |
| /ROBOT/initialpose | geometry_msgs/PoseWithCovarianceStamped | the start that is known; once, latched |
| /ROBOT/up | sensor_msgs/Imu | up as the robot knows it, as specific force at rest [m/s²], along the body's axes, with its variance |
| /ROBOT/imu | sensor_msgs/Imu | angular velocity [rad/s], specific force [m/s²], along the body's axes; where the sequence has imu.csv |
| /ROBOT/wheels | sensor_msgs/JointState | total angle of each wheel [rad]; where the sequence has wheels.csv |
| /ROBOT/truth/odom | nav_msgs/Odometry | true pose in the world, and velocity since the frame before |
| /ROBOT/truth/pose | geometry_msgs/PoseStamped | true pose in the world |
| /truth/people | visualization_msgs/MarkerArray | people as cylinders of 1.75 m by 0.5 m on their feet, and their ids |
| /terrain/map | grid_map_msgs/GridMap | height maps [m]: elevation of the ground, obstacles: the ground with walls and furniture; once, latched |
| /terrain, /obstacles | visualization_msgs/Marker | the ground, and walls and furniture, as triangles; once, latched |

Times [ns] are --epoch (0 where it was not given) · 10⁹ + frame · period, frames from 0; header and log have the same. To tf2 a time of 0 means
"the latest": with --epoch 1 and more the first frame is found like the others. Where the sequence's clocks have errors (generate --clock), headers of
images, calibrations, detections, odometry, IMU and wheels have the times of the clock of their camera or robot, and the log has true times.
world: right-handed, z up, metres. base_link and camera: x forward, y left, z up; optical: x right, y down, z ahead. A transform maps points of the
child to the parent.
Detections and robots: pose is the unit direction of the box's middle along the axes of CAMERA/optical, its covariance that of the direction [rad²].
Boxes: centre and size [px]; the first pixel's centre is (0, 0). In a panorama a box over the seam passes the right edge.
odom: pose.covariance is that of the odometry alone, summed from the start, along and about the axes of ROBOT/odom [m, rad]. Twist: the motion
since the frame before over the period [m/s, rad/s], along the axes of the body before it. ROBOT/odom is the start pose that is known; a robot
without one has no such transform.
CameraInfo: plumb_bob (k1, k2, p1, p2, k3) and equidistant (k1 to k4) as in ROS. K and P are zero for panoramas, which ROS reads as "no pinhole".
They have distortion_model equirectangular or cylindrical and d = fx, fy, cx, cy:
{PANORAMAS}"""


def export_mcap(out: Path, recordings: Iterable[RecordedSequence], epoch: int = 0) -> list[str]:
    """Write a bag for each sequence. Returns notes on missing images and fitted distortions. epoch: time of frame 0, whole seconds.

    Raises ValueError where two robots or two cameras have the same name in ROS.
    """
    notes = []
    for recording in recordings:
        scene = BagScene(recording, epoch)
        with BagWriter(out / recording.name) as bag:
            for topic, message in scene.static():
                bag.write(topic, message, scene.stamps[0])
            for frame in recording.frames():
                for stamp, topic, message in scene.samples(frame):
                    bag.write(topic, message, stamp)
                for topic, message in scene.messages(frame):
                    bag.write(topic, message, scene.stamps[frame])
        notes += camera_notes(recording, recording.cameras, "their topics are left out")
    return notes


@dataclass(frozen=True, eq=False)
class BagScene:
    """A sequence as messages. Names of robots and cameras become names of ROS: letters, digits and underscores."""

    recording: RecordedSequence
    epoch: int

    @cached_property
    def stamps(self) -> list[int]:
        """Time of each frame [ns]."""
        return self.recording.stamps(self.epoch)

    @cached_property
    def robots(self) -> dict[str, str]:
        """Robot → its name in ROS."""
        return ros_names(list(self.recording.setup.starts))

    @cached_property
    def cameras(self) -> dict[str, str]:
        """Camera → its name in ROS."""
        return ros_names(list(self.recording.setup.mounts))

    @cached_property
    def clocks(self) -> dict[str, list[int]]:
        """Camera or robot that moves → time of each frame by its clock [ns]."""
        names = [*self.recording.setup.mounts, *self.recording.setup.moving_robots]
        return {name: self.recording.clock_stamps(name, self.epoch) for name in names}

    @cached_property
    def odometry(self) -> dict[tuple[int, str], Message]:
        """(frame, robot) → Odometry: motions composed from the pose of the robot in frame 0."""
        none = Odometry(Pose.identity(), np.zeros((6, 6)))
        poses = dict.fromkeys(self.recording.setup.moving_robots, (Pose.identity(), np.zeros((6, 6))))
        out = {(0, robot): self._odometry(0, robot, none, *poses[robot]) for robot in poses}
        for (frame, robot), step in self._steps.items():
            pose, covariance = poses[robot]
            poses[robot] = pose @ step.T_before_now, composed_covariance(covariance, step.T_before_now, step.covariance)
            out[frame, robot] = self._odometry(frame, robot, step, *poses[robot])
        return out

    @cached_property
    def _steps(self) -> dict[tuple[int, str], Odometry]:
        """(frame, robot) → the motion of a moving robot since the previous frame."""
        moving = self.recording.setup.moving_robots
        steps = enumerate(self.recording.sequence.ticks.odometry())
        return {(frame, robot): step for frame, of_frame in steps for robot, step in of_frame.items() if robot in moving}

    def _odometry(self, frame: int, robot: str, step: Odometry, pose: Pose, covariance: Array) -> Message:
        period, name = self.recording.setup.period, self.robots[robot]
        where = (self.clocks[robot][frame], f"{name}/odom", f"{name}/base_link")
        spread = fixed_axes(covariance, pose.rotation)
        return odometry_message(pose, spread, step.T_before_now.log() / period, step.covariance / period**2, where)

    def static(self) -> Iterator[tuple[Topic, Message]]:
        """Topics that are written once, before all others."""
        setup, stamp = self.recording.setup, self.stamps[0]
        transforms = []
        for robot, name in self.robots.items():
            start = setup.starts[robot]
            if start is not None:
                child = f"{name}/base_link" if setup.is_fixed(robot) else f"{name}/odom"
                transforms.append(transform(WORLD, child, start.T_world_robot, stamp))
        for camera, name in self.cameras.items():
            mount = setup.mounts[camera]
            transforms.append(transform(f"{self.robots[mount.robot]}/base_link", f"{name}/camera", mount.T_body_camera, stamp))
            transforms.append(transform(f"{name}/camera", f"{name}/optical", OPTICAL, stamp))
        for robot in self.recording.imu:
            name = self.robots[robot]
            transforms.append(transform(f"{name}/base_link", f"{name}/imu", self.recording.imu_noise(robot).T_body_imu, stamp))
        yield Topic("/tf_static", "tf2_msgs/TFMessage", latched=True), {"transforms": transforms}
        for robot in setup.anchored_robots:
            if (start := setup.starts[robot]) is not None:
                message = start_message(start, stamp, WORLD)
                yield Topic(f"/{self.robots[robot]}/initialpose", "geometry_msgs/PoseWithCovarianceStamped", latched=True), message
        if isinstance(setup.ground, Grid):
            layers = {"elevation": setup.ground} | ({"obstacles": setup.occluders} if isinstance(setup.occluders, Grid) else {})
            yield Topic("/terrain/map", "grid_map_msgs/GridMap", latched=True), map_message(layers, stamp, WORLD)
            maps = {"terrain": terrain_marker(setup.ground, "terrain", stamp)}
            if isinstance(setup.occluders, Grid):
                maps["obstacles"] = terrain_marker(setup.occluders, "obstacles", stamp, above=setup.ground)
            for name, marker in maps.items():
                if marker is not None:
                    yield Topic(f"/{name}", "visualization_msgs/Marker", latched=True), marker

    def samples(self, frame: int) -> Iterator[tuple[int, Topic, Message]]:
        """Samples of IMUs and wheel encoders since the frame before, with their true times [ns], in the order of time."""
        for stamp, robot, sensor, row in self._samples.get(frame, []):
            topic, message = self._imu(robot, row) if sensor == "imu" else self._wheels(robot, row)
            yield stamp, topic, message

    @cached_property
    def _samples(self) -> dict[int, list[tuple[int, str, str, int]]]:
        """Frame → true time [ns], robot, sensor and row of its samples. Those after the last frame belong to the last."""
        found: list[tuple[int, str, str, int]] = []
        for sensor in ("imu", "wheels"):
            for robot, samples in getattr(self.recording, sensor).items():
                times = self.recording.nanoseconds(samples.time, self.epoch, robot)
                found += [(time, robot, sensor, row) for row, time in enumerate(times)]
        found.sort(key=lambda sample: sample[0])
        out: dict[int, list[tuple[int, str, str, int]]] = {}
        for sample in found:
            # Times of the tables are rounded to 9 digits: a sample at the time of a frame comes before it.
            frame = min(bisect_left(self.stamps, sample[0] - ROUNDING), len(self.stamps) - 1)
            out.setdefault(frame, []).append(sample)
        return out

    def _imu(self, robot: str, row: int) -> tuple[Topic, Message]:
        samples, noise, name = self.recording.imu[robot], self.recording.imu_noise(robot), self.robots[robot]
        sigma = (noise.gyro_noise * noise.rate**0.5, noise.force_noise * noise.rate**0.5)
        stamp = self._sample_stamps["imu", robot][row]
        return Topic(f"/{name}/imu", "sensor_msgs/Imu"), imu_message(samples.gyro[row], samples.force[row], sigma, stamp, f"{name}/imu")

    def _wheels(self, robot: str, row: int) -> tuple[Topic, Message]:
        name, stamp = self.robots[robot], self._sample_stamps["wheels", robot][row]
        message = wheels_message(WHEEL_NAMES, self.recording.wheels[robot].angle[row], stamp, f"{name}/base_link")
        return Topic(f"/{name}/wheels", "sensor_msgs/JointState"), message

    @cached_property
    def _sample_stamps(self) -> dict[tuple[str, str], list[int]]:
        """(sensor, robot) → times of its samples by the robot's clock [ns]."""
        named = [("imu", robot, s.stamp) for robot, s in self.recording.imu.items()]
        named += [("wheels", robot, s.stamp) for robot, s in self.recording.wheels.items()]
        return {(sensor, robot): self.recording.nanoseconds(stamps, self.epoch, robot) for sensor, robot, stamps in named}

    def messages(self, frame: int) -> Iterator[tuple[Topic, Message]]:
        """The messages of a frame: transforms first."""
        stamp, truth = self.stamps[frame], self.recording.truth[frame]
        moving = {robot: self.robots[robot] for robot in self.recording.setup.moving_robots}
        if moving:
            transforms = [transform(WORLD, f"{name}/base_link", truth.T_world_robot[robot], stamp) for robot, name in moving.items()]
            yield Topic("/tf", "tf2_msgs/TFMessage"), {"transforms": transforms}
        for robot, name in moving.items():
            if (frame, robot) in self.odometry:
                yield Topic(f"/{name}/odom", "nav_msgs/Odometry"), self.odometry[frame, robot]
            step = self._steps.get((frame, robot))
            if step is not None and step.gravity is not None:
                up = up_message(step.gravity, step.gravity_sigma, self.clocks[robot][frame], f"{name}/base_link")
                yield Topic(f"/{name}/up", "sensor_msgs/Imu"), up
            pose = truth.T_world_robot[robot]
            yield Topic(f"/{name}/truth/odom", "nav_msgs/Odometry"), self._true_odometry(frame, robot, pose)
            yield Topic(f"/{name}/truth/pose", "geometry_msgs/PoseStamped"), {"header": header(stamp, WORLD), "pose": pose_message(pose)}
        for camera in self.cameras:
            yield from self._camera(frame, camera)
        before = self.recording.truth[frame - 1].person_id.tolist() if frame else []
        people = truth.person_id.tolist()
        markers = people_markers(people, truth.feet, [person for person in before if person not in people], stamp)
        yield Topic("/truth/people", "visualization_msgs/MarkerArray"), markers

    def _true_odometry(self, frame: int, robot: str, pose: Pose) -> Message:
        """The velocity is the mean since the previous frame; 0 in frame 0."""
        before = self.recording.truth[max(frame - 1, 0)].T_world_robot[robot]
        tangent = (before.inverse() @ pose).log() / self.recording.setup.period
        where = (self.stamps[frame], WORLD, f"{self.robots[robot]}/base_link")
        return odometry_message(pose, np.zeros((6, 6)), tangent, np.zeros((6, 6)), where)

    def _camera(self, frame: int, camera: str) -> Iterator[tuple[Topic, Message]]:
        name, stamp = self.cameras[camera], self.clocks[camera][frame]
        optical = f"{name}/optical"
        if self.recording.has_images(camera):
            suffix = self.recording.image_suffix(camera)
            image = compressed_image(self.recording.image(frame, camera, suffix), suffix, stamp, optical)
            yield Topic(f"/{name}/image/compressed", "sensor_msgs/CompressedImage"), image
        yield Topic(f"/{name}/camera_info", "sensor_msgs/CameraInfo"), camera_info(self.recording.cameras[camera], stamp, optical)
        boxes, confidence = self.recording.detection_boxes(frame, camera)
        found = self.recording.detections.get((frame, camera), Detections.none())
        directions = direction_messages(found.bearing, found.covariance)
        given = detections_message(boxes, confidence, [""] * len(boxes), header(stamp, optical), directions)
        white = {"r": 1.0, "g": 1.0, "b": 1.0, "a": 0.8}
        turn = self.recording.cameras[camera].width if self.recording.cameras[camera].wraps else np.inf
        yield Topic(f"/{name}/detections", "vision_msgs/Detection2DArray"), given
        yield Topic(f"/{name}/detections/markers", IMAGE_MARKER), boxes_marker(boxes, [white] * len(boxes), turn, stamp, optical)
        if (frame, camera) in self.recording.robot_detections:
            others = self.recording.robot_detections[frame, camera]
            others = replace(others, robot=tuple(self.robots[robot] for robot in others.robot))
            pixels = self.recording.cameras[camera].pixels_from_bearings(others.bearing)[0] + 0.5 - self.recording.cameras[camera].pixel_centre
            yield Topic(f"/{name}/robots", "vision_msgs/Detection2DArray"), robots_message(others, pixels, header(stamp, optical))
        if (frame, camera) in self.recording.views:
            true = self.recording.views[frame, camera].boxes
            seen = true.visible > 0
            edges, people = ltwh_from_edges(true.seen[seen]), true.person[seen].tolist()
            message = detections_message(edges, true.visible[seen], map(str, people), header(self.stamps[frame], optical))
            yield Topic(f"/{name}/truth/detections", "vision_msgs/Detection2DArray"), message
            # Foxglove draws only markers with the stamp of the image.
            marker = boxes_marker(edges, [person_color(person) for person in people], turn, stamp, optical)
            yield Topic(f"/{name}/truth/detections/markers", IMAGE_MARKER), marker


def ros_names(names: list[str]) -> dict[str, str]:
    """Name → name in ROS: `_` replaces each character that ROS does not allow, and `n_` precedes a first character that is no letter.

    Raises ValueError where two names become the same.
    """
    out: dict[str, str] = {}
    for name in names:
        allowed = re.sub(r"[^A-Za-z0-9_]", "_", name)
        allowed = allowed if re.match(r"[A-Za-z]", allowed) else f"n_{allowed}"
        if allowed in out.values():
            raise ValueError(f"names {name!r} and {next(n for n, taken in out.items() if taken == allowed)!r} are both {allowed} in ROS")
        out[name] = allowed
    return out
