import numpy as np
import pytest

from sim.crowd.crowd import Obstacles
from sim.crowd.replay import Paths, Replay
from sim.scenario import Scenario
from sim.simulation.simulation import Simulation
from tests.sim.yard import yard

STEP = 1 / 7


def noisy_circle(noise: float) -> tuple[Paths, np.ndarray]:
    """Paths and true positions of two people on a circle of 3 m radius at 1.2 m/s. The second one is present in frames 10 to 39."""
    times = STEP * np.arange(60)
    angle = np.array([0.0, 2.0])[:, None] + 0.4 * times
    true = 3.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    position = true + np.random.default_rng(0).normal(0.0, noise, true.shape)
    position[1, :10] = position[1, 40:] = np.nan
    return Paths(np.array([4, 9]), times, position), true


def walked(paths: Paths, dt: float = STEP / 3) -> list:
    replay = Replay(paths, yard().feet)
    states = [replay.start()]
    for _ in range(round((paths.times[-1] - paths.times[0]) / dt)):
        states.append(replay.step(states[-1], Obstacles.none(), dt))
    return states


def test_people_follow_their_paths():
    paths, true = noisy_circle(0.0)
    states = walked(paths)[::3]
    assert len(states) == 60
    present = np.array([s.present for s in states])
    np.testing.assert_array_equal(present[:, 0], True)
    np.testing.assert_array_equal(present[:, 1], (np.arange(60) >= 10) & (np.arange(60) < 40))
    error = np.linalg.norm(np.array([s.position for s in states]) - true.transpose(1, 0, 2), axis=2)
    assert error[present].max() < 0.03


def test_noise_of_the_annotation_does_not_shake_bodies():
    paths, _ = noisy_circle(0.04)
    states = walked(paths)[6:-6]
    speed = np.array([np.linalg.norm(s.velocity[0]) for s in states])
    raw = np.linalg.norm(np.diff(paths.position[0], axis=0), axis=1) / STEP
    assert abs(speed.mean() - 1.2) < 0.05
    assert speed.std() < 0.4 * raw.std()
    heading = np.unwrap([s.heading[0] for s in states])
    # Along the circle, and no faster than a body turns.
    expected = 0.4 * STEP / 3 * np.arange(len(states))
    assert np.abs(heading - heading[0] - expected).max() < 0.5


def test_short_visits_and_single_frames_pass():
    position = np.full((2, 5, 2), np.nan)
    position[0, 2] = position[1, 1] = [2.0, 2.0]
    position[1, 2] = [2.1, 2.0]
    states = walked(Paths(np.array([1, 2]), STEP * np.arange(5), position))[::3]
    np.testing.assert_array_equal([s.present.tolist() for s in states], [[0, 0], [0, 1], [1, 1], [0, 0], [0, 0]])


@pytest.mark.parametrize(
    ("place", "fault"),
    [([99.0, 0.0], "outside the world"), ([0.0, 0.1], "inside a wall or an obstacle")],
)
def test_a_path_out_of_the_world_or_into_a_wall_is_refused(place, fault):
    paths, _ = noisy_circle(0.0)
    position = paths.position.copy()
    position[1, 20] = place
    with pytest.raises(ValueError, match=f"person 9 at frame 20 .*{fault}.*{place[0]:.2f}") as error:
        Replay(Paths(paths.ids, paths.times, position), yard().feet)
    assert "\n" not in str(error.value)


def test_paths_that_do_not_fit_are_refused():
    place = np.zeros((2, 3, 2))
    with pytest.raises(ValueError, match="position has shape"):
        Paths(np.array([1]), np.arange(3.0), place)
    with pytest.raises(ValueError, match="ids are"):
        Paths(np.array([1, 1]), np.arange(3.0), place)
    with pytest.raises(ValueError, match="ids are"):
        Paths(np.array([0, 1]), np.arange(3.0), place)
    with pytest.raises(ValueError, match="times step by"):
        Paths(np.array([1, 2]), np.array([0.0, 1.0, 3.0]), place)
    with pytest.raises(ValueError, match="person 2 has no position"):
        Paths(np.array([1, 2]), np.arange(3.0), np.stack([place[0], place[1] + np.nan]))


def test_a_simulation_replays_paths_under_their_ids():
    paths, true = noisy_circle(0.0)
    scenario = Scenario(robots=1, people=2, frames=15, rate=7.0)
    simulation = Simulation(scenario, yard(), paths=paths)
    assert simulation.persons.tolist() == [4]
    for _ in range(12):
        simulation.step()
    assert simulation.persons.tolist() == [4, 9]
    assert np.linalg.norm(simulation.feet()[:, :2] - true[:, 12], axis=1).max() < 0.03
    with pytest.raises(ValueError, match="people is 3"):
        Simulation(Scenario(robots=1, people=3), yard(), paths=paths)
