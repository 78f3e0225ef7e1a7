"""Draw list: culling keeps all visible shapes, opaque shapes come first from near to far, round shapes have enough triangles."""

import mujoco
import numpy as np
import pytest

from sim.rendering.cubemap import FaceTable
from sim.rendering.draw_list import TRIANGLES_PER_PIXEL, DrawCommands, DrawList, classes
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.scenes import G
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from worlds.semantics import CLASSES

CAMERA = Panorama(256, 128)
PLANES = np.stack([face.planes for face in FaceTable.make(CAMERA).faces])


def balls(places: np.ndarray, colours: np.ndarray, radius: float = 0.1) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    for place, colour in zip(places, colours, strict=True):
        spec.worldbody.add_geom(type=G.mjGEOM_SPHERE, size=[radius, 0, 0], pos=place, rgba=colour)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def drawn(draw_commands: DrawCommands) -> list[int]:
    return [int(record) for record in draw_commands.commands["record"]]


def test_a_face_draws_only_the_balls_in_its_frustum() -> None:
    rng = np.random.default_rng(3)
    places = rng.normal(size=(300, 3)) * 3
    model, data = balls(places, np.full((300, 4), 0.6))
    listed = DrawList(model)
    listed.update(data)
    pose = Pose.planar(0.5, -0.3, 0.8, 0.2)
    local = (places - pose.translation) @ pose.rotation
    for planes, draw_commands in zip(PLANES, listed.visible_from(pose, PLANES, 40.0), strict=True):
        depth = (local @ planes.T).min(axis=1)
        visible = set(drawn(draw_commands))
        assert set(np.flatnonzero(depth > -0.1).tolist()) <= visible
        # The box about a ball reaches further than the ball, by √3.
        assert visible <= set(np.flatnonzero(depth > -0.1 * np.sqrt(3) - 0.01).tolist())


def test_opaque_records_go_from_near_to_far_then_blended_ones_from_far_to_near() -> None:
    places = np.array([[k, 0.0, 0.0] for k in (5, 3, 8, 2, 6, 4)])
    colours = np.array([[1, 1, 1, 1.0]] * 3 + [[1, 1, 1, 0.5]] * 3)
    model, data = balls(places, colours)
    listed = DrawList(model)
    listed.update(data)
    ahead = listed.visible_from(Pose.identity(), PLANES, 40.0)[0]
    assert drawn(ahead) == [1, 0, 2, 4, 5, 3]
    assert [(batch.blended, batch.first, batch.last) for batch in ahead.batches] == [(False, 0, 3), (True, 3, 6)]


def test_level_of_detail_grows_with_the_size_in_pixels() -> None:
    model, data = balls(np.array([[1.0, 0, 0]]), np.ones((1, 4)))
    listed = DrawList(model)
    listed.update(data)
    one = np.zeros(1, np.int64)
    triangles = [int(listed.commands(one, np.array([pixels]))["count"][0]) // 3 for pixels in (0.1, 3.0, 10.0, 30.0, 1000.0)]
    assert triangles == sorted(triangles)
    assert triangles[0] < 150 < triangles[-1]
    for pixels, count in zip((0.1, 3.0, 10.0, 30.0), triangles, strict=False):
        assert count >= TRIANGLES_PER_PIXEL * pixels


def test_groups_and_invisible_things_are_left_out() -> None:
    spec = mujoco.MjSpec()
    for group in range(6):
        spec.worldbody.add_geom(name=f"g{group}", type=G.mjGEOM_BOX, size=[0.1] * 3, group=group, pos=[2, group, 0])
    spec.worldbody.add_geom(name="ghost", type=G.mjGEOM_BOX, size=[0.1] * 3, rgba=[1, 1, 1, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    listed = DrawList(model)
    listed.update(data)
    ahead = listed.visible_from(Pose.planar(-9.0, 2.0, 0.0), PLANES, 40.0)[0]
    assert sorted(model.geom(int(listed.geom[k])).name for k in drawn(ahead)) == ["g0", "g1", "g2", "g3"]


def test_what_cannot_be_drawn_is_refused() -> None:
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=G.mjGEOM_SPHERE, size=[0.1, 0, 0])
    flexible = """<mujoco><worldbody><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2"/></worldbody></mujoco>"""
    with pytest.raises(ValueError, match="1 flexes and 0 skins"):
        DrawList(mujoco.MjModel.from_xml_string(flexible))


@pytest.mark.render
def test_geoms_have_the_classes_of_people_robots_and_worlds() -> None:
    simulation = Simulation(Scenario(people=2, robots=1))
    found = classes(simulation.model)
    drawn = np.isin(simulation.model.geom_group, (0, 1, 2, 3)) & (simulation.model.geom_rgba[:, 3] > 0)
    assert (found[drawn & (simulation.person_of_geom > 0)] == CLASSES.index("person")).all()
    assert (found[drawn & (simulation.robot_of_geom > 0)] == CLASSES.index("robot")).all()
    rest = drawn & (simulation.person_of_geom == 0) & (simulation.robot_of_geom == 0)
    assert CLASSES[found[simulation.model.geom("ground").id]] == "ground"
    assert set(found[rest].tolist()).isdisjoint({0, CLASSES.index("person"), CLASSES.index("robot")})
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="unicorn1", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0])
    with pytest.raises(ValueError, match="unicorn"):
        classes(spec.compile())
