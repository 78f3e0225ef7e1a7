"""COCO (Lin et al. 2014): run-length masks, boxes, key points and tracks over videos; the export of a sequence.

Boxes are in pixels from the corner of the image: a whole image is [0, 0, W, H]. Key points are in pixels from the centre of the first pixel.
A box in a panorama may exceed the width, where a body lies over the seam: its annotation has `wraps` true.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.formats.exported_sequence import RecordedSequence, ltwh_from_edges
from tracker.io.json_files import write_json
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
    category = {"id": PERSON, "name": "person", "supercategory": "person", "keypoints": list(KEYPOINT_NAMES), "skeleton": [*map(list, SKELETON)]}
    for recording in recordings:
        videos, images, annotations = list[Any](), list[Any](), list[Any]()
        for number, camera in enumerate(recording.cameras, 1):
            (out / "images" / recording.name / camera).mkdir(parents=True)
            videos.append({"id": number, "name": f"{recording.name}-{camera}", "camera": camera, "sequence": recording.name})
        for k in recording.frames():
            for video, (camera, size) in enumerate(recording.cameras.items(), 1):
                file, ids = f"{recording.name}/{camera}/{k:06d}.jpg", {"image_id": len(images) + 1, "video_id": video}
                (out / "images" / file).write_bytes(recording.image(k, camera))
                shape = {"width": size.width, "height": size.height}
                images.append({"id": len(images) + 1, **shape, "file_name": file, "video_id": video, "frame_id": k})
                for person in people_in_image(recording, k, camera):
                    annotations.append({"id": len(annotations) + 1, **ids, "category_id": PERSON, **person})
        whole = {
            "info": {"description": f"{recording.name}: synthetic people by pilsim", "version": "1.0"},
            "licenses": [],
            "videos": videos,
            "categories": [category],
            "images": images,
            "annotations": annotations,
        }
        write_json(out / "annotations" / f"{recording.name}.json", whole)
    return []


def people_in_image(recording: RecordedSequence, frame: int, camera: str) -> list[dict[str, Any]]:
    """The fields of annotations, except their ids, of the people with visible pixels in an image, in the order of the boxes."""
    view: ViewTruth | None = recording.views.get((frame, camera))
    masks = encode_masks(recording.instances(frame, camera))
    boxes = view.boxes if view else Boxes.none()
    rows = [k for k, visible in enumerate(boxes.visible) if visible > 0]
    if sorted(boxes.person[rows].tolist()) != list(masks):
        raise ValueError(f"{recording.folder}: instances of {camera} in frame {frame} show {list(masks)}, the boxes {boxes.person[rows].tolist()}")
    people = []
    for k in rows:
        assert view is not None
        person = int(boxes.person[k])
        point, mask = int(np.flatnonzero(view.keypoints.person == person)[0]), masks[person]
        flags = view.keypoints.visibility[point]
        points = np.where(flags[:, None] > 0, view.keypoints.pixels[point] - CENTRE, 0.0).tolist()
        seen, full = ltwh_from_edges(boxes.seen[[k]])[0], ltwh_from_edges(boxes.full[[k]])[0]
        people.append(
            {
                "track_id": person,
                "bbox": seen.tolist(),
                "area": mask.area,
                "segmentation": {"size": [mask.height, mask.width], "counts": encode_counts(mask.counts)},
                "iscrowd": 0,
                "keypoints": [x for (u, v), flag in zip(points, flags.tolist(), strict=True) for x in (round(u, 2), round(v, 2), flag)],
                "num_keypoints": int((flags > 0).sum()),
                "wraps": bool(seen[0] + seen[2] > mask.width),
                "bbox_full": full.tolist(),
                "visibility": float(boxes.visible[k]),
                "range": float(boxes.range[k]),
            }
        )
    return people
