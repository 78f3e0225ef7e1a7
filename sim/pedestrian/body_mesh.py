"""Lofted sections of the body, clothes, hair and luggage of a person, limb by limb.

Heights and lengths are those of skeleton.py (Drillis & Contini). Breadths and depths are about the means of adults in
NASA-STD-3000 (1995), vol. I, 3.3.1. As shares of stature: bideltoid breadth 0.28, hip breadth 0.20, chest depth 0.13,
head breadth 0.088, head length 0.113. Every limb ends in a ball about its joint, so that bent limbs leave no gap.
"""

from __future__ import annotations

from dataclasses import dataclass

from sim.pedestrian import clothing_textures
from sim.pedestrian.clothing_textures import FACE, HAIR, SKIN, region
from sim.pedestrian.foot_contact import ANKLE, HEEL
from sim.pedestrian.leg_kinematics import SHIN, THIGH
from sim.pedestrian.loft import FORWARD, Part, sections
from sim.pedestrian.skeleton import FOREARM, HAND, UPPER_ARM
from tracker.geometry import Array

TRUNK, LIMB, SMALL, TINY = (12, 7, 5), (8, 5, 4), (7, 4, 3), (7, 4, 0)
"""Corners of a section at each level of detail."""
DETAIL = (7, 0, 0)


@dataclass(frozen=True)
class Outfit:
    """Appearance of one person.

    head, top, bottom, shoes, bag: tiles of the texture atlas. girth: scale of breadths and depths. sleeves: "long" or "short".
    legs: "long", "short", "skirt", "coat", "long_skirt" or "long_coat". tucked: whether the shirt is in the trousers.
    hair: "short", "long", "loose", "bun", "cap", "beanie", "hood" or "none". luggage: "none", "backpack" or "shoulder".
    side: of a shoulder bag, +1 (left) or −1 (right).
    """

    head: int
    top: int
    bottom: int
    shoes: int
    bag: int
    girth: float
    sleeves: str
    legs: str
    tucked: bool
    hair: str
    luggage: str
    side: int


def parts(outfit: Outfit) -> dict[str, list[Part]]:
    """Limb → its parts, in the limb's frame."""
    out = {"pelvis": _pelvis(outfit), "torso": _torso(outfit) + _luggage(outfit), "head": _head(outfit) + _hair(outfit)}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        out[f"{side}_upper_arm"] = _upper_arm(outfit)
        out[f"{side}_forearm"] = _forearm(outfit, sign)
        out[f"{side}_thigh"] = _thigh(outfit, sign)
        out[f"{side}_shin"] = _shin(outfit)
        out[f"{side}_shoe"] = _shoe(outfit, sign)
    return out


def _scaled_girth(rows: Array, girth: float) -> Array:
    """Sections with depth and breadth scaled, in place."""
    rows[:, 1:3] *= girth
    return rows


def _pelvis(o: Outfit) -> list[Part]:
    rows = sections(
        (-0.072, 0.022, 0.030, -0.002), (-0.060, 0.048, 0.066, -0.003), (-0.035, 0.064, 0.091, -0.006), (0.0, 0.066, 0.096, -0.007),
        (0.035, 0.063, 0.093, -0.003), (0.060, 0.060, 0.088, 0.002), (0.075, 0.050, 0.070, 0.002),
    )  # fmt: skip
    if not o.tucked:
        rows[-3:, 1:3] *= [[0.93], [0.80], [0.70]]
    out = [Part(_scaled_girth(rows, o.girth), region(o.bottom, (0.0, 0.0, 1.0, 0.30)), TRUNK)]
    if o.legs in ("long_skirt", "long_coat"):
        tile, v0, hem = (o.bottom, 0.1, -0.43) if o.legs == "long_skirt" else (o.top, 0.55, -0.36)
        cloth = sections(
            (hem, 0.118, 0.128, 0.006), (-0.24, 0.106, 0.122, 0.004), (-0.08, 0.090, 0.110), (-0.02, 0.078, 0.108, -0.004), (0.03, 0.069, 0.099),
            (0.07, 0.050 + 0.016 * o.tucked, 0.070 + 0.020 * o.tucked),
        )  # fmt: skip
        out.append(Part(_scaled_girth(cloth, o.girth), region(tile, (0.0, v0, 1.0, 0.97)), TRUNK))
    elif o.legs in ("skirt", "coat"):
        tile, v0 = (o.bottom, 0.1) if o.legs == "skirt" else (o.top, 0.72)
        hem = -0.19 if o.legs == "skirt" else -0.15
        cloth = sections(
            (hem, 0.104, 0.116, 0.006), (-0.08, 0.088, 0.108), (-0.02, 0.077, 0.107, -0.004), (0.03, 0.068, 0.098),
            (0.07, 0.050 + 0.016 * o.tucked, 0.070 + 0.020 * o.tucked),
        )  # fmt: skip
        out.append(Part(_scaled_girth(cloth, o.girth), region(tile, (0.0, v0, 1.0, 0.97)), TRUNK))
    return out


