"""The command `view`: a sequence with tracks in the Rerun viewer, or as a Rerun recording.

Rerun is an optional dependency. It is imported on demand; without it, one line says what to install.
Entities: `world` in metres, `panoramas/CAMERA` for images of any camera, `off` for the robots' errors.
"""

from __future__ import annotations

import errno
import importlib
import os
import shutil
import sys
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import tee
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
import trimesh

from sim.visualization.overlays import STANDING, colour_of, draw_boxes
from tracker.formats.opening import format_of, open_recording, open_sequence
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, Ints, Pose, quaternion_from_rotation
from tracker.geometry.cameras import Camera
from tracker.geometry.ground import Flat, Grid
from tracker.io.atomic import new_file
from tracker.io.file_lock import output_file_lock
from tracker.io.progress import progress_bar
from tracker.pipeline import track
from tracker.sequence.results import Results, read_results
from tracker.types import Estimate, Sequence, Tick, Truth

SIGMAS = 2.0
"""Half sizes of an ellipsoid, standard deviations."""
TRAIL = 18
"""Length of a person's trail, frames."""
BODY = (1.3, 0.22)
"""m: length (between the centres of its ends) and radius of the capsule that stands for a person."""
CHASSIS = (0.35, 0.25, 0.15)
"""m: half sizes of the box that stands for a robot."""
FRUSTUM = 1.0
"""m: length of the lines of sight that show a camera."""
SIDE_POINTS = 12
"""Points along a side of an image at which its lines of sight are drawn; distortion bends the sides."""
CUT_HEIGHT = 0.7
"""m above the ground at which objects are cut off, so that walls do not hide people."""
LARGEST_MESH = 240
"""Largest number of points along a side of the terrain mesh."""
JPEG_QUALITY = 80
LIGHT_DIRECTION = np.array([-0.6, 0.5, 0.62])
"""Direction to the light that shades the terrain, of unit length within 1 %."""
GREY, ROYAL = (120, 120, 120), (65, 105, 225)
RESERVE = 16 << 20
"""Bytes that must be free on the disk before a frame is written."""


SceneFrame = tuple[Tick, Estimate | None]
"""A tick, and the estimate of a tracker or None."""


