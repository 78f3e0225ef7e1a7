import numpy as np
import pytest

from sim.scenario import Scenario
from sim.simulation import wheel_slip
from sim.simulation.simulation import Simulation


@pytest.mark.soak
def test_slip_on_level_ground_is_below_two_per_cent():
    """The campus at difficulty 0 is flat and wide, so that rovers seldom turn in place."""
    simulation = Simulation(Scenario(world="campus", difficulty=0.0, robots=4, people=0))
    found = wheel_slip.measure(simulation, 30.0)
    assert found.driven > 50
    assert 0.0005 < found.error < 0.02
    assert found.tipped == 0


def test_the_error_of_a_segment_is_its_summed_error_over_its_length():
    steps = np.array([[0.1, 0.0, 0.0, 4.0], [0.05, 0.2, 0.0, 1.0], [1.0, 1.0, 1.0, 0.9]])
    np.testing.assert_allclose(wheel_slip._segment_errors(steps), [np.hypot(0.15, 0.2) / 5])
