"""Calibration of fixed cameras from boxes of walking people: read this first.

Feet and heads in one view give focal length, pitch, roll and height of its camera (single_view.py). Paths of people register pairs of cameras
on the ground (registration.py), the best pair first. Bundle adjustment then estimates all parameters with paths and statures (adjustment.py).
`problems` lists what the data leave undetermined; if it is not empty, the result is a guess.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from tracker.calibration.adjustment import GLOBAL_PRIOR, ROUNDS, Adjusted, Prior, adjust
from tracker.calibration.body import CX, CY, FOCAL, HEIGHT, K1, MEAN_STATURE, OFFSET, PITCH, ROLL, YAW, X, Y, angles_of, corner_of, lens_of, pose_of
from tracker.calibration.boxes import linked_boxes
from tracker.calibration.people import MOST, observations
from tracker.calibration.refinement import changes, moved_cameras, refine, unswapped
from tracker.calibration.registration import CameraBoxes, Match, Timeline, in_view, match, paths_of, placements
from tracker.calibration.result import Calibration, Known
from tracker.calibration.single_view import LEAST_BOXES, ROLL_SIGMA, STATURE, USUAL_FOCAL, USUAL_HEIGHT, SingleView, log_usual_focal, single_view
from tracker.calibration.tracklet_pairs import CLEARLY, Evidence, Paths, evidence
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import LensCamera, Pinhole
from tracker.recordings import Recording, RecordingCamera

MOST_SIGMA = {FOCAL: 0.1, PITCH: np.radians(2.0), ROLL: np.radians(2.0), YAW: np.radians(2.0)}
"""Standard deviations above which a parameter counts as not known."""
MOST_PLACE = 0.12
"""The same for the camera's position, as a share of the median distance of people."""
TRIED = 3
"""Candidate placements of a camera that are adjusted; the one that agrees best afterwards is kept."""
LEAST_SEEN, CONTRADICTION, MOST_PAIRED = 100, 1.2, 0.5
"""Bounds for cameras that contradict each other: least places of people in the overlap, and largest evidence over that of chance.
The third is the largest share of these places in pairs. People who stand still are paired, but their evidence is that of chance."""
MOST_EDGE, MOST_MISFIT = 0.1, 5.0
"""Largest plausible error of a box's edge, a share of its height, and of a parameter of all bodies, in standard deviations of its prior."""
LINE = 0.06
"""Ratio of breadth to length of the area where people walk, below which they walk on a line."""
TIGHT = 0.6
"""Standard deviations of places after the adjustment, as a share of those before."""
ROUGH = (8, 2500)
"""Most steps and most boxes of an adjustment before all cameras are in the common frame."""
LATE, ROUND = 100.0, 12.0
"""s: times from a first box later than LATE, or before 0, are counted from there, less up to ROUND.
ROUND is a multiple of registration.STEP and people.SPACING."""
OTHER_CLOCK = 0.6
"""Prior standard deviation of clock offsets, as a share of the largest."""
PRINCIPAL, BENT = 0.02, 0.04
"""Standard deviations: of the principal point from the image centre, over the width; of the shift of corners by k1, over their distance from it."""
Progress = Callable[..., Iterable[Any]]


def calibrate(recording: Recording, known: Known | None = None, progress: Progress | None = None) -> Calibration:
    """Calibrate the fixed cameras of a recording from its boxes. Cameras with a pose keep it and define the world, unless `known.refine` is set.

    progress: wraps the iteration over pairs of cameras. Raises ValueError for a recording without fixed cameras that have boxes.
    """
    known = known or Known()
    if not known.refine:
        return _Calibrator(recording, known).run(progress)
    recording, swapped = unswapped(recording)
    found = _Calibrator(recording, known).run(progress)
    return replace(found, changes=(*swapped, *found.changes))


