"""Folders of images and videos of unknown origin: which files are read, their order, and their frame numbers."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from tracker.geometry import Image
from tracker.io.image_files import PICTURES, decode_picture, orientation
from tracker.io.mot15 import MAX_FRAME
from tracker.io.time_order import counted, say
from tracker.io.video_files import VIDEOS

READ = (*PICTURES, *VIDEOS)
LEAST_STAMP = 9
"""A name with at least so many digits is a time, such as seconds since 1970, or a date with a time of day."""
DATED = re.compile("(?:.*[^0-9])?(19|20)[0-9]{2}(0[1-9]|1[0-2])(0[1-9]|[12][0-9]|3[01])[^0-9]?([01][0-9]|2[0-3])([0-5][0-9]){2}")
"""Names that end in a date and a time of day. Those of one day differ only in their last number, as frames do."""
NAMED = 3
"""Most files that a logged line names."""
_BLOCK = 1 << 20


def natural_key(name: str) -> tuple[tuple[int | str, ...], str]:
    """Sort key of names by which frame2 comes before frame10: numbers count by value, and text without case."""
    parts = re.split("([0-9]+)", name.casefold())
    return tuple(int(part) if k % 2 else part for k, part in enumerate(parts)), name


def visible_files(folder: Path, kinds: Iterable[str] = READ) -> list[Path]:
    """The files of a folder with these suffixes, in natural order. Hidden files are left out silently, all others with a logged line."""
    there = [one for one in folder.iterdir() if not one.name.startswith(".")]
    read = [one for one in there if one.suffix.lower() in kinds and not one.is_dir()]
    say_left_out(folder, [one for one in there if one not in set(read)], f"need to be files with {', '.join(kinds)}")
    return sorted(read, key=lambda one: natural_key(one.name))


def read_picture(file: Path) -> Image:
    """An image (H, W, 3) RGB. That images of its folder are turned upright is logged. Raises ValueError, with the file, as decode_picture."""
    data = file.read_bytes()
    try:
        image = decode_picture(data)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    if orientation(data) != 1:
        say(f"{file.parent}: images are turned upright by their EXIF orientation")
    return image


def say_left_out(folder: Path, files: Iterable[Path], why: str) -> None:
    """Log which files and folders in a folder are not read, and why; nothing where there are none."""
    names = sorted((one.name for one in files), key=natural_key)
    if names:
        rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        say(f"{folder}: {', '.join(names[:NAMED])}{rest} left out, {why}")


def say_order(name: str, files: list[Path]) -> None:
    """Log the order of image files by their first and last name, and whether numbers are missing between them."""
    if len(files) < 2:
        return
    numbers = [int(match[1]) for one in files if (match := re.search("([0-9]+)[^0-9]*$", one.stem))]
    gaps = numbers[-1] - numbers[0] + 1 - len(files) if len(numbers) == len(files) else 0
    missing = f"; {counted(gaps, 'number')} between them missing, and not counted as frames" if 0 < gaps <= MAX_FRAME else ""
    say(f"{name}: {len(files)} images in the order of their numbers, {files[0].name} to {files[-1].name}{missing}")


def numbered_files(folder: Path) -> dict[int, Path]:
    """Number → image file of a folder, ascending. Names are numbers, as 000001.jpg, or hold one, as frame_000001.jpg.

    Names that are times are numbered from 1 in their order, which is logged. Files without a number in the name are left out, which is logged.
    Raises ValueError for two files with one number.
    """
    files = visible_files(folder, PICTURES)
    parts = {one: match for one in files if (match := re.fullmatch("(.*?)([0-9]+)([^0-9]*)", one.stem))}
    if files and len(parts) == len(files) and all(len(re.sub("[^0-9]", "", one.stem)) >= LEAST_STAMP for one in files):
        rests = {(match[1], match[3]) for match in parts.values()}
        dated = all(DATED.fullmatch(one.stem) for one in files)
        if dated or len(rests) > 1 or max(int(match[2]) for match in parts.values()) > MAX_FRAME:
            say(f"{folder}: names are times, taken as frames 1 to {len(files)} in their order, {files[0].name} to {files[-1].name}")
            return dict(enumerate(files, 1))
    form = Counter((match[1], match[3]) for match in parts.values()).most_common(1)
    chosen = [one for one in files if one in parts and (parts[one][1], parts[one][3]) == form[0][0] and int(parts[one][2]) <= MAX_FRAME]
    say_left_out(folder, set(files) - set(chosen), "need the number of a frame in the name, as 000001.jpg")
    out: dict[int, Path] = {}
    for one in chosen:
        number = int(parts[one][2])
        if number in out:
            raise ValueError(f"{folder}: {out[number].name} and {one.name} have one number, needs one image for each frame")
        out[number] = one
    if out and [one.name for one in out.values()] != sorted(one.name for one in out.values()):
        say_order(str(folder), list(out.values()))
    return out


def frames_from_zero(numbered: Mapping[str, Mapping[int, Path]], where: str) -> dict[str, dict[int, Path]]:
    """Camera → frame from 0 → file. If a camera's numbers begin at 0, which is logged, those of all cameras count from 0, else from 1."""
    first = min((min(files) for files in numbered.values() if files), default=1)
    start = 0 if first == 0 else 1
    if start == 0:
        name = next(files[0].name for files in numbered.values() if 0 in files)
        say(f"{where}: numbered from 0, so {name} is frame 1 of detections and truth")
    return {camera: {number - start: file for number, file in files.items()} for camera, files in numbered.items()}


def content_checksum(files: Iterable[Path]) -> str:
    """SHA-256 of the names and contents of files, read in parts. It identifies the images of a finished run."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(f"{file.name}\0{file.stat().st_size}\0".encode("utf-8", "surrogateescape"))
        with file.open("rb") as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
    return digest.hexdigest()
