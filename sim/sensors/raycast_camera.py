"""Exact ray casting through the scene of a simulation: truth of views and sightings of landmarks without rendering, and detections of rovers.

The box of a person encloses the meshes of the limbs. The visible fraction is the share of unoccluded sample points on the surface.
The result is a ViewTruth as from a rendered view, for the same Detector.
Landmarks are points on static geometry. A landmark is visible if a ray reaches it; its sighting has a noisy bearing and descriptor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.pedestrian.skeleton import LIMBS
from sim.rendering.draw_list import GROUPS
from sim.sensors.true_boxes import People, boxes_of, truth_above
from sim.simulation.simulation import ABSENT, Simulation
from tracker.geometry import Array, Ints, Mask, Pose, perturbed_bearings
from tracker.geometry.cameras import Camera, Panorama
from tracker.geometry.ground import Grid
from tracker.types import Keypoints, Mount, RobotDetections, Setup, Sightings, ViewTruth
from worlds.engine import mujoco

DRAWN_GROUPS = np.array([1, 1, 1, 1, 0, 0], np.uint8)
"""Geom groups that rays hit: those that are drawn."""
TARGET_MARGIN = 0.02
"""m: a hit less than this before the target counts as the target."""
STATIC_GROUPS = np.array([1, 1, 0, 0, 0, 0], np.uint8)
"""Geom groups of static geometry: ground and props."""

SKIN_POINTS = 48
"""Sample points on a person's surface, uniform over its area."""

LANDMARK_COUNT, FARTHEST_LANDMARK = 300, 200.0
"""Number of landmarks in the world, and m: largest distance of a landmark from the point whose ray finds it."""
SIGHTING_NOISE, SIGHTING_REACH = np.radians(0.12), 25.0
"""Sigma of the bearing of a landmark, rad an axis, and range of sightings, m."""
MISS_RATE, OUTLIER_RATE, OUTLIER_NOISE = 0.3, 0.02, 0.03
"""Share of visible landmarks not found in a frame, share found with a larger sigma, and that sigma, rad."""
DESCRIPTOR_SIZE, DESCRIPTOR_NOISE = 32, 0.2
"""Length of a descriptor, and norm of its error over its own norm."""
LEAST_VARIANCE = 1e-8
"""rad²: smallest variance, because the covariance of a detector without noise must be positive."""

_DIRECTIONS = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 3)

_DIRECTIONS = np.delete(_DIRECTIONS, 13, axis=0)

_ALONG_AXES = np.abs(_DIRECTIONS).sum(axis=1) == 1


