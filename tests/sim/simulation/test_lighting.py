"""Kinds of light, sky and wet ground as changes of a model."""

import mujoco
import numpy as np
import pytest

from sim.scenario import LIGHTS, Scenario
from sim.simulation.lighting import add_lamps, apply, set_light
from tests.sim.plaza import plaza


def models(**fields: object) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """The plaza, and the plaza with the light of a scenario."""
    plain, lit = plaza().spec.copy().compile(), plaza().spec.copy().compile()
    apply(lit, Scenario(**fields))
    return plain, lit


def appearance(model: mujoco.MjModel) -> list[np.ndarray]:
    names = ("light_dir", "light_diffuse", "light_ambient", "light_specular", "light_castshadow", "mat_rgba", "mat_specular", "tex_data")
    return [*(np.array(getattr(model, name)) for name in names), np.array(model.vis.headlight.ambient)]


def test_by_default_nothing_changes():
    plain, lit = models()
    for a, b in zip(appearance(plain), appearance(lit), strict=True):
        np.testing.assert_array_equal(a, b)


def test_kinds_of_light_do_what_they_say():
    plain, overcast = models(light="overcast")
    assert plain.light_castshadow.any()
    assert not overcast.light_castshadow.any()
    assert (overcast.light_diffuse < plain.light_diffuse).all()
    plain, low = models(light="low", seed=4)
    elevation = np.degrees(-np.arcsin(low.light_dir[:, 2]))
    assert ((elevation > 8) & (elevation < 30)).all()
    assert (low.light_diffuse[:, 0] >= low.light_diffuse[:, 2]).all()
    plain, dim = models(light="dim")
    np.testing.assert_allclose(dim.light_diffuse, 0.5 * plain.light_diffuse)
    np.testing.assert_allclose(dim.vis.headlight.ambient, 0.5 * plain.vis.headlight.ambient)
    # The sky of each kind is another one, and grey under clouds.
    skies = [models(light=kind)[1].tex_data.astype(float).mean() for kind in LIGHTS]
    assert len({round(sky, 3) for sky in skies}) == len(LIGHTS)


def test_a_light_is_drawn_from_the_seed_alone():
    one, two, other = (models(light="low", seed=seed)[1].light_dir.copy() for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert np.abs(one - other).max() > 0.01


def test_wet_ground_is_darker_and_shines():
    plain, wet = models(wet=1.0)
    material = int(plain.geom_matid[plain.geom("ground").id])
    assert (wet.mat_rgba[material, :3] < 0.6 * plain.mat_rgba[material, :3]).all()
    assert wet.mat_specular[material] > 5 * plain.mat_specular[material]
    assert wet.light_specular.max() > 0.5
    damp = models(wet=0.3)[1]
    assert (wet.mat_rgba[material, :3] < damp.mat_rgba[material, :3]).all()


def test_lamps_replace_the_sun():
    spec = plaza().spec.copy()
    add_lamps(spec, plaza().ground.extent, 0.0, np.random.default_rng(0))
    model = spec.compile()
    on = model.light_active.astype(bool)
    assert on.sum() == 4
    assert (model.light_type[on] == int(mujoco.mjtLightType.mjLIGHT_POINT)).all()
    low, high = plaza().ground.extent
    assert ((model.light_pos[on, :2] > low) & (model.light_pos[on, :2] < high)).all()


def test_unknown_kinds_are_refused():
    with pytest.raises(ValueError, match=r"light is 'neon', needs one of built, overcast, low, dim, lamps"):
        Scenario(light="neon")
    with pytest.raises(ValueError, match=r"clothing is 'loud', needs plain or varied"):
        Scenario(clothing="loud")
    before = plaza().spec.copy().compile()
    set_light(before, "built", np.random.default_rng(0))
    np.testing.assert_array_equal(before.light_diffuse, plaza().spec.copy().compile().light_diffuse)
