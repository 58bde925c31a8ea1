"""The integrator: its order, its step, and the same numbers with and without a compiler."""

from dataclasses import replace

import numpy as np
import pytest

from msgs_yaml.types import WHEELS
from node_runtime import named_vector
from vehicle_plant import integrator
from vehicle_plant.actuators import DelayLine, SetPointRamp, delay_steps
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.manoeuvres import procedure, settings
from vehicle_plant.simulator import START_NS
from vehicle_plant.state import SetPoints, State, Trajectory

N = len(named_vector.names(State))
REST = SetPoints(0.0, 0.0, 0.0)
PLACE = [
    named_vector.names(State).index(f'planar.{name}') for name in ('X', 'Y', 'psi', 'vx', 'vy', 'r')
]


def swerve(steps, h):
    t = np.arange(steps + 1) * h
    delta = 0.06 * np.sin(2 * np.pi * 0.7 * t)
    return np.column_stack([delta, -3000 - 0 * t, -1500 - 0 * t])


def rolling(params, speed):
    return rolling_state(params, Start(0.0, 0.0, 0.0, speed))


def settled(params, speed):
    """A state on which the braked car rolls steadily: nothing sticks, no servo starts."""
    x = rolling(params, speed)
    held = np.tile([0.02, -3000.0, -1500.0], (501, 1))
    return integrator.advance(x, held, integrator.parameter_vector(params, 1.0))[1][-1, :N]


def test_error_falls_with_the_fourth_power_of_the_step(params):
    p = integrator.parameter_vector(params, 1.0)
    x = settled(params, 30.0)

    def end(steps):
        t = np.linspace(0.0, 1.0, steps + 1)
        # straight lines, which every step size samples exactly
        set_points = np.column_stack([0.02 + 0.02 * t, -3000 + 0 * t, -1500 + 0 * t])
        return integrator.advance(x, set_points, p, 0.2 / steps)[1][-1, :N]

    exact = end(3200)
    errors = [np.linalg.norm((end(steps) - exact)[PLACE]) for steps in (100, 200, 400)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 3.5).all(), (errors, orders)


def test_a_millisecond_is_converged_at_the_limit(params):
    """A swerve that uses all grip, 3 s: a quarter of the step changes the end by under 1 mm."""
    p = integrator.parameter_vector(params, 1.0)
    x = rolling_state(params, Start(0.0, 0.0, 0.0, 25.0))
    coarse = integrator.advance(x, swerve(3000, 1e-3), p, 1e-3)[1][-1, PLACE]
    fine = integrator.advance(x, swerve(12000, 2.5e-4), p, 2.5e-4)[1][-1, PLACE]
    assert np.hypot(*(coarse - fine)[:2]) < 1e-3
    assert np.abs(coarse - fine)[2:].max() < 1e-3


@pytest.mark.needs('compiler')
def test_interpreted_equals_compiled(params, rng, advance_interpreted):
    p = integrator.parameter_vector(params, 0.8)
    x = rolling_state(params, Start(1.0, 2.0, 0.5, 22.0))
    set_points = np.cumsum(rng.normal(size=(301, 3)) * [0.005, 300, 300], axis=0)
    fast = integrator.advance(x, set_points, p)[1]
    _, slow = advance_interpreted(x, set_points, p)
    assert np.abs(fast - slow).max() <= 1e-9 * np.abs(fast).max()


def test_parameters_change_nothing_but_numbers(params):
    """Another friction takes the same compiled plant."""
    before = integrator.library()
    x = rolling_state(params, Start(0.0, 0.0, 0.0, 20.0))
    for friction in (1.0, 0.5):
        integrator.advance(x, np.zeros((2, 3)), integrator.parameter_vector(params, friction))
    assert integrator.library() == before


def case_of(plant):
    return procedure.Case(plant, 1.0, settings.load())


def drive_in_steps(run, case, h):
    """Return what `procedure.drive` does with steps of h [s], a row per millisecond or per step."""
    steps, stride = round(procedure.TICK_S / h), max(round(integrator.STEP_S / h), 1)
    p, x = integrator.parameter_vector(case.plant, case.friction), rolling(case.plant, run.speed)
    delays = (round(n * integrator.STEP_S / h) for n in delay_steps(case.plant.car))
    line, ramp = DelayLine(SetPoints(*delays), REST), SetPointRamp(REST)
    vx, rows = run.speed, []
    for tick in range(1, round(run.seconds / procedure.TICK_S) + 1):
        ramp.set_target(run.law(tick * procedure.TICK_S, vx), steps)
        x, burst = integrator.advance(x, line.shift(ramp.advance(steps)), p, h)
        rows.append(burst[stride - 1 :: stride])
        vx = Trajectory(np.empty(0), rows[-1]).column('planar.vx')[-1]
    rows = np.concatenate(rows)
    every_ns = round(h * stride * 1e9)
    return Trajectory(START_NS + every_ns * np.arange(1, len(rows) + 1), rows)


@pytest.mark.parametrize('delay_ms', [0, 70])
def test_a_simulator_drives_in_steps_of_a_millisecond(params, delay_ms):
    late = replace(params.car.steering, delay_ms=delay_ms)
    case = case_of(replace(params, car=replace(params.car, steering=late)))
    run = MANOEUVRES['turn_braking'].runs(case)[2]
    trajectory, expected = procedure.drive(run, case), drive_in_steps(run, case, integrator.STEP_S)
    assert trajectory.rows.tobytes() == expected.rows.tobytes()
    assert trajectory.stamp_ns.tolist() == expected.stamp_ns.tolist()


def step_errors(plant, name, steps_s):
    """Return the greatest differences of a manoeuvre's first run to one in steps of 0.1 ms."""
    case = case_of(plant)
    run = MANOEUVRES[name].runs(case)[0]
    reference = drive_in_steps(run, case, integrator.STEP_S / 10)
    return [difference(drive_in_steps(run, case, h), reference) for h in steps_s]


def difference(trajectory, reference):
    """Compare at the common instants; the reference has every millisecond."""
    rows = (trajectory.stamp_ns - reference.stamp_ns[0]) // np.diff(reference.stamp_ns[:2])
    slips = [f'wheels.{w}.{slip}' for w in WHEELS for slip in ('kappa', 'tan_alpha')]
    columns = {
        'position': ('planar.X', 'planar.Y'),
        'yaw_rate': ('planar.r',),
        'acceleration': ('acceleration.ax', 'acceleration.ay'),
        'slip': slips,
    }
    return {
        quantity: max(np.abs(trajectory.column(n) - reference.column(n)[rows]).max() for n in names)
        for quantity, names in columns.items()
    }


@pytest.mark.parametrize('name', ['step_steer', 'turn_braking', 'sine_with_dwell'])
def test_error_falls_with_the_fourth_power_and_a_millisecond_leaves_little(params, name):
    coarse, fine = step_errors(params, name, (2 * integrator.STEP_S, integrator.STEP_S))
    for quantity in ('acceleration', 'slip'):
        assert np.log2(coarse[quantity] / fine[quantity]) > 3.5
    most = {'position': 1e-7, 'yaw_rate': 1e-8, 'acceleration': 1e-5, 'slip': 1e-7}
    assert all(fine[quantity] < value for quantity, value in most.items())


def test_standstill_is_of_first_order_and_still_accurate(params):
    (fine,) = step_errors(params, 'straight_braking', (integrator.STEP_S,))
    assert fine['position'] < 1e-5
    assert fine['acceleration'] < 1e-2
