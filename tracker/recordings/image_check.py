"""Tests of frames and images against the boxes of a recording: frames without boxes in any camera, and images that do not fit the boxes.

A shift of frame numbers between images and boxes is found from pixels that differ from the background.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import cv2
import numpy as np

from tracker.geometry import Array, Ints
from tracker.io.image_files import image_size
from tracker.io.time_order import say
from tracker.io.video_files import frame_times
from tracker.recordings.calibration_errors import Finding
from tracker.recordings.clocks import CameraClock
from tracker.recordings.folder import runs_of
from tracker.recordings.images import ImageFiles, ImageSource, VideoFile
from tracker.recordings.recording import FrameBoxes, Recording, RecordingCamera

LEAST_BESIDE = 4.0
"""Least mean number of boxes in the frames beside a silent frame. So many people do not vanish from all views in a frame."""
RATE_OFF = 0.05
"""Share by which the rate of a video may differ from that of the recording: 30 and 29.97 frames/s count as equal."""
RATE_FRAMES = 200
"""Frames of a video from whose stamps its rate is estimated."""
NAMED = 3
"""Runs of frames that a line names."""
SAMPLED, AT_LEAST = 150, 25
"""Frames, from the first with boxes, that the test of shifted images uses, and the least number that it needs."""
WIDTH = 240
"""px to which images are scaled."""
SHIFTS = (-2, -1, 1, 2)
"""Shifts of images, in frames, that are tested."""
SURE, CLEARLY = 4.0, 0.03
"""Standard errors, and share of the contrast, by which another frame's boxes have to fit better."""


def silent_frames(recording: Recording) -> list[Finding]:
    """A finding of frames without boxes in any camera, where those just before and after have some: they were lost, or not searched."""
    recording = recording.in_step()
    counts = np.zeros(recording.frames)
    known = np.zeros(recording.frames, dtype=bool)
    for name in recording.fixed:
        searched = recording.searched.get(name)
        known |= True if searched is None else np.isin(np.arange(recording.frames), list(searched))
        for frame, (boxes, _) in recording.detections.get(name, {}).items():
            counts[frame] += len(boxes)
    silent = _silent(counts, known)
    if not len(silent):
        return []
    beside = float(np.median(counts[counts > 0]))
    words = f"frames {_named(silent)} ({len(silent)} of {recording.frames}) have no boxes in any camera, and the others about {beside:.0f}"
    ask = 'were they searched? They count as frames in which nobody is seen, unless "searched" in recording.json says which frames were'
    return [Finding("frames-silent", (), f"{words}: {ask}")]


def _silent(counts: Array, known: Array) -> Ints:
    """Frames without boxes between frames with many. counts (f,): boxes; known (f,): whether any camera was searched."""
    full = np.flatnonzero(counts > 0)
    if not len(full):
        return np.zeros(0, dtype=np.int64)
    least = max(LEAST_BESIDE, float(counts[full].mean()) / 2)
    gaps = np.flatnonzero(np.diff(full) > 1)
    out = [np.arange(full[k] + 1, full[k + 1]) for k in gaps if (counts[full[k]] + counts[full[k + 1]]) / 2 >= least]
    silent = np.concatenate([np.zeros(0, dtype=np.int64), *out])
    return silent[known[silent]]


def _named(frames: Iterable[int]) -> str:
    """Frames from 0 as runs from 1, the first NAMED of them."""
    runs = runs_of(frames)
    shown = [f"{a}" if a == b else f"{a}-{b}" for a, b in runs[:NAMED]]
    return ", ".join(shown) + (f" and {len(runs) - NAMED} more runs" if len(runs) > NAMED else "")


def image_findings(recording: Recording) -> list[Finding]:
    """Images that do not fit the boxes: of another size, missing, or fewer. A different rate of a video is only logged, because it is frequent."""
    out: list[Finding] = []
    for name, source in recording.images.items():
        boxes = [frame for frame, (box, _) in recording.detections.get(name, {}).items() if len(box)]
        if isinstance(source, ImageFiles):
            out += _of_files(recording, name, source, boxes)
        elif isinstance(source, VideoFile):
            out += _of_video(recording, name, source, boxes)
        if not any(name in finding.cameras for finding in out):
            out += shifted_images(name, recording.cameras[name], source, recording.detections.get(name, {}))
    return out


