"""Building fronts around a world, and their windows that glare."""

import mujoco
import numpy as np
import pytest

from sim.scenario import Scenario
from sim.simulation.simulation import furnished
from tests.sim.plaza import plaza
from worlds.props.facades import add_facades
from worlds.semantics import CLASSES, class_of
from worlds.terrain.heightfield import Heightfield

GROUND = Heightfield.flat([[-9.0, -6.0], [9.0, 6.0]], 0.5)


def compiled(glare: float) -> mujoco.MjModel:
    """Three buildings around a level ground."""
    spec = mujoco.MjSpec()
    add_facades(spec, np.random.default_rng(2), GROUND, 3, glare)
    return spec.compile()


def panes(model: mujoco.MjModel) -> int:
    """Number of corners of the panes that glare."""
    return sum(int(model.mesh_vertnum[model.geom_dataid[k]]) for k in range(model.ngeom) if not model.geom(k).name.endswith("facade"))


def test_fronts_stand_around_the_ground_and_a_share_of_their_panes_glares() -> None:
    model, all_ = compiled(0.4), compiled(1.0)
    data, (low, high) = mujoco.MjData(model), GROUND.extent
    mujoco.mj_forward(model, data)
    for k in range(model.ngeom):
        name, mesh = model.geom(k).name, int(model.geom_dataid[k])
        corners = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]] @ data.geom_xmat[k].reshape(3, 3).T + data.geom_xpos[k]
        assert ((corners[:, :2] < low) | (corners[:, :2] > high)).any(axis=1).all()
        assert CLASSES[class_of(name)] == "wall"
        assert not model.geom_contype[k]
        assert model.mat_emission[model.geom_matid[k]] == float(not name.endswith("facade"))
    assert 0.25 < panes(model) / panes(all_) < 0.55


def test_free_space_stays_and_nothing_changes_by_default() -> None:
    world = plaza()
    assert furnished(world, Scenario()) is world
    built = furnished(world, Scenario(facades=1))
    assert built.feet is world.feet
    assert len(built.spec.geoms) == len(world.spec.geoms) + 1
    assert "facades" not in Scenario().to_json()
    assert Scenario.from_json(Scenario(facades=2, glare=0.5).to_json()) == Scenario(facades=2, glare=0.5)


def test_glare_needs_facades() -> None:
    with pytest.raises(ValueError, match=r"glare is 0\.5 and facades is 0"):
        Scenario(glare=0.5)
