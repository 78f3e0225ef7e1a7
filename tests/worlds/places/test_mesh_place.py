"""Meshes and MJCF of a user: free space and heights are those of the geometry, whatever its format, axes and unit."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from tests.worlds.inspection import can_be_walked
from tests.worlds.places.samples import MODEL, house, write_house
from worlds import catalogue
from worlds.places import mesh_file
from worlds.places.mesh_file import read_mesh
from worlds.places.place import place_of
from worlds.semantics import class_of, kind_of
from worlds.world import World


def built(name: str, seed: int = 0) -> World:
    return catalogue.build(name, np.random.default_rng(seed), 0.5)


@pytest.fixture(scope="module")
def glb(tmp_path_factory: pytest.TempPathFactory) -> World:
    return built(write_house(tmp_path_factory.mktemp("places") / "house.glb"))


def test_people_walk_on_steps_and_slopes_and_rovers_on_slopes(glb: World) -> None:
    can_be_walked(glb, 40)
    expected = {
        (-8, 6): (True, True), (0, 0): (True, True), (0, -4.9): (True, True), (-7.5, -4.5): (True, True),  # lawn, room, door, slope
        (2.25, 3.4): (True, False), (3.6, 3.4): (True, False),  # steps, platform
        (-4.9, 0): (False, False), (-2.2, 1.5): (False, False), (3, -4.9): (False, False),  # wall, table, wall
    }  # fmt: skip
    points = np.array(list(expected), dtype=float)
    found = list(zip(glb.feet.free_at(points).tolist(), glb.wheels.free_at(points).tolist(), strict=True))
    assert dict(zip(expected, found, strict=True)) == expected
    assert any("left out: 1" in note for note in glb.notes), "the roof"


def test_feet_are_on_the_drawn_surface(glb: World) -> None:
    """Heights of the terrain are those of rays on the model, on the slope and on the steps, too, to a millimetre."""
    model = glb.spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    drawn, geom = np.array([1, 1, 0, 0, 0, 0], np.uint8), np.zeros(1, np.int32)
    points = np.random.default_rng(0).uniform([-9.5, -7.5], [9.5, 7.5], (4000, 2))
    points = points[glb.feet.free_at(points)]
    for (x, y), height in zip(points, glb.terrain.height_at(points), strict=True):
        distance = mujoco.mj_ray(model, data, np.array([x, y, height + 0.5]), np.array([0.0, 0.0, -1.0]), drawn, 1, -1, geom, None)
        assert abs(distance - 0.5) < 1e-3, (x, y)
    assert max(glb.terrain.height_at(points)) > 0.6


@pytest.mark.parametrize(("suffix", "unit"), [(".obj", 1.0), (".ply", 1.0), (".obj", 0.001), (".ply", 0.01)])
def test_format_axis_and_unit_do_not_matter(tmp_path: Path, glb: World, suffix: str, unit: float) -> None:
    name = write_house(tmp_path / f"house{suffix}", unit)
    world = built(name)
    told = tomllib.loads(world.place)
    assert (told["up"], told["unit"]) == ("z", unit)
    np.testing.assert_allclose(world.ground.extent, glb.ground.extent, atol=1e-3)
    assert (world.feet.free != glb.feet.free).mean() < 1e-3


def test_parts_have_the_class_of_their_names(glb: World) -> None:
    names = {geom.name for geom in glb.spec.geoms}
    assert {re.sub(r"\d", "", name) for name in names} >= {"ground", "wall", "beam", "table"}
    assert all(class_of(name) for name in names)
    assert kind_of("Old_OakTree.003 Material") == "tree"
    assert kind_of("mesh_17") is None
    assert kind_of("door_mat") == "table", "no wall"


def test_a_scan_without_names_is_ground_where_one_walks(tmp_path: Path) -> None:
    (tmp_path / "scan.ply").write_bytes(house().to_mesh().export(file_type="ply"))
    world = built(str(tmp_path / "scan.ply"))
    assert {re.sub(r"\d", "", geom.name) for geom in world.spec.geoms} == {"ground", "beam"}


def test_the_roof_can_be_chosen(tmp_path: Path) -> None:
    world = built(write_house(tmp_path / "house.glb") + ":level=3.2")
    points = world.feet.points(world.feet.free)
    np.testing.assert_allclose(world.terrain.height_at(points), 3.2, atol=1e-3)


def test_more_triangles_than_the_bound_are_reduced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fast_simplification")
    monkeypatch.setattr("worlds.places.mesh_file.MOST_TRIANGLES", 4000)
    ground = trimesh.creation.box(extents=(30, 20, 1)).subdivide().subdivide().subdivide().subdivide().subdivide()
    (tmp_path / "fine.ply").write_bytes(ground.export(file_type="ply"))
    world = built(f"{tmp_path / 'fine.ply'}")
    assert any("reduced" in note for note in world.notes)
    assert sum(len(mesh.userface) // 3 for mesh in world.spec.meshes) <= 4500
    can_be_walked(world, 40)


def test_reduced_faces_keep_colours_of_the_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of a hill is red and half is blue: no face of the simplified hill has a colour between."""
    x, y = np.meshgrid(np.linspace(-10, 10, 60), np.linspace(-10, 10, 60))
    hill = trimesh.Trimesh(np.column_stack([x.ravel(), y.ravel(), np.sin(x.ravel() / 4)]), _cells(60), process=False)
    hill.visual = trimesh.visual.ColorVisuals(
        hill, vertex_colors=np.where(x.ravel()[:, None] < 0, [255, 0, 0, 255], [0, 0, 255, 255]).astype(np.uint8)
    )
    (tmp_path / "hill.ply").write_bytes(hill.export(file_type="ply"))
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 2000)
    part = read_mesh(place_of(str(tmp_path / "hill.ply"))).parts[0]
    assert part.uv is not None
    assert part.image is not None
    assert len(part.faces) < 3000
    texel = np.floor(part.uv[part.faces] * [1, -1] * mesh_file.PALETTE + [0, mesh_file.PALETTE]).astype(int)
    assert (np.ptp(texel, axis=1) == 0).all(), "one colour a face"
    colour = part.image[texel[:, 0, 1], texel[:, 0, 0]]
    pure = (colour == [255, 0, 0]).all(axis=1) | (colour == [0, 0, 255]).all(axis=1)
    assert pure.mean() > 0.9, "but for the cells of the border"


