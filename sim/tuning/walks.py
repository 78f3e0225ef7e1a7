"""Places of synthetic cases, and paths of people and rovers in them: they come, walk, cross, stand in groups, sit, wait at doors and leave.

People are points with the social force (Helbing and Molnár 1995), along shortest paths in free space. The force on standing people is small, so
that they stand as close together as in real rooms. Places have free space, doors, seats and occluders.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from tracker.geometry import Array, Ints, Mask
from tracker.geometry.ground import Flat, Grid, Ground
from worlds.catalogue import build
from worlds.terrain.free_space import FreeSpace, largest_region

SPACING = 0.15
"""m: of the grid of free space in rooms, halls and squares."""
BODY_RADIUS = 0.2
"""m: a person's middle keeps this distance from walls and furniture."""
LEVEL = Flat()
OUTDOOR_WORLDS = ("campus", "forest", "hills", "quarry", "ruins")
MOST_PEOPLE = 60
"""People at once, at most, unless more are there from the start; others wait outside."""
SPOTS = 14
"""Places of a case to which people walk."""
STEPS = 4
"""Steps of motion in a frame; the clock of a camera is off by whole steps."""
LEAST_SPACING = 0.3
"""m: least distance between two people, kept by `apart`."""
RELAXATION, PUSH, REACH = 0.4, 1.6, 0.22
"""The social force: s until the wanted velocity is reached; m/s² where bodies touch; m over which it falls by e."""
TOUCH = 0.45
"""m: distance of the middles of two bodies that touch."""
ARRIVED, LEFT, DIRECT = 0.2, 0.6, 1.5
"""m: distances from a goal at which people stop, from a door at which they leave, and from a goal within which the path is straight."""
PATIENCE = 5.0
"""s without progress after which a person stands still, or goes elsewhere."""
WARM_UP = 12.0
"""s of simulation before the first frame."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A place where people walk.

    free: of people. doors (d, 2), spots (s, 2), seats (k, 2) m: where people come in and leave, meet, and sit. ground: the terrain.
    pillars (p, 5): furniture and columns, as in Setup. occluders: heights of objects on the ground, None where pillars are the only ones.
    area (2, 2): lowest and highest x, y m.
    """

    free: FreeSpace
    doors: Array
    spots: Array
    seats: Array
    area: Array
    ground: Ground = LEVEL
    pillars: Array = field(default_factory=lambda: np.zeros((0, 5)))
    occluders: Grid | None = None


def floor(area: Array, furniture: Array, doors: int, rng: np.random.Generator, ground: Ground = LEVEL) -> Surroundings:
    """The ground in an area (2, 2): lowest and highest x, y m, with furniture (p, 5) on it. Doors are at its border."""
    low, high = np.asarray(area, dtype=np.float64)
    columns, rows = (int(np.ceil(side / SPACING)) + 3 for side in (high - low).tolist())
    origin = low - SPACING
    x, y = origin[0] + SPACING * np.arange(columns), origin[1] + SPACING * np.arange(rows)
    across, along = (np.abs(v - (a + b) / 2) <= (b - a) / 2 - BODY_RADIUS for v, a, b in zip((x, y), low, high, strict=True))
    inside = across[None] & along[:, None]
    for one_x, one_y, radius, bottom, _ in furniture:
        if bottom < 1.8:
            inside &= (x[None] - one_x) ** 2 + (y[:, None] - one_y) ** 2 > (radius + BODY_RADIUS) ** 2
    free = FreeSpace(largest_region(inside), origin, SPACING)
    seats = _seats(free, furniture, rng)
    return Surroundings(free, _border(free, doors, rng), _spots(free, rng), seats, np.array([low, high]), ground, furniture)


