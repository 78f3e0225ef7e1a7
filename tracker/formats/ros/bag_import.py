"""Import of a bag as a recording: cameras, boxes, odometry and, from pilsim's export, truth and terrain. Read `read_bag` first.

A first pass reads all but the images. It reports missing data before anything is written. A second pass copies the images one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tracker.formats.exported_sequence import export_folder
from tracker.formats.ros.bag_cameras import CAMERA_KINDS, IMAGE_KINDS, INFO, BagCamera, CameraFinder, readable, robot_name
from tracker.formats.ros.bag_odometry import OdometryPath, UpPath, step_between
from tracker.formats.ros.bag_reader import BagReader, seconds
from tracker.formats.ros.bag_times import FrameTimes, Growing, Tell
from tracker.formats.ros.bag_truth import GROUND, PEOPLE, TOPS, BagTruth, Taker
from tracker.formats.ros.bag_values import boxes_from_message, stamp_of
from tracker.formats.ros.frame_tree import FrameTree, bare
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Panorama
from tracker.geometry.ground import Flat
from tracker.io.atomic import write_text
from tracker.io.csv_tables import write_table
from tracker.io.image_files import image_size
from tracker.io.progress import progress_bar
from tracker.recordings import FrameBoxes, Recording, RecordingCamera, RecordingRobot
from tracker.recordings.folder import START_SIGMA, read_recording, write_recording
from tracker.recordings.recording import MAX_FRAMES
from tracker.types import Odometry, Start

T = TypeVar("T")
TRANSFORMS = ("tf2_msgs/TFMessage", "tf/tfMessage")
BOXES, IMU, ODOMETRY = "vision_msgs/Detection2DArray", "sensor_msgs/Imu", "nav_msgs/Odometry"


@dataclass(frozen=True)
class BagTopics:
    """The topics of a bag to import, and how.

    cameras: topic of Image, CompressedImage or CameraInfo → model, one of bag_values.MODELS, or "" for that of CameraInfo.
    odometry, imu, detections: topics. calibration: a file with entries of recording.json for cameras, by name or topic.
    ground: height of flat ground, m. exported: whether truth and terrain of our own export are read, too.
    """

    cameras: Mapping[str, str] = field(default_factory=dict)
    odometry: tuple[str, ...] = ()
    imu: tuple[str, ...] = ()
    detections: tuple[str, ...] = ()
    calibration: Path | None = None
    ground: float = 0.0
    exported: bool = False

    @staticmethod
    def of_export(path: Path) -> BagTopics:
        """All topics of a bag that `pilsim export --format mcap` wrote. Raises ValueError for another bag."""
        with BagReader(path) as bag:
            infos = {topic.rpartition("/")[0]: topic for topic in bag.of_kind(INFO)}
            if not infos or PEOPLE not in bag.kinds:
                raise ValueError(f"{path}: has no {PEOPLE} and /CAMERA/camera_info, needs a bag of `pilsim export --format mcap`; name its topics")
            images = {name: f"{name}/image/compressed" for name in infos}
            cameras = {images[name] if images[name] in bag.kinds else info: "" for name, info in infos.items()}
            odometry = tuple(topic for topic in bag.of_kind(ODOMETRY) if not topic.endswith("/truth/odom"))
            up = tuple(topic for topic in bag.of_kind(IMU) if topic.endswith("/up"))
            boxes = tuple(f"{name}/detections" for name in infos if f"{name}/detections" in bag.kinds)
            return BagTopics(cameras, odometry, up, boxes, exported=True)


def read_bag(path: Path, topics: BagTopics, out: Path, tell: Tell = lambda line: None) -> Recording:
    """Write the chosen topics of a bag as a recording into `out` atomically, and read it.

    tell: takes one line of text for each assumption and omission.
    Raises ValueError, in one line with topic and stamp, for missing or unreadable data, and as export_folder.
    """
    with BagReader(path) as bag, export_folder(path, out) as unfinished:
        notes: list[str] = []

        def told(line: str) -> None:
            notes.append(line)
            tell(line)

        survey = Survey(bag, topics, told)
        survey.read()
        times = copy_images(survey, unfinished)
        write_recording(unfinished, survey.recording(times))
        rows = [[name, frame + 1, (stamp - times.zero) / 1e9] for name in times.stamps for frame, stamp in times.stamps[name].items()]
        write_table(unfinished / "times.csv", ["camera", "frame", "time_s"], rows)
        head = f"# A bag, imported by pilsim\n\nFrom: {path.resolve().name}. Time 0 is {seconds(times.zero)} s.\n\n"
        write_text(unfinished / "README.md", head + "".join(f"* {note}\n" for note in [*survey.sources(), *notes]))
    return read_recording(out)


@dataclass(eq=False)
class BoxTopic:
    """Boxes of a topic: stamp [ns] → boxes (n, 4) px from the image's corner and scores (n,). frame: that of their images."""

    frame: str = ""
    found: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    def add(self, _: int, message: Any) -> None:
        """Add a Detection2DArray."""
        self.frame = self.frame or bare(message.header.frame_id)
        self.found[stamp_of(message)] = boxes_from_message(message)