class _Calibrator:
    """State of a calibration: views, parameters `rows` of the cameras in the common frame, and problems."""

    def __init__(self, recording: Recording, known: Known) -> None:
        self.recording, self.known, self.problems = recording, known, list[str]()
        self.views: dict[str, CameraBoxes] = {}
        self.rows: dict[str, Array] = {}
        self.walked: dict[str, tuple[Array, Paths]] = {}
        fixed = {name: camera for name, camera in recording.fixed.items() if recording.detections.get(name)}
        if not fixed:
            raise ValueError("no fixed camera has boxes, needs detections/CAMERA.txt; `pilsim detect` finds them in images")
        self.posed = {name for name, camera in fixed.items() if "pose" not in camera.unknown}
        for name, camera in fixed.items():
            self._view(name, camera)
        first = min((view.table.time.min(initial=np.inf) for view in self.views.values()), default=np.inf)
        self.begin = ROUND * np.floor(first / ROUND) if LATE < first < np.inf or first < 0 else 0.0
        for name, view in self.views.items():
            self.views[name] = replace(view, table=replace(view.table, time=view.table.time - self.begin))
        self.times = Timeline.of(self.views.values(), known.clock)

    def _view(self, name: str, camera: RecordingCamera) -> None:
        table = linked_boxes(camera.camera, self.recording.detections[name], self.recording.rate, self.recording.clocks.get(name))
        row = self._given(name, camera)
        single: SingleView | None
        if row is None:
            single = single_view(camera.camera, table, "K" not in camera.unknown, self.known.heights.get(name))
        else:
            self.rows[name], single = row, SingleView(row, ())
        if single is None:
            count = int(table.whole.sum())
            needed = f"needs at least {LEAST_BOXES} that are apart in time, of people below a horizon"
            self.problems.append(f"{name}: {count} boxes show whole bodies, {needed}")
            return
        self.views[name] = CameraBoxes(name, camera.camera, table, single)

    def _given(self, name: str, camera: RecordingCamera) -> Array | None:
        """Parameters (11,) of a camera with a pose; None without one."""
        if name not in self.posed:
            return None
        ground = float(self.recording.ground.height_at(camera.pose.translation[None])[0])
        row = np.zeros(11)
        row[[PITCH, ROLL, YAW]] = angles_of(camera.pose.rotation)
        row[[X, Y]], row[HEIGHT] = camera.pose.translation[:2], np.log(max(camera.pose.translation[2] - ground, 0.01))
        return row

    def run(self, progress: Progress | None) -> Calibration:
        if not self.views:
            return self._result(None, [])
        before = dict(self.rows)
        if self.known.refine:
            self._forget_lost()
        pairs = [(a, b) for a, b in combinations(self.views, 2) if not {a, b} <= self.posed]
        shown = pairs if progress is None else progress(pairs, total=len(pairs))
        matches = {(a, b): match(self.views[a], self.views[b], self.times) for a, b in shown}
        if not self.rows:
            self._begin(matches)
        while left := [name for name in self.views if name not in self.rows]:
            if not self._join(left):
                break
        for name in left:
            self.problems.append(self._why_alone(name, matches))
        self._order()
        if self.known.refine:
            return self._refined(before)
        self._adjust(rough=True)
        return self._result(self._adjust(TIGHT), list(self.rows))

    def _refined(self, before: Mapping[str, Array]) -> Calibration:
        """The given calibration, with new values of the parameters that have changed. before: the rows of cameras as given."""
        names = list(self.rows)
        lost = np.array([name not in self.posed for name in names])
        given = np.array([self.rows[name] for name in names])
        self.posed = set()
        prior = self._prior(names)
        sigma = np.where((prior.sigma == 0) & (np.arange(11) > K1), np.inf, prior.sigma)
        sigma[:, FOCAL] = np.where([isinstance(self.views[name].camera, LensCamera) for name in names], USUAL_FOCAL[1], 0.0)
        body = prior.body.copy()
        body[MEAN_STATURE] = STATURE, 0.2  # Unchanged cameras fix the scale.
        # Known heights (--height) are believed before given ones.
        of_height = np.isin(names, list(self.known.heights))[:, None] & (np.arange(11) == HEIGHT)
        free = replace(prior, mean=np.where(of_height, prior.mean, given), sigma=sigma, body=body)
        rows, loose = moved_cameras({name: self.views[name] for name in names}, self.times, given, free, lost)
        for tight in (1.3, 0.8):
            seen = observations(self.views, dict(zip(names, rows, strict=True)), self.times, tight)
            if len(seen.view) < LEAST_BOXES:
                self.posed = {name for name, one in zip(names, lost.tolist(), strict=True) if not one}
                return self._result(None, names)
            adjusted, moved = refine([self.views[name].camera for name in names], seen, (given, rows), free, (loose, lost))
            rows = adjusted.rows
        self.rows = dict(zip(names, rows, strict=True))
        found = self._result(adjusted, names)
        moves = np.delete(moved, OFFSET, axis=1)
        unmoved = {name: self.recording.cameras[name] for name, own in zip(names, moves, strict=True) if not own.any()}
        told = tuple(changes(names, np.array([before.get(name, row) for name, row in zip(names, given, strict=True)]), adjusted, moved))
        return replace(found, cameras={**found.cameras, **unmoved}, moved_frame=False, changes=told)

    def _contradictions(self, adjusted: Adjusted) -> list[str]:
        """Lines on cameras with larger box errors than detectors have, and on pairs that disagree on the people in their overlap.

        Places of a person agree within WITHIN standard deviations. These follow from the errors of the lower edges (`edges`).
        """
        worst = dict(zip(self.rows, adjusted.edges.max(axis=1).tolist(), strict=True))
        out = [
            f"{name}: boxes are {edge:.0%} of their heights off, needs {MOST_EDGE:.0%}: this camera or another one is wrong"
            for name, edge in worst.items()
            if edge > MOST_EDGE
        ]
        # Ground that is not level and bent lenses are compensated by bodies that do not exist.
        if adjusted.misfit > MOST_MISFIT and not self.known.refine:
            odd = f"boxes fit no upright bodies on level ground ({adjusted.misfit:.0f} standard deviations off, needs {MOST_MISFIT:.0f})"
            out.append(f"{odd}: the ground rises, people do not stand, or a lens bends lines; --k1 and --from intrinsics may help")
        for a, b in combinations(self.rows, 2):
            paths = {name: self._walked(name, self.rows[name]) for name in (a, b)}
            seen = min(in_view(self.views[one], self.rows[one], paths[other]) for one, other in ((a, b), (b, a)))
            shown = evidence(paths[a], paths[b], TIGHT)
            if seen >= LEAST_SEEN and shown.ratio < CONTRADICTION * shown.chance and shown.steps < MOST_PAIRED * seen:
                out.append(f"{a} and {b} see the same ground, but people walk there on different paths: one of them is wrong")
        return out

    def _forget_lost(self) -> None:
        """Discard the poses of cameras that agree with no other camera, if at least two others agree; they are estimated anew."""
        lost = [name for name in self.rows if not self._evidence(name, None, 1.5).clear]
        if len(self.rows) - len(lost) < 2:
            return
        for name in lost:
            camera = self.recording.cameras[name]
            single = single_view(camera.camera, self.views[name].table, False, self.known.heights.get(name))
            if single is not None:
                self.views[name] = replace(self.views[name], single=single)
                self.posed.discard(name)
                del self.rows[name]

    def _order(self) -> None:
        """Sort the cameras in the order of the recording. Without a given pose, move the first one to the origin."""
        names = [name for name in self.views if name in self.rows]
        first = self.rows[names[0]]
        origin = np.where(np.isin(np.arange(len(first)), [X, Y, YAW, OFFSET]), 0.0, first)
        self.rows = {name: self.rows[name] if self.posed else _moved(self.rows[name], first, origin) for name in names}

    def _begin(self, matches: Mapping[tuple[str, str], list[Match]]) -> None:
        """Start the frame with the best match that agrees after adjustment, else with one camera: of the best match, or with the most boxes."""
        found = [(one.evidence.gain, pair, one) for pair, of_pair in matches.items() for one in of_pair[:TRIED]]
        surest = sorted(found, key=lambda one: -one[0])[:TRIED]
        if not self._best_of([dict(zip(pair, one.rows, strict=True)) for _, pair, one in surest]):
            name = surest[0][1][0] if surest else max(self.views, key=lambda one: int(self.views[one].table.whole.sum()))
            self.rows = {name: self.views[name].single.row.copy()}

    def _join(self, left: list[str]) -> bool:
        """Add the camera that agrees best with those in the frame; False if none agrees."""
        known = Paths.joined([self._walked(name, row) for name, row in self.rows.items()])
        candidates = [(name, row) for name in left for row in placements(known, self.views[name], self.times)]
        found = [(gain, name, row) for name, row in candidates if (gain := self._evidence(name, row, 1.0).gain) > 0]
        while found:
            surest = sorted(found, key=lambda one: -one[0])[:TRIED]
            if self._best_of([{**self.rows, name: row} for _, name, row in surest]):
                return True
            failed = {name for _, name, _ in surest}
            found = [one for one in found if one[1] not in failed]
        return False

    def _best_of(self, frames: list[dict[str, Array]]) -> bool:
        """Keep the candidate frame whose last camera agrees best with the others after adjustment; False if every candidate fails.

        All cameras have to agree, because a wrongly placed camera displaces the others.
        """
        best = 0.0, self.rows
        for frame in frames:
            self.rows = frame
            self._adjust(rough=True)
            found = [self._evidence(name) for name in self.rows]
            if all(one.clear for one in found):
                best = max(best, (found[-1].gain, self.rows), key=lambda one: one[0])
        self.rows = best[1]
        return best[0] > 0

    def _evidence(self, name: str, row: Array | None = None, tight: float = TIGHT) -> Evidence:
        """The evidence that a camera sees the people whom the others in the frame see."""
        own = self._walked(name, self.rows[name] if row is None else row)
        out = Evidence()
        for other, its in self.rows.items():
            if other != name:
                out = out.plus(evidence(self._walked(other, its), own, tight))
        return out

    def _walked(self, name: str, row: Array) -> Paths:
        """The paths that a camera sees under its parameters `row`. The last result is cached."""
        last = self.walked.get(name)
        if last is None or last[0] is not row:
            last = self.walked[name] = row, paths_of(self.views[name], row, self.times)
        return last[1]

    def _prior(self, names: list[str]) -> Prior:
        mean, sigma, lens = np.zeros((len(names), 11)), np.full((len(names), 11), np.inf), np.zeros((len(names), 11))
        sigma[:, [CX, CY, K1]] = 0.0
        sigma[:, [FOCAL, ROLL, OFFSET]] = USUAL_FOCAL[1], ROLL_SIGMA, OTHER_CLOCK * self.known.clock
        mean[:, HEIGHT], sigma[:, HEIGHT] = np.log(USUAL_HEIGHT[0]), USUAL_HEIGHT[1]
        for k, name in enumerate(names):
            camera, unknown = self.views[name].camera, self.recording.cameras[name].unknown
            if isinstance(camera, LensCamera):
                mean[k, FOCAL] = log_usual_focal(camera)
            if "K" not in unknown or not isinstance(camera, LensCamera):
                mean[k, FOCAL], sigma[k, FOCAL] = 0.0, 0.0
            elif isinstance(camera, Pinhole):
                (sigma if self.known.principal else lens)[k, [CX, CY]] = PRINCIPAL
                (sigma if self.known.k1 else lens)[k, K1] = BENT * (np.exp(self.rows[name][FOCAL]) / corner_of(camera)) ** 2
            if name in self.known.heights:
                mean[k, HEIGHT], sigma[k, HEIGHT] = np.log(self.known.heights[name]), 0.005
            if name in self.posed:
                mean[k], sigma[k], lens[k] = self.views[name].single.row, 0.0, 0.0
                sigma[k, OFFSET] = OTHER_CLOCK * self.known.clock if name != min(self.posed) else 0.0
        if not self.posed & set(names):
            sigma[0, [X, Y, YAW, OFFSET]] = 0.0
        body = GLOBAL_PRIOR.copy()
        usual = body[MEAN_STATURE, 1] if not self._scaled() else 0.1
        body[MEAN_STATURE] = (STATURE, 0.2) if self.known.stature is None else (self.known.stature, usual)
        index = {name: k for k, name in enumerate(names)}
        far = tuple((index[a], index[b], m, 0.005 * m) for (a, b), m in self.known.distances.items() if a in index and b in index)
        return Prior(mean, sigma, body, far, lens[:, [CX, CY, K1]])

    def _scaled(self) -> bool:
        """Whether a height, a distance or a pose gives the scale."""
        return bool(self.known.heights or self.known.distances or len(self.posed) > 0)

    def _adjust(self, tight: float = 1.0, rough: bool = False) -> Adjusted | None:
        """Adjust the cameras in the frame; None with too few boxes. rough: few steps with some of the boxes, before all cameras are in the frame."""
        names = list(self.rows)
        seen = observations(self.views, self.rows, self.times, tight, ROUGH[1] if rough else MOST)
        if len(seen.view) < LEAST_BOXES:
            return None
        rows, rounds = np.array([self.rows[name] for name in names]), ROUGH[0] if rough else ROUNDS
        adjusted = adjust([self.views[name].camera for name in names], seen, rows, self._prior(names), rounds, not rough)
        self.rows = dict(zip(names, adjusted.rows, strict=True))
        return adjusted

    def _why_alone(self, name: str, matches: Mapping[tuple[str, str], list[Match]]) -> str:
        found = [one.evidence for pair, of_pair in matches.items() if name in pair for one in of_pair[:1]]
        if not found:
            return f"{name}: nobody walks 1 m or more in sight of it and of another camera, which its place needs"
        best = max(found, key=lambda one: one.gain)
        times = best.ratio / max(best.chance, 1.0)
        agree = f"paths agree {times:.1f} times as well as by chance, needs {CLEARLY}"
        if best.clear:
            agree = f"paths agree {times:.1f} times as well as by chance before the cameras are adjusted, less after it"
        elif times >= CLEARLY:
            agree = "too few people walk in sight of both"
        return f"{name}: sees too little of what other cameras see ({agree}), so its place is not known"

    def _result(self, adjusted: Adjusted | None, names: list[str]) -> Calibration:
        rows = np.array([self.rows[name] for name in names]).reshape(-1, 11)
        covariance = np.full((rows.size, rows.size), np.nan) if adjusted is None else adjusted.covariance
        cameras, offsets = {}, {}
        for name, row in zip(names, rows, strict=True):
            given = self.recording.cameras[name]
            pose = pose_of(row)
            # A new world has level ground at 0.
            ground = float(self.recording.ground.height_at(np.append(row[[X, Y]], 0.0)[None])[0]) if self.posed or self.known.refine else 0.0
            pose = Pose(pose.rotation, pose.translation + np.array([0.0, 0.0, ground]))
            cameras[name] = given if name in self.posed else RecordingCamera(lens_of(given.camera, row), pose, given.robot)
            offsets[name] = float(row[OFFSET])
        paths = {} if adjusted is None else {person: (time + self.begin, place) for person, (time, place) in adjusted.paths.items()}
        self._doubt(adjusted, names)
        figures = {} if adjusted is None else adjusted.figures()
        return Calibration(cameras, offsets, rows, covariance, tuple(self.problems), figures, paths, moved_frame=not self.posed)

    def _doubt(self, adjusted: Adjusted | None, names: list[str]) -> None:
        """Add lines on what the adjustment leaves undetermined to `problems`."""
        if adjusted is None:
            if names:
                self.problems.append("too few boxes of people who can be told apart")
            return
        if self.known.stature is None and not self._scaled() and not self.known.refine:
            self.problems.append("nothing gives the scale: neither a stature, nor the height of a camera, nor a distance is known")
        places = np.concatenate([place for _, place in adjusted.paths.values()])
        spread = np.sqrt(np.linalg.eigvalsh(np.cov(places.T)))
        if spread[0] < LINE * spread[1]:
            size = f"{spread[0]:.1f} m broad, {spread[1]:.1f} m long"
            self.problems.append(f"all people walk on one line ({size}), which leaves the turns of cameras about it open")
        self.problems += self._contradictions(adjusted)
        sigma = np.sqrt(np.abs(np.diag(adjusted.covariance))).reshape(-1, 11)
        sigma[:, [PITCH, ROLL, YAW, X, Y]] = self._apart_from_frame(adjusted, names)
        for k, name in enumerate(names):
            distance = float(np.median(np.hypot(*(places - adjusted.rows[k, [X, Y]]).T)))
            if name not in self.posed and not adjusted.edges[k].any():
                self.problems.append(f"{name}: none of its boxes agrees with people, so nothing of it is known")
            elif sigma[k, FOCAL] > MOST_SIGMA[FOCAL]:
                known = f"{name}: its focal length is known to {sigma[k, FOCAL]:.0%} only"
                self.problems.append(f"{known}: people at like distances do not tell it from pitch and height")
            elif (sigma[k, [PITCH, ROLL, YAW]] > [MOST_SIGMA[p] for p in (PITCH, ROLL, YAW)]).any():
                self.problems.append(f"{name}: its angles are known to {np.degrees(sigma[k, [PITCH, ROLL, YAW]].max()):.1f}° only")
            elif np.hypot(*sigma[k, [X, Y]]) > MOST_PLACE * distance:
                self.problems.append(f"{name}: its place is known to {np.hypot(*sigma[k, [X, Y]]):.2f} m only")

    def _apart_from_frame(self, adjusted: Adjusted, names: list[str]) -> Array:
        """Standard deviations (n, 5): pitch, roll and yaw, rad, of the ray through the image centre, and x, y, m, without the choice of frame.

        The central ray is used because errors of principal point and rotation are correlated. If a camera has a pose, deviations are relative to it.
        For two cameras they are relative to the first, without the scale if statures alone give it. For three or more, the best similarity
        transformation of the positions is removed, because all share the uncertain frame of the first one.
        """
        rows, n = adjusted.rows, len(names)
        T = np.zeros((n, 5, n, 11))
        for k, name in enumerate(names):
            lens, pitch = lens_of(self.views[name].camera, rows[k]), float(rows[k, PITCH])
            wide = lens.width / lens.fx if isinstance(lens, LensCamera) else 0.0
            T[k, range(5), k, [PITCH, ROLL, YAW, X, Y]] = 1.0
            T[k, :3, k, CX] = 0.0, wide * np.tan(pitch), wide / np.cos(pitch)
            T[k, 0, k, CY] = -wide
        if self.posed or n < 3:
            first = names.index(min(self.posed)) if self.posed else 0
            T[:, 2] -= T[first, 2].copy()
            if not self._scaled():
                T[:, 3:, :, HEIGHT] -= rows[:, [X, Y], None] / n
        else:
            high, apart = np.exp(rows[:, HEIGHT]), rows[:, [X, Y]] - rows[:, [X, Y]].mean(axis=0)
            place = T[:, 3:] - T[:, 3:].mean(axis=0)
            turn = np.einsum("k,kij->ij", apart[:, 0], place[:, 1]) - np.einsum("k,kij->ij", apart[:, 1], place[:, 0])
            scale = np.einsum("kp,kpij->ij", apart, place)
            scale[range(n), HEIGHT] += high**2
            turn, scale = turn / np.maximum((apart**2).sum(), 1e-9), scale / ((apart**2).sum() + (high**2).sum())
            T[:, 2] -= turn
            across = np.column_stack([-apart[:, 1], apart[:, 0]])
            T[:, 3:] = place - across[:, :, None, None] * turn - apart[:, :, None, None] * scale
        variance = np.einsum("ij,jk,ik->i", flat := T.reshape(5 * n, -1), adjusted.covariance, flat)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 5))


def _moved(row: Array, beside: Array, world: Array) -> Array:
    """Move `row` rigidly, from the frame where another camera has the parameters `beside` to that where it has `world`."""
    out, turn = row.copy(), world[YAW] - beside[YAW]
    away = row[[X, Y]] - beside[[X, Y]]
    c, s = np.cos(turn), np.sin(turn)
    out[X], out[Y] = world[X] + c * away[0] - s * away[1], world[Y] + s * away[0] + c * away[1]
    out[YAW], out[OFFSET] = row[YAW] + turn, row[OFFSET] + world[OFFSET] - beside[OFFSET]
    return out
