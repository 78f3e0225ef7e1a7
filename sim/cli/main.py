"""The command line of pilsim. Read `main` first. Each command is a class of its own file in this folder."""

from __future__ import annotations

import _thread
import contextlib
import ctypes
import difflib
import importlib
import importlib.metadata
import io
import os
import re
import shutil
import signal
import sys
import textwrap
import threading
from collections.abc import Iterator
from typing import Any, NoReturn, get_type_hints

import tyro
from tyro.conf import Positional

from pilsim import CODE
from sim.rendering.gl_context import GLUnavailable
from tracker.options import check_options

GROUPS: dict[str, tuple[str, ...]] = {
    "Start": ("demo", "doctor"),
    "Data": ("generate", "worlds", "check", "calibrate", "info", "import", "export", "view"),
    "Tracking": ("detect", "track", "score", "score-detections", "clique"),
    "Experiments": ("fit-detector", "train-detector", "predict", "tune", "stress", "report", "compare", "place", "study"),
}
"""The commands as the overview shows them."""
COMMANDS = tuple(name for names in GROUPS.values() for name in names)
OLD_NAMES: dict[str, dict[str, str]] = {
    "generate": {"--views": "--fixed-cameras"},
    **{name: {"--views": "--cameras"} for name in ("check", "track", "fit-detector", "predict")},
    "stress": {"--ladder": "--ablation", "--no-ladder": "--no-ablation"},
}
"""Command → old name of an option → its present name. Old names still work; the help does not show them."""
WIDEST = 120
"""Largest width of the help of a command, columns."""
WRONG_TYPE = re.compile(r"Error parsing (\S+): no type matching \{None\}\|(\S+) could be instantiated from \[(.*?)\]\. .*")
"""tyro's message for a value of the wrong type."""
NEAR = 0.7
"""Least similarity, from 0 to 1 (difflib), of a word to the name that an error message suggests for it."""
MOMENT = 0.02
"""Delay after which a lost Ctrl-C is raised again, s."""


class _Stream(io.FileIO):
    """A standard stream whose failure does not end the command: further output is dropped, and the first OSError is kept.

    A broken pipe of standard output is raised, since nobody reads what the command prints.
    """

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write bytes, as FileIO does."""
        try:
            return len(memoryview(data)) if self.failure else super().write(data)
        except OSError as error:
            if isinstance(error, BrokenPipeError) and self.fileno() == 1:
                raise
            self.failure = error
            return len(memoryview(data))


def _guard_streams() -> None:
    """Replace the standard streams by ones that tolerate failures, except those that a test captures.

    A closed stream becomes the null device, so that no other file takes its number. Characters outside the encoding are replaced.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if stream is getattr(sys, f"__{name}__"):
            raw = _Stream(number, "w", closefd=False)
            encoding = "utf-8" if stream is None else stream.encoding
            setattr(sys, name, io.TextIOWrapper(io.BufferedWriter(raw), encoding, "replace", line_buffering=number == 2 or raw.isatty()))


def main() -> None:
    """Run the command line. The exit code is 0, 2 with one line for bad input, 130 when interrupted, 1 for a broken pipe, or the command's own."""
    _guard_streams()
    sys.unraisablehook = _unraisable
    try:
        words = sys.argv[1:]
        if words == ["--version"]:
            print(f"pilsim {importlib.metadata.version('pilsim')}")
        elif words[:1] in (["--help"], ["-h"]):
            print(overview())
        elif command := _parse(words):
            command.run()
        sys.stdout.flush()
        failure = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
        if isinstance(failure, _Stream) and failure.failure is not None:
            raise OSError(failure.failure.errno, failure.failure.strerror, "standard output")
    except BrokenPipeError:
        # The reader of the pipe has ended (`pilsim … | head`), so that a message would reach nobody.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        _interrupted()
    except ImportError as error:
        # Some packages turn Ctrl-C during their import into an ImportError.
        if not isinstance(error.__context__, KeyboardInterrupt):
            raise
        _interrupted()
    except (ValueError, OSError, GLUnavailable) as error:
        print(f"error: {_message(error)}", file=sys.stderr)
        sys.exit(2)


def _interrupted() -> NoReturn:
    """End the process after Ctrl-C. Another Ctrl-C is ignored from here on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Where a compiled module saw the signal first, CPython would end by the signal instead of this code, unless it runs other code first.
    ctypes.pythonapi.PyRun_SimpleString(b"")
    print("interrupted: complete results are kept, the same command continues from there", file=sys.stderr)
    sys.exit(CODE)


def _unraisable(found: sys.UnraisableHookArgs) -> None:
    """Raise Ctrl-C again a moment later where it came in a place that cannot raise, as in a callback of a compiler."""
    if found.exc_type is KeyboardInterrupt:
        threading.Timer(MOMENT, _thread.interrupt_main).start()
    else:
        sys.__unraisablehook__(found)


def command_of(name: str) -> type:
    """The class of a command: FitDetector in fit_detector.py for fit-detector."""
    found: type = getattr(importlib.import_module(f"sim.cli.{name.replace('-', '_')}"), name.title().replace("-", ""))
    return found


def overview() -> str:
    """The help of `pilsim` itself: a line for each command, in groups, at most 80 columns wide."""
    lines = ["usage: pilsim COMMAND [OPTIONS]", "", "Simulate people and panoramic robots in irregular worlds, track them, score.", ""]
    for title, names in GROUPS.items():
        lines += [f"{title}:", *(f"  {name:9} {(command_of(name).__doc__ or '').splitlines()[0]}" for name in names), ""]
    return "\n".join([*lines, "`pilsim COMMAND --help` shows options and examples; see also `pilsim --version`."])


def _message(error: Exception) -> str:
    """The error in one line. An error of a file is its name and the message of the system."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return " ".join(f"{error.filename}: {error.strerror}".split())
    return " ".join(str(error).split())