class Raycaster:
    """Casts rays through the current state of a simulation, or through the scene `data`."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.data: mujoco.MjData | None = None
        self._height_fields = _height_fields(simulation.model, simulation.data)

    def first_hit(self, eye: Array, targets: Array) -> tuple[NDArray[np.int32], Mask]:
        """First geom (n,) on the rays from eye (3,) m to targets (n, 3) m, −1 for none, and whether each ray reaches its target."""
        model, away, data = self._simulation.model, targets - eye, self._simulation.data if self.data is None else self.data
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        geom, distance = np.full((len(targets), 1), -1, np.int32), np.full((len(targets), 1), -1.0)
        if not len(targets):
            return geom[:, 0], np.zeros(0, dtype=bool)
        directions, start = np.ascontiguousarray(away / length[:, None]), np.array(eye, dtype=np.float64)
        # MuJoCo tests every cell under a ray. Grid.intersect traverses the same triangles ten times as fast.
        groups = model.geom_group.copy()
        model.geom_group[list(self._height_fields)] = ABSENT
        try:
            rays = directions.ravel(), DRAWN_GROUPS, 1, -1, geom, distance, None, len(targets), float(length.max()) + 1.0
            mujoco.mj_multiRay(model, data, start, *rays)
        finally:
            model.geom_group[:] = groups
        first, nearest = geom[:, 0], np.where(geom[:, 0] < 0, np.inf, distance[:, 0])
        for k, ground in self._height_fields.items():
            met, hit = ground.intersect(np.broadcast_to(start, directions.shape), directions, float(length.max()) + 1.0)
            there = np.where(hit, np.linalg.norm(met - start, axis=1), np.inf)
            first, nearest = np.where(there < nearest, k, first).astype(np.int32), np.minimum(there, nearest)
        return first, nearest > length - TARGET_MARGIN


def _height_fields(model: mujoco.MjModel, data: mujoco.MjData) -> dict[int, Grid]:
    """Geom → heights, for every drawn height field that is level and has square cells."""
    out = {}
    for k in np.flatnonzero((model.geom_type == int(mujoco.mjtGeom.mjGEOM_HFIELD)) & (model.geom_group <= GROUPS[-1])).tolist():
        field = int(model.geom_dataid[k])
        half, high = model.hfield_size[field, :2], model.hfield_size[field, 2]
        rows, columns, first = int(model.hfield_nrow[field]), int(model.hfield_ncol[field]), int(model.hfield_adr[field])
        spacing = 2 * half / np.array([columns - 1, rows - 1])
        if abs(spacing[0] - spacing[1]) < 1e-9 and np.abs(data.geom_xmat[k] - np.eye(3).ravel()).max() < 1e-9:
            z = model.hfield_data[first : first + rows * columns].reshape(rows, columns).astype(np.float64) * high + data.geom_xpos[k, 2]
            out[k] = Grid(z, data.geom_xpos[k, :2] - half, float(spacing[0]))
    return out


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Landmarks of a scene: points (n, 3) m, world, and unit descriptors (n, d)."""

    points: Array
    descriptors: Array

    @staticmethod
    def described(points: Array, count: int, rng: np.random.Generator) -> Landmarks:
        """These points with random descriptors, drawn for `count` of them or more."""
        descriptors = rng.normal(size=(count, DESCRIPTOR_SIZE))
        return Landmarks(points, (descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True))[: len(points)])

    def sightings(self, T_world_camera: Pose, visible: Callable[[Array], Mask], rng: np.random.Generator) -> Sightings:
        """Sightings by a panorama at T_world_camera, in random order. The draws of one landmark do not depend on the others.

        visible: which of points (m, 3) m in reach nothing occludes (m,).
        """
        n = len(self.points)
        found, order = rng.random(n) >= MISS_RATE, rng.permutation(n)
        sigma = np.where(rng.random(n) < OUTLIER_RATE, OUTLIER_NOISE, SIGHTING_NOISE)[:, None]
        error = rng.normal(size=(n, 2)) * sigma
        descriptor_error = rng.normal(size=self.descriptors.shape) * DESCRIPTOR_NOISE / np.sqrt(DESCRIPTOR_SIZE)
        away = self.points - T_world_camera.translation
        distance = np.linalg.norm(away, axis=1)
        found &= (distance < SIGHTING_REACH) & (distance > 0.3)
        found[found] = visible(self.points[found])
        rows = order[found[order]]
        sight = away[rows] @ T_world_camera.rotation / distance[rows, None]
        bearing = perturbed_bearings(sight, error[rows])
        descriptor, covariance = (self.descriptors[rows] + descriptor_error[rows]).astype(np.float32), np.eye(2) * SIGHTING_NOISE**2
        return Sightings(bearing, np.full(len(rows), np.nan), np.full(len(rows), -1), descriptor, np.tile(covariance, (len(rows), 1, 1)))


