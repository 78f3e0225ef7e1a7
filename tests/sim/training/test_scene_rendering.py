"""Bodies that the border of a plain image cuts count as hidden by as much."""

import numpy as np
import pytest

from sim.sensors.true_boxes import People
from sim.training.scene_rendering import _inside
from tracker.geometry import Pose
from tracker.geometry.cameras import Camera, Panorama, pinhole


@pytest.mark.parametrize(
    ("camera", "aside", "share"),
    [(pinhole(640, 480, np.radians(90)), 0.0, 9 / 17), (pinhole(640, 480, np.radians(90)), 9.0, 1 / 17), (Panorama(1024, 512), 9.0, 1.0)],
)
def test_the_share_of_joints_in_the_image(camera: Camera, aside: float, share: float):
    """Seventeen joints above each other, from the height of the camera down, the last of which are below a pinhole image."""
    down = np.linspace(0.0, 2 * 480 / 640 * (1 - 1e-3) * 2, 17)
    joints = np.stack([np.full(17, 2.0), np.full(17, aside), -down], axis=1)
    people = People(np.array([3, 7]), np.stack([joints + 100, joints]))
    np.testing.assert_allclose(_inside(camera, Pose.identity(), people, np.array([7])), [share])
