"""Simulated boxes of one view by a detector model. Random draws are seeded, and those of a person do not depend on who else is in the view."""

from __future__ import annotations

from collections.abc import Iterable
from typing import final

import numpy as np
from scipy.special import expit, ndtr

from tracker.detector_models.bodies import LEAST_VISIBLE, MATCH, OVERLAPS, Place, SimulatedBoxes, TrueBodies, nearest_overlap
from tracker.detector_models.model import CLEAR, KNOTS, DetectorModel
from tracker.detector_models.processes import persistence
from tracker.detector_models.second_boxes import example_kinds, examples_by_kind, next_example, second_rates
from tracker.detector_models.trends import trend_features
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.camera_protocol import Camera
from tracker.geometry.image_boxes import body_outlines, clipped, paired_overlaps

GRID = np.linspace(0.0, 1.0, KNOTS)
"""Probabilities of the quantiles of a model."""
TRIES = 30
"""Most places that are drawn for a false box until one lies in the image."""
LOST = 2.0
"""A standing false box is replaced if its distance from the camera exceeds this factor times its first distance plus 1 m."""
HALVINGS = 4
"""How often the errors of a box that would not match its body are halved, at most."""


@final
class ViewSampler:
    """The boxes of one view, frame by frame. It holds the hidden states of the people and the standing false boxes.

    persons: ids of all people who may appear. rng: the random stream of the view; the order of `persons` and the seed give the same bytes.
    """

    def __init__(self, model: DetectorModel, camera: Camera, period: float, persons: Iterable[int], rng: np.random.Generator) -> None:
        self.model, self.camera, self.period = model, camera, period
        self._row = {person: k for k, person in enumerate(sorted(set(persons)))}
        self._people, self._false, self._order = rng.spawn(3)
        n = len(self._row)
        correlation = np.array(model.edges.correlation)
        self._root = _root(correlation)
        self._rho = np.array([persistence(time_s, period) for time_s in model.edges.time_s])
        self._step = _root(correlation * (1 - self._rho[:, None] * self._rho[None]))
        self._lasting = self._people.normal(size=(n, 4)) @ self._root.T
        self._drift = self._people.normal(size=(n, 4)) @ self._root.T
        self._sure = self._people.normal(size=(n, 2))
        self._hidden = self._people.random((n, 3))
        self._example = self._people.integers(0, 1 << 30, (n, max(1, len(model.second.rates))))
        self._alike = examples_by_kind(model.second)
        # The present example of a second box, −1 for none, and whether its run is traversed forward. They need no random numbers.
        self._now = np.full(self._example.shape, -1)
        self._forward = np.ones(self._example.shape, dtype=bool)
        self._waited = 0.0
        self._sites = Sites(model, camera, period, self._false)

    def step(self, bodies: TrueBodies, place: Place) -> SimulatedBoxes:
        """The boxes of the next frame. Raises KeyError for a person who is not in `persons`."""
        rows = np.array([self._row[int(person)] for person in bodies.person], dtype=np.int64)
        found, confidence, person = self._of_people(bodies, rows)
        self._advance()
        false, sure = self._sites.step(place)
        edges = np.concatenate([found, false])
        everyone = np.concatenate([person, np.zeros(len(false), dtype=np.int64)])
        sures, order = np.concatenate([confidence, sure]), self._order.permutation(len(edges))
        size = np.maximum(edges[:, 2:] - edges[:, :2], 1.0)
        boxes = np.column_stack([edges[:, :2], size])
        if self.camera.wraps:
            boxes[:, 0] = np.mod(boxes[:, 0], self.camera.width)
        return SimulatedBoxes(boxes[order], sures[order], everyone[order])

    def _advance(self) -> None:
        """Advance the hidden states of all people to the next frame, whether they are in the view or not."""
        n, model = len(self._row), self.model
        self._drift = self._drift * self._rho + self._people.normal(size=(n, 4)) @ self._step.T
        rho = persistence(model.confidences.time_s, self.period)
        self._sure[:, 1] = rho * self._sure[:, 1] + np.sqrt(1 - rho**2) * self._people.normal(size=n)
        kept = [persistence(time_s, self.period) for time_s in (model.misses.time_s, model.merges.time_s, model.second.time_s)]
        renewed = self._people.random((n, 3)) >= np.array(kept)
        self._hidden = np.where(renewed, self._people.random((n, 3)), self._hidden)
        example = self._people.integers(0, 1 << 30, self._example.shape)
        self._now = np.where(renewed[:, 2:], -1, self._now)
        self._waited += self.period
        while 0 < model.second.step_s <= self._waited * (1 + 1e-9):
            self._waited -= model.second.step_s
            for row, number in np.argwhere(self._now >= 0).tolist():
                self._now[row, number], self._forward[row, number] = next_example(
                    model.second, int(self._now[row, number]), bool(self._forward[row, number])
                )
                renewed[row, 2] |= self._now[row, number] < 0
        self._example = np.where(renewed[:, 2:], example, self._example)

    def _of_people(self, bodies: TrueBodies, rows: Ints) -> tuple[Array, Array, Ints]:
        """Edges (n, 4) px, confidences (n,) and persons (n,) of the boxes of people, merged and second ones included."""
        model = self.model
        flicker = self._people.random(len(self._row))[rows]
        features = bodies.features(self.camera.height, model.misses.sizes)
        blind = blindness(model, features)
        visible = bodies.visible > LEAST_VISIBLE
        blind = np.where(visible, blind, model.misses.unseen)
        found = (visible | (model.misses.unseen < 1.0)) & (self._hidden[rows, 0] >= blind) & (flicker >= model.misses.flicker)
        edges = self._edges(bodies, rows)
        partner = merge_partner(bodies, self._hidden[rows, 1], model.merges.probability, found)
        for k in np.flatnonzero(partner >= 0):
            other = int(partner[k])
            edges[other] = np.concatenate([np.minimum(edges[other, :2], edges[k, :2]), np.maximum(edges[other, 2:], edges[k, 2:])])
        first, own = found.copy(), edges.copy()
        found &= partner < 0
        edges = self._in_image(edges)
        confidence = confidence_of(model, features, self._sure[rows])
        second, sure, of = self._second(bodies, rows, (visible, first, own), features)
        person = np.concatenate([bodies.person[found], of])
        return np.concatenate([edges[found], second]), np.concatenate([confidence[found], sure]), person

    def _edges(self, bodies: TrueBodies, rows: Ints) -> Array:
        """Edges (n, 4) px with errors, also of people who are missed."""
        errors = self.model.edges
        edges = expected_edges(self.model, bodies, self.camera)
        lasting = np.array(errors.lasting)
        score = np.sqrt(lasting) * self._lasting[rows] + np.sqrt(1 - lasting) * self._drift[rows]
        share = ndtr(score)
        # columns: middle, top, width, bottom
        tables = [np.column_stack([np.interp(share[:, k], GRID, table[k]) for k in range(4)]) for table in errors.quantiles]
        middle, top, width, bottom = np.where((bodies.visible >= CLEAR)[:, None], *tables).T
        if errors.trend:
            middle, top, width, bottom = np.array([middle, top, width, bottom]) + self._trend(bodies)
        error = np.column_stack([middle - width / 2, top, middle + width / 2, bottom]) * bodies.height[:, None]
        # The model has the errors of matched boxes only, so larger errors are halved.
        for _ in range(HALVINGS if errors.near == 0 else 0):
            wrong = np.maximum(paired_overlaps(edges + error, bodies.whole), paired_overlaps(edges + error, bodies.seen)) < MATCH
            error[wrong] /= 2
        edges = edges + error
        return np.concatenate([np.minimum(edges[:, :2], edges[:, 2:]), np.maximum(edges[:, :2], edges[:, 2:])], axis=1)

    def _trend(self, bodies: TrueBodies) -> Array:
        """Mean errors (4, n) of the terms by place, size and visible share."""
        errors = self.model.edges
        features = trend_features(*bodies.placed(self.camera), bodies.visible, np.array(errors.trend_bounds))
        return np.asarray(np.array(errors.trend) @ features.T)

    def _second(self, bodies: TrueBodies, rows: Ints, seen: tuple[Mask, Mask, Array], features: Array) -> tuple[Array, Array, Ints]:
        """Second boxes: edges (n, 4) px, confidences (n,), persons (n,).

        seen: whether anything of a body is visible, whether it has a first box, and the edges (n, 4) px of this.
        """
        second, (visible, found, first) = self.model.second, seen
        out, sure, of = [np.zeros(4)][:0], list[float](), list[int]()
        rates, kind = second_rates(second, features, found), example_kinds(bodies.visible, found)
        for k, row in enumerate(rows.tolist()):
            if not visible[k] and not found[k]:
                continue
            for number, rate in enumerate(rates[k].tolist()):
                if self._hidden[row, 2] < rate:
                    alike, now = self._alike[int(kind[k])], int(self._now[row, number])
                    if now < 0 or (second.samples[now][6] < 0.5) != found[k]:
                        now = int(alike[int(self._example[row, number]) % len(alike)])
                    if second.step_s > 0:
                        self._now[row, number] = now
                    sample = second.samples[now]
                    base = first[k] if found[k] and sample[6] < 0.5 else bodies.whole[k]
                    out.append(base + np.array(sample[:4]) * bodies.height[k])
                    sure.append(sample[4])
                    of.append(int(bodies.person[k]))
        return self._in_image(np.array(out).reshape(-1, 4)), np.array(sure), np.array(of, dtype=np.int64)

    def _in_image(self, edges: Array) -> Array:
        """Edges (n, 4) px, clipped to the image if the detector's boxes end at its border."""
        return clipped(edges[:, :2], edges[:, 2:], self.camera) if self.model.edges.border < 0.5 else edges


