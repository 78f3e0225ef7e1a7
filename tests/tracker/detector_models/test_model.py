"""Models as JSON: the round trip, the models of the package, and files that are refused in one line."""

import json
from pathlib import Path

import pytest

from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import INDEPENDENT, DetectorModel, chosen_model, model_names, model_of, named_model, read_model

NAMES = ["fairmot", "faster-rcnn", "keypoint-rcnn", "pets-det", "pixels"]


def test_models_of_the_package():
    assert model_names() == NAMES
    for name in NAMES:
        model = named_model(name)
        assert model.name == name
        assert all(low <= high for _, low, high in model.figures.values())
        for source in model.made["sources"]:
            first, end = source["frames"]
            # Real recordings are fitted in their first halves, and our own detector in rendered ones.
            real = {"CMC1": 130, "CMC2": 130, "S2.L1": 400}
            assert (first, end) == (0, real[source["folder"]] if name != "pixels" else end)
            assert (source["source"] == "pilsim") == (name == "pixels")


@pytest.mark.parametrize("name", NAMES)
def test_round_trip(name, tmp_path):
    model = named_model(name)
    text = model.to_json()
    assert DetectorModel.from_json(text).to_json() == text
    (tmp_path / "m.json").write_text(text)
    assert read_model(tmp_path / "m.json").to_json() == text
    chosen = chosen_model(str(tmp_path / "m.json"))
    found = model_of(chosen)
    assert isinstance(found, DetectorModel)
    assert found.to_json() == text
    assert chosen_model(name) == name


@pytest.mark.parametrize(("columns", "read"), [(5, (1.0, 1.0, 0.0)), (7, (0.2, 0.0, 0.0)), (8, (0.2, 0.0, 1.0))])
def test_files_of_versions_before_are_read(columns, read):
    content = json.loads(named_model("fairmot").to_json())
    row = [0.1, 0.0, 0.1, 0.0, 0.4, 0.2, 0.0, 1.0]
    content["second"]["samples"] = [row[:columns]]
    content["edges"] |= {"fills": [0.5] * 21, "fill_time_s": 2.0}
    model = DetectorModel.from_json(json.dumps(content))
    assert model.second.samples == ((*row[:5], *read),)
    assert model.edges == named_model("fairmot").edges


def test_independent_has_no_file():
    assert chosen_model(INDEPENDENT) == INDEPENDENT
    assert model_of(INDEPENDENT) == IndependentErrors()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 2}, "no detector model of schema 1"),
        ({"bodies": "feet"}, "bodies is 'feet', needs boxes or places"),
        ({"colour": 1}, "unknown field"),
        ({"misses": {}}, "misses needs the fields coefficients"),
        ({"misses.flicker": 1.5}, "misses.flicker is 1.5, needs 0 to 1"),
        ({"misses.flicker": "much"}, "misses.flicker is"),
        ({"misses.coefficients": [1, 2]}, "misses.coefficients needs 5 numbers"),
        ({"edges.lasting": [0, 0, 0, 2]}, r"edges.lasting\[3\] is 2"),
        ({"edges.correlation": [[1, 2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "symmetric"),
        ({"confidences.quantiles": list(range(21))[::-1]}, "rows that do not fall"),
        ({"false.samples": []}, "false.samples is empty"),
        ({"standing.samples": [[1, 2]]}, "standing.samples"),
        ({"figures": {"a": [1]}}, "figures.a needs three numbers"),
    ],
)
def test_bad_files(change, message, tmp_path):
    content = json.loads(named_model("fairmot").to_json())
    for name, value in change.items():
        part, _, field = name.partition(".")
        (content[part] if field else content).__setitem__(field or part, value)
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message) as caught:
        read_model(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_unknown_names():
    with pytest.raises(ValueError, match=r"needs independent, a file, or one of fairmot"):
        chosen_model("yolo")
    with pytest.raises(ValueError, match=r"none\.json: no such file"):
        chosen_model("none.json")
    with pytest.raises(ValueError, match="not JSON"):
        read_model(Path(__file__))
