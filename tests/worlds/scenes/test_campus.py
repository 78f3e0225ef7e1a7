"""The campus is where PETS 2009 was filmed: its paths are free and its cameras see them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tracker.formats import pets2009
from tracker.geometry.ground import Flat
from tracker.io import tsai_xml
from worlds import catalogue
from worlds.scenes import campus_objects
from worlds.terrain.heightfield import Array
from worlds.world import World

Data = Callable[..., Path]


@cache
def campus(difficulty: float) -> World:
    return catalogue.build("campus", np.random.default_rng(3), difficulty)


@pytest.fixture(scope="module")
def feet(data: Data) -> Array:
    """(n, 2) m: everywhere that somebody of the complete annotations stands."""
    _, camera, T_world_camera = tsai_xml.read_camera(data("pets2009", "calibration", "View_001.xml"))
    found = []
    for name in ("S1.L1/annotations/PETS2009-S1L1-1.xml", "S2.L1/annotations/PETS2009-S2L1.xml"):
        annotations = pets2009.read_annotations(data("pets2009", *name.split("/")))
        found += [p for _, p in pets2009.ground_truth(annotations, camera, T_world_camera, Flat(0.0)).values()]
    return np.concatenate(found)[:, :2]


def test_without_difficulty_the_ground_is_level_where_people_walk_and_they_walk_free(feet: Array) -> None:
    world = campus(0.0)
    ring = 0.5 * np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 12)])
    around = (feet[:, None] + ring).reshape(-1, 2)
    np.testing.assert_array_equal(world.terrain.height_at(around), 0.0)
    assert world.feet.free_at(feet).all()
    # Nothing that stands there reaches into half a metre around anybody.
    model = world.spec.copy().compile()
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    geom = np.zeros(1, dtype=np.int32)
    for x, y in around[::47]:
        d = mujoco.mj_ray(model, state, np.array([x, y, 2.1]), np.array([0, 0, -1.0]), None, 1, -1, geom, None)
        assert d == pytest.approx(2.1, abs=1e-6)


def test_without_difficulty_the_cameras_see_whom_they_saw(feet: Array, data: Data) -> None:
    world = campus(0.0)
    model = world.spec.copy().compile()
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    thin = np.array([class_.startswith("pole") for class_ in (model.geom(k).name for k in range(model.ngeom))])
    for view in range(1, 9):
        _, camera, T_world_camera = tsai_xml.read_camera(data("pets2009", "calibration", f"View_{view:03d}.xml"))
        eye = T_world_camera.translation
        assert np.linalg.norm(campus_objects.CAMERAS[view - 1] - eye[:2]) < 0.02
        bodies = np.concatenate([np.column_stack([feet[::40], np.full(len(feet[::40]), z)]) for z in (0.1, 1.7)])
        way = bodies - eye
        length = np.linalg.norm(way, axis=1)
        _, seen = camera.pixels_from_bearings(way / length[:, None] @ T_world_camera.rotation)
        way, length = way[seen] / length[seen, None], length[seen]
        geom, distance = np.zeros(len(way), dtype=np.int32), np.zeros(len(way))
        mujoco.mj_multiRay(model, state, eye, way.ravel(), None, 1, -1, geom, distance, None, len(way), 200.0)
        hidden = (geom >= 0) & (distance < length - 0.05) & ~thin[geom]
        assert not hidden.any(), f"View_{view:03d}: {model.geom(geom[hidden][0]).name} is in the way"


def test_with_difficulty_there_are_kerbs_to_step_up_and_ramps_to_roll_up() -> None:
    world = campus(0.6)
    # From the road onto the lawns west and south of it.
    nodes = world.ground.nodes[(world.wheels.clearance > 0.3) & (campus_objects.kept_clear(world.ground.nodes) > 2)]
    for lawn in (nodes[nodes[:, 0] < -15], nodes[(nodes[:, 0] > 0) & (nodes[:, 1] < -12)]):
        assert len(world.wheels.route((-8.0, -3.0), lawn[len(lawn) // 2])) >= 2
    kerb = world.ground.height_at([(-10.6, 1.5), (-9.4, 1.5)])
    assert 0.03 < kerb[0] - kerb[1] < 0.25
    assert np.ptp(world.ground.heights[world.feet.free]) > 0.5
    assert len(world.feet.sample(np.random.default_rng(0), 200, 0.1, 1.0)) == 200


def test_the_ramp_of_the_building_is_walked_up() -> None:
    world = campus(0.6)
    assert world.feet.free_at([(10.5, 2.0), (11.8, 2.0)]).all()
    assert world.terrain.height_at([(11.8, 2.0)])[0] - world.ground.height_at([(11.8, 2.0)])[0] > 0.25
