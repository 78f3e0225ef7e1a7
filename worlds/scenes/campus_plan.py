"""The ground plan of the world campus, in the world frame of PETS 2009 (Ferryman and Shahrokni 2009), read off the view of camera View_001."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from worlds.terrain.heightfield import Array
from worlds.terrain.polygons import signed_distance

EXTENT = np.array([[-31.0, -29.0], [21.0, 21.0]])
WALKED = np.array([(-19.9, -10.9), (-17.1, -16.3), (-13.0, -15.5), (-7.1, -13.9), (7.0, -8.9), (6.8, -8.2), (-5.6, 8.5), (-6.0, 8.5), (-10.0, 3.6)])
"""m: around all feet of the complete annotations of S1.L1 and S2.L1."""
CAMERAS = np.array(
    [(-28.94, -19.53), (-3.70, -24.28), (-34.27, -37.5), (26.1, 75.64), (-14.64, -1.67), (-15.86, -12.99), (-2.78, -16.58), (-0.17, -3.53)]
)
"""m: where the cameras View_001 to View_008 stand."""
ROAD = np.array(
    [
        (-17.2, -29), (-8.6, -29), (-7.0, -17), (-5.9, -13.9), (-2.8, -12.3), (0.3, -10.7), (3.4, -10.2), (21, -10.2), (21, -5.0), (-0.6, -5.2),
        (-2.5, -4.8), (-3.6, -3.8), (-4.3, -2.1), (-5.2, 3.0), (-5.1, 21), (-10.4, 21), (-10.0, 4.2), (-10.1, -2.4), (-11.1, -7.0), (-12.3, -9.8),
        (-13.8, -13.8),
    ]
)  # fmt: skip
CAR_PARK = np.array([(-5.3, 0.8), (1.8, 0.8), (1.8, 11.5), (-5.2, 11.5)])
BUILDING = np.array([(12.6, -2.6), (20.4, -2.6), (20.4, 8.6), (12.6, 8.6)])
HUT = np.array([(14.0, -20.0), (19.0, -20.0), (19.0, -15.5), (14.0, -15.5)])
LAMPS = np.array([(-13.7, -10.6), (-3.3, 14.0), (9.5, -3.8), (-20.0, 13.0)])
BOULDERS = np.array([(-10.7, -1.3), (4.0, -11.6), (7.5, -11.4), (10.5, -11.5), (-2.2, -13.6)])
BENCHES = np.array([(-16.5, 6.0), (10.7, -1.3), (-23.0, 2.0), (11.7, 7.0)])
CARS = np.array([(16.0, -4.2), (17.5, -11.2), (-2.8, 9.2), (-0.2, 9.2)])
"""m: the first two are parked along the road and in nobody's sight."""
KERB_RAMPS = np.array(
    [(-10.2, 8.0), (-10.4, -4.0), (-13.2, -12.0), (-3.9, -3.2), (3.0, -5.1), (11.0, -5.1), (-4.4, -13.2), (8.0, -10.3), (-7.6, -21.0)]
)
"""m: where kerbs are lowered for wheels."""


@dataclass(frozen=True, eq=False)
class Sights:
    """What lies between the cameras and where people walk: convex polygons, one a camera."""

    polygons: tuple[Array, ...]

    @staticmethod
    def of_cameras() -> Sights:
        hulls = []
        for camera in CAMERAS:
            points = np.concatenate([WALKED, camera[None]])
            hulls.append(points[ConvexHull(points).vertices])
        return Sights(tuple(hulls))

    def distance(self, points: Array) -> Array:
        """Points (..., 2) m → (...) m to the nearest line of sight; negative among them."""
        return np.minimum.reduce([signed_distance(points, polygon) for polygon in self.polygons])


def kept_clear(points: Array) -> Array:
    """Points (..., 2) m → (...) m to the nearest road, car park or building; negative on it."""
    return np.minimum.reduce([signed_distance(points, polygon) for polygon in (ROAD, CAR_PARK, BUILDING, HUT)])
