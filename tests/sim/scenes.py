"""Small scenes for rendering: uneven ground, walls, textured boxes, bodies of capsules."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Pose, rotation_z

G = mujoco.mjtGeom
SUN = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
HALF = 12.0
EYE = 1.4


@dataclass(frozen=True, eq=False)
class Scene:
    """A compiled scene with up-to-date data, the instance of every geom, and two camera poses."""

    model: mujoco.MjModel
    data: mujoco.MjData
    instances: NDArray[np.uint16]
    poses: list[Pose]


def spec_with_sky() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse, spec.visual.headlight.specular = [0.4] * 3, [0.2] * 3, [0] * 3
    gradient, sky = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, mujoco.mjtTexture.mjTEXTURE_SKYBOX
    spec.add_texture(name="sky", type=sky, builtin=gradient, rgb1=[0.4, 0.6, 0.9], rgb2=[0.8, 0.85, 0.95], width=128, height=768)
    return spec


def add_material(spec: mujoco.MjSpec, name: str, rng: np.random.Generator) -> str:
    """A texture of smooth noise at several scales."""
    layers = [cv2.resize(rng.uniform(-1, 1, (k, k)), (256, 256), interpolation=cv2.INTER_CUBIC) / np.sqrt(k) for k in (4, 8, 16, 32, 64)]
    image = np.clip(140 * (1 + 0.7 * np.sum(layers, axis=0)), 0, 255)[..., None] * np.array([1.0, 0.9, 0.75])
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=256, height=256, nchannel=3)
    texture.data = image.astype(np.uint8).tobytes()
    material = spec.add_material(name=name, texrepeat=[4, 4])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    return name


def add_ground(spec: mujoco.MjSpec, material: str, n: int = 61) -> None:
    x, y = np.meshgrid(np.linspace(-HALF, HALF, n), np.linspace(-HALF, HALF, n))
    z = 0.15 * np.sin(x / 2) * np.cos(y / 3) + 0.8 * np.exp(-((x - 6) ** 2 + (y - 6) ** 2) / 6) + 0.2 * (y < -5)
    span = np.ptp(z)
    spec.add_hfield(name="ground", nrow=n, ncol=n, size=[HALF, HALF, span, 0.2], userdata=((z - z.min()) / span).ravel())
    spec.worldbody.add_geom(name="ground", type=G.mjGEOM_HFIELD, hfieldname="ground", pos=[0, 0, z.min()], material=material)


def add_person(spec: mujoco.MjSpec, number: int, x: float, y: float, rng: np.random.Generator) -> None:
    body = spec.worldbody.add_body(name=f"person_{number}", pos=[x, y, 0.2], mocap=True)
    looks = {"contype": 0, "conaffinity": 0, "rgba": [*rng.uniform(0.1, 0.9, 3), 1.0]}
    limbs = {"trunk": ((0, 0, 0.9, 0, 0, 1.3), 0.16), "head": ((0, 0, 1.58, 0, 0, 1.6), 0.11)}
    for side in (-1, 1):
        limbs[f"leg{side}"] = (0, 0.1 * side, 0.1, 0, 0.1 * side, 0.8), 0.07
        limbs[f"arm{side}"] = (0, 0.25 * side, 0.8, 0, 0.2 * side, 1.3), 0.05
    for limb, (ends, radius) in limbs.items():
        body.add_geom(name=f"person_{number}/{limb}", type=G.mjGEOM_CAPSULE, fromto=ends, size=[radius, 0, 0], **looks)


def compiled(spec: mujoco.MjSpec, poses: list[Pose]) -> Scene:
    """Geoms named person_<n>/… are of instance n."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = [model.geom(k).name.split("/")[0] for k in range(model.ngeom)]
    instances = [int(name.removeprefix("person_")) if name.startswith("person_") else 0 for name in names]
    return Scene(model, data, np.array(instances, np.uint16), poses)


def court() -> Scene:
    """Five people in a walled court. Person 3 is behind a board, person 4 behind the first camera, across its seam."""
    rng = np.random.default_rng(7)
    spec = spec_with_sky()
    ground, wall = add_material(spec, "earth", rng), add_material(spec, "wall", rng)
    add_ground(spec, ground)
    walls = [(0, -10, 8, 0.1, 1.5), (0, 10, 8, 0.1, 1.5), (-9, 0, 0.1, 7, 1.5), (9, 0, 0.1, 7, 1.5)]
    board, box = (-2, 3.5, 0.8, 0.05, 1.2), (3, -2, 0.3, 0.3, 0.4)
    for x, y, a, b, c in [*walls, board, box]:
        spec.worldbody.add_geom(type=G.mjGEOM_BOX, size=[a, b, c], pos=[x, y, c], material=wall, euler=[0, 0, 0.1])
    for number, (x, y) in enumerate([(3, 1), (2.5, 1.4), (-2.2, 4.6), (-3, 0), (0.5, -4)], start=1):
        add_person(spec, number, x, y, rng)
    spec.worldbody.add_geom(type=G.mjGEOM_CYLINDER, size=[0.25, 0.3, 0], pos=[1, 3, 0.4], group=3, rgba=[0.9, 0.4, 0.1, 1])
    spec.worldbody.add_geom(type=G.mjGEOM_SPHERE, size=[2.0, 0, 0], pos=[4, 4, 1], group=4)
    spec.worldbody.add_site(size=[0.3] * 3, pos=[2, 0, 1])
    spec.worldbody.add_light(pos=[0, 0, 10], dir=[0.4, 0.3, -1], type=SUN, castshadow=True, diffuse=[0.6] * 3)
    tilted = Pose.exp([0, 0, 0, 0.1, -0.07, 0])
    return compiled(spec, [Pose(np.eye(3), np.array([0.0, 0.0, EYE])), Pose.planar(-4.0, -3.0, 2.0, EYE) @ tilted])


def quarter(pose: Pose) -> Pose:
    """The pose rotated by 90° to the left."""
    return pose @ Pose(np.round(rotation_z(np.pi / 2)), np.zeros(3))
