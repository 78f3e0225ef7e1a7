"""Plan and objects of the campus: buildings, cars, benches, lamps, trees and hedges.

The plan is in the world frame of PETS 2009 (Ferryman and Shahrokni 2009), read off the view of camera View_001.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from worlds.engine import mujoco
from worlds.props.meshes import PERIOD, hull, tilted, wedge
from worlds.props.shapes import Shape
from worlds.terrain.heightfield import Array, Heightfield, Mask
from worlds.terrain.polygons import covered, rectangle, signed_distance, turned

EXTENT = np.array([[-31.0, -29.0], [21.0, 21.0]])
WALKED = np.array([(-19.9, -10.9), (-17.1, -16.3), (-13.0, -15.5), (-7.1, -13.9), (7.0, -8.9), (6.8, -8.2), (-5.6, 8.5), (-6.0, 8.5), (-10.0, 3.6)])
"""m: polygon around the foot points of all complete annotations of S1.L1 and S2.L1."""
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
"""m: the first two are parked along the road, outside of all lines of sight from cameras to people."""
KERB_RAMPS = np.array(
    [(-10.2, 8.0), (-10.4, -4.0), (-13.2, -12.0), (-3.9, -3.2), (3.0, -5.1), (11.0, -5.1), (-4.4, -13.2), (8.0, -10.3), (-7.6, -21.0)]
)
"""m: where kerbs are lowered for wheels."""
Colour = tuple[float, float, float]


def off_sights(points: Array) -> Array:
    """Points (..., 2) m → (...) m to the nearest line of sight from a camera to where people walk; negative among them."""
    fans = [np.concatenate([WALKED, camera[None]]) for camera in CAMERAS]
    return np.minimum.reduce([signed_distance(points, fan[ConvexHull(fan).vertices]) for fan in fans])


def kept_clear(points: Array) -> Array:
    """Points (..., 2) m → (...) m to the nearest road, car park or building; negative on it."""
    return np.minimum.reduce([signed_distance(points, polygon) for polygon in (ROAD, CAR_PARK, BUILDING, HUT)])


@dataclass(frozen=True, eq=False)
class CampusSite:
    """The campus under construction. blocked: mask (rows, columns) of grid points under objects."""

    spec: mujoco.MjSpec
    ground: Heightfield
    blocked: Mask

    def stand(self, shape: Shape, name: str, material: str, place: tuple[ArrayLike, float, float]) -> mujoco.MjsGeom:
        """Place a shape; place: (2,) m, m over the lowest ground under it, yaw rad."""
        (x, y), above, yaw = np.asarray(place[0], dtype=np.float64), place[1], place[2]
        return shape.add_to(self.spec, name, material, [x, y, self.low((x, y)) + above], yaw)

    def box(self, name: str, low: ArrayLike, high: ArrayLike, colour: Colour) -> mujoco.MjsGeom:
        """A plain box from low (3,) to high (3,) m."""
        a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        kind = mujoco.mjtGeom.mjGEOM_BOX
        return self.spec.worldbody.add_geom(name=name, type=kind, pos=(a + b) / 2, size=(b - a) / 2, rgba=[*colour, 1.0], group=1)

    def low(self, place: ArrayLike) -> float:
        return self.ground.lowest_around(place, 0.25)

    def block(self, corners: ArrayLike) -> None:
        self.blocked[covered(self.ground, corners, self.ground.spacing / 2)] = True


def buildings(site: CampusSite) -> None:
    """A brick building with rows of windows and a flat roof, and a hut."""
    for k, (corners, top) in enumerate(((BUILDING, 6.6), (HUT, 3.0))):
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle, size = (low + high) / 2, high - low
        corner = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]) * [*size, top + 0.6] - [0, 0, 0.6]
        hull(corner).add_to(site.spec, f"wall{k}", "brick", [*middle, 0.0])
        site.box(f"wall{k}-roof", [*(low - 0.25), top], [*(high + 0.25), top + 0.3], (0.62, 0.61, 0.58))
        site.block(corners)
        for row, sill in enumerate(np.arange(1.1, top - 1.6, 3.2)):
            for side, name in ((low[0], "west"), (low[1], "south")):
                along = (low[1], high[1]) if name == "west" else (low[0], high[0])
                _windows(site, (f"wall{k}-{name}{row}", name == "west"), (along[0] + 0.7, along[1] - 0.7), (side, sill))


def _windows(site: CampusSite, what: tuple[str, bool], along: tuple[float, float], at: tuple[float, float]) -> None:
    """A band of glass in a dark red frame along x or y, a few centimetres in front of the wall."""
    name, west = what
    side, sill = at

    def box(part: str, ends: tuple[float, float, float, float], colour: Colour, out: float) -> None:
        a, b, low, high = ends
        corners = ((side - out, a, low), (side + 0.1, b, high)) if west else ((a, side - out, low), (b, side + 0.1, high))
        site.box(f"{name}-{part}", *corners, colour)

    box("glass", (along[0], along[1], sill, sill + 1.3), (0.20, 0.25, 0.30), 0.03)
    box("sill", (along[0] - 0.1, along[1] + 0.1, sill - 0.1, sill), (0.42, 0.16, 0.12), 0.09)
    box("head", (along[0] - 0.1, along[1] + 0.1, sill + 1.3, sill + 1.4), (0.42, 0.16, 0.12), 0.09)
    for k, x in enumerate(np.linspace(along[0], along[1], max(3, round((along[1] - along[0]) / 1.4)))):
        box(f"post{k}", (x - 0.05, x + 0.05, sill, sill + 1.3), (0.42, 0.16, 0.12), 0.07)


def furniture(rng: np.random.Generator, site: CampusSite, difficulty: float) -> None:
    """Stones at the kerbs, benches, cars in the car park; all off the paths of people in PETS 2009."""
    for k, place in enumerate(BOULDERS):
        shape = hull([(x * rng.uniform(0.16, 0.24), y * rng.uniform(0.16, 0.24), z) for x in (-1, 1) for y in (-1, 1) for z in (-0.3, 0.2)]
                     + [(0.05, 0.0, rng.uniform(0.34, 0.45))], rng.uniform(0, PERIOD, 2))  # fmt: skip
        site.stand(shape, f"rock{k}", "stone", (place, 0.0, rng.uniform(-np.pi, np.pi)))
        site.block(rectangle(place, (0.45, 0.45)))
    for k, place in enumerate(BENCHES):
        z = site.low(place)
        x, y = place
        for part, (low, high) in enumerate((((-0.8, -0.2, 0.40), (0.8, 0.2, 0.46)), ((-0.8, 0.18, 0.55), (0.8, 0.23, 0.85)))):
            at = np.array([x, y, z])
            site.box(f"bench{k}-{part}", at + low, at + high, (0.52, 0.36, 0.22))
        for part, left in enumerate((-0.7, 0.62)):
            site.box(f"bench{k}-leg{part}", (x + left, y - 0.18, z - 0.1), (x + left + 0.08, y + 0.22, z + 0.85), (0.25, 0.25, 0.27))
        site.block(rectangle(place, (1.7, 0.55)))
    for k, place in enumerate(CARS if difficulty else CARS[:2]):
        colour = ((0.75, 0.76, 0.78), (0.30, 0.42, 0.55), (0.86, 0.86, 0.84))[k % 3]
        _car(site, f"car{k}", place, (colour, 0.0 if k < 2 else np.pi / 2))


def _car(site: CampusSite, name: str, place: Array, look: tuple[Colour, float]) -> None:
    """A saloon: body, cabin with glass, wheels."""
    colour, yaw = look
    body = wedge([(-2.1, 0.25), (2.0, 0.25), (2.1, 0.62), (1.95, 0.80), (-2.0, 0.86), (-2.15, 0.55)], 1.7)
    cabin = wedge([(-1.75, 0.8), (1.05, 0.8), (0.35, 1.38), (-1.25, 1.40)], 1.5)
    for part, shape, tone in (("body", body, colour), ("cabin", cabin, (0.16, 0.19, 0.22))):
        site.stand(shape, f"{name}-{part}", "", (place, 0.0, yaw)).rgba = [*tone, 1.0]
    for k, (x, y) in enumerate(((-1.3, -0.78), (-1.3, 0.78), (1.35, -0.78), (1.35, 0.78))):
        at = place + turned([x, y], yaw)
        half = np.sqrt(0.5)
        quat = np.array([half, half * np.cos(yaw), half * np.sin(yaw), 0.0])
        pos = [*at, site.low(place) + 0.31]
        wheel = site.spec.worldbody.add_geom(name=f"{name}-wheel{k}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.32, 0.1, 0], pos=pos, quat=quat)
        wheel.rgba, wheel.group = [0.1, 0.1, 0.11, 1.0], 1
    site.block(rectangle(place, (4.3, 1.8), yaw))


def ramp(rng: np.random.Generator, site: CampusSite, difficulty: float) -> list[str]:
    """A ramp of stone up to the door of the building."""
    top, z = 0.22 + 0.25 * difficulty, site.low((9.6, 2.0))
    profile = [(-2.1, 0.01), (0.6, top), (2.0, top), (2.0, -0.6), (-2.1, -0.6)]
    geom = wedge(profile, 2.4, rng.uniform(0, PERIOD, 2)).add_to(site.spec, "deck0", "stone", [10.7, 2.0, z], 0.0)
    geom.group = 0
    return [geom.name]


def _free_spots(rng: np.random.Generator, site: CampusSite, difficulty: float, gap: float) -> Callable[[], Array]:
    """A source of places (2,) m at least `gap` m off roads and buildings, at difficulty 0 also off all lines of sight to where people walk."""
    low, high = EXTENT + np.array([[2.0], [-2.0]])
    spots = rng.uniform(low, high, (600, 2))
    fit = kept_clear(spots) > gap
    fit &= signed_distance(spots, rectangle((10.7, 2.0), (6.5, 4.5))) > 0
    fit &= np.min(np.linalg.norm(spots[:, None] - np.concatenate([CAMERAS, BENCHES]), axis=-1), axis=1) > 2.0
    if difficulty == 0:
        fit &= off_sights(spots) > 3.0
    else:
        fit &= signed_distance(spots, WALKED) > -2.0 - 8.0 * difficulty
    left = spots[fit].tolist()

    def spot() -> Array:
        """The next place that is still free; NaN if there is none."""
        while left:
            place = np.array(left.pop())
            if not site.blocked[covered(site.ground, rectangle(place, (2 * gap, 2 * gap)))].any():
                return place
        return np.full(2, np.nan)

    return spot


def trees(rng: np.random.Generator, site: CampusSite, difficulty: float) -> None:
    """Trees on the lawns; their crowns are over people's heads and collide with nothing."""
    spot = _free_spots(rng, site, difficulty, 1.2)
    for k in range(14 + round(16 * difficulty)):
        place = spot()
        if np.isnan(place).any():
            return
        r, tall = rng.uniform(0.13, 0.24), rng.uniform(2.3, 3.2)
        angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ends = [np.column_stack([ring * r * w, np.full(8, z)]) for w, z in ((1.5, -0.3), (1.0, 0.3), (0.6, tall + 1.2))]
        trunk = tilted(hull(np.concatenate(ends), rng.uniform(0, 4, 2)), *rng.uniform(-0.05, 0.05, 2))
        site.stand(trunk, f"tree{k}-trunk", "bark", (place, 0.0, 0.0))
        for part in range(4):
            cloud = rng.normal(size=(26, 3))
            cloud *= rng.uniform(0.85, 1.1, (26, 1)) * rng.uniform(0.8, 1.35) / np.linalg.norm(cloud, axis=1, keepdims=True)
            aside = turned([0.75 * (part < 3), 0.0], part * 2.1 + rng.uniform(0, 1))
            off = np.array([*aside, tall + (1.1 if part < 3 else 2.1) + rng.uniform(0, 0.5)])
            geom = site.stand(hull(cloud * [1, 1, 0.8] + off, rng.uniform(0, 4, 2)), f"tree{k}-crown{part}", "leaves", (place, 0.0, 0.0))
            geom.contype = geom.conaffinity = 0
        site.block(rectangle(place, (3 * r, 3 * r)))


