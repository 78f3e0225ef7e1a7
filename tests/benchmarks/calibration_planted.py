"""Errors planted in a right calibration, and what `--from current` finds of them: tilt, focal length, place, swapped cameras, and none.

A line has the error and what is left of it, in its camera and in the others: largest angle, focal length and place.
Then follow changes and problems. `--row CMC1` plants errors in the published calibration of a real recording, and refines by its first half.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from tests.benchmarks.calibration import KINDS, Synthetic, focal_of, synthetic
from tests.benchmarks.calibration_real import ROWS, recording_of
from tracker.calibration import Known, calibrate
from tracker.calibration.body import angles_of, rotation_of
from tracker.geometry import Pose
from tracker.geometry.cameras import Pinhole, Tsai
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.clock_offsets import with_offsets

SIZES = {"none": (0.0,), "tilt": (1.0, 3.0, 5.0), "focal": (2.0, 5.0, 10.0), "place": (0.05, 0.2, 0.5), "swapped": (1.0,)}
"""Degrees, %, m."""


def moved(camera: RecordingCamera, error: str, size: float) -> RecordingCamera:
    """The camera with one error."""
    pitch, roll, yaw = angles_of(camera.pose.rotation)
    lens, place = camera.camera, camera.pose.translation
    assert isinstance(lens, Pinhole | Tsai)
    if error == "focal":
        factor = 1 + size / 100
        lens = replace(lens, focal=lens.focal * factor) if isinstance(lens, Tsai) else replace(lens, fx=lens.fx * factor, fy=lens.fy * factor)
    if error == "place":
        place = place + size * np.array([np.cos(yaw + 1.0), np.sin(yaw + 1.0), 0.0])
    return RecordingCamera(lens, Pose(rotation_of(pitch + np.radians(size if error == "tilt" else 0.0), roll, yaw), place))


def planted(case: Synthetic, error: str, size: float) -> Recording:
    """The recording with its true cameras and clocks, but for the error of the second camera."""
    cameras = dict(case.cameras)
    first, second = list(cameras)[:2]
    if error == "swapped":
        cameras[first], cameras[second] = cameras[second], cameras[first]
    else:
        cameras[second] = moved(cameras[second], error, size)
    return replace(with_offsets(case.recording, case.offsets), cameras=cameras)


def left(case: Synthetic, found: dict[str, RecordingCamera], names: list[str]) -> str:
    """The largest errors of some cameras."""
    figures = np.zeros(3)
    for name in names:
        a, b = found[name], case.cameras[name]
        angle = np.degrees(np.arccos(np.clip((np.trace(a.pose.rotation.T @ b.pose.rotation) - 1) / 2, -1, 1)))
        focal = 100 * abs(focal_of(a.camera) / focal_of(b.camera) - 1)
        figures = np.maximum(figures, [angle, focal, float(np.linalg.norm(a.pose.translation - b.pose.translation))])
    return "{:.2f}° {:.1f} % {:.2f} m".format(*figures)


def published(row: str) -> Synthetic:
    """The first half of a real recording with its published calibration, which is taken for the truth."""
    recording = recording_of(row)
    first = replace(recording.cut(0, recording.frames // 2), truth=None, visible={})
    return Synthetic(first, dict(first.cameras), dict.fromkeys(first.cameras, 0.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("errors", nargs="*", metavar="ERROR", default=list(SIZES))
    parser.add_argument("--kind", choices=list(KINDS), default="room")
    parser.add_argument("--row", choices=list(ROWS), help="a real recording in place of a synthetic one")
    parser.add_argument("--cameras", type=int, default=3)
    parser.add_argument("--seed", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=90.0)
    chosen = parser.parse_args()
    case = published(chosen.row) if chosen.row else synthetic(chosen.kind, chosen.cameras, chosen.seed, chosen.seconds)
    first, second, *rest = case.cameras
    for error in chosen.errors:
        for size in SIZES[error]:
            began = time.process_time()
            found = calibrate(planted(case, error, size), Known(refine=True))
            said = "; ".join([*found.changes, *found.problems])
            print(f"{error} {size:g}: {second} {left(case, found.cameras, [second])}, others {left(case, found.cameras, [first, *rest])}, "
                  f"{time.process_time() - began:.0f} s; {said or 'nothing'}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
