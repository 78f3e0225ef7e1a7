"""Ablation: the same trial tracked with stages replaced by the truth, in all 16 combinations, and the loss attributed to the stages.

Shares are Shapley values (Shapley 1953, A value for n-person games). The four stages are replaced one after the other, and a share is the gain of a
stage at its turn, averaged over all orders. The shares add up to the difference between no stage and all stages replaced.

Replaced poses, detections and terrain are true inputs of the tracker. Replaced association is a tracker for each person, which gets the boxes of
that person only.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import factorial
from typing import Any

import numpy as np

from sim.stress.tracker_under_test import TrackerUnderTest, check_estimates
from sim.stress.trial_data import TrialData, match_persons
from tracker.detections.ground_points import GroundDetections, project_to_ground
from tracker.detections.occlusion import Viewpoint
from tracker.detector_models.independent import IndependentErrors
from tracker.geometry import Array, Ints, Pose
from tracker.metrics.clear_mot import score
from tracker.mht.tracker import MhtTracker
from tracker.options import parameters_from
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.slam.filter import Slam
from tracker.slam.image_features import ImageFeatures
from tracker.tracks.tracks import Tracks
from tracker.types import Detections, Estimate, Odometry, Setup, Start, Tick, View

STAGES = ("poses", "detections", "association", "terrain")
TINY_VARIANCE = 1e-10
"""m², rad²: variance of known quantities. Covariances of 0 could not be inverted."""

ACCEPT_ALL = {
    "n_conf": 1,
    "report": 0.0,
    "forget": 0.0,
}
"""Parameters of a tracker that gets the boxes of one person only: its first track is confirmed at once and never deleted."""


def ablate(data: TrialData, tracker: TrackerUnderTest) -> dict[str, Any]:
    """Shares of the stages in MOTA ("mota") and in the mean distance of a match ("metres"), and both scores of every combination.

    The key "0110" of a combination means that detections and association are replaced. The tracker must be pilsim's own, since the association of
    others cannot be replaced.
    """
    parameters = parameters_from(tracker.options)
    values = {}
    for which in product((False, True), repeat=len(STAGES)):
        chosen = dict(zip(STAGES, which, strict=True))
        values["".join("01"[on] for on in which)] = _scores(data, _track(data, parameters, chosen))
    # A larger MOTA is better, a larger distance is worse.
    shares = {name: shapley({k: sign * v[name] for k, v in values.items()}) for name, sign in (("mota", 1.0), ("metres", -1.0))}
    return shares | {"combinations": values}


def shapley(values: Mapping[str, float]) -> dict[str, float]:
    """The Shapley value of each stage, and "total": values["1111"] − values["0000"], which is their sum."""
    n, out = len(STAGES), dict[str, float]()
    for k, stage in enumerate(STAGES):
        share = 0.0
        for key, value in values.items():
            if key[k] == "0":
                size = key.count("1")
                share += factorial(size) * factorial(n - size - 1) / factorial(n) * (values[key[:k] + "1" + key[k + 1 :]] - value)
        out[stage] = share
    return out | {"total": values["1" * n] - values["0" * n]}


def _scores(data: TrialData, results: Results) -> dict[str, float]:
    value = score(data.matching_frames(results))
    # Without a match there is no distance; the largest distance of a match stands for it.
    return {"mota": float(np.nan_to_num(value.mota, nan=1.0)), "metres": float(np.nan_to_num(value.motp_m, nan=1.0))}


def _track(data: TrialData, parameters: Parameters, chosen: Mapping[str, bool]) -> Results:
    setup, ticks, persons = with_true_stages(data, chosen)
    if not chosen["association"]:
        return Results.of(check_estimates("default", track(setup, ticks, parameters), setup, ticks), {})
    return Results.of(track_with_true_association(setup, ticks, parameters, persons), {})


@dataclass(frozen=True, eq=False)
class TruePersons:
    """The true persons of the trial's detections, and of true detections that replace them (by `id` of their Detections)."""

    data: TrialData
    replaced: Mapping[int, Ints]

    def of(self, detections: Detections) -> Ints:
        """(n,) person, 0 for false detections."""
        return self.replaced[id(detections)] if id(detections) in self.replaced else self.data.true_persons(detections)


