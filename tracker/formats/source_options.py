"""Options for reading a source: cameras, frames and detections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tracker.io.json_files import JsonObject
from tracker.recordings.degradation import BoxNoise, Degradation


@dataclass(frozen=True, eq=False)
class SourceOptions:
    """Options for reading a source.

    cameras: names, or the numbers at their ends, as 5 for View_005; empty for all. detections: camera → a MOT15 file that replaces its detections;
    the key "" holds a folder with files CAMERA.txt. frames: the first frame and the end (excluded), as in Python's slices; None for all.
    degradation: errors added to all detections, drawn with `seed`. images: whether images are read, too. projected: errors of boxes that are
    projected from the truth and replace the detections, or None. pixels: whether people are detected in the images, so that no boxes are needed.
    offsets: clock offsets of the cameras, in the syntax of --offsets; "" for none.
    """

    cameras: tuple[str, ...] = ()
    detections: Mapping[str, Path] = field(default_factory=dict)
    frames: tuple[int, int | None] | None = None
    degradation: Degradation = Degradation()
    seed: int = 0
    images: bool = False
    projected: BoxNoise | None = None
    pixels: bool = False
    offsets: str = ""

    @staticmethod
    def parse(
        detections: Iterable[str] = (),
        degrade: str = "",
        seed: int = 0,
        cameras: str = "",
        frames: str = "",
        images: bool = False,
        project: str | None = None,
        pixels: bool = False,
        offsets: str = "",
    ) -> SourceOptions:
        """Parse command line options. detections: each CAMERA=FILE, or one folder. degrade: see Degradation.parse. cameras: as C1,C3. frames: A:B.
        project: see BoxNoise.parse.

        Raises ValueError for an invalid value, and for a file or folder of detections that does not exist.
        """
        if seed < 0:
            raise ValueError(f"--seed is {seed}, needs 0 or more")
        noise = None if project is None else BoxNoise.parse(project)
        given = list(detections)
        if given and noise is not None:
            raise ValueError("--detections and --project exclude each other: boxes are read, or projected from the truth")
        if pixels and (given or noise is not None or degrade):
            raise ValueError("--detector pixels finds the boxes in images, and excludes --detections, --project and --degrade")
        read = _names(cameras), _files(given), parse_frames(frames) if frames else None
        return SourceOptions(*read, Degradation.parse(degrade), seed, images or pixels, noise, pixels, offsets)

    def to_run(self) -> dict[str, Any]:
        """The options as entries of run.json; defaults have no entry. `images` is left out, because scores do not need images."""
        out: dict[str, Any] = {}
        if self.cameras:
            out["cameras"] = list(self.cameras)
        if self.frames is not None:
            first, end = self.frames
            out["frames_read"] = f"{first}:{'' if end is None else end}"
        if self.detections or self.degradation != Degradation():
            d = self.degradation
            if self.detections:
                out["detections"] = [f"{name}={file.resolve()}" if name else str(file.resolve()) for name, file in self.detections.items()]
            out |= {"degrade": f"drop={d.drop},clutter={d.clutter},noise={d.noise}", "seed": self.seed}
        if self.projected is not None:
            out |= {"project": str(self.projected), "seed": self.seed}
        if self.pixels:
            out["detector"] = "pixels"
        if self.offsets:
            out["offsets"] = self.offsets
        return out

    def detection_files(self, cameras: list[str]) -> dict[str, Path]:
        """Camera → the file that replaces its detections, given by name or in a folder. Raises ValueError for a camera that is not in `cameras`."""
        named = {camera_named(text, cameras): file for text, file in self.detections.items() if text}
        folder = self.detections.get("")
        if folder is None:
            return named
        found = {name: file for name in cameras if (file := folder / f"{name}.txt").is_file()}
        if not found:
            raise ValueError(f"{folder}: no CAMERA.txt of {', '.join(cameras)}")
        return found | named

    @staticmethod
    def of_run(run: Mapping[str, Any]) -> SourceOptions:
        """The options that to_run wrote. View numbers of pilsim 0.3.0 are read as cameras. Raises ValueError for other content."""
        fields = JsonObject(dict(run), "run.json")
        cameras, detections, views = (fields.maybe(name, list) or [] for name in ("cameras", "detections", "views"))
        degrade, frames, offsets = (fields.maybe(name, str) or "" for name in ("degrade", "frames_read", "offsets"))
        project, pixels, names = fields.maybe("project", str), run.get("detector") == "pixels", ",".join(map(str, cameras or views))
        seed = fields.maybe("seed", int) or 0
        return SourceOptions.parse(map(str, detections), degrade, seed, names, frames, project=project, pixels=pixels, offsets=offsets)


def _names(text: str) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(",") if part.strip())
    if text and not names:
        raise ValueError(f"--cameras is {text!r}, needs names as C1,C3")
    if len(set(names)) != len(names):
        raise ValueError(f"--cameras {text} names a camera twice")
    return names


def _files(texts: Iterable[str]) -> dict[str, Path]:
    files: dict[str, Path] = {}
    for text in texts:
        name, equals, file = text.partition("=")
        if not equals and Path(text).is_dir():
            name, file = "", text
        if (not name and equals) or not file or name in files:
            raise ValueError(f"--detections is {text!r}, needs CAMERA=FILE, each camera once, or a folder with CAMERA.txt")
        if not (Path(file).is_file() or (name == "" and Path(file).is_dir())):
            raise ValueError(f"{file}: no such file")
        files[name] = Path(file)
    return files


def parse_frames(text: str, option: str = "--frames") -> tuple[int, int | None]:
    """The first frame and the end (excluded) of A:B or A:, counted from 0. Raises ValueError that names the option."""
    first, colon, end = text.partition(":")
    try:
        cut = int(first or 0), int(end) if end else None
    except ValueError:
        cut = -1, None
    if not colon or cut[0] < 0 or (cut[1] is not None and cut[1] <= cut[0]):
        raise ValueError(f"{option} is {text!r}, needs FIRST:END as in 0:100, counted from 0, END left out of them")
    return cut


def camera_named(text: str, names: Iterable[str]) -> str:
    """The name that equals `text` or ends in the number `text`. Raises ValueError with all names where not exactly one matches."""
    known = list(names)
    if text in known:
        return text
    found = [name for name in known if text.isdecimal() and _number_of(name) == int(text)]
    if len(found) != 1:
        raise ValueError(f"camera is {text!r}, needs one of {', '.join(known)}")
    return found[0]


def _number_of(name: str) -> int | None:
    digits = name[len(name.rstrip("0123456789")) :]
    return int(digits) if digits else None