def _of_files(recording: Recording, name: str, source: ImageFiles, boxes: list[int]) -> list[Finding]:
    out, lens = [], recording.cameras[name].camera
    first = source.files[min(source.files)] if source.files else None
    size = image_size(first.read_bytes()) if first is not None else None
    if first is not None and size is not None and size != (lens.height, lens.width):
        words = f"{name}: {first.name} is {size[1]} x {size[0]} px, and the calibration is of {lens.width} x {lens.height} px"
        out.append(Finding("image-size", (name,), words))
    missing = sorted(set(boxes) - set(source.files))
    if missing:
        words = f"{name}: {len(missing)} of {len(boxes)} frames with boxes have no image ({_named(missing)})"
        out.append(Finding("images-missing", (name,), words))
    return out


def _of_video(recording: Recording, name: str, source: VideoFile, boxes: list[int]) -> list[Finding]:
    out = []
    last, times = max(boxes, default=-1), frame_times(source.path, RATE_FRAMES)
    clock = recording.clocks.get(name, CameraClock())
    whose, told = (f"camera {name}", clock.rate) if clock.rate is not None else ("the recording", recording.rate)
    rate = (len(times) - 1) / float(np.ptp(times)) if len(times) > 2 and np.ptp(times) > 0 else told
    if clock.stamps is None and not 1 - RATE_OFF < rate / told < 1 + RATE_OFF:
        say(f"{source.path}: has {rate:.4g} frames/s by its stamps, and {whose} has {told:g}; its frames are taken one by one")
    if last >= len(times) and last >= (frames := source.frames()):
        words = f"{name}: {source.path.name} has {frames} frames, and there are boxes in frame {last + 1}"
        out.append(Finding("video-short", (name,), words))
    return out


def shifted_images(name: str, camera: RecordingCamera, source: ImageSource, boxes: FrameBoxes) -> list[Finding]:
    """A finding where images fit the boxes of another frame clearly better. Where people hardly move, no shift is found."""
    frames = sorted(frame for frame, (box, _) in boxes.items() if len(box))
    if len(frames) < AT_LEAST or camera.robot is not None:
        return []
    change = dict(_changes(camera, source, range(frames[0], min(frames[-1], frames[0] + SAMPLED) + 1)))
    if len(change) < AT_LEAST:
        return []
    scale = WIDTH / camera.camera.width
    fit = {shift: np.array([_inside(change[f], boxes, f + shift, scale) for f in sorted(change)]) for shift in (0, *SHIFTS)}
    gains = {shift: gain for shift in SHIFTS if (gain := _gain(fit[0], fit[shift])) > CLEARLY}
    if not gains:
        return []
    shift = max(gains, key=lambda one: gains[one])
    n, way = abs(shift), "low" if shift > 0 else "high"
    words = f"{name}: images look numbered {n} too {way}: image n fits the boxes of frame n {'+' if shift > 0 else '−'} {n}"
    return [Finding("images-shifted", (name,), words)]


def _changes(camera: RecordingCamera, source: ImageSource, frames: range) -> Iterator[tuple[int, Array]]:
    """Frame → absolute difference (h, w) of its small image from the median of all."""
    size, small = (camera.camera.height, camera.camera.width), dict[int, Array]()
    target = WIDTH, max(1, round(WIDTH * size[0] / size[1]))
    try:
        for frame, image in enumerate(source.images(frames.stop, size)):
            if image is not None and frame in frames:
                small[frame] = cv2.resize(image, target, interpolation=cv2.INTER_AREA).mean(axis=2)
    except ValueError:
        pass  # Missing and damaged images are reported elsewhere.
    if small:
        background = np.median(np.array(list(small.values())), axis=0)
        yield from ((frame, np.abs(one - background)) for frame, one in small.items())


def _inside(change: Array, boxes: FrameBoxes, frame: int, scale: float) -> float:
    """Mean change within the boxes of a frame, less that of the whole image; NaN without boxes in it."""
    values = []
    for left, top, width, height in boxes.get(frame, (np.zeros((0, 4)), None))[0] * scale:
        part = change[max(0, round(top)) : max(0, round(top + height)), max(0, round(left)) : max(0, round(left + width))]
        if part.size:
            values.append(float(part.mean()))
    return float(np.mean(values) - change.mean()) if values else np.nan


def _gain(own: Array, other: Array) -> float:
    """Share of the contrast by which the other frame's boxes fit better; 0 where this is within SURE standard errors."""
    known = np.isfinite(own) & np.isfinite(other)
    if known.sum() < AT_LEAST:
        return 0.0
    better = (other - own)[known]
    error = float(better.std(ddof=1)) / np.sqrt(len(better))
    return float(better.mean()) / max(float(own[known].mean()), 1.0) if better.mean() > SURE * error else 0.0
