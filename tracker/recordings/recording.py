"""A recording: calibrated cameras, boxes of people per camera and frame, and optional further data. Every foreign data set is read as a Recording.

Frames count from 0 here; files count from 1, as MOTChallenge does. Positions are in metres in a right-handed world with z up.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tracker.detections.boxes import detections_from_boxes, feet_seen
from tracker.geometry import Array, Ints, Mask, Pose
from tracker.geometry.cameras import OPTICAL_FROM_CAMERA, Camera, Pinhole
from tracker.geometry.ground import Flat, Ground
from tracker.io.mot15 import MAX_FRAME
from tracker.recordings.clocks import LONGEST, TOGETHER, CameraClock, Schedule, TickViews, near_frame
from tracker.recordings.images import ImageFiles, ImageSource, TicksWithImages
from tracker.sequence.calibration import MAX_RATE, MIN_RATE
from tracker.types import Detections, Mount, Odometry, RobotDetections, Sequence, Setup, Start, Tick, Ticks, TicksInMemory, Truth, View

FrameBoxes = Mapping[int, tuple[Array, Array]]
"""Frame from 0 → boxes (n, 4) left, top, width, height px and confidence (n,). Frames without boxes may have no entry."""
FrameVectors = Mapping[int, Array]
"""Frame from 0 → vectors (n, d) of the boxes of that frame, in their order."""
MAX_FRAMES = MAX_FRAME
"""Most frames of a recording, which holds a value for each frame, also for frames without data."""
MAX_VIEWS = 1 << 24
"""Most frames times cameras: each tick holds a view per camera."""
NOBODY, NO_ROBOT = Detections.none(), RobotDetections.none()
NO_BOXES = np.zeros((0, 4)), np.zeros(0)
STATURE = (1.4, 2.3)
"""m: the default band of body heights, as in Setup."""
GUESSED_FOCAL = 0.8
"""Focal length over the width of the image where it is not known."""
SHOWN_AS = 4 / 3
"""Width over height at which pictures of STANDARD_SIZES are shown (ITU-R BT.601), whatever their numbers of pixels."""
STANDARD_SIZES = frozenset({(720, 576), (704, 576), (352, 288), (720, 480), (704, 480), (352, 240)})
"""px: width and height of PAL and NTSC video, whose pixels are not square."""
OF_BOXES = {"appearances": "d", "covariances": "3", "visible_parts": "5"}
"""Fields of a recording with a vector for each box, and the lengths of the vectors."""


def pixel_aspect(width: int, height: int) -> float:
    """Width over height of a pixel, by the size of the image: 1 except for STANDARD_SIZES."""
    return SHOWN_AS * height / width if (width, height) in STANDARD_SIZES else 1.0


@dataclass(frozen=True, eq=False)
class RecordingCamera:
    """A camera: its model and its pose in body axes (x forward, y left, z up).

    pose: T_world_camera of a fixed camera; T_robot_camera where `robot` names the robot that carries it.
    unknown: "K" where the model is guessed from the image size, "pose" where the pose is unknown. `pilsim calibrate` estimates both.
    own_body: as in Mount.
    """

    camera: Camera
    pose: Pose
    robot: str | None = None
    unknown: frozenset[str] = frozenset()
    own_body: Mask | None = None

    @staticmethod
    def uncalibrated(width: int, height: int, camera: Camera | None = None) -> RecordingCamera:
        """A camera without a known pose. Its model is `camera`, or a guess from the image size."""
        focal = GUESSED_FOCAL * width
        guess = Pinhole(width, height, focal, focal * pixel_aspect(width, height), (width - 1) / 2, (height - 1) / 2)
        return RecordingCamera(camera or guess, Pose.identity(), unknown=frozenset({"pose"} if camera else {"K", "pose"}))

    def without_pose(self, keep_model: bool = True) -> RecordingCamera:
        """The camera without its pose, and without its model unless that is known and `keep_model`."""
        model = self.camera
        return RecordingCamera.uncalibrated(model.width, model.height, model if keep_model and "K" not in self.unknown else None)

    @staticmethod
    def of_opencv(camera: Camera, R: ArrayLike, t: ArrayLike, robot: str | None = None) -> RecordingCamera:
        """A camera whose extrinsics are those of OpenCV: x_camera = R x_world + t; x_camera right, down and ahead, metres."""
        rotation = np.asarray(R, dtype=np.float64)
        return RecordingCamera(camera, Pose(rotation.T @ OPTICAL_FROM_CAMERA, -rotation.T @ np.asarray(t, dtype=np.float64)), robot)

    @staticmethod
    def looking_at(camera: Camera, position: ArrayLike, target: ArrayLike) -> RecordingCamera:
        """A fixed camera at `position` (3,) m that looks at `target` (3,) m, level from side to side.

        Raises ValueError for a target straight above or below, where the roll is undefined.
        """
        eye = np.asarray(position, dtype=np.float64)
        forward = np.asarray(target, dtype=np.float64) - eye
        left = np.array([-forward[1], forward[0], 0.0])
        if not np.linalg.norm(left) > 1e-9 * np.linalg.norm(forward):
            raise ValueError(f"target is {np.asarray(target).tolist()}, needs a place that is not straight above or below the camera")
        forward, left = forward / np.linalg.norm(forward), left / np.linalg.norm(left)
        return RecordingCamera(camera, Pose(np.column_stack([forward, left, np.cross(forward, left)]), eye))

    @property
    def opencv_extrinsics(self) -> tuple[Array, Array]:
        """R (3, 3) and t (3,) m with x_camera = R x_world + t, the inverse of of_opencv."""
        R = OPTICAL_FROM_CAMERA @ self.pose.rotation.T
        return R, -R @ self.pose.translation


@dataclass(frozen=True, eq=False)
class RecordingRobot:
    """A robot that carries cameras: start, or None where unknown; odometry by frame from 0; truth: true poses by frame, or None."""

    start: Start | None
    odometry: Mapping[int, Odometry] = field(default_factory=dict)
    truth: Mapping[int, Pose] | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """Cameras, boxes, and optional further data of a recording.

    rate: frames per second. cameras: name → RecordingCamera. detections: camera → FrameBoxes; a fixed camera without an entry has no views.
    truth: frame from 0 → ids (k,) and positions (k, 3) m of people, or None. frames: number of frames, 0 for up to the last with data.
    area: (2, 2) m, the lowest and highest x, y in which people are reported, or None. ground: the terrain. height: band of body heights, m.
    searched: fixed camera → frames in which people were searched, if not all. In other frames the camera has no view.
    clocks: camera → times of its frames; all fields then count its own frames. Other cameras are in step with the recording (clocks.py).
    stamps: frame → its time in s, empty for an even rate. None takes the stamps that all cameras share; a part of the recording keeps them.
    appearances: camera → frame → vectors (n, d) of the boxes of that frame, as in Detections; they are dropped where the boxes are replaced.
    covariances: camera → frame → (n, 3) rad²: c00, c01, c11 of the detector's covariance, as in Detections; dropped likewise.
    visible_parts: camera → frame → (n, 5): left, top, width, height px of the visible part of each box, and the share seen; dropped likewise.
    robot_detections: camera → frame → the other robots that it sees; empty where no detector of robots runs.
    visible: frame → (k,) the largest share of each true person that a camera sees, in [0, 1]; 1 for frames without an entry.
    occluders: height map of walls and furniture, or None. pillars: as in Setup. images: camera → its images. robots: name → RecordingRobot.

    Raises ValueError for a rate, height or frames out of bounds, a missing robot, and for data of an unknown camera.
    """

    rate: float
    cameras: Mapping[str, RecordingCamera]
    detections: Mapping[str, FrameBoxes] = field(default_factory=dict)
    truth: Mapping[int, tuple[Ints, Array]] | None = None
    frames: int = 0
    area: ArrayLike | None = None
    ground: Ground = Flat()
    height: tuple[float, float] = STATURE
    occluders: Ground | None = None
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))
    images: Mapping[str, ImageSource] = field(default_factory=dict)
    robots: Mapping[str, RecordingRobot] = field(default_factory=dict)
    visible: Mapping[int, Array] = field(default_factory=dict)
    appearances: Mapping[str, FrameVectors] = field(default_factory=dict)
    covariances: Mapping[str, FrameVectors] = field(default_factory=dict)
    visible_parts: Mapping[str, FrameVectors] = field(default_factory=dict)
    robot_detections: Mapping[str, Mapping[int, RobotDetections]] = field(default_factory=dict)
    searched: Mapping[str, frozenset[int]] = field(default_factory=dict)
    clocks: Mapping[str, CameraClock] = field(default_factory=dict)
    stamps: Mapping[int, float] | None = None
    source: Mapping[str, Any] = field(default_factory=lambda: {"source": "recording"})

    def __post_init__(self) -> None:
        if not MIN_RATE <= self.rate <= MAX_RATE:
            raise ValueError(f"rate is {self.rate}, needs more than 0 and at most {MAX_RATE:g} frames/s, and at least {MIN_RATE:g}")
        if not self.cameras:
            raise ValueError("cameras is empty, needs at least one")
        if self.area is not None:
            object.__setattr__(self, "area", _area(self.area))
        low, high = self.height
        if not 0 < low < high < np.inf:
            raise ValueError(f"height is {list(self.height)}, needs two numbers of metres above 0, the lower first")
        for kind in ("detections", "images", *OF_BOXES, "searched", "clocks"):
            if unknown := sorted(set(getattr(self, kind)) - set(self.cameras)):
                raise ValueError(f"{kind} has camera {unknown[0]!r}, needs one of {', '.join(self.cameras)}")
        for name, camera in self.cameras.items():
            if camera.robot is not None and camera.robot not in self.robots:
                raise ValueError(
                    f"cameras.{name}.robot is {camera.robot!r}, needs one of {', '.join(self.robots) or 'robots.json, which is missing'}"
                )
            if camera.robot is None and name in self.robots:
                raise ValueError(f"camera {name!r} is fixed and has the name of a robot, needs another name")
        if self.stamps is None:
            first, *others = [self.clocks[name].stamps if name in self.clocks else None for name in self.cameras]
            object.__setattr__(self, "stamps", first if first is not None and all(one == first for one in others) else {})
        if self.frames == 0:
            object.__setattr__(self, "frames", self._last_frame() + 1)
        # A view shortly after the last frame is in its tick.
        last = self._last_frame(near_frame(self.rate) + 1e-9)
        if not last < self.frames <= MAX_FRAMES:
            raise ValueError(f"frames is {self.frames}, needs more than {last}, the last with data, and at most {MAX_FRAMES}")
        if self.frames * len(self.cameras) > MAX_VIEWS:
            raise ValueError(f"frames is {self.frames} of {len(self.cameras)} cameras, needs at most {MAX_VIEWS} views in all")
        for kind, length in OF_BOXES.items():
            for name, vectors in getattr(self, kind).items():
                for frame, of_frame in vectors.items():
                    count = len(self.detections.get(name, {}).get(frame, NO_BOXES)[0])
                    if np.ndim(of_frame) != 2 or len(of_frame) != count or length not in ("d", str(of_frame.shape[1])):
                        shape = f"have shape {np.shape(of_frame)}, needs ({count}, {length})"
                        raise ValueError(f"{kind} of {name}, frame {frame}, {shape}, one for each box")

    def check_heights(self) -> None:
        """Raises ValueError for a fixed camera that is not above the ground. `pilsim check` opens such a recording and reports the error."""
        for name, camera in self.fixed.items():
            if "pose" in camera.unknown:
                continue
            x, y, z = camera.pose.translation
            ground = float(self.ground.height_at(camera.pose.translation[None])[0])
            if not z > ground:
                raise ValueError(
                    f"cameras.{name}.t puts the camera at ({x:.2f}, {y:.2f}, {z:.2f}) m, {ground - z:.2f} m below the ground, needs a place above it;"
                    " x_camera = R x_world + t in metres; `pilsim check` tells what is wrong"
                )

    def check_calibrated(self) -> None:
        """Raises ValueError where the pose of a camera is not known."""
        if unknown := [name for name, camera in self.cameras.items() if camera.unknown]:
            raise ValueError(f"cameras {', '.join(unknown)} have no R and t; `pilsim calibrate` finds them by the people who walk before them")

    def _last_frame(self, near: float = TOGETHER) -> int:
        """The last frame that has boxes, an image file, truth or odometry; −1 without any. near: as in _frame_of."""
        files = {name: source.files for name, source in self.images.items() if isinstance(source, ImageFiles)}
        of_cameras = [self._frame_of(name, max(of[name]), near) for of in (self.detections, files) for name in of if of[name]]
        others: list[Iterable[int]] = [self.truth or (), *(robot.odometry for robot in self.robots.values())]
        return max([*of_cameras, *(max(frames, default=-1) for frames in others)], default=-1)

    def _frame_of(self, name: str, frame: int, near: float) -> int:
        """The first frame of the recording that is at most `near` s before a camera's own frame; a robot's camera counts these frames itself."""
        if self._counts_along(name):
            return frame
        stamps = self.clocks[name].stamps
        if stamps is not None and frame not in stamps:
            raise ValueError(f"{name} has data in frame {frame + 1}, for which times.csv has no row")
        time, shared = self.clocks[name].time(frame, self.rate) - near, self.stamps or {0: 0.0}
        known = sorted(shared)
        times = [shared[k] for k in known]
        # Frames before and after the stamps have the rate of the recording.
        beyond = (time - np.clip(time, times[0], times[-1])) * self.rate
        return max(0, int(np.ceil(np.interp(time, times, known) + beyond)))

    def _counts_along(self, name: str) -> bool:
        """Whether a camera's own frames are those of the recording."""
        return name not in self.clocks or self.cameras[name].robot is not None or self._has_stamps(name)

    def _has_stamps(self, name: str) -> bool:
        """Whether the stamps of a camera are those of the recording's frames."""
        return bool(self.stamps) and name in self.clocks and self.clocks[name].stamps == self.stamps

    @cached_property
    def schedule(self) -> Schedule:
        """The times of the recording's frames, and the ticks of its cameras."""
        robots = {name: camera.robot is not None for name, camera in self.cameras.items()}
        return Schedule(self.rate, self.frames, self.clocks, robots, self.stamps or {})

    def in_step(self) -> Recording:
        """The recording without clocks. Data of cameras with clocks move to the frames nearest in time; the cameras are not searched in other frames.

        Functions that compare cameras frame by frame use it.
        """
        if not self.clocks:
            return self
        number = {name: {f: k for f, (k, _) in self._nearest(name).items()} for name in self.clocks if not self._counts_along(name)}

        def moved(kind: str) -> dict[str, Any]:
            return {
                name: of if name not in number else {number[name][f]: value for f, value in of.items() if f in number[name]}
                for name, of in getattr(self, kind).items()
            }

        searched = {name: frozenset(k for f, k in frames.items() if f in self.searched.get(name, frames)) for name, frames in number.items()}
        files = {name: source for name, source in self.images.items() if name not in number or isinstance(source, ImageFiles)}
        images: dict[str, ImageSource] = {
            name: ImageFiles({number[name][f]: path for f, path in source.files.items() if f in number[name]})
            if name in number and isinstance(source, ImageFiles) else source
            for name, source in files.items()
        }  # fmt: skip
        vectors: dict[str, Any] = {kind: moved(kind) for kind in OF_BOXES}
        return replace(
            self, clocks={}, stamps={}, images=images, searched={**self.searched, **searched}, detections=moved("detections"),
            robot_detections=moved("robot_detections"), **vectors,
        )  # fmt: skip

    def apart(self, name: str) -> Array:
        """Delays (n,) s of a camera's pictures after the frames of `in_step` that hold them."""
        nearest = self._nearest(name) if name in self.clocks and not self._has_stamps(name) else {}
        return np.array([apart for _, apart in nearest.values()])

    def _nearest(self, name: str) -> dict[int, tuple[int, float]]:
        """As Schedule.nearest, within half a period of the recording."""
        return self.schedule.nearest(name, 0.5 / self.rate + TOGETHER)

    def own_frames(self, name: str) -> Iterable[int]:
        """The frames of a camera up to the end of the recording, by its clock."""
        if self._counts_along(name) or not self.frames:
            return range(self.frames)
        return self.clocks[name].frames(self.schedule.end, self.rate)

    def truth_of(self, name: str) -> Mapping[int, tuple[Ints, Array]]:
        """Own frame of a camera → ids (k,) and places (k, 3) m of people at its time, interpolated between frames of the truth."""
        truth = self.truth or {}
        if self._counts_along(name):
            return truth
        known, out = sorted(truth), dict[int, tuple[Ints, Array]]()
        times = self.schedule.times[known]
        for frame in self.own_frames(name):
            time = self.clocks[name].time(frame, self.rate)
            k = int(np.searchsorted(times, time - TOGETHER))
            if k < len(known) and times[k] <= time + TOGETHER:
                out[frame] = truth[known[k]]
            elif 0 < k < len(known):
                (before, start), (after, end) = truth[known[k - 1]], truth[known[k]]
                ids, i, j = np.intersect1d(before, after, return_indices=True)
                share = (time - times[k - 1]) / (times[k] - times[k - 1])
                out[frame] = ids, (1 - share) * start[i] + share * end[j]
        return out

    @property
    def fixed(self) -> dict[str, RecordingCamera]:
        """The cameras that stand still."""
        return {name: camera for name, camera in self.cameras.items() if camera.robot is None}

    def with_detections(self, detections: Mapping[str, FrameBoxes]) -> Recording:
        """The recording with other detections of the named cameras. It has at least as many frames as before."""
        kept: dict[str, Any] = {kind: {n: v for n, v in getattr(self, kind).items() if n not in detections} for kind in OF_BOXES}
        searched = {name: frames for name, frames in self.searched.items() if name not in detections}
        boxes = {**self.detections, **detections}
        changed = replace(self, frames=0, detections=boxes, searched=searched, **kept)
        return replace(changed, frames=max(self.frames, changed.frames))

    def pose_at(self, camera: RecordingCamera, frame: int) -> Pose | None:
        """T_world_camera of a camera in a frame, None where the true pose of its robot is not known."""
        if camera.robot is None:
            return camera.pose
        truth = self.robots[camera.robot].truth or {}
        return truth[frame] @ camera.pose if frame in truth else None

    def choose(self, cameras: Iterable[str]) -> Recording:
        """The recording with only these cameras. Raises ValueError for an unknown camera and for one that is named twice."""
        names = list(cameras)
        for name in names:
            if name not in self.cameras:
                raise ValueError(f"camera is {name!r}, needs one of {', '.join(self.cameras)}")
        if len(set(names)) != len(names):
            raise ValueError(f"cameras are {','.join(names)}, needs each once")
        chosen = {name: self.cameras[name] for name in names}
        carriers = {camera.robot for camera in chosen.values()}
        parts: dict[str, Any] = {
            kind: {name: getattr(self, kind)[name] for name in names if name in getattr(self, kind)}
            for kind in ("detections", *OF_BOXES, "searched", "clocks", "images")
        }
        return replace(
            self,
            cameras=chosen,
            robot_detections={name: _of_robots(self.robot_detections[name], carriers) for name in names if name in self.robot_detections},
            robots={name: robot for name, robot in self.robots.items() if name in carriers},
            **parts,
        )

    def cut(self, first: int, end: int) -> Recording:
        """The frames from `first` to `end` − 1; `first` becomes frame 0. Raises ValueError for missing frames."""
        if not 0 <= first < end <= self.frames:
            raise ValueError(f"frames are {first}:{end}, needs 0 to {self.frames} with the lower first")

        spans = {name: self._span(name, first, end) for name in self.cameras}
        begin = float(self.schedule.times[first]) if self.clocks else 0.0

        def part(by_frame: Mapping[int, Any], name: str = "") -> dict[int, Any]:
            low, high = spans.get(name, (first, end))
            return {frame - low: value for frame, value in by_frame.items() if low <= frame < high}

        vectors: dict[str, Any] = {kind: {name: part(of, name) for name, of in getattr(self, kind).items()} for kind in OF_BOXES}
        robots = {
            name: replace(robot, odometry=part(robot.odometry), truth=None if robot.truth is None else part(robot.truth))
            for name, robot in self.robots.items()
        }
        if robots and first:
            raise ValueError(f"frames begin at {first}, needs 0 where robots move, since their start is known at frame 0 alone")
        return replace(
            self,
            detections={name: part(boxes, name) for name, boxes in self.detections.items()},
            searched={name: frozenset(part(dict.fromkeys(frames), name)) for name, frames in self.searched.items()},
            clocks={name: self._cut_clock(name, spans[name], begin) for name in self.clocks},
            stamps=_cut_stamps(self.stamps, (first, end), begin) if self.stamps else {},
            robot_detections={name: part(seen, name) for name, seen in self.robot_detections.items()},
            truth=None if self.truth is None else part(self.truth),
            visible=part(self.visible),
            images={name: source.cut(*spans[name]) for name, source in self.images.items()},
            frames=end - first,
            robots=robots,
            **vectors,
        )

    def _span(self, name: str, first: int, end: int) -> tuple[int, int]:
        """First and end of a camera's own frames in the ticks of the frames from `first` to `end` − 1 of the recording."""
        if self._counts_along(name):
            return first, end
        inside = [tick.frames[name] for tick in self.schedule.ticks() if name in tick.frames and first <= tick.frame < end]
        return (min(inside), max(inside) + 1) if inside else (0, 0)

    def _cut_clock(self, name: str, span: tuple[int, int], begin: float) -> CameraClock:
        """The clock of a camera whose frames begin at the first one of `span`, in a recording that begins at `begin` s."""
        clock = self.clocks[name]
        if clock.stamps is not None:
            return replace(clock, stamps=_cut_stamps(clock.stamps, span, begin))
        return replace(clock, offset=clock.time(span[0], self.rate) - begin)

    def setup(self, calibrated: bool = True) -> Setup:
        """The constant inputs of the tracker. A fixed camera is a robot of its name that never moves. Raises ValueError as check_heights.

        calibrated: whether ValueError is raised for a camera without a pose. Finding people in images needs no poses.
        """
        if calibrated:
            self.check_calibrated()
        self.check_heights()
        mounts, starts = {}, dict[str, Start | None]()
        for name, camera in self.cameras.items():
            period = self.clocks[name].period(self.rate) if name in self.clocks else 0.0
            if camera.robot is None:
                mounts[name] = Mount(camera.camera, Pose.identity(), name, period=period)
                starts[name] = Start(camera.pose, np.zeros((6, 6)))
            else:
                mounts[name] = Mount(camera.camera, camera.pose, camera.robot, period=period, own_body=camera.own_body)
                starts[camera.robot] = self.robots[camera.robot].start
        area = None if self.area is None else np.asarray(self.area)
        return Setup(mounts, self.ground, starts, 1 / self.rate, area=area, height=self.height, occluders=self.occluders, pillars=self.pillars)

    def sequence(self, images: bool = False, calibrated: bool = True) -> Sequence:
        """The recording as the input of the tracker.

        images: whether all images are included. Those of cameras on robots always are, because SLAM needs them.
        calibrated: as in setup. Raises ValueError where images are asked for and there are none.
        """
        setup = self.setup(calibrated)
        planned = self.schedule.ticks() if self.clocks else (TickViews(k / self.rate, k, True, self._all(k), {}) for k in range(self.frames))
        ticks: Ticks = TicksInMemory(tuple(self._tick(one) for one in planned), setup.mounts)
        wanted = {name: source for name, source in self.images.items() if images or self.cameras[name].robot is not None}
        if images and not wanted:
            raise ValueError(f"no images, neither video/CAMERA.mp4 nor images/CAMERA/000001.jpg, of {', '.join(self.cameras)}")
        if wanted:
            ticks = TicksWithImages(ticks, wanted, {name: (self.cameras[name].camera.height, self.cameras[name].camera.width) for name in wanted})
        return Sequence(setup, ticks, self._truth(), dict(self.source))

    @cached_property
    def _empty_views(self) -> dict[str, View]:
        """Camera → the view that all frames without boxes share, because there may be many."""
        nobody = NO_ROBOT if self.robot_detections else None
        return {name: View(name, NOBODY, robot_detections=nobody) for name in self.cameras}

    def _all(self, frame: int) -> dict[str, int]:
        return dict.fromkeys(self.cameras, frame)

    def _tick(self, planned: TickViews) -> Tick:
        views = []
        for name, index in planned.frames.items():
            camera = self.cameras[name]
            if camera.robot is None and name not in self.detections:
                continue  # an empty view would mean that the camera sees nobody
            if camera.robot is None and index not in self.searched.get(name, (index,)):
                continue
            found = self.detections.get(name, {}).get(index)
            odometry = self.robots[camera.robot].odometry.get(index) if camera.robot is not None else None
            robots = self.robot_detections.get(name, {}).get(index, NO_ROBOT) if self.robot_detections else None
            if found is None and odometry is None and not robots and not self.clocks:
                views.append(self._empty_views[name])
                continue
            detections = NOBODY if found is None else detections_from_boxes(camera.camera, *found)
            if len(detections) and index in (vectors := self.appearances.get(name, {})):
                detections = replace(detections, appearance=vectors[index])
            if len(detections) and index in (stated := self.covariances.get(name, {})):
                detections = replace(detections, covariance=stated[index][:, [0, 1, 1, 2]].reshape(-1, 2, 2))
            if found is not None and len(detections) and index in (parts := self.visible_parts.get(name, {})):
                detections = replace(detections, feet_seen=feet_seen(found[0], parts[index]))
            frame = index if self.clocks else None
            views.append(View(name, detections, odometry=odometry, robot_detections=robots, frame=frame, later=planned.later.get(name, 0.0)))
        return Tick(planned.frame, planned.time, tuple(views), planned.reported)

    def _truth(self) -> tuple[Truth, ...] | None:
        """The truth of frames 0 to the last that has an entry. Later frames are not labeled."""
        if self.truth is None:
            return None
        nobody = Truth(0, {}, np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, len(self.cameras))))
        out = []
        for index in range(max(self.truth, default=-1) + 1):
            ids, positions = self.truth.get(index, (nobody.person_id, nobody.feet))
            visible = self.visible.get(index, np.ones(len(ids)))
            poses = {name: robot.truth[index] for name, robot in self.robots.items() if robot.truth is not None and index in robot.truth}
            # A frame is often empty, and a truth with new arrays takes 1 kB and some time.
            empty = not poses and not len(ids)
            out.append(nobody.at(index) if empty else Truth(index, poses, ids, positions, np.tile(visible[:, None], len(self.cameras))))
        return tuple(out)


def _cut_stamps(stamps: Mapping[int, float], span: tuple[int, int], begin: float) -> dict[int, float]:
    return {f - span[0]: time - begin for f, time in stamps.items() if span[0] <= f < span[1]} or {0: -LONGEST}


def _of_robots(seen: Mapping[int, RobotDetections], robots: Collection[str | None]) -> dict[int, RobotDetections]:
    """The detections of the given robots only."""
    return {frame: of_frame.choose([name for name in of_frame.robot if name in robots]) for frame, of_frame in seen.items()}


def _area(area: ArrayLike) -> Array:
    try:
        corners = np.asarray(area, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"area is {str(area)[:80]!r}, needs two corners x, y in metres, the lowest first") from None
    if corners.shape != (2, 2) or not np.isfinite(corners).all() or not (corners[0] < corners[1]).all():
        raise ValueError(f"area is {corners.tolist()}, needs two corners x, y in metres, the lowest first")
    return corners
