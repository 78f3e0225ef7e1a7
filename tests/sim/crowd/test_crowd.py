from itertools import pairwise

import numpy as np
import pytest

from sim.crowd.crowd import ARRIVED, Crowd, CrowdState, Obstacles, StepInput, update_behavior
from sim.crowd.goals import GoalPlans, Schedule, make_plans, order_by_group
from sim.crowd.social_force import BODY_RADIUS, PAUSE, SPEED, STUCK, VISIT, YIELDS
from sim.scenario import Scenario
from tests.sim.yard import yard
from worlds import catalogue
from worlds.terrain.free_space import FEET, free_space
from worlds.terrain.heightfield import Heightfield
from worlds.world import World

DT = 0.05


def crowd_of(world: World, seed: int, n: int, apart: float = 0.8) -> tuple[Crowd, CrowdState]:
    scenario = Scenario(seed=seed, people=n)
    plans = make_plans(world.feet, [scenario.stream(f"person_{i}") for i in range(n)], scenario.stream("goals"))
    crowd = Crowd(world.feet, world.terrain, plans)
    return crowd, crowd.start(order_by_group(world.feet.sample(scenario.stream("start"), n, 0.1, apart), plans.group), np.zeros(n))


def history(crowd: Crowd, state: CrowdState, seconds: float, obstacles: Obstacles | None = None) -> list[CrowdState]:
    states = [state]
    for _ in range(round(seconds / DT)):
        states.append(crowd.step(states[-1], obstacles or Obstacles.none(), DT))
    return states


def distances(position: np.ndarray) -> np.ndarray:
    return np.linalg.norm(position[:, None] - position, axis=2)[np.triu_indices(len(position), 1)]


def field(slope: float = 0.0) -> World:
    """An open place 20 m by 6 m that rises along x."""
    ground = Heightfield.flat([[-10, -3], [10, 3]], 0.1)
    ground = ground.with_heights(slope * ground.nodes[..., 0])
    feet = free_space(ground, np.zeros(ground.heights.shape, dtype=bool), FEET)
    return World("field", yard().spec, ground, feet, feet, np.array([[[-1.0, -1.0], [1.0, 1.0]]]))


def crossing(world: World, starts: np.ndarray, goals: np.ndarray) -> tuple[Crowd, CrowdState]:
    """As many people as starts, each with one goal and 1.2 m/s."""
    m = len(starts)
    plans = GoalPlans.of(np.full(m, 1.2), goals, np.arange(m)[:, None], np.full((m, 1), 60.0))
    crowd = Crowd(world.feet, world.terrain, plans)
    return crowd, crowd.start(starts, np.zeros(m))


@pytest.mark.parametrize("place", ["pilsun", *(pytest.param(name, marks=pytest.mark.soak) for name in ("campus", "forest", "ruins", "tunnel"))])
def test_seventy_four_people_do_not_walk_through_each_other_or_walls(place):
    world = catalogue.build(place, Scenario().stream("world"), 0.5)
    crowd, state = crowd_of(world, 0, 74, apart=0.6)
    deep, frames, through = 0, 0, 0
    for _ in range(600):
        state = crowd.step(state, Obstacles.none(), DT)
        gaps = np.linalg.norm(state.position[:, None] - state.position, axis=2) + np.diag(np.full(74, np.inf))
        deep, frames = deep + int((gaps.min(axis=1) < 2 * BODY_RADIUS - 0.05).sum()), frames + 74
        through += int((world.feet.clearance_at(state.position) <= 0).sum())
    assert deep < 0.001 * frames
    assert through == 0
    assert np.median(state.body[:, VISIT]) >= 1


def test_time_in_a_queue_counts_the_same_share_in_long_steps():
    """Steps of sequences at 6 frames/s, and of kinematic placement."""
    crowd, state = crossing(field(), np.array([[-8.0, 0.0]]), np.array([[8.0, 0.0]]))
    desired, effect, obstacle = np.zeros((1, 6)), np.zeros((1, 5)), np.zeros((0, 7))
    desired[:, SPEED] = effect[:, YIELDS] = 1.0
    waited = []
    for dt in (1 / 18, 1 / 6):
        body = state.body.copy()
        body[0, STUCK] = dt
        update_behavior(body, (desired, effect, obstacle), crowd.constants()[0].goals, crowd.constants()[2], StepInput(0.0, dt, 1, 0))
        waited.append(body[0, STUCK] / dt)
    np.testing.assert_allclose(waited, 1 - 0.75 * 0.9)


def test_the_same_start_gives_the_same_end_and_states_stay():
    crowd, state = crowd_of(yard(), 3, 6)
    position = state.position.copy()
    first, again = history(crowd, state, 5.0)[-1], history(crowd_of(yard(), 3, 6)[0], state, 5.0)[-1]
    np.testing.assert_array_equal(first.body, again.body)
    np.testing.assert_array_equal(state.position, position)
    with pytest.raises(ValueError, match="read-only"):
        state.position[0] = 0.0


def test_a_lone_walker_reaches_the_preferred_speed_and_the_goal():
    crowd, state = crossing(field(), np.array([[-8.0, 0.0]]), np.array([[8.0, 0.0]]))
    states = history(crowd, state, 16.0)
    speed = np.array([np.linalg.norm(s.velocity) for s in states])
    assert abs(speed[60:180].mean() - 1.2) < 0.03
    assert np.linalg.norm(states[-1].position - [8.0, 0.0]) < ARRIVED
    assert speed[-1] < 0.05
    assert states[-1].body[0, PAUSE] > 0


