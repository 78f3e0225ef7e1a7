"""Scenario: all parameters of a run as one value, with conversion to and from JSON.

The same scenario gives the same truth, odometry and detections on every machine.
"""

from __future__ import annotations

import dataclasses
import json
import math
import zlib
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any, get_origin, get_type_hints

import numpy as np

from sim.cameras import EQUIRECTANGULAR, Rig, parse_camera
from sim.cameras.view_clock import parse_view_clocks
from sim.effects import Effects, parse_effects
from sim.robots.clock import parse_clocks
from sim.robots.imu import IMU_RATES, WHEEL_RATES, parse_imu, steps_a_sample
from sim.robots.robot_choice import ROVER, parse_robots

CROWD_STEP = 0.05
"""s: nominal step of the crowd and of commands. The nearest step that divides a frame is used."""
INDEPENDENT = "independent"
"""The detector model that uses the fields misses, clutter, bearing_noise and min_visible."""
PLAIN_CLOTHING, VARIED_CLOTHING = "plain", "varied"
BUILT_LIGHT, LAMPS = "built", "lamps"
LIGHTS = (BUILT_LIGHT, "overcast", "low", "dim", LAMPS)
"""Kinds of light, as sim.simulation.lighting makes them."""
Share = Annotated[float, (0.0, 1.0)]
"""A field with its lowest and highest value, both included."""


