"""Export to COCO: panoramas and pinhole views, with masks, boxes, key points and tracks."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from tracker.export.recorded_sequence import RecordedSequence, ltwh_from_edges
from tracker.formats.coco import CocoFile, PersonAnnotation, encode_masks, write_coco
from tracker.types import Boxes, ViewTruth

README = """
    images/SEQUENCE/CAMERA/000000.jpg  images, RGB, frames from 0
    annotations/SEQUENCE.json          all annotations of a sequence

A file of annotations has videos (one a view: id, name, camera, sequence), images (id, width, height [px], file_name below images/, video_id,
frame_id from 0), one category (1, person, with the names of its key points and its skeleton) and annotations. Ids of videos, images and
annotations count from 1 in every file. Who shows no pixel in an image has no annotation in it. An annotation has, beside its ids:

* track_id: the person's id, pilsim's: the same in all views of a sequence and at all times. In another sequence it is somebody else.
* bbox: left, top, width, height [px] of what is seen, counted from the image's corner (0-based: a whole image is [0, 0, W, H]). In a panorama, where
  a body lies over the seam, left + width passes W; `wraps` is true there. Modulo W is where the box goes on.
* segmentation: the mask of what is seen, run lengths down the columns, compressed as pycocotools does; area [px]: its pixels. iscrowd: 0.
* keypoints: 17 times u, v [px] to 0.01, and v: 2 visible, 1 hidden by something or by the own body, 0 not in the image (u = v = 0). Counted from the
  middle of the first pixel, as COCO's own key points are: the image's edges lie at −0.5. num_keypoints: those that are not 0.
* bbox_full: as bbox, of the whole body, as if nothing were before it (in pinhole views the part in the image). visibility in [0, 1]: pixels seen /
  pixels that the body would cover alone. range [m]: from the camera to the middle between the hips.
"""


def export_coco(out: Path, recordings: Iterable[RecordedSequence]) -> list[str]:
    """Write images and one annotation file per sequence. Raises ValueError where instances and boxes of a view disagree."""
    (out / "annotations").mkdir()
    for recording in recordings:
        content, videos = CocoFile(), {}
        for camera in recording.cameras:
            (out / "images" / recording.name / camera).mkdir(parents=True)
            videos[camera] = content.add_video(f"{recording.name}-{camera}", camera, recording.name)
        for k in recording.frames():
            for camera, size in recording.cameras.items():
                file = f"{recording.name}/{camera}/{k:06d}.jpg"
                (out / "images" / file).write_bytes(recording.image(k, camera))
                image = content.add_image(videos[camera], file, (size.width, size.height), k)
                for person in people_in_image(recording, k, camera):
                    content.add(image, person)
        write_coco(out / "annotations" / f"{recording.name}.json", content, f"{recording.name}: synthetic people by pilsim")
    return []


def people_in_image(recording: RecordedSequence, frame: int, camera: str) -> list[PersonAnnotation]:
    """The people with visible pixels in an image, in the order of the boxes."""
    view: ViewTruth | None = recording.views.get((frame, camera))
    found = encode_masks(recording.instances(frame, camera))
    boxes = view.boxes if view else Boxes.none()
    rows = [k for k, visible in enumerate(boxes.visible) if visible > 0]
    if sorted(boxes.person[rows].tolist()) != list(found):
        raise ValueError(f"{recording.folder}: instances of {camera} in frame {frame} show {list(found)}, the boxes {boxes.person[rows].tolist()}")
    people = []
    for k in rows:
        person = int(boxes.person[k])
        assert view is not None
        point = int(np.flatnonzero(view.keypoints.person == person)[0])
        pixels, visibility = view.keypoints.pixels[point], view.keypoints.visibility[point]
        seen, full = ltwh_from_edges(boxes.seen[[k]])[0], ltwh_from_edges(boxes.full[[k]])[0]
        people.append(PersonAnnotation(person, seen, full, float(boxes.visible[k]), float(boxes.range[k]), found[person], pixels, visibility))
    return people