def test_two_who_meet_head_on_pass():
    crowd, state = crossing(field(), np.array([[-6.0, 0.0], [6.0, 0.02]]), np.array([[6.0, 0.0], [-6.0, 0.0]]))
    states = history(crowd, state, 14.0)
    assert min(distances(s.position)[0] for s in states) > 2 * BODY_RADIUS
    assert states[-1].position[0, 0] > 5.0
    assert states[-1].position[1, 0] < -5.0


def test_people_walk_around_a_robot():
    robot = Obstacles(np.array([[0.0, 0.05]]), np.zeros((1, 2)), np.array([0.5]))
    crowd, state = crossing(field(), np.array([[-6.0, 0.0]]), np.array([[6.0, 0.0]]))
    states = history(crowd, state, 16.0, robot)
    gap = min(float(np.linalg.norm(s.position[0] - robot.position[0])) for s in states)
    assert gap >= BODY_RADIUS + 0.5 - 1e-6
    assert states[-1].position[0, 0] > 5.0


def test_standing_people_yield_to_a_robot_that_requests_way():
    for requested_velocity, leaves in ((0.0, False), (0.7, True)):
        crowd, state = crossing(field(), np.array([[1.2, 0.05]]), np.array([[1.2, 0.05]]))
        robot = Obstacles(np.zeros((1, 2)), np.zeros((1, 2)), np.array([0.5]), np.array([[requested_velocity, 0.0]]))
        last = history(crowd, state, 4.0, robot)[-1]
        assert (abs(last.position[0, 1]) > 0.6) == leaves


def test_speed_on_slopes_follows_tobler():
    for slope in (0.2, -0.2):
        crowd, state = crossing(field(slope), np.array([[-8.0, 0.0]]), np.array([[8.0, 0.0]]))
        speed = np.array([np.linalg.norm(s.velocity) for s in history(crowd, state, 8.0)])[60:].mean()
        assert abs(speed / 1.2 - np.exp(-3.5 * (abs(slope + 0.05) - 0.05))) < 0.03


def test_heading_turns_no_faster_than_a_body_can():
    crowd, state = crossing(field(), np.array([[6.0, 0.0]]), np.array([[-6.0, 0.0]]))
    heading = np.unwrap([s.heading[0] for s in history(crowd, state, 4.0)])
    assert np.abs(np.diff(heading)).max() <= 2.5 * DT + 1e-9
    assert abs(abs(heading[-1]) - np.pi) < 0.2


def test_a_person_inside_a_wall_gets_out():
    world = yard()
    crowd, state = crossing(world, np.array([[0.0, 0.62]]), np.array([[4.0, 4.0]]))
    assert world.feet.clearance_at(state.position)[0] < 0
    assert world.feet.clearance_at(history(crowd, state, 3.0)[-1].position)[0] > 0


def test_a_third_of_people_walk_in_groups_of_two_or_three():
    group = make_plans(yard().feet, [np.random.default_rng([7, i]) for i in range(3000)], np.random.default_rng(0)).group
    sizes = np.bincount(group, minlength=3000)
    assert sizes.max() == 3
    assert abs((sizes[group] > 1).mean() - 1 / 3) < 0.04


def test_a_group_stays_together_and_goes_to_the_same_goals():
    plans = GoalPlans.of(np.array([1.2, 1.2, 1.2]), np.array([[8.0, 0.0], [-8.0, 1.0]]), np.tile([[0, 1]], (3, 1)), np.full((3, 2), 2.0))
    together = GoalPlans(**(vars(plans) | {"group": np.zeros(3, dtype=np.int64)}))
    world = field()
    crowd = Crowd(world.feet, world.terrain, together)
    states = history(crowd, crowd.start(np.array([[-8.0, 0.0], [-8.5, 0.7], [-6.0, -1.0]]), np.zeros(3)), 40.0)
    middle = np.array([s.position - s.position.mean(axis=0) for s in states[100:]])
    assert np.linalg.norm(middle, axis=2).mean() < 1.0
    assert all((s.body[:, VISIT] == s.body[0, VISIT]).all() for s in states)
    assert states[-1].body[0, VISIT] >= 1


def test_people_come_and_go_through_spawn_areas_and_all_of_them_come():
    areas, world = np.array([[[-5.0, -5.0], [-4.0, -4.0]], [[4.0, 4.0], [5.0, 5.0]]]), yard()
    rngs = [np.random.default_rng([1, i]) for i in range(16)]
    crowd = Crowd(world.feet, world.terrain, make_plans(world.feet, rngs, np.random.default_rng(2), Schedule(areas, 5, 120.0)))
    places = np.zeros((16, 2))
    places[:5] = world.feet.sample(np.random.default_rng(3), 5, 0.1, 0.8)
    states = history(crowd, crowd.start(places, np.zeros(16)), 120.0)
    present = np.array([s.present for s in states])
    assert present.any(axis=0).all()
    assert present.sum(axis=1).max() == 5
    assert present.sum(axis=1).mean() > 3.5
    # Nobody comes twice, and whoever comes or goes does so near an area.
    assert (np.diff(present.astype(int), axis=0) == 1).sum(axis=0).max() <= 1
    middles = areas.mean(axis=1)
    for before, after in pairwise(states):
        changed = before.present != after.present
        if changed.any():
            assert np.linalg.norm(after.position[changed][:, None] - middles, axis=2).min(axis=1).max() < 2.0
