"""Which stage owns the loss: the same footage tracked with stages replaced by the truth, all 16 combinations, and the loss shared out between them.

Shares are Shapley's (1953, A value for n-person games): the mean, over all orders in which the four stages can be replaced one after the other, of
what replacing the stage gains at its turn. They add up to the whole difference between nothing and everything replaced. The tracker is never
handed the truth: what goes into it is replaced, or, for association, the part that decides whose a box is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from math import factorial
from typing import Any

import numpy as np

from sim.sensors.person_detector import Detector
from sim.stress.footage import TrialData, identities
from sim.stress.tracker_under_test import TrackerUnderTest, checked
from tracker.detections.ground_points import GroundDetections, project_to_ground
from tracker.detections.occlusion import Viewpoint
from tracker.geometry import Array, Ints, Pose
from tracker.gnn.tracker import GnnTracker
from tracker.metrics.clear_mot import score
from tracker.metrics.evaluation import who_counts
from tracker.metrics.matching import MatchingFrame
from tracker.options import parameters_from
from tracker.pipeline import Parameters, track
from tracker.sequence.results import Results
from tracker.slam.filter import Slam
from tracker.tracks.tracks import Tracks
from tracker.types import Detections, Estimate, Odometry, Setup, Start, Tick, View

STAGES = ("poses", "detections", "association", "terrain")
SURE = 1e-10
"""m², rad²: variance of what is known for certain; of nothing at all no covariance can be inverted."""

TRUSTING = {"min_confidence": 0.0, "birth_confidence": 0.0, "n_conf": 1, "believe": -1e6, "forget": -1e6, "end": -1e6}
"""TargetParameters of who is shown one person's boxes alone: what they show is there."""


def ablate(footage: TrialData, contender: TrackerUnderTest) -> dict[str, Any]:
    """Shares of the stages in MOTA and in metres (mean distance of a match), and both for every combination, "0110" for detections and association
    replaced. Of our own tracker alone: the association of others cannot be replaced.
    """
    parameters = parameters_from(contender.options)
    values = {}
    for which in product((False, True), repeat=len(STAGES)):
        chosen = dict(zip(STAGES, which, strict=True))
        values["".join("01"[on] for on in which)] = _scored(footage, _tracked(footage, parameters, chosen))
    # Metres are lost where they grow, points where they fall.
    shares = {name: shapley({k: sign * v[name] for k, v in values.items()}) for name, sign in (("mota", 1.0), ("metres", -1.0))}
    return shares | {"combinations": values}


def shapley(values: Mapping[str, float]) -> dict[str, float]:
    """What each stage adds on average over all orders, and "total": values["1111"] − values["0000"], which is their sum."""
    n, out = len(STAGES), dict[str, float]()
    for k, stage in enumerate(STAGES):
        share = 0.0
        for key, value in values.items():
            if key[k] == "0":
                size = key.count("1")
                share += factorial(size) * factorial(n - size - 1) / factorial(n) * (values[key[:k] + "1" + key[k + 1 :]] - value)
        out[stage] = share
    return out | {"total": values["1" * n] - values["0" * n]}


def _scored(footage: TrialData, results: Results) -> dict[str, float]:
    nobody = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    counts = who_counts(footage.truth, footage.setup.period)
    frames = [MatchingFrame(t.person_id, t.feet, *results.tracks.get(t.index, nobody), counts=c) for t, c in zip(footage.truth, counts, strict=True)]
    value = score(frames)
    # Where nobody is matched there is no distance: as far off as a match may be.
    return {"mota": float(np.nan_to_num(value.mota, nan=1.0)), "metres": float(np.nan_to_num(value.motp_m, nan=1.0))}


def _tracked(footage: TrialData, parameters: Parameters, chosen: Mapping[str, bool]) -> Results:
    setup, ticks, whose = replaced(footage, chosen)
    if not chosen["association"]:
        return Results.of(checked("default", track(setup, ticks, parameters), setup, ticks), {})
    return Results.of(associated(setup, ticks, parameters, whose), {})


@dataclass(frozen=True, eq=False)
class TrueOwners:
    """Whose detections are: those of the footage, and perfect ones."""

    footage: TrialData
    perfect: Mapping[int, Ints]

    def of(self, detections: Detections) -> Ints:
        """(n,) person, 0 for nobody."""
        return self.perfect[id(detections)] if id(detections) in self.perfect else self.footage.whose(detections)