@dataclass(eq=False)
class Survey:
    """The content of a bag without its images: transforms, odometry and directions of up of robots, boxes by topic, and exported truth.

    placed: the cameras of the recording, on `robots` or in the world.
    """

    bag: BagReader
    topics: BagTopics
    tell: Tell
    tree: FrameTree = field(default_factory=FrameTree)
    growing: Growing = field(default_factory=Growing)
    paths: dict[str, OdometryPath] = field(default_factory=dict)
    ups: dict[str, UpPath] = field(default_factory=dict)
    boxes: dict[str, BoxTopic] = field(default_factory=dict)
    truth: BagTruth = field(default_factory=BagTruth)
    cameras: dict[str, BagCamera] = field(default_factory=dict)
    placed: dict[str, RecordingCamera] = field(default_factory=dict)

    @cached_property
    def finder(self) -> CameraFinder:
        """Finds models and poses of cameras, after all transforms are read."""
        return CameraFinder(self.tree, self.paths, CameraFinder.entries(self.topics.calibration))

    def read(self) -> None:
        """Read all but the images, and place the cameras. Raises ValueError, in one line, for what is missing."""
        self._check_topics()
        names = {robot_name(topic): topic for topic in self.topics.odometry}
        if len(names) < len(self.topics.odometry):
            raise ValueError(f"odometry of {', '.join(self.topics.odometry)}: two robots have one name, {', '.join(names)}")
        self.paths = {name: OdometryPath(topic) for name, topic in names.items()}
        self.ups = {topic: UpPath(topic) for topic in self.topics.imu}
        self.boxes = {topic: BoxTopic() for topic in self.topics.detections}
        takers: list[tuple[str, Taker]] = [(topic, lambda _, message: self.tree.add(message)) for topic in self.bag.of_kind(*TRANSFORMS)]
        takers += [(path.topic, self._growing(path.topic, path.add)) for path in self.paths.values()]
        takers += [(topic, self._growing(topic, up.add)) for topic, up in self.ups.items()]
        takers += [(topic, boxes.add) for topic, boxes in self.boxes.items()]
        takers += self.truth.takers(self.bag.kinds) if self.topics.exported else []
        by_topic = {topic: [take for other, take in takers if other == topic] for topic, _ in takers}
        for topic, log, message in self.bag.messages(by_topic):
            try:
                for take in by_topic[topic]:
                    take(log, message)
            except ValueError as error:
                raise ValueError(f"{self.bag.path}: {topic} at {seconds(log)} s: {error}") from None
        self.growing.tell(self.bag.path, self.tell)
        self._place_cameras()
        self._check_ups()

    def _growing(self, topic: str, add: Callable[[Any], None]) -> Taker:
        """A function that passes the messages of a topic with growing stamps to `add`."""

        def take(log: int, message: Any) -> None:
            if self.growing.take(topic, stamp_of(message), log):
                add(message)

        return take

    def _check_ups(self) -> None:
        """Report IMUs without a transform to a robot with odometry."""
        for topic, up in self.ups.items():
            if all(self.tree.between(path.child, up.frame, self.finder.world) is None for path in self.paths.values()):
                self.tell(f"{topic}: left out, as no transform leads from its frame {up.frame!r} to a robot with odometry")

    def _check_topics(self) -> None:
        """Raises ValueError for topics that are not named, missing, empty or of another type. It lists the available topics."""
        path, kinds = self.bag.path, self.bag.kinds
        images = self.bag.of_kind(*IMAGE_KINDS) or self.bag.of_kind(*CAMERA_KINDS)
        if not self.topics.cameras:
            raise ValueError(f"{path}: needs --camera TOPIC, one or more of {', '.join(images) or 'its topics, none of which has images'}")
        wanted = [(topic, CAMERA_KINDS) for topic in self.topics.cameras] + [(topic, (ODOMETRY,)) for topic in self.topics.odometry]
        wanted += [(topic, (IMU,)) for topic in self.topics.imu] + [(topic, (BOXES,)) for topic in self.topics.detections]
        for topic, needed in wanted:
            there = ", ".join(self.bag.of_kind(*needed)) or "none"
            if kinds.get(topic) not in needed:
                what = f"{topic} is {kinds[topic]}" if topic in kinds else f"has no topic {topic}"
                raise ValueError(f"{path}: {what}, needs {' or '.join(needed)}; there are: {there}")
            if not self.bag.counts[topic]:
                raise ValueError(f"{path}: {topic} has no messages")

    def _place_cameras(self) -> None:
        for topic, model in self.topics.cameras.items():
            camera = BagCamera.read(self.bag, topic, model)
            for other in self.cameras.values():
                if other.name == camera.name or other.frame == camera.frame:
                    same = f"name {camera.name!r}" if other.name == camera.name else f"frame id {camera.frame!r}"
                    raise ValueError(f"{self.bag.path}: cameras {other.topic} and {topic} have one {same}, needs different ones")
            self.cameras[camera.name] = camera
        self.placed = {name: self.finder.find(camera) for name, camera in self.cameras.items()}
        for name, placed in self.placed.items():
            if placed.robot is not None and placed.robot not in self.paths:
                self.tell(f"{placed.robot}: no odometry, so that motion is predicted at constant velocity and lengths have no scale")
            if placed.robot is not None and not isinstance(placed.camera, Panorama):
                self.tell(f"{name}: is no panorama, in which SLAM finds landmarks; {placed.robot} moves as its odometry says")

    def sources(self) -> list[str]:
        """A line for each camera and robot: its topic and frame."""
        lines = [f"camera {c.name}: {c.topic}, frame {c.frame}" for c in self.cameras.values()]
        return lines + [f"robot {name}: {path.topic}, {path.frame} to {path.child}" for name, path in self.paths.items()]

    def recording(self, times: FrameTimes) -> Recording:
        """The recording without its images, which are copied already."""
        carried = {robot: [n for n, c in self.placed.items() if c.robot == robot] for robot in dict.fromkeys(c.robot for c in self.placed.values())}
        robots = {name: self._robot(name, cameras, times) for name, cameras in carried.items() if name is not None}
        if robots and not any(robot.start for robot in robots.values()):
            frames = ", ".join(path.frame for path in self.paths.values())
            raise ValueError(f"{self.bag.path}: no transform from {self.finder.world!r} to {frames}, needs one where cameras stand in the world")
        truth, grids, detections = self.topics.exported, self.truth.grids, self._detections(times)
        return Recording(
            times.rate,
            self.placed,
            detections,
            self.truth.people_by_frame(times) if truth else None,
            frames=times.count,
            ground=grids.get(GROUND, Flat(self.topics.ground)),
            occluders=grids.get(TOPS),
            robots=robots,
            covariances=self._of_cameras(self.truth.covariances, times, detections),
            robot_detections=self._of_cameras(self.truth.robots, times),
            visible=self.truth.visible_by_frame(times),
        )

    def _robot(self, name: str, cameras: list[str], times: FrameTimes) -> RecordingRobot:
        """A robot: its pose at frame 0, and its motion between the times of the frames."""
        truth, path, stamps = self.truth.poses_by_frame(name, times), self.paths.get(name), times.of_robot(cameras)
        if path is None:
            return RecordingRobot(Start(Pose.identity(), START_SIGMA**2 * np.eye(6)), {}, truth)
        steps = {frame: step_between(path, *stamps[frame - 1 : frame + 1].tolist()) for frame in range(1, times.count)}
        odometry = {frame: self._with_up(path, step, stamps[frame - 1 : frame + 1]) for frame, step in steps.items() if step is not None}
        if len(odometry) < times.count - 1:
            self.tell(f"{path.topic}: does not reach {times.count - 1 - len(odometry)} of {times.count} frames, which have no odometry")
        if path.unstated:
            self.tell(f"{path.topic}: states no variance of {', '.join(path.unstated)}; 5 cm and 2 degrees after a metre are taken")
        return RecordingRobot(self._start(name, path, int(stamps[0])), odometry, truth)

    def _start(self, name: str, path: OdometryPath, stamp: int) -> Start | None:
        """The pose at a time [ns] in the world. Without a transform there and without fixed cameras, the first odometry's frame is the world."""
        T_world_odom = self.tree.between(self.finder.world, path.frame)
        if T_world_odom is None and path is next(iter(self.paths.values())) and all(c.robot is not None for c in self.placed.values()):
            T_world_odom = Pose.identity()
        if T_world_odom is None:
            self.tell(f"{path.topic}: no transform from {self.finder.world!r} to {path.frame!r}; the start of {name} is unknown")
            return None
        covariance = self.truth.starts.get(name, START_SIGMA**2 * np.eye(6))
        return Start(T_world_odom @ (path.pose(stamp) or path.first), covariance)

    def _with_up(self, path: OdometryPath, step: Odometry, stamps: Ints) -> Odometry:
        """The motion between two times (2,) [ns] with the direction of up from the IMU on the robot, if it has one."""
        for up in self.ups.values():
            mount = self.tree.between(path.child, up.frame, self.finder.world)
            if mount is not None and (found := up.up(*stamps.tolist())) is not None:
                return replace(step, gravity=mount.rotation @ found[0], gravity_sigma=found[1])
        return step

    @staticmethod
    def _of_cameras(
        stamped: Mapping[str, Mapping[int, T]], times: FrameTimes, boxes: Mapping[str, FrameBoxes] | None = None
    ) -> dict[str, dict[int, T]]:
        """Camera → stamp → value as camera → frame → value, only for frames in `boxes` where it is given."""
        out = {
            name: {times.of_camera(name, stamp): value for stamp, value in of_camera.items()}
            for name, of_camera in stamped.items()
            if name in times.stamps
        }
        return {name: {f: v for f, v in of.items() if f is not None and (boxes is None or f in boxes.get(name, {}))} for name, of in out.items()}

    def _detections(self, times: FrameTimes) -> dict[str, FrameBoxes]:
        """Camera → its boxes by frame. Raises ValueError for boxes whose frame id belongs to no camera."""
        out: dict[str, FrameBoxes] = {}
        for topic, boxes in self.boxes.items():
            name = next((c.name for c in self.cameras.values() if c.frame == boxes.frame), None)
            if name is None:
                frames = ", ".join(c.frame for c in self.cameras.values())
                raise ValueError(f"{self.bag.path}: {topic} has boxes in the frame {boxes.frame!r}, cameras have {frames}")
            shift = np.array([self.placed[name].camera.pixel_centre] * 2 + [0.0, 0.0])
            framed = {times.of_camera(name, stamp): (found + shift, scores) for stamp, (found, scores) in boxes.found.items()}
            if lost := len(boxes.found) - len(framed.keys() - {None}):
                self.tell(f"{topic}: left out {lost} of {len(boxes.found)} messages, whose stamps are those of no image")
            out[name] = {frame: of_frame for frame, of_frame in sorted(framed.items()) if frame is not None and len(of_frame[0])}
        return out