def furniture(size: tuple[float, float], density: float, rng: np.random.Generator) -> Array:
    """Tables, shelves and columns as upright cylinders (p, 5): `density` of them a square metre."""
    count = int(rng.poisson(density * size[0] * size[1]))
    rows = []
    for _ in range(count):
        kind = rng.random()
        radius, top = (rng.uniform(0.3, 0.7), rng.uniform(0.65, 0.8)) if kind < 0.6 else (rng.uniform(0.25, 0.45), rng.uniform(1.1, 2.1))
        if kind > 0.9:
            radius, top = rng.uniform(0.15, 0.35), 4.0
        rows.append((*rng.uniform(0.0, size), radius, 0.0, top))
    return np.asarray(np.array(rows, dtype=np.float64).reshape(-1, 5).round(3), dtype=np.float64)


def outdoor(name: str, difficulty: float, rng: np.random.Generator) -> Surroundings:
    """An outdoor world."""
    world = build(name, rng, difficulty)
    tops, spots = world.tops(), _spots(world.feet, rng)
    walked = world.terrain.on_grid
    ground = Grid(np.round(walked.heights, 3), walked.origin, walked.spacing)
    doors = world.spawn.mean(axis=1)
    points = world.feet.points(world.feet.free)
    area = np.array([points.min(axis=0), points.max(axis=0)]).round(2)
    occluders = Grid(np.round(tops.heights, 3), tops.origin, tops.spacing)
    return Surroundings(world.feet, doors, spots, np.zeros((0, 2)), area, ground, occluders=occluders)


def _spots(free: FreeSpace, rng: np.random.Generator) -> Array:
    """Places (s, 2) m spread over free space: each is the farthest of four random candidates from those chosen before."""
    points = free.points(free.clearance > min(0.2, 0.5 * float(free.clearance.max())))
    return _spread(points, min(SPOTS, len(points)), rng)


def _border(free: FreeSpace, count: int, rng: np.random.Generator) -> Array:
    edge = free.free & ~ndimage.binary_erosion(free.free)
    return _spread(free.points(edge), count, rng)


def _spread(points: Array, count: int, rng: np.random.Generator) -> Array:
    chosen = [points[int(rng.integers(len(points)))]]
    while len(chosen) < count:
        some = points[rng.integers(len(points), size=4)]
        apart = np.linalg.norm(some[:, None] - np.array(chosen), axis=2).min(axis=1)
        chosen.append(some[int(np.argmax(apart))])
    return np.asarray(chosen, dtype=np.float64)


def _seats(free: FreeSpace, pillars: Array, rng: np.random.Generator) -> Array:
    """Up to three places (k, 2) m around each table."""
    out = []
    for x, y, radius, _, top in pillars:
        if 0.6 < top < 0.85:
            angles = rng.uniform(-np.pi, np.pi) + np.arange(3) * 2 * np.pi / 3
            out += [(x + (radius + 0.3) * np.cos(a), y + (radius + 0.3) * np.sin(a)) for a in angles]
    places = np.array(out).reshape(-1, 2)
    return places[free.clearance_at(places) > 0] if len(places) else places


def reached(ground: Ground, eye: Array, points: Array) -> Mask:
    """Mask (n,) of the points (n, 3) m that a height map does not hide from `eye` (3,) m."""
    away = points - eye
    length = np.linalg.norm(away, axis=1)
    origins = np.broadcast_to(eye, points.shape)
    met, hit = ground.intersect(origins, away / length[:, None], float(length.max(initial=1.0)) + 1.0)
    return np.asarray(~hit | (np.linalg.norm(met - eye, axis=1) > length - 0.3))


@dataclass(frozen=True)
class Habits:
    """The habits of people.

    standing, sitting, waiting: probabilities that a person next stands in a group, sits, or waits at a door; others walk on after a short pause.
    pause: s that people stand in the mean. speed: m/s in the mean. gap: m, lowest and highest distance of neighbours in a group.
    crossing: probability that a person crosses the place to a door and leaves. If it is not 0, all who come later cross, and the others stay.
    """

    standing: float
    sitting: float
    waiting: float
    pause: float
    speed: float
    gap: tuple[float, float]
    crossing: float = 0.0


@dataclass(frozen=True, eq=False)
class Walks:
    """Places (steps, people, 2) m, NaN for absent people; sits (steps, people)."""

    place: Array
    sits: Mask


