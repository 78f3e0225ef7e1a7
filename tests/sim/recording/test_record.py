"""A recording: truth, panoramas and instances of a frame agree, and the same seed gives the same bytes."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.recording.record import record
from sim.recording.tracker_setup import make_setup
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tracker.geometry.ground import Grid
from tracker.sequence.reader import read_sequence
from tracker.sequence.truth_tables import read_boxes

pytestmark = pytest.mark.render

SCENARIO = Scenario(seed=11, robots=2, people=5, frames=5, width=512)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("record") / "sequence"
    record(SCENARIO, path)
    return path


def instances(folder: Path, camera: str, frame: int) -> np.ndarray:
    image = cv2.imread(str(folder / "instances" / camera / f"{frame:06d}.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.dtype == np.uint16
    return image


def test_truth_projects_onto_the_instances(folder: Path) -> None:
    """The centre of every unoccluded body lies on its instance in every frame, so that there is no lag and no offset."""
    sequence = read_sequence(folder)
    assert sequence.truth is not None
    boxes = read_boxes(folder)
    checked = 0
    for truth in sequence.truth:
        for name, mount in sequence.setup.mounts.items():
            image = instances(folder, name, truth.index)
            T_camera_world = (truth.T_world_robot[mount.robot] @ mount.T_body_camera).inverse()
            column = list(sequence.setup.mounts).index(name)
            for person, feet, visible in zip(truth.person_id, truth.feet, truth.visible[:, column], strict=True):
                if visible < 0.95:
                    continue
                sight = T_camera_world.apply(feet + np.array([0.0, 0.0, 1.15]))
                pixel, _ = mount.camera.pixels_from_bearings(sight[None] / np.linalg.norm(sight))
                u, v = pixel[0].astype(int)
                assert (image[v - 1 : v + 2, max(u - 1, 0) : u + 2] == person).any(), (truth.index, name, person)
                checked += 1
            for person, box in zip(boxes[truth.index, name].person, boxes[truth.index, name].seen, strict=True):
                rows, _columns = np.nonzero(image == person)
                if len(rows):
                    assert (rows.min(), rows.max() + 1) == (box[1], box[3])
                    assert box[2] - box[0] <= 200
    assert checked > 10


def test_the_same_seed_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    record(SCENARIO, tmp_path / "again")
    assert (tmp_path / "again" / "manifest.json").read_bytes() == (folder / "manifest.json").read_bytes()


def test_walls_occlude_people_and_beams_do_not() -> None:
    simulation = Simulation(Scenario(seed=3))
    setup = make_setup(simulation)
    assert isinstance(setup.occluders, Grid)
    assert isinstance(setup.ground, Grid)
    above = setup.occluders.heights - setup.ground.heights
    assert (above > -1e-9).all()
    assert 0.03 < (above > 0.3).mean() < 0.4
    # Where people can walk, hardly anything stands.
    points = np.stack(np.meshgrid(np.linspace(-6, 6, 60), np.linspace(-5, 5, 50)), axis=-1).reshape(-1, 2)
    free = points[simulation.world.feet.clearance_at(points) > 0.2]
    assert (setup.occluders.height_at(free) - setup.ground.height_at(free) < 0.05).mean() > 0.99
