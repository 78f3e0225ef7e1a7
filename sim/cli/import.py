"""The command `pilsim import`: make a recording of a robot's bag."""  # noqa: N999  the command is named so

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, arg

from sim.cli.options import Out, json_text, unset

Topics = tyro.conf.UseAppendAction[Annotated[tuple[str, ...], arg(metavar="TOPIC", help_behavior_hint="(default: none; repeatable)")]]


@dataclass(frozen=True)
class Import:
    """Make a recording of a robot's bag: ROS 1, ROS 2 or MCAP.

    BAG is a file .bag, .mcap or .db3, or a folder with metadata.yaml.
    `pilsim info BAG` lists its topics. `detect`, `track` and `view` read the result.
    Camera poses come from transforms (tf, tf_static) or --calibration; image frames
    are optical frames, as in ROS. The command needs pip install 'pilsim[ros]'.

    Examples: pilsim import walk.bag --camera /pano/image_raw=panorama --odometry /odom
                  --imu /imu --out runs/walk
              pilsim import runs/ros2/pilsun-00000 --exported --out runs/again
    """

    bag: Annotated[Positional[Path], arg(metavar="BAG")]
    """The bag."""
    out: Out
    """Folder of the recording; it must not exist yet."""
    camera: tyro.conf.UseAppendAction[
        Annotated[tuple[str, ...], arg(metavar="TOPIC[=MODEL]", help_behavior_hint="(default: none; the model as CameraInfo says; repeatable)")]
    ] = ()
    """Images, or CameraInfo of a camera without images. MODEL is panorama, pinhole, fisheye or cylinder."""
    odometry: Topics = ()
    """Odometry of a robot. A camera on a robot without odometry is predicted at constant velocity."""
    imu: Topics = ()
    """IMU of a robot, which gives the direction of gravity."""
    detections: Topics = ()
    """Boxes of people (vision_msgs/Detection2DArray) in the frame of a camera."""
    calibration: Annotated[Path | None, unset("FILE.json", "CameraInfo and transforms")] = None
    """Cameras as in recording.json, by their names or topics, in place of those of the bag."""
    ground: Annotated[float, arg(metavar="M")] = 0.0
    """Height of flat ground in the world, m."""
    exported: bool = False
    """The bag is one of `export --format mcap`: take all topics, truth and terrain, too."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from tracker.formats.ros.bag_import import BagTopics, read_bag
        from tracker.formats.ros.bag_values import MODELS

        cameras = dict[str, str]()
        for text in self.camera:
            topic, _, model = text.partition("=")
            if model not in ("", *MODELS):
                raise ValueError(f"--camera {text}: model is {model!r}, needs one of {', '.join(MODELS)}")
            cameras[topic] = model
        topics = BagTopics(cameras, self.odometry, self.imu, self.detections, self.calibration, self.ground)
        if self.exported:
            if topics != BagTopics(ground=self.ground, calibration=self.calibration):
                raise ValueError("--exported takes all topics of a bag, and excludes --camera, --odometry, --imu and --detections")
            topics = replace(BagTopics.of_export(self.bag), calibration=self.calibration, ground=self.ground)
        notes: list[str] = []
        recording = read_bag(self.bag, topics, self.out, notes.append if self.json else lambda line: print(line, file=sys.stderr))
        if self.json:
            robots = list(recording.robots)
            print(json_text({"out": str(self.out), "frames": recording.frames, "rate": recording.rate, "robots": robots, "notes": notes}))
            return
        print(f"{self.out}: {recording.frames} frames at {recording.rate:g}/s of {', '.join(recording.cameras)}; `pilsim track {self.out}` reads it")
