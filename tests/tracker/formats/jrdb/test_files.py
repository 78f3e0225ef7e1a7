"""JRDB labels: round trips and errors."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from tracker.formats.jrdb.files import Label2d, Label3d, read_labels_2d, read_labels_3d, write_labels_2d, write_labels_3d

person = st.one_of(st.integers(0, 20), st.integers(2**31, 2**53 - 1))
four = st.tuples(*[st.floats(0, 4000)] * 4).map(np.array)
three = st.tuples(*[st.floats(-100, 100)] * 3).map(np.array)
labels_2d = st.builds(Label2d, person, four, four, st.floats(0, 1))
labels_3d = st.builds(Label3d, person, three, three, st.floats(-3.1, 3.1))

KINDS = {
    "2-D": (labels_2d, lambda path, labels: write_labels_2d(path, labels, 1024), read_labels_2d),
    "3-D": (labels_3d, write_labels_3d, read_labels_3d),
}


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=60, deadline=None)
@given(draw=st.data())
def test_labels_round_trip(kind: str, draw: st.DataObject) -> None:
    one, write, read = KINDS[kind]
    labels = draw.draw(st.dictionaries(st.integers(0, 999_999), st.lists(one, max_size=4), max_size=4))
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / "s.json", labels)
        again = read(Path(folder) / "s.json")
    assert list(again) == sorted(labels)
    for frame, found in again.items():
        for a, b in zip(found, labels[frame], strict=True):
            for name, value in vars(b).items():
                assert_array_equal(getattr(a, name), value)


def test_field_values_of_the_format(tmp_path: Path) -> None:
    visible = {
        1.0: "Fully_visible",
        0.95: "Fully_visible",
        0.94: "Mostly_visible",
        0.5: "Mostly_visible",
        0.01: "Severely_occluded",
        0.0: "Fully_occluded",
    }
    found = [Label2d(k, np.array([1000.0, 5, 30, 40]), np.zeros(4), v) for k, v in enumerate(visible)]
    write_labels_2d(tmp_path / "s.json", {7: found}, 1024)
    entries = json.loads((tmp_path / "s.json").read_text())["labels"]["000007.jpg"]
    assert [e["attributes"]["occlusion"] for e in entries] == list(visible.values())
    assert [e["label_id"] for e in entries] == [f"pedestrian:{k}" for k in range(len(visible))]
    assert all(e["wraps"] for e in entries)
    # Ahead and to the left, looking back at the camera along −x: seen from 135° less 180°.
    write_labels_3d(tmp_path / "d.json", {0: [Label3d(3, np.array([-2.0, 2.0, 0.0]), np.ones(3), np.pi)]})
    (entry,) = json.loads((tmp_path / "d.json").read_text())["labels"]["000000.pcd"]
    assert entry["observation_angle"] == pytest.approx(np.pi / 4)
    assert entry["attributes"]["distance"] == pytest.approx(8**0.5)


@pytest.mark.parametrize(("word", "visible"), [("Fully_visible", 1.0), ("Mostly_visible", 0.5), ("Severely_occluded", 0.25), ("Fully_occluded", 0.0)])
def test_jrdb_own_files_are_read(tmp_path: Path, word: str, visible: float) -> None:
    """Without our fields; the visible fraction is what the word says."""
    entry = {"label_id": "pedestrian:5", "box": [1, 2, 3, 4], "attributes": {"occlusion": word}}
    (tmp_path / "s.json").write_text(json.dumps({"labels": {"000012.jpg": [entry]}}))
    (label,) = read_labels_2d(tmp_path / "s.json")[12]
    assert (label.person, label.visible, label.occlusion) == (5, visible, word)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "a JSON list, needs an object"),
        ({"labels": {"a.jpg": []}}, "labels of 'a.jpg', needs NUMBER.jpg"),
        ({"labels": {"000001.png": []}}, "labels of '000001.png', needs NUMBER.jpg"),
        ({"labels": {"1.jpg": [{"label_id": "car:4", "box": [1, 2, 3, 4], "visibility": 1}]}}, "label_id is 'car:4', needs pedestrian:NUMBER"),
        ({"labels": {"1.jpg": [{"label_id": "pedestrian:4"}]}}, r"labels: 1\.jpg\[0\]: box is missing"),
        ({"labels": {"1.jpg": [{"label_id": "pedestrian:4", "box": [1, 2, 3, 4], "visibility": 2}]}}, "visibility is 2, needs a number from 0 to 1"),
    ],
)
def test_errors_name_the_file(tmp_path: Path, content: object, message: str) -> None:
    (tmp_path / "s.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message) as error:
        read_labels_2d(tmp_path / "s.json")
    assert str(error.value).startswith(str(tmp_path / "s.json"))
