"""A plan view of an episode: ground, obstacles, robots, fields of view, people and beliefs. Drawn with OpenCV."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from sim.placement.config import YAW
from sim.placement.episode import Episode
from sim.placement.map import CHEST_HEIGHT, PlacementMap
from sim.placement.visibility import line_of_sight
from tracker.geometry import Array, Image

LONGER_SIDE = 800
"""Length of the longer side, px."""
OBSTACLE_HEIGHT = 0.8
"""Height above the floor from which a cell counts as an obstacle, m."""
COLOURS = ((214, 105, 30), (38, 110, 190), (46, 139, 87), (150, 80, 170), (190, 160, 20), (200, 60, 90), (30, 150, 160), (120, 90, 60))
"""RGB of the robots, in their order."""
LEGEND_HEIGHT = 40
"""Height of the legend, px."""
WALKED, ROUGH = (240.0, 236.0, 227.0), (219.0, 213.0, 200.0)
INK, PAPER, SEEN_TWICE, SEEN_ONCE, UNSEEN = (40, 42, 46), (250, 249, 246), (34, 139, 64), (226, 158, 36), (200, 46, 46)
_SHIFT = 4


def draw_plan(episode: Episode) -> Image:
    """The plan view (H, W, 3) RGB, north up.

    Fields of view are tinted in the robots' colours. People are green where two robots see them, amber where one does, red where none does.
    Ellipses show two standard deviations of the beliefs.
    """
    place, now = episode.place, episode.now
    scale, picture = _ground(place)
    picture = _tint(picture.copy(), episode)
    for k in range(len(now.team)):
        _trail(picture, [_pixel(place, step[k], scale) for step in episode.trail], COLOURS[k % len(COLOURS)])
    for mean, P in zip(*episode.estimates(), strict=True):
        _ellipse(picture, _pixel(place, mean, scale), P[:2, :2], scale)
    views = (now.seen > 0).sum(axis=0)
    for person, count in zip(now.people, views.tolist(), strict=True):
        _disc(picture, _pixel(place, person[:2], scale), 0.24 * scale, (UNSEEN, SEEN_ONCE, SEEN_TWICE)[min(count, 2)])
    for k, robot in enumerate(now.team):
        if episode.goals is not None:
            _cross(picture, _pixel(place, place.roadmap.nodes[episode.goals[k]], scale), COLOURS[k % len(COLOURS)])
        _rover(picture, _pixel(place, robot[:2], scale), float(robot[YAW]), 0.5 * scale, COLOURS[k % len(COLOURS)])
    return _legend(picture, views)


@lru_cache(maxsize=8)
def _ground(place: PlacementMap) -> tuple[float, Image]:
    """Pixels per metre, and the empty map: shaded by slope, lighter where people walk, dark at obstacles."""
    low, high = place.extent
    scale = LONGER_SIDE / float((high - low).max())
    size = np.maximum(np.round((high - low) * scale).astype(int), 1).tolist()
    floor, top = place.floor.heights, place.elevation.top
    north, east = np.gradient(floor, place.floor.spacing)
    shade = np.clip(1.0 + 0.8 * (east - north) / np.sqrt(2.0), 0.75, 1.12)[..., None]
    colour = np.where(place.world.feet.free[..., None], WALKED, ROUGH) * shade
    height = (top - floor)[..., None]
    colour = np.where(height > OBSTACLE_HEIGHT, 126.0 - 60.0 * np.clip((height - OBSTACLE_HEIGHT) / 1.5, 0.0, 1.0), colour)
    picture = cv2.resize(np.clip(colour, 0, 255).astype(np.uint8)[::-1], size, interpolation=cv2.INTER_LINEAR)
    return scale, np.asarray(picture, dtype=np.uint8)


def _tint(picture: Image, episode: Episode) -> Image:
    """The ground with the field of view of each robot tinted in its colour."""
    place, now, out = episode.place, episode.now, picture.astype(np.float32)
    nodes = place.floor.nodes.reshape(-1, 2)
    chest = np.column_stack([nodes, place.floor.heights.ravel() + CHEST_HEIGHT])
    for k in range(len(now.team)):
        if now.tipped[k]:
            continue
        near = np.flatnonzero(np.hypot(*(nodes - now.cameras[k, :2]).T) < episode.config.reach)
        sees = np.zeros(len(nodes), dtype=np.float32)
        sees[near] = line_of_sight(place.elevation, now.cameras[k], chest[near])
        mask = cv2.resize(sees.reshape(place.floor.heights.shape)[::-1], picture.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        out += 0.22 * mask[..., None] * (np.array(COLOURS[k % len(COLOURS)], dtype=np.float32) - out)
    return np.asarray(out, dtype=np.uint8)


def _pixel(place: PlacementMap, point: Array, scale: float) -> tuple[float, float]:
    low, high = place.extent
    return float((point[0] - low[0]) * scale), float((high[1] - point[1]) * scale)


def _fixed(*numbers: float) -> list[int]:
    """Pixels as fixed-point integers, as OpenCV takes them."""
    return [round(number * (1 << _SHIFT)) for number in numbers]


def _disc(picture: Image, at: tuple[float, float], radius: float, colour: tuple[int, int, int]) -> None:
    for size, fill in ((radius + 1.5, PAPER), (radius, colour)):
        cv2.circle(picture, _fixed(*at), _fixed(size)[0], fill, -1, cv2.LINE_AA, _SHIFT)


def _trail(picture: Image, points: list[tuple[float, float]], colour: tuple[int, int, int]) -> None:
    if len(points) > 1:
        line = np.array([_fixed(*point) for point in points], dtype=np.int32)
        cv2.polylines(picture, [line], False, colour, 2, cv2.LINE_AA, _SHIFT)


def _cross(picture: Image, at: tuple[float, float], colour: tuple[int, int, int]) -> None:
    for dx, dy in ((6.0, 6.0), (6.0, -6.0)):
        cv2.line(picture, _fixed(at[0] - dx, at[1] - dy), _fixed(at[0] + dx, at[1] + dy), colour, 2, cv2.LINE_AA, _SHIFT)


def _ellipse(picture: Image, at: tuple[float, float], P: Array, scale: float) -> None:
    value, vector = np.linalg.eigh(P)
    axes = 2.0 * np.sqrt(np.maximum(value, 0.0)) * scale
    if axes[1] < LONGER_SIDE:
        angle = -np.degrees(np.arctan2(vector[1, 1], vector[0, 1]))
        cv2.ellipse(picture, _fixed(*at), _fixed(max(axes[1], 2.0), max(axes[0], 2.0)), angle, 0, 360, INK, 1, cv2.LINE_AA, _SHIFT)


def _rover(picture: Image, at: tuple[float, float], yaw: float, size: float, colour: tuple[int, int, int]) -> None:
    """Draw an arrow head as long as a rover, or longer where it would be too small to see."""
    size = max(size, 11.0)
    shape = np.array([(1.0, 0.0), (-0.75, 0.7), (-0.4, 0.0), (-0.75, -0.7)]) * size
    c, s = np.cos(yaw), np.sin(yaw)
    corners = np.array([_fixed(at[0] + x * c - y * s, at[1] - x * s - y * c) for x, y in shape], dtype=np.int32)
    cv2.fillPoly(picture, [corners], colour, cv2.LINE_AA, _SHIFT)
    cv2.polylines(picture, [corners], True, PAPER, 2, cv2.LINE_AA, _SHIFT)


def _legend(picture: Image, views: Array) -> Image:
    """Append a legend: the numbers of people whom two or more, one, and no robots see."""
    out = np.full((picture.shape[0] + LEGEND_HEIGHT, picture.shape[1], 3), PAPER, dtype=np.uint8)
    out[: picture.shape[0]] = picture
    x, y = 14, picture.shape[0] + LEGEND_HEIGHT - 14
    words = (("twice or more", SEEN_TWICE, views >= 2), ("once", SEEN_ONCE, views == 1), ("unseen", UNSEEN, views == 0))
    size = 0.5 if picture.shape[1] > 600 else 0.36
    for word, colour, which in words:
        _disc(out, (x + 5.0, y - 5.0), 6.0, colour)
        text = f"{word} {int(which.sum())}"
        cv2.putText(out, text, (x + 18, y), cv2.FONT_HERSHEY_SIMPLEX, size, INK, 1, cv2.LINE_AA)
        x += 34 + cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0]
    return out
