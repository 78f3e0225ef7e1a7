"""Textures of things on walls: windows, doors, boards, posters, pipes and sockets. Functions of things at x m (left side) return the width, m."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from worlds.textures.masonry import brick, concrete, plaster, skirting
from worlds.textures.materials import Box, Canvas, tint

INK = (45, 48, 55)
BRIGHT = np.array(
    [[196, 72, 58], [48, 98, 160], [226, 172, 60], [66, 132, 92], [120, 80, 140], [236, 232, 222], [40, 44, 52], [70, 160, 175]],
    dtype=np.float64,
)


def wall(rng: np.random.Generator, width: float, height: float, base: float, door: bool = False) -> Canvas:
    """A whole wall, width x height m and down to `base` m: with `door`, a closed door in its middle, else random things."""
    material = (plaster, plaster, brick, concrete)[int(rng.integers(4))]
    canvas = material(rng, width, height, base)
    skirting(canvas, rng)
    if door:
        _door(canvas, rng, width / 2 - 0.5)
    elif width > 1.2:
        _hang(canvas, rng)
    return canvas


def _hang(canvas: Canvas, rng: np.random.Generator) -> None:
    """Fill a wall from left to right with things of changing kinds."""
    things: tuple[Callable[[Canvas, np.random.Generator, float], float], ...] = (
        _poster, _posters, _board, _notices, _window, _cupboard, _chart, _panel,
    )  # fmt: skip
    _services(canvas, rng)
    x, last = rng.uniform(0.1, 0.5), -1
    while x < canvas.width - 1.0:
        kind = int(rng.choice([k for k in range(len(things)) if k != last]))
        if x + 2.0 > canvas.width and kind in (2, 3, 4):
            kind = 0
        x += things[kind](canvas, rng, x) + rng.uniform(0.15, 0.8)
        last = kind


def _services(canvas: Canvas, rng: np.random.Generator) -> None:
    """Pipes and trunking along the wall, sockets on it."""
    for y in (canvas.height - rng.uniform(0.12, 0.3), rng.uniform(0.95, 1.15)):
        thick = rng.uniform(0.03, 0.09)
        box = (0.0, y, canvas.width, y + thick)
        canvas.fill(box, tint(rng, (176, 176, 172)))
        rows = canvas.window(box).shape[0]
        canvas.shade(box, 0.18 * np.sin(np.linspace(-0.6, 3.6, rows))[:, None] - 0.08)
        canvas.mottle(rng, box, 0.15, 0.4, 3)
        x = rng.uniform(0.2, 0.6)
        while x < canvas.width:
            canvas.fill((x, y - 0.012, x + 0.035, y + thick + 0.012), tint(rng, (104, 104, 104)))
            x += rng.uniform(0.5, 1.3)
    for _ in range(int(1 + canvas.width / 2)):
        x, y = rng.uniform(0.1, canvas.width - 0.2), rng.choice([0.3, 1.3])
        canvas.fill((x, y, x + 0.16, y + 0.085), (232, 230, 224))
        canvas.frame((x, y, x + 0.16, y + 0.085), (150, 150, 148), 0.01)
        canvas.disc((x + 0.04, y + 0.042), 0.022, (110, 110, 110))
        canvas.disc((x + 0.115, y + 0.042), 0.022, (110, 110, 110))
    if rng.uniform() < 0.6:
        x = rng.uniform(0.3, canvas.width - 0.3)
        box = (x, canvas.base, x + rng.uniform(0.05, 0.12), canvas.height)
        canvas.fill(box, tint(rng, BRIGHT[int(rng.integers(5))] * 0.6 + 70))
        columns = canvas.window(box).shape[1]
        canvas.shade(box, 0.25 * np.sin(np.linspace(-0.6, 3.6, columns))[None, :] - 0.1)


def _poster(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """A scientific poster: a title, columns of writing, pictures and plots."""
    width = rng.uniform(0.55, 1.0)
    high = width * rng.uniform(1.15, 1.4)
    y0 = rng.uniform(1.2, 1.35)
    x1, y1 = x + width, min(y0 + high, canvas.height - 0.3)
    colour = BRIGHT[int(rng.integers(5))]
    canvas.shade((x + 0.02, y0 - 0.02, x1 + 0.015, y1), -0.25)
    canvas.fill((x, y0, x1, y1), tint(rng, (238, 236, 230), 6))
    head = y1 - 0.16 * (y1 - y0)
    canvas.fill((x, head, x1, y1), tint(rng, colour))
    canvas.writing(rng, (x + 0.05, head + 0.02, x1 - 0.05, y1 - 0.02), (245, 245, 240), 0.05)
    half = x + 0.5 * width
    for left, right in ((x + 0.04, half - 0.02), (half + 0.02, x1 - 0.04)):
        level = head - 0.03
        while level > y0 + 0.2:
            tall = rng.uniform(0.14, 0.3)
            box = (left, max(level - tall, y0 + 0.04), right, level)
            kind = int(rng.integers(3))
            if kind == 0:
                canvas.picture(rng, box, BRIGHT[rng.integers(0, len(BRIGHT), 3)])
            elif kind == 1:
                _plot(canvas, rng, box)
            else:
                canvas.writing(rng, box, INK, 0.02)
            level -= tall + 0.03
    return width


def _plot(canvas: Canvas, rng: np.random.Generator, box: Box) -> None:
    x0, y0, x1, y1 = box
    canvas.fill(box, (226, 228, 230))
    canvas.frame(box, (70, 70, 76), 0.008)
    for _ in range(int(rng.integers(1, 4))):
        colour = BRIGHT[int(rng.integers(5))]
        level, dx = rng.uniform(0.2, 0.8), 0.012
        for x in np.arange(x0 + 0.01, x1 - 0.02, dx):
            level = float(np.clip(level + rng.normal(0, 0.07), 0.05, 0.9))
            y = y0 + level * (y1 - y0)
            canvas.fill((x, y, x + dx, y + 0.012), colour)


def _posters(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """Sheets of paper, taped up askew in rows."""
    start = x
    for _ in range(int(rng.integers(2, 5))):
        for y in (1.85, 1.45):
            if rng.uniform() < 0.8:
                dx, dy = rng.uniform(-0.02, 0.04), rng.uniform(-0.04, 0.05)
                box = (x + dx, y + dy, x + dx + 0.21, y + dy + 0.297)
                canvas.fill(box, tint(rng, BRIGHT[5] if rng.uniform() < 0.7 else BRIGHT[2] * 0.5 + 120, 8))
                canvas.writing(rng, (box[0] + 0.02, box[1] + 0.1, box[2] - 0.02, box[3] - 0.02), INK, 0.022)
                canvas.picture(rng, (box[0] + 0.03, box[1] + 0.02, box[2] - 0.03, box[1] + 0.09), BRIGHT[rng.integers(0, len(BRIGHT), 3)])
        x += 0.27
    return x - start


def _board(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """A white or a black board with formulas on it."""
    width = min(rng.uniform(1.4, 2.2), canvas.width - x - 0.1)
    box = (x, 1.0, x + width, 2.1)
    dark = rng.uniform() < 0.35
    canvas.fill(box, tint(rng, (52, 76, 66) if dark else (234, 236, 238), 5))
    canvas.mottle(rng, box, 0.12 if dark else 0.05, 0.5, 3)
    for _ in range(int(rng.integers(4, 8))):
        a, b = x + rng.uniform(0.05, 0.7) * width, rng.uniform(1.1, 1.8)
        ink = (220, 224, 216) if dark else BRIGHT[int(rng.choice([0, 1, 3, 6]))]
        canvas.writing(rng, (a, b, min(a + rng.uniform(0.3, 0.8), x + width - 0.05), b + rng.uniform(0.06, 0.3)), ink, rng.uniform(0.035, 0.07))
    for _ in range(3):
        a, b, s = x + rng.uniform(0.1, 0.8) * width, rng.uniform(1.15, 1.7), rng.uniform(0.1, 0.25)
        canvas.frame((a, b, min(a + s, x + width - 0.04), b + s), BRIGHT[int(rng.choice([0, 1, 3, 2]))], 0.012)
    canvas.frame(box, (150, 152, 156), 0.035)
    canvas.fill((x + 0.1, 0.96, x + width - 0.1, 1.0), (120, 122, 126))
    return width


def _notices(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """A cork board full of notes."""
    width = min(rng.uniform(0.9, 1.5), canvas.width - x - 0.1)
    box = (x, 1.15, x + width, 2.0)
    canvas.fill(box, tint(rng, (178, 138, 92), 6))
    canvas.mottle(rng, box, 0.3, 0.05, 3)
    for _ in range(int(14 * width)):
        w, h = rng.uniform(0.08, 0.24), rng.uniform(0.08, 0.26)
        a, b = x + rng.uniform(0.04, max(0.05, width - w - 0.04)), rng.uniform(1.19, 1.96 - h)
        colour = BRIGHT[int(rng.integers(len(BRIGHT)))]
        canvas.shade((a + 0.01, b - 0.01, a + w + 0.008, b + h), -0.3)
        canvas.fill((a, b, a + w, b + h), tint(rng, 0.35 * colour + 150, 10))
        canvas.writing(rng, (a + 0.01, b + 0.01, a + w - 0.01, b + h - 0.015), INK, rng.uniform(0.014, 0.03))
        canvas.disc((a + w / 2, b + h - 0.01), 0.009, BRIGHT[int(rng.integers(5))])
    canvas.frame(box, (110, 82, 54), 0.04)
    return width


def _window(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """A window with mullions: sky, and something green below it."""
    width = min(rng.uniform(1.1, 1.9), canvas.width - x - 0.1)
    y0, y1 = 1.0, canvas.height - 0.45
    box = (x, y0, x + width, y1)
    canvas.picture(rng, box, ((176, 200, 226), (206, 220, 234), (238, 240, 242)))
    canvas.picture(rng, (x, y0, x + width, y0 + rng.uniform(0.3, 0.7)), ((78, 104, 66), (120, 138, 92), (58, 76, 60)))
    roof = x + rng.uniform(0, 0.6) * width
    canvas.fill((roof, y0, roof + 0.35 * width, y0 + rng.uniform(0.4, 0.8)), tint(rng, (150, 128, 116)))
    if rng.uniform() < 0.5:
        bottom = rng.uniform(y0 + 0.5, y1 - 0.15)
        for y in np.arange(bottom, y1, 0.05):
            canvas.fill((x, y, x + width, y + 0.036), tint(rng, (214, 210, 198), 5))
    panes = int(rng.integers(2, 4))
    for k in range(1, panes):
        canvas.fill((x + k * width / panes - 0.03, y0, x + k * width / panes + 0.03, y1), (222, 220, 214))
    canvas.fill((x, y0 + 0.68 * (y1 - y0), x + width, y0 + 0.68 * (y1 - y0) + 0.04), (222, 220, 214))
    canvas.frame(box, tint(rng, (218, 216, 210), 5), 0.06)
    canvas.fill((x - 0.06, y0 - 0.06, x + width + 0.06, y0), (196, 192, 184))
    canvas.shade((x - 0.06, y0 - 0.10, x + width + 0.06, y0 - 0.06), -0.3)
    return width


def _cupboard(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """A wall cupboard for first aid, fuses or fire hoses, with its signs."""
    width, y0 = rng.uniform(0.4, 0.8), rng.uniform(1.1, 1.5)
    box = (x, y0, x + width, y0 + rng.uniform(0.5, 0.8))
    colour = BRIGHT[int(rng.choice([0, 3, 5, 1]))]
    canvas.shade((x + 0.02, y0 - 0.03, x + width + 0.025, box[3]), -0.3)
    canvas.fill(box, tint(rng, 0.8 * colour + 30, 8))
    canvas.frame(box, 0.5 * colour, 0.02)
    canvas.mottle(rng, box, 0.12, 0.4, 4)
    canvas.fill((x + 0.1, y0 + 0.2, x + width - 0.1, y0 + 0.4), (240, 238, 230))
    canvas.writing(rng, (x + 0.12, y0 + 0.22, x + width - 0.12, y0 + 0.38), INK, 0.04)
    canvas.disc((x + width - 0.06, y0 + 0.12), 0.02, (60, 60, 60))
    sign = (x + 0.05, box[3] + 0.08, x + 0.27, box[3] + 0.30)
    canvas.fill(sign, tint(rng, (0, 122, 84) if rng.uniform() < 0.5 else (196, 40, 36)))
    canvas.writing(rng, (sign[0] + 0.03, sign[1] + 0.03, sign[2] - 0.02, sign[3] - 0.03), (240, 240, 236), 0.07)
    return width


def _chart(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """A framed map, photograph or painting, high on the wall, with a clock beside it."""
    width, high = rng.uniform(0.6, 1.1), rng.uniform(0.45, 0.75)
    box = (x, 1.45, x + width, 1.45 + high)
    canvas.shade((x + 0.02, 1.42, x + width + 0.02, 1.45 + high), -0.3)
    canvas.picture(rng, box, BRIGHT[rng.integers(0, len(BRIGHT), 3)])
    canvas.frame((x + 0.03, 1.48, x + width - 0.03, 1.42 + high), (240, 238, 230), 0.03)
    canvas.frame(box, tint(rng, (70, 54, 40)), 0.035)
    if rng.uniform() < 0.5:
        centre = (x + width + 0.22, 2.1)
        canvas.disc(centre, 0.16, (40, 40, 44))
        canvas.disc(centre, 0.14, (240, 240, 236))
        canvas.fill((centre[0] - 0.006, centre[1], centre[0] + 0.006, centre[1] + 0.11), INK)
        canvas.fill((centre[0], centre[1] - 0.006, centre[0] + 0.08, centre[1] + 0.006), INK)
        width += 0.4
    return width


def _panel(canvas: Canvas, rng: np.random.Generator, x: float) -> float:
    """A grey switchboard: rows of lamps, dials and labels."""
    width, y0 = rng.uniform(0.5, 0.9), rng.uniform(0.9, 1.2)
    box = (x, y0, x + width, y0 + rng.uniform(0.7, 1.0))
    canvas.fill(box, tint(rng, (142, 148, 150), 8))
    canvas.mottle(rng, box, 0.1, 0.3, 4)
    for y in np.arange(y0 + 0.1, box[3] - 0.1, 0.13):
        for a in np.arange(x + 0.08, x + width - 0.08, 0.11):
            if rng.uniform() < 0.75:
                canvas.disc((a, y), rng.uniform(0.015, 0.035), tint(rng, BRIGHT[int(rng.integers(len(BRIGHT)))]))
                canvas.writing(rng, (a - 0.03, y + 0.035, a + 0.04, y + 0.06), INK, 0.018)
    canvas.frame(box, (84, 88, 90), 0.025)
    return width


def _door(canvas: Canvas, rng: np.random.Generator, x: float) -> None:
    """A closed door a metre wide with its frame, a pane, a plate and a sign."""
    colour = tint(rng, [(120, 84, 58), (84, 104, 128), (148, 60, 52), (170, 164, 150)][int(rng.integers(4))], 8)
    box = (x, 0.0, x + 1.0, 2.1)
    canvas.fill((x - 0.09, 0.0, x + 1.09, 2.19), tint(rng, (206, 200, 190), 6))
    canvas.fill(box, colour)
    canvas.mottle(rng, box, 0.25, 0.5, 5)
    canvas.fill((x + 0.3, 1.25, x + 0.7, 1.9), (150, 176, 190))
    canvas.mottle(rng, (x + 0.3, 1.25, x + 0.7, 1.9), 0.25, 0.5, 2)
    canvas.frame((x + 0.3, 1.25, x + 0.7, 1.9), colour * 0.6, 0.03)
    canvas.fill((x + 0.05, 0.05, x + 0.95, 0.3), (168, 170, 172))
    canvas.fill((x + 0.82, 1.0, x + 0.95, 1.04), (60, 60, 62))
    canvas.fill((x + 0.1, 1.6, x + 0.26, 1.72), (240, 236, 220))
    canvas.writing(rng, (x + 0.11, 1.61, x + 0.25, 1.71), INK, 0.035)
    canvas.fill((x + 0.3, 2.26, x + 0.7, 2.42), (0, 128, 84))
    canvas.writing(rng, (x + 0.34, 2.28, x + 0.66, 2.40), (240, 244, 240), 0.09)
