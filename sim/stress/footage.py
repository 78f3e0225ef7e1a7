"""What a trial is made of: the setup, the ticks and the truth of a case, in memory, as they were and as the tracker gets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from sim.datasets.pets_twin import Twin, stage_of
from sim.policies.driven_simulation import PolicySimulation
from sim.recording.raycast_run import RaycastFrame, run_raycast
from sim.recording.record import Stage, open_renderer
from sim.recording.record import run as run_rendered
from sim.recording.tracker_setup import setup_of
from sim.sensors.raycast_camera import RaycastCamera
from sim.stress.sweeps import OWN_GOALS, Case
from tracker.datasets.opening import open_source
from tracker.datasets.pets2009 import PETS_AREA, PETS_VIEWS
from tracker.geometry import Array, Ints, angles_from_bearing, wrap
from tracker.geometry.cameras import Camera, Panorama
from tracker.types import Boxes, Detections, Setup, Tick, TicksInMemory, Truth, ViewTruth

STRAY = np.radians(1.5)
"""rad an edge beyond which a detection is nobody's, beside four standard deviations."""


@dataclass(frozen=True, eq=False)
class TrialData:
    """setup, recorded ticks and truth of a case; told, ticks: what the tracker is given of them; views: by frame and camera what is true of the
    view, empty where that is not known (real sequences); person: whose each detection is, by `whose`; landmarks (n, 3) m that sightings are of,
    None where they are features of pictures.
    """

    case: Case
    setup: Setup
    recorded: list[Tick]
    truth: tuple[Truth, ...]
    views: Sequence[Mapping[str, ViewTruth]]
    told: Setup
    ticks: list[Tick]
    person: Mapping[int, Ints]
    landmarks: Array | None = None

    def whose(self, detections: Detections) -> Ints:
        """(n,) the person whom each of these detections shows, 0 for nobody. Of detections of this footage alone."""
        return self.person.get(id(detections), np.zeros(len(detections), dtype=np.int64))

    def in_memory(self) -> TicksInMemory:
        """The ticks that the tracker is given."""
        return TicksInMemory(tuple(self.ticks), self.setup.mounts)


def simulate_case(case: Case, rendered: bool) -> TrialData:
    """Simulate a case, or read it. Raises ValueError for a scenario that its world cannot hold and for a folder that is none of PETS 2009."""
    if case.source == "pets":
        return _real(case)
    stage = _staged(case)
    setup = setup_of(stage.scenario, stage.simulation, stage.fixed)
    if case.source:
        setup = _before_cameras(setup)
    landmarks = None
    if rendered and not case.source:
        with open_renderer(stage.scenario, stage.simulation) as renderer:
            # Of instances and ranges nothing more is wanted.
            moments = [RaycastFrame(m.tick, m.truth, m.views) for m in run_rendered(stage.scenario, stage.simulation, setup, renderer)]
    else:
        lines = RaycastCamera(stage.simulation)
        landmarks = lines.landmarks
        moments = list(run_raycast(stage.scenario, stage.simulation, setup, lines))
        moments = [_within(m, setup) for m in moments] if setup.area is not None else moments
    recorded = [moment.tick for moment in moments]
    person = {
        id(view.detections): identities(view.detections, setup.mounts[view.camera].camera, moment.views[view.camera].boxes)
        for moment in moments
        for view in moment.tick.views
    }
    ticks = case.troubles.sent(setup, recorded, case.scenario.seed)
    truth, views = tuple(moment.truth for moment in moments), [moment.views for moment in moments]
    return TrialData(case, setup, recorded, truth, views, case.troubles.told(setup), ticks, person, landmarks)


def _staged(case: Case) -> Stage:
    """What is simulated."""
    if case.source == "twin":
        return _twin(case)
    if not case.policy:
        return Stage.of(case.scenario)
    return Stage(case.scenario, PolicySimulation(case.scenario, "" if case.policy == OWN_GOALS else case.policy), {}, {})


