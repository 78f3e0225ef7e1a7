"""Calibration from people alone, against the exact truth: rooms, halls and squares with 2 to 8 cameras, none of them calibrated.

Real principal points are not in the middle of the image, and lenses bend lines a little: so do those here, by draws of LENS.
Seeds below 10 were developed on. `--each` prints a line of JSON for each run; `--plot FILE.png RUNS.jsonl …` draws errors of such lines
against people, time, cameras, overlap and detector.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from sim.tuning.kinds import corner_cameras, mast_cameras
from sim.tuning.population import STATURE, STATURES
from sim.tuning.walks import STEPS, Habits, Walkers, floor, furniture, walks
from tracker.calibration import Calibration, calibrate
from tracker.calibration.body import CX, CY, FOCAL, HEIGHT, K1, MOST_BENT, OFFSET, PITCH, ROLL, YAW, X, Y, angles_of, corner_of
from tracker.detector_models.model import named_model
from tracker.detector_models.observations import TruePeople
from tracker.detector_models.simulation import simulated_detections
from tracker.geometry import Array
from tracker.geometry.cameras import Camera, Pinhole
from tracker.geometry.ground import Grid
from tracker.recordings import Recording, RecordingCamera

KINDS = {
    "room": ((6.0, 10.0), (4.0, 6.0)),
    "hall": ((14.0, 26.0), (9.0, 16.0)),
    "square": ((16.0, 30.0), (12.0, 24.0)),
    "low": ((16.0, 30.0), (12.0, 24.0)),
    "crowded": ((6.0, 10.0), (4.0, 6.0)),
    "uneven": ((16.0, 30.0), (12.0, 24.0)),
}
"""Ranges of length and width, m. `low` is a square whose cameras stand as high as heads are, on tripods. `crowded` is a room with people 0.7 m apart
in the mean, and `uneven` a square on ground that rises and falls."""
DENSITY = 0.5
"""People a square metre in a crowded room: their nearest neighbours are 0.7 m away in the mean."""
LENS = (0.02, 0.04)
"""Deviations of principal points from the middle, over the width of the image, and of corners by k1, over their distance from the middle."""
ROUGH, WAVE = (0.05, 0.15), 6.0
"""m: deviation of the heights of uneven ground, and the length over which they are alike."""


@dataclass(frozen=True, eq=False)
class Synthetic:
    """A recording without calibration, its true cameras, and by how many s the clock of each is late.

    people: at once, in the mean. overlap: of the other cameras, the share in whose images a person is whom one camera has in its own.
    """

    recording: Recording
    cameras: dict[str, RecordingCamera]
    offsets: dict[str, float]
    people: float = 0.0
    overlap: float = 0.0


def synthetic(kind: str, cameras: int, seed: int, seconds: float = 90.0, model: str = "fairmot", people: int | None = None) -> Synthetic:
    """A case: people who walk, stand in groups, come and go, seen by a fitted detector; clocks off by up to a second."""
    rng = np.random.default_rng([seed, cameras, list(KINDS).index(kind)])
    size = tuple(float(rng.uniform(*bounds)) for bounds in KINDS[kind])
    rate = float(rng.choice([4.0, 5.0, 10.0]))
    frames = round(seconds * rate)
    around = floor(np.array([(0.0, 0.0), size]), furniture(size, 0.01, rng), 2, rng)
    numbers = {"room": int(rng.integers(4, 11)), "hall": int(rng.integers(6, 20)), "crowded": round(DENSITY * size[0] * size[1])}
    at_once = numbers.get(kind, int(rng.integers(6, 24))) if people is None else people
    own = np.random.default_rng([seed, cameras, list(KINDS).index(kind), 1])
    around = replace(around, ground=_uneven(size, own)) if kind == "uneven" else around
    true = corner_cameras(size, cameras, rng) if kind in ("room", "hall", "crowded") else mast_cameras(around, cameras, rng)
    true = [on_tripod(camera, rng) for camera in true] if kind == "low" else true
    true = [replace(camera, camera=off_centre(camera.camera, own)) for camera in true]
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
        places: dict[int, tuple[Any, Array]] = {}
        for frame in range(frames):
            step = STEPS * (frame + slack) + late[name]
            here = np.flatnonzero(np.isfinite(walked.place[step]).all(axis=1))
            places[frame] = here + 1, np.column_stack([walked.place[step, here], around.ground.height_at(walked.place[step, here])])
        seen = Recording(rate, {name: camera}, {name: {}}, places, frames=frames, ground=around.ground, pillars=around.pillars)
        detections |= simulated_detections(seen, TruePeople(places, {}, heights=heights), named_model(model), seed)
    blind = {name: unknown(camera) for name, camera in named.items()}
    everybody = np.concatenate([place for _, place in places.values()])
    offsets = {name: k / STEPS / rate for name, k in late.items()}
    return Synthetic(Recording(rate, blind, detections, frames=frames), named, offsets, len(everybody) / frames, overlap_of(named, everybody))


def overlap_of(cameras: dict[str, RecordingCamera], people: Array) -> float:
    """Of the other cameras, the share in whose images the feet (n, 3) m are that are in the image of one."""
    inside = []
    for camera in cameras.values():
        ray = (people - camera.pose.translation) @ camera.pose.rotation
        pixels, valid = camera.camera.pixels_from_bearings(ray / np.linalg.norm(ray, axis=1, keepdims=True))
        size = [camera.camera.width, camera.camera.height]
        inside.append(valid & (pixels > 0).all(axis=1) & (pixels < size).all(axis=1))
    seen = np.sum(inside, axis=0)
    return float((seen[seen > 0] - 1).mean() / max(len(cameras) - 1, 1))


def off_centre(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera with a principal point off the middle of the image, and a lens that bends lines."""
    assert isinstance(camera, Pinhole)
    (x, y), bent = rng.normal(0.0, LENS[0] * camera.width, 2), float(rng.normal(0.0, LENS[1]))
    moved = replace(camera, cx=camera.cx + float(x), cy=camera.cy + float(y))
    return replace(moved, distortion=(max(bent, -MOST_BENT) / corner_of(moved) ** 2, 0.0, 0.0, 0.0, 0.0))


