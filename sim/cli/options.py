"""Helpers and options that several commands share. Most options are fields of a scenario; None keeps the value of the preset."""

from __future__ import annotations

import dataclasses
import re
import shlex
from collections.abc import Container, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import UseAppendAction, arg

from tracker.options import unset

if TYPE_CHECKING:
    import numpy as np

__all__ = ["DetectorModelName", "Out", "changed_options", "command_line", "ground_area", "json_text", "locked", "options_of", "print_place", "unset"]

Out = Annotated[Path, arg(metavar="DIR")]
_OWN = "the preset's"
Word = Annotated[str | None, unset("NAME", _OWN)]
Whole = Annotated[int | None, unset("INT", _OWN)]
Number = Annotated[float | None, unset("FLOAT", _OWN)]


def print_place(sequence: Path) -> None:
    """Print what was read, guessed or left out, where the place of a sequence was made from a user's file."""
    if (file := sequence / "place.toml").is_file():
        from worlds.world import notes_of

        for note in notes_of(file.read_text(encoding="utf-8")):
            print(note)


def options_of(command: Any, default: Any = None) -> Iterator[tuple[str, Any, Any]]:
    """Name, value and default of each option of a command, options of groups included. default: the group as it is without options."""
    for field in dataclasses.fields(command):
        value, usual = getattr(command, field.name), field.default if default is None else getattr(default, field.name)
        if dataclasses.is_dataclass(value):
            yield from options_of(value, usual)
        else:
            yield field.name, value, usual


def changed_options(command: Any, names: Container[str]) -> dict[str, Any]:
    """Name → value of those options of a command among `names` that differ from their defaults."""
    return {name: value for name, value, usual in options_of(command) if name in names and value != usual}


DetectorModelName = Annotated[str, unset("FILE|NAME", "independent")]
"""The value of --detector-model: a file that `pilsim fit-detector` wrote, or the name of a model of the package."""


