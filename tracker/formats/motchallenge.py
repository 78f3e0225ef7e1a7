"""MOTChallenge: MOT15 (tracker/io/mot15.py), the truth of MOT17, and their other files; the export of a sequence.

MOT17 truth: frame, id, left, top, width, height (pixels, the first is 1), consider, class, visibility in [0, 1].
A row with consider 0 does not count, and class 1 is a pedestrian. Frames count from 1. Detections and results are MOT15 files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from tracker.formats.exported_sequence import RecordedSequence, ltwh_from_edges
from tracker.geometry import Ints
from tracker.io.atomic import write_text
from tracker.io.mot15 import PEDESTRIAN, Mot15Rows, number, rows_from_tracks, write_mot15
from tracker.types import Boxes
from tracker.types.truth import evaluated_people


def write_mot17(path: Path, frame: Ints, boxes: Boxes) -> None:
    """Write truth, sorted by frame, then id. All people count, and boxes are of whole bodies. Every number reads back the same.

    frame (n,): from 1, of each of the n boxes, whose pixels count from the corner of the image.
    """
    left, top, width, height = (ltwh_from_edges(boxes.full) + np.array([FIRST, FIRST, 0, 0])).T
    rows = []
    for k in np.lexsort((boxes.person, frame)):
        box = ",".join(number(x) for x in (left[k], top[k], width[k], height[k]))
        rows.append(f"{frame[k]},{boxes.person[k]},{box},1,{PEDESTRIAN},{number(float(boxes.visible[k]))}\n")
    write_text(path, "".join(rows))


FIRST = 1.0
"""Number of the first pixel: a box at the left edge of the image has left = 1."""

LAYOUT = """
    {era}-train/SEQUENCE-CAMERA/img1/000001.jpg  images, RGB; file 000001 is frame 0 of the pilsim sequence
    {era}-train/SEQUENCE-CAMERA/gt/gt.txt        truth
    {era}-train/SEQUENCE-CAMERA/det/det.txt      detections
    {era}-train/SEQUENCE-CAMERA/seqinfo.ini      frame rate [1/s], number of frames, size of the images [px]
    seqmaps/{era}-train.txt                      names of all sequences, after a line `name`

TrackEval reads it: GT_FOLDER is this folder, BENCHMARK {era}, SPLIT_TO_EVAL train.

Pixels: u to the right, v down, counted from 1: the first pixel is 1, so a box with left 1 and width W covers the whole image.
Frames count from 1. Ids are pilsim's, the same person has the same id in all views and at all times. Lines end with \\n, no header.
In a panorama left lies in [1, W + 1), and left + width − 1 may pass the width W where a body lies over the seam: modulo W is where it goes on.
"""
DETECTIONS = """
det.txt: frame, −1, left, top, width, height [px], confidence in [0, 1], −1, −1, −1. What pilsim's simulated detector reported.
"""
README17 = (
    LAYOUT.format(era="MOT17")
    + """
gt.txt, nine values: frame; id; left, top, width, height [px] of the whole body, as if nothing were before it (in pinhole views the part in
the image); consider: always 1; class: always 1, pedestrian; visibility in [0, 1]: pixels seen / pixels that the body would cover alone.
"""
    + DETECTIONS
)
README15 = (
    LAYOUT.format(era="MOT15")
    + """
gt.txt, ten values: frame; id; left, top, width, height [px] of the whole body, as if nothing were before it (in pinhole views the part in the
image); confidence: 1, or 0 where no pixel of the body is seen (the row does not count); x, y, z [m]: the ground under the middle of the body
in pilsim's world (right-handed, z up, its own origin). An x or y of exactly 0 is written as 1e-9, because 0 means absent to the 3-D kit.
"""
    + DETECTIONS
    + """
MOT15-3D/SEQUENCE/gt/gt.txt: all people of the world, whichever view sees them: frame, id, −1, −1, −1, −1, confidence (0: seen by no camera, at
least a fifth of the body, for 9/7 s: does not count), x, y, z [m]. `pilsim score --truth gt.txt --result mine.txt` scores places within 1 m.
"""
)


def export_mot17(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write MOT17 sequences with truth of nine values. Returns no notes."""
    _export_views(out, "MOT17", recordings, lambda path, _, frame, boxes: write_mot17(path, frame, boxes))
    return []