def _uneven(size: tuple[float, float], rng: np.random.Generator) -> Grid:
    """Ground of height 0 in the mean, 10 m beyond a place of `size` m on all sides."""
    rows, columns = (round(side) + 21 for side in size[::-1])
    heights = gaussian_filter(rng.normal(size=(rows, columns)), WAVE / 2)
    heights = (heights - heights[10:-10, 10:-10].mean()) / heights[10:-10, 10:-10].std()
    return Grid(rng.uniform(*ROUGH) * heights, np.array([-10.0, -10.0]), 1.0)


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


def lens_row(camera: Camera, guess: Camera) -> Array:
    """Focal length, principal point and k1 (4,) of a camera as parameters beside a guess of it."""
    out = np.array([np.log(focal_of(camera) / focal_of(guess)), 0.0, 0.0, 0.0])
    if isinstance(camera, Pinhole) and isinstance(guess, Pinhole):
        out[[CX, CY]] = (camera.cx - guess.cx) / guess.width, (camera.cy - guess.cy) / guess.width
        out[K1] = camera.distortion[0] - guess.distortion[0]
    return out


def true_rows(case: Synthetic, names: list[str]) -> Array:
    """Parameters (cameras, 11) of the true cameras, in the frame of the first one."""
    out, first = [], case.cameras[names[0]]
    yaw = angles_of(first.pose.rotation)[2]
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    for name in names:
        camera, row = case.cameras[name], np.zeros(11)
        pitch, roll, own = angles_of(camera.pose.rotation)
        row[: K1 + 1] = lens_row(camera.camera, case.recording.cameras[name].camera)
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
    """Errors of cameras (n,) after the best similarity: focal %, angles °, place in % of the mean distance of people, offset s; NEES without lenses.

    silent (n,): 1 for cameras that are wrong in silence. z (11,): root mean square errors of parameters over their stated deviations.
    """
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
    estimated = ~np.isin(np.arange(apart.size) % apart.shape[1], [CX, CY, K1])
    free = np.flatnonzero((np.diag(found.covariance) > 0) & estimated)
    flat = apart.ravel()[free]
    nees = float(flat @ np.linalg.pinv(found.covariance[np.ix_(free, free)], hermitian=True) @ flat) / len(free)
    one = {
        "focal": 100 * np.abs(apart[:, FOCAL]), "angle": np.array(angle), "place": np.array(place), "offset": np.abs(apart[:, OFFSET]),
        "scale": np.array([100 * abs(1 - factor)]), "NEES": np.array([nees]),
    }  # fmt: skip
    sigma = np.sqrt(np.maximum(np.diag(found.covariance), 0.0)).reshape(apart.shape)
    beyond = np.abs(apart) > SIGMAS * np.where(sigma > 0, sigma, np.inf)
    silent = np.zeros(len(apart), dtype=bool)
    for name, (bound, own) in WANTED.items():
        silent |= (one[name] > bound) & beyond[:, own].any(axis=1)
    ratio = np.divide(apart, sigma, out=np.zeros(apart.shape), where=sigma > 0)
    return one | {"silent": silent.astype(np.float64), "z": np.sqrt((ratio**2).mean(axis=0))}


