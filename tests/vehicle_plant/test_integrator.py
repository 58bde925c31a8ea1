"""The integrator: its order, its step, and the same numbers with and without a compiler."""

import numpy as np
import pytest
from drives import advance_interpreted, altered, at, perform

from msgs_yaml.types import WHEELS
from node_runtime import named_vector
from vehicle_plant import integrator, road_friction
from vehicle_plant.actuators import DelayLine, SetPointRamp, delay_steps
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.manoeuvres import procedure
from vehicle_plant.simulator import START_NS
from vehicle_plant.state import SetPoints, State, Trajectory

N = len(named_vector.names(State))
REST = SetPoints(0.0, 0.0, 0.0)
ICE_LEFT = road_friction.patch_array([5, 0, 200, 0, 200, 10, 5, 10], [0.3])


@pytest.mark.needs('compiler')
@pytest.mark.parametrize('patches', [None, ICE_LEFT], ids=['dry', 'patch'])
def test_compiled_steps_are_the_interpreted_ones(params, rng, patches):
    p = integrator.parameter_vector(params, 0.8)
    x = rolling_state(params, Start(3.0, 0.5, 0.1, 22.0))
    given = x.copy()
    set_points = np.cumsum(rng.normal(size=(201, 3)) * [0.005, 300, 300], axis=0)
    state, fast = integrator.advance(x, set_points, p, patches=patches)
    _, slow = advance_interpreted(x, set_points, p, patches)
    assert np.abs(fast - slow).max() <= 1e-9 * np.abs(fast).max()
    assert np.array_equal(state, fast[-1, :N])
    assert np.array_equal(x, given)


def drive_in_steps(run, case, h):
    """Return what `procedure.drive` does with steps of h [s], a row per millisecond or per step."""
    steps, stride = round(procedure.TICK_S / h), max(round(integrator.STEP_S / h), 1)
    p = integrator.parameter_vector(case.plant, case.friction)
    x = rolling_state(case.plant, at(run.speed))
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
    driven = perform('turn_braking')
    case = driven.case._replace(plant=altered(params, car__steering__delay_ms=delay_ms))
    track = procedure.drive(driven.runs[2], case)
    expected = drive_in_steps(driven.runs[2], case, integrator.STEP_S)
    assert track.rows.tobytes() == expected.rows.tobytes()
    assert track.stamp_ns.tolist() == expected.stamp_ns.tolist()


QUANTITIES = {
    'position': ('planar.X', 'planar.Y'),
    'yaw_rate': ('planar.r',),
    'acceleration': ('acceleration.ax', 'acceleration.ay'),
    'slip': tuple(f'wheels.{w}.{slip}' for w in WHEELS for slip in ('kappa', 'tan_alpha')),
}


def step_errors(name, *steps_s):
    """Return the greatest differences of a manoeuvre's first run to one in steps of 0.1 ms."""
    case, (run, *_) = perform(name)[:2]
    reference = drive_in_steps(run, case, integrator.STEP_S / 10)

    def difference(track, names):
        """Compare at the common instants; the reference has every millisecond."""
        rows = (track.stamp_ns - reference.stamp_ns[0]) // np.diff(reference.stamp_ns[:2])
        return max(np.abs(track.column(n) - reference.column(n)[rows]).max() for n in names)

    tracks = [drive_in_steps(run, case, h) for h in steps_s]
    return [{q: difference(track, n) for q, n in QUANTITIES.items()} for track in tracks]


@pytest.mark.parametrize('name', ['step_steer', 'turn_braking', 'sine_with_dwell'])
def test_in_a_manoeuvre_the_order_is_four_and_a_millisecond_leaves_little(name):
    coarse, fine = step_errors(name, 2 * integrator.STEP_S, integrator.STEP_S)
    for quantity in ('acceleration', 'slip'):
        assert np.log2(coarse[quantity] / fine[quantity]) > 3.5
    most = {'position': 1e-7, 'yaw_rate': 1e-8, 'acceleration': 1e-5, 'slip': 1e-7}
    assert all(fine[quantity] < value for quantity, value in most.items())


def test_standstill_is_of_first_order_and_still_accurate():
    (fine,) = step_errors('straight_braking', integrator.STEP_S)
    assert fine['position'] < 1e-5
    assert fine['acceleration'] < 1e-2
