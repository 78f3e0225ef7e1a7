"""Truth projected onto the images of a sequence, in panoramas and Tsai cameras: there is no lag and no offset."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest

from sim.recording.frames import Frame
from sim.recording.record import SimulatedSequence, rendered_frames, write_sequence
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.sensors.true_boxes import DEPTH_IN_BODY, image_points
from sim.simulation.simulation import Simulation
from tests.sim.rays import silhouettes
from tests.sim.yard import yard
from tracker.geometry import Array, Ints, Pose
from tracker.geometry.cameras import Camera, Tsai
from tracker.recordings import RecordingCamera
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_joints, read_views
from tracker.types import HIDDEN, KEYPOINT_NAMES, VISIBLE, Setup, ViewTruth

SCENARIO = Scenario(seed=5, robots=2, people=8, frames=6, width=1024)
# The first is View_001 of PETS 2009 with its κ1 and sx, the other a wider one that bends the other way.
FIXED = {
    "pets": RecordingCamera(
        Tsai(768, 576, 5.5549183034, 5.1113043639e-3, 324.22149053, 282.56650051, 1.0937855397, 5.1273271277e-3, 4.65e-3),
        Pose.planar(-5.6, -5.6, 0.8, 2.6) @ Pose.exp([0, 0, 0, 0.02, 0.25, 0]),
    ),
    "barrel": RecordingCamera(
        Tsai(640, 480, 3.0, -0.012, 300.0, 250.0, 1.05, 5e-3, 5e-3), Pose.planar(5.6, 0.5, 3.1, 1.8) @ Pose.exp([0, 0, 0, 0, 0.1, 0])
    ),
}
pytestmark = pytest.mark.render
LEGS = [k for k, name in enumerate(KEYPOINT_NAMES) if name.split("_")[-1] in ("hip", "knee", "ankle")]


def stage() -> SimulatedSequence:
    return SimulatedSequence(Simulation(SCENARIO, world=yard()), FIXED, {})


@dataclass(frozen=True, eq=False)
class Written:
    folder: Path
    setup: Setup
    views: dict[tuple[int, str], ViewTruth]
    joints: dict[int, tuple[Ints, Array]]

    def instances(self, frame: int, camera: str) -> np.ndarray:
        image = cv2.imread(str(self.folder / "instances" / camera / f"{frame:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert image is not None
        return image


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("reprojection") / "s"
    write_sequence(stage(), folder)
    return Written(folder, read_sequence(folder).setup, read_views(folder), read_joints(folder))


def on_own(written: Written, shift: tuple[float, float] = (0.0, 0.0), lag: int = 0) -> dict[tuple[int, str], Array]:
    """(frame, camera) → (n, 17) whether each joint of everybody who is seen (nearly) whole is on its own instance."""
    out = {}
    for (frame, camera), view in written.views.items():
        if frame + lag >= SCENARIO.frames:
            continue
        image, model = written.instances(frame + lag, camera), written.setup.mounts[camera].camera
        persons, joints = written.joints[frame]
        rows = []
        for person in view.boxes.person[view.boxes.visible > 0.95]:
            pixels, inside = image_points(model, view.T_world_camera, joints[persons.tolist().index(person)])
            if inside.all():
                u, v = np.floor(pixels + shift).astype(int).T
                rows.append(image[np.clip(v, 0, image.shape[0] - 1), u % image.shape[1]] == person)
        out[frame, camera] = np.array(rows).reshape(-1, 17)
    return out


def faithful(rows: Array) -> bool:
    """Requirements on rows (n, 17) of on_own. Leg joints lie well inside the silhouette, face and shoulders near its edge."""
    return bool(rows[:, LEGS].mean() > 0.97 and rows.mean() > 0.86)


def test_joints_fall_on_their_own_person_in_every_frame(written: Written) -> None:
    whole = on_own(written)
    assert {camera for (_, camera), rows in whole.items() if len(rows)} >= set(written.setup.mounts)
    for frame in range(SCENARIO.frames):
        rows = np.concatenate([rows for (k, _), rows in whole.items() if k == frame])
        assert len(rows) > 8
        assert faithful(rows), (frame, rows.mean(axis=0))


@pytest.mark.parametrize("shift", [(3, 0), (-3, 0), (0, 3), (0, -3)])
def test_an_offset_of_few_pixels_would_be_noticed(written: Written, shift: tuple[int, int]) -> None:
    assert not faithful(np.concatenate(list(on_own(written, shift).values())))


def test_a_lag_of_one_frame_would_be_noticed(written: Written) -> None:
    assert not faithful(np.concatenate(list(on_own(written, lag=1).values())))


def test_seen_boxes_are_the_silhouettes(written: Written) -> None:
    checked = 0
    for (frame, camera), view in written.views.items():
        image = written.instances(frame, camera)
        for person, seen, full, visible in zip(view.boxes.person, view.boxes.seen, view.boxes.full, view.boxes.visible, strict=True):
            rows, columns = np.nonzero(image == person)
            assert (visible > 0) == (len(rows) > 0)
            if not len(rows):
                assert not seen.any()
                continue
            assert (rows.min(), rows.max() + 1) == (seen[1], seen[3])
            inside = (columns >= seen[0]) & (columns < seen[2]) | (columns + image.shape[1] < seen[2])
            assert inside.all()
            assert full[1] <= seen[1] < seen[3] <= full[3]
            if visible == 1.0:
                np.testing.assert_array_equal(seen, full)
                checked += 1
    assert checked > 30


def test_ranges_and_the_ground_below(written: Written) -> None:
    terrain, hips = yard().terrain, [KEYPOINT_NAMES.index("left_hip"), KEYPOINT_NAMES.index("right_hip")]
    for (frame, _), view in written.views.items():
        persons, joints = written.joints[frame]
        middle = joints[np.searchsorted(persons, view.boxes.person)][:, hips].mean(axis=1)
        np.testing.assert_allclose(view.boxes.range, np.linalg.norm(middle - view.T_world_camera.translation, axis=1), atol=2e-4)
        below = view.T_world_camera.translation[None]
        assert view.ground == pytest.approx(terrain.height_at(below)[0], abs=1e-6)
        np.testing.assert_allclose(view.normal, terrain.normal_at(below)[0], atol=1e-6)


@pytest.fixture(scope="module")
def moments() -> list[tuple[Frame, Setup, Array]]:
    """Two frames in memory, and the first hit of the ray to every joint of every view that is not the limb of that joint."""
    one = stage()
    setup = make_setup(one.simulation, one.fixed)
    out = []
    for moment, _ in zip(rendered_frames(one.simulation, setup), range(2), strict=False):
        out.append((moment, setup, rays_to_joints(one.simulation, moment, {name: mount.camera for name, mount in setup.mounts.items()})))
    return out


def rays_to_joints(simulation: Simulation, moment: Frame, cameras: dict[str, Camera]) -> Array:
    """Hits (cameras, m, 17, 3) of the rays to joints: owner, distance before the joint m, and whether a silhouette is within 1.5 px.

    Near a silhouette, a pixel does not tell what is beside it.
    """
    joints, groups, geom = moment.truth.joints, np.array([1, 1, 1, 1, 0, 0], np.uint8), np.zeros(1, np.int32)
    assert joints is not None
    out = np.zeros((len(moment.views), *joints.shape[:2], 3))
    for c, (name, view) in enumerate(moment.views.items()):
        eye, edges = view.T_world_camera.translation, silhouettes(moment.images[name].instances.astype(np.int32), moment.images[name].range)
        for place in np.ndindex(*joints.shape[:2]):
            sight = joints[place] - eye
            length = float(np.linalg.norm(sight))
            far = mujoco.mj_ray(simulation.model, simulation.data, eye, sight / length, groups, 1, -1, geom, None)
            (pixel,), (inside,) = image_points(cameras[name], view.T_world_camera, joints[place][None])
            u, v = np.floor(pixel).astype(int) if inside else (0, 0)
            out[c, *place] = simulation.person_of_geom[geom[0]] if geom[0] >= 0 else 0, length - far, edges[v, u]
    return out


def test_visibility_agrees_with_exact_rays(moments: list[tuple[Frame, Setup, Array]]) -> None:
    """Exceptions are joints exactly at the allowed depth and, more often, joints within two pixels of a silhouette."""
    depth = np.array([DEPTH_IN_BODY[name.split("_")[-1]] for name in KEYPOINT_NAMES])
    agreed, clear, hidden = [], [], []
    for moment, _, rays in moments:
        for c, view in enumerate(moment.views.values()):
            rows = np.searchsorted(moment.truth.person_id, view.keypoints.person)
            met, before, edge = np.moveaxis(rays[c, rows], -1, 0)
            visible = (met == view.keypoints.person[:, None]) & (before < depth)
            seen = view.keypoints.visibility
            agreed.append(((seen == VISIBLE) == visible)[seen > 0])
            clear.append(edge[seen > 0] == 0)
            hidden.append((seen == HIDDEN)[seen > 0])
    right, inside = np.concatenate(agreed), np.concatenate(clear)
    assert len(right) > 400
    assert inside.mean() > 0.4
    assert 0.1 < np.concatenate(hidden).mean() < 0.7
    assert right[inside].mean() >= 0.98
    assert right.mean() > 0.94
