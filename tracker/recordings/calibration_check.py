"""The check of a recording's calibration: figures of each fixed camera, and likely errors in words.

calibration_errors.py and calibration_timing.py test units, the direction of R and t, boxes, frame numbers and the order of cameras.
calibration_verdict.py tests the figures of the table for errors that none of these explains.
Without truth, three errors are not observable: a shift of all frames, the unit of the truth, and another frame rate of all cameras.
Where people stand still, no error of frames is observable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tracker.geometry import Array
from tracker.geometry.ground import inside_area
from tracker.recordings.calibration_errors import (
    Corrected,
    Finding,
    swapped_cameras,
    wrong_area_unit,
    wrong_boxes,
    wrong_extrinsics,
    wrong_truth_unit,
)
from tracker.recordings.calibration_feet import CalibrationCase
from tracker.recordings.calibration_timing import shifted_frames, stretched_frames
from tracker.recordings.calibration_verdict import doubts
from tracker.recordings.image_check import image_findings, silent_frames
from tracker.recordings.recording import Recording, RecordingCamera

MOST_FINDINGS = 6
SIGHT = 60.0
"""m: distance up to which ground counts as seen. Beyond it, a pixel covers metres of ground."""
SAMPLES = 48
"""Points per side at which the image and the area are sampled."""
ABSENT = 1e6
"""m: largest distance of feet that is reported."""

STEPS: tuple[Callable[[CalibrationCase], Corrected | None], ...] = (
    lambda case: _that_mends(case, wrong_extrinsics, alone=True),
    lambda case: _that_mends(case, wrong_boxes) if doubts(case) else None,
    wrong_truth_unit,
    swapped_cameras,
    stretched_frames,
    lambda case: _that_mends(case, shifted_frames),
    wrong_area_unit,
)
"""Tests, in this order. A finding is corrected before the next test."""
UNEXPLAINED = "unexplained"
"""Kind of a finding that no named error explains."""


def _that_mends(case: CalibrationCase, test: Callable[[CalibrationCase], Corrected | None], alone: bool = False) -> Corrected | None:
    """The finding of a test, if its cameras have no doubts after the correction. Other errors may look like it.

    alone: as in doubts, because other cameras and the truth may have errors, too.
    """
    found = test(case)
    concerned = set(found[0].cameras or case.lenses) if found else set()
    return None if found is None or any(concerned & set(cameras) for cameras, _ in doubts(found[1], alone)) else found


@dataclass(frozen=True)
class CameraCheck:
    """Figures of a fixed camera as given.

    place (3,) m; above: height above the ground, m; heading, pitch: of the middle of the image, degrees, anticlockwise from +x, and up.
    ground_share: share of the image that sees ground within SIGHT m. area_share: share of the area that is in the image; None without an area.
    boxes: number of boxes whose feet are in the image. grounded, inside: shares of them whose feet are on the ground, and in the area. tall: share
    with the height of a person. distance: median distance m of feet in the area to the nearest true person of the frame; None where there is
    none. Without truth it is that to the nearest feet of other cameras. compared: "truth", "cameras" or "".
    """

    name: str
    place: tuple[float, float, float]
    above: float
    heading: float
    pitch: float
    ground_share: float
    area_share: float | None
    boxes: int
    grounded: float
    inside: float
    tall: float
    distance: float | None
    compared: str


@dataclass(frozen=True)
class CalibrationReport:
    """cameras: figures of the fixed cameras. moving: names of cameras on robots, which are not checked. findings: likely errors.

    Findings of the kind UNEXPLAINED are figures that no right recording shows, after all named errors are corrected.
    """

    cameras: tuple[CameraCheck, ...]
    moving: tuple[str, ...]
    findings: tuple[Finding, ...]

    @property
    def unexplained(self) -> tuple[Finding, ...]:
        """The findings of the kind UNEXPLAINED."""
        return tuple(finding for finding in self.findings if finding.kind == UNEXPLAINED)

    def to_json(self) -> dict[str, Any]:
        """As `pilsim check --json` prints it: the fields by their names."""
        return {"cameras": [asdict(one) for one in self.cameras], "moving": list(self.moving), "findings": [asdict(one) for one in self.findings]}

    def lines(self) -> list[str]:
        """A table of the cameras, and a line for each finding."""
        width = max([6, *(len(one.name) for one in self.cameras)])
        compared = next((one.compared for one in self.cameras if one.compared), "")
        to = {"truth": "to truth", "cameras": "to others", "": "distance"}[compared]
        out = [
            f"{'camera':{width}}  {'place x, y, z [m]':>24} {'above':>7} {'heading':>7} {'pitch':>6} {'ground':>6} {'area':>5}"
            f" {'boxes':>7} {'on it':>6} {'inside':>6} {'tall':>5} {to:>9}"
        ]
        for one in self.cameras:
            place = ", ".join(_short(value) for value in one.place)
            area = "-" if one.area_share is None else f"{one.area_share:.0%}"
            shares = f"{one.grounded:>6.0%} {one.inside:>6.0%} {one.tall:>5.0%}" if one.boxes else f"{'-':>6} {'-':>6} {'-':>5}"
            distance = "-" if one.distance is None else f"{_short(one.distance)} m"
            out.append(
                f"{one.name:{width}}  {place:>24} {_short(one.above):>7} {one.heading:>6.0f}° {one.pitch:>5.0f}° {one.ground_share:>6.0%}"
                f" {area:>5} {one.boxes:>7} {shares} {distance:>9}"
            )
        if self.moving:
            out.append(f"{', '.join(self.moving)}: on robots, not checked")
        return out + [f"{'something is wrong' if one.kind == UNEXPLAINED else 'looks wrong'}: {one.words}" for one in self.findings]


def _short(value: float) -> str:
    return f"{value:.2f}" if abs(value) < 100 else f"{value:.0f}"


LEGEND = (
    "above: height above the ground; ground, area: share of the image that sees ground within 60 m, share of the area in the image;\n"
    "on it, inside, tall: share of boxes with feet on the ground, in the area, with the height of a person; last: median distance of feet in the area"
)


def check_calibration(recording: Recording) -> CalibrationReport:
    """Check the fixed cameras of a recording, which may be one that check_heights refuses. Raises ValueError for a camera without a pose."""
    recording.check_calibrated()
    case = CalibrationCase.of(recording)
    moving = tuple(name for name in recording.cameras if name not in case.lenses)
    checks = tuple(_camera_check(case, name, camera) for name, camera in recording.fixed.items())
    found = _findings(case)
    # With boxes in every k-th frame, the other frames have none.
    silent = [] if any(finding.kind == "frames-stretched" for finding in found) else silent_frames(recording)
    return CalibrationReport(checks, moving, (*found, *silent, *image_findings(recording)))


def _findings(case: CalibrationCase) -> list[Finding]:
    found: list[Finding] = []
    while len(found) < MOST_FINDINGS and case.lenses:
        corrected = next((c for step in STEPS if (c := step(case)) is not None), None)
        if corrected is None:
            break
        found.append(corrected[0])
        case = corrected[1]
    return [*found, *_below_ground(case), *(Finding(UNEXPLAINED, cameras, words) for cameras, words in doubts(case))]


def suspicion(recording: Recording) -> str:
    """The findings of `pilsim check` on boxes, places and frame numbers, in one line, or "". Images are not read, to save time."""
    case = CalibrationCase.of(recording)
    # Where figures are already wrong, the search for a correction is left to `check`.
    unexplained = [Finding(UNEXPLAINED, cameras, words) for cameras, words in doubts(case)]
    found = [*unexplained, *_below_ground(case)] if unexplained else _findings(case)
    silent = [] if any(finding.kind == "frames-stretched" for finding in found) else silent_frames(recording)
    return "; ".join(finding.words for finding in (*found, *silent))


def _below_ground(case: CalibrationCase) -> list[Finding]:
    """Cameras that are below the ground even after all corrections."""
    out = []
    for name, (R, t) in case.extrinsics.items():
        place = -R.T @ t
        below = float(case.ground.height_at(place[None])[0] - place[2])
        if not below < 0:
            out.append(Finding("camera-below-ground", (name,), f"{name}: is {_short(below)} m below the ground, and no known error explains it"))
    return out


def _camera_check(case: CalibrationCase, name: str, camera: RecordingCamera) -> CameraCheck:
    feet, place = case.feet(name), camera.pose.translation
    inside, n = inside_area(feet.point, case.area), len(feet.frame)
    compared, distance = "", None
    reference = case.reference(name)
    if len(reference.frames) and inside.any():
        known = reference.distances(feet.frame[inside], feet.point[inside], ABSENT)
        known = known[np.isin(feet.frame[inside], reference.frames)]
        if len(known):
            compared, distance = "cameras" if case.truth is None else "truth", float(np.median(known))
    ahead = _middle(camera)
    return CameraCheck(
        name,
        (float(place[0]), float(place[1]), float(place[2])),
        float(place[2] - case.ground.height_at(place[None])[0]),
        float(np.degrees(np.arctan2(ahead[1], ahead[0]))),
        float(np.degrees(np.arcsin(np.clip(ahead[2], -1, 1)))),
        _ground_share(case, camera),
        None if case.area is None else _area_share(case, camera),
        n,
        float(feet.grounded.mean()) if n else 0.0,
        float(inside.mean()) if n else 0.0,
        feet.plausible(case.band),
        distance,
        compared,
    )


def _middle(camera: RecordingCamera) -> Array:
    """Direction (3,) of the middle of the image in the world."""
    size = np.array([[camera.camera.width / 2, camera.camera.height / 2]])
    return np.asarray(camera.pose.rotation @ camera.camera.bearings_from_pixels(size)[0])


def _ground_share(case: CalibrationCase, camera: RecordingCamera) -> float:
    lens, pose = camera.camera, camera.pose
    u, v = np.meshgrid((np.arange(SAMPLES) + 0.5) * lens.width / SAMPLES, (np.arange(SAMPLES) + 0.5) * lens.height / SAMPLES)
    rays = lens.bearings_from_pixels(np.column_stack([u.ravel(), v.ravel()])) @ pose.rotation.T
    if pose.translation[2] <= case.ground.height_at(pose.translation[None])[0]:
        return 0.0
    return float(case.ground.intersect(np.broadcast_to(pose.translation, rays.shape), rays, SIGHT)[1].mean())


def _area_share(case: CalibrationCase, camera: RecordingCamera) -> float:
    assert case.area is not None
    x, y = (np.linspace(case.area[0, axis], case.area[1, axis], SAMPLES) for axis in (0, 1))
    points = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
    points = np.column_stack([points, case.ground.height_at(points)])
    sight = (points - camera.pose.translation) @ camera.pose.rotation
    if camera.pose.translation[2] <= case.ground.height_at(camera.pose.translation[None])[0]:
        return 0.0
    return float(camera.camera.pixels_from_bearings(sight / np.maximum(np.linalg.norm(sight, axis=1), 1e-9)[:, None])[1].mean())
