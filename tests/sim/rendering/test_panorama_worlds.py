"""Panoramas of every world, and of people at all levels of detail, against exact rays."""

import numpy as np
import pytest

from sim.rendering.panorama import PanoramaRenderer
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.rays import Agreement, cast, compare
from tests.sim.scenes import EYE, Scene, add_person, compiled
from tracker.geometry import Pose
from tracker.geometry.cameras import Panorama
from worlds import catalogue

pytestmark = pytest.mark.render
CAMERA = Panorama(1024, 512)


def peopled(name: str, difficulty: float, seed: int) -> Scene:
    """A world with four people of capsules, and a camera pose."""
    rng = np.random.default_rng(seed)
    world = catalogue.build(name, rng, difficulty)
    spec = world.spec.copy()
    places = world.feet.sample(rng, 5, 0.3, 1.0)
    heights = world.terrain.height_at(places)
    for number, (place, height) in enumerate(zip(places[1:], heights[1:], strict=True), start=1):
        add_person(spec, number, float(place[0]), float(place[1]), rng)
        spec.body(f"person_{number}").pos = [*place, height]
    return compiled(spec, [Pose.planar(*places[0], float(rng.uniform(-3, 3)), float(heights[0]) + EYE)])


def check(found: Agreement) -> None:
    assert found.everywhere >= 0.995
    assert found.inside == 1
    assert found.median < 0.002
    assert found.percentile < 0.01


def compared(scene: Scene) -> Agreement:
    with PanoramaRenderer(scene.model, CAMERA, scene.instances) as renderer:
        (shot,) = renderer.render(scene.data, scene.poses)
    return compare(shot, scene.instances, *cast(scene.model, scene.data, CAMERA, scene.poses[0]))


@pytest.mark.parametrize(
    ("name", "difficulty"),
    [("pilsun", 0.5), ("forest", 0.5), *(pytest.param(name, 1.0, marks=pytest.mark.soak) for name in sorted(catalogue.WORLDS))],
)
def test_every_world_is_drawn_as_rays_see_it(name: str, difficulty: float) -> None:
    check(compared(peopled(name, difficulty, 1)))


def test_people_and_robots_are_drawn_as_rays_see_them_near_and_far() -> None:
    simulation = Simulation(Scenario(people=12, robots=3, seed=2))
    owners = (simulation.person_of_geom + 100 * simulation.robot_of_geom).astype(np.uint16)
    poses = [simulation.T_world_robot(robot) @ simulation.mount(robot) for robot in simulation.robots]
    with PanoramaRenderer(simulation.model, CAMERA, owners) as renderer:
        for pose, shot in zip(poses, renderer.render(simulation.data, poses), strict=True):
            check(compare(shot, owners, *cast(simulation.model, simulation.data, CAMERA, pose)))