@dataclass(frozen=True)
class Scenario:
    """Parameters of a simulation and of its sensors.

    world: a name of worlds.catalogue. difficulty: in [0, 1]. seed: of all random streams. frames: number of frames. rate: frames/s.
    people: number of people in the whole run. children: share of them who are children (1.1 to 1.5 m tall; adults 1.5 to 2 m).
    at_once: how many people are present at once, entering and leaving through spawn areas; 0 means all of them throughout.
    width: of the panorama, px; its height is half of it. camera_height: m above the ground.
    timestep: of the physics, s; the nearest value that divides the crowd's step is used.
    Images: exposure is the sigma of its slow drift in stops, image_noise the sigma of every pixel and channel in counts of 255.
    Detector: misses is the share of visible people not detected, clutter the mean number of false detections a view and frame.
    bearing_noise is one sigma of a box's edge, rad; a body with a smaller visible fraction than min_visible is never detected.
    Sensors of the robots, off by default: imu is NAME or NAME@HZ with a part of sim.robots.imu. wheels is the rate of the encoders, Hz.
    clock has the errors of the clocks of robots and cameras, as sim.robots.clock.parse_clocks reads them.
    detector_model: "independent" for these errors. A model of tracker.detector_models replaces them, by its name or as JSON.
    camera, view_camera: models of the rovers' and the fixed cameras, as sim.cameras.parse_camera reads them; "" for panoramas and Tsai's model.
    effects: errors of the cameras, as sim.effects.parse_effects reads them, or a list of such texts; "" for none.
    distractors: number of things placed in the world that detectors take for people, as cones and coat stands; 0 by default.
    groups: share of the people who stand together and talk, 2 to 5 a group. sitting: share of those present who sit; both 0 by default.
    clothing: plain, or varied: mostly dark, with long coats, long skirts, hoods and loose hair.
    umbrellas: probability that a person who does not sit carries one, 0 by default.
    light: one of LIGHTS. built: the light of the world. lamps: room lamps in place of the sun. wet: how wet the ground is, 0 by default.
    facades: number of buildings with windows around the world. glare: probability that a window of theirs mirrors the sun, or is lit from inside.
    view_clock: when fixed cameras take their pictures, as sim.cameras.view_clock.parse_view_clocks reads it; "" for one at each frame.
    robot: in place of rovers, names and files of robots as sim.robots.robot_choice.parse_robots reads them, repeated; "" for rovers.
    speed: top speed of rovers that drive to goals of their own, m/s.
    Raises ValueError with name, value and bound for any field out of its bounds, NaN included.
    """

    world: str = "pilsun"
    difficulty: Share = 0.5
    seed: Annotated[int, (0, 2**63 - 1)] = 0
    robots: Annotated[int, (0, 64)] = 4
    people: Annotated[int, (0, 1000)] = 10
    at_once: Annotated[int, (0, 1000)] = 0
    children: Share = 0.0
    frames: Annotated[int, (1, 1_000_000)] = 60
    rate: Annotated[float, (0.5, 60.0)] = 6.0
    width: Annotated[int, (64, 8192)] = 1024
    camera_height: Annotated[float, (0.5, 3.0)] = 1.5
    timestep: Annotated[float, (0.0005, 0.01)] = 0.005
    exposure: Annotated[float, (0.0, 4.0)] = 0.0
    image_noise: Annotated[float, (0.0, 100.0)] = 0.0
    misses: Share = 0.1
    clutter: Annotated[float, (0.0, 100.0)] = 0.05
    bearing_noise: Annotated[float, (0.0, math.radians(10.0))] = math.radians(0.15)
    min_visible: Share = 0.2
    # Optional fields, whose defaults switch them off.
    _: KW_ONLY
    imu: str = ""
    wheels: float = 0.0
    clock: str = ""
    detector_model: str = INDEPENDENT
    camera: str = ""
    view_camera: str = ""
    effects: str = ""
    distractors: Annotated[int, (0, 500)] = 0
    groups: Share = 0.0
    sitting: Share = 0.0
    clothing: str = PLAIN_CLOTHING
    umbrellas: Share = 0.0
    light: str = BUILT_LIGHT
    wet: Share = 0.0
    speed: Annotated[float, (0.1, 1.5)] = 0.7
    facades: Annotated[int, (0, 60)] = 0
    glare: Share = 0.0
    view_clock: str = ""
    robot: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.effects, (list, tuple)) and all(isinstance(one, str) for one in self.effects):
            object.__setattr__(self, "effects", ",".join(self.effects))
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.type == "str" and not isinstance(value, str):
                raise ValueError(f"{field.name} is {repr(value)[:60]}, needs a text")
            if field.name in BOUNDS:
                object.__setattr__(self, field.name, bounded(field.name, value, BOUNDS[field.name], whole=isinstance(field.default, int)))
        if not self.world:
            raise ValueError("world is '', needs a name")
        if self.width % 2:
            raise ValueError(f"width is {self.width} px, needs an even number")
        self._check_sensors()
        self._check_cameras()
        if self.detector_model != INDEPENDENT:
            # Imported on demand: most scenarios have none.
            from tracker.detector_models.model import model_of

            model_of(self.detector_model)

    def _check_sensors(self) -> None:
        if isinstance(self.wheels, bool) or not isinstance(self.wheels, (int, float, np.integer, np.floating)):
            raise ValueError(f"wheels is {repr(self.wheels)[:60]}, needs a number of Hz")
        object.__setattr__(self, "wheels", float(self.wheels))
        if self.clothing not in (PLAIN_CLOTHING, VARIED_CLOTHING):
            raise ValueError(f"clothing is {repr(self.clothing)[:60]}, needs {PLAIN_CLOTHING} or {VARIED_CLOTHING}")
        if self.light not in LIGHTS:
            raise ValueError(f"light is {repr(self.light)[:60]}, needs one of {', '.join(LIGHTS)}")
        if self.groups + self.sitting > 1:
            raise ValueError(f"groups and sitting are {self.groups:g} and {self.sitting:g}, need shares of at most 1 together")
        if self.glare and not self.facades:
            raise ValueError(f"glare is {self.glare:g} and facades is 0, needs the facades whose windows glare")
        if self.robot and {choice.source for choice in parse_robots(self.robot)} != {ROVER} and self.wheels:
            raise ValueError(f"wheels is {self.wheels:g} and robot is {self.robot[:60]!r}, but encoders are tables of rovers alone")
        _ = self.imu_steps, self.wheel_steps
        if self.view_clock:
            parse_view_clocks(self.view_clock, self.rate)
        if self.clock:
            own = {f"robot_{i}{part}" for i in range(self.robots) for part in ("", "_camera")}
            for name in parse_clocks(self.clock):
                # Names of fixed cameras are checked where their number is known.
                if name and name not in own and not name.startswith("View_"):
                    raise ValueError(f"clock names {name[:60]!r}, needs a robot or a camera, as robot_0, robot_0_camera or View_001")

    def _check_cameras(self) -> None:
        if self.camera.strip() == EQUIRECTANGULAR:
            object.__setattr__(self, "camera", "")
        for text, width in ((self.camera, self.width), (self.view_camera, self.view_width)):
            if text:
                Rig.of(text, width)
        effects = self.camera_effects
        effects.check_period(self.period)
        if effects.gain is not None and self.image_noise:
            raise ValueError("effects have gain and image_noise is not 0: both are noise of the sensor, needs one of them")
        if effects.seam is not None and not any(text and parse_camera(text).model == "dual-fisheye" for text in (self.camera, self.view_camera)):
            raise ValueError("effects have seam, needs a camera with two lenses (dual-fisheye)")

    @property
    def camera_effects(self) -> Effects:
        """The errors of the cameras."""
        return parse_effects(self.effects)

    @property
    def sitters(self) -> int:
        """Number of people who sit."""
        return round(self.sitting * min(self.at_once or self.people, self.people))

    @property
    def view_width(self) -> int:
        """Width of the pictures of fixed cameras, px."""
        return 2 * round(0.375 * self.width)

    @property
    def crowd_steps(self) -> int:
        """Number of steps of the crowd and of commands in a frame."""
        return max(1, round(self.period / CROWD_STEP))

    @property
    def substeps(self) -> int:
        """Number of physics steps in a step of the crowd."""
        return max(1, round(self.period / self.crowd_steps / self.timestep))

    @property
    def physics_rate(self) -> float:
        """Physics steps a second."""
        return self.rate * self.crowd_steps * self.substeps

    @property
    def imu_steps(self) -> int:
        """Physics steps between samples of the IMU; 0 without one."""
        return steps_a_sample("imu", parse_imu(self.imu)[1], self.physics_rate, IMU_RATES) if self.imu else 0

    @property
    def wheel_steps(self) -> int:
        """Physics steps between samples of the wheel encoders; 0 without them."""
        return steps_a_sample("wheels", self.wheels, self.physics_rate, WHEEL_RATES) if self.wheels else 0

    @property
    def height(self) -> int:
        """Height of the panorama, px."""
        return self.width // 2

    @property
    def period(self) -> float:
        """s between frames."""
        return 1.0 / self.rate

    def check_any_camera(self, fixed: int) -> None:
        """Raise ValueError where there is neither a robot nor a fixed camera. fixed: number of fixed cameras."""
        if not (self.robots or fixed):
            raise ValueError(f"robots is 0, needs a whole number in [1, {BOUNDS['robots'][1]:g}] where there is no fixed camera")

    def stream(self, name: str) -> np.random.Generator:
        """The random stream of that name, seeded by (seed, crc32(name)). Streams are independent of each other."""
        return np.random.default_rng([self.seed, zlib.crc32(name.encode())])

    def to_json(self) -> str:
        """One JSON object with a key for each field that is not OPTIONAL or is switched on, and floats as their shortest exact decimals."""
        fields = {name: value for name, value in dataclasses.asdict(self).items() if name not in OPTIONAL or value != OPTIONAL[name]}
        return json.dumps(fields, indent=2, allow_nan=False) + "\n"

    @staticmethod
    def from_json(text: str) -> Scenario:
        """Inverse of to_json. Raises ValueError if the text is no object, or a field is unknown, missing or out of bounds."""
        content = json.loads(text)
        if not isinstance(content, dict):
            raise ValueError(f"scenario is a JSON {type(content).__name__}, needs an object")
        names = [field.name for field in dataclasses.fields(Scenario)]
        unknown, missing = sorted(set(content) - set(names)), [name for name in names if name not in content and name not in OPTIONAL]
        if unknown:
            raise ValueError(f"scenario has unknown fields {unknown}, knows {names}")
        if missing:
            raise ValueError(f"scenario lacks the fields {missing}, needs all of {names}")
        return Scenario(**content)


OPTIONAL = {field.name: field.default for field in dataclasses.fields(Scenario) if field.kw_only}
"""Optional fields with the values that switch them off. The JSON of a scenario holds only those that are switched on."""
_HINTS = get_type_hints(Scenario, include_extras=True)
BOUNDS: dict[str, tuple[float, float]] = {name: hint.__metadata__[0] for name, hint in _HINTS.items() if get_origin(hint) is Annotated}
"""Lowest and highest value of every numeric field, both included."""


def bounded(name: str, value: Any, bound: tuple[float, float], whole: bool) -> float:
    """`value` as an int or a float. Raises ValueError if it is not a number within the bound, lowest and highest value."""
    low, high = bound
    fits = isinstance(value, (int, np.integer)) if whole else isinstance(value, (int, float, np.integer, np.floating))
    if not fits or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"{name} is {repr(value)[:60]}, needs {'a whole number' if whole else 'a number'} in [{low:g}, {high:g}]")
    return int(value) if whole else float(value)
