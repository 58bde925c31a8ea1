"""No sequence of commands, on no road, makes the car leave physics. bench/plant_random.py: more."""

import numpy as np
import plant_random
import pytest

from msgs_yaml.types import WHEELS
from vehicle_plant import parameters
from vehicle_plant.manoeuvres import procedure, settings
from vehicle_plant.state import SetPoints

SEQUENCES, SECONDS = 500, 1.5


@pytest.fixture(scope='module')
def case():
    return procedure.Case(parameters.load(), 1.0, settings.load())


def test_random_commands_never_break_a_bound(case):
    broken = {
        seed: lines
        for seed in range(SEQUENCES)
        if (lines := plant_random.drive_random_run(seed, case, SECONDS))
    }
    assert broken == {}


def test_sequences_reach_the_corners_of_what_can_be_asked(case):
    """Ice and dry road, standstill and full speed, both locks, all brakes, all drive."""
    car = case.plant.car
    frictions, speeds, set_points = [], [], set()
    for seed in range(100):
        run, friction = plant_random.random_run(seed, case.plant, SECONDS)
        again, _ = plant_random.random_run(seed, case.plant, SECONDS)
        ticks = np.arange(1, round(SECONDS / procedure.TICK_S) + 1) * procedure.TICK_S
        sequence = [run.law(t, 0.0) for t in ticks]
        assert sequence == [again.law(t, 0.0) for t in ticks]
        set_points.update(sequence)
        frictions.append(friction)
        speeds.append(run.speed)
    assert min(frictions) < 0.15
    assert max(frictions) > 1.15
    assert 0.0 in speeds
    assert max(speeds) > 40.0
    delta, Fxf, Fxr = zip(*set_points)
    assert (min(delta), max(delta)) == (-car.steering.limit_rad, car.steering.limit_rad)
    assert min(Fxf) == -car.force.front.brake_n
    assert (min(Fxr), max(Fxr)) == (-car.force.rear.brake_n, car.force.rear.drive_n)


def test_full_brakes_at_full_lock_end_at_standstill(case):
    """Every odd sequence brakes with all it has in its second half."""
    car, stood = case.plant.car, 0
    for seed in range(1, 40, 2):
        run, friction = plant_random.random_run(seed, case.plant, 4.0)
        if run.speed > 5.0 or friction < 0.5:
            continue
        track = procedure.drive(run, case._replace(friction=friction))
        assert np.abs(track.column('planar.vx')[-500:]).max() < 0.05, seed
        for w in WHEELS:
            rim = track.column(f'wheels.{w}.omega')[-500:] * car.wheel.radius_m
            assert np.abs(rim).max() < 0.1, seed
        stood += 1
    assert stood > 0


@pytest.mark.parametrize('speed', [0.0, 25.0])
def test_wheels_that_spin_up_on_ice_keep_their_slip_bounded(case, speed):
    """Full throttle for three seconds: the rims race, the slips stay."""
    drive = case.plant.car.force.rear.drive_n
    run = procedure.Run('throttle', speed, 3.0, lambda t, _: SetPoints(0.0, 0.0, drive))
    track = procedure.drive(run, case._replace(friction=0.1))
    assert plant_random.violated_bounds(track, run, 0.1, case.plant) == []
    assert track.column('planar.vx')[-1] > speed


@pytest.mark.parametrize(
    ('column', 'value', 'line'),
    [
        ('planar.vx', np.nan, 'a number is not finite'),
        ('planar.vx', 90.0, 'speed is'),
        ('loads.fl.Fx', 2e4, 'fl force beyond grip is'),
        ('loads.rr.Fz', 3e4, 'rr load is'),
        ('wheels.rl.kappa', -2.1, 'rl kappa is'),
        ('ride.phi', 0.2, 'roll is'),
    ],
)
def test_a_broken_bound_is_named(case, column, value, line):
    run, friction = plant_random.random_run(0, case.plant, SECONDS)
    track = procedure.drive(run, case._replace(friction=friction))
    assert plant_random.violated_bounds(track, run, friction, case.plant) == []
    track.column(column)[len(track.rows) // 2] = value
    (violation,) = plant_random.violated_bounds(track, run, friction, case.plant)
    assert violation.startswith(line)
