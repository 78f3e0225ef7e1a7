"""Distractors stand on free ground, close no way, and have a class that is not a person's."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from worlds import catalogue
from worlds.scenes.distractor_placement import with_distractors
from worlds.semantics import CLASSES, class_of


def test_distractors_shrink_free_space_and_repeat() -> None:
    world = catalogue.build("pilsun", np.random.default_rng(1), 0.25)
    assert with_distractors(world, np.random.default_rng(2), 0) is world
    one, two = (with_distractors(world, np.random.default_rng(2), 8) for _ in range(2))
    before, after = world.spec.copy().compile(), one.spec.copy().compile()
    added = [after.geom(k).name for k in range(before.ngeom, after.ngeom)]
    assert len(added) == 8
    assert all(class_of(name) not in (CLASSES.index("person"), CLASSES.index("robot")) for name in added)
    assert not (one.feet.free & ~world.feet.free).any()
    assert one.feet.area < world.feet.area
    again = two.spec.copy().compile()
    np.testing.assert_array_equal(after.geom_pos, again.geom_pos)
    data = mujoco.MjData(after)
    mujoco.mj_forward(after, data)
    assert not one.feet.free_at(data.geom_xpos[before.ngeom :, :2]).any()


def test_too_many_distractors_are_refused() -> None:
    world = catalogue.build("pilsun", np.random.default_rng(1), 0.25)
    with pytest.raises(ValueError, match="distractors is 400"):
        with_distractors(world, np.random.default_rng(2), 400)
