"""Markers for RViz and Foxglove: people as cylinders with their ids, boxes on images as lines, and height maps as triangles."""

from __future__ import annotations

import colorsys
from typing import Any

import numpy as np

from tracker.formats.ros.messages import Message, header, vector
from tracker.geometry import Array
from tracker.geometry.ground import Grid

CYLINDER, TEXT, TRIANGLES, DELETE, LINES = 3, 9, 11, 2, 2
"""Marker.CYLINDER, TEXT_VIEW_FACING, TRIANGLE_LIST and DELETE; ImageMarker.LINE_LIST."""
HEIGHT, DIAMETER = 1.75, 0.5
"""m: of the cylinder of every person."""
GOLDEN = 0.618033988749895
"""Hues of successive ids are this share of a turn apart, so that neighbours differ."""
MOST_TRIANGLES = 20_000
"""A finer height map is thinned for its marker, by whole numbers of grid points."""
LIGHT = np.array([-0.4, -0.3, 0.866])
"""Direction to the light that shades the triangles, for viewers without shading."""
GROUND, OBSTACLES = (0.62, 0.56, 0.46), (0.55, 0.57, 0.62)
CLEARANCE = 0.05
"""m: cells whose top is higher above the ground belong to walls and furniture."""


def people_markers(people: list[int], feet: Array, gone: list[int], stamp: int) -> Message:
    """MarkerArray: a cylinder and a label for each person, and the removal of those who have `gone`. feet (n, 3) m, world."""
    top = header(stamp, "world")
    markers: list[Message] = []
    for person, foot in zip(people, feet, strict=True):
        shared = {"header": top, "id": person, "color": person_color(person) | {"a": 0.7}}
        scale = {"x": DIAMETER, "y": DIAMETER, "z": HEIGHT}
        markers.append(shared | {"ns": "people", "type": CYLINDER, "pose": _at(foot, HEIGHT / 2), "scale": scale})
        markers.append(shared | {"ns": "ids", "type": TEXT, "pose": _at(foot, HEIGHT + 0.2), "scale": {"z": 0.3}, "text": str(person)})
    markers += [{"header": top, "ns": ns, "id": person, "action": DELETE} for person in gone for ns in ("people", "ids")]
    return {"markers": markers}


def person_color(person: int) -> Message:
    """ColorRGBA of a person, the same in all topics."""
    r, g, b = colorsys.hsv_to_rgb(person * GOLDEN % 1.0, 0.7, 0.9)
    return {"r": r, "g": g, "b": b, "a": 1.0}


def boxes_marker(boxes: Array, colors: list[Message], turn: float, stamp: int, frame: str) -> Message:
    """ImageMarker with the four sides of each box. boxes (n, 4): left, top, width, height px from the image's corner. colors: n ColorRGBA.

    turn: width of a panorama, px, inf for other cameras. A box that passes the right edge of a panorama is drawn on the left side, too.
    Points have the first pixel's centre at (0, 0).
    """
    points: list[Message] = []
    sides: list[Message] = []
    for (left, top, across, down), color in zip(boxes.tolist(), colors, strict=True):
        for low in [left - 0.5] + [left - 0.5 - turn] * (left + across > turn):
            corners = [(low, top - 0.5), (low + across, top - 0.5), (low + across, top - 0.5 + down), (low, top - 0.5 + down)]
            ends = [corners[k % 4] for k in (0, 1, 1, 2, 2, 3, 3, 4)]
            points += [{"x": u, "y": v} for u, v in ends]
            sides += [color] * len(ends)
    return {"header": header(stamp, frame), "ns": "boxes", "type": LINES, "scale": 2.0, "points": points, "outline_colors": sides}


def _at(foot: Array, above: float) -> Message:
    return {"position": vector(foot + np.array([0.0, 0.0, above])), "orientation": {"w": 1.0}}


def terrain_marker(ground: Grid, name: str, stamp: int, above: Grid | None = None) -> Message | None:
    """Marker of a height map's triangles, with cells split as in Grid; None without triangles.

    above: another map on the same grid; only cells with a corner higher than CLEARANCE above that map are drawn.
    """
    step = max(1, int(np.ceil(np.sqrt(2 * np.prod(np.array(ground.heights.shape) - 1.0) / MOST_TRIANGLES))))
    rows, columns = (np.unique(np.append(np.arange(0, count, step), count - 1)) for count in ground.heights.shape)
    z = ground.heights[np.ix_(rows, columns)]
    x, y = np.meshgrid(ground.origin[0] + columns * ground.spacing, ground.origin[1] + rows * ground.spacing)
    points = np.stack([x, y, z], axis=-1)
    low, right, up, far = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    triangles = np.stack([np.stack([low, right, far], axis=-2), np.stack([low, far, up], axis=-2)], axis=-3)
    if above is not None:
        raised = z - above.heights[np.ix_(rows, columns)] > CLEARANCE
        triangles = triangles[raised[:-1, :-1] | raised[:-1, 1:] | raised[1:, :-1] | raised[1:, 1:]]
    triangles = triangles.reshape(-1, 3, 3)
    return _triangle_list(triangles, name, stamp) if len(triangles) else None


def _triangle_list(triangles: Array, name: str, stamp: int) -> Message:
    """Marker TRIANGLE_LIST of (n, 3, 3) m, shaded by Lambert's law."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    shade = 0.35 + 0.65 * np.clip(normal @ LIGHT, 0.0, 1.0)
    color = np.array(OBSTACLES if name == "obstacles" else GROUND)
    colors: list[dict[str, Any]] = []
    for r, g, b in (shade[:, None] * color).tolist():
        colors += [{"r": r, "g": g, "b": b, "a": 1.0}] * 3
    return {
        "header": header(stamp, "world"),
        "ns": name,
        "type": TRIANGLES,
        "pose": {"orientation": {"w": 1.0}},
        "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
        "color": {"r": color[0], "g": color[1], "b": color[2], "a": 1.0},
        "points": [{"x": px, "y": py, "z": pz} for px, py, pz in triangles.reshape(-1, 3).tolist()],
        "colors": colors,
    }
