"""Views by ray casting against rendered views."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.recording.frames import Frame, raycast_frames
from sim.recording.record import rendered_frames
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.sensors import raycast_camera
from sim.sensors.raycast_camera import TARGET_MARGIN, RaycastCamera
from sim.sensors.true_boxes import People
from sim.simulation.simulation import Simulation
from tests.sim.yard import yard
from tracker.geometry import Array, Pose
from tracker.geometry.cameras import Panorama

SCENARIO = Scenario(seed=1003, robots=2, people=12, frames=2, width=1024)
WIDTH = SCENARIO.width


@pytest.fixture(scope="module")
def both() -> tuple[list[Frame], list[Frame]]:
    rendered, unrendered = (Simulation(SCENARIO, world=yard()) for _ in range(2))
    setup = make_setup(rendered)
    return list(rendered_frames(rendered, setup)), list(raycast_frames(unrendered, setup))


def apart(a: Array, b: Array) -> Array:
    """Differences between edges of boxes, px, modulo the seam."""
    out = a - b
    out[[0, 2]] = np.mod(out[[0, 2]] + WIDTH / 2, WIDTH) - WIDTH / 2
    return np.abs(out)


@pytest.mark.render
def test_boxes_and_visible_fractions_match_rendered_ones(both: tuple[list[Frame], list[Frame]]) -> None:
    seen, full, visible = [], [], []
    for moment, glimpse in zip(*both, strict=True):
        np.testing.assert_array_equal(moment.truth.feet, glimpse.truth.feet)
        visible.append(np.abs(moment.truth.visible - glimpse.truth.visible))
        for name, view in moment.views.items():
            mine = glimpse.views[name].boxes
            assert set(view.boxes.person.tolist()) == set(mine.person.tolist())
            for k, person in enumerate(view.boxes.person.tolist()):
                j = int(np.flatnonzero(mine.person == person)[0])
                full.append(apart(view.boxes.full[k], mine.full[j]))
                if min(view.boxes.visible[k], mine.visible[j]) > 0.3:
                    seen.append(apart(view.boxes.seen[k], mine.seen[j]))
    assert len(seen) > 20
    share = np.concatenate([v.ravel() for v in visible])
    assert np.sqrt((share**2).mean()) < 0.05
    assert share.max() < 0.25
    # A picture's boxes end at whole pixels.
    assert np.max(full) < 3.0
    assert np.median(full) < 0.7
    assert np.percentile(seen, 90) < 2.5


def test_sightings_point_at_unoccluded_landmarks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raycast_camera, "OUTLIER_RATE", 0.0)
    monkeypatch.setattr(raycast_camera, "MISS_RATE", 0.0)
    simulation = Simulation(replace(SCENARIO, people=4), world=yard())
    lines = RaycastCamera(simulation)
    landmarks = lines.landmarks.points
    assert len(landmarks) == 300
    pose = simulation.T_world_robot("robot_0") @ simulation.mount("robot_0")
    seen = lines.sightings(pose, np.random.default_rng(1))
    assert 40 < len(seen) < 300
    # Errors of descriptors are small beside their distances from each other.
    subject = np.argmax(seen.descriptor @ lines.landmarks.descriptors.T, axis=1)
    away = landmarks[subject] - pose.translation
    distance = np.linalg.norm(away, axis=1)
    sight = away / distance[:, None]
    angle = np.arccos(np.clip(np.einsum("ni,ni->n", seen.bearing @ pose.rotation.T, sight), -1, 1))
    # Two axes of 0.12 degrees each.
    assert np.sqrt((angle**2).mean() / 2) == pytest.approx(np.radians(0.12), rel=0.2)
    hidden = np.setdiff1d(np.arange(300), subject)
    geom = np.zeros(1, np.int32)
    groups = np.array([1, 1, 1, 1, 0, 0], np.uint8)
    for rows, clear in ((subject, True), (hidden, False)):
        for row in rows[:40]:
            way = landmarks[row] - pose.translation
            length = float(np.linalg.norm(way))
            if length >= raycast_camera.SIGHTING_REACH:
                continue
            hit = mujoco.mj_ray(simulation.model, simulation.data, pose.translation.copy(), way / length, groups, 1, -1, geom, None)
            assert (hit > length - TARGET_MARGIN) == clear


def test_the_ground_occludes_a_person() -> None:
    """From below the ground nobody is visible. From above the head the whole body is, since it occludes only itself."""
    simulation = Simulation(replace(SCENARIO, robots=1, people=1), world=yard())
    lines, feet = RaycastCamera(simulation), simulation.feet()[0]

    people = People(simulation.persons, simulation.joints())
    aside = np.array([*(-2.0 * feet[:2] / np.linalg.norm(feet[:2])), -1.5])
    below = lines.view(Panorama(WIDTH, WIDTH // 2), Pose(np.eye(3), feet + aside), people)
    assert below.boxes.visible.tolist() == [0.0]
    assert not below.boxes.seen.any()
    above = lines.view(Panorama(WIDTH, WIDTH // 2), Pose(np.eye(3), feet + np.array([0.0, 0.0, 2.6])), people)
    assert above.boxes.visible[0] > 0.95
    np.testing.assert_array_equal(above.boxes.seen, above.boxes.full)
