"""Faults of the actuators: what the servos do instead of what was asked for."""

import numpy as np
import pytest
from drives import ahead, load
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml.types import Command
from vehicle_plant.car import FaultParams, add_delay
from vehicle_plant.parameters import PlantParams
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import join_trajectories

NO_FAULTS = dict.fromkeys(FaultParams.__annotations__)
SERVOS = [f'servos.{name}.position' for name in ('steer', 'front', 'rear')]
TICKS = 20
BEGIN_S = 0.4
kinds = st.fixed_dictionaries(
    {},
    optional={
        'steer_stuck': st.booleans(),
        'steer_offset_rad': st.floats(-0.02, 0.02),
        'front_force_share': st.floats(0.0, 1.0),
        'rear_force_share': st.floats(0.0, 1.0),
        'delay_ms': st.integers(0, 150),
    },
)


def driven(faults, plant=None, pieces=(50,), fork_at=None):
    """Return the drive of one second of steering to both sides, braking; each tick in pieces."""
    car = Simulator(plant or load(), 1.0, ahead(20.0), faults=FaultParams(**(NO_FAULTS | faults)))
    parts = [car.now]
    for k in range(TICKS):
        if k == fork_at:
            car, other = car.fork(), car
            other.advance(None, 500)
        car.command(Command(car.stamp_ns, 0.02 * np.sin(0.5 * k), 0.0, -1000.0, -600.0))
        parts += [car.advance(None, steps) for steps in pieces]
    return join_trajectories(parts)


def at_the_end(track):
    return np.array([track.column(name)[-1] for name in SERVOS])


@settings(max_examples=15)
@given(kinds, st.sampled_from([(50,), (1, 0, 49), (20, 13, 17)]), st.none() | st.integers(1, 19))
def test_a_drive_is_that_of_a_healthy_car_until_the_fault_however_it_is_cut(kind, pieces, fork_at):
    faults = {**kind, 'from_s': BEGIN_S}
    track, healthy = (driven(f, pieces=pieces, fork_at=fork_at) for f in (faults, {}))
    until = round(1e3 * BEGIN_S)
    assert np.array_equal(track.rows[:until], healthy.rows[:until])
    assert np.allclose(track.rows, driven(faults).rows, atol=1e-6)  # of rounded ramps


def test_a_fault_ends():
    passed = driven({'steer_offset_rad': 0.01, 'from_s': 0.2, 'until_s': 0.45})
    steer, healthy = (drive.column(SERVOS[0]) for drive in (passed, driven({})))
    assert np.abs(steer - healthy).max() == pytest.approx(0.01, rel=0.1)
    assert np.abs(steer - healthy)[-200:].max() < 1e-5


def test_each_fault_does_what_it_is_called():
    healthy = at_the_end(driven({}))
    stuck = driven({'steer_stuck': True, 'from_s': BEGIN_S}).column(SERVOS[0])
    assert np.ptp(stuck[-400:]) < 1e-4
    assert np.ptp(driven({}).column(SERVOS[0])[-400:]) > 0.01
    assert at_the_end(driven({'steer_offset_rad': 0.01})) - healthy == pytest.approx(
        [0.01, 0.0, 0.0], abs=1e-6
    )
    weak = at_the_end(driven({'front_force_share': 0.0, 'rear_force_share': 0.5}))
    assert weak == pytest.approx(healthy * [1.0, 0.0, 0.5], rel=1e-6)


def test_a_late_actuator_is_that_of_a_car_with_a_longer_delay():
    plant = load()
    slower = PlantParams(add_delay(plant.car, 150), plant.tyre)
    assert np.array_equal(driven({'delay_ms': 150}).rows, driven({}, slower).rows)