def with_true_stages(data: TrialData, chosen: Mapping[str, bool]) -> tuple[Setup, list[Tick], TruePersons]:
    """The input of the tracker where the chosen stages are replaced by the truth, and the true persons of its detections."""
    setup = data.tracker_setup
    if chosen["terrain"]:
        setup = replace(setup, ground=data.setup.ground, occluders=data.setup.occluders)
    if chosen["poses"]:
        setup = replace(setup, starts={robot: _true_start(data, robot, start) for robot, start in setup.starts.items()})
    true_persons: dict[int, Ints] = {}
    ticks = []
    for k, tick in enumerate(data.ticks):
        views = []
        for view in tick.views:
            now = view
            if chosen["detections"]:
                detections, persons = _true_detections(data, view.camera, k)
                true_persons[id(detections)] = persons
                now = replace(now, detections=detections)
            views.append(_with_true_odometry(data, now, k) if chosen["poses"] else now)
        ticks.append(replace(tick, views=tuple(views)))
    return setup, ticks, TruePersons(data, true_persons)


def _true_start(data: TrialData, robot: str, start: Start | None) -> Start | None:
    """The true start of a robot. The start of a fixed camera is known and stays."""
    if robot not in data.truth[0].T_world_robot or data.tracker_setup.is_fixed(robot):
        return start
    return Start(data.truth[0].T_world_robot[robot], TINY_VARIANCE * np.eye(6))


def _with_true_odometry(data: TrialData, view: View, k: int) -> View:
    """The view with the true motion as odometry, and without measurements that would correct it."""
    robot = data.setup.mounts[view.camera].robot
    if robot not in data.truth[k].T_world_robot:
        return view
    before, now = (data.truth[max(j, 0)].T_world_robot[robot] for j in (k - 1, k))
    motion = Odometry(before.inverse() @ now, TINY_VARIANCE / 100 * np.eye(6))
    return View(view.camera, view.detections, None, motion)


def _true_detections(data: TrialData, camera: str, k: int) -> tuple[Detections, Ints]:
    """The true boxes of all persons who are visible enough in the view, and the persons (n,)."""
    scenario, mount, view = data.case.scenario, data.setup.mounts[camera], data.views[k][camera]
    # Without noise, the random draws change the order and the confidence only, and the confidence is set to 1.
    found = IndependentErrors(0.0, 0.0, 0.0, scenario.min_visible).detect(mount.camera, view, np.random.default_rng(0))
    found = replace(found, confidence=np.ones(len(found)))
    return found, match_persons(found, mount.camera, view.boxes)


def track_with_true_association(setup: Setup, ticks: Iterable[Tick], parameters: Parameters, persons: TruePersons) -> Iterator[Estimate]:
    """The estimates of pilsim's tracker with true association: one tracker of people for each person, which gets the boxes of that person only."""
    features, slam, people = ImageFeatures(setup, parameters.slam.features), Slam(setup, parameters.slam), dict[int, MhtTracker]()
    accepting = replace(parameters.targets.over(setup), **ACCEPT_ALL)  # type: ignore[arg-type]
    for tick in ticks:
        slam.step(features.find(tick))
        points, cameras, owners = list[GroundDetections](), list[Viewpoint](), list[Ints]()
        for view in tick.views:
            mount = setup.mounts[view.camera]
            pose = slam.pose(mount.robot)
            points.append(project_to_ground(setup, view.camera, view.detections, (pose, slam.covariance(mount.robot)), accepting.fusion))
            cameras.append(Viewpoint(view.camera, mount.camera, pose @ mount.T_body_camera))
            owners.append(persons.of(view.detections))
        for person in sorted({int(p) for own in owners for p in own[own > 0]} - set(people)):
            people[person] = MhtTracker(setup, accepting, 0)
        tracks = {p: one.step([g.select(own == p) for g, own in zip(points, owners, strict=True)], cameras, tick.time) for p, one in people.items()}
        robots = {robot: (slam.pose(robot), slam.covariance(robot)) for robot in setup.starts}
        yield _estimate(setup, tick.index, robots, tracks)


def _estimate(setup: Setup, index: int, robots: dict[str, tuple[Pose, Array]], tracks_of: Mapping[int, Tracks | None]) -> Estimate:
    """The best track of each person, with the person as its id; tracks outside the area are left out."""
    ids, places, spread = [], [], []
    for person, tracks in tracks_of.items():
        if tracks is None or not len(tracks):
            continue
        best = int(np.argmax(tracks.score))
        place = tracks.state[best, :2]
        if setup.contains(place[None])[0]:
            ids.append(person)
            places.append([*place, float(setup.ground.height_at(place[None])[0])])
            P = np.zeros((3, 3))
            P[:2, :2] = tracks.covariance[best, :2, :2]
            spread.append(P)
    poses, covariance = {r: pose for r, (pose, _) in robots.items()}, {r: P for r, (_, P) in robots.items()}
    return Estimate(index, poses, covariance, np.array(ids, dtype=np.int64), np.array(places).reshape(-1, 3), np.array(spread).reshape(-1, 3, 3), {})