class RaycastCamera:
    """Ray-casting camera in the current state of a simulation.

    landmarks: on the ground and on props; drawn from the scenario's stream "landmarks".
    """

    def __init__(self, simulation: Simulation) -> None:
        self.simulation, rng = simulation, simulation.scenario.stream("landmarks")
        points = _landmark_points(simulation, LANDMARK_COUNT, rng)
        self.landmarks = Landmarks.described(points, len(points), rng)
        self.raycaster = Raycaster(simulation)
        self._surfaces = {int(person): _PersonSurface.of(simulation.model, f"person_{person}") for person in simulation.all_persons}

    def past_view(self, before: float, camera: Camera, T_world_camera: Pose, people: People) -> ViewTruth:
        """As `view`, `before` s before the current frame of the simulation, which keeps its steps."""
        self.raycaster.data = self.simulation.past(before)
        try:
            return self.view(camera, T_world_camera, people)
        finally:
            self.raycaster.data = None

    def view(self, camera: Camera, T_world_camera: Pose, people: People) -> ViewTruth:
        """Truth of a view, as true_boxes.truth_above. Boxes are not rounded to pixels, and there are no key points."""
        eye = T_world_camera.translation
        data = self.simulation.data if self.raycaster.data is None else self.raycaster.data
        surfaces = [self._surfaces[int(person)].placed(data) for person in people.person]
        clear = self._unoccluded(eye, [points for points, _ in surfaces], people.person)
        kept, visible_boxes, full, visible = [], [], [], []
        for k, (points, corners) in enumerate(surfaces):
            outline, inside = _bounding_box(camera, T_world_camera, corners)
            _, shown = _pixels(camera, T_world_camera, points)
            if outline is None or not shown.any():
                continue
            share = float(clear[k][shown].mean())
            box = outline
            if 0 < share < 1:
                rims = np.flatnonzero(inside & self._surfaces[int(people.person[k])].rim)
                rims = rims[self._unoccluded(eye, [corners[rims]], people.person[k : k + 1])[0]]
                partial, _ = _bounding_box(camera, T_world_camera, np.concatenate([corners[rims], points[shown & clear[k]]]))
                box = outline if partial is None else partial
            kept.append(k)
            full.append(outline)
            visible_boxes.append(box if share > 0 else np.zeros(4))
            visible.append(share)
        boxes = boxes_of(people, kept, eye, (visible_boxes, full, visible))
        return truth_above(self.simulation.world, T_world_camera, boxes, Keypoints.none())

    def sightings(self, T_world_camera: Pose, rng: np.random.Generator) -> Sightings:
        """Landmarks visible from a panorama at T_world_camera."""
        return self.landmarks.sightings(T_world_camera, lambda points: self.raycaster.first_hit(T_world_camera.translation, points)[1], rng)

    def _unoccluded(self, eye: Array, points: list[Array], persons: Ints) -> list[Mask]:
        """For each person, a mask (n,) of the points (n, 3) m that nothing but the person itself occludes."""
        if not points:
            return []
        ends = np.cumsum([len(p) for p in points])[:-1]
        owner = np.repeat(persons, [len(p) for p in points])
        geom, free = self.raycaster.first_hit(eye, np.concatenate(points))
        own = (geom >= 0) & (self.simulation.person_of_geom[geom] == owner)
        return np.split(free | own, ends)


def is_rover_panorama(simulation: Simulation, mount: Mount) -> bool:
    """Whether a camera is a panorama on a simulated rover."""
    return mount.robot in simulation.robots and isinstance(mount.camera, Panorama)


class RobotDetector:
    """Detects rovers from the cameras of other rovers in the current state of a simulation, and identifies them.

    Like the detector of people, it misses a share Scenario.misses, and its bearings have the noise Scenario.bearing_noise. A rover is visible if it
    is in the image and nothing is on the line between the two cameras. The draws of a camera come from its stream "companions/CAMERA".
    """

    def __init__(self, simulation: Simulation, setup: Setup) -> None:
        scenario = simulation.scenario
        self._misses, self._noise = scenario.misses, scenario.bearing_noise
        self._simulation, self._raycaster = simulation, Raycaster(simulation)
        self._mounts = {name: mount for name, mount in setup.mounts.items() if mount.robot in simulation.robots}
        self._streams = {name: scenario.stream(f"companions/{name}") for name in self._mounts}

    def detect(self, camera: str) -> RobotDetections | None:
        """The rovers visible from a camera; None for a camera that is not on a rover. The draws of a camera do not depend on others."""
        if camera not in self._mounts:
            return None
        mount, rng, simulation = self._mounts[camera], self._streams[camera], self._simulation
        others = list(dict.fromkeys(other.robot for other in self._mounts.values() if other.robot != mount.robot))
        error, found = rng.normal(0.0, self._noise, (len(others), 2)), rng.random(len(others)) >= self._misses
        pose = simulation.T_world_robot(mount.robot) @ mount.T_body_camera
        targets = np.array([(simulation.T_world_robot(robot) @ simulation.mount(robot)).translation for robot in others]).reshape(-1, 3)
        found &= mount.camera.pixels_from_bearings(pose.inverse().apply(targets))[1]
        found[found] = self._raycaster.first_hit(pose.translation, targets[found])[1]
        sight = pose.inverse().apply(targets[found])
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        bearing = perturbed_bearings(sight, error[found])
        covariance = np.tile(np.eye(2) * max(self._noise**2, LEAST_VARIANCE), (len(bearing), 1, 1))
        return RobotDetections(bearing, tuple(np.array(others)[found].tolist()), covariance)


