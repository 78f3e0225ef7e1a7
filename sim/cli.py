"""Irregular worlds, people and panoramic robots: simulate, track, score. Bad input is one line, `error: …`, and exit code 2."""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import os
import sys
from typing import Annotated, get_args

import tyro

from sim.commands.check import Check
from sim.commands.clique import Clique
from sim.commands.compare import Compare
from sim.commands.demo import Demo
from sim.commands.doctor import Doctor
from sim.commands.export import Export
from sim.commands.generate import Generate
from sim.commands.info import Info
from sim.commands.place import Place
from sim.commands.report import Report
from sim.commands.score import Score
from sim.commands.stress import Stress
from sim.commands.study import Study
from sim.commands.track import Track
from sim.commands.view import View
from sim.commands.worlds import Worlds
from sim.gl import GLUnavailable

Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Track, tyro.conf.subcommand("track")]
    | Annotated[Score, tyro.conf.subcommand("score")]
    | Annotated[Study, tyro.conf.subcommand("study")]
    | Annotated[Worlds, tyro.conf.subcommand("worlds")]
    | Annotated[Clique, tyro.conf.subcommand("clique")]
    | Annotated[Generate, tyro.conf.subcommand("generate")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Info, tyro.conf.subcommand("info")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Place, tyro.conf.subcommand("place")]
    | Annotated[Stress, tyro.conf.subcommand("stress")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Compare, tyro.conf.subcommand("compare")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)


def main() -> None:
    """Entry point; leaves with 0, with 2 and one line where the input is at fault, with 130 when interrupted."""
    try:
        if sys.argv[1:] == ["--version"]:
            print(f"pilsim {importlib.metadata.version('pilsim')}")
            return
        _asked_for().run()
        sys.stdout.flush()
    except BrokenPipeError:
        # Who reads us has gone (`pilsim … | head`): nothing to say, and nothing to say it to.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        print("interrupted: what was whole is kept, the same command goes on from there", file=sys.stderr)
        sys.exit(130)
    except (ValueError, OSError, GLUnavailable) as error:
        print(f"error: {_said(error)}", file=sys.stderr)
        sys.exit(2)


def _said(error: Exception) -> str:
    """What went wrong, in one line; of files: which one, and what the system says of it."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return " ".join(f"{error.filename}: {error.strerror}".split())
    return " ".join(str(error).split())


def _asked_for() -> Command:
    """The command of the command line. Raises ValueError, in one line, for what it does not know."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(Command, prog="pilsim", description=__doc__)
    except SystemExit as left:
        if left.code == 2:
            raise ValueError(_in_a_line(said.getvalue())) from None
        raise


def _in_a_line(box: str) -> str:
    """What tyro draws as a box of many lines: its first part, the first option that it thinks was meant, and where more is to be read."""
    lines = [line.strip("│ ").strip() for line in box.splitlines() if line.startswith("│")]
    rules = [k for k, line in enumerate(lines) if line.startswith("──")]
    message = " ".join(lines[: rules[0] if rules else None])
    meant = [lines[k + 1].split()[0] for k, line in enumerate(lines[:-1]) if line == "Perhaps you meant:" and lines[k + 1]]
    names = {hint.__origin__.__name__.lower() for hint in get_args(Command)}
    command = f"{sys.argv[1]} " if sys.argv[1:] and sys.argv[1] in names else ""
    return f"{message.rstrip('.')}{f' (perhaps {meant[0]})' if meant else ''}; see pilsim {command}--help"


if __name__ == "__main__":
    main()
