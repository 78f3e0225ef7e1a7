"""The command line of pilsim. Read `main` first. Each command is a class of its own file in this folder."""

from __future__ import annotations

import contextlib
import difflib
import importlib.metadata
import io
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterator
from typing import Annotated, Any, get_type_hints

import tyro
from tyro.conf import Positional, subcommand

from pilsim import leave
from sim.cli.check import Check
from sim.cli.clique import Clique
from sim.cli.compare import Compare
from sim.cli.demo import Demo
from sim.cli.detect import Detect
from sim.cli.doctor import Doctor
from sim.cli.export import Export
from sim.cli.fit_detector import FitDetector
from sim.cli.generate import Generate
from sim.cli.info import Info
from sim.cli.place import Place
from sim.cli.predict import Predict
from sim.cli.report import Report
from sim.cli.score import Score
from sim.cli.score_detections import ScoreDetections
from sim.cli.streams import guard_streams
from sim.cli.stress import Stress
from sim.cli.study import Study
from sim.cli.track import Track
from sim.cli.train_detector import TrainDetector
from sim.cli.view import View
from sim.cli.worlds import Worlds
from sim.rendering.gl_context import GLUnavailable

Command = (
    Annotated[Demo, subcommand("demo")]
    | Annotated[Doctor, subcommand("doctor")]
    | Annotated[Generate, subcommand("generate")]
    | Annotated[Worlds, subcommand("worlds")]
    | Annotated[Check, subcommand("check")]
    | Annotated[Info, subcommand("info")]
    | Annotated[Export, subcommand("export")]
    | Annotated[View, subcommand("view")]
    | Annotated[Detect, subcommand("detect")]
    | Annotated[Track, subcommand("track")]
    | Annotated[Score, subcommand("score")]
    | Annotated[ScoreDetections, subcommand("score-detections")]
    | Annotated[Clique, subcommand("clique")]
    | Annotated[FitDetector, subcommand("fit-detector")]
    | Annotated[TrainDetector, subcommand("train-detector")]
    | Annotated[Predict, subcommand("predict")]
    | Annotated[Stress, subcommand("stress")]
    | Annotated[Report, subcommand("report")]
    | Annotated[Compare, subcommand("compare")]
    | Annotated[Place, subcommand("place")]
    | Annotated[Study, subcommand("study")]
)


def name_of(command: type) -> str:
    """The name of a command on the command line: FitDetector is fit-detector."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", command.__name__).lower()


GROUPS: dict[str, tuple[type, ...]] = {
    "Start": (Demo, Doctor),
    "Data": (Generate, Worlds, Check, Info, Export, View),
    "Tracking": (Detect, Track, Score, ScoreDetections, Clique),
    "Experiments": (FitDetector, TrainDetector, Predict, Stress, Report, Compare, Place, Study),
}
"""The commands as the overview shows them."""
COMMANDS = {name_of(command): command for group in GROUPS.values() for command in group}
WIDEST = 120
"""Largest width of the help of a command, columns."""
WRONG_TYPE = re.compile(r"Error parsing (\S+): no type matching \{None\}\|(\S+) could be instantiated from \[(.*?)\]\. .*")
"""What tyro says of a word that is not of the type of its option."""
NEAR = 0.7
"""Least similarity, from 0 to 1 (difflib), of a word to the name that an error message suggests for it."""


def main() -> None:
    """Run the command line. The exit code is 0, 2 with one line for bad input, or 130 when interrupted."""
    output = guard_streams()
    try:
        words = sys.argv[1:]
        if words == ["--version"]:
            print(f"pilsim {importlib.metadata.version('pilsim')}")
        elif words[:1] in (["--help"], ["-h"]):
            print(overview())
        elif command := _parse(words):
            command.run()
        output.flush()
        if output.failure is not None:
            raise OSError(output.failure.errno, output.failure.strerror, "standard output")
    except BrokenPipeError:
        # The reader of the pipe has ended (`pilsim … | head`), so that a message would reach nobody.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        leave("interrupted: complete results are kept, the same command continues from there")
    except (ValueError, OSError, GLUnavailable) as error:
        print(f"error: {_message(error)}", file=sys.stderr)
        sys.exit(2)


def overview() -> str:
    """The help of `pilsim` itself: a line for each command, in groups, at most 80 columns wide."""
    lines = ["usage: pilsim COMMAND [OPTIONS]", "", "Simulate people and panoramic robots in irregular worlds, track them, score.", ""]
    for title, commands in GROUPS.items():
        lines.append(f"{title}:")
        lines += [f"  {name_of(command):9} {(command.__doc__ or '').splitlines()[0]}" for command in commands]
        lines.append("")
    return "\n".join([*lines, "`pilsim COMMAND --help` shows options and examples; see also `pilsim --version`."])


def _message(error: Exception) -> str:
    """The error in one line. An error of a file is its name and the message of the system."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return " ".join(f"{error.filename}: {error.strerror}".split())
    return " ".join(str(error).split())


