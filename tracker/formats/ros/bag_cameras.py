"""The cameras of a bag: models from CameraInfo and poses from transforms, or both from a calibration file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, count
from pathlib import Path
from typing import Any

from tracker.formats.camera_parameters import OPTICAL
from tracker.formats.ros.bag_odometry import OdometryPath
from tracker.formats.ros.bag_reader import BagReader, seconds
from tracker.formats.ros.bag_values import camera_from_info, picture
from tracker.formats.ros.frame_tree import FrameTree, bare
from tracker.geometry import Pose
from tracker.geometry.cameras import Camera, Panorama
from tracker.io.image_files import image_size
from tracker.io.json_files import JsonObject, read_json
from tracker.recordings import RecordingCamera
from tracker.recordings.camera_json import camera_from

IMAGE_KINDS = ("sensor_msgs/Image", "sensor_msgs/CompressedImage")
INFO = "sensor_msgs/CameraInfo"
CAMERA_KINDS = (*IMAGE_KINDS, INFO)
WORLDS = ("world", "map")
"""Names of frames that are taken as the world."""
PARTS = r"(/(image|compressed|image_raw|image_color|image_rect|image_rect_color|image_mono|camera_info))+$"
"""The end of a camera's topic that is not its name."""


def camera_name(topic: str) -> str:
    """The name of a camera: robot_0_camera for /robot_0_camera/image/compressed."""
    return re.sub(r"[^\w.-]", "_", re.sub(PARTS, "", topic).strip("/")) or "camera"


def robot_name(topic: str) -> str:
    """The name of a robot from its odometry topic: robot_0 for /robot_0/odom."""
    return re.sub(r"[^\w.-]", "_", topic.strip("/").rpartition("/")[0]) or "robot"


@dataclass(frozen=True, eq=False)
class BagCamera:
    """A camera of a bag. frame: that of its images. size: (height, width) of its first image, None without images. info: its first CameraInfo."""

    topic: str
    name: str
    model: str
    frame: str
    size: tuple[int, int] | None
    info: Any

    @staticmethod
    def read(bag: BagReader, topic: str, model: str) -> BagCamera:
        """The camera of a topic from its first messages. Raises ValueError for an image with an unknown encoding."""
        info_topic = topic if bag.kinds[topic] not in IMAGE_KINDS else _info_topic(bag, topic)
        info: Any = next((message for _, _, message in bag.messages([info_topic])), None) if info_topic else None
        if info_topic == topic:
            return BagCamera(topic, camera_name(topic), model, bare(info.header.frame_id), None, info)
        log, image = next((log, message) for _, log, message in bag.messages([topic]))
        size = image_size(readable(bag, topic, log, image)[0])
        return BagCamera(topic, camera_name(topic), model, bare(image.header.frame_id), size, info)


def _info_topic(bag: BagReader, topic: str) -> str | None:
    """The topic of CameraInfo for a topic of images, by the convention of image_transport."""
    above = topic.removesuffix("/compressed").rpartition("/")[0]
    return f"{above}/camera_info" if f"{above}/camera_info" in bag.of_kind(INFO) else None


def readable(bag: BagReader, topic: str, log: int, message: Any) -> tuple[bytes, str]:
    """As `picture`, with the topic and the time of the log [ns] in its error."""
    try:
        return picture(message)
    except ValueError as error:
        raise ValueError(f"{bag.path}: {topic} at {seconds(log)} s: {error}") from None


@dataclass(eq=False)
class CameraFinder:
    """Finds models and places of cameras. robots: name → odometry. calibration: the file and its entries of cameras.

    without_odometry: body → name of a robot that carries a camera and has no odometry.
    """

    tree: FrameTree
    robots: Mapping[str, OdometryPath]
    calibration: tuple[Path, Mapping[str, Any]] | None = None
    without_odometry: dict[str, str] = field(default_factory=dict)

    @staticmethod
    def entries(file: Path | None) -> tuple[Path, Mapping[str, Any]] | None:
        """The cameras of a calibration file: recording.json, or its object of cameras alone. Raises ValueError for other content."""
        if file is None:
            return None
        content = JsonObject(read_json(file), str(file))
        return file, (content.part("cameras") if "cameras" in content.values else content).values

    @cached_property
    def world(self) -> str:
        """The frame of the world: one of WORLDS in the transforms, else that of the first odometry."""
        named = [frame for frame in WORLDS if frame in self.tree.parent or any(above == frame for above, _ in self.tree.parent.values())]
        return named[0] if named else next((path.frame for path in self.robots.values()), WORLDS[0])

    def find(self, camera: BagCamera) -> RecordingCamera:
        """The camera with its place. Raises ValueError with the topic and what is missing."""
        file, entries = self.calibration or (Path(), {})
        for key in (camera.name, camera.topic):
            if key in entries:
                found = camera_from(entries[key], f"{file}: {key}")
                if found.robot is not None and found.robot not in self.robots:
                    raise ValueError(
                        f"{file}: {key}.robot is {found.robot!r}, needs one of {', '.join(self.robots) or '--odometry, which is missing'}"
                    )
                return found
        try:
            model = self._model(camera)
            if camera.size is not None and camera.size != (model.height, model.width):
                raise ValueError(f"images are {camera.size[1]} x {camera.size[0]} px, CameraInfo says {model.width} x {model.height}")
        except ValueError as error:
            raise ValueError(f"{camera.topic}: {error}") from None
        return self._place(camera, model)

    def _model(self, camera: BagCamera) -> Camera:
        if camera.info is not None:
            return camera_from_info(camera.info, camera.model)
        if camera.model == "panorama" and camera.size is not None:
            return Panorama(camera.size[1], camera.size[0])
        raise ValueError("has no CameraInfo beside it, needs TOPIC=panorama or --calibration FILE")

    def _place(self, camera: BagCamera, model: Camera) -> RecordingCamera:
        """The camera on the robot whose body is nearest in the tree; else fixed in the world; else on a new robot without odometry."""
        above = list(self.tree.chain(camera.frame))
        mounts = {name: self.tree.between(path.child, camera.frame, self.world) for name, path in self.robots.items()}
        far = {name: above.index(self.robots[name].child) if self.robots[name].child in above else len(above) for name in mounts if mounts[name]}
        if far:
            robot = min(far, key=lambda name: far[name])
            mount = mounts[robot]
            assert mount is not None
            return RecordingCamera(model, mount @ OPTICAL.inverse(), robot)
        if self.world in above:
            return RecordingCamera(model, self.tree.chain(camera.frame)[self.world] @ OPTICAL.inverse())
        if self.robots:
            bodies = ", ".join(sorted({path.child for path in self.robots.values()}))
            raise ValueError(
                f"{camera.topic}: no transform from its frame {camera.frame!r} to {bodies}, needs --calibration FILE or transforms;"
                f" they reach {', '.join(above[1:]) or 'nothing'} from it, and name {', '.join(sorted(self.tree.parent)) or 'no frame'}"
            )
        body = above[-1]
        if body not in self.without_odometry:
            taken = self.without_odometry.values()
            names = chain([robot_name(camera.topic) if taken else "robot", camera.name], (f"{camera.name}_{k}" for k in count(2)))
            self.without_odometry[body] = next(name for name in names if name not in taken)
        robot = self.without_odometry[body]
        mount = self.tree.chain(camera.frame)[body]
        return RecordingCamera(model, (mount @ OPTICAL.inverse()) if len(above) > 1 else Pose.identity(), robot)