def surroundings(rng: np.random.Generator, site: CampusSite) -> None:
    """A low hedge around the lawns, open where roads leave, and tall trees far behind it, outside of the cameras' lines of sight."""
    low, high = EXTENT
    corners = [low + 0.5, np.array([high[0] - 0.5, low[1] + 0.5]), high - 0.5, np.array([low[0] + 0.5, high[1] - 0.5])]
    number = 0
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        pieces = round(float(np.hypot(*(b - a))) / 3.0)
        for middle in a + (np.arange(pieces)[:, None] + 0.5) / pieces * (b - a):
            if signed_distance(middle, ROAD) < 2.0:
                continue
            points = [(x, y * rng.uniform(0.8, 1.0), z * rng.uniform(0.93, 1.03)) for x in (-1.6, 0, 1.6) for y in (-0.4, 0.4) for z in (-0.5, 1.0)]
            yaw = float(np.arctan2(*(b - a)[::-1]))
            hull(points, rng.uniform(0, PERIOD, 2)).add_to(site.spec, f"hedge{number}", "leaves", [*middle, 0.0], yaw)
            number += 1
    centre = (low + high) / 2
    for k, angle in enumerate(np.linspace(0, 2 * np.pi, 26, endpoint=False)):
        place = centre + turned([rng.uniform(42, 60), 0.0], angle + rng.uniform(-0.1, 0.1))
        if float(off_sights(place)) < 6:
            continue
        cloud = rng.normal(size=(40, 3))
        cloud *= rng.uniform(0.85, 1.1, (40, 1)) * np.array([3.4, 3.4, 3.0]) / np.linalg.norm(cloud, axis=1, keepdims=True)
        crown = hull(cloud + np.array([0, 0, 6.0 + rng.uniform(-1, 1)]), rng.uniform(0, PERIOD, 2))
        crown.add_to(site.spec, f"tree{100 + k}-crown", "leaves", [*place, -0.3])
        site.box(f"tree{100 + k}-trunk", [*(place - 0.25), -0.5], [*(place + 0.25), 4.5], (0.33, 0.27, 0.21))


