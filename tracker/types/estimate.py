"""What the tracker reports of a frame: targets, poses of the robots, and the landmarks of the map."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tracker.geometry import Array, Ints, Pose, set_array, set_ints


@dataclass(frozen=True, eq=False)
class MapSnapshot:
    """The map at one tick: identity (m,), never used again, place (m, 3) m; sighted: robot → the identities (k,) that it saw at this tick."""

    identity: Ints
    place: Array
    sighted: dict[str, Ints]


@dataclass(frozen=True, eq=False)
class LandmarkHistory:
    """The charts of a run as one: places, landmark → (3,) m where it was last believed to be; final: those in the map at the end; sighted: a frame,
    robot → landmarks (k,) that it saw.
    """

    places: dict[int, Array]
    final: Ints
    sighted: tuple[dict[str, Ints], ...]

    @staticmethod
    def of(charts: list[MapSnapshot]) -> LandmarkHistory:
        """Of a chart a frame."""
        places = {int(n): place for chart in charts for n, place in zip(chart.identity, chart.place, strict=True)}
        return LandmarkHistory(places, charts[-1].identity if charts else np.zeros(0, dtype=np.int64), tuple(chart.sighted for chart in charts))

    @property
    def map(self) -> Array:
        """(m, 3) m: the map at the end."""
        return np.array([self.places[int(n)] for n in self.final]).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the tracker believes at one tick.

    T_world_robot and covariance (6, 6) of its right tangent a robot; target_id (k,), never used again; position (k, 3) m on the ground;
    covariance (k, 3, 3) m²; chart: the map, or None where the tracker tells of none.
    """

    index: int
    T_world_robot: dict[str, Pose]
    robot_covariance: dict[str, Array]
    target_id: Ints
    position: Array
    covariance: Array
    counters: dict[str, int] = field(default_factory=dict)
    chart: MapSnapshot | None = None

    @staticmethod
    def of_robots(index: int, T_world_robot: dict[str, Pose], covariance: dict[str, Array], counters: dict[str, int]) -> Estimate:
        """Nobody is there yet."""
        return Estimate(index, T_world_robot, covariance, np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), counters)

    def __post_init__(self) -> None:
        n = len(self.target_id)
        set_ints(self, "target_id", n)
        set_array(self, "position", (n, 3))
        set_array(self, "covariance", (n, 3, 3))
