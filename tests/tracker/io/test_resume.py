"""Resumption: folders with the same run, another run, or other content."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from tracker.io.resume import check_same, holds_run, json_value


def test_folder_holds_a_statement_or_is_empty(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    assert not holds_run(folder, "run.json")
    folder.mkdir()
    assert not holds_run(folder, "run.json")
    for name in (".lock", ".lock.pid"):
        (folder / name).touch()
    assert not holds_run(folder, "run.json")
    (folder / ".notes").touch()
    assert not holds_run(folder, "run.json", (".*",))
    with pytest.raises(ValueError, match=r"out: holds \.notes and no run\.json; choose another --out or remove it"):
        holds_run(folder, "run.json")
    (folder / "run.json").touch()
    assert holds_run(folder, "run.json")
    with pytest.raises(ValueError, match=r"run\.json: is a file, needs a folder"):
        holds_run(folder / "run.json", "run.json")


def test_results_and_order_of_keys_are_not_compared(tmp_path: Path) -> None:
    check_same(tmp_path, {"b": {"y": [1, 2], "x": None}, "a": 1, "result": 3}, {"a": 1, "b": {"x": None, "y": (1, 2)}})
    check_same(tmp_path, {"a": {"old": 1}}, {"a": {"old": 1, "new": None}})


@pytest.mark.parametrize(
    ("there", "wanted", "message"),
    [
        ({"a": 1}, {"a": 2}, "holds another run (a 1 there, 2 asked for)"),
        ({"a": {"b": [1]}}, {"a": {"b": [2]}}, "(a.b [1] there, [2] asked for)"),
        ({}, {"a": "x"}, "(a null there, x asked for)"),
        ({"a": {"b": 1, "c": 2}}, {"a": {"b": 1}}, "(a.c 2 there, null asked for)"),
    ],
)
def test_the_message_names_the_first_difference(tmp_path: Path, there: dict[str, object], wanted: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match="choose another --out or remove it") as error:
        check_same(tmp_path, there, wanted)
    assert message in str(error.value)


@dataclass(frozen=True)
class Inner:
    path: Path = Path("a/b")
    limit: float = float("inf")


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    pair: tuple[float, ...] = (1.0, 2.5)
    array: np.ndarray = field(default_factory=lambda: np.eye(2))


def test_dataclasses_become_json() -> None:
    assert json_value(Outer()) == {"inner": {"path": "a/b", "limit": "inf"}, "pair": [1.0, 2.5], "array": [[1.0, 0.0], [0.0, 1.0]]}
    with pytest.raises(ValueError, match="a value is a set, needs a JSON type"):
        json_value({"a": {1}})
