"""What is given away is the scene: rays and surfaces agree with the original."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.worlds.places.samples import MODEL
from worlds import catalogue
from worlds.export import export
from worlds.triangles import scenery
from worlds.world import World


@pytest.fixture(scope="module")
def world() -> World:
    return catalogue.build("hall:room=7.7x3.4", np.random.default_rng(3), 0.5)


def ranges(model: mujoco.MjModel, extent: np.ndarray) -> np.ndarray:
    """What 2000 rays from 2 m over the lowest place meet, m."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(1)
    out = []
    for _ in range(2000):
        eye, way = np.array([*rng.uniform(*extent), 2.0]), rng.normal(size=3)
        out.append(mujoco.mj_ray(model, data, eye, way / np.linalg.norm(way), None, 1, -1, np.zeros(1, np.int32), None))
    return np.array(out)


LOAD: dict[str, Callable[[str], mujoco.MjModel]] = {
    "scene.xml": mujoco.MjModel.from_xml_path,
    "scene.mjz": lambda path: mujoco.MjSpec.from_file(path).compile(),
}


@pytest.mark.parametrize("name", LOAD)
def test_mujoco_reads_the_same_scene_back(world: World, tmp_path: Path, name: str) -> None:
    export(world, tmp_path / name)
    again = LOAD[name](str(tmp_path / name))
    # XML holds six digits.
    np.testing.assert_allclose(ranges(again, world.ground.extent), ranges(world.spec.copy().compile(), world.ground.extent), atol=2e-4)
    assert again.ntex == world.spec.copy().compile().ntex


@pytest.mark.parametrize("form", ["glb", "obj", "ply"])
def test_other_programs_get_the_same_triangles(world: World, tmp_path: Path, form: str) -> None:
    path = tmp_path / f"scene.{form}"
    export(world, path)
    loaded = trimesh.load(path)
    mesh = loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
    whole = scenery(world.spec).to_mesh()
    np.testing.assert_allclose(np.sort(mesh.bounds, axis=0), whole.bounds, atol=1e-4)
    assert mesh.area == pytest.approx(whole.area, rel=1e-4)


def test_triangles_lie_on_the_terrain(world: World) -> None:
    scene = scenery(world.spec)
    ground = scene.geometry["ground"]
    # Middles of triangles tell how cells are split.
    middles = ground.triangles_center
    np.testing.assert_allclose(middles[:, 2], world.ground.height_at(middles), atol=1e-5)
    assert set(scene.geometry) == {geom.name for geom in world.spec.geoms}


def test_textures_keep_their_side_up(world: World) -> None:
    """The colour of the ground's picture under a corner of the height field is that of the picture's same corner."""
    visual = scenery(world.spec).geometry["ground"].visual
    texture = world.spec.texture("ground")
    pixels = np.frombuffer(texture.data, np.uint8).reshape(texture.height, texture.width, 3)
    colours = visual.to_color().vertex_colors[:, :3].astype(int)
    columns = world.ground.heights.shape[1]
    for vertex, corner in ((0, pixels[-1, 0]), (columns - 1, pixels[-1, -1]), (len(colours) - 1, pixels[0, -1])):
        assert np.abs(colours[vertex] - corner).max() <= 40


@pytest.mark.parametrize("form", ["xml", "mjz", "glb"])
def test_the_same_world_gives_the_same_bytes(world: World, tmp_path: Path, form: str) -> None:
    for folder in ("a", "b"):
        export(world, tmp_path / folder / f"scene.{form}")
    a, b = ({p.name: p.read_bytes() for p in (tmp_path / folder).rglob("*") if p.is_file()} for folder in ("a", "b"))
    assert a == b


def test_another_ending_is_refused(world: World, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"needs an ending of \.xml, \.mjz, \.glb, \.obj, \.ply"):
        export(world, tmp_path / "scene.stl")
    assert not any(tmp_path.iterdir())


def test_two_obj_exports_in_one_folder_share_no_file(world: World, tmp_path: Path) -> None:
    export(world, tmp_path / "a.obj")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    export(catalogue.build("hall:room=7.7x3.4", np.random.default_rng(1), 0.5), tmp_path / "b.obj")
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    loaded = trimesh.load(tmp_path / "a.obj")
    materials = [mesh.visual.material for mesh in loaded.geometry.values()]
    assert any(material.image is not None and max(material.image.size) > 16 for material in materials)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A place of MJCF that reads meshes and pictures from files, with a material without a picture."""
    folder = tmp_path_factory.mktemp("site")
    trimesh.creation.cone(0.6, 1.2).export(folder / "cone.obj")
    trimesh.creation.box((1, 2, 1)).export(folder / "brick.stl")
    pixels = np.random.default_rng(0).integers(0, 255, (6, 32, 32, 3), dtype=np.uint8)
    Image.fromarray(pixels[0]).save(folder / "wood.png")
    Image.fromarray(pixels.reshape(-1, 32, 3)).save(folder / "sides.png")
    assets = (
        '<mesh name="cone" file="cone.obj" scale="1 1 2"/><mesh name="brick" file="brick.stl"/><texture name="wood" type="2d" file="wood.png"/>'
        '<texture name="sides" type="cube" file="sides.png" gridsize="6 1" gridlayout="RLUDFB"/><material name="cubic" texture="sides"/>'
        '<material name="wooden" texture="wood"/><material name="red" rgba="1 0 0 1"/></asset>'
    )
    geoms = (
        '<geom type="mesh" mesh="cone" pos="3 2 0"/><geom type="mesh" mesh="brick" material="wooden" pos="-3 -2 0.5"/>'
        '<geom name="red" type="box" size=".3 .3 .3" pos="0 3 .3" material="red"/>'
        '<geom type="box" size=".3 .3 .3" pos="1 3 .3" material="cubic"/></worldbody>'
    )
    (folder / "site.xml").write_text(MODEL.replace("</asset>", assets).replace("</worldbody>", geoms))
    return catalogue.build(str(folder / "site.xml"), np.random.default_rng(0), 0.5)


@pytest.mark.parametrize("name", LOAD)
def test_a_place_with_files_is_exported_with_them(site: World, tmp_path: Path, name: str) -> None:
    export(site, tmp_path / name)
    again, model = LOAD[name](str(tmp_path / name)), site.spec.copy().compile()
    np.testing.assert_allclose(ranges(again, site.ground.extent), ranges(model, site.ground.extent), atol=2e-4)
    np.testing.assert_array_equal(again.tex_data, model.tex_data)


def test_materials_without_a_picture_keep_their_colour(site: World) -> None:
    assert scenery(site.spec).geometry["place/red"].visual.face_colors[0].tolist() == [255, 0, 0, 255]
