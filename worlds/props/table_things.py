"""Objects on and at tables: laptops, monitors, cups, microphones, papers; office chairs, stools and coats over backs of chairs.

Objects on tables stand around their own origin; z = 0 is the top of the table. Their users sit at −y and look along +y.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from worlds.props.distractors import bar
from worlds.props.shapes import CLOTHES, Shape, box, joined, revolved
from worlds.textures.furniture_atlas import Surface

PLASTIC = (Surface.DARK, Surface.DARK, Surface.STEEL, Surface.WHITE)
CLOTH = (Surface.DARK, Surface.DARK, Surface.BLUE, Surface.RED, Surface.GREEN, Surface.STEEL, Surface.WHITE, Surface.OAK)


def laptop(rng: np.random.Generator) -> Shape:
    """An open laptop, whose screen leans back."""
    w, d, body = rng.uniform(0.28, 0.38), rng.uniform(0.2, 0.26), _one(rng, PLASTIC)
    lid = box(rng, body, (-w / 2, -0.006, 0), (w / 2, 0.006, d), front=Surface.SCREEN)
    lean = rng.uniform(0.1, 0.5)
    tilt = np.array([[1.0, 0, 0], [0, np.cos(lean), np.sin(lean)], [0, -np.sin(lean), np.cos(lean)]])
    return box(rng, body, (-w / 2, -d / 2, 0), (w / 2, d / 2, 0.018)) + lid.moved((0, d / 2, 0.015), tilt)


def monitor(rng: np.random.Generator) -> Shape:
    """A screen on a foot."""
    w, lift = rng.uniform(0.45, 0.75), rng.uniform(0.08, 0.2)
    shape = box(rng, Surface.DARK, (-0.12, -0.08, 0), (0.12, 0.1, 0.015)) + box(rng, Surface.DARK, (-0.03, 0.03, 0), (0.03, 0.05, lift + 0.1))
    return shape + box(rng, Surface.DARK, (-w / 2, 0.0, lift), (w / 2, 0.03, lift + 0.6 * w), front=Surface.SCREEN)


def cup(rng: np.random.Generator) -> Shape:
    """A cup, a glass or a bottle."""
    r, h = (rng.uniform(0.03, 0.045), rng.uniform(0.08, 0.13)) if rng.random() < 0.6 else (rng.uniform(0.03, 0.045), rng.uniform(0.2, 0.32))
    surface = _one(rng, (Surface.WHITE, Surface.DARK, Surface.GREEN, Surface.BLUE, Surface.STEEL, Surface.RED))
    return revolved(rng, surface, [(0.8 * r, 0), (r, 0.3 * h), (r, 0.7 * h), (0.45 * r if h > 0.15 else r, h), (0.005, h)])


def microphone(rng: np.random.Generator) -> Shape:
    """A microphone on a foot with a thin neck, sometimes on a tall stand."""
    h, r, lean = rng.uniform(0.15, 0.55), rng.uniform(0.012, 0.045), rng.uniform(-0.12, 0.12, 2)
    shape = revolved(rng, Surface.DARK, [(0.06, 0), (0.06, 0.02), (0.01, 0.03)]) + bar(rng, Surface.DARK, (0, 0, 0.02), (*lean, h), 0.006)
    head = revolved(rng, _one(rng, PLASTIC), [(0.3 * r, -r), (r, -0.2 * r), (r, 2 * r), (0.5 * r, 3 * r), (0.002, 3.3 * r)])
    return shape + head.moved((*lean, h))


def papers(rng: np.random.Generator) -> Shape:
    """Sheets, a notebook or a bag."""
    tall = rng.random() < 0.15
    w, d, h = rng.uniform(0.15, 0.32), rng.uniform(0.15, 0.3), rng.uniform(0.2, 0.4) if tall else rng.uniform(0.003, 0.04)
    return box(rng, _one(rng, CLOTH) if tall or rng.random() < 0.4 else Surface.WHITE, (-w / 2, -d / 2, 0), (w / 2, d / 2, h))


def loudspeaker(rng: np.random.Generator) -> Shape:
    """A conference telephone, a camera on a pole or a loudspeaker, in the middle of a table."""
    r, h = rng.uniform(0.06, 0.13), rng.uniform(0.05, 0.4)
    profile = [(r, 0), (r, 0.03), (0.4 * r, 0.05), (0.4 * r, h), (0.6 * r, h + 0.02), (0.5 * r, h + 0.1), (0.005, h + 0.12)]
    return revolved(rng, _one(rng, PLASTIC), profile)


BEFORE_PEOPLE: tuple[tuple[Callable[[np.random.Generator], Shape], float], ...] = (
    (laptop, 0.5), (papers, 0.6), (cup, 0.6), (microphone, 0.25), (monitor, 0.06),
)  # fmt: skip
"""Objects on the table before a seat, and their probabilities."""


def laid(rng: np.random.Generator, screens: bool) -> Shape | None:
    """The objects on a table before a seat, as one mesh, or None; the table's edge is at y = 0. screens: with a monitor."""
    things = [monitor(rng).moved((0, 0.45, 0))] if screens else []
    for make, share in BEFORE_PEOPLE:
        if rng.random() < share and not (screens and make is monitor):
            aside = rng.uniform(-0.08, 0.08) if make is laptop else rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3)
            things.append(make(rng).turned(rng.normal(0.0, 0.25), (aside, rng.uniform(0.18, 0.32), 0.0)))
    return joined(things) if things else None


def office_chair(rng: np.random.Generator, seat: float) -> Shape:
    """A chair on a column, with a back of random height and sometimes arms. It looks along +y. seat: height m of its upper side."""
    cloth, w, top = _one(rng, CLOTH), rng.uniform(0.21, 0.26), seat + rng.uniform(0.25, 0.75)
    shape = revolved(rng, Surface.DARK, [(0.28, 0.02), (0.28, 0.05), (0.04, 0.1), (0.03, seat - 0.08)])
    shape += box(rng, cloth, (-w, -0.2, seat - 0.08), (w, 0.24, seat))
    shape += box(rng, cloth, (-0.95 * w, -0.3, seat + rng.uniform(0.02, 0.16)), (0.95 * w, -0.22, top))
    if rng.random() < 0.5:
        for x in (-w - 0.05, w):
            shape += box(rng, Surface.DARK, (x, -0.2, seat + 0.18), (x + 0.05, 0.1, seat + 0.22)) + box(
                rng, Surface.DARK, (x, -0.08, seat - 0.06), (x + 0.05, -0.03, seat + 0.18)
            )
    return shape


def coat_over_back(rng: np.random.Generator, seat: float) -> Shape:
    """A coat or a jacket over the back of a chair that looks along +y, as wide as shoulders."""
    top, half, thick = seat + rng.uniform(0.4, 0.6), rng.uniform(0.19, 0.27), rng.uniform(0.07, 0.12)
    profile = [(0.7 * half, seat - rng.uniform(-0.1, 0.3)), (half, seat + 0.15), (half, top - 0.12), (0.6 * half, top - 0.03), (0.01, top)]
    return revolved(rng, _one(rng, CLOTHES), profile, thick / half).moved((0, -0.25, 0))


def _one(rng: np.random.Generator, surfaces: tuple[Surface, ...]) -> Surface:
    return surfaces[int(rng.integers(len(surfaces)))]
