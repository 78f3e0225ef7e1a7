"""The choices for a place of a user: `FILE`, `FILE:name=value,…`, or a file place.toml that holds them."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HEIGHT_MAP, MESH, MODEL = "height map", "mesh", "model"
KINDS = {
    ".png": HEIGHT_MAP, ".tif": HEIGHT_MAP, ".tiff": HEIGHT_MAP,
    ".glb": MESH, ".gltf": MESH, ".obj": MESH, ".ply": MESH, ".stl": MESH,
    ".xml": MODEL, ".mjcf": MODEL,
}  # fmt: skip
"""Ending of a file → what it holds."""
CHOICES = ".toml"
FOREIGN = {
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), "USD; export it as .glb (in Blender: File, Export, glTF 2.0)"),
    **dict.fromkeys((".fbx", ".blend", ".dae"), "a scene of a modelling program; export it as .glb"),
    **dict.fromkeys((".las", ".laz", ".pcd", ".e57"), "a cloud of points; make a mesh of it, as .ply, or a height map, as .tif"),
    **dict.fromkeys((".jpg", ".jpeg", ".asc", ".hgt"), "no height map that is read; convert it to a GeoTIFF (gdal_translate IN OUT.tif)"),
    ".urdf": "URDF; convert it to MJCF (load it in MuJoCo and save it as .xml)",
}
"""Ending of a file that is not read → what it is, and how to convert it."""
AXES = ("x", "y", "z", "-x", "-y", "-z")
MOST_NODES = 400
"""Grid points along the longer side, unless spacing= says otherwise: the time of path searches grows with its square."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Unit of length → m."""
OF_KIND = {
    HEIGHT_MAP: {"size", "low", "high", "texture", "area", "spacing", "entrances", "licence"},
    MESH: {"up", "unit", "level", "area", "spacing", "entrances", "licence"},
    MODEL: {"level", "area", "spacing", "entrances", "licence"},
}
"""Names of the choices of each kind of file."""


Found = dict[str, "str | float | list[float]"]
"""Values read or guessed: name → value; names that are no choices begin with found_."""


@dataclass(frozen=True)
class Place:
    """A file of a user and the choices for it; values of choices that are None are guessed, or read from the file.

    source: the file. size: longer side of a height map, m. low, high: heights of its lowest and highest value, m. texture: a picture of all of it.
    area: (x0, y0, x1, y1) m of the part that is used. up: axis of a mesh that points up, one of AXES. unit: unit of its coordinates, m.
    level: height of the floor where people enter, m. spacing: of the grid of free space, m. entrances: (x, y) m where people enter and leave.
    licence: of the source, for the dataset's card.
    """

    source: Path
    size: float | None = None
    low: float | None = None
    high: float | None = None
    texture: Path | None = None
    area: tuple[float, float, float, float] | None = None
    up: str | None = None
    unit: float | None = None
    level: float | None = None
    spacing: float | None = None
    entrances: tuple[tuple[float, float], ...] = ()
    licence: str = ""

    @property
    def kind(self) -> str:
        """HEIGHT_MAP, MESH or MODEL."""
        return KINDS[self.source.suffix.lower()]

    @property
    def name(self) -> str:
        """The name of the world: that of the file."""
        return "".join(c if c.isalnum() or c in "-_" else "_" for c in self.source.stem)[:40]

    def grid_spacing(self, longest: float) -> float:
        """m: the chosen spacing of the grid of free space, or one with MOST_NODES along the longer side of `longest` m, but at least 0.1 m.

        Raises ValueError for a spacing that makes the grid too large.
        """
        spacing = self.spacing or max(0.1, longest / (MOST_NODES - 1))
        if longest / spacing > 4 * MOST_NODES:
            raise ValueError(f"spacing is {spacing:g} m, needs at least {longest / (4 * MOST_NODES):.3g} for {longest:.0f} m")
        return spacing

    def toml(self, found: Found, notes: Sequence[str]) -> str:
        """The text of place.toml. found: values guessed or read, beside the choices. notes: comments. Paths are written as given."""
        values: dict[str, Any] = {"source": self.source.as_posix(), "sha256": hashlib.sha256(self.source.read_bytes()).hexdigest()}
        told = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "source"}
        values |= {name: value for name, value in told.items() if value not in (None, (), "")} | found
        lines = [*(f"# {note}" for note in notes), *(f"{name} = {_toml(value)}" for name, value in values.items())]
        return "\n".join(lines) + "\n"


def is_place(name: object) -> bool:
    """Whether the name of a world is the path of a file."""
    return isinstance(name, str) and bool(Path(name.partition(":")[0]).suffix)


