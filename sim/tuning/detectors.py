"""Detectors of synthetic cases: error models drawn around the fitted ones, scales of confidences, and errors of calibration and clocks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit

from sim.tuning.walks import STEPS
from tracker.detector_models.bodies import BODY
from tracker.detector_models.model import DetectorModel, named_model
from tracker.geometry import Array, Ints, Pose

SCALES = ("given", "power", "logistic", "logit", "percent", "one", "none")
SCALE_SHARES = (0.34, 0.22, 0.14, 0.08, 0.06, 0.10, 0.06)
"""Probability of each scale."""
MODELS = {
    "fairmot": (0.28, 8.4),
    "faster-rcnn": (0.28, 8.4),
    "keypoint-rcnn": (0.18, 30.0),
    "pets-det": (0.08, 30.0),
    "pixels": (0.18, 20.0),
}
"""Shipped model → probability that a detector is drawn around it, and the diagonal of the place where it was fitted, m."""
MOST_FALSE = (1.5, 8.0)
"""Largest mean numbers of new false boxes per view and frame, and of places with lasting false boxes per view."""
BODY_WIDTH = BODY[1]
"""m: diameter of the cylinder that stands for a body."""
NO_CONFIDENCE = -1.0
"""The confidence of boxes without one, as MOTChallenge has it."""
ONE_NUMBER = 0.95
LOOSE, STRICT = 0.05, 0.3
"""Least confidences, on the model's scale from 0 to 1, of detectors that report weak boxes, too, and of those that do not."""


def inside_bounds(confidence: Array) -> Array:
    """Confidences (n,) of which the log-odds are finite."""
    return np.clip(confidence, 1e-4, 1 - 1e-4)


@dataclass(frozen=True)
class ConfidenceScale:
    """The value that a detector reports for a confidence c in [0, 1]: an increasing function of c, one number, or NO_CONFIDENCE.

    least: boxes with a lower c are not reported. number: exponent, or steepness.
    """

    kind: str
    number: float
    least: float

    @staticmethod
    def drawn(rng: np.random.Generator) -> ConfidenceScale:
        kind = str(rng.choice(SCALES, p=SCALE_SHARES))
        least = float(rng.choice([LOOSE, STRICT, rng.uniform(LOOSE, STRICT)]))
        # Without confidences, only a detector that drops its weak boxes is useful.
        return ConfidenceScale(kind, float(np.exp(rng.uniform(-1.2, 1.2))), STRICT if kind in ("one", "none") else least)

    def kept(self, confidence: Array) -> Ints:
        """Rows of the boxes that are reported."""
        return np.flatnonzero(confidence >= self.least)

    def said(self, confidence: Array) -> Array:
        """Confidences (n,) in the detector's scale."""
        if self.kind == "given":
            return confidence
        inside = inside_bounds(confidence)
        match self.kind:
            case "power":
                return np.asarray(inside**self.number)
            case "logistic":
                return np.asarray(expit(self.number * logit(inside) - 1.0))
            case "logit":
                return np.asarray(logit(inside))
            case "percent":
                return 100 * inside
            case "one":
                return np.full(len(inside), ONE_NUMBER)
        return np.full(len(inside), NO_CONFIDENCE)


@dataclass(frozen=True, eq=False)
class DrawnDetector:
    """The detector of a case: its model, scale of confidences, and bias of feet toward the camera, m."""

    model: DetectorModel
    scale: ConfidenceScale
    feet_bias: float

    @staticmethod
    def fitted(model: DetectorModel) -> DrawnDetector:
        """A model that was fitted to a camera: its errors of edges include the bias of feet."""
        return DrawnDetector(model, ConfidenceScale("given", 1.0, -np.inf), BODY_WIDTH / 2)


def drawn_detector(diagonal: float, rng: np.random.Generator) -> DrawnDetector:
    """A detector around one of the shipped models, for a place of a diagonal, m."""
    base = named_model(str(rng.choice(list(MODELS), p=[share for share, _ in MODELS.values()])))
    model = _at_distances(drawn_model(base, rng), diagonal / MODELS[base.name][1])
    return DrawnDetector(model, ConfidenceScale.drawn(rng), float(rng.uniform(0.0, 0.2)))