WANTED = {"focal": (3.0, [FOCAL]), "angle": (0.5, [PITCH, ROLL, YAW]), "place": (2.0, [X, Y, HEIGHT])}
"""Bounds of errors, and the parameters by which they are stated."""
SIGMAS = 3.0
"""A run has ended wrong in silence where an error is over its bound and over so many stated deviations."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--cameras", default="2,4")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--model", default="fairmot")
    parser.add_argument("--people", type=int, default=None, help="at once; drawn for each case by default")
    parser.add_argument("--each", action="store_true", help="a line of JSON for each run, too")
    parser.add_argument("--plot", nargs="+", type=Path, metavar="FILE", help="draw FILE.png from lines of JSON in the other files")
    chosen = parser.parse_args()
    if chosen.plot:
        draw(chosen.plot[0], [json.loads(line) for path in chosen.plot[1:] for line in path.read_text().splitlines() if line.startswith("{")])
        return
    print("kind, cameras: medians (90 %) of focal %, angle °, place %, offset s, scale %, NEES; s; runs: well, said unknown, wrong in silence")
    for kind in chosen.kinds.split(","):
        for count in map(int, chosen.cameras.split(",")):
            runs = [run_of(kind, count, seed, chosen) for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds)]
            print(row_of(kind, count, runs), flush=True)


def run_of(kind: str, count: int, seed: int, chosen: argparse.Namespace) -> dict[str, Any]:
    """Errors of a run, processor time s, and what it says that it does not know."""
    case = synthetic(kind, count, seed, chosen.seconds, chosen.model, chosen.people)
    began = time.process_time()
    found = calibrate(case.recording)
    run: dict[str, Any] = {"kind": kind, "cameras": count, "seed": seed, "s": time.process_time() - began, "problems": list(found.problems)}
    run |= {"seconds": chosen.seconds, "model": chosen.model, "people": round(case.people, 1), "overlap": round(case.overlap, 3)}
    if len(found.cameras) > 1:
        run |= {name: np.round(values, 4).tolist() for name, values in errors(case, found).items()}
    if chosen.each:
        print(json.dumps(run), flush=True)
    return run


def row_of(kind: str, count: int, runs: list[dict[str, Any]]) -> str:
    """A line of the table: of the runs that ended well, but for times."""
    well = [run for run in runs if not run["problems"] and "focal" in run]
    pooled = {name: np.concatenate([run[name] for run in well]) for name in ("focal", "angle", "place", "offset", "scale", "NEES") if well}
    figures = [f"{np.median(values):.3g} ({np.quantile(values, 0.9):.3g})" for values in pooled.values()]
    wrong = sum(max(run["silent"]) > 0 for run in well)
    seconds = np.median([run["s"] for run in runs])
    return f"{kind:7} {count}: {', '.join(figures)}; {seconds:.0f} s; {len(well)}, {len(runs) - len(well)}, {wrong}"


PANELS = (
    ("people", "people at once", (3, 6, 12, 24)),
    ("seconds", "s", (30, 60, 120, 240)),
    ("cameras", "cameras", ()),
    ("overlap", "overlap", (0.25, 0.5, 0.75)),
)
"""Field of a run, its label, and the bounds of classes of it."""
SHOWN = {"focal": "focal length %", "angle": "angle °", "place": "place %"}


def draw(path: Path, runs: list[dict[str, Any]]) -> None:
    """Medians, and quartiles as bars, of the errors of cameras against what they depend on, and of each detector; runs that say nothing is wrong."""
    well = [run for run in runs if not run["problems"] and "focal" in run]
    usual = [run for run in well if run["model"] == "fairmot"]
    figure = matplotlib.figure.Figure(figsize=(15, 3.8), layout="constrained")
    axes = figure.subplots(1, len(PANELS) + 1, sharey=True)
    for panel, (field, label, bounds) in zip(axes, PANELS, strict=False):
        of = [int(np.searchsorted(bounds, run[field], side="right")) if bounds else run[field] for run in usual]
        groups = {k: [run for run, own in zip(usual, of, strict=True) if own == k] for k in sorted(set(of))}
        _panel(panel, {np.mean([run[field] for run in group]): group for group in groups.values()}, label)
        panel.set_xscale("linear" if field == "overlap" else "log")
        panel.set_xticks(ticks := [float(f"{np.mean([run[field] for run in group]):.2g}") for group in groups.values()], [f"{t:g}" for t in ticks])
        panel.set_xticks([], minor=True)
    models = sorted({run["model"] for run in well})
    _panel(axes[-1], {k: [run for run in well if run["model"] == model] for k, model in enumerate(models)}, "detector")
    axes[-1].set_xticks(range(len(models)), models)
    axes[-1].margins(x=0.3)
    axes[0].set_ylabel("error, median and quartiles")
    axes[0].legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=100)


def _panel(axes: Any, groups: dict[Any, list[dict[str, Any]]], label: str) -> None:
    for name, words in SHOWN.items():
        low, middle, high = np.array([np.quantile(np.concatenate([run[name] for run in group]), [0.25, 0.5, 0.75]) for group in groups.values()]).T
        axes.errorbar(list(groups), middle, (middle - low, high - middle), marker="o", markersize=4, linewidth=1, capsize=2, label=words)
    axes.set_xlabel(label)
    axes.set_yscale("log")
    axes.set_yticks(ticks := [0.2, 0.5, 1.0, 2.0, 5.0, 10.0], [f"{t:g}" for t in ticks])
    axes.set_yticks([], minor=True)
    axes.grid(color="#e3e5e8", linewidth=0.6)


if __name__ == "__main__":
    main()
