"""What there is to draw: MuJoCo's scene as an array, and which of its geoms matter to which face of a cube.

MuJoCo's drawing loop does not cull; it draws every geom once for codes, and for colour once and twice more for every light with
shadows. Here the geoms outside a face's frustum are left out, but for those whose shadow may fall into it: the picture is the same.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.cubemap import frustum_planes
from sim.tiles import tiles_of
from tracker.geometry import Array, Pose

Indices = NDArray[np.int64]

GROUPS = (1, 1, 1, 1, 0, 0)
"""Geom groups that are drawn: 0 to 2, and 3 of the robots; 4 holds invisible collision shapes."""
SPARE = 16
"""Places in the scene beyond the model's geoms."""
SHOWN = (mujoco.mjtVisFlag.mjVIS_TEXTURE, mujoco.mjtVisFlag.mjVIS_STATIC, mujoco.mjtVisFlag.mjVIS_SKIN, mujoco.mjtVisFlag.mjVIS_FLEXSKIN)
"""All else that MuJoCo would draw beside geoms is decoration that no camera sees: sites, tendons, rangefinder beams."""

OFFSETS = {"type": 0, "dataid": 4, "objtype": 8, "objid": 12, "segid": 36, "size": 40, "pos": 52, "mat": 64, "rgba": 100, "reflectance": 128}
GEOM = np.dtype(
    {
        "names": list(OFFSETS),
        "formats": ["i4", "i4", "i4", "i4", "i4", ("f4", 3), ("f4", 3), ("f4", (3, 3)), ("f4", 4), "f4"],
        "offsets": list(OFFSETS.values()),
        "itemsize": 256,
    }
)
"""mjvGeom of MuJoCo 4 (mjvisualize.h), as far as it is needed; `_places` checks it against the bindings."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Per face the geoms that it sees, and those that its colours need: seen, or casting a shadow into it. Indices into the list."""

    seen: list[Indices]
    coloured: list[Indices]


class DrawList:
    """The geoms and lights of one moment, and the choice of what is drawn next. `scene` is what MuJoCo draws."""

    def __init__(self, model: mujoco.MjModel, instance_of_geom: NDArray[np.uint16], face: int) -> None:
        self.tiles = [tiles_of(model, k) for k in range(model.nhfield)]
        self._names = [np.zeros(len(tiles), np.int32) for tiles in self.tiles]
        self._boxes = [np.array([tile.box for tile in tiles]) for tiles in self.tiles]
        self.scene = mujoco.MjvScene(model, maxgeom=model.ngeom + sum(len(tiles) for tiles in self.tiles) + SPARE)
        self.instance_of_code = np.zeros(1, np.uint16)
        self._model, self._instance_of_geom = model, instance_of_geom
        self._planes = frustum_planes(face).reshape(30, 3)
        self._places = _places(self.scene)
        self._option, self._eye = _plain_option(), mujoco.MjvCamera()

    def name_tiles(self, names: list[list[int]]) -> None:
        """Tell under which numbers, in place of its height field's, each of `tiles` is drawn. To be called before the first `update`."""
        self._names = [np.array(of_field, dtype=np.int32) for of_field in names]

    def update(self, data: mujoco.MjData) -> None:
        """Take geoms and lights from `data`. Raises ValueError where the scene holds fewer geoms than are needed.

        `instance_of_code` then has the instance of every colour code: 0, where nothing is drawn, and MuJoCo's geom + 1.
        """
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._eye, every, self.scene)
        if self.scene.status:
            raise ValueError(f"the scene needs more geoms than the {self.scene.maxgeom} that it holds")
        geoms = self._places[: self.scene.ngeom].view(GEOM)[:, 0]
        geoms["segid"] = np.arange(self.scene.ngeom)
        # Only one reflecting geom is ever drawn as such, and leaving others out would change which.
        geoms["reflectance"] = 0
        modelled = geoms["objtype"] == mujoco.mjtObj.mjOBJ_GEOM.value
        number = np.where(modelled, geoms["objid"], 0)
        boxes = np.where(modelled[:, None], self._model.geom_aabb[number], [0, 0, 0, 1e10, 1e10, 1e10])
        instances = np.where(modelled, self._instance_of_geom[number], 0).astype(np.uint16)
        self.instance_of_code = np.concatenate([np.zeros(1, np.uint16), instances])
        origin = self._cut_up(geoms, boxes)
        self._instances = instances[origin]
        self._place_lights()

    def seen_from(self, pose: Pose) -> Choice:
        """What each face of a cube at `pose` (T_world_camera) sees and needs."""
        normals = self._planes @ pose.rotation.T
        reach = (self._centres - pose.translation) @ normals.T + np.abs(np.einsum("nij,fi->nfj", self._halves, normals)).sum(axis=2)
        seen = _within(reach)
        coloured = seen.copy()
        for sweep in self._sweeps:
            coloured |= _within(reach + np.maximum(sweep @ normals.T, 0.0))
        coloured |= self._spreading
        return Choice([np.flatnonzero(face) for face in seen.T], [np.flatnonzero(face) for face in coloured.T])

    def balls(self, pose: Pose, instance: int) -> tuple[Array, Array]:
        """Balls that hold an instance's geoms: centres (n, 3) in the camera's frame and radii (n,), m."""
        members = self.geoms_of(instance)
        return (self._centres[members] - pose.translation) @ pose.rotation, np.linalg.norm(self._halves[members], axis=(1, 2))

    def geoms_of(self, instance: int) -> Indices:
        """The geoms of an instance, as indices into the list."""
        return np.flatnonzero(self._instances == instance)

    def show(self, pose: Pose, shown: Indices, coded: bool) -> None:
        """Put the listed geoms on the scene, to be drawn in colour or as codes."""
        self._places[: len(shown)] = self._bytes[shown]
        self.scene.ngeom = len(shown)
        for light in self._headlights:
            light.pos = pose.translation
        flags = mujoco.mjtRndFlag
        self.scene.flags[:] = 0
        self.scene.flags[flags.mjRND_CULL_FACE.value] = 1
        for flag in (flags.mjRND_SEGMENT, flags.mjRND_IDCOLOR) if coded else (flags.mjRND_SHADOW, flags.mjRND_SKYBOX, flags.mjRND_HAZE):
            self.scene.flags[flag.value] = 1

    def _cut_up(self, geoms: NDArray[np.void], boxes: Array) -> Indices:
        """Make the list from MuJoCo's geoms and their boxes (n, 6), height fields in tiles; the geom (m,) that every entry is of."""
        fields = np.flatnonzero(geoms["type"] == mujoco.mjtGeom.mjGEOM_HFIELD.value)
        parts = np.ones(len(geoms), np.int64)
        parts[fields] = [len(self.tiles[k]) for k in geoms["dataid"][fields]]
        origin = np.repeat(np.arange(len(geoms)), parts)
        # As bytes: a copy by fields would leave behind what GEOM does not name.
        self._bytes, boxes = self._places[origin], boxes[origin]
        self._geoms = self._bytes.view(GEOM)[:, 0]
        for geom in fields:
            entries, field = origin == geom, geoms["dataid"][geom]
            self._geoms["dataid"][entries], boxes[entries] = self._names[field], self._boxes[field]
        flat = self._geoms["type"] == mujoco.mjtGeom.mjGEOM_PLANE.value
        boxes[flat, 2] = boxes[flat, 5] = 0.0  # MuJoCo's box of a plane is all that lies below it
        axes = self._geoms["mat"].astype(np.float64)
        # The oriented box about every entry: centre (m, 3), half edges as columns (m, 3, 3), m, world.
        self._centres = self._geoms["pos"] + np.einsum("nij,nj->ni", axes, boxes[:, :3])
        self._halves = axes * boxes[:, None, 3:]
        return origin

    def _place_lights(self) -> None:
        """Prepare the head light, and learn how far shadows reach: `_sweeps`, per light (n, 3) m from every geom to its shadow's end."""
        lights = self.scene.lights[: self.scene.nlight]
        self._headlights = [light for light in lights if light.headlight]
        for light in self._headlights:
            # The light of a camera that looks everywhere is a lamp at its place, not a beam along one of its faces.
            light.type, light.cutoff, light.exponent = mujoco.mjtLightType.mjLIGHT_SPOT.value, 180.0, 0.0
            light.attenuation = (1.0, 0.0, 0.0)
        height = np.abs(self._halves[:, 2]).sum(axis=1)
        top, floor = self._centres[:, 2] + height, (self._centres[:, 2] - height).min(initial=np.inf)
        farthest = 4 * self._model.stat.extent
        casting = [light for light in lights if light.castshadow]
        parallel = [light.dir for light in casting if light.type == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value]
        # The rays of a spot spread: its shadows may fall anywhere.
        self._spreading = len(casting) > len(parallel)
        self._sweeps = [np.minimum((top - floor) / max(-along[2], 1e-6), farthest)[:, None] * along for along in parallel]