class Walkers:
    """The state of people in a place; rows of `rovers` are rovers, which never stand in groups and never leave."""

    def __init__(self, around: Surroundings, habits: Habits, people: int, rovers: int, rng: np.random.Generator) -> None:
        n = people + rovers
        self.around, self.habits, self.rng, self.people = around, habits, rng, people
        self.targets = np.concatenate([around.spots, around.doors, around.seats])
        self.fields: dict[int, Array] = {}
        self.place, self.velocity = np.zeros((n, 2)), np.zeros((n, 2))
        self.goal, self.target = np.zeros((n, 2)), np.zeros(n, dtype=np.int64)
        self.speed = np.clip(rng.normal(habits.speed, 0.2 * habits.speed, n), 0.25, 1.8)
        self.speed[people:] = rng.uniform(0.3, 0.7, rovers)
        self.wait, self.next_wait = np.zeros(n), np.zeros(n)
        self.sits, self.next_sits, self.leaving = (np.zeros(n, dtype=bool) for _ in range(3))
        self.stuck, self.enter = np.zeros(n), np.full(n, -np.inf)
        self.leave, self.present = np.full(n, np.inf), np.zeros(n, dtype=bool)
        self.members: dict[int, list[int]] = {}
        self.gap = rng.uniform(*habits.gap, len(around.spots))
        self.crosses, self.most = np.zeros(n, dtype=bool), MOST_PEOPLE

    @staticmethod
    def of(around: Surroundings, habits: Habits, counts: tuple[int, int, int], duration: float, rng: np.random.Generator) -> Walkers:
        """counts: people at once, people in all, rovers."""
        at_once, people, rovers = counts
        out = Walkers(around, habits, people, rovers, rng)
        # Those who cross leave during the warm-up, too, and others come in their place.
        first = -WARM_UP if habits.crossing > 0 else 0.0
        out.enter[at_once:people] = np.sort(rng.uniform(first, duration, people - at_once))
        if habits.crossing > 0:
            out.crosses[:people] = (rng.random(people) < habits.crossing) | (np.arange(people) >= at_once)
        leavers = rng.permutation(people)[: max(0, people - at_once) if habits.crossing == 0 else 0]
        out.leave[leavers] = np.maximum(rng.uniform(0.0, duration, len(leavers)), out.enter[leavers] + 5.0)
        here = np.concatenate([np.arange(at_once), np.arange(people, people + rovers)])
        points = around.free.points(around.free.clearance > 0)
        out.place[here] = points[rng.integers(len(points), size=len(here))]
        out.present[here], out.most = True, max(MOST_PEOPLE, at_once)
        for k in here.tolist():
            out.choose(k)
        return out

    def choose(self, k: int) -> None:
        """Choose the next goal of person or rover k."""
        h, rng = self.habits, self.rng
        self._leave_group(k)
        self.sits[k] = self.next_sits[k] = False
        self.stuck[k] = 0.0
        if self.crosses[k]:
            self._exit(k)
            return
        kind = rng.random() if k < self.people else 1.0
        if kind < h.sitting and len(self.around.seats):
            seat = int(rng.integers(len(self.around.seats)))
            # One chair serves one person.
            taken = np.linalg.norm(self.goal - self.around.seats[seat], axis=1).min() < 0.3
            if not taken:
                self._go(k, self.around.seats[seat], None, rng.exponential(6 * h.pause) + 5.0)
                self.next_sits[k] = True
                return
        if kind < h.sitting + h.standing:
            self._join(k)
        elif kind < h.sitting + h.standing + h.waiting:
            door = self.around.doors[int(rng.integers(len(self.around.doors)))]
            self._go(k, door + rng.normal(0.0, 0.4, 2), None, rng.exponential(0.6 * h.pause) + 2.0)
        else:
            spot = int(rng.integers(len(self.around.spots)))
            self._go(k, self.around.spots[spot] + rng.normal(0.0, 0.5, 2), spot, float(rng.exponential(1.0)) if rng.random() < 0.5 else 0.0)

    def _join(self, k: int) -> None:
        """Join a group of up to six at a spot, beside the others, `gap` from a neighbour."""
        open_groups = [spot for spot, who in self.members.items() if 0 < len(who) < 6]
        spot = open_groups[int(self.rng.integers(len(open_groups)))] if open_groups and self.rng.random() < 0.75 else None
        spot = int(self.rng.integers(len(self.around.spots))) if spot is None else spot
        gap = float(self.gap[spot])
        others = np.array([self.goal[i] for i in self.members.get(spot, [])]).reshape(-1, 2)
        base = others[int(self.rng.integers(len(others)))] if len(others) else self.around.spots[spot]
        best, room = base, -np.inf
        for angle in self.rng.uniform(-np.pi, np.pi, 10):
            tried = base + (gap if len(others) else 0.0) * np.array([np.cos(angle), np.sin(angle)])
            nearest = np.linalg.norm(others - tried, axis=1).min(initial=gap)
            fits = min(nearest, gap) + min(float(self.around.free.clearance_at(tried[None])[0]), 0.0)
            if fits > room:
                best, room = tried, fits
        self.members.setdefault(spot, []).append(k)
        self._go(k, best, spot, float(self.rng.exponential(self.habits.pause)) + 2.0)

    def _leave_group(self, k: int) -> None:
        for who in self.members.values():
            if k in who:
                who.remove(k)

    def _go(self, k: int, goal: Array, spot: int | None, wait: float) -> None:
        goal = np.asarray(goal, dtype=np.float64)
        for _ in range(8):
            if self.around.free.clearance_at(goal[None])[0] > 0:
                break
            goal = goal + 0.2 * self.around.free.away_at(goal[None])[0]
        if self.around.free.clearance_at(goal[None])[0] <= 0:
            goal, spot = self.around.spots[0].copy(), 0
        near = int(np.argmin(np.linalg.norm(self.targets - goal, axis=1))) if spot is None else spot
        self.goal[k], self.target[k], self.next_wait[k], self.wait[k] = goal, near, wait, 0.0

    def step(self, time: float, dt: float) -> None:
        """One step of dt s."""
        self._come_and_go(time)
        for k in np.flatnonzero(self.present & (self.wait > 0)).tolist():
            self.wait[k] -= dt
            if self.wait[k] <= 0:
                self.choose(k)
        here = np.flatnonzero(self.present)
        stands = self.wait[here] > 0
        place, away = self.place[here], self.goal[here] - self.place[here]
        distance = np.linalg.norm(away, axis=1)
        wanted = self._directions(here, away, distance) * self.speed[here, None] * np.minimum(distance / 0.4, 1.0)[:, None]
        wanted[stands] = away[stands] * 0.5 + self.rng.normal(0.0, 0.06, (len(here), 2))[stands]
        between = place[:, None] - place
        gap = np.maximum(np.linalg.norm(between, axis=2), 1e-3) + np.diag(np.full(len(here), np.inf))
        force = ((PUSH * np.exp((TOUCH - gap) / REACH) / gap)[:, :, None] * between).sum(axis=1)
        force *= np.where(stands, np.where(self.sits[here], 0.0, 0.05), 1.0)[:, None]
        velocity = self.velocity[here] + dt * ((wanted - self.velocity[here]) / RELAXATION + force)
        fast = np.linalg.norm(velocity, axis=1)
        velocity *= (np.minimum(fast, 1.3 * self.speed[here]) / np.maximum(fast, 1e-9))[:, None]
        moved = self._inside(apart(place + dt * velocity), place)
        self.velocity[here], self.place[here] = (moved - place) / dt, moved
        self._arrive(here, stands, dt)

    def _directions(self, here: Ints, away: Array, distance: Array) -> Array:
        out = away / np.maximum(distance, 1e-9)[:, None]
        far = distance > DIRECT
        for target in np.unique(self.target[here[far]]).tolist():
            rows = np.flatnonzero(far & (self.target[here] == target))
            if target not in self.fields:
                self.fields[target] = self.around.free.distance_to(self.targets[target])
            way = self.around.free.direction_at(self.fields[target], self.place[here[rows]])
            near = np.linalg.norm(self.targets[target] - self.place[here[rows]], axis=1) < DIRECT
            out[rows] = np.where((np.abs(way).sum(axis=1) > 0)[:, None] & ~near[:, None], way, out[rows])
        return out

    def _inside(self, moved: Array, before: Array) -> Array:
        free = self.around.free
        for _ in range(2):
            short = np.maximum(0.02 - free.clearance_at(moved), 0.0)
            if not short.any():
                return moved
            moved = moved + short[:, None] * free.away_at(moved)
        lost = free.clearance_at(moved) < -0.1
        return np.asarray(np.where(lost[:, None], before, moved))

    def _arrive(self, here: Ints, stands: Mask, dt: float) -> None:
        slow = np.linalg.norm(self.velocity[here], axis=1) < 0.2 * self.speed[here]
        self.stuck[here] = np.where(slow & ~stands, self.stuck[here] + dt, 0.0)
        distance = np.linalg.norm(self.goal[here] - self.place[here], axis=1)
        arrived = distance < np.where(self.leaving[here], LEFT, ARRIVED)
        for k in here[~stands & (arrived | (self.stuck[here] > PATIENCE))].tolist():
            if self.leaving[k]:
                self.present[k] = self.stuck[k] > PATIENCE
                if self.present[k]:
                    self._exit(k)
            elif self.stuck[k] > PATIENCE and self.rng.random() < 0.5:
                self.choose(k)
            else:
                self.stuck[k], self.wait[k] = 0.0, max(self.next_wait[k], 1e-3)
                self.sits[k] = self.next_sits[k]

    def _come_and_go(self, time: float) -> None:
        room = max(0, self.most - int(self.present[: self.people].sum()))
        for k in np.flatnonzero(~self.present & (self.enter <= time) & np.isfinite(self.enter))[:room].tolist():
            self.enter[k], self.present[k] = np.inf, True
            door = self.around.doors[int(self.rng.integers(len(self.around.doors)))]
            self.place[k], self.velocity[k] = door + self.rng.normal(0.0, 0.05, 2), 0.0
            self.choose(k)
        for k in np.flatnonzero(self.present & (self.leave <= time) & ~self.leaving).tolist():
            self._exit(k)

    def _exit(self, k: int) -> None:
        self._leave_group(k)
        self.leaving[k], self.sits[k], self.next_sits[k], self.wait[k], self.stuck[k] = True, False, False, 0.0, 0.0
        doors = self.around.doors
        if self.crosses[k]:
            far = np.linalg.norm(doors - self.place[k], axis=1)
            doors = doors[far >= np.median(far)]
        self._go(k, doors[int(self.rng.integers(len(doors)))], None, 0.0)


def apart(place: Array) -> Array:
    """Places (n, 2) m, moved until any two are LEAST_SPACING apart, in at most six rounds."""
    for _ in range(6):
        between = place[:, None] - place
        gap = np.maximum(np.linalg.norm(between, axis=2), 1e-6) + np.diag(np.full(len(place), np.inf))
        if gap.min(initial=np.inf) >= LEAST_SPACING:
            break
        short = np.maximum(LEAST_SPACING + 1e-3 - gap, 0.0) / gap
        place = place + 0.5 * (short[:, :, None] * between).sum(axis=1)
    return place


def walks(walkers: Walkers, frames: int, period: float) -> Walks:
    """The paths from half a frame before the first frame to half a frame after the last: STEPS · frames + 1 steps."""
    dt, count = period / STEPS, STEPS * frames + 1
    place, sits = np.full((count, len(walkers.place), 2), np.nan), np.zeros((count, len(walkers.place)), dtype=bool)
    warm = round(WARM_UP / dt)
    for step in range(-warm, count):
        walkers.step(step * dt, dt)
        if step >= 0:
            place[step, walkers.present], sits[step] = walkers.place[walkers.present], walkers.sits
    return Walks(place, sits)
