"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

Out = Annotated[Path, arg(metavar="DIR")]


def unset(metavar: str, meaning: str) -> Any:
    """What help says of an option that is not there by default: how its value is called, and what happens without it, in place of `None`."""
    return arg(metavar=metavar, help_behavior_hint=f"(default: {meaning})")


def numbers(text: str) -> list[int]:
    """Views as in 1,5,7. Raises ValueError for anything else."""
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise ValueError(f"--views is {text!r}, needs numbers as in 1,5,7") from None


def views_of(run: dict[str, Any]) -> list[int]:
    """The views that a run.json names. Raises ValueError where that is no list of numbers."""
    views = run.get("views", [])
    if not isinstance(views, list) or not all(isinstance(view, int) for view in views):
        raise ValueError(f"run.json: views is {views!r}, needs a list of numbers")
    return views
