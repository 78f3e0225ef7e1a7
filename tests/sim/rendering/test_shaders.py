"""Projections of points by hand, and lights against the model."""

import mujoco
import numpy as np
import pytest

from sim.rendering.shaders import MOST_LIGHTS, Lights, shadow_view


def clip(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    out = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return out[:, :3] / out[:, 3:]


@pytest.mark.parametrize("direction", [[0.3, 0.1, -1], [0, 0, -1], [1, 0, -0.2]])
def test_a_parallel_shadow_holds_every_point_and_grows_away_from_the_light(direction: list[float]) -> None:
    points = np.random.default_rng(1).uniform(-7, 9, (100, 3))
    matrix = shadow_view(np.array([0, 0, 10, *direction]), None, points)
    found = clip(matrix, points)
    assert (np.abs(found[:, :2]) < 1).all()
    assert ((found[:, 2] > 0) & (found[:, 2] < 1)).all()
    step = clip(matrix, points + 0.1 * np.array(direction) / np.linalg.norm(direction)) - found
    assert np.abs(step[:, :2]).max() < 1e-12
    assert (step[:, 2] > 0).all()


def test_the_shadow_map_of_a_spot_is_its_view() -> None:
    place, direction, points = np.array([1.0, 2, 5]), np.array([0, 0.6, -0.8]), np.array([[1.0, 5, 1], [2, 2, 0]])
    matrix = shadow_view(np.concatenate([place, direction]), np.radians(45.0), points)
    axis = clip(matrix, place + np.array([[1.0], [3.0]]) * direction)
    np.testing.assert_allclose(axis[:, :2], 0, atol=1e-9)
    assert 0 < axis[0, 2] < axis[1, 2] < 1
    side = np.cross(direction, [1.0, 0, 0])
    edge = clip(matrix, (place + 2 * direction + 2 * side)[None])
    assert np.linalg.norm(edge[0, :2]) == pytest.approx(1)


def test_lights_with_shadows_come_first_and_the_headlight_last() -> None:
    spec = mujoco.MjSpec()
    for name, shadow, active in (("fill", False, True), ("off", True, False), ("sun", True, True)):
        spec.worldbody.add_light(name=name, type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=shadow, active=active, dir=[0, 0, -1])
    model = spec.compile()
    lights = Lights.of(model)
    assert [model.light(int(k)).name if k >= 0 else "head" for k in lights.index] == ["sun", "fill", "head"]
    assert lights.shadows == 1
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    parameters_at = lights.parameters_at(data, np.array([1.0, 2, 3]))
    assert parameters_at[2, 0, :3].tolist() == [1, 2, 3]
    assert parameters_at[:2, 1, :3].tolist() == [[0, 0, -1]] * 2


def test_without_lights_there_is_ambient_light() -> None:
    spec = mujoco.MjSpec()
    spec.visual.headlight.active = 0
    lights = Lights.of(spec.compile())
    assert len(lights.index) == 0
    assert lights.ambient == pytest.approx(0.3)


def test_more_lights_than_can_be_drawn_are_refused() -> None:
    spec = mujoco.MjSpec()
    for _ in range(MOST_LIGHTS):
        spec.worldbody.add_light()
    with pytest.raises(ValueError, match=f"{MOST_LIGHTS + 1} lights, needs at most {MOST_LIGHTS}"):
        Lights.of(spec.compile())