def _torso(o: Outfit) -> list[Part]:
    """The trunk from the hips to the root of the neck."""
    waist, chest, hem = o.girth**1.5, o.girth**0.5, (0.80 if o.tucked else 1.0) * o.girth
    rows = sections(
        (-0.022, 0.077 * hem, 0.107 * hem, -0.006), (0.02, 0.070 * hem, 0.099 * hem, -0.003), (0.075, 0.060 * waist, 0.082 * waist, 0.004),
        (0.13, 0.063 * chest, 0.090, 0.004), (0.19, 0.069 * chest, 0.104, 0.004), (0.235, 0.065 * chest, 0.113, 0.0), (0.268, 0.054, 0.121, -0.003),
        (0.288, 0.045, 0.119, -0.004), (0.302, 0.037, 0.095, -0.005), (0.313, 0.033, 0.062, -0.006), (0.324, 0.030, 0.038, -0.005),
    )  # fmt: skip
    return [Part(rows, region(o.top, (0.0, 0.02, 1.0, 0.76)), TRUNK, power=2.5)]


def _luggage(o: Outfit) -> list[Part]:
    leather = region(o.bag, (0.05, 0.05, 0.95, 0.95))
    if o.luggage == "backpack":
        back = sections(
            (0.062, 0.035, 0.062, -0.092), (0.075, 0.045, 0.075, -0.095), (0.2, 0.047, 0.078, -0.098), (0.265, 0.036, 0.068, -0.088),
            (0.282, 0.018, 0.045, -0.080),
        )  # fmt: skip
        pocket = sections((0.08, 0.022, 0.055, -0.132), (0.1, 0.026, 0.060, -0.133), (0.15, 0.024, 0.058, -0.135), (0.162, 0.012, 0.050, -0.132))
        straps = [
            sections((0.10, 0.004, 0.011, 0.064, y), (0.19, 0.005, 0.012, 0.074, y), (0.262, 0.005, 0.012, 0.050, y), (0.305, 0.006, 0.012, 0.006, y))
            for y in (0.060, -0.060)
        ]
        worn = [Part(strap, leather, DETAIL, closed=True) for strap in straps]
        return [Part(back, leather, TRUNK, power=4.0, closed=True), Part(pocket, leather, TINY, power=4.0, closed=True), *worn]
    if o.luggage == "shoulder":
        y = o.side * (0.118 * o.girth + 0.012)
        pouch = sections((-0.115, 0.060, 0.018, 0.0, y), (-0.10, 0.072, 0.028, 0.0, y), (-0.02, 0.070, 0.026, 0.0, y), (-0.01, 0.064, 0.016, 0.0, y))
        slope = -1.25 * o.side
        strap = sections((0.145, 0.073, 0.116, 0.002, 0, 0, slope), (0.170, 0.073, 0.116, 0.002, 0, 0, slope))
        return [Part(pouch, leather, SMALL, power=4.0, closed=True), Part(strap, leather, DETAIL)]
    return []


