"""What people look like: the geoms of one person's limbs, in the proportions of pedestrian.py and in clothes of their own."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.pedestrian import ANKLE, FOREARM, LIMBS, RADIUS, SHIN, THIGH, UPPER_ARM
from tracker.geometry import Array

_SKINS = ((0.96, 0.80, 0.69), (0.90, 0.72, 0.58), (0.78, 0.58, 0.43), (0.55, 0.38, 0.27), (0.36, 0.24, 0.17))
_HAIRS = ((0.07, 0.05, 0.04), (0.23, 0.14, 0.08), (0.45, 0.30, 0.15), (0.80, 0.65, 0.35), (0.55, 0.55, 0.55), (0.45, 0.17, 0.08))
_SHIRTS = (
    (0.85, 0.10, 0.12), (0.10, 0.25, 0.70), (0.92, 0.92, 0.90), (0.12, 0.12, 0.14), (0.15, 0.50, 0.25), (0.95, 0.80, 0.15),
    (0.55, 0.20, 0.55), (0.95, 0.50, 0.15), (0.40, 0.70, 0.85), (0.55, 0.55, 0.58), (0.45, 0.10, 0.15), (0.90, 0.60, 0.70),
)  # fmt: skip
_TROUSERS = (
    (0.12, 0.16, 0.32),
    (0.10, 0.10, 0.11),
    (0.35, 0.35, 0.37),
    (0.55, 0.47, 0.35),
    (0.25, 0.30, 0.22),
    (0.30, 0.42, 0.60),
    (0.42, 0.28, 0.18),
)
_SHOES = ((0.08, 0.08, 0.08), (0.90, 0.90, 0.90), (0.35, 0.20, 0.12), (0.60, 0.12, 0.12), (0.20, 0.25, 0.35))


def add_person(spec: mujoco.MjSpec, name: str, stature: float, rng: np.random.Generator) -> None:
    """Add the limbs (mocap bodies `name/limb`) and the capsule that robots collide with (`name/collider`) to the world body of `spec`."""
    _Tailor(spec, name, stature, rng).dress()
    collider = spec.worldbody.add_body(name=f"{name}/collider", mocap=True)
    half = stature / 2 - RADIUS
    collider.add_geom(
        name=f"{name}/collider", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(RADIUS, half, 0), pos=(0, 0, stature / 2), group=4, rgba=(0, 0, 0, 0),
        contype=2, conaffinity=0, solref=(0.06, 1.0),
    )  # fmt: skip


class _Tailor:
    """Makes the geoms of one person. Sizes are shares of stature times girth; choices come from the person's own stream."""

    def __init__(self, spec: mujoco.MjSpec, name: str, stature: float, rng: np.random.Generator) -> None:
        self.spec, self.name, self.size, self.rng = spec, name, stature, rng
        self.girth = float(rng.uniform(0.92, 1.14))
        self.skin = self.colour(_SKINS, 0.02)
        self.hair = self.colour(_HAIRS, 0.02)
        self.shirt = self.colour(_SHIRTS, 0.06)
        self.trousers = self.colour(_TROUSERS, 0.05)
        self.shoes = self.colour(_SHOES, 0.03)
        self.bodies = {limb: spec.worldbody.add_body(name=f"{name}/{limb}", mocap=True) for limb in LIMBS}

    def colour(self, palette: tuple[tuple[float, float, float], ...], spread: float) -> Array:
        """One of the palette, a little different each time (4,) rgba."""
        rgb = np.array(palette[int(self.rng.integers(len(palette)))]) + self.rng.normal(0.0, spread, 3)
        return np.append(np.clip(rgb, 0.02, 1.0), 1.0)

    def dress(self) -> None:
        sleeves, shorts = self.rng.random() < 0.6, self.rng.random() < 0.15
        style, bag = self.rng.random(), self.rng.random()
        self.head(style)
        self.trunk()
        if bag < 0.3:
            colour = self.colour(_SHIRTS, 0.05)
            self.box("torso", "backpack", (0.038, 0.070, 0.100), (-0.085, 0, 0.190), colour)
            self.ball("torso", "pocket", (0.024, 0.060, 0.055), (-0.120, 0, 0.160), 0.8 * colour + [0, 0, 0, 0.2])
        for side, sign in (("left", 1.0), ("right", -1.0)):
            self.arm(side, self.shirt if sleeves else self.skin)
            self.leg(side, sign, self.skin if shorts else self.trousers)

    def head(self, style: float) -> None:
        """Neck, head, nose, and hair: short, long, or none."""
        self.rod("head", "neck", 0.030, (0, 0, 0.0), (0.008, 0, 0.06), self.skin)
        self.ball("head", "head", (0.052, 0.043, 0.065), (0.012, 0, 0.117), self.skin)
        self.ball("head", "nose", (0.010, 0.007, 0.012), (0.062, 0, 0.110), self.skin)
        if style < 0.92:
            self.ball("head", "hair", (0.056, 0.047, 0.052), (-0.001, 0, 0.141), self.hair)
            self.ball("head", "nape", (0.034, 0.044, 0.052), (-0.022, 0, 0.118), self.hair)
        if style < 0.35:
            self.ball("head", "long_hair", (0.026, 0.045, 0.078), (-0.032, 0, 0.080), self.hair)

    def trunk(self) -> None:
        """Shoulders wider than the waist, hips between."""
        g = self.girth
        self.rod("torso", "shoulders", 0.034, (0, -0.090, 0.262), (0, 0.090, 0.262), self.shirt)
        self.ball("torso", "yoke", (0.056 * g, 0.122, 0.072), (-0.003, 0, 0.250), self.shirt)
        self.ball("torso", "chest", (0.066 * g, 0.105 * g, 0.150), (0.002, 0, 0.185), self.shirt)
        self.ball("torso", "waist", (0.061 * g, 0.086 * g, 0.150), (0.004, 0, 0.090), self.shirt)
        self.ball("pelvis", "pelvis", (0.066 * g, 0.095 * g, 0.070), (-0.004, 0, 0.0), self.trousers)

    def arm(self, side: str, lower: Array) -> None:
        g = self.girth
        self.rod(f"{side}_upper_arm", f"{side}_upper_arm", 0.0275 * g, (0, 0, -0.024), (0, 0, -UPPER_ARM), self.shirt)
        self.rod(f"{side}_forearm", f"{side}_forearm", 0.021 * g, (0, 0, -0.004), (0, 0, -FOREARM), lower)
        self.ball(f"{side}_forearm", f"{side}_hand", (0.024, 0.013, 0.050), (0.004, 0, -FOREARM - 0.050), self.skin)

    def leg(self, side: str, sign: float, lower: Array) -> None:
        g = self.girth
        self.rod(f"{side}_thigh", f"{side}_thigh", 0.044 * g, (0, 0.003 * sign, -0.01), (0, 0, -THIGH + 0.008), self.trousers)
        self.rod(f"{side}_shin", f"{side}_shin", 0.031 * g, (0, 0, 0), (0, 0, -SHIN + 0.012), lower)
        self.ball(f"{side}_shin", f"{side}_calf", (0.035 * g, 0.033 * g, 0.085), (-0.008, 0, -0.085), lower)
        self.ball(f"{side}_shoe", f"{side}_shoe", (0.076, 0.029, 0.029), (0.036, 0, -ANKLE + 0.024), self.shoes)
        self.box(f"{side}_shoe", f"{side}_sole", (0.062, 0.024, 0.006), (0.033, 0, -ANKLE + 0.006), np.array([0.15, 0.15, 0.15, 1.0]))

    def rod(self, limb: str, part: str, radius: float, start: tuple[float, ...], end: tuple[float, ...], colour: Array) -> None:
        ends = np.array([*start, *end]) * self.size
        self.add(limb, part, colour, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(radius * self.size, 0, 0), fromto=ends)

    def ball(self, limb: str, part: str, radii: tuple[float, ...], centre: tuple[float, ...], colour: Array) -> None:
        self.add(limb, part, colour, type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=np.array(radii) * self.size, pos=np.array(centre) * self.size)

    def box(self, limb: str, part: str, halves: tuple[float, ...], centre: tuple[float, ...], colour: Array) -> None:
        self.add(limb, part, colour, type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(halves) * self.size, pos=np.array(centre) * self.size)

    def add(self, limb: str, part: str, colour: Array, **shape: object) -> None:
        self.bodies[limb].add_geom(name=f"{self.name}/{part}", rgba=colour, contype=0, conaffinity=0, group=2, **shape)
