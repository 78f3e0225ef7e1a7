"""Rolling shutter, motion blur and stitching of a recorded sequence: rows against rays from their own poses and times."""

import csv
import dataclasses
import json
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest

from sim.recording import record
from sim.recording.drawing import around
from sim.recording.record import rendered_frames
from sim.recording.shots import ShutterTimes, lens_parts, mounted_rigs
from sim.recording.tracker_setup import make_setup
from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.rays import cast, silhouettes
from tests.sim.scenes import SUN, G, compiled, spec_with_sky
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from tracker.sequence.reader import read_sequence

pytestmark = pytest.mark.render


def test_a_straight_wall_bends_as_the_poses_say() -> None:
    """The edge of a wall, as a camera that shakes at 8 Hz sees it, to 1 px in every row."""
    spec = spec_with_sky()
    spec.worldbody.add_geom(type=G.mjGEOM_BOX, size=[0.5, 2, 4], pos=[4.5, 2, 0], rgba=[1, 0, 0, 1])
    spec.worldbody.add_light(pos=[0, 0, 10], dir=[0.4, 0.3, -1], type=SUN, diffuse=[0.6] * 3)
    scene = compiled(spec, [Pose.identity()])
    camera, times = Panorama(1024, 512), ShutterTimes(0.03, 0.0, 0.005, 1)
    parts = lens_parts(camera, times)
    assert len(parts) == 6

    def pose(before: float) -> Pose:
        return Pose.planar(0.0, 0.05 * before, 0.02 * np.sin(2 * np.pi * 8 * before), 0.0)

    label = np.zeros((512, 1024), np.uint8)
    with PanoramaRenderer(scene.model, [part.camera for part in parts], scene.instances) as renderer:
        for k, part in enumerate(parts):
            (image,) = renderer.render(scene.data, [pose(part.before)], [k])
            part.camera.paste(np.isfinite(image.range).astype(np.uint8), label)
    rows = np.arange(150, 362)
    seen = np.array([np.flatnonzero(label[row, 400:520])[-1] + 401 for row in rows])
    edge = np.array([4.0, 0.0, 0.0])
    predicted = []
    for row in rows:
        T = pose(0.03 * (1 - (row + 0.5) / 512)).inverse()
        heights = np.linspace(-4, 4, 4001)
        pixels, _ = camera.pixels_from_bearings(T.apply(edge + heights[:, None] * [0.0, 0.0, 1.0]))
        predicted.append(pixels[np.argmin(np.abs(pixels[:, 1] - row - 0.5)), 0])
    assert np.ptp(predicted) > 1
    assert np.abs(seen - predicted).max() < 1


def test_boxes_of_parts_join_over_the_seam() -> None:
    boxes = np.array([[95.0, 10, 103, 20], [2.0, 20, 6, 30], [99.0, 30, 100, 31]])
    assert around(boxes, 100, True).tolist() == [95, 10, 106, 31]
    assert around(boxes, 120, False).tolist() == [2, 10, 103, 31]


MOVING = Scenario(
    world="quarry", seed=3, robots=1, people=5, frames=3, width=256, camera="dual-fisheye:baseline=0.05", effects="readout=0.04,shutter=0.02"
)