def posts(rng: np.random.Generator, site: CampusSite, difficulty: float) -> None:
    """Street lamps and, with difficulty, more posts with signs."""
    spot = _free_spots(rng, site, difficulty, 0.35)
    signs = [spot() for _ in range(round(9 * difficulty))]
    for k, place in enumerate([*LAMPS, *(p for p in signs if not np.isnan(p).any())]):
        z, lamp = site.low(place), k < len(LAMPS)
        top, radius = (5.6, 0.07) if lamp else (2.6, 0.045)
        pole = site.spec.worldbody.add_geom(
            name=f"pole{k}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, (top + 0.3) / 2, 0], pos=[*place, z + (top - 0.3) / 2], group=1
        )
        pole.rgba = [0.60, 0.66, 0.66, 1.0]
        head = (place[0] - 0.35, place[1] - 0.03, z + 1.75), (place[0] + 0.35, place[1] + 0.05, z + 2.3)
        site.box(f"pole{k}-sign", *head, (0.12, 0.45, 0.42))
        if lamp:
            site.box(f"pole{k}-arm", (place[0], place[1] - 0.04, z + 5.5), (place[0] + 0.9, place[1] + 0.04, z + 5.58), (0.60, 0.66, 0.66))
            site.box(f"pole{k}-head", (place[0] + 0.6, place[1] - 0.12, z + 5.4), (place[0] + 1.3, place[1] + 0.12, z + 5.56), (0.82, 0.82, 0.78))
        site.block(rectangle(place, (2 * radius, 2 * radius)))
