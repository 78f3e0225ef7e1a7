"""Plan view of true and estimated paths, and video of panoramas with the plan, for a tracked sequence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import matplotlib.figure
import numpy as np
from numpy.typing import NDArray

from sim.visualization.overlays import STANDING, annotated, colour_of, draw_text, save_figure
from tracker.geometry import Array, Image, Pose
from tracker.geometry.ground import Grid
from tracker.io.atomic import new_file
from tracker.io.video_files import check_frames
from tracker.sequence.results import Results
from tracker.types import Sequence, Setup, Tick
from tracker.types.sequence import dead_reckoning

BAND = (28.0, -51.0)
"""Highest and lowest elevation of panoramas in the video, degrees."""
STRIP = (820, 180)
"""Width and height of a panorama in the video, px."""
STRIPS = 4
"""Panoramas in the video, at most."""
SIDE = (460, 720)
"""Width and height of the panel with the plan in the video, px."""
VP9 = {"deadline": "realtime", "cpu-used": "8", "crf": "18", "b": "0"}
"""Options of the encoder. OpenCV can set none; its encoder takes 11 times as long for 1 dB."""


@dataclass(frozen=True, eq=False)
class TerrainImage:
    """Image of the terrain from above: image (h, w, 3) RGB with north up; origin (2,) m of its lower left corner; scale px a metre."""

    image: Image
    origin: Array
    scale: float

    @staticmethod
    def of(setup: Setup, size: tuple[int, int]) -> TerrainImage:
        """The image that fits into size (width, height) px: heights as colour, slopes as shade, objects dark."""
        ground, tops = setup.ground, setup.occluders
        assert isinstance(ground, Grid)
        extent = (np.array(ground.heights.shape[::-1]) - 1) * ground.spacing
        scale = float(min(size / extent))
        w, h = (round(float(s)) for s in extent * scale)
        x, y = np.meshgrid((np.arange(w) + 0.5) / scale + ground.origin[0], (np.arange(h)[::-1] + 0.5) / scale + ground.origin[1])
        points = np.column_stack([x.ravel(), y.ravel()])
        heights = ground.height_at(points).reshape(h, w)
        dy, dx = np.gradient(heights, 1 / scale)
        shade = np.clip(0.85 - 0.9 * dx + 0.9 * dy, 0.45, 1.1)
        span = max(float(np.ptp(heights)), 1e-6)
        base = matplotlib.colormaps["YlGn"](0.05 + 0.4 * (heights - heights.min()) / span)[:, :, :3]
        image = np.clip(255 * base * shade[:, :, None], 0, 255)
        if tops is not None:
            image[tops.height_at(points).reshape(h, w) - heights > STANDING] = (96, 92, 96)
        return TerrainImage(image.astype(np.uint8), ground.origin, scale)

    def pixels(self, places: Array) -> NDArray[np.int64]:
        """Pixels (n, 2) of places (n, 2 or 3) m."""
        p = (np.atleast_2d(places)[:, :2] - self.origin) * self.scale
        return np.column_stack([p[:, 0], self.image.shape[0] - p[:, 1]]).round().astype(np.int64)


def _paths(results: Results, first: int, last: int) -> dict[int, Array]:
    """Id → frame, x, y, z (n, 4) of its estimates in the frames `first` to `last`."""
    rows: dict[int, list[Array]] = {}
    for frame in range(max(first, 0), last + 1):
        ids, places = results.tracks.get(frame, (np.zeros(0, dtype=np.int64), np.zeros((0, 3))))
        for identity, place in zip(ids.tolist(), places, strict=True):
            rows.setdefault(identity, []).append(np.array([frame, *place]))
    return {identity: np.array(path) for identity, path in rows.items()}


def plan(sequence: Sequence, results: Results, title: str, path: Path) -> None:
    """Write the plan view as a PNG: terrain, true paths of people in black, estimates in the colours of their ids, paths of robots."""
    terrain_image = TerrainImage.of(sequence.setup, (1600, 1600))
    h, w = terrain_image.image.shape[:2]
    x0, y0 = terrain_image.origin
    figure: Any = matplotlib.figure.Figure(figsize=(11, 9), layout="constrained")
    axes = figure.subplots()
    axes.imshow(terrain_image.image, extent=(x0, x0 + w / terrain_image.scale, y0, y0 + h / terrain_image.scale))
    truth = sequence.truth or ()
    people: dict[int, list[Array]] = {}
    for frame in truth:
        for person, feet in zip(frame.person_id.tolist(), frame.feet, strict=True):
            people.setdefault(person, []).append(feet[:2])
    for k, feet_of_one in enumerate(people.values()):
        axes.plot(*np.array(feet_of_one).T, color="black", linewidth=1.0, label="people, true" if k == 0 else None)
    for identity, walked in _paths(results, 0, results.frames).items():
        colour = np.array(colour_of(identity)) / 255 * 0.85
        axes.plot(walked[:, 1], walked[:, 2], color=colour, linewidth=2.2, alpha=0.8)
        axes.annotate(str(identity), (walked[-1, 1], walked[-1, 2]), color=colour, weight="bold", fontsize=11)
    for k, (robot, poses) in enumerate(results.poses.items()):
        true = np.array([frame.T_world_robot[robot].translation for frame in truth])
        axes.plot(*true[:, :2].T, color="royalblue", linewidth=4.5, alpha=0.6, label="robots, true" if k == 0 else None)
        driven = np.array([pose.translation for pose in poses if pose is not None])
        axes.plot(driven[:, 0], driven[:, 1], color="crimson", linewidth=1.4, label="robots, estimated" if k == 0 else None)
        axes.plot(*driven[0, :2], marker="o", color="crimson", markeredgecolor="white", markersize=8)
        name = robot.replace("robot_", "R")
        axes.annotate(name, (driven[0, 0], driven[0, 1]), xytext=(5, 5), textcoords="offset points", color="crimson", weight="bold")
    axes.plot([], [], color="tab:blue", linewidth=2.2, label="people, estimated (a colour an id)")
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title, aspect="equal")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=4, frameon=False)
    save_figure(path, figure)


def video_frames(sequence: Sequence, results: Results, ticks: Iterable[Tick]) -> Iterator[Image]:
    """Video frames (720, 1280, 3) RGB: images with boxes, the plan so far, and a chart of the robots' errors.

    Up to four panoramas have a strip each; the images of other cameras share the strips that are left.
    """
    terrain_image = TerrainImage.of(sequence.setup, (SIDE[0] - 20, SIDE[1] - 370))
    errors = {"by SLAM": _robot_errors(sequence, results.poses), "dead reckoning": _robot_errors(sequence, dead_reckoning(sequence))}
    for tick in ticks:
        images = list(annotated(sequence, results, tick).values())
        strips = [_strip(image) for image in images if _is_panorama(image)][:STRIPS]
        if len(strips) < STRIPS:
            strips.append(_grid([image for image in images if not _is_panorama(image)], STRIP[1] * (STRIPS - len(strips))))
        side = _plan_so_far(sequence, results, terrain_image, tick)
        _draw_error_chart(side, errors, tick.index, len(sequence.ticks))
        yield np.ascontiguousarray(np.hstack([np.vstack(strips), side]))


def _robot_errors(sequence: Sequence, poses: dict[str, list[Pose | None]]) -> Array:
    """Mean position error (frames,) m over the robots; NaN without an estimate."""
    out = []
    for k, frame in enumerate(sequence.truth or ()):
        errors = [np.linalg.norm(p.translation - frame.T_world_robot[r].translation) for r, ps in poses.items() if (p := ps[k]) is not None]
        out.append(np.mean(errors) if errors else np.nan)
    return np.array(out)


def _draw_error_chart(side: Image, lines: dict[str, Array], last_frame: int, frames: int) -> None:
    """Draw lines (frames,) up to `last_frame` into the lower part of the side panel, on a common scale."""
    if not all(len(values) for values in lines.values()):
        return
    left, right, top, bottom = 62, SIDE[0] - 16, SIDE[1] - 190, SIDE[1] - 36
    high = max(0.1, *(float(np.nanmax(values)) for values in lines.values()))
    draw_text(side, "robots' mean error [m]", (left - 46, top - 14), 0.5, (200, 200, 200))
    for share in (0.0, 0.5, 1.0):
        y = round(bottom - share * (bottom - top))
        cv2.line(side, (left, y), (right, y), (70, 70, 76), 1)
        draw_text(side, f"{share * high:.2f}", (left - 46, y + 5), 0.42, (170, 170, 170))
    for k, ((name, values), colour) in enumerate(zip(lines.items(), ((220, 20, 60), (150, 150, 160)), strict=True)):
        x = left + (right - left) * np.arange(last_frame + 1) / max(frames - 1, 1)
        y_of = bottom - (bottom - top) * values[: last_frame + 1] / high
        cv2.polylines(side, [np.column_stack([x, y_of]).round().astype(np.int32)], False, colour, 2, cv2.LINE_AA)
        draw_text(side, name, (left + 150 * k, bottom + 24), 0.48, colour)


def _is_panorama(image: Image) -> bool:
    return image.shape[1] == 2 * image.shape[0]


def _strip(image: Image) -> Image:
    """A band of a panorama, as large as STRIP."""
    top, bottom = (round(image.shape[0] * (90 - degrees) / 180) for degrees in BAND)
    return cv2.resize(image[top:bottom], STRIP, interpolation=cv2.INTER_AREA).astype(np.uint8)


def _grid(images: list[Image], height: int) -> Image:
    """Whole images in rows, as large as they fit into `height` px and the width of a strip."""
    out, width = np.full((height, STRIP[0], 3), 24, np.uint8), STRIP[0]
    if not images:
        return out
    tallest, widest = (max(image.shape[axis] for image in images) for axis in (0, 1))
    scales = {columns: min(width / columns / widest, height / -(-len(images) // columns) / tallest) for columns in range(1, len(images) + 1)}
    columns = max(scales, key=lambda number: scales[number])
    scale = scales[columns]
    for k, image in enumerate(images):
        small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        top, left = k // columns * int(tallest * scale), k % columns * int(widest * scale)
        part = out[top : top + small.shape[0], left : left + small.shape[1]]
        part[:] = small[: part.shape[0], : part.shape[1]]
    return out


def _plan_so_far(sequence: Sequence, results: Results, terrain_image: TerrainImage, tick: Tick) -> Image:
    side = np.full((SIDE[1], SIDE[0], 3), 24, np.uint8)
    canvas = terrain_image.image.copy()
    truth = sequence.truth[tick.index] if sequence.truth else None
    for identity, recent in _paths(results, tick.index - 17, tick.index).items():
        cv2.polylines(canvas, [terrain_image.pixels(recent[:, 1:]).astype(np.int32)], False, colour_of(identity), 2, cv2.LINE_AA)
        if len(recent) and recent[-1, 0] == tick.index:
            at = terrain_image.pixels(recent[-1:, 1:])[0]
            cv2.circle(canvas, at.tolist(), 6, colour_of(identity), -1, cv2.LINE_AA)
            draw_text(canvas, str(identity), (int(at[0]) + 7, int(at[1]) - 5), 0.45, colour_of(identity))
    if truth is not None:
        for at in terrain_image.pixels(truth.feet) if len(truth.feet) else []:
            cv2.circle(canvas, at.tolist(), 8, (10, 10, 10), 1, cv2.LINE_AA)
    for robot, poses in results.poses.items():
        pose = poses[tick.index]
        if pose is not None:
            nose = terrain_image.pixels(pose.apply(np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]])))
            cv2.arrowedLine(canvas, nose[0].tolist(), nose[1].tolist(), (220, 20, 60), 3, cv2.LINE_AA, tipLength=0.4)
            draw_text(canvas, robot.replace("robot_", "R"), (int(nose[0][0]) - 8, int(nose[0][1]) + 18), 0.45, (255, 120, 140))
    h, w = canvas.shape[:2]
    left = (SIDE[0] - w) // 2
    side[60 : 60 + h, left : left + w] = canvas
    draw_text(side, "pilsim", (left, 38), 0.9, (240, 240, 240))
    draw_text(side, f"frame {tick.index:4d}   {tick.time:6.2f} s", (left + 130, 38), 0.55, (200, 200, 200))
    for k, line in enumerate(("rings: true people", "dots and numbers: estimates", "arrows: robots, by SLAM")):
        draw_text(side, line, (left, 60 + h + 30 + 24 * k), 0.5, (200, 200, 200))
    return side


def write_video(path: Path, frames: Iterable[Image], rate: float) -> None:
    """An MP4 file (VP9, which browsers play) of RGB frames (H, W, 3) at `rate` frames/s. All have one size, of an even H and an even W.

    Raises ValueError where there is no frame, where a size does not fit, and where the file cannot be opened. Raises OSError where the disk is full.
    """
    import av  # Its libraries take 0.1 s to load.

    count, size, encoding, video = 0, (0, 0), None, None
    # The encoder runs without the interpreter's lock: the next frame is drawn meanwhile.
    with new_file(path) as part:
        try:
            with ExitStack() as stack, ThreadPoolExecutor(1) as encoder:
                for count, frame in enumerate(frames, 1):
                    if count == 1:
                        size = (frame.shape[1], frame.shape[0])
                        video = stack.enter_context(_open_vp9(part, path, size, rate))
                    if frame.shape != (size[1], size[0], 3):
                        raise ValueError(f"{path}: frame {count - 1} has the shape {frame.shape}, needs {(size[1], size[0], 3)}")
                    if encoding is not None:
                        encoding.result()
                    encoding = encoder.submit(_encode, video, frame)
                if encoding is None:
                    raise ValueError(f"{path}: no frame to write")
                encoding.result()
                _encode(video, None)
        except av.FFmpegError:
            raise OSError(f"{path}: not all of {count} frames could be written; is the disk full?") from None
        check_frames(part, count, path)


def _open_vp9(part: Path, path: Path, size: tuple[int, int], rate: float) -> Any:
    """The file `part`, open for video of `size` (width, height) px; messages name `path`."""
    import av

    if size[0] % 2 or size[1] % 2:  # The encoder halves the resolution of colours.
        raise ValueError(f"{path}: frames are {size[0]} x {size[1]} pixels, needs an even width and height")
    video = av.open(str(part), "w", format="mp4")
    stream = video.add_stream("libvpx-vp9", rate=Fraction(rate).limit_denominator(1000), options=VP9)
    stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
    # One thread: the same frames give the same bytes on any computer.
    stream.codec_context.thread_count = 1
    try:
        video.start_encoding()
    except av.FFmpegError as error:
        raise ValueError(f"{path}: video cannot be written here ({error.strerror})") from None
    return video


def _encode(video: Any, frame: Image | None) -> None:
    """Append an RGB frame. None flushes the encoder."""
    import av

    (stream,) = video.streams.video
    for packet in stream.encode(None if frame is None else av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")):
        video.mux(packet)