def test_every_row_is_that_of_rays_from_its_own_pose_and_time() -> None:
    simulation = Simulation(MOVING)
    setup = make_setup(simulation)
    *_, frame = rendered_frames(simulation, setup)
    name = "robot_0_camera_front"
    image, true, lens = frame.images[name], frame.views, mounted_rigs(simulation, setup)[0].rig.lenses[0]
    rows = [row for row in frame.rows if row[1] == name]
    assert len(rows) > 5
    moved = 0.0
    for row in rows:
        first, end, time = int(row[2]), int(row[3]), float(row[4])
        data = simulation.past(frame.tick.index * MOVING.period - time)
        pose = simulation.T_world_robot("robot_0", data) @ simulation.mount("robot_0") @ lens.T_rig_view
        np.testing.assert_allclose(pose.translation, row[5:8], atol=1e-12)
        moved = max(moved, float(np.linalg.norm(pose.translation - true[name].T_world_camera.translation)))
        geom, distance = cast(simulation.model, data, lens.camera, pose)
        truth = np.where(geom < 0, 0, simulation.person_of_geom[geom])
        v, u = np.mgrid[:128, :128]
        seen = ~lens.camera.blind(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(128, 128) & ~silhouettes(geom, distance)
        band = np.zeros((128, 128), bool)
        band[first:end] = seen[first:end]
        assert (image.instances[band] == truth[band]).mean() > 0.999
        hit = band & np.isfinite(distance)
        if hit.any():
            assert np.median(np.abs(image.range[hit] - distance[hit]) / distance[hit]) < 0.002
    assert moved > 0.001
    body = {int(person): box for person, box in zip(true[name].boxes.person, true[name].boxes.seen, strict=True) if box.any()}
    for person, box in body.items():
        v, u = np.nonzero(image.instances == person)
        assert box.tolist() == [u.min(), v.min(), u.max() + 1, v.max() + 1]


def test_the_past_of_a_frame_leads_from_one_frame_to_the_next() -> None:
    scenario = dataclasses.replace(MOVING, effects="", camera="", frames=2)
    simulation = Simulation(scenario)
    simulation.keep_steps = True
    simulation.step()
    before = mujoco.MjData(simulation.model)
    mujoco.mj_copyData(before, simulation.model, simulation.data)
    simulation.step()
    start, now = simulation.past(scenario.period), simulation.data
    # Colliders of people are not drawn.
    names = [simulation.model.body(int(body)).name for body in simulation.model.geom_bodyid]
    drawn = np.array([not name.endswith("collider") for name in names])
    np.testing.assert_allclose(start.geom_xpos[drawn], before.geom_xpos[drawn], atol=1e-9)
    np.testing.assert_allclose(simulation.past(1e-7).geom_xpos[drawn], now.geom_xpos[drawn], atol=1e-5)
    with pytest.raises(ValueError, match="the time since the frame before"):
        simulation.past(2 * scenario.period)


def test_a_sequence_has_the_truth_of_its_effects(tmp_path: Path) -> None:
    scenario = dataclasses.replace(MOVING, frames=2, effects="readout=0.01,seam=1,dust=3,mount_angle=2,vignette=1", people=2)
    record(scenario, tmp_path / "a")
    record(scenario, tmp_path / "b")
    for path in sorted((tmp_path / "a").rglob("*.*")):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes(), path
    with (tmp_path / "a" / "truth" / "effects.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(row["camera"], row["value"]) for row in rows if row["effect"] == "seam"} == {
        ("robot_0_camera_front", "0.5"), ("robot_0_camera_back", "-0.5")}  # fmt: skip
    assert sum(row["effect"] == "dust" for row in rows) == 6
    told = read_sequence(tmp_path / "a").setup.mounts
    true = json.loads((tmp_path / "a" / "truth" / "calibration.json").read_text())["cameras"]
    assert set(told) == set(true) == {"robot_0_camera", "robot_0_camera_front", "robot_0_camera_back"}
    for name, mount in told.items():
        q = np.array(true[name]["T_body_camera"][3:])
        exact = cv2.Rodrigues(mount.T_body_camera.rotation.T @ _rotation(q))[0]
        assert np.degrees(np.linalg.norm(exact)) == pytest.approx(2, abs=1e-3)


def _rotation(q: np.ndarray) -> np.ndarray:
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, q)
    return out.reshape(3, 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"effects": "readout=0.2"}, "longer than a frame; need at most 0.1667 s"),
        ({"effects": "seam=1"}, "needs a camera with two lenses"),
        ({"effects": "gain=12", "image_noise": 2.0}, "both are noise"),
        ({"effects": 3}, "needs a text"),
        ({"camera": "pinhole:k1=-3"}, "folds within the image"),
        ({"camera": "dual-fisheye:baseline=1"}, "needs a number in"),
    ],
)
def test_scenarios_that_do_not_fit(changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Scenario(**changes)


def test_a_scenario_with_cameras_survives_json() -> None:
    made = Scenario(camera="theta-sc", view_camera="fisheye", effects=["jpeg=40", "dust=3"])  # type: ignore[arg-type]
    assert made.effects == "jpeg=40,dust=3"
    assert Scenario.from_json(made.to_json()) == made
    assert 'camera"' not in Scenario(camera="equirectangular").to_json()
