"""Bundle adjustment of cameras by people: joint estimation of camera parameters, clock offsets, statures, and smooth paths on the ground.

The method is Levenberg and Marquardt's on the reduced camera system (Triggs et al. 2000, section 6): sparse factorization eliminates paths and
statures. Boxes have the weights of Cauchy's distribution, which is robust to outliers. Covariances are clustered (Liang and Zeger 1986), because
errors of the boxes of a person in a camera are correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from tracker.calibration.body import CX, CY, EDGES, GLOBALS, HEIGHT, K1, MEAN_STATURE, NAMES, OF_BOXES, OFFSET, X, Y, boxes_of, ground_places
from tracker.calibration.marginal import PeoplesPaths, local_covariances
from tracker.calibration.people import Observations
from tracker.calibration.single_view import SPREAD, STATURE
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.cameras import Camera

KNOT, ACCELERATION = 0.5, 0.8
"""s between two knots of a path, and standard deviation of its acceleration, m/s²."""
RELATIVE = STATURE / SPREAD
"""1 over the relative standard deviation of statures."""
CAUCHY = 3.5
"""Scale of Cauchy's weight, in standard deviations of the three residuals of a box. Without outliers the mean weight is 0.8."""
GLOBAL_PRIOR = np.array([[0.15, 0.08], [0.2, 0.06], [STATURE, 0.06], [0.0, 0.01], [0.03, 0.03], [-0.01, 0.015]])
"""Mean and standard deviation of body.GLOBALS: between simulated cylinders of 0.5 m and people with feet and a head.

Boxes of detectors end below the top of a body and above its feet (the fitted models in detector_models).
"""
STEPS = np.array([1e-4, 1e-5, 1e-5, 1e-4, 1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-5, 1e-3])
"""Steps of the parameters of a camera for numerical derivatives."""
ROUNDS, ENOUGH = 20, 1e-4
"""Most iterations, and the relative decrease of the cost below which they stop."""
OUTLIER = 30.0
"""Largest residual, and that of a predicted box without a pixel."""
MOST_RATIO, LEAST_INLIERS = 0.16, 0.4
"""Of people: largest logarithm of their stature over the mean (three standard deviations), and least share of inliers among their boxes."""
LEAST_PEOPLE = 3
"""Up to this number of people, the clustered covariance has the factor of this number (Problem.information)."""
INLIER = 0.45
"""Weight above which a box is an inlier."""
BIAS = 0.005
"""Standard deviation of errors common to all boxes of a camera: of an edge, and of its change per doubling of the height. A share of the height."""
INTEGRATED, STEADY, PART = 7, 1e-4, 0.6
"""Steps with paths integrated out, their damping, and the part of each that is taken, because smoothness and steps would oscillate."""
CELL = 5.0
"""m: side of a ground cell, within which errors of boxes count as correlated."""
FARTHEST_STEP = np.where(np.isin(np.arange(len(NAMES)), [X, Y]), 5.0, 0.3)
"""Largest step of camera parameters with paths integrated out. Iterations end at a longer one, for which the linearization fails."""
WORSE = 1.5
"""Factor by which the cost may rise in a step with paths integrated out. Iterations end at a larger rise."""
DAMPING, LEAST = 1e-3, 1e-6
"""Damping of the first step; and a ridge that keeps the matrix regular for people whose boxes all have no pixel."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Mean and standard deviation (cameras, 11) of camera parameters: 0 for known ones, inf without a prior. body: the same of GLOBALS (6, 2).

    distances: first camera, second camera, m, error m. lens (cameras, 3): standard deviations of cx, cy and k1 that are not estimated.
    """

    mean: Array
    sigma: Array
    body: Array = field(default_factory=lambda: GLOBAL_PRIOR.copy())
    distances: tuple[tuple[int, int, float, float], ...] = ()
    lens: Array = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class Adjusted:
    """rows (cameras, 11) and their covariance (cameras · 11, the same); body (6,) as body.GLOBALS.

    weight (n,) of the observations. edges (cameras, 3): errors of the middles, upper and lower edges of boxes, as shares of their heights.
    paths: person → times (k,) s and places (k, 2) m. stature (people,) m.
    """

    rows: Array
    covariance: Array
    body: Array
    weight: Array
    edges: Array
    paths: dict[int, tuple[Array, Array]]
    stature: Array

    @property
    def misfit(self) -> float:
        """Largest deviation of a parameter that boxes depend on from its prior, in standard deviations."""
        return float(np.abs((self.body - GLOBAL_PRIOR[:, 0]) / GLOBAL_PRIOR[:, 1])[list(OF_BOXES)].max())

    def figures(self) -> dict[str, float]:
        """Numbers of boxes and people, share of inliers, mean stature m, and body.GLOBALS."""
        inliers = float((self.weight > INLIER).mean())
        found = {"boxes": float(len(self.weight)), "people": float(len(self.stature)), "inliers": inliers, "stature": float(self.stature.mean())}
        return found | {name if name != "stature" else "mean_stature": float(value) for name, value in zip(GLOBALS, self.body, strict=True)}


