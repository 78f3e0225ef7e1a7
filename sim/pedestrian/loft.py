"""Lofted limbs: sections joined to a textured triangle mesh at several levels of detail.

A section (z, a, b, cx, cy, sx, sy) is a superellipse in a plane at height z with centre (cx, cy).
Its half widths along x and y are a and b, the slopes of its plane sx and sy.
The texture wraps around once: its middle column is in front (+x), its left and right edges are at the back.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracker.geometry import Array, frozen

LEVELS = 3
"""Levels of detail; 0 is the finest."""
TOLERANCE = (0.0, 0.006, 0.014)
"""Tolerance of each level, a share of stature. Sections nearer to the line between their neighbours are left out."""
UPRIGHT = np.eye(3)
FORWARD = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
"""Rotates an upward loft to a forward loft with its front on top."""


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh: vertices (n, 3), normals (n, 3) unit, texcoord (n, 2) with v downwards, faces (m, 3) anticlockwise from outside."""

    vertices: Array
    normals: Array
    texcoord: Array
    faces: NDArray[np.int64]

    @staticmethod
    def joined(skins: list[Skin]) -> Skin:
        """All meshes as one."""
        first = np.cumsum([0, *(len(s.vertices) for s in skins)])
        faces = np.concatenate([s.faces + k for s, k in zip(skins, first[:-1], strict=True)])
        vertices, normals, texcoord = (np.concatenate([getattr(s, name) for s in skins]) for name in ("vertices", "normals", "texcoord"))
        return Skin(vertices, normals, texcoord, faces)


@dataclass(frozen=True, eq=False)
class Part:
    """One loft of a limb.

    sections (k, 7): z, a, b, cx, cy, sx, sy from one end to the other, shares of stature.
    region (4,): texture coordinates u0, v0, u1, v1, with v0 at the last section. around: corners of a section at each level, 0 to omit the part.
    power: exponent of the superellipse (2 is an ellipse, higher is boxier). closed: whether the ends have caps. axes (3, 3): rotation.
    rounding: sections that round off the first and the last end; the coarsest level omits them.
    """

    sections: Array
    region: Array
    around: tuple[int, int, int]
    power: float = 2.3
    closed: bool = False
    axes: Array = field(default_factory=lambda: UPRIGHT)
    rounding: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sections", frozen(self.sections, (None, 7), "sections"))
        object.__setattr__(self, "region", frozen(self.region, (4,), "region"))

    def skin(self, level: int) -> Skin | None:
        """Mesh of the part at a level of detail; None if the level omits it."""
        n = self.around[level]
        rows = self.sections[self.rounding[0] : len(self.sections) - self.rounding[1]] if level == LEVELS - 1 else self.sections
        return _loft(self, rows[_simplified(rows, TOLERANCE[level])], n) if n else None


def sections(*rows: ArrayLike) -> Array:
    """Sections (k, 7) from rows (z, a, b), (z, a, b, cx), …; missing values are 0."""
    out = np.zeros((len(rows), 7))
    for k, row in enumerate(rows):
        values = np.asarray(row, dtype=np.float64)
        out[k, : len(values)] = values
    return out


def _loft(part: Part, rows: Array, n: int) -> Skin:
    """Mesh over these sections with n corners around."""
    angle = np.linspace(-np.pi, np.pi, n + 1)
    # Widen the polygon, so that its mean width is that of the section.
    wide = 2 / (1 + np.cos(np.pi / n))
    c, s = np.cos(angle), np.sin(angle)
    x, y = np.sign(c) * np.abs(c) ** (2 / part.power), np.sign(s) * np.abs(s) ** (2 / part.power)
    z, a, b, cx, cy, sx, sy = (column[:, None] for column in rows.T)
    across, aside = wide * a * x, wide * b * y
    points = np.stack([cx + across, cy + aside, z + sx * across + sy * aside], axis=-1)
    up = np.gradient(points, axis=0)
    round_ = np.empty_like(points)
    round_[:, 1:-1] = points[:, 2:] - points[:, :-2]
    round_[:, 0] = round_[:, -1] = points[:, 1] - points[:, -2]
    sign = 1.0 if rows[-1, 0] > rows[0, 0] else -1.0
    normals = sign * np.cross(round_, up)
    u0, v0, u1, v1 = part.region
    along = (rows[:, 0] - rows[0, 0]) / (rows[-1, 0] - rows[0, 0])
    texcoord = np.stack(np.broadcast_arrays((u0 + (u1 - u0) * (0.5 + angle / (2 * np.pi)))[None], (v1 + (v0 - v1) * along)[:, None]), axis=-1)
    i, j = np.meshgrid(np.arange(len(rows) - 1), np.arange(n), indexing="ij")
    corner = (i * (n + 1) + j).ravel()
    quads = np.stack([corner, corner + 1, corner + n + 2, corner + n + 1], axis=1)[:, :: int(sign)]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    skin = Skin(points.reshape(-1, 3), normals.reshape(-1, 3), texcoord.reshape(-1, 2), faces)
    if part.closed:
        skin = _with_end_caps(skin, points, texcoord, sign)
    length = np.maximum(np.linalg.norm(skin.normals, axis=1), 1e-12)
    return Skin(skin.vertices @ part.axes.T, skin.normals / length[:, None] @ part.axes.T, skin.texcoord, skin.faces)


def _with_end_caps(skin: Skin, points: Array, texcoord: Array, sign: float) -> Skin:
    """The mesh with a triangle fan over each end."""
    rings, n = points.shape[0], points.shape[1] - 1
    total = len(skin.vertices)
    middles = points[[0, -1], :-1].mean(axis=1)
    middle_texcoord = texcoord[[0, -1]].mean(axis=1)
    k = np.arange(n)
    last = (rings - 1) * (n + 1)
    low = np.stack([np.full(n, total), k + 1, k], axis=1)
    high = np.stack([np.full(n, total + 1), last + k, last + k + 1], axis=1)
    step = int(sign)
    return Skin(
        np.concatenate([skin.vertices, middles]),
        np.concatenate([skin.normals, [[0, 0, -sign], [0, 0, sign]]]),
        np.concatenate([skin.texcoord, middle_texcoord]),
        np.concatenate([skin.faces, low[:, ::step], high[:, ::step]]),
    )


def _simplified(rows: Array, tolerance: float) -> NDArray[np.int64]:
    """Indices of the kept sections (Douglas & Peucker 1973, on centre and widths as functions of height)."""
    if tolerance <= 0 or len(rows) < 3:
        return np.arange(len(rows))
    span = rows[-1, 0] - rows[0, 0]
    share = ((rows[:, 0] - rows[0, 0]) / span)[:, None]
    off = np.abs(rows[:, 1:5] - rows[0, 1:5] - share * (rows[-1, 1:5] - rows[0, 1:5])).max(axis=1)
    worst = int(np.argmax(off))
    if off[worst] <= tolerance:
        return np.array([0, len(rows) - 1])
    low, high = _simplified(rows[: worst + 1], tolerance), _simplified(rows[worst:], tolerance) + worst
    return np.concatenate([low, high[1:]])