def _at_distances(model: DetectorModel, factor: float) -> DetectorModel:
    """The model with false boxes `factor` times as far away, so that they are no farther than the walls of a small place."""

    def moved(samples: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        return tuple((round(row[0] * factor, 3), *row[1:]) for row in samples)

    false, standing = model.false, model.standing
    return replace(model, false=replace(false, samples=moved(false.samples)), standing=replace(standing, samples=moved(standing.samples)))


def drawn_model(base: DetectorModel, rng: np.random.Generator) -> DetectorModel:
    """A model whose rates, errors and confidences differ from those of `base` at random. Feet have no bias of their own."""
    m, e, c = base.misses, base.edges, base.confidences
    constant, hidden, mostly, size, cut = m.coefficients
    misses = replace(
        m,
        coefficients=(constant + rng.normal(0.0, 0.7), *(value * _factor(rng, 0.2) for value in (hidden, mostly, size)), max(cut, -1.0)),
        time_s=m.time_s * _factor(rng, 0.4),
        flicker=float(np.clip(m.flicker + rng.exponential(0.01), 0.0, 0.08)),
    )
    spread = _factor(rng, 0.25)
    quantiles = np.array(e.quantiles)
    quantiles[:, 3] -= quantiles[0, 3, quantiles.shape[2] // 2]
    middle = quantiles[:, :, quantiles.shape[2] // 2 : quantiles.shape[2] // 2 + 1]
    quantiles = middle + (quantiles - middle) * spread
    edges = replace(e, quantiles=_rows(quantiles), near=0.0, trend=(), trend_bounds=(), time_s=tuple(t * _factor(rng, 0.3) for t in e.time_s))
    second, false, standing = base.second, base.false, base.standing
    rate = min(_factor(rng, 0.6), 2.5)
    # In the recordings of the fits, the image border cuts hardly any body.
    known = (*c.coefficients[:-1], max(c.coefficients[-1], -4.0))
    return replace(
        base,
        misses=misses,
        edges=edges,
        confidences=replace(c, quantiles=_stretched(np.array(c.quantiles)), coefficients=known, spread=c.spread * _factor(rng, 0.2)),
        merges=replace(base.merges, probability=tuple(min(1.0, p * _factor(rng, 0.5)) for p in base.merges.probability)),
        second=replace(second, rates=tuple(min(0.5, r * rate) for r in second.rates), coefficients=_shifted(second.coefficients, rate)),
        false=replace(false, rate=min(false.rate * _factor(rng, 0.7), MOST_FALSE[0])),
        standing=replace(standing, sites=min(standing.sites * _factor(rng, 0.6), MOST_FALSE[1])),
        figures={},
        counts={},
    )


def _factor(rng: np.random.Generator, sigma: float) -> float:
    """A log-normal factor of median 1."""
    return float(np.exp(rng.normal(0.0, sigma)))


def _shifted(coefficients: tuple[float, ...], factor: float) -> tuple[float, ...]:
    """Coefficients of a logistic function, shifted so that small probabilities are multiplied by `factor`."""
    return (coefficients[0] + float(np.log(factor)), *coefficients[1:]) if coefficients else ()


def _stretched(quantiles: Array) -> tuple[float, ...]:
    """Quantiles of confidences, stretched so that the lowest is at most LOOSE, as of a detector with a low threshold."""
    low, high = float(quantiles[0]), float(quantiles[-1])
    share = (high - quantiles) / max(high - low, 1e-9)
    return tuple(np.round(quantiles - (low - min(low, LOOSE)) * share, 5).tolist())


def _rows(values: Array) -> tuple[tuple[tuple[float, ...], ...], ...]:
    return tuple(tuple(tuple(row) for row in table) for table in np.round(values, 5).tolist())


@dataclass(frozen=True, eq=False)
class CameraErrors:
    """Errors of the calibration that the tracker gets: of the pose (right tangent), and steps by which the clock is late."""

    pose: Pose
    late: int

    @staticmethod
    def drawn(scale: float, rng: np.random.Generator) -> CameraErrors:
        """scale: of all errors of a case, 0 for none."""
        turn, shift = rng.normal(0.0, np.radians(0.35) * scale, 3), rng.normal(0.0, 0.02 * scale, 3)
        late = int(rng.integers(-STEPS // 2, STEPS // 2 + 1)) if rng.random() < 0.3 * scale else 0
        return CameraErrors(Pose.exp(np.concatenate([shift, turn])), late)
