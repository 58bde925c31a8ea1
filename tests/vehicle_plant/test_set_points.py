"""Set-points between commands."""

import numpy as np

from msgs_yaml.types import Command
from vehicle_plant.actuators import SetPointRamp
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import START_NS, Simulator
from vehicle_plant.state import SetPoints

REST = SetPoints(0.0, 0.0, 0.0)


def test_they_move_in_a_straight_line_and_arrive_after_fifty_steps():
    ramp = SetPointRamp(REST)
    ramp.aim(SetPoints(0.1, -5000.0, 500.0), 50)
    path = ramp.advance(50)
    assert path.shape == (51, 3)
    assert np.allclose(path, np.outer(np.linspace(0, 1, 51), [0.1, -5000.0, 500.0]), rtol=1e-15)
    assert path[-1].tolist() == [0.1, -5000.0, 500.0]


def test_they_are_held_once_reached():
    ramp = SetPointRamp(REST)
    ramp.aim(SetPoints(0.1, 0.0, 0.0), 50)
    path = ramp.advance(120)
    assert (path[50:, 0] == 0.1).all()
    assert (ramp.advance(5)[:, 0] == 0.1).all()


def test_a_new_target_starts_where_they_are():
    ramp = SetPointRamp(REST)
    ramp.aim(SetPoints(0.1, 0.0, 0.0), 50)
    ramp.advance(25)
    assert ramp.now.delta == 0.05
    ramp.aim(SetPoints(0.0, 0.0, 0.0), 50)
    assert np.allclose(ramp.advance(50)[:, 0], np.linspace(0.05, 0.0, 51), atol=1e-17)


def test_a_late_target_is_due_when_its_stamp_says(params):
    """A command that arrives 20 ms after the state it answers has 30 ms left."""
    early = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    late = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    command = Command(START_NS, 0.02, 0.4, 0.0, 0.0)
    early.advance(command, 300)
    late.advance(None, 20)
    late.advance(command, 280)
    assert abs(early.actuators.delta - 0.02) < 1e-4
    assert abs(late.actuators.delta - 0.02) < 1e-4
    late_again = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, 20.0))
    late_again.advance(None, 60)
    late_again.command(command)
    assert late_again.advance(None, 40).column('servos.steer.position')[-1] > 0.005
