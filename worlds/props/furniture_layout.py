"""The layout of furniture: along walls or free on the floor, without blocking a passage."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from worlds.props.furniture import Piece
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import covered, rectangle, signed_distance

# What stands free leaves this much on all sides, m, and what stands at a wall leaves it before itself: two rovers do not fit, one does.
GAP = 1.1
# Furniture stands where the ground under it rises no more than that, m.
LEVEL = 0.07
TRIES = 60

Place = tuple[Array, float]


@final
class Furnishing:
    """What is taken so far, on the grid of the ground: walls (rows, columns), furniture, and what is kept clear."""

    def __init__(self, ground: Heightfield, outline: Array) -> None:
        """outline: corners (k, 2) m of the room; outside of it and within half a cell of its edge is wall."""
        self.ground = ground
        self.nodes = ground.nodes
        self.walls: Mask = signed_distance(self.nodes, outline) > -ground.spacing / 2
        self.furniture: Mask = np.zeros_like(self.walls)
        self.clear: Mask = np.zeros_like(self.walls)

    @property
    def blocked(self) -> Mask:
        return self.walls | self.furniture

    def take(self, corners: ArrayLike) -> None:
        """Something stands on a polygon (k, 2) m."""
        self.furniture |= self._under(corners)

    def keep_clear(self, corners: ArrayLike, margin: float = 0.0) -> None:
        """Nothing shall stand on a polygon (k, 2) m nor within the margin m around it."""
        self.clear |= covered(self.ground, corners, margin)

    def at_wall(self, rng: np.random.Generator, piece: Piece, edges: ArrayLike) -> Place | None:
        """A place with its back to one of the walls, edges (k, 2, 2) m with the room on their left; None where none was found."""
        walls = np.asarray(edges, dtype=np.float64)
        lengths = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
        width, depth = piece.size
        for _ in range(TRIES):
            k = int(rng.choice(len(walls), p=lengths / lengths.sum()))
            ahead = (walls[k, 1] - walls[k, 0]) / lengths[k]
            inwards = np.array([-ahead[1], ahead[0]])
            yaw = float(np.arctan2(inwards[0], -inwards[1]))
            reach = max(lengths[k] - width - 0.1, 0.0)
            position = walls[k, 0] + ahead * (0.05 + width / 2 + rng.uniform(0, reach)) + inwards * (depth / 2 + 0.03)
            under = self._under(piece.footprint(position, yaw))
            before = self._under(rectangle(position + inwards * (depth + GAP) / 2, (width, GAP), yaw))
            fits = reach > 0 and not ((self.furniture | self.clear)[under].any() or (self.blocked & ~under)[before].any())
            if fits and self._level(under):
                return position, yaw
        return None

    def standing_free(self, rng: np.random.Generator, piece: Piece) -> Place | None:
        """A place with GAP on all sides, turned anyhow; None where none was found."""
        room = ndimage.distance_transform_edt(~self.blocked) * self.ground.spacing
        candidates = np.argwhere((room > GAP) & ~self.clear)
        for _ in range(TRIES if len(candidates) else 0):
            i, j = candidates[int(rng.integers(len(candidates)))]
            yaw = float(rng.uniform(-np.pi, np.pi))
            under = self._under(piece.footprint(self.nodes[i, j], yaw))
            if room[under].min() > GAP and not self.clear[under].any() and self._level(under):
                return self.nodes[i, j], yaw
        return None

    def _under(self, corners: ArrayLike) -> Mask:
        return covered(self.ground, corners, self.ground.spacing / 2)

    def _level(self, under: Mask) -> bool:
        heights = self.ground.heights[under]
        return bool(heights.size) and float(np.ptp(heights)) < LEVEL
