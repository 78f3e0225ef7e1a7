"""Tracks of people as upright 3-D boxes of one size with the yaw of their motion.

A box is x, y, z of its middle (m), width, length, height (m) and yaw (rad). The width lies along the box's own x axis, the length along its y axis.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tracker.geometry import Array, Ints

PERSON = (0.6, 0.6, 1.75)
"""m: width, length and height of the box of a person whose size is not known."""
STEP = 0.2
"""m: displacement after which the yaw of a person is updated. It exceeds the position noise of standing people."""


def headings(tracks: Mapping[int, tuple[Ints, Array]], online: bool = False) -> dict[int, Array]:
    """The yaw of each person, in the direction of motion. tracks: frame → ids (k,) and positions (k, ≥ 2) m. Returns frame → yaw (k,) rad.

    The yaw is the direction of the last displacement of at least STEP. A standing person keeps the last yaw.
    Before the first displacement, the yaw is that of this displacement, or 0 where `online`. A person who never moves has 0.
    """
    anchor: dict[int, Array] = {}
    last: dict[int, float] = {}
    first: dict[int, float] = {}
    known: dict[int, list[float | None]] = {}
    for frame in sorted(tracks):
        ids, positions = tracks[frame]
        for person, position in zip(np.asarray(ids).tolist(), np.asarray(positions, dtype=np.float64), strict=True):
            step = position[:2] - anchor.setdefault(person, position[:2])
            if np.hypot(*step) >= STEP:
                last[person], anchor[person] = float(np.arctan2(step[1], step[0])), position[:2]
                first.setdefault(person, last[person])
        known[frame] = [last.get(person) for person in np.asarray(ids).tolist()]

    def yaw(person: int, value: float | None) -> float:
        return value if value is not None else 0.0 if online else first.get(person, 0.0)

    return {frame: np.array([yaw(p, v) for p, v in zip(np.asarray(tracks[frame][0]).tolist(), row, strict=True)]) for frame, row in known.items()}


def person_boxes(feet: Array, yaw: Array) -> Array:
    """Boxes (n, 7) of people who stand at feet (n, 3) m with yaw (n,) rad: PERSON in size, upright."""
    positions = np.asarray(feet, dtype=np.float64).reshape(-1, 3)
    size = np.tile(PERSON, (len(positions), 1))
    return np.column_stack([positions[:, :2], positions[:, 2] + PERSON[2] / 2, size, np.asarray(yaw, dtype=np.float64)])


def boxes_of_tracks(tracks: Mapping[int, tuple[Ints, Array]], online: bool = False) -> dict[int, tuple[Ints, Array]]:
    """Tracks, frame → ids (k,) and feet (k, 3) m, as frame → ids (k,) and boxes (k, 7) of people with the yaw of `headings`."""
    yaw = headings(tracks, online)
    return {frame: (ids, person_boxes(feet, yaw[frame])) for frame, (ids, feet) in tracks.items()}