def _head(o: Outfit) -> list[Part]:
    neck = sections(
        (-0.03, 0.036, 0.046, -0.006), (0.0, 0.031, 0.034, -0.004), (0.03, 0.029, 0.031, 0.0), (0.062, 0.030, 0.031, 0.004),
        (0.085, 0.026, 0.028, 0.006),
    )  # fmt: skip
    skull = sections(
        (0.046, 0.014, 0.012, 0.034), (0.051, 0.024, 0.021, 0.028), (0.062, 0.039, 0.031, 0.017), (0.080, 0.049, 0.0385, 0.008),
        (0.100, 0.054, 0.0425, 0.004),
        (0.122, 0.0565, 0.044, 0.001), (0.143, 0.056, 0.0435, 0.0), (0.160, 0.050, 0.039, 0.0), (0.172, 0.038, 0.030, 0.0),
        (0.179, 0.022, 0.018, 0.0),
        (0.182, 0.006, 0.005, 0.0),
    )  # fmt: skip
    bare = region(o.head, SKIN)
    nose = sections((0.099, 0.006, 0.010, 0.062), (0.103, 0.011, 0.0105, 0.060), (0.112, 0.008, 0.0075, 0.059), (0.126, 0.003, 0.004, 0.057))
    ears = [
        sections(
            (0.098, 0.005, 0.003, -0.004, y), (0.105, 0.009, 0.005, -0.003, y), (0.125, 0.013, 0.006, -0.006, 1.06 * y), (0.134, 0.008, 0.004, 0, y)
        )
        for y in (0.043, -0.043)
    ]
    out = [Part(neck, bare, (8, 5, 3)), Part(skull, region(o.head, FACE), (14, 8, 5), power=2.15)]
    return out + [Part(rows, bare, (6, 0, 0), power=2.0, closed=True) for rows in (nose, *ears)]


def _hair(o: Outfit) -> list[Part]:
    """Hair, a cap or a knitted hat. The hairline is higher in front than at the nape."""
    strands = region(o.head, HAIR)
    if o.hair == "hood":
        # The hood lies farther back than the face, so that the face stays visible.
        hood = sections(
            (-0.03, 0.052, 0.066, -0.012), (0.02, 0.050, 0.054, -0.014), (0.06, 0.056, 0.056, -0.018), (0.11, 0.061, 0.058, -0.019),
            (0.155, 0.060, 0.054, -0.014), (0.180, 0.048, 0.043, -0.010), (0.195, 0.022, 0.020, -0.008), (0.198, 0.004, 0.004, -0.008),
        )  # fmt: skip
        return [Part(hood, region(o.top, (0.0, 0.05, 1.0, 0.45)), (12, 7, 5))]
    if o.hair == "none":
        return []
    if o.hair in ("cap", "beanie"):
        cloth = region(o.bag if o.hair == "cap" else clothing_textures.BAGS.start, (0.0, 0.3, 1.0, 0.9))
        hat = sections(
            (0.140, 0.060, 0.0475, -0.001, 0, 0.12), (0.158, 0.058, 0.046, -0.001, 0, 0.12), (0.176, 0.044, 0.037, -0.002),
            (0.188, 0.022, 0.018, -0.002), (0.191, 0.004, 0.004, -0.002),
        )  # fmt: skip
        out = [Part(hat, cloth, (12, 7, 5))]
        if o.hair == "cap":
            peak = sections((0.146, 0.030, 0.036, 0.066, 0, -0.25), (0.150, 0.030, 0.036, 0.066, 0, -0.25))
            out.append(Part(peak, cloth, TINY, power=2.6, closed=True))
        return out
    cap = sections(
        (0.117, 0.0575, 0.0465, -0.008, 0, 0.62), (0.130, 0.0605, 0.049, -0.006, 0, 0.50), (0.150, 0.0605, 0.0485, -0.004, 0, 0.28),
        (0.170, 0.050, 0.041, -0.003, 0, 0.1),
        (0.184, 0.028, 0.023, -0.003), (0.188, 0.006, 0.006, -0.003),
    )  # fmt: skip
    out = [Part(cap, strands, (12, 7, 4), power=2.15)]
    if o.hair == "loose":
        fall = sections(
            (-0.075, 0.014, 0.062, -0.054), (-0.03, 0.024, 0.072, -0.044), (0.02, 0.030, 0.066, -0.036), (0.07, 0.038, 0.058, -0.028),
            (0.12, 0.038, 0.052, -0.022), (0.15, 0.032, 0.044, -0.022),
        )  # fmt: skip
        locks = [
            sections(
                (-0.05, 0.010, 0.008, 0.03, 1.15 * y), (0.0, 0.016, 0.012, 0.02, 1.1 * y), (0.07, 0.018, 0.012, 0.012, y), (0.13, 0.014, 0.008, 0, y)
            )
            for y in (0.046, -0.046)
        ]
        out += [Part(fall, strands, SMALL, closed=True), *(Part(lock, strands, TINY, closed=True) for lock in locks)]
    elif o.hair == "long":
        fall = sections(
            (-0.02, 0.014, 0.040, -0.046), (0.01, 0.022, 0.050, -0.042), (0.07, 0.030, 0.051, -0.036), (0.12, 0.034, 0.049, -0.026),
            (0.15, 0.030, 0.042, -0.026),
        )  # fmt: skip
        out.append(Part(fall, strands, SMALL, closed=True))
    elif o.hair == "bun":
        bun = sections((0.118, 0.010, 0.011, -0.064), (0.128, 0.021, 0.022, -0.068), (0.142, 0.022, 0.023, -0.070), (0.154, 0.011, 0.012, -0.068))
        out.append(Part(bun, strands, TINY, closed=True))
    return out


