"""The benchmark of parts: what it leaves out is there."""

from importlib import import_module

import pytest

from tests.benchmarks.parts import PARTS, WITH, main, row
from tracker.parameter_file import with_fields
from tracker.tracks.parameters import MhtParameters


@pytest.mark.parametrize("part", [part for part in PARTS if part != WITH])
def test_what_a_part_is_left_out_by_is_there_and_differs(part: str) -> None:
    without = PARTS[part]
    assert without.values or without.attributes
    assert not without.values or with_fields(MhtParameters(), without.values, "") != MhtParameters()
    for path, value in without.attributes.items():
        module, names = path.split(":")
        found = import_module(module)
        for name in names.split("."):
            found = getattr(found, name)
        assert found != value


def test_a_row_has_the_mean_of_differences() -> None:
    cases = [{"hota": 0.5 + 0.1 * k, "mota": 0.2, "idf1": float("nan"), "seconds": 2.0} for k in range(4)]
    lower = [case | {"hota": case["hota"] - 0.03, "seconds": 1.0} for case in cases]
    words = row("x", {WITH: cases, "x": lower}).split()
    assert (words[1], words[2]) == ("0.50", "−0.0300")
    assert words[6] == "+0.0000"


def test_an_unknown_part_is_refused() -> None:
    with pytest.raises(SystemExit) as raised:
        main(["--parts", "gravity"])
    assert raised.value.code == 2