def _parse(words: list[str]) -> Command | None:
    """The command of the command line; None where its help was asked for and is printed. Raises ValueError, in one line, for a wrong word."""
    _check_names(words)
    errors, output = io.StringIO(), _Output()
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(output), _at_most(WIDEST):
            return tyro.cli(Command, prog="pilsim", args=words)
    except SystemExit as exit_:
        if exit_.code == 2:
            raise ValueError(f"{_first_part(errors.getvalue())}; see pilsim {words[0]} --help") from None
        print("\n".join(_wrapped(output.getvalue())))
        return None


@contextlib.contextmanager
def _at_most(columns: int) -> Iterator[None]:
    """Limit the apparent width of the terminal. In a wide one, tyro puts expert options beside the common ones."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = str(min(columns, shutil.get_terminal_size().columns))
    try:
        yield
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before


class _Output(io.StringIO):
    """A buffer for help. It behaves like the real output, so that tyro uses colors and boxes where the real output has them."""

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return sys.__stdout__.encoding.lower() if sys.__stdout__ is not None else "utf-8"

    def isatty(self) -> bool:
        return sys.__stdout__ is not None and sys.__stdout__.isatty()


def _wrapped(text: str) -> Iterator[str]:
    """The lines of the help of a command. Paragraphs, which tyro joins to one line each, are wrapped to the terminal."""
    width = max(40, min(WIDEST, shutil.get_terminal_size().columns))
    for line in text.rstrip("\n").split("\n"):
        # Boxes fit the terminal already. Examples are indented, and stay on one line for copying.
        prose = line and not line.startswith((" ", "│", "╭", "╰", "Example"))
        yield from textwrap.wrap(line, width, break_long_words=False, break_on_hyphens=False) if prose else [line]


def _check_names(words: list[str]) -> None:
    """Raises ValueError where the command or an option is unknown, and suggests the nearest name."""
    if not words:
        raise ValueError(f"a command is missing, needs one of {', '.join(COMMANDS)}; see pilsim --help")
    if words[0].startswith("-"):
        raise ValueError(f"{words[0]} stands before the command; see pilsim --help")
    if words[0] not in COMMANDS:
        near = _near(words[0], list(COMMANDS))
        raise ValueError(f'pilsim has no command "{words[0]}"{f"; did you mean {near}?" if near else ";"} see pilsim --help')
    if {"-h", "--help"} & set(words):
        return
    known = [*_flags(COMMANDS[words[0]]), "--help"]
    given = [word.partition("=")[0] for word in words[1:] if word.startswith("--") and len(word) > 2]
    unknown = list(dict.fromkeys(flag for flag in given if flag.replace("_", "-") not in known))
    if unknown:
        faults = ", ".join(_unknown(flag, known) for flag in unknown)
        raise ValueError(f"{words[0]} has no option {faults}; see pilsim {words[0]} --help")


def _unknown(flag: str, known: list[str]) -> str:
    """An unknown option of a command, with the nearest known one, or with the commands that have it."""
    owners = ", ".join(name for name, other in COMMANDS.items() if flag in _flags(other))
    # Without the dashes, which every option has in common.
    near = _near(flag.lstrip("-").replace("_", "-"), [name.lstrip("-") for name in known])
    if near:
        return f'"{flag}" (did you mean --{near}?)'
    return f'"{flag}" (which is an option of {owners})' if owners else f'"{flag}"'


def _near(word: str, names: list[str]) -> str:
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
    # Of an option that may be left out, tyro lists the error of each of its types.
    return WRONG_TYPE.sub(r"\1 is \3, needs \2", text)


if __name__ == "__main__":
    main()