def _upper_arm(o: Outfit) -> list[Part]:
    rows = sections(
        (-UPPER_ARM - 0.017, 0.012, 0.012), (-UPPER_ARM, 0.0235, 0.0225), (-0.11, 0.0255, 0.0245), (-0.045, 0.0285, 0.027),
        (-0.006, 0.0285, 0.0255), (0.009, 0.022, 0.019),
        (0.017, 0.009, 0.008),
    )  # fmt: skip
    cloth = region(o.top, (0.03, 0.42, 0.30, 0.80))
    if o.sleeves == "long":
        rows[:, 1:3] *= 1.08
        return [Part(_scaled_girth(rows, o.girth), cloth, LIMB, rounding=(1, 2))]
    sleeve = sections((-0.105, 0.0325, 0.031), (-0.045, 0.0310, 0.0295), (-0.006, 0.0300, 0.027), (0.010, 0.023, 0.020), (0.019, 0.009, 0.008))
    return [
        Part(_scaled_girth(rows[:4], o.girth), region(o.head, SKIN), LIMB, rounding=(1, 0)),
        Part(_scaled_girth(sleeve, o.girth), cloth, LIMB, rounding=(0, 2)),
    ]


def _forearm(o: Outfit, sign: float) -> list[Part]:
    rows = sections(
        (-FOREARM - 0.006, 0.0155, 0.0125), (-0.11, 0.0185, 0.0160), (-0.05, 0.0245, 0.0225), (0.0, 0.0235, 0.0225), (0.017, 0.012, 0.012),
    )  # fmt: skip
    bare = region(o.head, SKIN)
    if o.sleeves == "long":
        rows[:, 1:3] *= 1.12
        forearm = Part(_scaled_girth(rows, o.girth), region(o.top, (0.03, 0.60, 0.30, 0.95)), LIMB, rounding=(0, 1))
    else:
        forearm = Part(_scaled_girth(rows, o.girth), bare, LIMB, rounding=(0, 1))
    tip = -FOREARM - HAND
    hand = sections(
        (tip, 0.007, 0.0035, 0.018, -0.010 * sign), (tip + 0.012, 0.016, 0.006, 0.014, -0.008 * sign),
        (tip + 0.045, 0.0235, 0.0085, 0.007, -0.003 * sign),
        (tip + 0.075, 0.0225, 0.0105, 0.003), (tip + 0.1, 0.0155, 0.0115), (tip + 0.12, 0.0145, 0.0115),
    )  # fmt: skip
    thumb = sections(
        (tip + 0.028, 0.004, 0.004, 0.034, -0.008 * sign), (tip + 0.045, 0.0068, 0.0065, 0.031, -0.007 * sign),
        (tip + 0.08, 0.009, 0.009, 0.014, -0.002 * sign),
    )  # fmt: skip
    return [forearm, Part(hand, bare, SMALL, closed=True, rounding=(1, 0)), Part(thumb, bare, (6, 0, 0), closed=True)]


