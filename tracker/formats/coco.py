"""COCO (Lin et al. 2014): masks by run lengths, boxes, key points, and tracks over videos. Written and read side by side.

Pixels: boxes are counted from the image's corner (0-based: a whole image is [0, 0, W, H]), key points from the middle of the first pixel. A box in a
panorama may pass the width, where a body lies over the seam: its annotation has `wraps` true.
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
"""Pairs of key points, from 1, as in COCO."""
PERSON = 1
CENTRE = 0.5
"""What the corner's count is ahead of the middle's."""
LARGEST = 2**53
"""Ids from here on are not exact in the floats of other people's JSON readers."""


@dataclass(frozen=True)
class Rle:
    """A mask (height, width): counts of pixels down the columns, off and on in turns, off first."""

    height: int
    width: int
    counts: tuple[int, ...]

    @property
    def area(self) -> int:
        return sum(self.counts[1::2])

    def decode(self) -> NDArray[np.bool_]:
        """(height, width). Raises ValueError where the counts are not those of such an image."""
        if sum(self.counts) != self.height * self.width or min(self.counts, default=0) < 0:
            raise ValueError(f"run lengths add up to {sum(self.counts)}, need {self.height} x {self.width} and none below 0")
        flat = np.repeat(np.arange(len(self.counts)) % 2 == 1, self.counts)
        return np.asarray(flat.reshape(self.width, self.height).T)


def masks(instances: NDArray[np.uint16]) -> dict[int, Rle]:
    """The mask of everybody in an image (H, W) of ids, 0 for nobody; ids ascending. One pass over the image for all of them."""
    height, width = instances.shape
    flat = instances.T.ravel()
    first = np.concatenate([[0], np.flatnonzero(np.diff(flat)) + 1])
    end = np.append(first[1:], flat.size)
    owner = flat[first]
    out = {}
    for person in np.unique(owner[owner > 0]).tolist():
        mine = owner == person
        edges = np.column_stack([first[mine], end[mine]]).ravel()
        counts = np.diff(edges, prepend=0, append=flat.size).tolist()
        out[person] = Rle(height, width, tuple(counts if counts[-1] else counts[:-1]))
    return out


def to_text(counts: Iterable[int]) -> str:
    """COCO's text of run lengths: from the fourth on the difference to the one two before; five bits a character from '0', low bits first."""
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


def from_text(text: str) -> tuple[int, ...]:
    """The run lengths of such a text. Raises ValueError for a character that cannot be in one."""
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
class Shown:
    """Somebody in an image: person id; box (4,) left, top, width, height px, of what is seen; full (4,), of the whole body; visible in
    [0, 1]; range m; mask; keypoints (17, 2) px from the image's corner and their visibility (17,).
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
class Content:
    """What one COCO file holds, gathered image by image: videos, images and annotations as JSON values, ids from 1."""

    videos: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)
    annotations: list[dict[str, Any]] = field(default_factory=list)

    def add_video(self, name: str, camera: str, sequence: str) -> int:
        """A view of a sequence; returns its id."""
        self.videos.append({"id": len(self.videos) + 1, "name": name, "camera": camera, "sequence": sequence})
        return len(self.videos)

    def add_image(self, video: int, file: str, size: tuple[int, int], frame: int) -> int:
        """size: width, height px; frame from 0. Returns the image's id."""
        width, height = size
        image = {"id": len(self.images) + 1, "width": width, "height": height, "file_name": file, "video_id": video, "frame_id": frame}
        self.images.append(image)
        return len(self.images)

    def add(self, image: int, shown: Shown) -> None:
        """Raises ValueError for an id that other readers cannot keep."""
        if not 0 <= shown.person < LARGEST:
            raise ValueError(f"person is {shown.person}, needs 0 to less than 2^53")
        seen = shown.visibility > 0
        points = np.where(seen[:, None], shown.pixels - CENTRE, 0.0)
        width = shown.mask.width
        self.annotations.append(
            {
                "id": len(self.annotations) + 1,
                "image_id": image,
                "video_id": self.images[image - 1]["video_id"],
                "category_id": PERSON,
                "track_id": shown.person,
                "bbox": shown.box.tolist(),
                "area": shown.mask.area,
                "segmentation": {"size": [shown.mask.height, width], "counts": to_text(shown.mask.counts)},
                "iscrowd": 0,
                "keypoints": [x for (u, v), s in zip(points.tolist(), shown.visibility.tolist(), strict=True) for x in (round(u, 2), round(v, 2), s)],
                "num_keypoints": int(seen.sum()),
                "wraps": bool(shown.box[0] + shown.box[2] > width),
                "bbox_full": shown.full.tolist(),
                "visibility": shown.visible,
                "range": shown.range,
            }
        )


def write_coco(path: Path, content: Content, description: str) -> None:
    """One JSON file; the same content gives the same bytes."""
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


def read_coco(path: Path) -> Content:
    """What write_coco wrote. Raises ValueError with the file's name where a field is missing, an id comes twice, or an image is not there."""
    whole = read_json(path)
    try:
        content = Content(list(whole["videos"]), list(whole["images"]), list(whole["annotations"]))
        for name, entries in (("video", content.videos), ("image", content.images), ("annotation", content.annotations)):
            ids = sorted(entry["id"] for entry in entries)
            if any(a == b for a, b in pairwise(ids)):
                raise ValueError(f"an id of the {name}s comes twice")
        images = {image["id"] for image in content.images}
        for annotation in content.annotations:
            if annotation["image_id"] not in images:
                raise ValueError(f"annotation {annotation['id']} is of image {annotation['image_id']}, which is not there")
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: field {error} is missing or of the wrong kind") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return content


def shown_of(annotation: dict[str, Any]) -> Shown:
    """An annotation that Content.add made. Raises ValueError where it is none."""
    try:
        segmentation = annotation["segmentation"]
        height, width = map(int, segmentation["size"])
        mask = Rle(height, width, from_text(segmentation["counts"]))
        points = np.array(annotation["keypoints"], dtype=np.float64).reshape(len(KEYPOINT_NAMES), 3)
        visibility = points[:, 2].astype(np.int64)
        pixels = np.where(visibility[:, None] > 0, points[:, :2] + CENTRE, 0.0)
        box, full = (np.array(annotation[name], dtype=np.float64) for name in ("bbox", "bbox_full"))
        return Shown(int(annotation["track_id"]), box, full, annotation["visibility"], annotation["range"], mask, pixels, visibility)
    except (KeyError, TypeError) as error:
        raise ValueError(f"annotation {annotation.get('id')}: field {error} is missing or of the wrong kind") from None
