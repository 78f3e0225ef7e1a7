"""Calibration from people alone on real recordings: from nothing by the first half of the frames, then tracked in the second half.

Errors are against the published calibration, after the best rotation about the vertical, shift and factor. The second half is tracked with our
cameras, moved by that similarity, and with the published ones. WILDTRACK's boxes are bodies of drawn statures at true places.
ROWS are some of the names below, or folders of recordings; none means all the names. `python -m tests.benchmarks.calibration_real CMC1 PETS-157`
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim.tuning.population import STATURE, STATURES
from tests.benchmarks.calibration import Synthetic, errors, similarity, unknown
from tests.conftest import DATA
from tracker.calibration import Calibration, Known, calibrate
from tracker.formats.opening import open_recording
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, Pose
from tracker.geometry.image_boxes import body_boxes
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import matching_frames
from tracker.options import parameters_from
from tracker.pipeline import track
from tracker.recordings import Recording, RecordingCamera
from tracker.recordings.clock_offsets import with_offsets
from tracker.recordings.degradation import BoxNoise, noisy_boxes
from tracker.sequence.results import Results
from tracker.types.truth import evaluated_people

PETS, WIDTH, DELAY = DATA / "pets2009" / "S2.L1", 0.5, 10
NOISE = BoxNoise(0.1, 0.02)
ROWS = {
    "CMC1": (DATA / "cmc" / "CMC1", ""),
    "CMC2": (DATA / "cmc" / "CMC2", ""),
    "PETS-157": (PETS, "157"),
    "PETS-low": (PETS, "5678"),
    "WILDTRACK": (DATA / "wildtrack", ""),
}


def recording_of(row: str) -> Recording:
    """The recording of a row, with its published calibration."""
    path, cameras = ROWS.get(row, (Path(row), ""))
    if row != "WILDTRACK":
        return open_recording(path, SourceOptions(tuple(cameras)), strict=False)
    return _with_bodies(open_recording(path, SourceOptions(projected=NOISE), strict=False))


def _with_bodies(recording: Recording) -> Recording:
    """The recording with boxes of bodies of drawn statures at its true places."""
    rng = np.random.default_rng(0)
    stature: dict[int, float] = {}
    detections = {}
    for name, camera in recording.fixed.items():
        boxes = {}
        for frame, (people, feet) in sorted((recording.truth or {}).items()):
            tall = [stature.setdefault(k, float(np.clip(rng.normal(*STATURE), *STATURES))) for k in people.tolist()]
            parts = [body_boxes(camera.camera, camera.pose, foot[None], (high, WIDTH)) for foot, high in zip(feet, tall, strict=True)]
            box = np.concatenate([np.zeros((0, 4)), *parts])
            boxes[frame] = box, np.full(len(box), 0.9)
        detections[name] = boxes
    return noisy_boxes(replace(recording, detections=detections), NOISE)


def placed(found: Calibration, case: Synthetic, recording: Recording) -> Recording:
    """The recording with the cameras that were found, brought to the published ones, and their clocks."""
    turn, factor, shift = similarity(found, case)
    c, s = turn.real, turn.imag
    about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    cameras = {
        name: RecordingCamera(one.camera, Pose(about @ one.pose.rotation, factor * about @ one.pose.translation + [shift.real, shift.imag, 0.0]))
        for name, one in found.cameras.items()
    }
    chosen = replace(recording.choose(list(cameras)), cameras=cameras)
    return with_offsets(chosen, {name: offset for name, offset in found.offsets.items() if offset})


def tracked(recording: Recording) -> str:
    """MOTA / IDF1 with the cameras of a recording."""
    sequence = recording.sequence()
    results = Results.of(track(sequence.setup, sequence.ticks, parameters_from({"delay": DELAY, "images": False})), {})
    assert sequence.truth is not None
    people: Mapping[int, tuple[Array, Array]] = {t.index: (t.person_id, t.feet) for t in sequence.truth}
    figures = score(matching_frames(people, results.tracks, evaluated_people(sequence.truth, sequence.setup.period))).to_dict()
    return f"{figures['mota']:.3f} / {figures['idf1']:.3f}"


def line_of(row: str, scored: bool) -> str:
    """A line of the table."""
    recording = recording_of(row)
    half = recording.frames // 2
    first, second = recording.cut(0, half), recording.cut(half, recording.frames)
    blind = replace(first, cameras={name: unknown(camera) for name, camera in first.cameras.items()}, truth=None, area=None, visible={})
    case = Synthetic(blind, dict(first.cameras), dict.fromkeys(first.cameras, 0.0))
    began = time.process_time()
    found = calibrate(blind, Known())
    seconds = time.process_time() - began
    out = [f"{row}: {len(found.cameras)} of {len(first.cameras)} cameras, {seconds:.0f} s", *(f"  not known: {line}" for line in found.problems)]
    if len(found.cameras) > 1:
        one = errors(case, found)
        each = [f"{name} {', '.join(f'{v:.2f}' for v in one[name])}" for name in ("focal", "angle", "place", "offset", "scale", "NEES")]
        out.append("  " + "; ".join(each))
        if scored:
            out.append(f"  MOTA / IDF1: ours {tracked(placed(found, case, second))}, published {tracked(second.choose(list(found.cameras)))}")
    return "\n".join(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", metavar="ROWS", default=list(ROWS))
    parser.add_argument("--no-score", action="store_true", help="calibrate alone, and track nothing")
    chosen = parser.parse_args()
    print("errors of cameras: focal length %, angle °, place % of the mean distance, offset s; scale %; NEES")
    for row in chosen.rows:
        print(line_of(row, not chosen.no_score), flush=True)


if __name__ == "__main__":
    main()