def _thigh(o: Outfit, sign: float) -> list[Part]:
    rows = sections(
        (-THIGH - 0.026, 0.014, 0.014, 0.002), (-THIGH - 0.014, 0.027, 0.026, 0.002), (-THIGH, 0.0335, 0.032, 0.002), (-0.19, 0.037, 0.036, 0.001),
        (-0.11, 0.046, 0.0435, 0.0),
        (-0.045, 0.0525, 0.048, -0.003, -0.004 * sign), (0.0, 0.054, 0.048, -0.004, -0.004 * sign), (0.032, 0.040, 0.036, -0.004, -0.003 * sign),
        (0.05, 0.016, 0.014, -0.003),
    )  # fmt: skip
    cloth, bare = region(o.bottom, (0.05, 0.30, 0.45, 0.68)), region(o.head, SKIN)
    if o.legs in ("long", "coat", "long_coat"):
        return [Part(_scaled_girth(rows, o.girth), cloth, LIMB, rounding=(1, 2))]
    legs = Part(_scaled_girth(rows, 0.94 * o.girth), bare, LIMB, rounding=(1, 2))
    if o.legs == "short":
        hem = sections(
            (-0.195, 0.049, 0.047), (-0.11, 0.051, 0.048), (-0.045, 0.055, 0.050, -0.003, -0.004 * sign),
            (0.0, 0.056, 0.049, -0.004, -0.004 * sign), (0.03, 0.04, 0.036, -0.004),
        )  # fmt: skip
        return [legs, Part(_scaled_girth(hem, o.girth), cloth, LIMB, rounding=(0, 1))]
    fold = sections(
        (-0.19, 0.066, 0.052, 0.0, -0.006 * sign), (-0.10, 0.061, 0.051, 0.0, -0.005 * sign), (0.0, 0.058, 0.049, -0.004, -0.004 * sign),
        (0.03, 0.04, 0.036, -0.004),
    )  # fmt: skip
    return [legs, Part(_scaled_girth(fold, o.girth), region(o.bottom, (0.05, 0.30, 0.95, 0.97)), LIMB, rounding=(0, 1))]


def _shin(o: Outfit) -> list[Part]:
    bare = o.legs in ("short", "skirt", "long_skirt")
    rows = sections(
        (-SHIN - 0.012, 0.020, 0.018), (-0.215, 0.0195, 0.0175, -0.001), (-0.16, 0.0245, 0.023, -0.005), (-0.085, 0.0335, 0.0305, -0.009),
        (-0.035, 0.032, 0.030, -0.003),
        (0.0, 0.0315, 0.0305, 0.002), (0.020, 0.021, 0.021, 0.002), (0.029, 0.009, 0.009, 0.002),
    )  # fmt: skip
    if bare:
        return [Part(_scaled_girth(rows, 0.96 * o.girth), region(o.head, SKIN), LIMB, rounding=(0, 2))]
    cloth = sections(
        (-0.236, 0.0335, 0.031, -0.003), (-0.16, 0.032, 0.030, -0.004), (-0.085, 0.036, 0.033, -0.006), (0.0, 0.0335, 0.0325, 0.002),
        (0.020, 0.022, 0.022, 0.002), (0.030, 0.009, 0.009, 0.002),
    )  # fmt: skip
    sock = sections((-SHIN - 0.012, 0.020, 0.018), (-0.20, 0.021, 0.019))
    leg = Part(_scaled_girth(cloth, o.girth), region(o.bottom, (0.05, 0.55, 0.45, 0.95)), LIMB, rounding=(0, 2))
    return [leg, Part(sock, region(o.shoes, (0.45, 0.1, 0.55, 0.2)), TINY)]


def _shoe(o: Outfit, sign: float) -> list[Part]:
    """A shoe, lofted from the heel forwards. Its toe is turned up a little, because the foot rolls over it."""
    low = -ANKLE

    def slice_(x: float, top: float, half: float, bottom: float = low, aside: float = 0.0) -> tuple[float, ...]:
        return x, 0.5 * (top - bottom), half, 0.5 * (top + bottom), -aside

    upper = sections(
        slice_(-HEEL - 0.002, -0.016, 0.013), slice_(-0.034, 0.004, 0.021), slice_(-0.012, 0.008, 0.0245), slice_(0.016, 0.004, 0.0255),
        slice_(0.042, -0.010, 0.0275, aside=-0.001 * sign),
        slice_(0.072, -0.017, 0.0305, aside=-0.003 * sign), slice_(0.095, -0.019, 0.0280, low + 0.001, -0.004 * sign),
        slice_(0.108, -0.022, 0.0180, low + 0.004, -0.005 * sign),
        slice_(0.112, -0.026, 0.0080, low + 0.007, -0.005 * sign),
    )  # fmt: skip
    collar = sections((-0.020, 0.026, 0.022, -0.004), (0.004, 0.027, 0.0225, -0.003), (0.016, 0.024, 0.0215, -0.003))
    tile = region(o.shoes, (0.0, 0.02, 1.0, 0.98))
    around = Part(collar, region(o.shoes, (0.35, 0.05, 0.65, 0.3)), DETAIL)
    return [Part(upper, tile, SMALL, power=3.0, closed=True, axes=FORWARD, rounding=(1, 1)), around]