class RerunScene:
    """Logs a sequence to a recording stream of Rerun, frame by frame. It holds the trails of people and robots."""

    def __init__(self, module: Any, stream: Any, sequence: Sequence) -> None:
        self.rerun, self.stream, self.sequence = module, stream, sequence
        self._trails: dict[tuple[str, int | str], deque[Array]] = defaultdict(lambda: deque(maxlen=TRAIL))
        self._robot_trails: dict[tuple[str, str], list[Array]] = defaultdict(list)

    def blueprint(self) -> Any:
        """Layout of the viewer: the world on the left, panoramas and the robots' errors on the right."""
        views = self.rerun.blueprint
        panoramas = [views.Spatial2DView(origin=f"panoramas/{name}", name=name) for name in self.sequence.setup.mounts]
        moving = self.sequence.setup.moving_robots
        right = [*panoramas[:4], *([views.TimeSeriesView(origin="off", name="robots' error [m]")] if moving else [])]
        target, eye = self._initial_view()
        controls = views.EyeControls3D(position=eye, look_target=target, eye_up=[0.0, 0.0, 1.0])
        world = views.Spatial3DView(origin="world", name="world", eye_controls=controls)
        return views.Blueprint(views.Horizontal(world, views.Vertical(*right), column_shares=[3, 2]), collapse_panels=True)

    def _initial_view(self) -> tuple[Array, Array]:
        """Target and eye (3,) m of the initial view: all robots and people of the first frame, from above."""
        truth = self.sequence.truth[0] if self.sequence.truth else None
        poses = [start.T_world_robot for start in self.sequence.setup.starts.values() if start]
        places = [pose.translation for pose in (truth.T_world_robot.values() if truth else poses)]
        points = np.array([*places, *(truth.feet if truth else ())]).reshape(-1, 3)
        if not len(points):
            points = np.zeros((1, 3))
        target = (points.min(axis=0) + points.max(axis=0)) / 2
        away = max(float(np.ptp(points[:, :2], axis=0).max()), 8.0)
        return target, target + away * np.array([-0.35, -0.75, 1.0])

    def log_static(self) -> None:
        """Log static entities: the world frame, fixed cameras, the terrain and the objects on it."""
        self._log("world", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        setup = self.sequence.setup
        for name, mount in setup.mounts.items():
            if setup.is_fixed(mount.robot) and (start := setup.starts[mount.robot]) is not None:
                self._camera(f"world/cameras/{name}", mount.camera, start.T_world_robot @ mount.T_body_camera, name)
        ground, tops = setup.ground, setup.occluders
        if isinstance(ground, Grid):
            points, triangles, heights = mesh(ground)
            span = max(float(np.ptp(heights)), 1e-6)
            colours = (255 * matplotlib.colormaps["YlGn"](0.1 + 0.4 * (heights - heights.min()) / span)[:, :3]).astype(np.uint8)
            self._mesh("world/terrain", points, triangles, colours)
            if isinstance(tops, Grid):
                over, triangles, heights = mesh(tops)
                stands = heights - ground.height_at(over) > STANDING
                kept = triangles[stands[triangles].any(axis=1)]
                if len(kept):
                    over[:, 2] = np.minimum(heights, ground.height_at(over) + CUT_HEIGHT)
                    self._mesh("world/standing", over, kept, np.full((len(over), 3), 130, np.uint8))
        elif isinstance(ground, Flat):
            low, high = np.array([[-20.0, -20.0], [20.0, 20.0]]) if setup.area is None else setup.area
            middle, half = [*(low + high) / 2, ground.level], [*(high - low) / 2, 0.0]
            self._log("world/ground", self.rerun.Boxes3D(centers=[middle], half_sizes=[half], colors=[GREY]), static=True)

    def log_frame(self, tick: Tick, estimate: Estimate | None) -> None:
        """Log one frame: truth and estimates, if there are any."""
        labelled = self.sequence.truth or ()
        # Frames after the last labelled one have no truth.
        truth = labelled[tick.index] if tick.index < len(labelled) else None
        self.stream.set_time("frame", sequence=tick.index)
        self.stream.set_time("time", duration=tick.time)
        if truth is not None:
            self._people("world/truth/people", truth.person_id, truth.feet, GREY)
            self._robots("world/truth/robots", truth.T_world_robot, ROYAL)
        if estimate is not None:
            self._estimates(estimate, truth)
        self._images(tick, estimate, truth)

    def _estimates(self, estimate: Estimate, truth: Truth | None) -> None:
        self._people("world/tracks", estimate.target_id, estimate.position, None)
        # Tracks from files have covariance 0, because the files do not hold it.
        known = [k for k, P in enumerate(estimate.covariance) if P.any()]
        spread = [(estimate.position[k], estimate.covariance[k]) for k in known]
        self._ellipsoids("world/tracks/covariance", spread, [colour_of(int(estimate.target_id[k])) for k in known])
        self._robots("world/robots", estimate.T_world_robot, (220, 20, 60))
        turned = []
        for robot, pose in estimate.T_world_robot.items():
            if self.sequence.setup.is_fixed(robot):
                continue
            # The translation of the right tangent is along the axes of the body.
            turned.append((pose.translation, pose.rotation @ estimate.robot_covariance[robot][:3, :3] @ pose.rotation.T))
            if truth is not None and robot in truth.T_world_robot:
                error = float(np.linalg.norm(pose.translation - truth.T_world_robot[robot].translation))
                self._log(f"off/{robot}", self.rerun.Scalars(error))
        self._ellipsoids("world/robots/covariance", turned, [(220, 20, 60)] * len(turned))

    def _people(self, path: str, ids: Ints, feet: Array, colour: tuple[int, int, int] | None) -> None:
        colours = [colour or colour_of(int(k)) for k in ids]
        for identity, place in zip(ids.tolist(), feet, strict=True):
            self._trails[path, identity].append(place)
        length, radius = BODY
        # Truth is drawn as wires, so that the estimate of the same person is visible inside.
        fill = self.rerun.components.FillMode.MajorWireframe if colour else self.rerun.components.FillMode.Solid
        bodies = self.rerun.Capsules3D(
            lengths=[length] * len(ids),
            radii=[radius] * len(ids),
            fill_mode=fill,
            translations=feet + np.array([0.0, 0.0, radius]),
            colors=colours,
            labels=[str(k) for k in ids],
        )
        self._log(path, bodies)
        trails = [np.array(self._trails[path, identity]) + np.array([0.0, 0.0, 0.03]) for identity in ids.tolist()]
        self._log(f"{path}/trails", self.rerun.LineStrips3D(trails, colors=colours, radii=0.03))

    def _robots(self, path: str, poses: dict[str, Pose], colour: tuple[int, int, int]) -> None:
        for robot, pose in poses.items():
            if self.sequence.setup.is_fixed(robot):
                continue
            for name, mount in self.sequence.setup.mounts.items():
                if mount.robot == robot:
                    self._camera(f"{path}/{robot}/{name}", mount.camera, pose @ mount.T_body_camera)
            self._robot_trails[path, robot].append(pose.translation)
            w, x, y, z = quaternion_from_rotation(pose.rotation)
            centre = pose.apply(np.array([[0.0, 0.0, CHASSIS[2]]]))
            box = self.rerun.Boxes3D(half_sizes=[CHASSIS], centers=centre, quaternions=[[x, y, z, w]], colors=[colour], labels=[robot])
            self._log(f"{path}/{robot}", box)
            self._log(f"{path}/{robot}/trail", self.rerun.LineStrips3D([np.array(self._robot_trails[path, robot])], colors=[colour], radii=0.03))

    def _ellipsoids(self, path: str, spread: list[tuple[Array, Array]], colours: list[tuple[int, int, int]]) -> None:
        axes = [ellipsoid(P) for _, P in spread]
        sizes, turns = [size for size, _ in axes], [turn for _, turn in axes]
        centres = [centre for centre, _ in spread]
        self._log(path, self.rerun.Ellipsoids3D(half_sizes=sizes, centers=centres, quaternions=turns, colors=colours))

    def _images(self, tick: Tick, estimate: Estimate | None, truth: Truth | None) -> None:
        for view in tick.views:
            if view.image is None:
                continue
            mount, image = self.sequence.setup.mounts[view.camera], view.image
            pose = estimate.T_world_robot.get(mount.robot) if estimate else truth.T_world_robot.get(mount.robot) if truth else None
            if estimate is not None and pose is not None:
                image = draw_boxes(image.copy(), mount.camera, pose @ mount.T_body_camera, estimate.target_id.tolist(), estimate.position)
            _, data = cv2.imencode(".jpg", image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            self._log(f"panoramas/{view.camera}", self.rerun.EncodedImage(contents=data.tobytes(), media_type="image/jpeg"))

    def _camera(self, path: str, camera: Camera, T_world_camera: Pose, name: str | None = None) -> None:
        """Lines of sight of a camera; static and with its name where one is given."""
        strips = [T_world_camera.apply(FRUSTUM * strip) for strip in lines_of_sight(camera)]
        labels = None if name is None else [name] + [""] * (len(strips) - 1)
        self._log(path, self.rerun.LineStrips3D(strips, colors=[ROYAL] * len(strips), radii=0.01, labels=labels), static=name is not None)

    def _mesh(self, path: str, points: Array, triangles: Ints, colours: Any) -> None:
        facing = trimesh.Trimesh(points, triangles, process=False).vertex_normals
        # Shading is part of the colours, because the viewer's own light may leave slopes flat.
        shaded = (colours * (0.6 + 0.4 * np.clip(facing @ LIGHT_DIRECTION, 0, 1))[:, None]).astype(np.uint8)
        body = self.rerun.Mesh3D(vertex_positions=points, triangle_indices=triangles, vertex_normals=facing, vertex_colors=shaded)
        self._log(path, body, static=True)

    def _log(self, path: str, what: Any, static: bool = False) -> None:
        self.stream.log(path, what, static=static)


def lines_of_sight(camera: Camera) -> list[Array]:
    """Strips (n, 3) in the camera's frame, unit length from the origin, that show what an image covers.

    For an image with a border: the border, and lines from the camera to its corners. For a panorama: three rows around, and a line ahead.
    Pixels without a line of sight, beyond the fold of a distortion, are left out.
    """
    first, along = camera.pixel_centre - 0.5, np.linspace(0.0, 1.0, SIDE_POINTS + 1)
    size = np.array([camera.width, camera.height])
    if camera.wraps:
        around = np.linspace(0.0, 1.0, 4 * SIDE_POINTS + 1)
        drawn = [np.column_stack([around, np.full(len(around), row)]) for row in (0.25, 0.5, 0.75)]
        single = np.array([[0.5, 0.5]])
    else:
        none, one = np.zeros(len(along)), np.ones(len(along))
        sides = [(along, none), (one, along), (along[::-1], one), (none, along[::-1])]
        drawn = [np.concatenate([np.column_stack(side) for side in sides])]
        single = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    strips = [camera.bearings_from_pixels(first + size * part) for part in drawn]
    strips += [np.array([np.zeros(3), ray]) for ray in camera.bearings_from_pixels(first + size * single)]
    strips = [strip[np.isfinite(strip).all(axis=1)] for strip in strips]
    return [strip for strip in strips if len(strip) > 1]


def mesh(grid: Grid) -> tuple[Array, Ints, Array]:
    """Mesh of a grid: points (n, 3) m, triangles (m, 3), heights (n,) m. It is subsampled to about LARGEST_MESH points a side."""
    step = -(-max(grid.heights.shape) // LARGEST_MESH)
    z = grid.heights[::step, ::step]
    rows, columns = z.shape
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    points = np.column_stack([grid.origin[0] + grid.spacing * step * x.ravel(), grid.origin[1] + grid.spacing * step * y.ravel(), z.ravel()])
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + columns + 1])
    upper = np.column_stack([corner, corner + columns + 1, corner + columns])
    return points, np.vstack([lower, upper]), z.ravel()


def ellipsoid(covariance: Array) -> tuple[Array, Array]:
    """Ellipsoid of a covariance (3, 3) m²: half sizes (3,) m of SIGMAS standard deviations, and the rotation as a quaternion xyzw."""
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    w, x, y, z = quaternion_from_rotation(axes)
    return SIGMAS * np.sqrt(np.clip(variances, 0.0, None)), np.array([x, y, z, w])


def rerun() -> Any:
    """The module `rerun`. Raises ValueError, which says what to install, if it is missing."""
    try:
        return importlib.import_module("rerun")
    except ImportError:
        raise ValueError('view needs Rerun, which is not installed: pip install "pilsim[view]" (or: pip install rerun-sdk)') from None


def show(folder: Path, results: Path | None = None, tracked: bool = False, save: Path | None = None) -> None:
    """Open the viewer on a sequence, or write a recording to the file `save` atomically.

    folder: a source, or a folder with `sequence` and `track` in it. results: a folder of tracks, or None. tracked: run the tracker instead.
    Raises ValueError without Rerun or a screen, for a file name that does not end in .rrd, and for files that cannot be read.
    """
    module = rerun()
    if save is not None and save.suffix != ".rrd":
        raise ValueError(f"--save is {save}, needs a name that ends in .rrd")
    source, given = _sequence_and_tracks(folder, results)
    format_of(source)
    if save is None and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ValueError("there is no screen here for the viewer: give --save FILE.rrd, and open that elsewhere with `rerun FILE.rrd`")
    if tracked and results is not None:
        raise ValueError("--results and --track exclude each other: tracks are read, or made now")
    read = read_results(given) if given is not None and not tracked else None
    sequence = open_sequence(source, _with_images(source, SourceOptions.of_run(read.run) if read else SourceOptions()))
    if read is not None and read.run.get("provenance", sequence.provenance) != sequence.provenance:
        raise ValueError(f"{given}: these tracks were made from another source than {source}")
    stream = module.RecordingStream("pilsim")
    scene = RerunScene(module, stream, sequence)
    frames = _tracked_now(sequence) if tracked else ((tick, None if read is None else read_frame(read, tick.index)) for tick in sequence.ticks)
    if save is None:
        stream.spawn(default_blueprint=scene.blueprint())
        _play(scene, frames)
        return
    with output_file_lock(save):
        _write(scene, frames, save)


def _write(scene: RerunScene, frames: Iterator[SceneFrame], save: Path) -> None:
    def check_space() -> None:
        if shutil.disk_usage(Path(os.path.realpath(save)).parent).free < RESERVE:
            raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)} (less than {RESERVE >> 20} MiB are free)", str(save))

    with new_file(save) as part:
        # Rerun waits without end where the disk is full.
        check_space()
        scene.stream.save(part, default_blueprint=scene.blueprint())
        _play(scene, frames, check_space)
        scene.stream.flush()
        scene.stream.disconnect()
    print(f"{save}: {len(scene.sequence.ticks)} frames, {save.stat().st_size / 1e6:.1f} MB; `rerun {save}` opens it")