def place_of(name: str, field: str = "world") -> Place:
    """The place of a text `FILE`, `FILE:name=value,…` or `place.toml`.

    Raises ValueError for a missing file, an unsupported kind, and an unknown or wrong choice. field: the option's name in the message.
    """
    path, _, text = name.partition(":")
    file, ending = Path(path), Path(path).suffix.lower()
    if ending in FOREIGN:
        raise ValueError(f"{field} is {path}: {FOREIGN[ending]}")
    if ending not in KINDS and ending != CHOICES:
        raise ValueError(f"{field} is {path[:60]!r}, needs a name of a world or a file that ends in {', '.join((*KINDS, CHOICES))}")
    if not file.is_file():
        raise ValueError(f"{path}: no such file")
    words = [word for word in text.split(",") if word]
    values: dict[str, Any] = {}
    if ending == CHOICES:
        values = _stored(file)
        file = values.pop("source")
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise ValueError(f"{path}: {word[:40]!r} is no choice, needs name=value, as size=60")
        values[key] = value
    try:
        return _place(file, values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _stored(file: Path) -> dict[str, Any]:
    """The choices of a place.toml, without sha256 and found_ values; paths are taken from its folder."""
    try:
        values = tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}: not TOML ({' '.join(str(error).split())})") from None
    source = values.get("source")
    if not isinstance(source, str) or Path(source).suffix.lower() not in KINDS:
        raise ValueError(f"{file}: source is {source!r}, needs a file that ends in {', '.join(KINDS)}")
    values["source"] = _beside(file, source)
    if not values["source"].is_file():
        raise ValueError(f"{file}: source {source} is no file, neither from the folder of place.toml nor from the present one")
    digest = values.pop("sha256", None)
    if digest is not None and digest != hashlib.sha256(values["source"].read_bytes()).hexdigest():
        raise ValueError(f"{file}: {source} is another file than the one of sha256; take that line out to use it")
    if isinstance(values.get("texture"), str):
        values["texture"] = str(_beside(file, values["texture"]))
    return {name: value for name, value in values.items() if not name.startswith("found_")}


def _beside(file: Path, name: str) -> Path:
    """A path from the folder of `file`, or from the present one, as `generate` writes paths as they were given."""
    return beside if (beside := file.parent / name).is_file() else Path(name)


def _place(file: Path, values: dict[str, Any]) -> Place:
    known = OF_KIND[KINDS[file.suffix.lower()]]
    for name in values:
        if name not in known:
            raise ValueError(f"{name[:40]!r} is no choice of a {KINDS[file.suffix.lower()]}, which has {', '.join(sorted(known))}")
    given: dict[str, Any] = {}
    for name, value in values.items():
        if name in ("size", "low", "high", "level", "spacing"):
            given[name] = _number(name, value)
        elif name == "area":
            given[name] = _area(value)
        elif name == "entrances":
            given[name] = _entrances(value)
        elif name == "texture":
            given[name] = Path(str(value))
        elif name == "unit":
            given[name] = UNITS[value] if value in UNITS else _number(f"unit (one of {', '.join(UNITS)}, or m)", value)
        else:
            given[name] = str(value)
    place = Place(file, **given)
    if place.up is not None and place.up not in AXES:
        raise ValueError(f"up is {place.up[:40]!r}, needs one of {', '.join(AXES)}")
    for name in ("size", "spacing", "unit"):
        if (number := getattr(place, name)) is not None and not number > 0:
            raise ValueError(f"{name} is {number}, needs more than 0")
    if place.low is not None and place.high is not None and place.high < place.low:
        raise ValueError(f"high is {place.high} m, needs at least low, {place.low} m")
    if place.texture is not None and not place.texture.is_file():
        raise ValueError(f"texture {place.texture}: no such file")
    return place


def _number(name: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not math.isfinite(number):
        raise ValueError(f"{name} is {str(value)[:40]!r}, needs a number")
    return number


def _area(value: object) -> tuple[float, float, float, float]:
    words = value.split(":") if isinstance(value, str) else value
    if not isinstance(words, list) or len(words) != 4:
        raise ValueError(f"area is {str(value)[:60]!r}, needs X0:Y0:X1:Y1, m")
    x0, y0, x1, y1 = (_number("area", word) for word in words)
    if not (x1 > x0 and y1 > y0):
        raise ValueError(f"area is {x0:g}:{y0:g}:{x1:g}:{y1:g}, needs X0:Y0:X1:Y1 with X1 above X0 and Y1 above Y0")
    return x0, y0, x1, y1


def _entrances(value: object) -> tuple[tuple[float, float], ...]:
    pairs = [pair.split(":") for pair in value.split("/")] if isinstance(value, str) else value
    if not isinstance(pairs, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        raise ValueError(f"entrances are {str(value)[:60]!r}, need X:Y/X:Y/…, m")
    return tuple((_number("entrances", x), _number("entrances", y)) for x, y in pairs)


def _toml(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(_toml(each) for each in value) + "]"
    if isinstance(value, (int, float)):
        return repr(float(value))
    text = str(value.as_posix() if isinstance(value, Path) else value)
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ") + '"'