def _parse(words: list[str]) -> Any:
    """The parsed command, or None after printing its help. Raises ValueError for a wrong word or value."""
    _check_names(words)
    errors, output = io.StringIO(), _Output()
    # In a wide terminal, tyro would put expert options beside the common ones.
    os.environ["COLUMNS"] = str(width := min(WIDEST, shutil.get_terminal_size().columns))
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(output):
            command: Any = tyro.cli(command_of(words[0]), prog=f"pilsim {words[0]}", args=today(words)[1:])
    except SystemExit as exit_:
        if exit_.code == 2:
            raise ValueError(f"{_first_part(errors.getvalue())}; see pilsim {words[0]} --help") from None
        print("\n".join(_wrapped(output.getvalue(), max(40, width))))
        return None
    check_options(command)
    return command


class _Output(io.StringIO):
    """A buffer for help. It behaves like the real output, so that tyro uses colors and boxes where the real output has them."""

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return sys.__stdout__.encoding.lower() if sys.__stdout__ is not None else "utf-8"

    def isatty(self) -> bool:
        return sys.__stdout__ is not None and sys.__stdout__.isatty()


def _wrapped(text: str, width: int) -> Iterator[str]:
    """The lines of the help of a command. Paragraphs, which tyro joins to one line each, are wrapped to the width, columns."""
    for line in text.rstrip("\n").split("\n"):
        # Boxes fit the terminal already. Examples are indented, and stay on one line for copying.
        prose = line and not line.startswith((" ", "│", "╭", "╰", "Example"))
        yield from textwrap.wrap(line, width, break_long_words=False, break_on_hyphens=False) if prose else [line]


def today(words: list[str]) -> list[str]:
    """A command line with the present names of options. `generate --views` was a number of cameras, `generate twin --views` their names."""
    old = OLD_NAMES.get(words[0], {}) | ({"--views": "--cameras"} if words[:2] == ["generate", "twin"] else {})
    return ["".join((old.get(name, name), *value)) for name, *value in (word.partition("=") for word in words)]


def _check_names(words: list[str]) -> None:
    """Raises ValueError where the command or an option is unknown, and suggests the nearest name."""
    if not words:
        raise ValueError(f"a command is missing, needs one of {', '.join(COMMANDS)}; see pilsim --help")
    if words[0].startswith("-"):
        raise ValueError(f"{words[0]} stands before the command; see pilsim --help")
    if words[0] not in COMMANDS:
        near = _near(words[0], COMMANDS)
        raise ValueError(f'pilsim has no command "{words[0]}"{f"; did you mean {near}?" if near else ";"} see pilsim --help')
    known = [*_flags(command_of(words[0])), "--help"]
    given = [word.partition("=")[0] for word in today(words)[1:] if word.startswith("--") and len(word) > 2]
    unknown = list(dict.fromkeys(flag for flag in given if flag.replace("_", "-") not in known))
    if unknown and not {"-h", "--help"} & set(words):
        faults = ", ".join(_unknown(flag, known) for flag in unknown)
        raise ValueError(f"{words[0]} has no option {faults}; see pilsim {words[0]} --help")


def _unknown(flag: str, known: list[str]) -> str:
    """An unknown option of a command, with the nearest known one, or with the commands that have it."""
    # Without the dashes, which every option has in common.
    if near := _near(flag.lstrip("-").replace("_", "-"), [name.lstrip("-") for name in known]):
        return f'"{flag}" (did you mean --{near}?)'
    owners = ", ".join(name for name in COMMANDS if flag in _flags(command_of(name)))
    return f'"{flag}" (which is an option of {owners})' if owners else f'"{flag}"'


def _near(word: str, names: tuple[str, ...] | list[str]) -> str:
    """The name nearest to a word, or "" where none is near."""
    return next(iter(difflib.get_close_matches(word.lower(), names, 1, NEAR)), "")


def _flags(command: Any) -> list[str]:
    """The options of a command and of its groups, as on the command line."""
    flags: list[str] = []
    for name, hint in get_type_hints(command, include_extras=True).items():
        metadata = getattr(hint, "__metadata__", ())
        if Positional[int].__metadata__[0] in metadata:  # type: ignore[attr-defined]
            continue
        kind = getattr(hint, "__origin__", hint) if metadata else hint
        if hasattr(kind, "__dataclass_fields__"):
            flags += _flags(kind)
            continue
        name = next((named for part in metadata if (named := getattr(part, "name", None))), name).replace("_", "-")
        flags += [f"--{name}", f"--no-{name}"] if kind is bool else [f"--{name}"]
    return flags


def _first_part(box: str) -> str:
    """The first part of the box that tyro draws around an error, as one line."""
    # tyro draws with dashes and bars where the output is not in UTF-8.
    lines = [line.strip("│| ") for line in box.splitlines() if line.startswith(("│", "|"))]
    rules = [k for k, line in enumerate(lines) if line and set(line) <= set("─-")]
    text = " ".join(lines[: rules[0] if rules else None]).rstrip(".")
    # For an option that may be omitted, tyro lists the error of each of its types.
    return WRONG_TYPE.sub(r"\1 is \3, needs \2", text)
