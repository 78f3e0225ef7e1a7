"""Errors that people make in recordings and that `check` has no name for: the test of its table has to tell of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tests.tracker.recordings.walked_room import with_extrinsics, with_frames
from tracker.geometry import Array
from tracker.geometry.cameras import Pinhole
from tracker.geometry.ground import Flat
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.calibration_feet import Extrinsics

Change = Callable[[Array], Array]


def with_boxes(recording: Recording, change: Callable[[Array, RecordingCamera], Array], names: tuple[str, ...] = ()) -> Recording:
    """The recording whose boxes (n, 4) of the named cameras, or of all, are changed."""
    return replace(
        recording,
        detections={
            name: {frame: (change(box, recording.cameras[name]), score) for frame, (box, score) in boxes.items()}
            if not names or name in names
            else boxes
            for name, boxes in recording.detections.items()
        },
    )


def turned(axis: str, degrees: float) -> Callable[[Extrinsics], Extrinsics]:
    """Extrinsics whose camera is turned about one of its own axes: x to the right, y down, z ahead. Its place stays."""
    turn = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return lambda e: (turn @ e[0], turn @ e[1])


def moved(offset: tuple[float, float, float]) -> Callable[[Extrinsics], Extrinsics]:
    """Extrinsics of a camera that is elsewhere in the world by this offset, m."""
    return lambda e: (e[0], e[1] - e[0] @ np.array(offset))


def of_world(matrix: Array) -> Callable[[Extrinsics], Extrinsics]:
    """Extrinsics to another world: x_world = matrix x_other."""
    return lambda e: (e[0] @ matrix, e[1])


def with_lens(recording: Recording, change: Callable[[Pinhole], Pinhole], names: tuple[str, ...] = ()) -> Recording:
    """The recording with other lenses of the named cameras, or of all."""
    cameras = {}
    for name, camera in recording.cameras.items():
        assert isinstance(camera.camera, Pinhole)
        cameras[name] = replace(camera, camera=change(camera.camera)) if not names or name in names else camera
    return replace(recording, cameras=cameras)


def with_places(recording: Recording, change: Change) -> Recording:
    """The recording with other true places (n, 3) m."""
    assert recording.truth is not None
    return replace(recording, truth={frame: (ids, change(places)) for frame, (ids, places) in recording.truth.items()})


def shares(box: Array, first: float, second: float) -> Array:
    """The part of boxes (n, 4) from one share of their height to another."""
    left, top, width, height = box.T
    return np.column_stack([left, top + first * height, width, (second - first) * height])


def unnamed(recording: Recording) -> dict[str, Recording]:
    """Name of an error without a name in `check` → the recording with it. Cameras are pinholes, and there is truth."""
    first, second = list(recording.cameras)[:2]
    rng = np.random.default_rng(0)
    order = rng.permutation(recording.frames)
    mirror, swap = np.diag([1.0, -1.0, 1.0]), np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    largest = max(max(camera.camera.width, camera.camera.height) for camera in recording.cameras.values())
    one = next(iter(recording.detections.values()))
    return {
        "one camera pitched by 8°": with_extrinsics(recording, turned("x", 8), (first,)),
        "all cameras pitched by -8°": with_extrinsics(recording, turned("x", -8)),
        "one camera turned by 12°": with_extrinsics(recording, turned("y", 12), (second,)),
        "all cameras turned by -15°": with_extrinsics(recording, turned("y", -15)),
        "one camera rolled by 20°": with_extrinsics(recording, turned("z", 20), (first,)),
        "all cameras upside down": with_extrinsics(recording, turned("z", 180)),
        "one camera on its side": with_extrinsics(recording, turned("z", 90), (second,)),
        "focal lengths times 1.6": with_lens(recording, lambda lens: replace(lens, fx=1.6 * lens.fx, fy=1.6 * lens.fy)),
        "focal length times 0.5 in one camera": with_lens(recording, lambda lens: replace(lens, fx=lens.fx / 2, fy=lens.fy / 2), (first,)),
        "focal length in millimetres": with_lens(recording, lambda lens: replace(lens, fx=4.0, fy=4.0)),
        "principal point is the size": with_lens(recording, lambda lens: replace(lens, cx=float(lens.width), cy=float(lens.height))),
        "principal point at the corner": with_lens(recording, lambda lens: replace(lens, cx=0.0, cy=0.0), (second,)),
        "one camera 2 m beside its place": with_extrinsics(recording, moved((1.4, -1.4, 0.0)), (first,)),
        "one camera 1.5 m too high": with_extrinsics(recording, moved((0, 0, 1.5)), (second,)),
        "ground 1 m below": replace(recording, ground=Flat(-1.0)),
        "translations in feet": with_extrinsics(recording, lambda e: (e[0], e[1] / 0.3048)),
        "one R for all cameras": with_extrinsics(recording, lambda e, R=recording.cameras[first].opencv_extrinsics[0]: (R, e[1])),  # type: ignore[misc]
        "one t for all cameras": with_extrinsics(recording, lambda e, t=recording.cameras[first].opencv_extrinsics[1]: (e[0], t)),  # type: ignore[misc]
        "world with z down": with_extrinsics(recording, of_world(np.diag([1.0, -1.0, -1.0]))),
        "truth mirrored": with_places(recording, lambda p: p @ mirror),
        "truth with x and y exchanged": with_places(recording, lambda p: p @ swap),
        "truth a quarter turn off": with_places(recording, lambda p: p @ quarter.T),
        "truth 3 m off": with_places(recording, lambda p: np.add(p, [3.0, 0, 0])),
        "truth from a corner of the image": with_places(recording, lambda p: p * [30.0, 30.0, 1] + [400, 200, 0]),
        "corners in place of sizes": with_boxes(recording, lambda b, _: np.column_stack([b[:, :2], b[:, :2] + b[:, 2:]])),
        "middles in place of corners": with_boxes(recording, lambda b, _: np.column_stack([b[:, :2] + b[:, 2:] / 2, b[:, 2:]])),
        "v upwards": with_boxes(recording, lambda b, c: np.column_stack([b[:, 0], c.camera.height - b[:, 1] - b[:, 3], b[:, 2:]])),
        "x and y exchanged": with_boxes(recording, lambda b, _: b[:, [1, 0, 3, 2]]),
        "width and height exchanged": with_boxes(recording, lambda b, _: b[:, [0, 1, 3, 2]]),
        "boxes of heads": with_boxes(recording, lambda b, _: shares(b, 0.0, 0.15)),
        "boxes of upper halves": with_boxes(recording, lambda b, _: shares(b, 0.0, 0.5)),
        "images cropped by a quarter": with_boxes(recording, lambda b, c: b - [c.camera.width / 4, c.camera.height / 4, 0, 0]),
        "images padded to squares": with_boxes(recording, lambda b, c: np.add(b, [0, (largest - c.camera.height) / 2, 0, 0])),
        "boxes of one camera in all": replace(recording, detections=dict.fromkeys(recording.detections, one)),
        "frames in any order": with_frames(recording, lambda frame: int(order[frame])),
        "frames backwards": with_frames(recording, lambda frame: recording.frames - 1 - frame),
        "frames late by a quarter of the recording": with_frames(recording, lambda frame: frame + recording.frames // 4),
        "boxes of nothing": with_boxes(
            recording, lambda b, c: np.column_stack([rng.uniform(0, [c.camera.width * 0.9, c.camera.height * 0.5], (len(b), 2)), b[:, 2:]])
        ),
    }
