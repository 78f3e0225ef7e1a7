"""Random crops of rendered images, with pasted people and objects, as training samples.

A batch depends on the seed and its number alone, so that any number of processes gives the same training.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.training.clutter import Picture, piece, texture_bank
from sim.training.photometric import camera_look, recoloured
from sim.training.scene_rendering import ImageSet
from sim.training.targets import HIDDEN, LEAST_HEIGHT, LEAST_INSIDE, LEAST_VISIBLE, Targets, areas, targets_of
from tracker.geometry import Array, Mask
from tracker.person_detector.network import MULTIPLE

SIZES = ((256, 16, (12.0, 210.0)), (256, 16, (12.0, 210.0)), (384, 7, (50.0, 370.0)))
"""Kinds of batches, used in turn: edge of the crops, px; their number; and bounds of the height of the chosen body, px, log-uniform."""
PANORAMA_SHARE, CHOSEN_SHARE = 0.42, 0.87
"""Share of crops from panoramas, and of crops around a chosen body. Other crops are anywhere."""
SCALES = (0.2, 2.4)
"""Bounds of the scale, px of the crop per px of its image. It may exceed 1, since the detector searches small bodies at twice the size."""
ASPECT = 0.07
"""Sigma of the logarithm of the ratio of both scales."""
PASTED_VISIBLE, PASTED_HEIGHT = 0.98, 36.0
"""Least visible share and height (px) of a body that is cut out and pasted elsewhere."""
FIRST_PASTED = 240
"""Instance of the first pasted body."""
FILLED = 0.4
"""Share of its box that a body fills."""
HIDDEN_SHARE, SCREEN_SHARE = 0.35, 0.1
"""Shares of crops in which something hides a part of a body, and of those with a screen or a picture that shows another image."""
ENDED_SHARE = 0.25
"""Share of crops in which the image ends before the crop does. The detector continues images by their last pixels to multiples of 32 px."""


@dataclass(eq=False)
class _CrowdCrop:
    """A crop under construction: picture (S, S, 3), instances (S, S), and its bodies.

    boxes (n, 4) px, person (n,) their instances, visible (n,).
    """

    picture: Picture
    instances: NDArray[np.uint8]
    boxes: Array
    person: NDArray[np.int64]
    visible: Array

    @property
    def height(self) -> float:
        """Median height of the bodies that can be found, px; a third of the crop where there are none."""
        tall = (self.boxes[:, 3] - self.boxes[:, 1])[self.visible >= LEAST_VISIBLE]
        return float(np.median(tall)) if len(tall) else len(self.picture) / 3

    def visible_here(self) -> Array:
        """Visible shares (n,) of the bodies, or less where their visible parts lie outside of the crop."""
        inside = np.clip(self.boxes, 0, len(self.picture))
        pixels = np.bincount(self.instances.ravel(), minlength=256)[self.person]
        return np.minimum(self.visible, pixels / np.maximum(FILLED * areas(inside), 1.0))

    def mirror(self) -> None:
        """Exchange left and right."""
        self.picture, self.instances = (np.ascontiguousarray(layer[:, ::-1]) for layer in (self.picture, self.instances))
        size = len(self.picture)
        self.boxes = np.stack([size - self.boxes[:, 2], self.boxes[:, 1], size - self.boxes[:, 0], self.boxes[:, 3]], axis=1)

    def paste(self, picture: Picture, mask: NDArray[np.uint8], corner: tuple[int, int], instance: int, behind: bool) -> None:
        """Paste a picture at a corner (x, y), in front of all bodies or behind them. The visible shares of the bodies it hides shrink."""
        size = len(self.picture)
        x, y = corner
        left, top, right, bottom = max(x, 0), max(y, 0), min(x + mask.shape[1], size), min(y + mask.shape[0], size)
        if left >= right or top >= bottom:
            return
        part = (slice(top, bottom), slice(left, right))
        inside = mask[top - y : bottom - y, left - x : right - x] > 0
        if behind:
            inside &= self.instances[part] == 0
        else:
            before = np.bincount(self.instances.ravel(), minlength=256)
            self.instances[part][inside] = instance
            after = np.bincount(self.instances.ravel(), minlength=256)
            self.visible = self.visible * after[self.person] / np.maximum(before[self.person], 1)
        self.picture[part][inside] = picture[top - y : bottom - y, left - x : right - x][inside]


@dataclass(frozen=True, eq=False)
class CropSampler:
    """Samples batches from panoramas and pinhole images. seed: of all draws."""

    panoramas: list[ImageSet]
    pinholes: list[ImageSet]
    seed: int

    def batch(self, number: int) -> dict[str, NDArray[Any]]:
        """The batch of that number: picture (b, S, S, 3) uint8 RGB, and the targets of each crop, stacked under the names of Targets."""
        rng = np.random.default_rng([self.seed, 2, number])
        size, count, heights = SIZES[number % len(SIZES)]
        made = [self._sample(rng, size, heights) for _ in range(count)]
        stacked = {field.name: np.stack([getattr(target, field.name) for _, target in made]) for field in fields(Targets)}
        return {"picture": np.stack([picture for picture, _ in made])} | stacked

    def _sample(self, rng: np.random.Generator, size: int, heights: tuple[float, float]) -> tuple[Picture, Targets]:
        crop = self._crop(rng, size, heights)
        self._change_background(crop, rng)
        if rng.random() < 0.6:
            crop.picture = recoloured(crop.picture, crop.instances, rng)
        if rng.random() < 0.35:
            self._paste_people(crop, rng)
        if rng.random() < 0.5:
            self._paste_clutter(crop, rng)
        if rng.random() < SCREEN_SHARE:
            self._paste_screen(crop, rng)
        if rng.random() < HIDDEN_SHARE:
            self._hide(crop, rng)
        crop.picture = camera_look(crop.picture, rng)
        if rng.random() < 0.5:
            crop.mirror()
        if rng.random() < ENDED_SHARE:
            self._end(crop, rng)
        return crop.picture, targets_of(crop.boxes, crop.visible_here(), size, visible_parts(crop.instances, crop.person, crop.boxes))

    def _image(self, rng: np.random.Generator) -> tuple[ImageSet, int, bool]:
        """A random image: its set, its index, and whether it is a panorama."""
        wraps = bool(rng.random() < PANORAMA_SHARE and self.panoramas)
        sets = self.panoramas if wraps or not self.pinholes else self.pinholes
        chosen = sets[int(rng.integers(len(sets)))]
        return chosen, int(rng.integers(len(chosen.colour))), sets is self.panoramas

    def _crop(self, rng: np.random.Generator, size: int, heights: tuple[float, float]) -> _CrowdCrop:
        images, index, wraps = self._image(rng)
        height, width = images.instances.shape[1:]
        mine = images.image == index
        boxes, person, visible = images.boxes[mine], images.person[mine], images.visible[mine]
        good = np.flatnonzero((visible >= LEAST_VISIBLE) & (boxes[:, 3] - boxes[:, 1] >= LEAST_HEIGHT))
        least = size / height
        scale, middle = max(float(np.exp(rng.uniform(*np.log([0.35, 1.3])))), least), np.array([rng.uniform(0, width), rng.uniform(0, height)])
        if len(good) and rng.random() < CHOSEN_SHARE:
            box = boxes[good[int(rng.integers(len(good)))]]
            scale = max(float(np.exp(rng.uniform(*np.log(heights)))) / (box[3] - box[1]), least)
            middle = (box[:2] + box[2:]) / 2 + rng.uniform(-0.4, 0.4, 2) * size / np.clip(scale, *SCALES)
        scales = np.clip(scale, *SCALES) * np.exp(rng.normal(0.0, ASPECT / 2) * np.array([1.0, -1.0]))
        return self._cut_out(images, index, (wraps, boxes, person, visible), (scales, middle, size))

    def _cut_out(
        self,
        images: ImageSet,
        index: int,
        bodies: tuple[bool, Array, NDArray[np.int64], Array],
        window: tuple[Array, Array, int],
    ) -> _CrowdCrop:
        """The window of an image around `middle` px, scaled to a crop. It lies within the image, but for the seam of a panorama."""
        wraps, boxes, person, visible = bodies
        scales, middle, size = window
        limits = np.array(images.instances.shape[:0:-1])
        side = np.minimum(np.maximum(np.rint(size / scales), 8), limits).astype(int)
        corner = np.rint(middle - side / 2).astype(int)
        corner = np.array([corner[0] if wraps else np.clip(corner[0], 0, limits[0] - side[0]), np.clip(corner[1], 0, limits[1] - side[1])])
        rows, columns = slice(corner[1], corner[1] + side[1]), np.arange(corner[0], corner[0] + side[0]) % limits[0]
        colour, instances = (layer[index][rows].take(columns, axis=1) for layer in (images.colour, images.instances))
        picture = cv2.resize(colour, (size, size), interpolation=cv2.INTER_AREA if scales.mean() < 1 else cv2.INTER_LINEAR)
        shown = cv2.resize(instances, (size, size), interpolation=cv2.INTER_NEAREST)
        moved = boxes - np.tile(corner, 2)
        if wraps:
            # Each body is shifted by full turns of the panorama to the place nearest to the middle of the window.
            turn = np.round(((moved[:, 0] + moved[:, 2]) / 2 - side[0] / 2) / limits[0]) * limits[0]
            moved = moved - turn[:, None] * np.array([1, 0, 1, 0])
        moved = moved * np.tile(size / side, 2)
        near = ((moved[:, 2:] > 0) & (moved[:, :2] < size)).all(axis=1)
        return _CrowdCrop(np.asarray(picture, np.uint8), np.asarray(shown, np.uint8), moved[near], person[near], visible[near].copy())

    def _texture(self, rng: np.random.Generator, size: int) -> Picture:
        """A random part of a random texture, of `size` px."""
        textures = _textures(self.seed)
        texture = textures[int(rng.integers(len(textures)))]
        x, y = rng.integers(0, len(texture) - size + 1, 2).tolist()
        return texture[y : y + size, x : x + size].copy()

    def _change_background(self, crop: _CrowdCrop, rng: np.random.Generator) -> None:
        """Replace the background by a texture, or shade it by one, or neither."""
        kind = rng.random()
        if kind > 0.35:
            return
        texture, behind = self._texture(rng, len(crop.picture)), crop.instances == 0
        if kind > 0.12:
            share = np.float32(rng.uniform(0.15, 0.6))
            texture = (crop.picture * (1 - share) + texture * share).astype(np.uint8)
        crop.picture[behind] = texture[behind]

    def _paste_people(self, crop: _CrowdCrop, rng: np.random.Generator) -> None:
        """Paste bodies from other images, one after the other in front of all."""
        size = len(crop.picture)
        for k in range(int(rng.integers(1, 4))):
            found = self._body(rng)
            if found is None:
                continue
            picture, mask, box = found
            scale = crop.height * np.exp(rng.normal(0.0, 0.25)) / (box[3] - box[1])
            shape = tuple(np.maximum(np.rint(np.array(mask.shape[::-1]) * scale), 4).astype(int).tolist())
            if scale > 2.5 or max(shape) > 2 * size:
                continue
            picture = np.asarray(cv2.resize(picture, shape, interpolation=cv2.INTER_AREA), np.uint8)
            mask = np.asarray(cv2.resize(mask, shape, interpolation=cv2.INTER_AREA) > 127, np.uint8)
            at = np.rint(rng.uniform(-0.1, 0.9, 2) * size).astype(int)
            gain = np.exp(rng.normal(0.0, 0.3))
            picture = (picture * gain).clip(0, 255).astype(np.uint8)
            crop.paste(picture, mask, (int(at[0]), int(at[1])), FIRST_PASTED + k, behind=False)
            crop.boxes = np.vstack([crop.boxes, np.concatenate([at, at + shape])])
            crop.person, crop.visible = np.append(crop.person, FIRST_PASTED + k), np.append(crop.visible, 1.0)

    def _body(self, rng: np.random.Generator) -> tuple[Picture, NDArray[np.uint8], Array] | None:
        """A body that nothing hides: its picture, its mask and its box; None where the random image has none."""
        images, index, _ = self._image(rng)
        height, width = images.instances.shape[1:]
        whole = ~cut_off(images.boxes, width, height, False)
        tall = images.boxes[:, 3] - images.boxes[:, 1] >= PASTED_HEIGHT
        good = np.flatnonzero((images.image == index) & (images.visible >= PASTED_VISIBLE) & whole & tall)
        if not len(good):
            return None
        chosen = good[int(rng.integers(len(good)))]
        left, top, right, bottom = images.boxes[chosen].astype(int).tolist()
        mask = (images.instances[index][top:bottom, left:right] == images.person[chosen]).astype(np.uint8) * np.uint8(255)
        return np.array(images.colour[index][top:bottom, left:right]), mask, images.boxes[chosen]

    def _paste_clutter(self, crop: _CrowdCrop, rng: np.random.Generator) -> None:
        """Paste things that are no people."""
        size = len(crop.picture)
        for _ in range(int(rng.integers(1, 5))):
            tall = int(np.clip(crop.height * np.exp(rng.normal(-0.3, 0.5)), 8, 0.8 * size))
            picture, mask = piece(rng, tall)
            at = rng.integers(-size // 10, size, 2).tolist()
            crop.paste(picture, mask, (at[0], at[1]), 0, behind=bool(rng.random() < 0.7))

    def _hide(self, crop: _CrowdCrop, rng: np.random.Generator) -> None:
        """Hide the lower part of a body, or one side of it, as tables, cars, walls and trunks do."""
        whole = np.flatnonzero(crop.visible > 0.6)
        if not len(whole):
            return
        left, top, right, bottom = crop.boxes[whole[int(rng.integers(len(whole)))]]
        wide, tall, size = right - left, bottom - top, len(crop.picture)
        if rng.random() < 0.7:
            low = top + rng.uniform(0.15, 0.75) * tall, bottom + rng.uniform(0.0, 0.4) * tall
            ends = left - rng.exponential(1.5) * wide - 1, right + rng.exponential(1.5) * wide + 1
        else:
            low, width = (top - rng.uniform(0.0, 1.0) * tall, bottom + rng.uniform(0.0, 0.4) * tall), rng.uniform(0.3, 2.0) * wide
            side = left + rng.uniform(0.25, 0.75) * wide
            ends = (side, side + width) if rng.random() < 0.5 else (side - width, side)
        corner = np.clip(np.floor([ends[0], low[0]]), 0, size).astype(int)
        shape = np.maximum(np.clip(np.ceil([ends[1], low[1]]), 0, size).astype(int) - corner, 2)
        picture = self._texture(rng, size)[: shape[1], : shape[0]]
        if rng.random() < 0.5:
            shade = np.linspace(rng.uniform(0.7, 1.3), rng.uniform(0.7, 1.3), len(picture))[:, None, None]
            picture = (rng.uniform(10, 245, 3) * shade + 0.15 * (picture - 128.0)).clip(0, 255).astype(np.uint8)
        crop.paste(picture, np.full(picture.shape[:2], 255, np.uint8), (int(corner[0]), int(corner[1])), 0, behind=False)

    def _paste_screen(self, crop: _CrowdCrop, rng: np.random.Generator) -> None:
        """Paste a part of another image within a frame, behind all bodies: people on screens must not be detected."""
        images, index, _ = self._image(rng)
        size, (height, width) = len(crop.picture), images.instances.shape[1:]
        wide = int(size * rng.uniform(0.12, 0.6))
        tall, side = int(wide * rng.uniform(0.5, 0.8)), int(rng.uniform(0.15, 0.6) * height)
        x, y = int(rng.integers(0, width - side)), int(rng.integers(0, height - side))
        screen = cv2.resize(images.colour[index][y : y + side, x : x + side], (wide, tall), interpolation=cv2.INTER_AREA).astype(np.float32)
        screen = (screen * rng.uniform(0.6, 1.4) + rng.uniform(0, 30)).clip(0, 255).astype(np.uint8)
        edge = max(1, round(0.03 * wide))
        framed = cv2.copyMakeBorder(screen, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=rng.uniform(0, 90, 3).tolist())
        at = rng.integers(-wide // 4, size - wide // 2, 2).tolist()
        crop.paste(np.asarray(framed, np.uint8), np.full(framed.shape[:2], 255, np.uint8), (at[0], at[1]), 0, behind=True)

    def _end(self, crop: _CrowdCrop, rng: np.random.Generator) -> None:
        """Let the image end before the crop at the right and below: its last pixels are repeated. Bodies end with the image."""
        size = len(crop.picture)
        columns, rows = (size - rng.integers(0, MULTIPLE, 2)).tolist()
        before = np.maximum(areas(crop.boxes), 1e-9)
        crop.boxes = np.minimum(crop.boxes, [columns, rows, columns, rows])
        inside = areas(crop.boxes) / before
        crop.visible = np.where(inside < LEAST_INSIDE, HIDDEN, crop.visible * inside)
        crop.instances[rows:], crop.instances[:, columns:] = 0, 0
        ended = cv2.copyMakeBorder(crop.picture[:rows, :columns], 0, size - rows, 0, size - columns, cv2.BORDER_REPLICATE)
        crop.picture = np.asarray(ended, np.uint8)


@cache
def _textures(seed: int) -> list[Picture]:
    return texture_bank(np.random.default_rng([seed, 1]))


def cut_off(boxes: Array, width: int, height: int, wraps: bool) -> Mask:
    """Whether boxes (n, 4) px touch the edge of their image, so that the whole body is unknown. wraps: a panorama has no left and right edge."""
    ends = (boxes[:, 1] <= 0) | (boxes[:, 3] >= height)
    return np.asarray(ends if wraps else ends | (boxes[:, 0] <= 0) | (boxes[:, 2] >= width))


def visible_parts(instances: NDArray[np.uint8], person: NDArray[np.int64], boxes: Array, wraps: bool = False) -> Array:
    """Left, top, right, bottom (n, 4) px around the pixels of bodies in an image (H, W) of their numbers `person` (n,).

    It is the box of a body without a pixel. boxes (n, 4) px. wraps: in a panorama, boxes and parts may pass the seam at the right edge.
    """
    out, width, parts = boxes.copy(), instances.shape[1], ndimage.find_objects(instances)
    for k, number in enumerate(person.tolist()):
        if not 0 < number <= len(parts) or parts[number - 1] is None:
            continue
        (rows, columns), turn = parts[number - 1], 0
        if wraps and boxes[k, 2] > width:
            turn = int(boxes[k, 0]) - 8
            rows, columns = ndimage.find_objects((np.roll(instances, -turn, axis=1) == number).astype(np.uint8))[0]
        out[k] = columns.start + turn, rows.start, columns.stop + turn, rows.stop
    return out
