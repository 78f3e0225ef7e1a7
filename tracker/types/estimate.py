"""What the tracker reports: an estimate of each frame, and the landmarks of a whole run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.geometry import Array, Ints, Pose, set_array, set_ints


@dataclass(frozen=True, eq=False)
class MapSnapshot:
    """The landmark map at one tick: landmark_id (m,), position (m, 3) m in the world. Ids are never reused.

    sighted: robot → ids (k,) of the landmarks that it observed at this tick.
    """

    landmark_id: Ints
    position: Array
    sighted: dict[str, Ints]


@dataclass(frozen=True, eq=False)
class LandmarkHistory:
    """All landmarks of a run.

    positions: landmark id → (3,) m, its last estimate. final: ids of the landmarks in the map after the last tick.
    sighted: for each tick, robot → ids (k,) of the landmarks that it observed.
    """

    positions: dict[int, Array]
    final: Ints
    sighted: tuple[dict[str, Ints], ...]

    @staticmethod
    def of(snapshots: list[MapSnapshot]) -> LandmarkHistory:
        """Combine the snapshots of all ticks, in order."""
        positions = {int(n): position for snapshot in snapshots for n, position in zip(snapshot.landmark_id, snapshot.position, strict=True)}
        final = snapshots[-1].landmark_id if snapshots else np.zeros(0, dtype=np.int64)
        return LandmarkHistory(positions, final, tuple(snapshot.sighted for snapshot in snapshots))

    @property
    def map(self) -> Array:
        """Positions (m, 3) m of the landmarks in `final`."""
        return np.array([self.positions[int(n)] for n in self.final]).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate of the tracker at one tick.

    T_world_robot: robot → pose. robot_covariance: robot → (6, 6) of the right tangent.
    target_id (k,): ids of the confirmed tracks, never reused. position (k, 3) m on the ground, world. covariance (k, 3, 3) m².
    counters: name of an event → its count at this tick. map_snapshot: the landmark map, or None where the tracker has none.
    """

    index: int
    T_world_robot: dict[str, Pose]
    robot_covariance: dict[str, Array]
    target_id: Ints
    position: Array
    covariance: Array
    counters: dict[str, int] = field(default_factory=dict)
    map_snapshot: MapSnapshot | None = None

    @staticmethod
    def of_robots(index: int, T_world_robot: dict[str, Pose], covariance: dict[str, Array], counters: dict[str, int]) -> Estimate:
        """An estimate of the robots without any target."""
        return Estimate(index, T_world_robot, covariance, np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), counters)

    def __post_init__(self) -> None:
        n = len(self.target_id)
        set_ints(self, "target_id", (n,))
        set_array(self, "position", (n, 3))
        set_array(self, "covariance", (n, 3, 3))