def replaced(footage: TrialData, chosen: Mapping[str, bool]) -> tuple[Setup, list[Tick], TrueOwners]:
    """What the tracker is given where the chosen stages are as good as the truth, and whose the detections are."""
    setup = footage.told
    if chosen["terrain"]:
        setup = replace(setup, ground=footage.setup.ground, occluders=footage.setup.occluders)
    if chosen["poses"]:
        setup = replace(setup, starts={robot: _known(footage, robot, start) for robot, start in setup.starts.items()})
    perfect: dict[int, Ints] = {}
    ticks = []
    for k, tick in enumerate(footage.ticks):
        views = []
        for view in tick.views:
            now = view
            if chosen["detections"]:
                detections, whose = _perfect(footage, view.camera, k)
                perfect[id(detections)] = whose
                now = replace(now, detections=detections)
            views.append(_placed(footage, now, k) if chosen["poses"] else now)
        ticks.append(replace(tick, views=tuple(views)))
    return setup, ticks, TrueOwners(footage, perfect)


def _known(footage: TrialData, robot: str, start: Start | None) -> Start | None:
    """The start as it is; a fixed camera is known anyway."""
    if robot not in footage.truth[0].T_world_robot or footage.told.is_fixed(robot):
        return start
    return Start(footage.truth[0].T_world_robot[robot], SURE * np.eye(6))


def _placed(footage: TrialData, view: View, k: int) -> View:
    """The view with the true motion as odometry, and with nothing by which the filter could put that right."""
    robot = footage.setup.mounts[view.camera].robot
    if robot not in footage.truth[k].T_world_robot:
        return view
    before, now = (footage.truth[max(j, 0)].T_world_robot[robot] for j in (k - 1, k))
    motion = Odometry(before.inverse() @ now, SURE / 100 * np.eye(6))
    return View(view.camera, view.detections, None, motion)


def _perfect(footage: TrialData, camera: str, k: int) -> tuple[Detections, Ints]:
    """The boxes of all whom the view shows well enough, where they are, and who they are."""
    scenario, mount, view = footage.case.scenario, footage.setup.mounts[camera], footage.views[k][camera]
    # Nothing is drawn that shows but the order, and confidence, of which there is no doubt.
    found = Detector(0.0, 0.0, 0.0, scenario.min_visible).detect(mount.camera, view, np.random.default_rng(0))
    found = replace(found, confidence=np.ones(len(found)))
    return found, identities(found, mount.camera, view.boxes)


def associated(setup: Setup, ticks: Iterable[Tick], parameters: Parameters, whose: TrueOwners) -> Iterator[Estimate]:
    """Our tracker, with one tracker of people for each person, which is shown that person's boxes and no others, and so believes the first."""
    slam, people = Slam(setup, parameters.slam), dict[int, GnnTracker]()
    trusting = replace(parameters.targets, **TRUSTING)  # type: ignore[arg-type]
    for tick in ticks:
        slam.step(tick)
        feet, cameras, owners = list[GroundDetections](), list[Viewpoint](), list[Ints]()
        for view in tick.views:
            mount = setup.mounts[view.camera]
            pose = slam.pose(mount.robot)
            feet.append(project_to_ground(setup, view.camera, view.detections, (pose, slam.covariance(mount.robot)), trusting.fusion))
            cameras.append(Viewpoint(view.camera, mount.camera, pose @ mount.T_body_camera))
            owners.append(whose.of(view.detections))
        for person in sorted({int(p) for own in owners for p in own[own > 0]} - set(people)):
            people[person] = GnnTracker(setup, trusting, 0)
        told = {p: one.step([f.select(own == p) for f, own in zip(feet, owners, strict=True)], cameras) for p, one in people.items()}
        robots = {robot: (slam.pose(robot), slam.covariance(robot)) for robot in setup.starts}
        yield _estimate(setup, tick.index, robots, told)


def _estimate(setup: Setup, index: int, robots: dict[str, tuple[Pose, Array]], told: Mapping[int, Tracks | None]) -> Estimate:
    """The best track of each person under the person's own name; outside the area nobody is told of."""
    ids, places, spread = [], [], []
    for person, tracks in told.items():
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
