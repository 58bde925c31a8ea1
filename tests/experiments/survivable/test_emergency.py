"""The instant of action, and what is driven from it."""

import dataclasses

import numpy as np
import pytest

from experiments import simulation
from experiments.survivable.emergency import Emergency
from msgs_yaml.types import Command
from vehicle_plant.car import FaultParams

POP_UP = {'x_m': 60.0, 'y_m': 0.5, 'radius_m': 0.8, 'appears_at_s': 1.02}


@pytest.fixture(scope='module')
def setup(straight_emergency):
    return straight_emergency(20.0, [POP_UP])


def replayed(commands):
    given = iter(commands)
    return lambda car, obstacles: next(given)._replace(stamp_ns=car.stamp_ns)


def test_the_driver_acts_from_the_first_tick_with_an_obstacle_on(setup):
    emergency = Emergency(setup)
    assert emergency.time_s == pytest.approx(1.05)
    assert len(emergency.obstacles_at(emergency.start_ns).items) == 1
    assert not emergency.obstacles_at(emergency.start_ns - 50_000_000).items


def test_nor_before_a_fault_of_the_actuators_begins(setup):
    faults = FaultParams(**dict.fromkeys(FaultParams.__annotations__))
    sticks = dataclasses.replace(faults, steer_stuck=True, from_s=1.4)
    emergency = Emergency(setup._replace(faults=sticks))
    assert emergency.time_s == pytest.approx(1.4)
    # the controller has seen the obstacle, and brakes or turns
    assert abs(emergency.car.actuators.delta) > 0.002


def test_with_preview_it_acts_from_the_start_and_foresees_what_appears(setup):
    emergency = Emergency(setup, preview=True)
    assert emergency.time_s == 0.0
    assert not emergency.obstacles_at(emergency.start_ns).items
    (foreseen,) = emergency.foreseen_at(emergency.start_ns).items
    assert (foreseen.X, foreseen.Y, foreseen.r_obs) == (60.0, 0.5, 0.8)


def test_until_then_and_with_the_same_commands_it_is_the_drive_of_a_run_bit_for_bit(setup):
    columns = simulation.run(setup, explain=False)
    run = simulation.drive(setup)
    sent = columns['/controller/command']
    fields = (sent.steer_rad, sent.steer_rate_radps, sent.front_x_n, sent.rear_x_n)
    commands = [Command(int(stamp), *values) for stamp, *values in zip(sent.stamp_ns, *fields)]
    emergency = Emergency(setup)
    commands = [command for command in commands if command.stamp_ns >= emergency.start_ns]
    drive = emergency.drive(emergency.roll(replayed(commands)))
    for ours, theirs in zip(drive.motion, run.motion, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    obstacle, other = drive.scene.obstacles[0], run.scene.obstacles[0]
    np.testing.assert_array_equal(obstacle.x, other.x)


def test_one_drive_leaves_no_trace_in_the_next(setup):
    emergency = Emergency(setup)

    def turn(car, obstacles):
        return Command(car.stamp_ns, 0.02, 0.0, -2000.0, -1000.0)

    first = emergency.roll(turn, 10).states()
    emergency.roll(lambda car, obstacles: Command(car.stamp_ns, -0.03, 0.0, 0.0, 0.0), 10)
    np.testing.assert_array_equal(emergency.roll(turn, 10).states(), first)