@final
class Sites:
    """False boxes of one view: new ones, and those that stand at places of the world."""

    def __init__(self, model: DetectorModel, camera: Camera, period: float, rng: np.random.Generator) -> None:
        self.model, self.camera, self.rng = model, camera, rng
        self.kept = persistence(model.standing.time_s, period)
        fixed = model.standing.fixed
        self.places = None if not fixed else FixedPlaces(model, period, rng)
        count = 0 if fixed else int(rng.poisson(model.standing.sites))
        self.sample = rng.integers(0, max(1, len(model.standing.samples)), count)
        self.foot: list[Array | None] = [None] * count
        self.state = rng.random(count)

    def step(self, place: Place) -> tuple[Array, Array]:
        """Edges (n, 4) px and confidences (n,) of the false boxes of the next frame."""
        rng, false = self.rng, self.model.false
        edges, sure = [np.zeros((0, 4))], list[float]()
        for _ in range(int(rng.poisson(false.rate))):
            distance, height, width, confidence = false.samples[int(rng.integers(len(false.samples)))]
            foot = self._drawn_foot(place, distance, (height, width))
            if foot is not None:
                edges.append(self._outline(place, foot, (height, width)))
                sure.append(confidence)
        for k, row in enumerate(self.sample.tolist()):
            if rng.random() >= self.kept:
                self.state[k] = rng.random()
            jitter, share = rng.normal(0.0, self.model.standing.jitter, 4), rng.random()
            distance, height, width, present, low, high = self.model.standing.samples[row]
            if self._lost(k, place, distance):
                self.foot[k] = self._drawn_foot(place, distance, (height, width))
            foot = self.foot[k]
            box = np.zeros((0, 4)) if foot is None else self._outline(place, foot, (height, width))
            if len(box) and self.state[k] < present:
                noisy = box + jitter * (box[0, 3] - box[0, 1])
                edges.append(np.concatenate([np.minimum(noisy[:, :2], noisy[:, 2:]), np.maximum(noisy[:, :2], noisy[:, 2:])], axis=1))
                sure.append(low + (high - low) * share)
        if self.places is not None:
            standing, sures = self.places.step()
            edges.append(standing)
            sure += sures.tolist()
        return np.concatenate(edges), np.array(sure)

    def _lost(self, site: int, place: Place, distance: float) -> bool:
        foot = self.foot[site]
        return foot is None or float(np.linalg.norm(foot[:2] - place.pose.translation[:2])) > LOST * (distance + 1.0)

    def _drawn_foot(self, place: Place, distance: float, body: tuple[float, float]) -> Array | None:
        """A place (3,) m on the ground at a distance from the camera whose box lies in the image; None if none is found."""
        eye = place.pose.translation
        feet = np.array([
            [eye[0] + distance * np.cos(azimuth), eye[1] + distance * np.sin(azimuth), place.ground]
            for azimuth in self.rng.uniform(-np.pi, np.pi, TRIES)
        ])  # fmt: skip
        rows, low, high = body_outlines(self.camera, place.pose, feet, body)
        shown = rows[_mostly_inside(low, high, self.camera)]
        return feet[shown[0]] if len(shown) else None

    def _outline(self, place: Place, foot: Array, body: tuple[float, float]) -> Array:
        """The edges (1, 4) px of the part of a box in the image; (0, 4) where less than half of it is there."""
        _, low, high = body_outlines(self.camera, place.pose, foot[None], body)
        return clipped(low, high, self.camera)[_mostly_inside(low, high, self.camera)]


