"""COCO (Lin et al. 2014): run-length masks, boxes, key points and tracks over videos; writer and reader.

Boxes are in pixels from the corner of the image: a whole image is [0, 0, W, H]. Key points are in pixels from the centre of the first pixel.
A box in a panorama may exceed the width, where a body lies over the seam: its annotation has `wraps` true.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array, Ints
from tracker.io.atomic import write_text
from tracker.io.json_files import read_json
from tracker.types import KEYPOINT_NAMES

SKELETON = (
    (16, 14), (14, 12), (17, 15), (15, 13), (12, 13), (6, 12), (7, 13), (6, 7), (6, 8), (7, 9), (8, 10), (9, 11), (2, 3), (1, 2), (1, 3), (2, 4),
    (3, 5), (4, 6), (5, 7),
)  # fmt: skip
"""Pairs of key points that are drawn connected, numbered from 1 as in COCO."""
PERSON = 1
"""Category id."""
CENTRE = 0.5
"""px: centre of the first pixel, from the corner of the image."""
MOST_PIXELS = 1 << 27
"""Of a mask."""
LARGEST = 2**53
"""Ids from here on are not exact in JSON readers that use floats."""


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

    def decode(self) -> NDArray[np.bool_]:
        """The mask (height, width). Raises ValueError where the counts do not fit the size."""
        if not 0 <= self.height * self.width <= MOST_PIXELS:
            raise ValueError(f"mask is {self.height} x {self.width}, needs at most {MOST_PIXELS} pixels")
        if sum(self.counts) != self.height * self.width or min(self.counts, default=0) < 0:
            raise ValueError(f"run lengths add up to {sum(self.counts)}, need {self.height} x {self.width} and none below 0")
        flat = np.repeat(np.arange(len(self.counts)) % 2 == 1, self.counts)
        return np.asarray(flat.reshape(self.width, self.height).T)


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


def decode_counts(text: str) -> tuple[int, ...]:
    """The counts that `encode_counts` wrote. Raises ValueError for other text."""
    out: list[int] = []
    x = shift = 0
    for character in text:
        digit = ord(character) - 48
        if not 0 <= digit < 64 or shift > 60:
            raise ValueError(f"run lengths hold {character!r}, need characters from '0' to 'o'")
        x |= (digit & 0x1F) << shift
        shift += 5
        if not digit & 0x20:
            if digit & 0x10:
                x -= 1 << shift
            out.append(x + (out[-2] if len(out) > 2 else 0))
            x = shift = 0
    if shift:
        raise ValueError("run lengths end within a number")
    return tuple(out)


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
        """Add an annotation of the image with that id. Raises ValueError for a person id above 2^53."""
        if not 0 <= person.person < LARGEST:
            raise ValueError(f"person is {person.person}, needs 0 to less than 2^53")
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


def read_coco(path: Path) -> CocoFile:
    """The file that write_coco wrote. Raises ValueError with the path for missing fields, repeated ids and unknown images."""
    whole = read_json(path)
    try:
        content = CocoFile(list(whole["videos"]), list(whole["images"]), list(whole["annotations"]))
        for name, entries in (("video", content.videos), ("image", content.images), ("annotation", content.annotations)):
            ids = sorted(entry["id"] for entry in entries)
            if any(a == b for a, b in pairwise(ids)):
                raise ValueError(f"an id of the {name}s occurs twice")
        images = {image["id"] for image in content.images}
        for annotation in content.annotations:
            if annotation["image_id"] not in images:
                raise ValueError(f"annotation {annotation['id']} is of image {annotation['image_id']}, which is missing")
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return content


def person_annotation(annotation: dict[str, Any]) -> PersonAnnotation:
    """Parse an annotation that CocoFile.add made. Raises ValueError for missing fields."""
    try:
        segmentation = annotation["segmentation"]
        height, width = map(int, segmentation["size"])
        mask = Rle(height, width, decode_counts(segmentation["counts"]))
        points = np.array(annotation["keypoints"], dtype=np.float64).reshape(len(KEYPOINT_NAMES), 3)
        if not np.isfinite(points).all() or not np.isin(points[:, 2], (0, 1, 2)).all():
            raise ValueError("keypoints: needs finite numbers, each third one of 0, 1 and 2")
        visibility = points[:, 2].astype(np.int64)
        pixels = np.where(visibility[:, None] > 0, points[:, :2] + CENTRE, 0.0)
        box, full = (np.array(annotation[name], dtype=np.float64) for name in ("bbox", "bbox_full"))
        return PersonAnnotation(int(annotation["track_id"]), box, full, annotation["visibility"], annotation["range"], mask, pixels, visibility)
    except (KeyError, TypeError) as error:
        raise ValueError(f"annotation {annotation.get('id')}: field {error} is missing or of the wrong kind") from None
