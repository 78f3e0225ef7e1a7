"""Height maps of a user: the ground is where the formula has it, and what cannot be used is one line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.worlds.inspection import can_be_walked, rays_hit_the_ground
from tests.worlds.places.samples import hills, pixel_centres, write_png
from worlds import catalogue
from worlds.places.height_map import read_height_map
from worlds.places.place import place_of
from worlds.world import World

tifffile = pytest.importorskip("tifffile")
UTM = (1024, 0, 1, 1, 3072, 0, 1, 25832)
"""GeoKeys of a projected map in UTM zone 32: header, then (id, where, count, value)."""


def built(name: str, seed: int = 0) -> World:
    return catalogue.build(name, np.random.default_rng(seed), 0.5)


def write_tiff(path: Path, heights: np.ndarray, pixel: float, model: int = 1, vertical: int = 9001) -> str:
    """vertical: unit of heights, as EPSG numbers it."""
    keys = (1, 1, 0, 3, 1024, 0, 1, model, 3072, 0, 1, 25832, 4099, 0, 1, vertical)
    tags = [(33550, "d", 3, (pixel, pixel, 0.0), True), (33922, "d", 6, (0, 0, 0, 500_000.0, 5_400_000.0, 0), True), (34735, "H", 16, keys, True)]
    tifffile.imwrite(path, heights.astype(np.float32), extratags=[*tags, (42113, "s", 0, "-9999", True)])
    return str(path)


def test_a_png_becomes_ground_in_metres(tmp_path: Path) -> None:
    world = built(write_png(tmp_path / "dem.png"))
    points = np.random.default_rng(0).uniform(-18, 18, (2000, 2))
    error = world.terrain.height_at(points) - hills(*points.T)
    assert np.ptp(error) < 0.02  # the lowest height became 0 m
    rays_hit_the_ground(world)
    can_be_walked(world, 74)


def test_choices_of_a_place_are_read_again(tmp_path: Path) -> None:
    """place.toml makes the same world as the text that it came from; an area moves nothing."""
    name = write_png(tmp_path / "dem.png") + ",area=-12:-8:10:14,licence=CC0,entrances=0:0/5:5"
    world = built(name)
    (tmp_path / "place.toml").write_text(world.place)
    again = built(str(tmp_path / "place.toml"))
    np.testing.assert_array_equal(world.ground.heights, again.ground.heights)
    np.testing.assert_array_equal(world.spawn.mean(axis=1), [[0, 0], [5, 5]])
    assert again.place == world.place
    assert tomllib.loads(world.place)["licence"] == "CC0"
    points = np.random.default_rng(0).uniform(-8, 8, (500, 2))
    assert np.ptp(world.terrain.height_at(points) - hills(*points.T)) < 0.02


def test_heights_of_a_geotiff_may_be_feet_and_have_a_level(tmp_path: Path) -> None:
    z = hills(*pixel_centres(40.0, 80))
    feet = write_tiff(tmp_path / "feet.tif", z / 0.3048, 0.5, vertical=9002)
    np.testing.assert_allclose(
        read_height_map(place_of(feet)).ground.heights, built(write_tiff(tmp_path / "m.tif", z, 0.5)).ground.heights, atol=1e-3
    )
    assert read_height_map(place_of(f"{feet}:low=100")).found["found_lowest"] == pytest.approx(100.0, abs=0.1)


def test_a_stored_place_is_found_from_the_present_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`generate` writes the path of a place as it was given, into another folder."""
    (tmp_path / "out").mkdir()
    name = write_png(tmp_path / "dem.png").replace(str(tmp_path / "dem.png"), "dem.png")
    monkeypatch.chdir(tmp_path)
    Path("out/place.toml").write_text(built(name).place)
    assert place_of("out/place.toml").source == Path("dem.png")