def _mostly_inside(low: Array, high: Array, camera: Camera) -> Mask:
    """Whether more than half of each box with corners low and high (n, 2) px lies in the image."""
    part = clipped(low, high, camera)
    size = np.maximum(part[:, 2:] - part[:, :2], 0.0)
    return np.asarray(np.prod(size, axis=1) > 0.5 * np.prod(high - low, axis=1))


@final
class FixedPlaces:
    """Standing false boxes at places of the image, where a fit found them: some exist from the start, and others appear and disappear."""

    def __init__(self, model: DetectorModel, period: float, rng: np.random.Generator) -> None:
        standing = model.standing
        self.rng, self.rows, self.jitter = rng, np.array(standing.fixed), standing.jitter
        self.kept, self.stays = persistence(standing.time_s, period), persistence(standing.life_s, period)
        self.births = standing.births * period
        self.row = np.flatnonzero(self.rows[:, 7] > 0.5)
        self.state = rng.random(len(self.row))

    def step(self) -> tuple[Array, Array]:
        """Edges (n, 4) px and confidences (n,) of the next frame."""
        rng = self.rng
        stays = rng.random(len(self.row)) < self.stays
        free = np.setdiff1d(np.arange(len(self.rows)), self.row[stays])
        new = rng.choice(free, min(int(rng.poisson(self.births)), len(free)), replace=False)
        state = np.where(rng.random(len(self.row)) < self.kept, self.state, rng.random(len(self.row)))
        self.row = np.concatenate([self.row[stays], new])
        self.state = np.concatenate([state[stays], rng.random(len(self.row) - int(stays.sum()))])
        mine = self.rows[self.row]
        jitter = rng.normal(0.0, self.jitter, (len(mine), 4)) * (mine[:, 3] - mine[:, 1])[:, None]
        noisy, share = mine[:, :4] + jitter, rng.random(len(mine))
        edges = np.concatenate([np.minimum(noisy[:, :2], noisy[:, 2:]), np.maximum(noisy[:, :2], noisy[:, 2:])], axis=1)
        there = self.state < mine[:, 4]
        return edges[there], (mine[:, 5] + (mine[:, 6] - mine[:, 5]) * share)[there]


