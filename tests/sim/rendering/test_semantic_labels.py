"""Classes of a simulation's geoms."""

import mujoco
import numpy as np
import pytest

from sim.rendering.semantic_labels import classes
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from worlds.semantics import CLASSES


def test_geoms_have_the_classes_of_people_robots_and_worlds() -> None:
    simulation = Simulation(Scenario(people=2, robots=1))
    found = classes(simulation.model)
    drawn = np.isin(simulation.model.geom_group, (0, 1, 2, 3)) & (simulation.model.geom_rgba[:, 3] > 0)
    assert (found[drawn & (simulation.person_of_geom > 0)] == CLASSES.index("person")).all()
    assert (found[drawn & (simulation.robot_of_geom > 0)] == CLASSES.index("robot")).all()
    rest = drawn & (simulation.person_of_geom == 0) & (simulation.robot_of_geom == 0)
    assert CLASSES[found[simulation.model.geom("ground").id]] == "ground"
    assert set(found[rest].tolist()).isdisjoint({0, CLASSES.index("person"), CLASSES.index("robot")})


def test_an_unknown_kind_is_named() -> None:
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="unicorn1", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0])
    with pytest.raises(ValueError, match="unicorn"):
        classes(spec.compile())