def _cells(n: int) -> np.ndarray:
    """Triangles of a grid of n x n vertices."""
    node = np.arange(n * n).reshape(n, n)
    a, b, c, d = node[:-1, :-1].ravel(), node[:-1, 1:].ravel(), node[1:, 1:].ravel(), node[1:, :-1].ravel()
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def test_ceilings_occlude_nobody_and_towers_do(tmp_path: Path) -> None:
    """A scan of a room has a ceiling of one sheet that faces down. A tower of 60 m begins above where rays to usual tops do."""
    scene = trimesh.Scene()
    for name, low, high in (("ground", (-10, -10, -0.5), (10, 10, 0)), ("building", (2, 2, 0), (4, 4, 60.0))):
        box = trimesh.creation.box(bounds=[low, high])
        scene.add_geometry(box, node_name=name, geom_name=name)
    sheet = trimesh.Trimesh(
        [(-8, -8, 3), (0, -8, 3), (0, 0, 3), (-8, 0, 3), (-4, -4, 3.01)], [(1, 0, 4), (2, 1, 4), (3, 2, 4), (0, 3, 4)], process=False
    )
    scene.add_geometry(sheet, node_name="ceiling", geom_name="ceiling")
    (tmp_path / "town.ply").write_bytes(scene.to_mesh().export(file_type="ply"))
    tops = built(f"{tmp_path / 'town.ply'}:unit=m,up=z").tops()
    assert tops.height_at(np.array([[-4.0, -4.0], [3.0, 3.0], [8.0, -8.0]])) == pytest.approx([0.0, 60.0, 0.0], abs=0.02)


def test_a_part_of_one_triangle_is_drawn(tmp_path: Path) -> None:
    scene = house()
    scene.add_geometry(trimesh.Trimesh([(6, 6, 0.5), (7, 6, 0.5), (6, 7, 0.5)], [(0, 1, 2)], process=False), node_name="flag", geom_name="flag")
    scene.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    (tmp_path / "flag.glb").write_bytes(scene.export(file_type="glb"))
    model = built(str(tmp_path / "flag.glb")).spec.copy().compile()
    assert min(model.mesh_facenum) == 2, "MuJoCo takes no single triangle, but its halves"


def test_mjcf_is_a_place_with_its_cameras_and_moving_bodies(tmp_path: Path) -> None:
    (tmp_path / "site.xml").write_text(MODEL)
    world = built(str(tmp_path / "site.xml"))
    points = np.array([[0, 0], [2, -2], [-3, 2], [4, 3]], dtype=float)
    assert world.feet.free_at(points).tolist() == [True, False, False, True]
    np.testing.assert_allclose(world.terrain.height_at(points[[0, 3]]), [0, 0.1], atol=1e-6)
    (camera,) = world.cameras
    assert camera.name == "gate"
    np.testing.assert_allclose(camera.rotation[:, 0], [np.sqrt(0.75), 0, -0.5], atol=5e-3)
    np.testing.assert_allclose(camera.position, [-6, 0, 3])
    model = world.spec.copy().compile()
    data = mujoco.MjData(model)
    for _ in range(400):
        mujoco.mj_step(model, data)
    assert 0.35 < data.body("place/robot_0").xpos[2] < 0.45, "the ball has fallen"


BAD = {
    "tiny.ply": (lambda p: p.write_bytes(trimesh.creation.box((0.4, 0.4, 0.4)).export(file_type="ply")), "needs 3 to 2000 m a side; tell unit="),
    "broken.glb": (lambda p: p.write_bytes(b"glTF nothing"), "no mesh that can be read"),
    "empty.ply": (lambda p: p.write_bytes(trimesh.PointCloud(np.eye(3) * 9).export(file_type="ply")), "no (mesh|triangles)"),
    "nan.obj": (lambda p: p.write_text("v nan 0 0\nv 9 0 0\nv 9 9 0\nf 1 2 3\n"), "no triangles"),
    "include.xml": (lambda p: p.write_text('<mujoco><include file="other.xml"/></mujoco>'), "MuJoCo cannot use it: .*other.xml"),
    "twice.xml": (
        lambda p: p.write_text('<mujoco><worldbody><geom name="a" size="1"/><geom name="a" size="1"/></worldbody></mujoco>'),
        "MuJoCo cannot use it: .*repeated name 'a'",
    ),
    "nothing.xml": (lambda p: p.write_text("<mujoco/>"), "has no geom that is drawn"),
    "small.xml": (lambda p: p.write_text('<mujoco><worldbody><geom type="plane" size="0.5 0.5 1"/></worldbody></mujoco>'), "the place is 1 x 1 m"),
}


@pytest.mark.parametrize("file", BAD)
def test_what_cannot_be_used_is_one_line(tmp_path: Path, file: str) -> None:
    write, message = BAD[file]
    write(tmp_path / file)
    with pytest.raises(ValueError, match=message) as raised:
        built(str(tmp_path / file))
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith(str(tmp_path / file))