def _before_cameras(setup: Setup) -> Setup:
    """The setup of a twin with its fixed cameras alone, and with the area of the real truth."""
    mounts = {name: mount for name, mount in setup.mounts.items() if name == mount.robot}
    starts = {name: setup.starts[name] for name in mounts}
    return replace(setup, mounts=mounts, starts=starts, area=np.array(PETS_AREA))


def _within(moment: RaycastFrame, setup: Setup) -> RaycastFrame:
    """The moment without people outside the area, and without robots, in its truth."""
    t = moment.truth
    inside = setup.contains(t.feet)
    return replace(moment, truth=Truth(t.index, {}, t.person_id[inside], t.feet[inside], t.visible[inside]))


def _real(case: Case) -> TrialData:
    """S2.L1 through PETS_VIEWS."""
    sequence = open_source(Path(case.folder), PETS_VIEWS)
    if sequence.truth is None:
        raise ValueError(f"{case.folder}: no truth (annotations/*-cropped.xml)")
    ticks = list(sequence.ticks)[: len(sequence.truth)]
    return TrialData(case, sequence.setup, ticks, sequence.truth, [{} for _ in ticks], sequence.setup, ticks, {})


def _twin(case: Case) -> Stage:
    """The twin of the sequence, before the same cameras and without rovers' pictures."""
    folder = Path(case.folder)
    calibration = next((p for p in (folder / "calibration", folder.parent / "calibration") if p.is_dir()), folder / "calibration")
    files = sorted((folder / "annotations").glob("*.xml"))
    whole = [file for file in files if "cropped" not in file.name] or files
    if not whole:
        raise ValueError(f"{folder / 'annotations'}: no *.xml")
    return stage_of(Twin(whole[0], calibration, PETS_VIEWS, robots=1, width=case.scenario.width, seed=case.scenario.seed))


def identities(detections: Detections, camera: Camera, boxes: Boxes) -> Ints:
    """(n,) the person whose box in a view is nearest to each detection, one person a detection, 0 where none is near."""
    out = np.zeros(len(detections), dtype=np.int64)
    shown = boxes.seen[:, 2] > boxes.seen[:, 0]
    if not len(detections) or not shown.any():
        return out
    azimuth, elevation, span, height = _angles(camera, boxes.seen[shown])
    seen_azimuth, seen_elevation = angles_from_bearing(detections.bearing)
    aside = np.abs(wrap(seen_azimuth[:, None] - azimuth))
    low = np.abs((seen_elevation - detections.extent[:, 1] / 2)[:, None] - (elevation - height / 2))
    high = np.abs((seen_elevation + detections.extent[:, 1] / 2)[:, None] - (elevation + height / 2))
    wide = np.abs(detections.extent[:, :1] - span)
    edge = 4 * np.sqrt(detections.covariance[:, 1, 1])[:, None] + STRAY
    cost = aside + low + high + 0.5 * wide
    allowed = (aside < edge) & (low < edge) & (high < edge)
    rows, columns = linear_sum_assignment(np.where(allowed, cost, 1e3))
    good = allowed[rows, columns]
    out[rows[good]] = boxes.person[shown][columns[good]]
    return out


def _angles(camera: Camera, boxes: Array) -> tuple[Array, Array, Array, Array]:
    """Boxes (n, 4) left, top, right, bottom px → azimuth and elevation of the middle, spans of both, rad."""
    left, top, right, bottom = boxes.T - (0.5 - camera.pixel_centre)
    middle = (left + right) / 2
    if isinstance(camera, Panorama):
        middle = np.mod(middle, camera.width)
    azimuth, low = angles_from_bearing(camera.bearings_from_pixels(np.stack([middle, bottom], axis=1)))
    _, high = angles_from_bearing(camera.bearings_from_pixels(np.stack([middle, top], axis=1)))
    if isinstance(camera, Panorama):
        span = 2 * np.pi * (right - left) / camera.width
    else:
        waist = (top + bottom) / 2
        first, _ = angles_from_bearing(camera.bearings_from_pixels(np.stack([left, waist], axis=1)))
        last, _ = angles_from_bearing(camera.bearings_from_pixels(np.stack([right, waist], axis=1)))
        span = first - last
    return azimuth, (low + high) / 2, span, high - low
