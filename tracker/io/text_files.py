"""Text files of unknown origin, read line by line: UTF-8 with or without a byte order mark, and any line end."""

from __future__ import annotations

import codecs
import difflib
import math
import os
import re
from collections.abc import Collection, Iterator
from pathlib import Path

LONGEST_LINE = 1 << 16
"""Characters. A file of unknown origin must not exhaust the memory."""
LARGEST_NUMBER = 1e60
"""No length, time or score is as large; its fourth power is still finite."""
INTEGER_BITS = 62
LONGEST_SHOWN = 60
"""Characters of a value in an error message."""
_ESCAPED = re.compile("[\udc80-\udcff]")


def read_lines(path: str | os.PathLike[str], errors: str = "strict") -> Iterator[tuple[int, str]]:
    """The lines of a file that are not blank: number from 1, and text without the line end and the blanks before it.

    Lines end with LF, CR LF or CR. errors: "replace" for a format with comments in any encoding.
    Raises ValueError with file and line for bytes that are not UTF-8, for a zero byte, and for a line of more than LONGEST_LINE characters.
    Raises OSError where the file cannot be read.
    """
    try:
        with Path(path).open(encoding="utf-8-sig", errors=errors) as file:
            number = 0
            while line := file.readline(LONGEST_LINE + 1):
                number += 1
                if len(line) > LONGEST_LINE:
                    raise ValueError(f"{path}:{number}: a line of more than {LONGEST_LINE} characters")
                if "\0" in line:
                    raise ValueError(f"{path}:{number}: holds a byte 0: not a text file")
                if text := line.rstrip():
                    yield number, text
    except UnicodeDecodeError:
        raise not_utf8(path) from None


def read_text(path: str | os.PathLike[str], most: int) -> str:
    """The text of a file of at most `most` bytes. Raises ValueError with file and line as read_lines, and OSError where it cannot be read."""
    size = Path(path).stat().st_size
    if size > most:
        raise ValueError(f"{path}: {size} bytes, needs at most {most}")
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise not_utf8(path) from None


def not_utf8(path: str | os.PathLike[str]) -> ValueError:
    """The error of a file that is not UTF-8, with file, line and byte from 0."""
    with Path(path).open("rb") as file:
        known = " but UTF-16" if file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else ""
    place, line = 0, 1
    # `surrogateescape` decodes each invalid byte to a character that valid text cannot hold.
    with Path(path).open(encoding="utf-8", errors="surrogateescape", newline="") as file:
        while text := file.readline(LONGEST_LINE):
            good = _ESCAPED.split(text, maxsplit=1)[0]
            place += len(good.encode())
            if len(good) < len(text):
                break
            line += text.endswith(("\n", "\r"))
    return ValueError(f"{path}:{line}: byte {place} is not UTF-8{known}: not a text file in UTF-8")


def shown(text: str) -> str:
    """A text of the file for an error message: quoted, on one line, and at most LONGEST_SHOWN characters long."""
    return repr(text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 1]}…")


def parse_number(text: str, where: str) -> float:
    """A finite decimal number. Raises ValueError that begins with `where`: the file, the line and the field."""
    try:
        if "_" in text:
            raise ValueError
        value = float(text)
    except ValueError:
        raise ValueError(f"{where} is {shown(text.strip())}, needs a number") from None
    if not math.isfinite(value):
        raise ValueError(f"{where} is {text.strip()[:LONGEST_SHOWN]}, needs a finite number")
    if abs(value) > LARGEST_NUMBER:
        raise ValueError(f"{where} is {text.strip()[:LONGEST_SHOWN]}, needs at most {LARGEST_NUMBER:g}")
    return value


def parse_integer(text: str, where: str) -> int:
    """A whole decimal number below 2^INTEGER_BITS. Raises ValueError as parse_number."""
    try:
        if "_" in text:
            raise ValueError
        value = int(text)
    except ValueError:
        raise ValueError(f"{where} is {shown(text.strip())}, needs a whole number") from None
    if abs(value) >= 1 << INTEGER_BITS:
        raise ValueError(f"{where} is {text.strip()[:LONGEST_SHOWN]}, needs less than 2^{INTEGER_BITS}")
    return value


def named_values(text: str, known: Collection[str], subject: str, needed: str) -> dict[str, str]:
    """Name → text of its value, from NAME=VALUE,NAME=VALUE. A dash in a name counts as an underscore where such a name is known.

    subject, needed: what the text describes, and the form that an item needs, for the message.
    Raises ValueError for an unknown name, with the nearest one, and for a name that occurs twice.
    """
    found: dict[str, str] = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        name, equals, value = (part.strip() for part in item.partition("="))
        name = name if name in known else name.replace("-", "_")
        if not equals or name not in known:
            near = difflib.get_close_matches(name, known, 1, 0.6)
            hint = f" ({near[0]}?)" if near and name not in known else ""
            raise ValueError(f"{subject} {item[:60]!r}{hint}, needs {needed}")
        if name in found:
            raise ValueError(f"{subject} {name} twice")
        found[name] = value
    return found
