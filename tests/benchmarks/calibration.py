"""Calibration from people alone, against the exact truth: rooms, halls and squares with 2 to 8 cameras, none of them calibrated."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim.tuning.kinds import corner_cameras, mast_cameras
from sim.tuning.population import STATURE, STATURES
from sim.tuning.walks import STEPS, Habits, Walkers, floor, furniture, walks
from tracker.calibration import Calibration, calibrate
from tracker.calibration.body import FOCAL, HEIGHT, OFFSET, PITCH, ROLL, YAW, X, Y, angles_of
from tracker.detector_models.model import named_model
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.simulation import simulated_detections
from tracker.geometry import Array
from tracker.geometry.cameras import Camera
from tracker.recordings import Recording, RecordingCamera

KINDS = {
    "room": ((6.0, 10.0), (4.0, 6.0)),
    "hall": ((14.0, 26.0), (9.0, 16.0)),
    "square": ((16.0, 30.0), (12.0, 24.0)),
    "low": ((16.0, 30.0), (12.0, 24.0)),
}
"""Ranges of length and width, m. `low` is a square whose cameras stand as high as heads are, on tripods."""


@dataclass(frozen=True, eq=False)
class Synthetic:
    """A recording without calibration, its true cameras, and by how many s the clock of each is late."""

    recording: Recording
    cameras: dict[str, RecordingCamera]
    offsets: dict[str, float]


def synthetic(kind: str, cameras: int, seed: int, seconds: float = 90.0, model: str = "fairmot", people: int | None = None) -> Synthetic:
    """A case: people who walk, stand in groups, come and go, seen by a fitted detector; clocks off by up to a second."""
    rng = np.random.default_rng([seed, cameras, list(KINDS).index(kind)])
    size = tuple(float(rng.uniform(*bounds)) for bounds in KINDS[kind])
    rate = float(rng.choice([4.0, 5.0, 10.0]))
    frames = round(seconds * rate)
    around = floor(np.array([(0.0, 0.0), size]), furniture(size, 0.01, rng), 2, rng)
    at_once = {"room": int(rng.integers(4, 11)), "hall": int(rng.integers(6, 20))}.get(kind, int(rng.integers(6, 24))) if people is None else people
    true = corner_cameras(size, cameras, rng) if kind in ("room", "hall") else mast_cameras(around, cameras, rng)
    true = [on_tripod(camera, rng) for camera in true] if kind == "low" else true
    habits = Habits(rng.uniform(0.1, 0.4), 0.0, 0.0, rng.uniform(3.0, 10.0), rng.uniform(0.8, 1.3), (0.4, 1.0))
    total = at_once + int(rng.integers(0, at_once + 1))
    walkers = Walkers.of(around, habits, (at_once, total, 0), frames / rate, rng)
    slack = round(rate) + 1
    walked = walks(walkers, frames + 2 * slack, 1 / rate)
    stature = np.clip(rng.normal(*STATURE, total), *STATURES)
    named = {f"C{k}": camera for k, camera in enumerate(true, 1)}
    late = {name: 0 if k == 0 else int(rng.integers(-round(rate) * STEPS, round(rate) * STEPS + 1)) for k, name in enumerate(named)}
    heights = {k + 1: float(one) for k, one in enumerate(stature)}
    detections: dict[str, Any] = {}
    for name, camera in named.items():
        places = {}
        for frame in range(frames):
            step = STEPS * (frame + slack) + late[name]
            here = np.flatnonzero(np.isfinite(walked.place[step]).all(axis=1))
            places[frame] = here + 1, np.column_stack([walked.place[step, here], np.zeros(len(here))])
        seen = Recording(rate, {name: camera}, {name: {}}, places, frames=frames, pillars=around.pillars)
        detections |= simulated_detections(seen, TruePeople(places, {}, heights=heights), named_model(model), seed)
    blind = {name: unknown(camera) for name, camera in named.items()}
    return Synthetic(Recording(rate, blind, detections, frames=frames), named, {name: k / STEPS / rate for name, k in late.items()})


def on_tripod(camera: RecordingCamera, rng: np.random.Generator) -> RecordingCamera:
    """The camera as high as heads are, nearly level."""
    eye = np.array([*camera.pose.translation[:2], rng.uniform(1.7, 2.3)])
    ahead = camera.pose.rotation[:2, 0] / np.linalg.norm(camera.pose.rotation[:2, 0])
    return RecordingCamera.looking_at(camera.camera, eye, [*(eye[:2] + 12.0 * ahead), rng.uniform(0.5, 1.2)])


def unknown(camera: RecordingCamera) -> RecordingCamera:
    """The camera of which the size of the image alone is known."""
    return RecordingCamera.uncalibrated(camera.camera.width, camera.camera.height)


def focal_of(camera: Camera) -> float:
    """Focal length px at the middle of a lens."""
    axis = np.array([[1.0, 0.0, 0.0], [1.0, -1e-3, 0.0]])
    return float(np.diff(camera.pixels_from_bearings(axis / np.linalg.norm(axis, axis=1, keepdims=True))[0][:, 0])[0] / 1e-3)


def true_rows(case: Synthetic, names: list[str]) -> Array:
    """Parameters (cameras, 11) of the true cameras, in the frame of the first one."""
    out, first = [], case.cameras[names[0]]
    yaw = angles_of(first.pose.rotation)[2]
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    for name in names:
        camera, row = case.cameras[name], np.zeros(11)
        pitch, roll, own = angles_of(camera.pose.rotation)
        row[FOCAL] = np.log(focal_of(camera.camera) / focal_of(case.recording.cameras[name].camera))
        row[HEIGHT] = np.log(camera.pose.translation[2])
        row[[PITCH, ROLL]], row[YAW] = (pitch, roll), np.angle(np.exp(1j * (own - yaw)))
        row[[X, Y]] = turn @ (camera.pose.translation - first.pose.translation)[:2]
        row[OFFSET] = case.offsets[name] - case.offsets[names[0]]
        out.append(row)
    return np.array(out)


def similarity(found: Calibration, case: Synthetic) -> tuple[complex, float, complex]:
    """Turn, factor and shift m that bring the places of the found cameras best to the true ones."""
    ours, true = (np.array([cameras[name].pose.translation for name in found.cameras]) for cameras in (found.cameras, case.cameras))
    z, w, h, g = ours[:, 0] + 1j * ours[:, 1], true[:, 0] + 1j * true[:, 1], ours[:, 2], true[:, 2]
    a, b = z - z.mean(), w - w.mean()
    cross = np.vdot(a, b)
    turn = complex(cross / abs(cross)) if abs(cross) > 0 else 1.0 + 0j
    factor = float((np.vdot(a * turn, b).real + h @ g) / ((np.abs(a) ** 2).sum() + h @ h))
    return turn, factor, complex(w.mean() - factor * turn * z.mean())


def angle_between(found: RecordingCamera, true: RecordingCamera, yaw: float) -> float:
    """Largest angle °, about an axis of the camera, between the rays of the image's inner half; the found camera is turned by `yaw` rad first.

    Principal points may differ: a shift of one is a turn nearly.
    """
    size = np.array([true.camera.width, true.camera.height])
    pixels = size / 2 + size / 4 * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    rays = [camera.camera.bearings_from_pixels(pixels) @ camera.pose.rotation.T for camera in (found, true)]
    about = Rotation.from_euler("z", yaw)
    turn = Rotation.align_vectors(rays[1], about.apply(rays[0]))[0]
    return float(np.degrees(np.abs(true.pose.rotation.T @ turn.as_rotvec())).max())


def errors(case: Synthetic, found: Calibration) -> dict[str, Array]:
    """Errors of cameras (n,) after the best similarity: focal %, angles °, place in % of the mean distance of people, offset s; NEES as it is."""
    turn, factor, shift = similarity(found, case)
    places = np.concatenate([place for _, place in found.paths.values()])
    place, angle = [], []
    for name, row in zip(found.cameras, found.rows, strict=True):
        pose, z = case.cameras[name].pose, factor * turn * complex(*row[[X, Y]]) + shift
        angle.append(angle_between(found.cameras[name], case.cameras[name], float(np.angle(turn))))
        off = np.linalg.norm([z.real, z.imag, factor * np.exp(row[HEIGHT])] - pose.translation)
        place.append(100 * off / (factor * np.hypot(*(places - row[[X, Y]]).T).mean()))
    apart = found.rows - true_rows(case, list(found.cameras))
    apart[:, YAW] = np.angle(np.exp(1j * apart[:, YAW]))
    free = np.flatnonzero(np.diag(found.covariance) > 0)
    flat = apart.ravel()[free]
    nees = float(flat @ np.linalg.pinv(found.covariance[np.ix_(free, free)], hermitian=True) @ flat) / len(free)
    sigma = np.sqrt(np.diag(found.covariance))[free]
    return {
        "focal": 100 * np.abs(apart[:, FOCAL]), "angle": np.array(angle), "place": np.array(place), "offset": np.abs(apart[:, OFFSET]),
        "scale": np.array([100 * abs(1 - factor)]), "NEES": np.array([nees]), "z": np.array([np.sqrt(((flat / sigma) ** 2).mean())]),
    }  # fmt: skip


WRONG = {"focal": 15.0, "angle": 3.0, "place": 15.0}
"""Errors above which a run has ended wrong."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--cameras", default="2,4")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--model", default="fairmot")
    chosen = parser.parse_args()
    print("kind, cameras: medians (90 %) of focal %, angle °, place %, offset s, scale %, NEES, z; s; runs that ended well, said unknown, were wrong")
    for kind in chosen.kinds.split(","):
        for count in map(int, chosen.cameras.split(",")):
            print(row_of(kind, count, chosen), flush=True)


def row_of(kind: str, count: int, chosen: argparse.Namespace) -> str:
    """A line of the table."""
    all_errors: dict[str, list[float]] = {}
    well = said = wrong = 0
    seconds = []
    for seed in range(chosen.seeds):
        case = synthetic(kind, count, seed, chosen.seconds, chosen.model)
        began = time.process_time()
        found = calibrate(case.recording)
        seconds.append(time.process_time() - began)
        if found.problems or not found.cameras:
            said += 1
            continue
        one = errors(case, found)
        well += 1
        wrong += any(float(one[name].max()) > bound for name, bound in WRONG.items())
        for name, values in one.items():
            all_errors.setdefault(name, []).extend(values.tolist())
    figures = [f"{np.median(values):.3g} ({np.quantile(values, 0.9):.3g})" for values in all_errors.values()]
    return f"{kind:7} {count}: {', '.join(figures)}; {np.median(seconds):.0f} s; {well}, {said}, {wrong}"


if __name__ == "__main__":
    main()