def test_a_geotiff_has_its_metres_and_its_holes(tmp_path: Path) -> None:
    z = hills(*pixel_centres(60.0, 120))
    z[40:60, 50:80] = np.nan
    z[5, 5] = -9999
    world = built(write_tiff(tmp_path / "dem.tif", z, 0.5))
    np.testing.assert_allclose(world.ground.extent, [[-30, -30], [30, 30]], atol=0.3)
    points = np.random.default_rng(0).uniform(-29, 29, (3000, 2))
    hole = (np.abs(points - [2.5, 5]) < [7.5, 5]).all(axis=1)
    assert np.ptp((world.terrain.height_at(points) - hills(*points.T))[~hole]) < 0.1
    assert not world.feet.free_at(points[(np.abs(points - [2.5, 5]) < [5.5, 3]).all(axis=1)]).any()
    assert world.feet.free_at(np.array([[-27.25, 27.25]])).all(), "a pixel without height is filled"
    told = tomllib.loads(world.place)
    assert told["found_crs"] == "EPSG:25832"
    assert told["found_north_west_corner"] == [500_000.0, 5_400_000.0]
    assert any("no height" in note for note in world.notes)


def test_the_orthophoto_lies_on_its_ground(tmp_path: Path) -> None:
    """The north-east quarter of the map is red; cropped to it, all of the ground is."""
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32, 32:, 0] = 255
    Image.fromarray(picture).save(tmp_path / "photo.png")
    world = built(write_png(tmp_path / "dem.png") + f",texture={tmp_path / 'photo.png'},area=1:1:19:19")
    texture = next(t for t in world.spec.textures if t.name == "ground")
    pixels = np.frombuffer(texture.data, np.uint8).reshape(texture.height, texture.width, 3)
    assert (pixels[:, :, 0] > 250).all()


BAD = {
    "{png}": "a PNG has no metres, needs size, low, high",
    "{png}:size=x,low=0,high=1": "size is 'x', needs a number",
    "{png}:size=1,low=0,high=1": "needs at least 3 m a side",
    "{png}:size=40,low=2,high=1": "high is 1.0 m, needs at least low",
    "{png}:size=40,low=0,high=1,up=z": "'up' is no choice of a height map",
    "{png}:size=40,low=0,high=1,area=1:2:3": "needs X0:Y0:X1:Y1",
    "{png}:size=40,low=0,high=400": "nothing is free",
    "{png}:size=40,low=0,high=4,entrances=100:0": "entrance 100:0 is not free",
    "{png}:size=40,low=0,high=4,texture=none.jpg": "texture none.jpg: no such file",
    "{folder}/colour.png:size=40,low=0,high=4": "is a picture in color",
    "{folder}/eight.png:size=40,low=0,high=40": r"has 8 bits, so that 40 m are in steps of 0\.5 m, needs 16 bits",
    "{folder}/broken.png:size=40,low=0,high=4": "no PNG that can be read",
    "{folder}/broken.tif": "no TIFF that can be read",
    "{folder}/nan.tif": "has no height at all",
    "{folder}/holes.tif": "has no height, needs at most 25%; crop it with area",
    "{folder}/degrees.tif": "is in degrees, needs metres",
    "{folder}/none.tif": "no such file",
    "site.usd": r"export it as \.glb",
    "site.laz": "make a mesh of it",
}


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bad")
    write_png(folder / "dem.png")
    z = hills(*pixel_centres(60.0, 60))
    write_tiff(folder / "nan.tif", np.full_like(z, np.nan), 1.0)
    write_tiff(folder / "degrees.tif", z, 0.0001, model=2)
    write_tiff(folder / "holes.tif", np.where(z > 3, np.nan, z), 1.0)
    Image.fromarray(np.zeros((9, 9, 3), np.uint8)).save(folder / "colour.png")
    Image.fromarray(np.arange(81, dtype=np.uint8).reshape(9, 9)).save(folder / "eight.png")
    for broken in ("broken.png", "broken.tif"):
        (folder / broken).write_bytes(b"II*\0 not a picture")
    return folder


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_used_is_one_line(bad_files: Path, name: str) -> None:
    with pytest.raises(ValueError, match=BAD[name]) as raised:
        built(name.format(png=bad_files / "dem.png", folder=bad_files))
    assert "\n" not in str(raised.value)


def test_a_name_is_checked_before_the_work(tmp_path: Path) -> None:
    catalogue.check_name(write_png(tmp_path / "dem.png"))
    assert place_of(write_png(tmp_path / "dem.png")).size == 40
    with pytest.raises(ValueError, match="no such file"):
        catalogue.check_name(str(tmp_path / "other.png"))