State = tuple[Array, Array, Array, Array]
"""Parameters of cameras (cameras, 11) and bodies (6,), statures (people,) m and knots (knots, 2) m."""


class Problem:
    """The unknowns: free parameters of cameras and bodies first, then statures of all people, then x and y of all knots."""

    def __init__(self, cameras: Sequence[Camera], seen: Observations, rows: Array, prior: Prior) -> None:
        self.cameras, self.seen, self.prior = cameras, seen, prior
        self.sigma = seen.sigma.copy()
        self.free = np.flatnonzero(prior.sigma.ravel() > 0)
        self.people = int(seen.person.max()) + 1
        self.of_view = [np.flatnonzero(seen.view == k) for k in range(len(cameras))]
        clock = seen.time + rows[seen.view, OFFSET]
        low, high = np.full(self.people, np.inf), np.full(self.people, -np.inf)
        np.minimum.at(low, seen.person, clock)
        np.maximum.at(high, seen.person, clock)
        self.start = low - KNOT
        self.count = np.ceil((high - low) / KNOT).astype(np.int64) + 3
        self.first = np.cumsum([0, *self.count[:-1].tolist()])
        self.knots = int(self.count.sum())
        self.body, self.rows, self._first_rows = prior.body[:, 0].copy(), rows.copy(), rows.copy()
        self.stature = np.full(self.people, self.body[MEAN_STATURE])
        self.place = self._initial_places()
        self.smoothing = 1.0

    def _initial_places(self) -> Array:
        """Knots (knots, 2) of paths through the feet of all cameras."""
        s = self.seen
        foot = np.zeros((len(s.view), 2))
        for k, rows in enumerate(self.of_view):
            foot[rows] = ground_places(self.cameras[k], self.rows[k], s.box[rows], float(self.body[0]))
        known = np.isfinite(foot[:, 0])
        at, share = self._at(self.rows)
        n = int(known.sum())
        at, share, i = at[known], share[known], np.arange(n)
        B = sparse.coo_matrix((np.concatenate([1 - share, share]), (np.tile(i, 2), np.concatenate([at, at + 1]))), (n, self.knots))
        away = np.zeros(len(s.view))
        for k, rows in enumerate(self.of_view):
            away[rows] = np.hypot(*(foot[rows] - self.rows[k, 7:9]).T)
        w = 1 / (0.2 + 0.1 * away[known]) ** 2
        D = self._smoothness()
        A = (B.T @ sparse.diags(w) @ B + D.T @ D + 1e-6 * sparse.eye(self.knots)).tocsc()
        return np.asarray(splu(A).solve(np.asarray(B.T @ (w[:, None] * foot[known]))))

    def _at(self, rows: Array) -> tuple[Ints, Array]:
        """Knot (n,) before each observation, and the share (n,) of the interval to the next knot."""
        s = self.seen
        where = (s.time + rows[s.view, OFFSET] - self.start[s.person]) / KNOT
        at = np.clip(np.floor(where).astype(np.int64), 0, self.count[s.person] - 2)
        return self.first[s.person] + at, where - at

    def _smoothness(self) -> sparse.csr_matrix:
        """Second differences of knots over their standard deviation."""
        middle = np.concatenate([self.first[k] + np.arange(1, self.count[k] - 1) for k in range(self.people)])
        n, scale = len(middle), 1 / (ACCELERATION * KNOT**2)
        i = np.arange(n)
        data = np.repeat([scale, -2 * scale, scale], n)
        return sparse.csr_matrix((data, (np.tile(i, 3), np.concatenate([middle - 1, middle, middle + 1]))), (n, self.knots))

    def _places(self, rows: Array, place: Array) -> Array:
        """Places (n, 2) m of the person of each observation."""
        at, share = self._at(rows)
        return np.asarray((1 - share)[:, None] * place[at] + share[:, None] * place[at + 1])

    def predicted(self, state: State, moved: tuple[str, int] = ("", 0), step: float = 0.0) -> Array:
        """Predicted boxes (n, 3) px. moved: kind and index of a quantity to which `step` is added: camera, body, place or stature."""
        rows, body, stature, place = state
        s = self.seen
        xy, tall = self._places(rows, place), stature[s.person]
        kind, index = moved
        if kind == "place":
            xy[:, index] += step
        elif kind == "stature":
            tall = tall + step
        elif kind == "body":
            body = body.copy()
            body[index] += step
        out = np.empty((len(s.view), 3))
        for k, own in enumerate(self.of_view):
            row = rows[k].copy()
            if kind == "camera":
                row[index] += step
            box = boxes_of(self.cameras[k], row, xy[own], tall[own], body)
            out[own] = box + (box[:, 2] - box[:, 1])[:, None] * body[EDGES]
            if self.cameras[k].wraps:
                apart = out[own, 0] - s.box[own, 0]
                out[own, 0] -= self.cameras[k].width * np.round(apart / self.cameras[k].width)
        return out

    def residuals(self, state: State) -> Array:
        """Residuals (n, 3) of boxes, in standard deviations."""
        r = (self.predicted(state) - self.seen.box) / self.sigma
        return np.where(np.isfinite(r), np.clip(r, -OUTLIER, OUTLIER), OUTLIER)

    def prior_residuals(self, state: State) -> tuple[Array, Array, Array]:
        """Prior residuals of cameras, bodies and distances (free + bodies + distances,), statures (people,) and paths (m, 2)."""
        rows, body, stature, place = state
        mean, sigma = self.prior.mean.ravel()[self.free], self.prior.sigma.ravel()[self.free]
        camera = np.where(np.isfinite(sigma), (rows.ravel()[self.free] - mean) / np.where(np.isfinite(sigma), sigma, 1.0), 0.0)
        bodies = (body - self.prior.body[:, 0]) / self.prior.body[:, 1]
        apart = [(self._distance(rows, a, b) - far) / error for a, b, far, error in self.prior.distances]
        return np.concatenate([camera, bodies, apart]), (stature / body[MEAN_STATURE] - 1) * RELATIVE, self._smooth @ place * self._unit(rows)

    def _unit(self, rows: Array) -> float:
        """Factor of the smoothness of paths. It is relative to the mean height of cameras, so that smoothness does not favour a small scale.

        While paths are integrated out, `smoothing` is estimated from people's accelerations.
        """
        return self.smoothing * float(np.exp((self._first_rows - rows)[:, HEIGHT].mean()))

    @staticmethod
    def _distance(rows: Array, a: int, b: int) -> float:
        return float(np.linalg.norm(np.append((rows[a] - rows[b])[7:9], np.exp(rows[a, HEIGHT]) - np.exp(rows[b, HEIGHT]))))

    def cost(self, state: State) -> float:
        """Sum of squares of prior residuals, plus twice Cauchy's loss of each box."""
        r = self.residuals(state)
        squares = CAUCHY**2 * np.log1p((r * r).sum(axis=1) / CAUCHY**2)
        return float(squares.sum()) + float(sum((p * p).sum() for p in self.prior_residuals(state)))

    def solve(self, rounds: int = ROUNDS, held: Mask | None = None) -> None:
        """Minimize the cost from the present state. held (free,): parameters of cameras that are fixed.

        Biases of edges are fixed, too, because they would grow while paths absorb noise.
        """
        moving = np.append(np.ones(len(self.free), dtype=bool) if held is None else ~held, np.arange(len(GLOBALS)) < EDGES.start)
        self._smooth = self._smoothness()
        state, damping = (self.rows, self.body, self.stature, self.place), DAMPING
        cost = self.cost(state)
        for _ in range(rounds):
            system = self._system(state)
            while damping < 1e6:
                trial = self._moved(state, self._step(system, damping, moving))
                now = self.cost(trial)
                if now < cost:
                    break
                damping *= 5
            else:
                break
            fall, state, cost, damping = (cost - now) / cost, trial, now, max(damping / 5, 1e-7)
            if fall < ENOUGH:
                break
        self.rows, self.body, self.stature, self.place = state

    def rescale(self, lever: Array | float = 0.0) -> None:
        """Set standard deviations of edges from residuals. lever (n, 3): share of the variance that paths and statures absorb (leverage)."""
        r = self.residuals((self.rows, self.body, self.stature, self.place)) / np.sqrt(np.clip(1 - np.asarray(lever), 0.1, 1.0))
        for own in self.of_view:
            if len(own) > 20:
                self.sigma[own] *= np.clip(1.48 * np.median(np.abs(r[own]), axis=0), 0.3, 3.0)

    def _moved(self, state: State, step: tuple[Array, Array]) -> State:
        rows, body, stature, place = state
        camera, rest = step
        new = rows.ravel().copy()
        new[self.free] += camera[: len(self.free)]
        return new.reshape(rows.shape), body + camera[len(self.free) :], stature + rest[: self.people], place + rest[self.people :].reshape(2, -1).T

    def _system(self, state: State, bend: float = 1.0) -> dict[str, Array]:
        """Normal equations: blocks of cameras and bodies, of people, and between them. bend: factor of the second derivative of the boxes' loss."""
        s, base = self.seen, self.predicted(state)
        r = self.residuals(state)
        ok = np.isfinite(base) & (np.abs(r) < OUTLIER)
        weight = 1 / (1 + (r * r).sum(axis=1) / CAUCHY**2)
        root = np.sqrt(weight)

        def derivative(kind: str, index: int, step: float) -> Array:
            d = (self.predicted(state, (kind, index), step) - base) / step / self.sigma * (root * np.sqrt(bend))[:, None]
            return np.where(ok & np.isfinite(d), d, 0.0)

        n, free = len(s.view), len(self.free)
        dx, dy = (derivative("place", axis, 1e-4) for axis in (0, 1))
        at, share = self._at(state[0])
        speed = (state[3][at + 1] - state[3][at]) / KNOT
        J = np.zeros((3 * n, free + len(GLOBALS)))
        for p in sorted({int(one) % len(NAMES) for one in self.free}):
            d = dx * speed[:, :1] + dy * speed[:, 1:] if p == OFFSET else derivative("camera", p, float(STEPS[p]))
            for column in np.flatnonzero(self.free % len(NAMES) == p).tolist():
                own = self.of_view[int(self.free[column]) // len(NAMES)]
                J.reshape(n, 3, -1)[own, :, column] = d[own]
        for g in OF_BOXES:
            J[:, free + g] = derivative("body", g, 1e-4).ravel()
        i = np.arange(3 * n)
        knot, part = np.repeat(at, 3), np.repeat(share, 3)
        before, after = (1 - part, part)
        data = [derivative("stature", 0, 1e-4).ravel(), before * dx.ravel(), after * dx.ravel(), before * dy.ravel(), after * dy.ravel()]
        x, y = self.people + knot, self.people + self.knots + knot
        columns = np.concatenate([np.repeat(s.person, 3), x, x + 1, y, y + 1])
        K = sparse.csr_matrix((np.concatenate(data), (np.tile(i, 5), columns)), (3 * n, self.people + 2 * self.knots))
        wr = (r * (root / np.sqrt(bend))[:, None] * ok).ravel()
        return self._with_priors(state, {"J": J, "K": K, "r": wr})

    def _with_priors(self, state: State, system: dict[str, Array]) -> dict[str, Array]:
        J, K, wr = system["J"], system["K"], system["r"]
        camera, stature, smooth = self.prior_residuals(state)
        free = len(self.free)
        sigma = self.prior.sigma.ravel()[self.free]
        bodies = len(GLOBALS)
        P = np.zeros((len(camera), free + bodies))
        P[np.arange(free), np.arange(free)] = np.where(np.isfinite(sigma), 1 / sigma, 0.0)
        P[free + np.arange(bodies), free + np.arange(bodies)] = 1 / self.prior.body[:, 1]
        for k, (a, b, _, error) in enumerate(self.prior.distances):
            base = self._distance(state[0], a, b)
            for column, flat in enumerate(self.free.tolist()):
                moved = state[0].copy().ravel()
                moved[flat] += 1e-5
                P[free + bodies + k, column] = (self._distance(moved.reshape(state[0].shape), a, b) - base) / 1e-5 / error
        mean, scale = state[1][MEAN_STATURE], self._unit(state[0])
        D = sparse.block_diag([sparse.eye(self.people) * (RELATIVE / mean), self._smooth * scale, self._smooth * scale]).tocsr()
        C = (K.T @ K + D.T @ D + LEAST * sparse.eye(K.shape[1])).tocsc()
        g = np.concatenate([stature, smooth[:, 0], smooth[:, 1]])
        E = np.zeros((len(g), free + bodies))
        E[: self.people, free + MEAN_STATURE] = -state[2] * (RELATIVE / mean**2)
        E[self.people :, np.flatnonzero(self.free % len(NAMES) == HEIGHT)] = -g[self.people :, None] / len(self.cameras)
        cross, A, right = K.T @ J + D.T @ E, J.T @ J + P.T @ P + E.T @ E, J.T @ wr + P.T @ camera + E.T @ g
        system |= {"A": A, "B": cross, "C": C, "a": right, "c": K.T @ wr + D.T @ g}
        return system

    def _with_marginal(self, state: State, system: dict[str, Array]) -> dict[str, Array]:
        """The system plus the gradient of half the logarithm of the determinant of C over that of the prior.

        decided: degrees of freedom of paths that the data determine. lever (n, 3): share of each edge's variance that paths and statures absorb.
        """
        s, rows = self.seen, state[0]
        at, share = self._at(rows)
        paths = PeoplesPaths(s.person, at, share, self.first, self.count)
        spread, decided = local_covariances(paths, system["C"], self._smooth * self._unit(rows))
        weight = 1 / (1 + (self.residuals(state) ** 2).sum(axis=1) / CAUCHY**2)
        base = self._local(state)
        T = base @ spread * (weight[:, None] / self.sigma**2)[:, :, None]

        def each(moved: State, step: float) -> Array:
            d = (self._local(moved) - base) / step * T
            return np.where(np.isfinite(d), d, 0.0).sum(axis=(1, 2))

        right, rest = system["a"].copy(), system["c"].copy()
        for p in sorted({int(one) % len(NAMES) for one in self.free} - {OFFSET}):
            moved = rows.copy()
            moved[:, p] += 10 * STEPS[p]
            of_view = np.bincount(s.view, each((moved, *state[1:]), 10 * STEPS[p]), minlength=len(rows))
            own = np.flatnonzero(self.free % len(NAMES) == p)
            right[own] += of_view[self.free[own] // len(NAMES)]
        right[np.flatnonzero(self.free % len(NAMES) == HEIGHT)] += decided / len(rows)
        for g in OF_BOXES:
            right[len(self.free) + g] += each((rows, state[1] + 1e-3 * (np.arange(len(GLOBALS)) == g), *state[2:]), 1e-3).sum()
        rest[: self.people] += np.bincount(s.person, each((*state[:2], state[2] + 1e-3, state[3]), 1e-3), minlength=self.people)
        for axis in (0, 1):
            gain = each((*state[:3], state[3] + 1e-3 * (np.arange(2) == axis)), 1e-3)
            first = self.people + axis * self.knots
            rest[first : first + self.knots] += np.bincount(at, (1 - share) * gain, self.knots) + np.bincount(at + 1, share * gain, self.knots)
        lever = np.einsum("nij,njk,nik->ni", base, spread, base) * weight[:, None] / self.sigma**2
        return system | {"a": right, "c": rest, "decided": np.array(decided), "lever": np.nan_to_num(lever)}

    def _local(self, state: State) -> Array:
        """Derivatives (n, 3, 3) of boxes by stature, x and y."""
        base = self.predicted(state)
        moved = [self.predicted(state, (kind, axis), 1e-4) for kind, axis in (("stature", 0), ("place", 0), ("place", 1))]
        out = (np.stack(moved, axis=2) - base[:, :, None]) / 1e-4
        return np.where(np.isfinite(out), out, 0.0)

    def integrate(self, rounds: int = INTEGRATED, held: Mask | None = None) -> None:
        """Maximize the marginal density of cameras and bodies from the result of `solve`. Errors of boxes and accelerations are estimated, too."""
        moving = np.append(np.ones(len(self.free), dtype=bool) if held is None else ~held, np.ones(len(GLOBALS), dtype=bool))
        state = self.rows, self.body, self.stature, self.place
        for _ in range(rounds):
            system = self._with_marginal(state, self._system(state))
            rough = self._smooth @ state[3] * self._unit(state[0])
            self.smoothing *= float(np.sqrt(max(float(system["decided"]), 1.0) / max(float((rough**2).sum()), 1e-9)) ** PART)
            self.rescale(system["lever"])
            camera, people = self._step(system, STEADY, moving)
            moved = self._moved(state, (PART * camera, PART * people))
            if not (np.abs(moved[0] - state[0]) < FARTHEST_STEP).all() or not self.cost(moved) < WORSE * self.cost(state):
                break
            state = moved
            self.rows, self.body, self.stature, self.place = state

    @staticmethod
    def _step(system: dict[str, Array], damping: float, moving: Mask) -> tuple[Array, Array]:
        """Steps of cameras and bodies, 0 where not `moving`, and of people."""
        A, C = system["A"], system["C"]
        factor = _factor((C + damping * sparse.diags(C.diagonal())).tocsc())
        X = factor.solve(np.column_stack([system["B"], system["c"]]))
        S = A + damping * np.diag(np.diag(A)) - system["B"].T @ X[:, :-1]
        right = system["a"] - system["B"].T @ X[:, -1]
        camera = np.zeros(len(right))
        camera[moving] = -np.linalg.solve(S[np.ix_(moving, moving)] + 1e-12 * np.eye(int(moving.sum())) * np.trace(S), right[moving])
        return camera, -(X[:, -1] + X[:, :-1] @ camera)

    def information(self) -> tuple[Array, Array, Array]:
        """Information (p, p) of the free parameters and bodies with people eliminated, and covariance (p, p) of the gradient.

        The third (p, errors) is the change of the gradient by an error of one standard deviation in each lens parameter that is not estimated.
        The covariance includes errors common to boxes of a person in a camera, and to boxes at one place, for instance on a slope.
        It also includes errors common to all boxes of a camera.
        """
        state = self.rows, self.body, self.stature, self.place
        weight = self.weights()
        square = CAUCHY**2 * (1 / weight - 1)
        # The derivative of Cauchy's score is less than its weight (Huber 1981, section 6.5), in the mean over the three edges by this factor.
        bend = max(1 - 2 / 3 * float((weight**2 * square).sum() / weight.sum()) / CAUCHY**2, 0.2)
        system = self._system(state, bend)
        X = _factor(system["C"]).solve(system["B"])
        H, reduced = system["A"] - system["B"].T @ X, system["J"] - system["K"] @ X
        s = self.seen
        each = (reduced * system["r"][:, None]).reshape(len(s.view), 3, -1).sum(axis=1)
        cell = np.floor(self._places(self.rows, self.place) / CELL).astype(np.int64)

        def clusters(*of: Array | Ints) -> Array:
            chunk = np.unique(np.column_stack([s.view, *of]), axis=0, return_inverse=True)[1].ravel()
            score = np.zeros((int(chunk.max()) + 1, each.shape[1]))
            np.add.at(score, chunk, each)
            return np.asarray(score.T @ score)

        # Two-way clustering (Cameron, Gelbach and Miller 2011): the clusters of a place, less those of one person at that place.
        values, vectors = np.linalg.eigh(clusters(cell) - clusters(cell, s.person))
        placed = np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
        common, lens = (reduced.T @ errors / np.sqrt(bend) for errors in (self._common_errors(state), self._lens_errors(state)))
        # With few people, the variance between people is uncertain: the factor is the variance of Student's t with as many degrees of freedom.
        few = self.people / (self.people - 2) if self.people > LEAST_PEOPLE else LEAST_PEOPLE
        return H, few * clusters(s.person) + placed + (H - reduced.T @ reduced) + common @ common.T + lens @ lens.T, lens

    def covariance(self, held: Mask | None = None) -> Array:
        """Covariance (cameras · 11, same) of the parameters; 0 for fixed ones and those `held` (free,)."""
        moving = np.ones(len(self.free), dtype=bool) if held is None else ~held
        own = np.flatnonzero(np.append(moving, np.ones(len(GLOBALS), dtype=bool)))
        information, meat, lens = self.information()
        inverse = np.linalg.pinv(information[np.ix_(own, own)], hermitian=True)
        found, at = inverse @ meat[np.ix_(own, own)] @ inverse, self.free[moving]
        out = np.zeros((self.rows.size, self.rows.size))
        out[np.ix_(at, at)] = found[: len(at), : len(at)]
        wrong, sigma = self._lens_parameters()
        # An error of a lens parameter shifts the estimates.
        out[np.ix_(at, wrong)] = -(inverse @ lens[own])[: len(at)] * sigma
        out[np.ix_(wrong, at)] = out[np.ix_(at, wrong)].T
        out[wrong, wrong] = sigma**2
        return out

    def _lens_parameters(self) -> tuple[Ints, Array]:
        """Indices of lens parameters with errors that are not estimated, in the flat parameters of all cameras, and their standard deviations."""
        camera, kind = np.nonzero(self.prior.lens)
        return camera * len(NAMES) + np.array([CX, CY, K1])[kind], self.prior.lens[camera, kind]

    def _lens_errors(self, state: State) -> Array:
        """Changes (3 n, errors) of residuals by errors of lenses that are not estimated, of one standard deviation each."""
        base, flat = self.predicted(state), list(zip(*(part.tolist() for part in self._lens_parameters()), strict=True))
        root = 1 / np.sqrt(1 + (self.residuals(state) ** 2).sum(axis=1) / CAUCHY**2)
        out = np.zeros((len(base), 3, len(flat)))
        for p in {one % len(NAMES) for one, _ in flat}:
            d = (self.predicted(state, ("camera", p), float(STEPS[p])) - base) / STEPS[p] / self.sigma * root[:, None]
            for column, (one, sigma) in enumerate(flat):
                if one % len(NAMES) == p:
                    own = self.of_view[one // len(NAMES)]
                    out[own, :, column] = np.where(np.isfinite(d[own]), d[own], 0.0) * sigma
        return out.reshape(3 * len(base), len(flat))

    def _common_errors(self, state: State) -> Array:
        """Residuals (3 n, errors) due to edge errors common to a camera's boxes, of one standard deviation each: constant, and with log size."""
        r = self.residuals(state)
        root = 1 / np.sqrt(1 + (r * r).sum(axis=1) / CAUCHY**2)
        high = self.seen.box[:, 2] - self.seen.box[:, 1]
        out = []
        for own in filter(len, self.of_view):
            size = np.log2(high[own])
            for edge in (1, 2):
                for form in (np.full(len(own), BIAS), BIAS * (size - size.mean())):
                    error = np.zeros((len(high), 3))
                    error[own, edge] = form * high[own] / self.sigma[own, edge] * root[own]
                    out.append(error.ravel())
        return np.array(out).T

    def result(self, covariance: Array | None = None) -> Adjusted:
        """The present state. covariance (cameras · 11, same): NaN where none is given."""
        unknown = np.full((self.rows.size, self.rows.size), np.nan)
        ends = zip(self.start, self.first.tolist(), self.count.tolist(), strict=True)
        paths = {k: (start + KNOT * np.arange(count), self.place[first : first + count]) for k, (start, first, count) in enumerate(ends)}
        share = self.sigma / (self.seen.box[:, 2] - self.seen.box[:, 1])[:, None]
        edges = np.array([np.median(share[own], axis=0) if len(own) else np.zeros(3) for own in self.of_view])
        return Adjusted(self.rows, unknown if covariance is None else covariance, self.body, self.weights(), edges, paths, self.stature)

    def weights(self) -> Array:
        """Cauchy's weight (n,) of each box."""
        square = (self.residuals((self.rows, self.body, self.stature, self.place)) ** 2).sum(axis=1)
        return np.asarray(1 / (1 + square / CAUCHY**2))


def _factor(matrix: sparse.csc_matrix) -> SuperLU:
    """Factors of a positive definite matrix."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def adjust(cameras: Sequence[Camera], seen: Observations, rows: Array, prior: Prior, rounds: int = ROUNDS, integrated: bool = True) -> Adjusted:
    """Maximize the posterior density from `rows` (cameras, 11). integrated: with paths and statures integrated out.

    Half of the steps are made first. People with an implausible stature or mostly outliers are then left out; they are often false boxes.
    Standard deviations of boxes are set from the residuals before the other steps.
    """
    first = Problem(cameras, seen, rows, prior)
    first.solve(max(rounds // 2, 4))
    ratio, count = first.stature / first.body[MEAN_STATURE], np.bincount(seen.person, minlength=first.people)
    inliers = np.bincount(seen.person, first.weights() > INLIER, minlength=first.people) / np.maximum(count, 1)
    kept = (np.abs(np.log(ratio)) < MOST_RATIO) & (inliers > LEAST_INLIERS)
    if not kept[seen.person].any():
        kept[:] = True
    problem = Problem(cameras, seen.of_people(kept), first.rows, prior)
    problem.body = first.body
    problem.stature[:] = first.stature[kept]
    problem.solve(5)
    problem.rescale()
    problem.solve(rounds)
    if not integrated:
        return problem.result()
    problem.integrate()
    return problem.result(problem.covariance())
