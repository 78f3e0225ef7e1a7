"""Bundle adjustment of cameras by people: parameters of cameras, clock offsets, statures, and smooth paths on the ground, all at once.

Levenberg and Marquardt's method on the reduced camera system (Triggs et al. 2000, section 6): paths and statures are eliminated by sparse
factors. Outliers are weighted as Cauchy's distribution has it. Covariances are those of clusters (Liang and Zeger 1986): errors of boxes that
follow each other in a tracklet are not independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from tracker.calibration.body import HEIGHT, NAMES, OFFSET, boxes_of, ground_places
from tracker.calibration.people import Observations
from tracker.calibration.single_view import SPREAD, STATURE
from tracker.geometry import Array, Ints, Mask
from tracker.geometry.cameras import Camera

KNOT, ACCELERATION = 0.5, 0.8
"""s between two knots of a path, and standard deviation of its acceleration, m/s²."""
RELATIVE = STATURE / SPREAD
"""1 over the relative deviation of statures."""
CAUCHY = 2.0
"""Scale of Cauchy's weight, in standard deviations of a box."""
GLOBAL_PRIOR = np.array([[0.15, 0.08], [0.2, 0.06], [STATURE, 0.03]])
"""Mean and deviation of body.GLOBALS: bodies are between cylinders of 0.5 m, as simulated ones, and people with feet and a head."""
STEPS = np.array([1e-4, 1e-5, 1e-5, 1e-4, 1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-5, 1e-3])
"""Of the parameters of a camera, for derivatives."""
ROUNDS, ENOUGH = 20, 1e-4
"""Most steps, and the relative fall of the cost at which they end."""
OUTLIER = 30.0
"""Residual where a box has no pixel."""
MOST_RATIO, LEAST_INLIERS = 0.16, 0.4
"""Of people: greatest logarithm of their stature over the mean, three deviations, and least share of boxes that are no outliers."""
INLIER = 0.3
"""Weight of a box that is no outlier."""
CLUSTER = 3.0
"""s of a tracklet whose errors are taken together."""
BIAS = 0.015
"""Deviation of errors that all boxes of a camera have: of an edge, and of its change by the doubling of the height. A share of the height."""
DAMPING, LEAST = 1e-3, 1e-6
"""Of the first step; and what keeps people whose boxes all have no pixel from making a matrix singular."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Of camera parameters (cameras, 11): mean, and standard deviation; 0 for known ones, inf where nothing is known.

    distances: first camera, second camera, m, error m.
    """

    mean: Array
    sigma: Array
    body: Array = field(default_factory=lambda: GLOBAL_PRIOR.copy())
    distances: tuple[tuple[int, int, float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Adjusted:
    """rows (cameras, 11) and their covariance (cameras · 11, the same); body (3,); sigma factors (cameras, 3) of middles, tops and bottoms.

    cost: a box, in weighted squares. weight (n,) of the observations. path: person → times (k,) s and places (k, 2) m. stature (people,) m.
    """

    rows: Array
    covariance: Array
    body: Array
    factors: Array
    cost: float
    weight: Array
    paths: dict[int, tuple[Array, Array]]
    stature: Array

    def with_sigma(self, covariance: Array) -> Adjusted:
        """The same with another covariance."""
        return replace(self, covariance=covariance)

    def figures(self) -> dict[str, float]:
        """Numbers of boxes and people, share of boxes that are no outliers, mean stature m, and the distances of body.GLOBALS, m."""
        inliers = float((self.weight > INLIER).mean())
        found = {"boxes": float(len(self.weight)), "people": float(len(self.stature)), "inliers": inliers, "stature": float(self.stature.mean())}
        return found | {"foot": float(self.body[0]), "head": float(self.body[1]), "mean_stature": float(self.body[2])}


State = tuple[Array, Array, Array, Array]
"""Parameters of cameras (cameras, 11) and bodies (3,), statures (people,) m and knots (knots, 2) m."""


class Problem:
    """The unknowns: free parameters of cameras and bodies first, then of each person the stature and the knots."""

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
        self.stature = np.full(self.people, self.body[2])
        self.place = self._initial_places()

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
        """Knot (n,) before each observation, and how far it is from there to the next, as a share."""
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

    def predicted(self, state: State, moved: tuple[str, int] = ("", 0), step: float = 0.0) -> Array:
        """Boxes (n, 3) px. moved: a quantity that is changed by `step`: a parameter of all cameras, the body, places or statures."""
        rows, body, stature, place = state
        s = self.seen
        at, share = self._at(rows)
        xy = (1 - share)[:, None] * place[at] + share[:, None] * place[at + 1]
        tall = stature[s.person]
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
            out[own] = boxes_of(self.cameras[k], row, xy[own], tall[own], body)
            if self.cameras[k].wraps:
                apart = out[own, 0] - s.box[own, 0]
                out[own, 0] -= self.cameras[k].width * np.round(apart / self.cameras[k].width)
        return out

    def residuals(self, state: State) -> Array:
        """Of boxes (n, 3), in standard deviations."""
        r = (self.predicted(state) - self.seen.box) / self.sigma
        return np.where(np.isfinite(r), np.clip(r, -OUTLIER, OUTLIER), OUTLIER)

    def prior_residuals(self, state: State) -> tuple[Array, Array, Array]:
        """Of cameras and bodies (free + 3 + distances,), statures (people,) and paths (m, 2)."""
        rows, body, stature, place = state
        mean, sigma = self.prior.mean.ravel()[self.free], self.prior.sigma.ravel()[self.free]
        camera = np.where(np.isfinite(sigma), (rows.ravel()[self.free] - mean) / np.where(np.isfinite(sigma), sigma, 1.0), 0.0)
        bodies = (body - self.prior.body[:, 0]) / self.prior.body[:, 1]
        apart = [(self._distance(rows, a, b) - far) / error for a, b, far, error in self.prior.distances]
        return np.concatenate([camera, bodies, apart]), (stature / body[2] - 1) * RELATIVE, self._smooth @ place * self._unit(rows)

    def _unit(self, rows: Array) -> float:
        """By how much smaller the world was at first, by the heights of cameras: smooth paths are to draw no scale."""
        return float(np.exp((self._first_rows - rows)[:, HEIGHT].mean()))

    @staticmethod
    def _distance(rows: Array, a: int, b: int) -> float:
        return float(np.linalg.norm(np.append((rows[a] - rows[b])[7:9], np.exp(rows[a, HEIGHT]) - np.exp(rows[b, HEIGHT]))))

    def cost(self, state: State) -> float:
        """Sum of squares; of boxes, twice Cauchy's negative logarithm."""
        r = self.residuals(state)
        squares = CAUCHY**2 * np.log1p((r * r).sum(axis=1) / CAUCHY**2)
        return float(squares.sum()) + float(sum((p * p).sum() for p in self.prior_residuals(state)))

    def solve(self, rounds: int = ROUNDS, held: Mask | None = None) -> Adjusted:
        """Minimize the cost from the present state. held (free,): parameters of cameras that stay as they are."""
        moving = np.append(np.ones(len(self.free), dtype=bool) if held is None else ~held, np.ones(3, dtype=bool))
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
        return self._result(state)

    def rescaled(self, common: bool = False) -> Array:
        """Set the errors of middles, tops and bottoms of each camera from the residuals; factors (cameras, 3) of the first ones.

        common: whether all cameras have the same errors, the median of theirs.
        """
        r = self.residuals((self.rows, self.body, self.stature, self.place))
        spread = [np.clip(1.48 * np.median(np.abs(r[own]), axis=0), 0.3, 3.0) if len(own) > 20 else np.ones(3) for own in self.of_view]
        for own, factor in zip(self.of_view, spread, strict=True):
            self.sigma[own] *= np.median(spread, axis=0) if common else factor
        return np.array([(self.sigma[own] / self.seen.sigma[own])[0] if len(own) else np.ones(3) for own in self.of_view])

    def _moved(self, state: State, step: tuple[Array, Array]) -> State:
        rows, body, stature, place = state
        camera, rest = step
        new = rows.ravel().copy()
        new[self.free] += camera[: len(self.free)]
        return new.reshape(rows.shape), body + camera[len(self.free) :], stature + rest[: self.people], place + rest[self.people :].reshape(2, -1).T

    def _system(self, state: State) -> dict[str, Array]:
        """Normal equations: of cameras and bodies, of people, and between them."""
        s, base = self.seen, self.predicted(state)
        r = self.residuals(state)
        ok = np.isfinite(base) & (np.abs(r) < OUTLIER)
        weight = 1 / (1 + (r * r).sum(axis=1) / CAUCHY**2)
        root = np.sqrt(weight)

        def derivative(kind: str, index: int, step: float) -> Array:
            d = (self.predicted(state, (kind, index), step) - base) / step / self.sigma * root[:, None]
            return np.where(ok & np.isfinite(d), d, 0.0)

        n, free = len(s.view), len(self.free)
        dx, dy = (derivative("place", axis, 1e-4) for axis in (0, 1))
        at, share = self._at(state[0])
        speed = (state[3][at + 1] - state[3][at]) / KNOT
        J = np.zeros((3 * n, free + 3))
        for p in sorted({int(one) % len(NAMES) for one in self.free}):
            d = dx * speed[:, :1] + dy * speed[:, 1:] if p == OFFSET else derivative("camera", p, float(STEPS[p]))
            for column in np.flatnonzero(self.free % len(NAMES) == p).tolist():
                own = self.of_view[int(self.free[column]) // len(NAMES)]
                J.reshape(n, 3, -1)[own, :, column] = d[own]
        for g in (0, 1):
            J[:, free + g] = derivative("body", g, 1e-4).ravel()
        i = np.arange(3 * n)
        knot, part = np.repeat(at, 3), np.repeat(share, 3)
        before, after = (1 - part, part)
        data = [derivative("stature", 0, 1e-4).ravel(), before * dx.ravel(), after * dx.ravel(), before * dy.ravel(), after * dy.ravel()]
        x, y = self.people + knot, self.people + self.knots + knot
        columns = np.concatenate([np.repeat(s.person, 3), x, x + 1, y, y + 1])
        K = sparse.csr_matrix((np.concatenate(data), (np.tile(i, 5), columns)), (3 * n, self.people + 2 * self.knots))
        wr = (r * root[:, None] * ok).ravel()
        return self._with_priors(state, {"J": J, "K": K, "r": wr})

    def _with_priors(self, state: State, system: dict[str, Array]) -> dict[str, Array]:
        J, K, wr = system["J"], system["K"], system["r"]
        camera, stature, smooth = self.prior_residuals(state)
        free = len(self.free)
        sigma = self.prior.sigma.ravel()[self.free]
        P = np.zeros((len(camera), free + 3))
        P[np.arange(free), np.arange(free)] = np.where(np.isfinite(sigma), 1 / sigma, 0.0)
        P[free + np.arange(3), free + np.arange(3)] = 1 / self.prior.body[:, 1]
        for k, (a, b, _, error) in enumerate(self.prior.distances):
            base = self._distance(state[0], a, b)
            for column, flat in enumerate(self.free.tolist()):
                moved = state[0].copy().ravel()
                moved[flat] += 1e-5
                P[free + 3 + k, column] = (self._distance(moved.reshape(state[0].shape), a, b) - base) / 1e-5 / error
        mean, scale = state[1][2], self._unit(state[0])
        D = sparse.block_diag([sparse.eye(self.people) * (RELATIVE / mean), self._smooth * scale, self._smooth * scale]).tocsr()
        C = (K.T @ K + D.T @ D + LEAST * sparse.eye(K.shape[1])).tocsc()
        g = np.concatenate([stature, smooth[:, 0], smooth[:, 1]])
        E = np.zeros((len(g), free + 3))
        E[: self.people, free + 2] = -state[2] * (RELATIVE / mean**2)
        E[self.people :, np.flatnonzero(self.free % len(NAMES) == HEIGHT)] = -g[self.people :, None] / len(self.cameras)
        cross, A, right = K.T @ J + D.T @ E, J.T @ J + P.T @ P + E.T @ E, J.T @ wr + P.T @ camera + E.T @ g
        return system | {"A": A, "B": cross, "C": C, "a": right, "c": K.T @ wr + D.T @ g}

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
        """Of the free parameters and the bodies, people eliminated: gradient (p,), information (p, p), and covariance (p, p) of the gradient.

        The last holds what boxes of a tracklet have in common, and errors that all boxes of a camera may have.
        """
        state = self.rows, self.body, self.stature, self.place
        system = self._system(state)
        X = _factor(system["C"]).solve(np.column_stack([system["B"], system["c"]]))
        H, gradient = system["A"] - system["B"].T @ X[:, :-1], system["a"] - system["B"].T @ X[:, -1]
        reduced = system["J"] - system["K"] @ X[:, :-1]
        s = self.seen
        chunk = np.unique(np.column_stack([s.view, s.track, (s.time / CLUSTER).astype(np.int64)]), axis=0, return_inverse=True)[1].ravel()
        score = np.zeros((int(chunk.max()) + 1, reduced.shape[1]))
        np.add.at(score, np.repeat(chunk, 3), reduced * system["r"][:, None])
        common = reduced.T @ self._common_errors(state)
        return gradient, H, score.T @ score + (H - reduced.T @ reduced) + common @ common.T

    def _common_errors(self, state: State) -> Array:
        """Residuals (3 n, errors) by errors of edges that all boxes of a camera have, of one standard deviation each: constant, and with the size."""
        r = self.residuals(state)
        root = 1 / np.sqrt(1 + (r * r).sum(axis=1) / CAUCHY**2)
        high = self.seen.box[:, 2] - self.seen.box[:, 1]
        out = []
        for own in self.of_view:
            size = np.log2(high[own])
            for edge in (1, 2):
                for form in (np.full(len(own), BIAS), BIAS * (size - size.mean())):
                    error = np.zeros((len(high), 3))
                    error[own, edge] = form * high[own] / self.sigma[own, edge] * root[own]
                    out.append(error.ravel())
        return np.array(out).T

    def _result(self, state: State) -> Adjusted:
        _, H, meat = self.information()
        inverse = np.linalg.pinv(H, hermitian=True)
        covariance = inverse @ meat @ inverse
        free = len(self.free)
        whole = np.zeros((state[0].size, state[0].size))
        whole[np.ix_(self.free, self.free)] = covariance[:free, :free]
        r = self.residuals(state)
        weight = 1 / (1 + (r * r).sum(axis=1) / CAUCHY**2)
        rows, body, stature, place = state
        ends = zip(self.start, self.first.tolist(), self.count.tolist(), strict=True)
        paths = {k: (start + KNOT * np.arange(count), place[first : first + count]) for k, (start, first, count) in enumerate(ends)}
        return Adjusted(rows, whole, body, np.ones((len(self.cameras), 3)), self.cost(state) / max(len(weight), 1), weight, paths, stature)


def _factor(matrix: sparse.csc_matrix) -> SuperLU:
    """Factors of a positive definite matrix."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def adjust(cameras: Sequence[Camera], seen: Observations, rows: Array, prior: Prior, rounds: int = ROUNDS) -> Adjusted:
    """The parameters of greatest posterior density from `rows` (cameras, 11).

    Half of the steps are made first. Who then has no stature of people, or boxes that are mostly outliers, is left out: false boxes, for instance.
    Errors of boxes are set from the residuals before the rest.
    """
    first = Problem(cameras, seen, rows, prior)
    found = first.solve(max(rounds // 2, 4))
    ratio, count = found.stature / found.body[2], np.bincount(seen.person, minlength=len(found.stature))
    inliers = np.bincount(seen.person, found.weight > INLIER, minlength=len(found.stature)) / np.maximum(count, 1)
    kept = (np.abs(np.log(ratio)) < MOST_RATIO) & (inliers > LEAST_INLIERS)
    if not kept[seen.person].any():
        kept[:] = True
    problem = Problem(cameras, seen.of_people(kept), found.rows, prior)
    problem.body = found.body
    problem.stature[:] = found.stature[kept]
    problem.solve(5)
    factors = problem.rescaled()
    return replace(problem.solve(rounds), factors=factors)