def export_mot15(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write MOT15 sequences with truth of ten values, and the ground positions of each sequence. Returns no notes."""
    _export_views(out, "MOT15", (_with_ground_positions(out / "MOT15-3D", recording) for recording in recordings), _write_truth15)
    return []


def _export_views(
    out: Path, era: str, recordings: Iterable[RecordedSequence], write_truth: Callable[[Path, RecordedSequence, Ints, Boxes], None]
) -> None:
    """Write a folder for each view, and the list of all that TrackEval reads; its first line is `name`.

    write_truth: takes the path of gt.txt, the sequence, frames (n,) from 1 and the boxes of n people.
    """
    split, names = out / f"{era}-train", ["name"]
    for recording in recordings:
        for camera in recording.cameras:
            root = _view_folder(split, recording, camera)
            names.append(root.name)
            write_truth(root / "gt" / "gt.txt", recording, *_stacked(recording, camera))
        for k in recording.frames():
            for camera in recording.cameras:
                (split / f"{recording.name}-{camera}" / "img1" / f"{k + 1:06d}.jpg").write_bytes(recording.image(k, camera))
    (out / "seqmaps").mkdir()
    write_text(out / "seqmaps" / f"{era}-train.txt", "".join(f"{name}\n" for name in names))


def _write_truth15(path: Path, recording: RecordedSequence, frame: Ints, boxes: Boxes) -> None:
    feet = {(t.index, p): position for t in recording.truth for p, position in zip(t.person_id.tolist(), t.feet, strict=True)}
    positions = np.array([feet[k - 1, p] for k, p in zip(frame.tolist(), boxes.person.tolist(), strict=True)]).reshape(-1, 3)
    full = ltwh_from_edges(boxes.full) + np.array([FIRST, FIRST, 0, 0])
    write_mot15(path, Mot15Rows(frame, boxes.person, full, (boxes.visible > 0).astype(float), positions))


def _with_ground_positions(folder: Path, recording: RecordedSequence) -> RecordedSequence:
    """Write the ground positions of all people as rows without boxes, and return the sequence.

    Confidence is 0 where a person does not count (evaluated_people).
    """
    rows = rows_from_tracks({t.index + 1: (t.person_id, t.feet) for t in recording.truth})
    counts = evaluated_people(recording.truth, recording.setup.period)
    ground = folder / recording.name / "gt"
    ground.mkdir(parents=True)
    write_mot15(ground / "gt.txt", replace(rows, confidence=np.concatenate(counts).astype(float)))
    return recording


def _stacked(recording: RecordedSequence, camera: str) -> tuple[Ints, Boxes]:
    """Frames (n,) from 1 and boxes of all people in one camera over all frames."""
    views = {k: recording.views[k, camera].boxes for k in range(len(recording.truth)) if (k, camera) in recording.views}
    frame = np.repeat(np.array(list(views), dtype=np.int64) + 1, [len(boxes.person) for boxes in views.values()])
    return frame, Boxes(*(np.concatenate([getattr(boxes, one.name) for boxes in (Boxes.none(), *views.values())]) for one in fields(Boxes)))


def _view_folder(split: Path, recording: RecordedSequence, camera: str) -> Path:
    """Make the folder of one view with seqinfo.ini and det.txt."""
    root, size = split / f"{recording.name}-{camera}", recording.cameras[camera]
    for name in ("img1", "gt", "det"):
        (root / name).mkdir(parents=True)
    values = {"name": root.name, "imDir": "img1", "frameRate": number(recording.rate), "seqLength": len(recording.truth)}
    values |= {"imWidth": size.width, "imHeight": size.height, "imExt": ".jpg"}
    write_text(root / "seqinfo.ini", "[Sequence]\n" + "".join(f"{key}={value}\n" for key, value in values.items()))
    write_mot15(root / "det" / "det.txt", recording.detection_rows(camera, FIRST))
    return root