def copy_images(survey: Survey, folder: Path) -> FrameTimes:
    """Copy the images of all cameras to images/CAMERA below a folder, one by one. Returns the times of their frames.

    Cameras without images have the times of their CameraInfo. Raises ValueError for an image with an unknown encoding or another size.
    """
    cameras, stamps = {c.topic: c for c in survey.cameras.values()}, {name: list[int]() for name in survey.cameras}
    files: dict[str, list[Path]] = {name: [] for name in survey.cameras}
    total = sum(survey.bag.counts[topic] for topic in cameras)
    for topic, log, message in progress_bar(survey.bag.messages(cameras), total=total, desc=survey.bag.path.name, unit="image"):
        camera, stamp = cameras[topic], stamp_of(message)
        if not survey.growing.take(topic, stamp, log):
            continue
        stamps[camera.name].append(stamp)
        if camera.size is not None:
            data, suffix = readable(survey.bag, topic, log, message)
            if (size := image_size(data)) != camera.size:
                raise ValueError(f"{survey.bag.path}: {topic} at {seconds(log)} s: image has {size} px (height, width), the first has {camera.size}")
            file = folder / "images" / camera.name / f"{len(stamps[camera.name]):06d}{suffix}"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
            files[camera.name].append(file)
    survey.growing.tell(survey.bag.path, survey.tell)
    times = FrameTimes.of(stamps)
    if times.count > MAX_FRAMES:
        spans = ", ".join(f"{name} from {seconds(of[0])} to {seconds(of[-1])} s" for name, of in stamps.items())
        raise ValueError(
            f"{survey.bag.path}: stamps of images are those of {times.count} frames at {times.rate:g}/s ({spans}), needs at most {MAX_FRAMES},"
            " of one clock that does not jump"
        )
    for name, written in files.items():
        # Frame numbers are at least the file numbers, so renaming from the last to the first overwrites no file.
        for file, frame in zip(written[::-1], sorted(times.stamps[name], reverse=True), strict=True):
            file.rename(file.with_stem(f"{frame + 1:06d}"))
    return times