def miss_rate(model: DetectorModel, features: Array) -> Array:
    """Probability (n,) of a miss, by features (n, 5)."""
    return np.asarray(expit(features @ np.array(model.misses.coefficients)))


def blindness(model: DetectorModel, features: Array) -> Array:
    """Probability (n,) q that the detector is blind to a person, so that with flicker the misses are those of `miss_rate`."""
    flicker = min(model.misses.flicker, 1.0 - 1e-9)
    return np.asarray(np.clip((miss_rate(model, features) - flicker) / (1.0 - flicker), 0.0, 1.0))


def confidence_of(model: DetectorModel, features: Array, score: Array) -> Array:
    """Confidences (n,) by features (n, 5); score (n, 2): standard normal, the part that lasts and the part that drifts."""
    c = model.confidences
    noise = np.sqrt(c.lasting) * score[:, 0] + np.sqrt(1 - c.lasting) * score[:, 1]
    return np.asarray(np.interp(ndtr(features @ np.array(c.coefficients) + c.spread * noise), GRID, c.quantiles))


def expected_edges(model: DetectorModel, bodies: TrueBodies, camera: Camera) -> Array:
    """Edges (n, 4) px of boxes without errors: of the whole body, less what the detector leaves out of its hidden part and beyond the border."""
    (part, seen), e = bodies.parts(camera), model.edges
    return np.asarray(bodies.whole + (1 - e.border) * (part - bodies.whole) + (1 - e.hidden) * (seen - part))


def merge_partner(bodies: TrueBodies, state: Array, probability: tuple[float, ...], found: Mask) -> Ints:
    """The row (n,) of the detected person into whose box each person is merged, −1 for none."""
    other, most = nearest_overlap(bodies)
    if not len(other):
        return other
    bin_ = np.clip(np.searchsorted(OVERLAPS, most, side="right") - 1, 0, len(OVERLAPS) - 1)
    merged = (other >= 0) & (state < np.array(probability)[bin_]) & found[np.maximum(other, 0)]
    # A chain of merges ends at a person who is not merged.
    return np.where(merged & ~merged[np.maximum(other, 0)], other, -1)


def _root(matrix: Array) -> Array:
    """A square root (n, n) of a symmetric matrix; eigenvalues below 0 are taken for 0."""
    value, vector = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))
