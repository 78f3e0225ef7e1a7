"""site.json: round trips of pillars and errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tracker.formats.pets2009 import PILLARS, Site, read_site, write_site
from tracker.geometry.ground import Flat

SITE = Site(6.0, np.array([[-5.0, -4.0], [5.0, 4.0]]), Flat(), pillars=np.array([[1.0, 2.0, 0.1, 0.0, 2.5], [1.0, 2.0, 0.3, 2.5, 3.0]]))


def test_pillars_round_trip(tmp_path: Path) -> None:
    write_site(tmp_path, SITE, None)
    site = read_site(tmp_path)
    np.testing.assert_array_equal(site.pillars, SITE.pillars)
    np.testing.assert_array_equal(site.area, SITE.area)


def test_default_pillars(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_site(tmp_path).pillars, PILLARS)
    (tmp_path / "site.json").write_text(json.dumps({"rate": 7, "area": [[0, 0], [1, 1]], "terrain": None}))
    assert read_site(tmp_path).pillars.shape == (0, 5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pillars": [[1, 2, 0.1, 0]]}, "pillars is .*, needs 1 x 5 numbers .*: rows of x, y, radius, low and high in metres"),
        ({"pillars": [[1, 2, 0, 0, 2]]}, "pillars is .*, needs rows of x, y, radius, low and high in metres"),
        ({"pillars": "x"}, "pillars is 'x', needs"),
        ({"rate": None}, "rate is missing"),
        ({"area": [[0, 0], [0, 1]]}, "area is .*needs two corners"),
        ({"terrain": "../terrain.npz"}, "terrain is '../terrain.npz', needs 'terrain.npz' or null"),
    ],
)
def test_invalid_sites_are_refused(tmp_path: Path, change: dict[str, object], message: str) -> None:
    (tmp_path / "site.json").write_text(json.dumps({"rate": 7, "area": [[0, 0], [1, 1]], "terrain": None} | change))
    with pytest.raises(ValueError, match=rf"site.json: {message}"):
        read_site(tmp_path)