@dataclass(frozen=True, eq=False)
class _PersonSurface:
    """Sample points of a person's limb meshes: points spread over the surface, corners at extreme vertices.

    points, corners: (n, 3) m, in the frames of the geoms on_point, on_corner (n,).
    rim (n,): whether a corner is extreme along an axis of its limb.
    """

    points: Array
    on_point: Ints
    corners: Array
    on_corner: Ints
    rim: Mask

    @staticmethod
    def of(model: mujoco.MjModel, name: str) -> _PersonSurface:
        rng = np.random.default_rng(0)
        triangles, owner, corners, on_corner, rim = [], [], [], [], []
        for geom in (model.geom(f"{name}/{limb}").id for limb in LIMBS):
            mesh = model.mesh(int(model.geom_dataid[geom]))
            first, faces = int(mesh.vertadr[0]), model.mesh_face[mesh.faceadr[0] : mesh.faceadr[0] + mesh.facenum[0]]
            shape = model.mesh_vert[first : first + mesh.vertnum[0]].astype(np.float64)[faces]
            vertices = shape.reshape(-1, 3)
            farthest = np.argmax(vertices @ _DIRECTIONS.T, axis=0)
            extreme = np.unique(farthest)
            rim.append(np.isin(extreme, farthest[_ALONG_AXES]))
            triangles.append(shape)
            owner.append(np.full(len(shape), geom))
            corners.append(vertices[extreme])
            on_corner.append(np.full(len(extreme), geom))
        shape, on = np.concatenate(triangles), np.concatenate(owner)
        area = np.linalg.norm(np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0]), axis=1)
        # Stratified along the cumulated area, so that every limb has its share.
        chosen = np.searchsorted(np.cumsum(area), (np.arange(SKIN_POINTS) + 0.5) / SKIN_POINTS * area.sum())
        weight = rng.dirichlet(np.ones(3), SKIN_POINTS)
        points = np.einsum("nk,nki->ni", weight, shape[chosen])
        return _PersonSurface(points, on[chosen], np.concatenate(corners), np.concatenate(on_corner), np.concatenate(rim))

    def placed(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Points and corners (n, 3) m, world."""
        return _placed(data, self.points, self.on_point), _placed(data, self.corners, self.on_corner)


def _placed(data: mujoco.MjData, points: Array, geom: Ints) -> Array:
    out: Array = data.geom_xpos[geom] + np.einsum("nij,nj->ni", data.geom_xmat[geom].reshape(-1, 3, 3), points)
    return out


def _landmark_points(simulation: Simulation, count: int, rng: np.random.Generator) -> Array:
    """Points (count, 3) m where random rays hit static geometry. Rays start at camera height over free space for rovers."""
    world, data = simulation.world, simulation.data
    free = np.argwhere(world.wheels.free)
    out: list[Array] = []
    for _ in range(20 * count):
        if len(out) == count:
            break
        row, column = free[rng.integers(len(free))]
        place = world.wheels.origin + world.wheels.spacing * np.array([column, row])
        eye = np.array([*place, float(world.terrain.height_at(place[None])[0]) + simulation.scenario.camera_height])
        azimuth, elevation = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(-45.0, 35.0))
        sight = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        distance = mujoco.mj_ray(simulation.model, data, eye, sight, STATIC_GROUPS, 1, -1, np.zeros(1, np.int32), None)
        if 0.5 < distance < FARTHEST_LANDMARK:
            out.append(eye + distance * sight)
    return np.array(out).reshape(-1, 3)


def _pixels(camera: Camera, T_world_camera: Pose, points: Array) -> tuple[Array, Mask]:
    """Project points (n, 3) m to pixels (n, 2) from the image's corner, and tell which are in the image."""
    bearings = T_world_camera.inverse().apply(points)
    pixels, inside = camera.pixels_from_bearings(bearings / np.linalg.norm(bearings, axis=1, keepdims=True))
    return pixels + (0.5 - camera.pixel_centre), inside


def _bounding_box(camera: Camera, T_world_camera: Pose, points: Array) -> tuple[Array | None, Mask]:
    """Bounding box (4,) left, top, right, bottom px of the points in the image, None for none; and which points are in the image.

    In a panorama left is in [0, W), and right > W for a box across the seam.
    """
    if not len(points):
        return None, np.zeros(0, dtype=bool)
    pixels, inside = _pixels(camera, T_world_camera, points)
    if not inside.any():
        return None, inside
    u, v = pixels[inside].T
    if camera.wraps:
        u = u[0] + np.mod(u - u[0] + camera.width / 2, camera.width) - camera.width / 2
        shift = -np.floor(u.min() / camera.width) * camera.width
        u = u + shift
    return np.array([u.min(), v.min(), u.max(), v.max()]), inside
