"""dataset.json and the sequences of a dataset."""

from pathlib import Path

import pytest

from tests.tracker import sequences as made
from tracker.sequence.dataset import Dataset, read_dataset, sequences

DATASET = Dataset("pilsun", {"seed": 3}, 4, {"png": False}, ("pilsun-00000", "pilsun-00001"))


def test_round_trip(tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_text(DATASET.to_json())
    assert read_dataset(tmp_path) == DATASET


def test_only_complete_sequences_are_listed(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="neither a sequence"):
        sequences(tmp_path)
    (tmp_path / "dataset.json").write_text(DATASET.to_json())
    (tmp_path / "pilsun-00000").mkdir()
    with pytest.raises(ValueError, match="no sequence of this dataset is complete yet"):
        sequences(tmp_path)
    made.write(tmp_path / "pilsun-00001")
    assert sequences(tmp_path) == [tmp_path / "pilsun-00001"]
    assert sequences(tmp_path / "pilsun-00001") == [tmp_path / "pilsun-00001"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"schema": 1', '"schema": 7', "schema is 7, this version reads 1"),
        ('"views": 4', '"views": "4"', "views is str, needs int"),
        ("pilsun-00001", "../pilsun", "sequence is '../pilsun', needs a name of letters"),
        ("pilsun-00001", "pilsun-00000", "a name occurs twice"),
        ('"seed": 3', '"seed": Infinity', "holds Infinity"),
        ("{", "[", "not JSON"),
    ],
)
def test_errors_name_the_file(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "dataset.json").write_text(DATASET.to_json().replace(old, new, 1))
    with pytest.raises(ValueError, match=f"dataset.json.*{message}"):
        read_dataset(tmp_path)
