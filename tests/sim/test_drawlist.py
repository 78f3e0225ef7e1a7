"""The list of what is drawn: MuJoCo's memory as an array, and what each face needs."""

import mujoco
import numpy as np
import pytest

from sim import drawlist
from sim.drawlist import GEOM, DrawList
from tests.sim.scenes import SUN, G, Scene, compiled, court
from tracker.geometry import Pose


@pytest.fixture(scope="module")
def scene() -> Scene:
    return court()


def test_the_array_is_mujocos_memory(scene: Scene) -> None:
    listed = DrawList(scene.model, scene.instances, 96)
    listed.update(scene.data)
    listed.show(scene.poses[0], np.array([2, 5]), coded=True)
    assert listed.scene.ngeom == 2
    for geom, entry in zip(listed.scene.geoms[:2], listed._geoms[[2, 5]], strict=True):
        assert geom.segid == entry["segid"]
        np.testing.assert_array_equal(geom.pos, entry["pos"])
        np.testing.assert_array_equal(geom.mat, entry["mat"])


def test_other_memory_is_refused(monkeypatch: pytest.MonkeyPatch, scene: Scene) -> None:
    offsets = [offset + 4 * (name == "segid") for name, offset in drawlist.OFFSETS.items()]
    moved = {"names": list(drawlist.OFFSETS), "formats": [GEOM[name] for name in drawlist.OFFSETS], "offsets": offsets, "itemsize": 256}
    monkeypatch.setattr(drawlist, "GEOM", np.dtype(moved))
    with pytest.raises(RuntimeError, match="lies in memory otherwise"):
        DrawList(scene.model, scene.instances, 96)


def test_groups_sites_and_codes(scene: Scene) -> None:
    listed = DrawList(scene.model, scene.instances, 96)
    listed.update(scene.data)
    drawn = set(listed._geoms["objid"].tolist())
    assert drawn == set(np.flatnonzero(scene.model.geom_group < 4).tolist())
    assert (listed._geoms["objtype"] == mujoco.mjtObj.mjOBJ_GEOM.value).all()
    codes = listed._geoms["segid"] + 1
    np.testing.assert_array_equal(listed.instance_of_code[codes], scene.instances[listed._geoms["objid"]])


def test_a_face_sees_what_is_before_it_and_needs_what_shades_it() -> None:
    spec = mujoco.MjSpec()
    for name, at in {"ahead": (5, 0, 1), "behind": (-5, 0, 1), "above": (0, 0, 6), "left": (0, 5, 1)}.items():
        spec.worldbody.add_geom(name=name, type=G.mjGEOM_SPHERE, size=[0.3, 0, 0], pos=at)
    spec.worldbody.add_geom(name="floor", type=G.mjGEOM_PLANE, size=[0, 0, 1])
    # The sun stands to the left: shadows fall to the right.
    spec.worldbody.add_light(pos=[0, 0, 10], dir=[0, -1, -1], type=SUN, castshadow=True)
    scene = compiled(spec, [Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))])
    listed = DrawList(scene.model, scene.instances, 96)
    listed.update(scene.data)
    choice = listed.seen_from(scene.poses[0])
    names = [[scene.model.geom(listed._geoms["objid"][k]).name for k in face] for face in choice.seen]
    assert names == [["ahead", "floor"], ["left", "floor"], ["behind", "floor"], ["floor"], ["above"], ["floor"]]
    needed = {scene.model.geom(listed._geoms["objid"][k]).name for k in choice.coloured[3]}
    assert needed == {"above", "floor"}
