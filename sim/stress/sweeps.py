"""Sweeps of one parameter each, as data, and the faults that some inject. The id `density/3` names the fourth value of the sweep `density`.

A case is a Scenario, faults, and options of the tracker. A case and a seed give one reproducible run.
Faults are view dropout, clock skew, wheel slip, a kidnapped robot, and poor knowledge of the terrain. They change recorded ticks and the setup, so
that the same run can be tracked with and without them.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from sim.datasets.presets import PRESETS
from sim.scenario import INDEPENDENT, Scenario
from tracker.detector_models.model import model_text, named_model
from tracker.geometry import Pose
from tracker.geometry.ground import Flat, Grid, Ground
from tracker.types import Detections, Setup, Tick, View

KNOWLEDGE = ("exact", "coarse", "flat", "none")
COARSE = 2.0
"""Grid spacing of a coarsely known terrain, m."""
DROPOUT_TICKS = 5
"""Mean number of consecutive ticks without a view."""
Value = int | float | str

RECORDED = "recording"
OWN_GOALS = "own goals"
POLICIES = (OWN_GOALS, "random", "static", "lloyd", "greedy", "predictive", "learned")
"""Policies that place the robots (sim.policies.rollouts). With "own goals", each robot tours goals of its own, as in all other sweeps."""


@dataclass(frozen=True)
class Faults:
    """The faults of a case.

    dropout: the share of ticks without a view, in runs of DROPOUT_TICKS on average. skew: delay of every second robot, ticks. slip: standard
    deviation of a robot's constant odometry error, as a share of the distance; half of it is added anew at each tick. kidnapped: time for which the
    first robot is carried in mid-run, s; its cameras see nothing and its wheels stand still.

    terrain: the knowledge of the ground. "exact"; "coarse", heights every 2 m without occluders; "flat", the mean height of starts; "none", z = 0.
    """

    dropout: float = 0.0
    skew: int = 0
    slip: float = 0.0
    kidnapped: float = 0.0
    terrain: str = "exact"

    def __post_init__(self) -> None:
        for name, high in (("dropout", 1.0), ("skew", 100), ("slip", 10.0), ("kidnapped", 1e6)):
            if not 0 <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name)}, needs 0 to {high:g}")
        if self.terrain not in KNOWLEDGE:
            raise ValueError(f"terrain is {self.terrain!r}, needs one of {', '.join(KNOWLEDGE)}")

    def to_dict(self) -> dict[str, Any]:
        """The fields that differ from their defaults."""
        none = asdict(Faults())
        return {name: value for name, value in asdict(self).items() if value != none[name]}

    def degraded_setup(self, setup: Setup) -> Setup:
        """The setup that the tracker gets."""
        if self.terrain == "exact":
            return setup
        return replace(setup, ground=_known_ground(setup, self.terrain), occluders=None)

    def degraded_ticks(self, setup: Setup, ticks: Sequence[Tick], seed: int) -> list[Tick]:
        """The ticks that the tracker gets. Each fault has random streams of its own."""
        out = list(ticks)
        if self.skew:
            out = _delay(setup, out, self.skew)
        if self.slip:
            out = _add_slip(setup, out, self.slip, seed)
        if self.dropout:
            out = _drop_views(setup, out, self.dropout, seed)
        if self.kidnapped:
            out = _kidnap(setup, out, round(self.kidnapped / setup.period))
        return out


def _stream(seed: int, name: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def _known_ground(setup: Setup, terrain: str) -> Ground:
    ground = setup.ground
    if terrain == "coarse" and isinstance(ground, Grid):
        rows, columns = ground.heights.shape
        wide = np.array([columns - 1, rows - 1]) * ground.spacing
        x, y = (np.arange(max(2, int(np.ceil(w / COARSE)) + 1)) * COARSE + low for w, low in zip(wide, ground.origin, strict=True))
        places = np.stack(np.meshgrid(x, y), axis=-1)
        return Grid(ground.height_at(places.reshape(-1, 2)).reshape(len(y), len(x)), ground.origin, COARSE)
    if terrain == "flat":
        places = np.array([start.T_world_robot.translation for start in setup.starts.values() if start is not None]).reshape(-1, 3)
        return Flat(float(ground.height_at(places).mean()) if len(places) else 0.0)
    return Flat(0.0)


def _blind(view: View) -> View:
    """The view with its odometry only."""
    return View(view.camera, Detections.none(), odometry=view.odometry)


def _delay(setup: Setup, ticks: list[Tick], by: int) -> list[Tick]:
    """Views of every second robot from `by` ticks before; the first ticks repeat the first view."""
    robots = list(setup.starts)
    out = []
    for k, tick in enumerate(ticks):
        views = []
        for view in tick.views:
            late = robots.index(setup.mounts[view.camera].robot) % 2
            before = ticks[max(k - by * late, 0)]
            views.append(next((v for v in before.views if v.camera == view.camera), _blind(view)))
        out.append(replace(tick, views=tuple(views)))
    return out


def _add_slip(setup: Setup, ticks: list[Tick], slip: float, seed: int) -> list[Tick]:
    streams = {robot: _stream(seed, f"{robot}/slip") for robot in setup.starts}
    constant = {robot: rng.normal(0.0, slip) for robot, rng in streams.items()}

    def worse(view: View) -> View:
        if view.odometry is None:
            return view
        robot = setup.mounts[view.camera].robot
        share = 1.0 + constant[robot] + streams[robot].normal(0.0, slip / 2)
        motion = view.odometry.T_before_now
        return replace(view, odometry=replace(view.odometry, T_before_now=Pose(motion.rotation, motion.translation * share)))

    return [replace(tick, views=tuple(worse(view) for view in tick.views)) for tick in ticks]


def _drop_views(setup: Setup, ticks: list[Tick], share: float, seed: int) -> list[Tick]:
    """Dropout as a Markov chain of two states. Views are absent for DROPOUT_TICKS on average, and for `share` of all ticks."""
    away = {}
    for camera in setup.mounts:
        draws = _stream(seed, f"{camera}/dropout").random(len(ticks) + 1)
        gone, absent = bool(draws[0] < share), []
        for draw in draws[1:]:
            absent.append(gone)
            gone = bool(draw >= 1 / DROPOUT_TICKS) if gone else bool(draw < share / max(1e-9, 1 - share) / DROPOUT_TICKS)
        away[camera] = absent
    return [replace(tick, views=tuple(_blind(v) if away[v.camera][k] else v for v in tick.views)) for k, tick in enumerate(ticks)]


def _kidnap(setup: Setup, ticks: list[Tick], length: int) -> list[Tick]:
    """From the middle of the run on, the odometry of the first robot is zero for `length` ticks, and its cameras see nothing."""
    robot, first = next(iter(setup.starts)), len(ticks) // 2

    def still(view: View) -> View:
        if setup.mounts[view.camera].robot != robot or view.odometry is None:
            return view
        return replace(_blind(view), odometry=replace(view.odometry, T_before_now=Pose.identity()))

    return [replace(t, views=tuple(still(v) for v in t.views)) if first <= k < first + length else t for k, t in enumerate(ticks)]


@dataclass(frozen=True)
class Sweep:
    """Cases that differ in one parameter.

    about: what changes, in one line. parameter: its name. values: from easy to hard. wording: a value in words, for str.format. unit: of the values.
    world: name of the world where the command has the default one, or None for that of the command.
    """

    name: str
    about: str
    parameter: str
    values: tuple[Value, ...]
    wording: str
    unit: str = ""
    world: str | None = None


SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep("density", "more people, who occlude each other", "people", (5, 10, 20, 40, 80, 150), "{} people", world="ruins"),
        Sweep("difficulty", "rougher ground, more clutter", "difficulty", (0.0, 0.25, 0.5, 0.75, 1.0), "difficulty {}"),
        Sweep("robots", "fewer robots, from seven to one", "robots", (7, 5, 4, 3, 2, 1), "team size {}"),
        Sweep("dropout", "views that are absent for about five frames at a time", "dropout", (0.0, 0.1, 0.3, 0.5, 0.7),
            "{:.0%} of views absent", "share of frames"),
        Sweep("misses", "visible people whom the detector misses", "misses", (0.0, 0.1, 0.3, 0.5, 0.7), "{:.0%} missed", "share"),
        Sweep("clutter", "false detections", "clutter", (0.0, 0.5, 1.0, 2.0, 5.0), "{:g} false boxes a view", "boxes a view and frame"),
        Sweep("box_noise", "errors of box edges", "bearing_noise", (0.0, 0.15, 0.5, 1.0, 2.0), "edges {:g}° off", "degrees"),
        Sweep("rate", "the same ten seconds in fewer frames", "rate", (12.0, 6.0, 3.0, 2.0, 1.0), "{:g} frames a second", "frames a second"),
        Sweep("slip", "wheel slip that the odometry does not report", "slip", (0.0, 0.05, 0.1, 0.2, 0.4), "{:.0%} slip", "share of the distance"),
        Sweep("skew", "delay of the clock of every second robot", "skew", (0, 1, 2, 4), "clocks {} frames late", "frames"),
        Sweep("terrain", "knowledge of the terrain", "terrain", KNOWLEDGE, "knowledge of terrain: {}"),
        Sweep("kidnapped", "one robot is carried, blind, with still wheels", "kidnapped", (0.0, 1.0, 2.0, 4.0), "{:g} s carried", "seconds"),
        Sweep("filter", "the SLAM filter and its odometry correction factor", "slam", (
            "fej, 2 iterations, correction", "fej, 2 iterations", "iekf, 2 iterations, correction", "iekf, 2 iterations",
            "ekf, correction", "ekf",
        ), "filter: {}"),
        Sweep("hypotheses", "K_H, the number of global hypotheses", "k_h", (1, 5, 10, 15, 20, 25, 30), "K_H = {}"),
        Sweep("moves", "the limit of moves of the clique search", "i_bls_max", (500, 1000, 2000), "at most {} moves"),
        Sweep("placement", "the policy that places the robots", "policy", POLICIES, "policy {}", world="ruins"),
    )
}  # fmt: skip

RECORDING_SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep("recorded_misses", "boxes of the recording that are dropped", "drop", (0.0, 0.1, 0.3, 0.5), "{:.0%} dropped", "share"),
        Sweep("recorded_clutter", "false boxes that are added to the recording", "clutter", (0, 1, 2, 4), "{} added", "boxes a view and frame"),
        Sweep("recorded_noise", "noise that is added to the boxes of the recording", "noise", (0.0, 2.0, 5.0, 10.0), "{:g} px", "pixels"),
        Sweep("recorded_dropout", "views of the recording that are absent for about five frames at a time", "dropout", (0.0, 0.1, 0.3, 0.5),
            "{:.0%} of views absent", "share of frames"),
        Sweep("recorded_cameras", "fewer cameras of the recording", "fewer", (0, 1, 2, 3), "{} cameras fewer", "cameras"),
    )
}  # fmt: skip
"""Sweeps of a recording. Values of 0 are the recording as it is. Cameras are left out from the last one on."""

ROUGH_SPEEDS = {"roughness_slow": 0.35, "roughness_usual": 0.7, "roughness_fast": 1.2}
"""Sweep → top speed of its rovers, m/s."""
CAMERA_SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep("readout", "rolling shutter: time from the first row to the last", "readout", (0.0, 0.005, 0.01, 0.02, 0.033),
            "readout of {:g} s", "s"),
        Sweep("blur", "motion blur: exposure time", "shutter", (0.0, 0.0025, 0.005, 0.01, 0.02), "exposed for {:g} s", "s"),
        Sweep("seam", "parallax at the seam of two fisheye lenses", "baseline", (0.0, 0.005, 0.01, 0.02, 0.03), "lenses {:g} m apart", "m"),
        Sweep("focal", "focal length that stitching takes for that of two lenses", "focal_error", (0.0, 0.25, 0.5, 1.0, 2.0),
            "{:g} % too long", "%"),
        Sweep("mount_angle", "calibration: mounts turned from where they are", "mount_angle", (0.0, 0.25, 0.5, 1.0, 2.0),
            "mounts {:g}° off", "degrees"),
        Sweep("mount_shift", "calibration: mounts away from where they are", "mount_shift", (0.0, 0.01, 0.02, 0.05, 0.1),
            "mounts {:g} m off", "m"),
        *(
            Sweep(name, f"rougher ground at {speed:g} m/s", "difficulty", (0.0, 0.25, 0.5, 0.75, 1.0), f"difficulty {{}} at {speed:g} m/s")
            for name, speed in ROUGH_SPEEDS.items()
        ),
    )
}  # fmt: skip
"""Sweeps of cameras, calibration and driving, for SLAM. They are run where they are named; a test of all sweeps leaves them out."""
STITCHED = "dual-fisheye:output=stitched"
IMAGE_SWEEPS = ("readout", "blur", "seam", "focal")
"""Sweeps that change pixels alone, and need rendered images."""

ROOM = "room"
"""The preset of ROOM_SWEEPS, and the source of their cases: a small room with four corner cameras and no rovers."""
ROOM_SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep("room", "more people in a room of 7.7 x 3.4 m with four corner cameras", "people", (3, 10, 15, 20), "{} people"),
        Sweep("standing", "people of this room who stand together in groups", "groups", (0.0, 0.25, 0.5, 0.75, 1.0), "{:.0%} stand", "share"),
        Sweep("detectors", "detectors by name, before ten people in this room", "detector_model", (
            INDEPENDENT, "fairmot", "pets-det", "keypoint-rcnn", "faster-rcnn", "pixels",
        ), "detector: {}"),
        Sweep("lasting", "places of lasting false boxes of faster-rcnn in each view of this room", "sites", (0.0, 1.0, 2.0, 4.0, 8.0),
            "{:g} places a view", "places a view"),
    )
}  # fmt: skip
"""Sweeps that are run by name only. They have cameras of their own, and are never rendered."""
KNOWN_SWEEPS = SWEEPS | RECORDING_SWEEPS | CAMERA_SWEEPS | ROOM_SWEEPS

DETECTOR_SWEEPS = ("misses", "clutter", "box_noise", "detectors", "lasting")
"""Sweeps that set the detector or its errors, so that they exclude another detector model."""
FAULT_SWEEPS = ("dropout", "slip", "skew", "terrain", "kidnapped")
TRACKER_SWEEPS = ("filter", "hypotheses", "moves")
SATURATED = 0.98
"""A sweep whose MOTA and IDF1 are all above this does not show where a tracker breaks."""


@dataclass(frozen=True)
class Case:
    """One value of one sweep: a Scenario, faults, and options of the tracker (TrackerUnderTest) as JSON values. `with_seed` sets the seed.

    policy: one of POLICIES in the sweep over policies, "" in all others. source: "" for a simulated run, "pets" for the PETS 2009 sequence in
    `folder`, "twin" for its twin. "room" is a simulated run of that preset, with its cameras.
    "recording" stands for any other recording in `folder`, with its first `scenario.frames` frames.
    """

    id: str
    sweep: str
    parameter: str
    value: Value
    scenario: Scenario
    faults: Faults = field(default_factory=Faults)
    options: dict[str, Value] = field(default_factory=dict)
    policy: str = ""
    source: str = ""
    folder: str = ""

    def with_seed(self, seed: int) -> Case:
        """The case with the seed of its scenario set."""
        return replace(self, scenario=replace(self.scenario, seed=seed))

    def to_json(self) -> str:
        """One line of JSON, as `stress --list --json` prints it."""
        plain = {name: getattr(self, name) for name in ("id", "sweep", "parameter", "value", "options", "policy", "source", "folder")}
        return json.dumps(plain | {"scenario": json.loads(self.scenario.to_json()), "troubles": self.faults.to_dict()})


def default_scenario(frames: int = 60, width: int = 512) -> Scenario:
    """The scenario that all sweeps start from: ten seconds of ten people and four rovers."""
    return Scenario(frames=frames, width=width)


def cases(names: Iterable[str], start: Scenario) -> list[Case]:
    """The cases of the named sweeps, or single ones, as density/3; all cases where there are no names.

    Raises ValueError for an unknown name, with a list of the known ones, and for a sweep of DETECTOR_SWEEPS with a detector model.
    """
    out, simulated = dict[str, Case](), SWEEPS | CAMERA_SWEEPS | ROOM_SWEEPS
    modelled = start.detector_model != INDEPENDENT
    for sweep, k in _chosen(list(names) or [name for name in SWEEPS if not (modelled and name in DETECTOR_SWEEPS)], simulated):
        if modelled and sweep.name in DETECTOR_SWEEPS:
            raise ValueError(f"--sweep {sweep.name} varies the independent detector, and --detector-model has errors of its own")
        out[f"{sweep.name}/{k}"] = _case(sweep, k, start)
    return list(out.values())


def _chosen(names: Iterable[str], known: Mapping[str, Sweep], beside: str = "") -> Iterator[tuple[Sweep, int]]:
    """Sweep and number of each named value; a name without a number means all values. Raises ValueError for an unknown name or number."""
    for name in names:
        sweep, _, number = name.partition("/")
        if sweep not in known:
            raise ValueError(f"--sweep is {name!r}, needs one of {', '.join(known)}{beside}")
        count = len(known[sweep].values)
        if number and not (number.isdecimal() and int(number) < count):
            raise ValueError(f"--sweep is '{sweep}/{number}', needs {sweep}/0 to {sweep}/{count - 1}")
        yield from ((known[sweep], k) for k in ([int(number)] if number else range(count)))


def _case(sweep: Sweep, number: int, start: Scenario) -> Case:
    value = sweep.values[number]
    if sweep.name in ROOM_SWEEPS:
        return _room_case(sweep, number, start)
    scenario, faults, options = start, Faults(), dict[str, Value]()
    if sweep.world and start.world == Scenario.world:
        scenario = replace(scenario, world=sweep.world)
    if sweep.name in FAULT_SWEEPS:
        faults = Faults(**{sweep.parameter: value})  # type: ignore[arg-type]
    elif sweep.name in TRACKER_SWEEPS:
        options = _options(sweep.name, value)
    elif sweep.name == "placement":
        return Case(f"{sweep.name}/{number}", sweep.name, sweep.parameter, value, scenario, policy=str(value))
    elif sweep.name == "rate":
        scenario = replace(scenario, rate=float(value), frames=max(2, round(start.frames * float(value) / start.rate)))
    elif sweep.name == "box_noise":
        scenario = replace(scenario, bearing_noise=float(np.radians(float(value))))
    elif sweep.name in ("seam", "focal"):
        scenario = replace(scenario, camera=_stitched(sweep, start.camera, value))
    elif sweep.name in CAMERA_SWEEPS and sweep.parameter != "difficulty":
        # The value 0 means no effect.
        effects = [*_without(start.effects, sweep.parameter), *([f"{sweep.parameter}={value}"] if value else [])]
        scenario = replace(scenario, effects=",".join(effects))
    else:
        scenario = replace(scenario, **{sweep.parameter: value}, speed=ROUGH_SPEEDS.get(sweep.name, scenario.speed))  # type: ignore[arg-type]
    return Case(f"{sweep.name}/{number}", sweep.name, sweep.parameter, value, scenario, faults, options)


def _stitched(sweep: Sweep, camera: str, value: Value) -> str:
    """The text of a dual fisheye camera with this option. Raises ValueError for another camera."""
    if camera and not camera.startswith("dual-fisheye"):
        raise ValueError(f"--sweep {sweep.name} needs --camera dual-fisheye or none, got {camera[:40]!r}")
    model, _, options = (camera or STITCHED).partition(":")
    return f"{model}:{','.join([*_without(options, sweep.parameter), f'{sweep.parameter}={value}'])}"


def _without(text: str, name: str) -> list[str]:
    """The items NAME=VALUE of a text, without that of a parameter that the sweep sets."""
    return [item for item in text.split(",") if item.strip() and item.partition("=")[0].strip().replace("-", "_") != name]


def _room_case(sweep: Sweep, number: int, start: Scenario) -> Case:
    """A case of ROOM_SWEEPS: the preset, as long as the start, with its seed and detector."""
    value = sweep.values[number]
    scenario = replace(PRESETS[ROOM].scenario, frames=start.frames, width=start.width, seed=start.seed, detector_model=start.detector_model)
    if sweep.name == "lasting":
        model = named_model("faster-rcnn")
        changed = replace(model, standing=replace(model.standing, sites=float(value)))
        scenario = replace(scenario, detector_model=model_text(changed))
    else:
        scenario = replace(scenario, **{sweep.parameter: value})  # type: ignore[arg-type]
    return Case(f"{sweep.name}/{number}", sweep.name, sweep.parameter, value, scenario, source=ROOM)


def _options(sweep: str, value: Value) -> dict[str, Value]:
    """Options of the tracker at a value of one of TRACKER_SWEEPS."""
    if sweep == "filter":
        mode, *rest = str(value).split(", ")
        out: dict[str, Value] = {"slam": mode, "correction": "on" if "correction" in rest else "off"}
        return out | ({"iterations": 2} if mode != "ekf" else {})
    return {"k_h" if sweep == "hypotheses" else "i_bls_max": value}


def recording_cases(names: Iterable[str], folder: str, cameras: int, start: Scenario) -> list[Case]:
    """The cases of RECORDING_SWEEPS for the recording in `folder`. cameras: their number. names: of sweeps or single cases; empty for all sweeps.

    Raises ValueError for an unknown name. Cases that would leave no camera are left out.
    """
    out: dict[str, Case] = {}
    for sweep, k in _chosen(list(names) or RECORDING_SWEEPS, RECORDING_SWEEPS, " with --recording"):
        value, name = sweep.values[k], f"{sweep.name}/{k}"
        if sweep.parameter != "fewer" or int(value) < cameras:
            faults = Faults(dropout=float(value)) if sweep.parameter == "dropout" else Faults()
            out[name] = Case(name, sweep.name, sweep.parameter, value, start, faults, source=RECORDED, folder=folder)
    return list(out.values())


def pets_cases(folder: str, start: Scenario) -> list[Case]:
    """A PETS 2009 sequence and its twin."""
    sources = {"real": "pets", "twin": "twin"}
    return [Case(f"pets/{name}", "pets", "source", name, start, source=source, folder=folder) for name, source in sources.items()]


def saturated(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Names of sweeps of at least two values whose scores are all above SATURATED, in the order of the rows.

    rows: of results.jsonl. Rows with an error or without scores are ignored.
    """
    scores: dict[str, list[float]] = {}
    values: dict[str, set[str]] = {}
    for row in rows:
        found = [row["scores"].get(name) for name in ("mota", "idf1")] if row.get("scores") else []
        known = [score for score in found if score is not None]
        if known:
            scores.setdefault(row["sweep"], []).extend(known)
            values.setdefault(row["sweep"], set()).add(row["id"])
    return [name for name, known in scores.items() if len(values[name]) > 1 and min(known) > SATURATED]
