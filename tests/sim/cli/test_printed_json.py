"""JSON that commands print is JSON by RFC 8259, on the emptiest inputs, too."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from tests.commands import pilsim
from tracker.io.json_files import json_text

BOX = "1,{0},10,10,5,9,1,{1},2,0\n"


def printed(*words: str) -> Any:
    """What a command prints, read by the standard."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    done = pilsim(*words, "--json")
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return json.loads(done.stdout, parse_constant=refuse)


@pytest.mark.command
@pytest.mark.parametrize(("truth", "result"), [("", ""), ("", BOX.format(1, 1)), (BOX.format(1, 1), ""), (BOX.format(1, 1), BOX.format(1, 90))])
@pytest.mark.parametrize("iou", [(), ("--iou", "0.5")])
def test_score_without_matches(tmp_path: Path, truth: str, result: str, iou: tuple[str, ...]) -> None:
    (tmp_path / "gt.txt").write_text(truth)
    (tmp_path / "out.txt").write_text(result)
    assert isinstance(printed("score", "--truth", str(tmp_path / "gt.txt"), "--result", str(tmp_path / "out.txt"), *iou), dict)


@pytest.mark.command
def test_clique_of_a_graph_without_edges(tmp_path: Path) -> None:
    for text in ("p edge 1 0\n", "p edge 2 0\nn 1 1e-9\nn 2 1e60\n"):
        (tmp_path / "a.clq").write_text(text)
        for exact in ((), ("--exact",)):
            assert "weight" in printed("clique", str(tmp_path / "a.clq"), "--seconds", "0.1", *exact)


@pytest.mark.command
def test_a_sequence_without_people(tmp_path: Path) -> None:
    folder = tmp_path / "d"
    command = ["generate", "pilsun", "--frames", "2", "--people", "0", "--robots", "1", "--width", "64", "--fixed-cameras", "0", "--out", str(folder)]
    done = pilsim(*command)
    assert done.returncode == 0, done.stderr
    printed("info", str(folder))
    printed("check", str(folder))


def test_finite_values_are_unchanged() -> None:
    value = {"a": [1, 2.5, None, True, "x"], "b": {"c": 1e-300, "d": (3, -0.0)}, 4: []}
    assert json_text(value, 1) == json.dumps(value, indent=1)
    assert json_text({"a": [math.nan, -math.inf, (math.inf,)]}) == '{"a": [null, null, [null]]}'
