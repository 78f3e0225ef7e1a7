"""Presets, their settings, and the placement of fixed cameras."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sim.datasets.fixed_cameras import corner_cameras, place_cameras
from sim.datasets.presets import PETS_GROUND, PRESETS, confine, preset_of, provenance, read_settings
from sim.scenario import Scenario
from worlds import catalogue
from worlds.world import World


@cache
def world(name: str) -> World:
    return catalogue.build(name, Scenario(world=name, seed=5).stream("world"), 0.5)


def test_sizes_are_those_of_the_recordings() -> None:
    sizes = {name: (p.scenario.frames, p.scenario.rate, p.scenario.people, p.scenario.at_once) for name, p in PRESETS.items()}
    new = {name: sizes.pop(name) for name in ("room", "room-rovers", "square")}
    assert new == {"room": (260, 4.0, 10, 0), "room-rovers": (260, 4.0, 10, 0), "square": (360, 2.0, 72, 24)}
    assert [(PRESETS[name].views, PRESETS[name].scenario.robots) for name in new] == [(4, 0), (0, 2), (7, 0)]
    assert sizes == {"pilsun": (333, 6.0, 10, 0), "s2l1": (795, 7.0, 19, 8), "s2l2": (436, 7.0, 43, 35), "s2l3": (240, 7.0, 74, 43)}
    assert all(4 <= preset.views <= 7 for name, preset in PRESETS.items() if name != "room-rovers")
    recorded = provenance("pilsun", PRESETS["pilsun"])
    assert (recorded["preset"], recorded["views"], recorded["people"], recorded["paper"]["i_bls_max"]) == ("pilsun", 4, 10, 2000)


def test_toml_and_json_settings_agree(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('world = "forest"\nframes = 100\nviews = 6\nmisses = 0.25\n')
    (tmp_path / "a.json").write_text('{"world": "forest", "frames": 100, "views": 6, "misses": 0.25}')
    toml, json = (preset_of("s2l1", read_settings(tmp_path / f"a.{ending}")) for ending in ("toml", "json"))
    assert toml == json
    assert (toml.views, toml.scenario.world, toml.scenario.frames, toml.scenario.misses, toml.scenario.people) == (6, "forest", 100, 0.25, 19)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", "frames = ", "a.toml: not TOML"),
        ("a.toml", "colour = 3", "setting is 'colour', needs one of views, world, "),
        ("a.toml", "frames = 1.5", "frames is 1.5, needs a whole number in"),
        ("a.toml", "rate = nan", "rate is nan"),
        ("a.toml", "views = true", "views is True"),
        ("a.json", "[1]", "a JSON list, needs an object"),
        ("a.json", '{"rate": NaN}', "holds NaN"),
        ("a.yaml", "", "needs an ending of .toml or .json"),
    ],
)
def test_invalid_settings_are_refused(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message.replace("[", r"\[")):
        preset_of("pilsun", read_settings(tmp_path / name))


@pytest.mark.parametrize("name", ["pilsun", pytest.param("tunnel", marks=pytest.mark.soak)])
def test_fixed_cameras_see_the_walkable_area(name: str) -> None:
    place = world(name)
    cameras = place_cameras(place, 4, 96)
    assert list(cameras) == ["View_001", "View_002", "View_003", "View_004"]
    i, j = np.nonzero(place.feet.free)
    ground = place.feet.origin + place.feet.spacing * np.stack([j, i], axis=1)
    points = np.column_stack([ground, place.terrain.height_at(ground) + 1.0])
    for one in cameras.values():
        _, inside = one.camera.pixels_from_bearings(one.pose.inverse().apply(points))
        assert inside.mean() > 0.2
        above = one.pose.translation[2] - place.terrain.height_at(one.pose.translation[None, :2])[0]
        assert 2.0 < above < 5.0
    again = place_cameras(place, 4, 96)
    assert all((again[view].pose.translation == cameras[view].pose.translation).all() for view in cameras)


def test_too_many_fixed_cameras_are_refused() -> None:
    with pytest.raises(ValueError, match="views is 99, more than the"):
        place_cameras(world("pilsun"), 99, 96)


def test_a_crowd_is_confined_to_the_ground_of_its_recording() -> None:
    place = world("campus")
    kept = confine(place, PETS_GROUND, np.random.default_rng(0))
    assert kept.feet.area < 27 * 25 < place.feet.area
    i, j = np.nonzero(kept.feet.free)
    extent = np.array([np.ptp(j), np.ptp(i)]) * kept.feet.spacing
    assert (extent <= PETS_GROUND).all()
    assert (extent > 0.8 * np.array(PETS_GROUND)).all()
    assert confine(place, None, np.random.default_rng(0)) is place


def test_cameras_of_a_room_are_in_its_corners_and_see_its_middle() -> None:
    preset = PRESETS["room"]
    room = catalogue.build(preset.scenario.world, preset.scenario.stream("world"), 0.0)
    cameras = corner_cameras(room, 4, 384)
    assert len(cameras) == 4
    for one in cameras.values():
        x, y, z = one.pose.translation
        # The room ends at 3.85 and 1.7 m.
        assert 3.3 < abs(x) < 3.85
        assert 1.15 < abs(y) < 1.7
        assert 2.0 <= z <= 3.0
        pixels, inside = one.camera.pixels_from_bearings(one.pose.inverse().apply(np.array([[0.0, 0.0, 0.8], [0.0, 0.0, 1.8]])))
        assert inside.all()
        np.testing.assert_allclose(pixels[0], [192, 144], atol=0.51)
    with pytest.raises(ValueError, match="views is 5, a room has 4 corners"):
        corner_cameras(room, 5, 384)
