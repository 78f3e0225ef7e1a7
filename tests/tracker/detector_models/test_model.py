"""Models as JSON: the round trip of both kinds, the models of the package, files of before, and files that are refused in one line."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from tracker.detector_models.independent import IndependentErrors
from tracker.detector_models.model import (
    INDEPENDENT,
    chosen_model,
    model_names,
    model_of,
    model_text,
    named_model,
    parse_model,
    read_model,
)

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


@pytest.mark.parametrize("model", [named_model("fairmot"), named_model("pets-det"), IndependentErrors(0.3, 0.5, 0.004, 0.1)], ids=["a", "b", "c"])
def test_round_trip(model, tmp_path):
    text = model_text(model)
    (tmp_path / "m.json").write_text(text)
    for found in (parse_model(text), read_model(tmp_path / "m.json"), model_of(chosen_model(str(tmp_path / "m.json")))):
        assert model_text(found) == text
        assert asdict(found) == asdict(model)


def test_names_stand_for_models():
    assert [chosen_model(name) for name in ("fairmot", INDEPENDENT)] == ["fairmot", INDEPENDENT]
    assert model_of(INDEPENDENT) == IndependentErrors()
    assert parse_model('{"schema": 1, "kind": "independent", "misses": 0.2}') == IndependentErrors(misses=0.2)


@pytest.mark.parametrize(("columns", "read"), [(5, (1.0, 1.0, 0.0)), (7, (0.2, 0.0, 0.0)), (8, (0.2, 0.0, 1.0))])
def test_files_of_versions_before_are_read(columns, read):
    content = json.loads(model_text(named_model("fairmot")))
    row = [0.1, 0.0, 0.1, 0.0, 0.4, 0.2, 0.0, 1.0]
    content["second"]["samples"] = [row[:columns]]
    content["edges"] |= {"fills": [0.5] * 21, "fill_time_s": 2.0}
    del content["kind"]
    model = parse_model(json.dumps(content))
    assert model.second.samples == ((*row[:5], *read),)
    assert model.edges == named_model("fairmot").edges


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 2}, "no detector model of schema 1"),
        ({"kind": "best"}, "no detector model of schema 1, fitted or independent"),
        ({"kind": "independent"}, "the model needs the fields misses, clutter, noise, min_visible"),
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
        ({"standing.samples": [[1, 2]]}, "standing.samples needs at most 400 x 6 numbers"),
        ({"second.rates": [], "second.coefficients": [0.0] * 6}, "second.rates is empty, needs rates where there are coefficients"),
        ({"second.samples": [[1.0] * 8] * 401}, "second.samples needs at most 400 x 8 numbers"),
        ({"edges.trend": [[0.0] * 7] * 4}, "edges.trend needs trend_bounds"),
        ({"figures": {"a": [1]}}, "figures.a needs three numbers"),
    ],
)
def test_bad_files(change, message, tmp_path):
    content = json.loads(model_text(named_model("fairmot")))
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
    with pytest.raises(ValueError, match=r"detector model: misses is 2, needs 0 to 1"):
        parse_model('{"schema": 1, "kind": "independent", "misses": 2}')
