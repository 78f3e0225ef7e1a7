"""COCO (Lin et al. 2014): run-length masks, boxes, key points and tracks over videos; the export of a sequence.

Boxes are in pixels from the corner of the image: a whole image is [0, 0, W, H]. Key points are in pixels from the centre of the first pixel.
A box in a panorama may exceed the width, where a body lies over the seam: its annotation has `wraps` true.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.formats.exported_sequence import RecordedSequence, ltwh_from_edges
from tracker.geometry import Array, Ints
from tracker.io.atomic import write_text
from tracker.types import KEYPOINT_NAMES, Boxes, ViewTruth

SKELETON = (
    (16, 14), (14, 12), (17, 15), (15, 13), (12, 13), (6, 12), (7, 13), (6, 7), (6, 8), (7, 9), (8, 10), (9, 11), (2, 3), (1, 2), (1, 3), (2, 4),
    (3, 5), (4, 6), (5, 7),
)  # fmt: skip
"""Pairs of key points that are drawn connected, numbered from 1 as in COCO."""
PERSON = 1
"""Category id."""
CENTRE = 0.5
"""px: centre of the first pixel, from the corner of the image."""


@dataclass(frozen=True)
class Rle:
    """A run-length encoded mask (height, width): counts of pixels in column-major order, alternately off and on, off first."""

    height: int
    width: int
    counts: tuple[int, ...]

    @property
    def area(self) -> int:
        """Number of pixels that are on."""
        return sum(self.counts[1::2])


def encode_masks(instances: NDArray[np.uint16]) -> dict[int, Rle]:
    """The masks of all people in an instance image (H, W) of person ids, 0 for no person → id → mask, ids ascending."""
    height, width = instances.shape
    flat = instances.T.ravel()
    first = np.concatenate([[0], np.flatnonzero(np.diff(flat)) + 1])
    end = np.append(first[1:], flat.size)
    owner = flat[first]
    found = {}
    for person in np.unique(owner[owner > 0]).tolist():
        mine = owner == person
        edges = np.column_stack([first[mine], end[mine]]).ravel()
        counts = np.diff(edges, prepend=0, append=flat.size).tolist()
        found[person] = Rle(height, width, tuple(counts if counts[-1] else counts[:-1]))
    return found


def encode_counts(counts: Iterable[int]) -> str:
    """Compressed run lengths as pycocotools writes them.

    From the fourth count on, the difference to the count two before is encoded: five bits per character from '0', low bits first.
    """
    out = []
    numbers = list(counts)
    for k, count in enumerate(numbers):
        x = count - numbers[k - 2] if k > 2 else count
        more = True
        while more:
            low, x = x & 0x1F, x >> 5
            more = x != (-1 if low & 0x10 else 0)
            out.append(chr(low + (0x20 if more else 0) + 48))
    return "".join(out)


@dataclass(frozen=True, eq=False)
class PersonAnnotation:
    """A person in an image: person id.

    box (4,): left, top, width, height px of the visible part; full (4,): of the whole body. Pixels count from the corner of the image.
    visible: visible fraction in [0, 1]. range m. mask of the visible part.
    pixels (17, 2): key points px from the corner of the image. visibility (17,): 2 visible, 1 hidden, 0 not in the image.
    """

    person: int
    box: Array
    full: Array
    visible: float
    range: float
    mask: Rle
    pixels: Array
    visibility: Ints


@dataclass(eq=False)
class CocoFile:
    """The content of a COCO file: videos, images and annotations as JSON values, ids from 1."""

    videos: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)
    annotations: list[dict[str, Any]] = field(default_factory=list)

    def add_video(self, name: str, camera: str, sequence: str) -> int:
        """Add the images of one camera of a sequence as a video; returns its id."""
        self.videos.append({"id": len(self.videos) + 1, "name": name, "camera": camera, "sequence": sequence})
        return len(self.videos)

    def add_image(self, video: int, file: str, size: tuple[int, int], frame: int) -> int:
        """Add an image; size: width, height px; frame from 0. Returns its id."""
        width, height = size
        image = {"id": len(self.images) + 1, "width": width, "height": height, "file_name": file, "video_id": video, "frame_id": frame}
        self.images.append(image)
        return len(self.images)

    def add(self, image: int, person: PersonAnnotation) -> None:
        """Add an annotation of the image with that id."""
        seen = person.visibility > 0
        points = np.where(seen[:, None], person.pixels - CENTRE, 0.0)
        flags, width = person.visibility.tolist(), person.mask.width
        self.annotations.append(
            {
                "id": len(self.annotations) + 1,
                "image_id": image,
                "video_id": self.images[image - 1]["video_id"],
                "category_id": PERSON,
                "track_id": person.person,
                "bbox": person.box.tolist(),
                "area": person.mask.area,
                "segmentation": {"size": [person.mask.height, width], "counts": encode_counts(person.mask.counts)},
                "iscrowd": 0,
                "keypoints": [x for (u, v), flag in zip(points.tolist(), flags, strict=True) for x in (round(u, 2), round(v, 2), flag)],
                "num_keypoints": int(seen.sum()),
                "wraps": bool(person.box[0] + person.box[2] > width),
                "bbox_full": person.full.tolist(),
                "visibility": person.visible,
                "range": person.range,
            }
        )


def write_coco(path: Path, content: CocoFile, description: str) -> None:
    """Write a JSON file. The same content gives the same bytes."""
    category = {"id": PERSON, "name": "person", "supercategory": "person", "keypoints": list(KEYPOINT_NAMES), "skeleton": [*map(list, SKELETON)]}
    whole = {
        "info": {"description": description, "version": "1.0"},
        "licenses": [],
        "videos": content.videos,
        "categories": [category],
        "images": content.images,
        "annotations": content.annotations,
    }
    write_text(path, json.dumps(whole, allow_nan=False) + "\n")


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