def _with_images(source: Path, options: SourceOptions) -> SourceOptions:
    """The options with the images of a recording that has some. Sequences of pilsim always have theirs."""
    there = format_of(source).read is not None and bool(open_recording(source, options).images)
    return replace(options, images=there)


def _sequence_and_tracks(folder: Path, results: Path | None) -> tuple[Path, Path | None]:
    """Folders of the sequence and of the tracks that `folder` refers to."""
    if (folder / "sequence").is_dir():
        beside = folder / "track"
        return folder / "sequence", results or (beside if beside.is_dir() else None)
    return folder, results


def _play(scene: RerunScene, frames: Iterator[SceneFrame], check: Callable[[], None] = lambda: None) -> None:
    """Show all frames. check: called before each frame."""
    scene.log_static()
    for tick, estimate in progress_bar(frames, total=len(scene.sequence.ticks), desc="frames", unit="frame"):
        check()
        scene.log_frame(tick, estimate)


def read_frame(results: Results, k: int) -> Estimate:
    """The estimate of frame k from the files of a run. Covariances of targets are 0, because the files do not hold them."""
    ids, places = results.tracks.get(k, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
    poses = {robot: pose for robot, of_robot in results.poses.items() if (pose := of_robot[k]) is not None}
    spread = {robot: P for robot, of_robot in results.covariances.items() if (P := of_robot[k]) is not None}
    return replace(Estimate.of_robots(k, poses, spread, {}), target_id=ids, position=places, covariance=np.zeros((len(ids), 3, 3)))


def _tracked_now(sequence: Sequence) -> Iterator[SceneFrame]:
    """Run the tracker, and yield each tick with its estimate."""
    # Estimates may lag behind their ticks, which `tee` buffers.
    read, shown = tee(sequence.ticks)
    for estimate in track(sequence.setup, read):
        yield next(shown), estimate
