import mujoco
import numpy as np
import pytest

from sim import gait, pedestrian
from sim.clothes import add_person
from sim.pedestrian import LIMBS
from worlds.heightfield import Heightfield

STATURE = 1.8


def dressed(seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A person who stands at the origin and looks along x."""
    spec = mujoco.MjSpec()
    add_person(spec, "person_1", STATURE, np.random.default_rng(seed))
    model = spec.compile()
    data = mujoco.MjData(model)
    stature, place, heading = np.array([STATURE]), np.zeros((1, 2)), np.zeros(1)
    poses = pedestrian.pose(stature, gait.stand(place, heading, stature), place, heading, Heightfield.flat([[-1, -1], [1, 1]], 0.5))
    for k, limb in enumerate(LIMBS):
        body = model.body(f"person_1/{limb}").mocapid[0]
        data.mocap_pos[body], data.mocap_quat[body] = poses.position[0, k], poses.quaternion[0, k]
    mujoco.mj_forward(model, data)
    return model, data


def span(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """(2, 3) m: the box that an ellipsoid, a capsule or a box along the world's axes fills."""
    R, size = data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom]
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        half = np.linalg.norm(R * size, axis=1)
    elif model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
        half = np.abs(R[:, 2]) * size[1] + size[0]
    else:
        half = np.abs(R) @ size
    return data.geom_xpos[geom] + np.array([-half, half])


@pytest.mark.parametrize("seed", range(6))
def test_a_person_is_as_tall_as_stated_and_stands_on_the_ground(seed):
    model, data = dressed(seed)
    boxes = np.array([span(model, data, k) for k in range(model.ngeom) if model.geom_group[k] == 2])
    assert boxes[:, 1, 2].max() == pytest.approx(STATURE, abs=0.06)
    assert boxes[:, 0, 2].min() == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_shoulders_are_wider_than_the_waist(seed):
    model, data = dressed(seed)

    def width(*names: str) -> float:
        boxes = np.array([span(model, data, model.geom(f"person_1/{name}").id) for name in names])
        return float(boxes[:, 1, 1].max() - boxes[:, 0, 1].min())

    assert 0.40 < width("left_upper_arm", "right_upper_arm") < 0.60
    assert width("yoke") > width("waist")
    assert width("head") < 0.2


def test_only_the_capsule_collides_and_it_is_not_drawn():
    model, _ = dressed(0)
    collider = model.geom("person_1/collider").id
    others = np.arange(model.ngeom) != collider
    assert not model.geom_contype[others].any()
    assert not model.geom_conaffinity[others].any()
    assert (model.geom_group[others] == 2).all()
    assert model.geom_group[collider] == 4
    assert model.geom_rgba[collider, 3] == 0
    assert model.geom_contype[collider] == 2
    assert model.geom_conaffinity[collider] == 0
    assert model.geom_type[collider] == mujoco.mjtGeom.mjGEOM_CAPSULE


def test_people_differ():
    colours = [dressed(seed)[0].geom("person_1/chest").rgba for seed in range(5)]
    assert len(np.unique(np.round(colours, 3), axis=0)) == 5


def test_every_limb_is_a_mocap_body_of_its_own():
    model, _ = dressed(0)
    assert model.nmocap == len(LIMBS) + 1
    assert model.nv == 0