def _within(reach: Array) -> NDArray[np.bool_]:
    """(n, 30) m of reach inwards of the planes of six faces → (n, 6) whether a face may see it; 1 mm for rounding."""
    return np.asarray((reach.reshape(-1, 6, 5) > -1e-3).all(axis=2))


def _plain_option() -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.geomgroup[:] = GROUPS
    for groups in (option.sitegroup, option.jointgroup, option.tendongroup, option.actuatorgroup):
        groups[:] = 0
    option.flags[:] = 0
    for flag in SHOWN:
        option.flags[flag.value] = 1
    return option


def _places(scene: mujoco.MjvScene) -> NDArray[np.uint8]:
    """The scene's buffer of geoms as bytes (maxgeom, 256) over the same memory: one assignment instead of thousands of attributes.

    Raises RuntimeError where the memory is not as GEOM says, before anything is written.
    """
    sample = scene.geoms[1]
    mujoco.mjv_initGeom(sample, mujoco.mjtGeom.mjGEOM_BOX.value, np.array([1.0, 2, 3]), np.array([4.0, 5, 6]), np.arange(9.0), np.arange(4.0))
    sample.objtype, sample.objid, sample.segid, sample.reflectance = 21, 22, 23, 24.0
    pitch = sample.size.ctypes.data - scene.geoms[0].size.ctypes.data
    offset = sample.pos.ctypes.data - sample.size.ctypes.data + OFFSETS["size"]
    if pitch == GEOM.itemsize and offset == OFFSETS["pos"]:
        start = scene.geoms[0].size.ctypes.data - OFFSETS["size"]
        places = np.frombuffer((ctypes.c_char * (pitch * scene.maxgeom)).from_address(start), dtype=np.uint8).reshape(-1, pitch)
        seen = places.view(GEOM)[1, 0]
        if all(np.array_equal(seen[name], np.reshape(getattr(sample, name), GEOM[name].shape)) for name in OFFSETS):
            return places
    raise RuntimeError(f"mjvGeom of mujoco {mujoco.__version__} lies in memory otherwise than in 4.0.0, needs a new layout in {__name__}")
