"""Actuators that do something else than was asked for: plant and controller in process."""

import numpy as np
import pytest
from driven_setups import driven, prepare
from node_graph import note_run
from node_ring import NodeRing

from experiments import simulation
from experiments.configuration.node_config import known_controllers
from experiments.replay import check
from mpcc_controller.driving.actuator_faults import FAULT
from mpcc_controller.driving.controller import Controller
from msgs_yaml.conversions import NS_PER_S
from vehicle_plant.simulator import START_NS, Simulator

TICK_S = 0.05
DOUBLE = 'double_lane_change'
NOISE = {
    'measurement_errors.position_noise_m': 0.05,
    'measurement_errors.speed_noise_mps': 0.1,
    'measurement_errors.lateral_speed_noise_mps': 0.1,
    'measurement_errors.yaw_rate_noise_radps': 0.02,
}
CONTROLLERS = [*known_controllers()]
# locked wheels: the controllers do not know that the road is slippery
NOMINAL = [
    *((DOUBLE, controller, {}) for controller in CONTROLLERS),
    (DOUBLE, 'mpcc_road', {'plant': {'command_delay_ms': 60}}),
    (
        DOUBLE,
        'mpcc_road',
        {'plant': {'command_delay_ms': 200}, 'controller': {'delay.command_s': 0.2}},
    ),
    (DOUBLE, 'mpcc', {'plant': {'friction': 0.4}}),
    ('pop_up', 'mpcc_road', {'controller': NOISE}),
    *((scene, 'mpcc_road', {}) for scene in ('split_mu_obstacle', 'stop_and_go')),
    ('low_mu_obstacle', 'mpcc', {}),
]


@pytest.mark.parametrize(('scenario', 'controller', 'settings'), NOMINAL)
def test_nothing_is_reported_of_actuators_that_only_lag(drive, scenario, controller, settings):
    reports = drive(scenario, controller, settings).reports
    assert not any(report.get(FAULT) for report in reports)
    assert not any(report['reason'].startswith('steering') for report in reports)
    assert max(abs(report['actuators.steer_error_rad']) for report in reports) < 0.005


WEAK_BRAKES = {'front_force_share': 0.7, 'rear_force_share': 0.7}


class DriverBrakes(Simulator):
    """A plant whose driver brakes for a second, whatever was asked for."""

    def command(self, command):
        if 2.0 <= (self.stamp_ns - START_NS) / NS_PER_S < 3.0:
            command = command._replace(Fxf=min(command.Fxf, -4e3), Fxr=min(command.Fxr, -2e3))
        return super().command(command)


def drive_faulty(scenario, controller, end_s=np.inf, **faults):
    """Return the Driven of a car with faults of its actuators."""
    values = {f'faults.{name}': value for name, value in faults.items()}
    setup = prepare(scenario, controller, {'plant': values})
    stop = setup.scn.stop._replace(time=min(setup.scn.stop.time, end_s))
    return driven(setup._replace(scn=setup.scn._replace(stop=stop)), explain=True)


def faults(driven):
    """Return the fault of every tick, '' for none."""
    return [report.get(FAULT, '') for report in driven.reports]


def test_plans_begin_where_a_steering_is_that_is_off():
    off = drive_faulty(DOUBLE, 'mpcc', steer_offset_rad=0.03)
    actuators = off.columns['/vehicle/actuators']
    steer_of = dict(zip(actuators.stamp_ns.tolist(), actuators.steer_rad.tolist()))
    planned = [
        why
        for why in off.columns['/controller/why'].values
        if FAULT in why.values and 'set_point.delta' in why.values
    ]
    assert len(planned) > 100
    for why in planned:
        assert why.values['set_point.delta'] == steer_of[why.stamp_ns]


