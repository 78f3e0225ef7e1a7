"""Plants: stems that are solid and convex, crowns over people's heads that nobody runs into."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import trimesh

from worlds.props.meshes import PERIOD
from worlds.props.plants import Plant, broadleaf, bush, canvases, conifer, log, stump

MAKERS: dict[str, Callable[[np.random.Generator], Plant]] = {
    "broadleaf": lambda rng: broadleaf(rng, 5.0),
    "conifer": lambda rng: conifer(rng, 8.0),
    "bush": lambda rng: bush(rng, 1.2),
    "stump": stump,
}
HEAD = 2.0


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("seed", range(3))
def test_wood_is_convex_and_rooted(name: str, seed: int) -> None:
    plant = MAKERS[name](np.random.default_rng(seed))
    solid = trimesh.Trimesh(plant.wood.vertices, plant.wood.faces, process=True)
    assert solid.is_watertight
    np.testing.assert_allclose(solid.volume, solid.convex_hull.volume, rtol=1e-9)
    assert plant.wood.vertices[:, 2].min() <= -0.3, "a stem must reach into the ground, which is not level"
    at_ground = plant.wood.vertices[plant.wood.vertices[:, 2] <= 0.1]
    assert np.hypot(at_ground[:, 0], at_ground[:, 1]).max() <= plant.radius * 1.07 + 1e-9
    assert len(plant.wood.faces) + (0 if plant.leaves is None else len(plant.leaves.faces)) <= 600


@pytest.mark.parametrize("height", [4.0, 6.0, 10.0])
@pytest.mark.parametrize("make", [broadleaf, conifer])
def test_people_walk_under_crowns(make: Callable[[np.random.Generator, float], Plant], height: float) -> None:
    for seed in range(10):
        tree = make(np.random.default_rng(seed), height)
        assert tree.leaves is not None
        assert tree.leaves.vertices[:, 2].min() >= HEAD
        assert tree.leaves.vertices[:, 2].max() <= 1.2 * height


def test_leaves_stop_nobody_and_wood_does() -> None:
    rng = np.random.default_rng(0)
    spec = mujoco.MjSpec()
    for material in canvases(rng):
        spec.add_material(name=material)
    broadleaf(rng, 5.0).stand(spec, "tree0", [1, 2, 3], 0.5)
    model = spec.compile()
    wood, leaves = model.geom("tree0"), model.geom("tree0-leaves")
    assert wood.contype[0]
    assert not leaves.contype[0]
    assert not leaves.conaffinity[0]


def test_a_log_lies_along_x() -> None:
    stem = log(np.random.default_rng(0), 3.0, 0.2)
    np.testing.assert_allclose(stem.vertices.min(axis=0)[0], -1.5)
    np.testing.assert_allclose(np.ptp(stem.vertices, axis=0)[0], 3.0)
    assert np.hypot(stem.vertices[:, 1], stem.vertices[:, 2]).max() <= 0.2 + 1e-9


def test_foliage_has_texture_at_every_scale() -> None:
    for name, canvas in canvases(np.random.default_rng(0), 0.3).items():
        grey = canvas.pixels.mean(axis=2)
        assert canvas.width == canvas.height == PERIOD
        for step in (1, 4, 16):
            cut = grey[: len(grey) // step * step, : len(grey) // step * step]
            means = cut.reshape(len(cut) // step, step, len(cut) // step, step).mean(axis=(1, 3))
            assert np.abs(np.diff(means, axis=1)).mean() > 1.0, (name, step)