def ground_area(text: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Parse --area, as in 0,0,7.7,3.4: (2, 2) m, the lowest and highest x, y. Raises ValueError for anything else."""
    import numpy as np

    try:
        area = np.array([float(part) for part in text.split(",")]).reshape(2, 2)
    except ValueError:
        area = np.full((2, 2), np.nan)
    if not (np.isfinite(area).all() and (area[1] > area[0]).all()):
        raise ValueError(f"--area is {text!r}, needs lowest x, lowest y, highest x, highest y in m, as in 0,0,7.7,3.4")
    return area


def command_line(command: Any, without: Container[str], repeated: Container[str] = ()) -> str:
    """The command line that gives a command its changed options. without: options to leave out. repeated: options whose name precedes each value."""
    name = re.sub("(?<!^)(?=[A-Z])", "-", type(command).__name__).lower()
    words = ["pilsim", name]
    for option, value, usual in options_of(command):
        # The name of a field that is a keyword of Python ends with "_".
        flag = f"--{option.rstrip('_').replace('_', '-')}"
        if option == "source":
            words += [] if value is None else [str(value)]
        elif value == usual or option in without:
            continue
        elif option in repeated:
            words += [word for one in value for word in (flag, one)]
        elif isinstance(value, bool):
            words.append(flag if value else f"--no-{option}")
        else:
            words += [flag, *map(str, value if isinstance(value, tuple) else [value])]
    return shlex.join(words)


@contextmanager
def locked(*files: Path | None) -> Iterator[None]:
    """Lock the files that are written; None stands for no file. Raises ValueError where another process writes one of them."""
    from tracker.io.file_lock import output_file_lock

    with ExitStack() as locks:
        for path in filter(None, files):
            locks.enter_context(output_file_lock(path))
        yield


def json_text(value: Any, indent: int | None = None) -> str:
    """As json_text of tracker/io/json_files.py, imported on demand, since the help of a command needs no package of the tracker."""
    from tracker.io.json_files import json_text as text

    return text(value, indent)


@dataclass(frozen=True)
class SceneOptions:
    """The world, its people and its robots."""

    world: Word = None
    """Name of the world, as `pilsim worlds` lists it, or a file: a height map (dem.png:size=60,low=0,high=6), a mesh (.glb) or MJCF (.xml).

    pilsun is an indoor laboratory with ramps, a step, a platform and furniture."""
    difficulty: Number = None
    """Difficulty of the terrain, from 0 (gentle) to 1."""
    robots: Whole = None
    """Number of rovers, each with a panoramic camera."""
    people: Whole = None
    """Number of people, in all."""
    robot: Annotated[str | None, unset("NAME|FILE.xml,...", "rover")] = None
    """Robots in place of rovers, one after another: names of MuJoCo Menagerie or MJCF files, as rover,unitree_go2,my_drone.xml:motion=thrust."""


USUAL = SceneOptions("pilsun", 0.5, 4, 10)
"""The scene of commands without presets."""


@dataclass(frozen=True)
class BoxOptions:
    """Source of the boxes of people."""

    detector_model: DetectorModelName = "independent"
    """Errors of a real detector: a file of `pilsim fit-detector`, fairmot, faster-rcnn, keypoint-rcnn, pets-det or pixels."""
    detector: Literal["simulated", "pixels"] = "simulated"
    """Source of the boxes: a simulated detector, which knows the truth, or the person detector on the rendered panoramas."""
    model: Annotated[Path | None, unset("FILE.onnx", "the one of the package")] = None
    """The model of --detector pixels, an ONNX file that `train-detector` makes."""

    @property
    def pixels(self) -> bool:
        """Whether boxes are found in the panoramas. Raises ValueError for a model without --detector pixels."""
        if self.model is not None and self.detector != "pixels":
            raise ValueError(f"{self.model}: --model is for --detector pixels")
        return self.detector == "pixels"


@dataclass(frozen=True)
class ScenarioSettings:
    """People, cameras and physics."""

    at_once: Whole = None
    """Number of people who are present at the same time; 0 keeps all people present."""
    children: Number = None
    """Share of the people who are children, from 0 to 1."""
    rate: Number = None
    """Frame rate, frames per second."""
    camera_height: Number = None
    """Height of the panoramic cameras above the ground, m."""
    timestep: Number = None
    """Time step of the physics, s."""
    exposure: Number = None
    """Standard deviation of a slow exposure drift, stops."""
    image_noise: Number = None
    """Standard deviation of the pixel noise, counts of 255."""
    groups: Number = None
    """Share of the people who stand together in groups of 2 to 5 and talk, from 0 to 1."""
    sitting: Number = None
    """Share of the people present who sit on chairs, on benches and at tables, from 0 to 1; groups and sitting are at most 1 together."""
    clothing: Word = None
    """plain, or varied: mostly dark, with long coats and skirts, hoods and loose hair, and ten tones of skin."""
    umbrellas: Number = None
    """Share of the people who carry an open umbrella, from 0 to 1; it hides what is behind it and is no part of a body."""
    light: Word = None
    """built (the light of the world), overcast, low (a low warm sun), dim, or lamps (of a room, in place of the sun)."""
    wet: Number = None
    """How wet the ground is, from 0 to 1: darker, and bright towards the sun."""
    facades: Whole = None
    """Number of buildings with windows that stand around the world; 0 is usual."""
    glare: Number = None
    """Probability that a window of these buildings mirrors the sun or is lit from inside, from 0 to 1."""
    speed: Number = None
    """Top speed of the rovers, m/s; 0.7 is usual."""
    distractors: Whole = None
    """Number of things that detectors take for people: cones, signs, coat stands, tripods, clothes, prams, posters and others."""


@dataclass(frozen=True)
class CameraSettings:
    """Models and errors of the cameras; sim/README.md has all of them."""

    camera: Annotated[str | None, unset("MODEL[:OPTIONS]", "equirectangular")] = None
    """Camera of the rovers: equirectangular, fisheye, pinhole, cylindrical, dual-fisheye, or theta-sc, tum-vi, euroc; as fisheye:fov=200,pitch=10."""
    view_camera: Annotated[str | None, unset("MODEL[:OPTIONS]", "Tsai's pinhole")] = None
    """Camera model of the fixed cameras, as for --camera."""
    view_clock: Annotated[str | None, unset("CLOCKS", "one picture a frame")] = None
    """When fixed cameras take pictures, as View_001:rate=7,offset=0.13;View_002:lost=0.1;View_003:freeze=4+3 (1/s, s, share, BEGIN+SECONDS)."""
    effect: Annotated[UseAppendAction[tuple[str, ...]], unset("NAME=VALUE", "none")] = ()
    """An error of all cameras, as readout=0.02 or vignette=1.5; may be repeated."""


def camera_given(options: CameraSettings) -> dict[str, Any]:
    """Name → value of the settings of the cameras, as a scenario has them."""
    effects = {"effects": ",".join(options.effect)} if options.effect else {}
    return {name: value for name, value in given(options).items() if name != "effect"} | effects


@dataclass(frozen=True)
class SensorSettings:
    """The robots' own sensors, beside cameras and odometry."""

    imu: Annotated[str | None, unset("NAME[@HZ]", "none")] = None
    """IMU of each rover, 100 to 400 Hz: adis16448, bmi088, icm20948 or ideal; without @HZ at the highest rate that the physics gives."""
    wheels: Annotated[float | None, unset("HZ", "none")] = None
    """Wheel encoders of each rover at this rate, Hz."""
    clock: Annotated[str | None, unset("ERRORS", "exact")] = None
    """Errors of the clocks of robots and cameras, as offset=±0.02,jitter=0.001,drift=20 (s, s, ppm); sim/README.md has the rest."""


@dataclass(frozen=True)
class DetectorSettings:
    """The simulated detector of people."""

    misses: Number = None
    """Probability that a visible person is missed, from 0 to 1."""
    clutter: Number = None
    """Mean number of false detections per view and frame."""
    bearing_noise: Number = None
    """Standard deviation of an edge of a detection, rad."""
    min_visible: Number = None
    """Visible fraction of a body, from 0 to 1, below which it is never detected."""
    detector_model: Annotated[str | None, unset("FILE|NAME", "independent")] = None
    """Errors of a real detector in place of these: a file of `pilsim fit-detector`, fairmot, faster-rcnn, keypoint-rcnn, pets-det or pixels."""


def detector_given(options: DetectorSettings) -> dict[str, Any]:
    """Name → value of the settings of the detector; a model in the form that scenarios hold.

    Raises ValueError for an unknown or invalid model, and for settings of the independent detector beside a model.
    """
    from tracker.detector_models.model import INDEPENDENT, chosen_model

    values = given(options)
    if (text := values.get("detector_model")) is None:
        return values
    beside = [name for name in values if name != "detector_model"]
    if beside and text != INDEPENDENT:
        raise ValueError(f"--detector-model {text} has its own errors, and --{beside[0].replace('_', '-')} is of the independent detector")
    return values | {"detector_model": chosen_model(text)}


def given(options: Any) -> dict[str, Any]:
    """Name → value of the options that are not None."""
    values = {field.name: getattr(options, field.name) for field in dataclasses.fields(options)}
    return {name: value for name, value in values.items() if value is not None}