@pytest.mark.parametrize(
    ('scenario', 'controller', 'begins_s'), [(DOUBLE, 'mpcc', 2.5), ('pop_up', 'mpcc_road', 3.0)]
)
def test_a_sticking_steering_is_reported_and_the_car_stops(scenario, controller, begins_s):
    end_s = begins_s + 1.5
    stuck = drive_faulty(scenario, controller, end_s, steer_stuck=True, from_s=begins_s)
    first = faults(stuck).index('steer')
    assert begins_s < TICK_S * first <= begins_s + 0.301
    reasons = [report['reason'] for report in stuck.reports]
    assert {*reasons[first:]} == {'steering_sticks'}
    # it brakes before it is known that the set-points are not late
    stands = reasons.index('steering_stands')
    assert TICK_S * stands <= begins_s + 0.2
    assert {*reasons[stands:first]} == {'steering_stands'}
    odometry = stuck.columns['/vehicle/odometry']
    forces = stuck.columns['/vehicle/actuators']
    half_s = TICK_S * first + 0.2  # the brakes are applied faster than by a car that steers
    half_n = np.interp(half_s, forces.t_s, forces.front_x_n + forces.rear_x_n)
    assert half_n < -0.5 * 9.81 * stuck.setup.vehicle.car.mass_kg
    begins_s = TICK_S * first + 0.5  # then the brakes have their force
    early, late = np.interp([begins_s, begins_s + 0.5], odometry.t_s, odometry.vx_mps)
    assert late == 0.0 or early - late > 0.5 * 6.0


def test_the_report_ends_when_the_steering_comes_free():
    freed = drive_faulty('pop_up', 'mpcc_road', steer_stuck=True, from_s=3.0, until_s=3.6)
    assert 'steer' in faults(freed)
    assert not any(faults(freed)[int(5.0 / TICK_S) :])
    assert freed.metrics['survived']


@pytest.mark.parametrize(
    ('scenario', 'controller', 'fault', 'plant', 'reported'),
    [
        ('closed_road', 'mpcc', WEAK_BRAKES, Simulator, 'force'),
        (DOUBLE, 'mpcc', {}, DriverBrakes, 'force'),
        ('closed_road', 'mpcc_road', {'delay_ms': 150}, Simulator, 'late'),
        ('stop_and_go', 'mpcc_road', {'front_force_share': 0.0}, Simulator, 'front'),
        ('stop_and_go', 'mpcc_road', {'rear_force_share': 0.0}, Simulator, 'rear'),
    ],
)
def test_it_survives_what_it_does_not_survive_without_comparing(
    monkeypatch, scenario, controller, fault, plant, reported
):
    monkeypatch.setattr(simulation, 'Simulator', plant)
    comparing = drive_faulty(scenario, controller, **fault)
    assert reported in faults(comparing)
    assert comparing.metrics['survived']
    step = Controller.step
    monkeypatch.setattr(Controller, 'step', lambda self, x: step(self, x._replace(actuators=None)))
    blind = drive_faulty(scenario, controller, **fault)
    assert not any(faults(blind))
    assert not blind.metrics['survived']


def test_how_late_set_points_are_is_reported_from_the_first_small_movements_on():
    late = drive_faulty('pop_up', 'mpcc_road', delay_ms=150)
    found = faults(late).index('late')
    assert found * TICK_S < 1.5
    assert {report.get('actuators.late_ms') for report in late.reports[found:]} == {150.0}
    lead_ms = [report['time.lead_ms'] for report in late.reports]
    assert lead_ms == [0.0] * found + [150.0] * (len(lead_ms) - found)


@pytest.mark.usefixtures('dds')
def test_a_drive_with_a_fault_is_answered_by_a_replay_as_it_was(tmp_path):
    plant = {'stop.time_s': 4.0, 'faults.steer_stuck': True, 'faults.from_s': 2.5}
    ring = NodeRing(tmp_path, 'lockstep', DOUBLE, plant=plant)
    note_run(ring.configured, tmp_path, DOUBLE)
    with ring:
        report = check.check(ring.finish(), {})
    assert report.repeatable == len(report.ticks) == len(ring.whys)
    reported = [FAULT in tick.tick.why.values for tick in report.ticks]
    assert 15 < sum(reported) < len(reported)
    # a heading that becomes a quaternion for the second time is rounded
    assert not report.failures
    compared = [pair for tick in report.ticks for pair in tick.pairs if pair.field == FAULT]
    assert [pair.replayed for pair in compared] == ['steer'] * sum(reported)
