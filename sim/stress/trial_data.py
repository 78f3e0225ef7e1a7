"""The data of a trial in memory: setup, ticks and truth of a case, as recorded and as the tracker gets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from sim.datasets.fixed_cameras import corner_cameras
from sim.datasets.presets import PRESETS
from sim.datasets.twin import Twin, recording_of
from sim.policies.driven_simulation import PolicySimulation
from sim.recording.frames import Frame, raycast_frames
from sim.recording.record import SimulatedSequence, rendered_frames
from sim.recording.tracker_setup import make_setup, told_setup
from sim.sensors.raycast_camera import RaycastCamera
from sim.stress.sweeps import OWN_GOALS, RECORDED, ROOM, Case
from tracker.detections.boxes import detections_from_boxes
from tracker.formats.opening import open_recording, open_sequence
from tracker.formats.pets2009 import PETS_AREA, PETS_VIEWS
from tracker.formats.source_options import SourceOptions
from tracker.geometry import Array, Ints, angles_from_bearing, wrap
from tracker.geometry.cameras import Camera
from tracker.metrics.evaluation import matching_frames
from tracker.metrics.matching import MatchingFrame
from tracker.person_detector.detected_ticks import sites_of, with_found_people
from tracker.person_detector.detector import PersonDetector
from tracker.recordings.degradation import Degradation
from tracker.sequence.results import Results
from tracker.types import Boxes, Detections, Setup, Tick, TicksInMemory, Truth, ViewTruth
from tracker.types.truth import evaluated_people

EDGE_TOLERANCE = np.radians(1.5)
"""A detection is false where its direction or an edge is off by more than this plus four standard deviations, rad."""


@dataclass(frozen=True, eq=False)
class TrialData:
    """A case as recorded (setup, recorded, truth) and as the tracker gets it (tracker_setup, ticks).

    views: by frame and camera, the truth of the view; empty where it is not known, as in real sequences. person: by `id` of Detections, the true
    persons, as `true_persons` gives them. landmarks: (n, 3) m, of which there are sightings; None where sightings are features of images.
    """

    case: Case
    setup: Setup
    recorded: list[Tick]
    truth: tuple[Truth, ...]
    views: Sequence[Mapping[str, ViewTruth]]
    tracker_setup: Setup
    ticks: list[Tick]
    person: Mapping[int, Ints]
    landmarks: Array | None = None

    def true_persons(self, detections: Detections) -> Ints:
        """(n,) the true person of each detection, 0 for false ones. The detections must be objects of this trial."""
        return self.person.get(id(detections), np.zeros(len(detections), dtype=np.int64))

    def matching_frames(self, results: Results, everybody: bool = False) -> list[MatchingFrame]:
        """People and tracks of each frame. People whom no view showed lately do not count, unless `everybody` is true."""
        people = {t.index: (t.person_id, t.feet) for t in self.truth}
        return matching_frames(people, results.tracks, None if everybody else evaluated_people(self.truth, self.setup.period))

    def in_memory(self) -> TicksInMemory:
        """The ticks that the tracker gets."""
        return TicksInMemory(tuple(self.ticks), self.setup.mounts)


def simulate_case(case: Case, rendered: bool, detector: PersonDetector | None = None) -> TrialData:
    """Simulate a case, or read it.

    rendered: from images, otherwise by ray casting. detector: finds the people in these images, in place of the simulated one.
    Raises ValueError where the scenario does not fit its world, where the folder is no PETS 2009 sequence, and for a detector without images.
    """
    if detector is not None and (case.source or not rendered):
        raise ValueError("--detector pixels needs rendered panoramas")
    if case.source == "pets":
        return _read_pets(case)
    if case.source == RECORDED:
        return _read_recording(case)
    recording = _recording_of(case)
    setup = make_setup(recording.simulation, recording.fixed)
    if case.source == "twin":
        setup = _with_fixed_cameras_only(setup)
    landmarks = None
    if rendered and not case.source:
        # Instances and ranges are large and not needed any more.
        frames = [replace(frame, images={}) for frame in rendered_frames(recording.simulation, setup)]
    else:
        camera = RaycastCamera(recording.simulation)
        landmarks = camera.landmarks.points
        frames = list(raycast_frames(recording.simulation, setup, camera))
        frames = [_crop_truth(frame, setup) for frame in frames] if setup.area is not None else frames
    if detector is not None:
        sites = sites_of(setup)
        frames = [replace(frame, tick=with_found_people(frame.tick, detector, sites)) for frame in frames]
    recorded = [frame.tick for frame in frames]
    person = {
        id(view.detections): match_persons(view.detections, setup.mounts[view.camera].camera, frame.views[view.camera].boxes)
        for frame in frames
        for view in frame.tick.views
    }
    ticks = case.faults.degraded_ticks(setup, recorded, case.scenario.seed)
    truth, views = tuple(frame.truth for frame in frames), [frame.views for frame in frames]
    told = told_setup(recording.simulation, setup)
    return TrialData(case, setup, recorded, truth, views, case.faults.degraded_setup(told), ticks, person, landmarks)


def _recording_of(case: Case) -> SimulatedSequence:
    """The simulation of a case, ready to record."""
    if case.source == "twin":
        return _twin_recording(case)
    if case.source == ROOM:
        made = SimulatedSequence.of(case.scenario)
        return replace(made, fixed=corner_cameras(made.simulation.world, PRESETS[ROOM].views, case.scenario.view_width))
    if not case.policy:
        return SimulatedSequence.of(case.scenario)
    return SimulatedSequence(PolicySimulation(case.scenario, "" if case.policy == OWN_GOALS else case.policy), {}, {})


def _with_fixed_cameras_only(setup: Setup) -> Setup:
    """The setup of a twin with its fixed cameras only, and with the area of the real truth."""
    mounts = {name: mount for name, mount in setup.mounts.items() if name == mount.robot}
    starts = {name: setup.starts[name] for name in mounts}
    return replace(setup, mounts=mounts, starts=starts, area=np.array(PETS_AREA))


def _crop_truth(frame: Frame, setup: Setup) -> Frame:
    """The frame with the truth of people within the area only, and without robots."""
    t = frame.truth
    inside = setup.contains(t.feet)
    return replace(frame, truth=Truth(t.index, {}, t.person_id[inside], t.feet[inside], t.visible[inside]))


def _read_pets(case: Case) -> TrialData:
    """The real sequence S2.L1, as PETS_VIEWS see it."""
    sequence = open_sequence(Path(case.folder), SourceOptions(tuple(map(str, PETS_VIEWS))))
    if sequence.truth is None:
        raise ValueError(f"{case.folder}: no truth (annotations/*-cropped.xml)")
    ticks = list(sequence.ticks)[: len(sequence.truth)]
    return TrialData(case, sequence.setup, ticks, sequence.truth, [{} for _ in ticks], sequence.setup, ticks, {})


def _read_recording(case: Case) -> TrialData:
    """The first frames of a recording, as the case changes it."""
    degraded = case.parameter in ("drop", "clutter", "noise")
    degrade = Degradation.parse(f"{case.parameter}={case.value}") if degraded else Degradation()
    folder, cameras = Path(case.folder), tuple[str, ...]()
    if case.parameter == "fewer":
        names = list(open_recording(folder).cameras)
        cameras = tuple(names[: len(names) - int(case.value)])
    options = SourceOptions(cameras, frames=(0, case.scenario.frames), degradation=degrade, seed=case.scenario.seed)
    sequence = open_recording(folder, options).in_step().sequence()
    if sequence.truth is None:
        raise ValueError(f"{folder}: no truth, which a stress test needs")
    recorded = list(sequence.ticks)[: len(sequence.truth)]
    ticks = case.faults.degraded_ticks(sequence.setup, recorded, case.scenario.seed)
    return TrialData(case, sequence.setup, recorded, sequence.truth, [{} for _ in ticks], sequence.setup, ticks, {})


def _twin_recording(case: Case) -> SimulatedSequence:
    """The twin of the sequence, as the same cameras see it."""
    scenario, views = case.scenario, tuple(map(str, PETS_VIEWS))
    twin = Twin(Path(case.folder), views, robots=1, width=scenario.width, seed=scenario.seed, detector_model=scenario.detector_model)
    return recording_of(twin)


def match_persons(detections: Detections, camera: Camera, boxes: Boxes) -> Ints:
    """(n,) the person of each detection by linear assignment to the true boxes of the view, 0 where no box is near."""
    out = np.zeros(len(detections), dtype=np.int64)
    shown = boxes.seen[:, 2] > boxes.seen[:, 0]
    if not len(detections) or not shown.any():
        return out
    edges = boxes.seen[shown] - (0.5 - camera.pixel_centre)
    true = detections_from_boxes(camera, np.concatenate([edges[:, :2], edges[:, 2:] - edges[:, :2]], axis=1), np.ones(len(edges)))
    (azimuth, elevation), (seen_azimuth, seen_elevation) = angles_from_bearing(true.bearing), angles_from_bearing(detections.bearing)
    span, height = true.extent.T
    aside = np.abs(wrap(seen_azimuth[:, None] - azimuth))
    low = np.abs((seen_elevation - detections.extent[:, 1] / 2)[:, None] - (elevation - height / 2))
    high = np.abs((seen_elevation + detections.extent[:, 1] / 2)[:, None] - (elevation + height / 2))
    wide = np.abs(detections.extent[:, :1] - span)
    edge = 4 * np.sqrt(detections.covariance[:, 1, 1])[:, None] + EDGE_TOLERANCE
    cost = aside + low + high + 0.5 * wide
    allowed = (aside < edge) & (low < edge) & (high < edge)
    rows, columns = linear_sum_assignment(np.where(allowed, cost, 1e3))
    good = allowed[rows, columns]
    out[rows[good]] = boxes.person[shown][columns[good]]
    return out
