"""Actuators that do something else than was asked for: plant and controller in process."""

import numpy as np
import pytest

from bags.evaluation.drive import LOCKSTEP, drive_from_columns
from bags.evaluation.metrics import compute_metrics
from bags.storage import message_filing, read
from bags.storage.bag_writer import BagWriter
from experiments import simulation
from experiments.replay import check
from mpcc_controller.driving.actuator_monitor import FAULT
from mpcc_controller.driving.controller import Controller
from msgs_yaml import contract, encode
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Actuators, Command, VehicleState
from node_runtime import ros
from vehicle_plant.simulator import START_NS, Simulator

TICK_S = 0.05
DOUBLE = 'double_lane_change'
# what a replay reads
ENCODED = {
    '/scenario/reference': (None, encode.reference),
    '/scenario/road_edges': (None, encode.road_edges),
    '/scenario/obstacles': (None, encode.obstacles),
    '/vehicle/odometry': (VehicleState, encode.odometry),
    '/vehicle/actuators': (Actuators, encode.actuators),
    '/controller/command': (Command, encode.command),
    '/controller/prediction': (None, encode.prediction),
    '/controller/why': (None, encode.why),
}
NOISE = {
    'measurement_errors.position_noise_m': 0.05,
    'measurement_errors.speed_noise_mps': 0.1,
    'measurement_errors.lateral_speed_noise_mps': 0.1,
    'measurement_errors.yaw_rate_noise_radps': 0.02,
}
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet', 'tracking', 'mpcc_comfort', 'mpcc_road')
# locked wheels: the controllers do not know that the road is slippery
NOMINAL = [
    *((DOUBLE, controller, {}) for controller in CONTROLLERS),
    *((DOUBLE, 'mpcc_road', {'plant': {'command_delay_ms': delay}}) for delay in (20, 60)),
    (
        DOUBLE,
        'mpcc_road',
        {'plant': {'command_delay_ms': 200}, 'controller': {'delay.command_s': 0.2}},
    ),
    (DOUBLE, 'mpcc', {'plant': {'friction': 0.4}}),
    *(('pop_up', controller, {'controller': NOISE}) for controller in ('mpcc', 'mpcc_road')),
    *((scene, 'mpcc_road', {}) for scene in ('split_mu_obstacle', 'stop_and_go', 'cut_in')),
    ('low_mu_obstacle', 'mpcc', {}),
]


@pytest.fixture
def drive_with(monkeypatch):
    """Return drive(scenario, controller, change, from_s, to_s, end_s) -> setup and columns.

    `change` turns a command into what the actuators are told from one time to another; its second
    argument is where they were when that began.
    """

    def drive(scenario, controller, change, from_s=0.0, to_s=np.inf, end_s=np.inf):
        class Faulty(Simulator):
            held = None

            def command(self, command):
                if from_s <= seconds(self) < to_s:
                    self.held = self.held or self.actuators
                    command = change(command, self.held)
                return super().command(command)

        monkeypatch.setattr(simulation, 'Simulator', Faulty)
        setup = simulation.prepare(scenario, controller)
        stop = setup.scn.stop
        stop = stop._replace(time=min(stop.time, end_s))
        setup = setup._replace(scn=setup.scn._replace(stop=stop))
        return setup, simulation.run(setup)

    return drive


def seconds(stamped):
    return (stamped.stamp_ns - START_NS) / NS_PER_S


def sticking(command, held):
    return command._replace(delta=held.delta, d_delta=0.0)


def weak_brakes(command, _):
    share = 0.7 if command.Fxf + command.Fxr < 0 else 1.0
    return command._replace(Fxf=share * command.Fxf, Fxr=share * command.Fxr)


def driver_brakes(command, _):
    return command._replace(Fxf=min(command.Fxf, -4000.0), Fxr=min(command.Fxr, -2000.0))


def faults(columns):
    """Return the fault of every tick, '' for none."""
    return [why.values.get(FAULT, '') for why in columns['/controller/why'].values]


def first_s(columns, fault):
    """Return when a fault was reported first, after the start."""
    return TICK_S * faults(columns).index(fault)


def verdict(setup, columns):
    info = simulation.run_info(setup)
    return compute_metrics(drive_from_columns(columns, info, setup.controller))


@pytest.mark.parametrize(('scenario', 'controller', 'settings'), NOMINAL)
def test_nothing_is_reported_of_actuators_that_only_lag(scenario, controller, settings):
    columns = simulation.run(simulation.prepare(scenario, controller, settings), explain=False)
    assert not any(faults(columns))
    errors = [why.values['actuators.steer_error_rad'] for why in columns['/controller/why'].values]
    assert max(map(abs, errors)) < 0.005


@pytest.mark.parametrize(
    ('scenario', 'controller', 'begins_s'),
    [(DOUBLE, 'mpcc', 2.5), (DOUBLE, 'mpcc_road', 2.5), ('pop_up', 'mpcc_road', 3.0)],
)
def test_a_sticking_steering_is_reported_and_planned_with(
    drive_with, scenario, controller, begins_s
):
    _, columns = drive_with(scenario, controller, sticking, begins_s, end_s=begins_s + 1.5)
    assert first_s(columns, 'steer') <= begins_s + 0.5
    assert first_s(columns, 'steer') > begins_s
    actuators = columns['/vehicle/actuators']
    reports = [why for why in columns['/controller/why'].values if FAULT in why.values]
    steer_of = dict(zip(actuators.stamp_ns.tolist(), actuators.steer_rad.tolist()))
    planned = [why for why in reports if 'set_point.delta' in why.values]
    assert len(planned) > 15
    for why in planned:
        assert why.values['set_point.delta'] == steer_of[why.stamp_ns]


def test_the_report_ends_when_the_steering_comes_free(drive_with):
    setup, columns = drive_with('pop_up', 'mpcc_road', sticking, 2.0, 2.6)
    reported = faults(columns)
    assert 'steer' in reported
    assert not any(reported[int(4.0 / TICK_S) :])
    assert verdict(setup, columns)['survived']


@pytest.mark.parametrize(
    ('scenario', 'change', 'from_s', 'to_s'),
    [('closed_road', weak_brakes, 0.0, np.inf), (DOUBLE, driver_brakes, 2.0, 3.0)],
)
def test_it_survives_what_it_does_not_survive_without_comparing(
    drive_with, monkeypatch, scenario, change, from_s, to_s
):
    setup, columns = drive_with(scenario, 'mpcc', change, from_s, to_s)
    assert 'force' in faults(columns)
    assert verdict(setup, columns)['survived']
    step = Controller.step
    monkeypatch.setattr(Controller, 'step', lambda self, x: step(self, x._replace(actuators=None)))
    setup, columns = drive_with(scenario, 'mpcc', change, from_s, to_s)
    assert not any(faults(columns))
    assert not verdict(setup, columns)['survived']


def test_a_drive_with_a_fault_is_answered_by_a_replay_as_it_was(drive_with, tmp_path):
    setup, columns = drive_with('pop_up', 'mpcc_road', sticking, 3.0, end_s=4.5)
    bag = read.load(write_bag(tmp_path / 'bag', setup, columns))
    report = check.check(bag, {})
    assert report.repeatable == len(report.ticks) == len(columns['/controller/why'].values)
    reported = [FAULT in one.tick.why.values for one in report.ticks]
    assert 15 < sum(reported) < len(reported)
    # a heading that becomes a quaternion for the second time is rounded
    assert not report.failures
    compared = [pair for one in report.ticks for pair in one.pairs if pair.field == FAULT]
    assert [pair.replayed for pair in compared] == ['steer'] * sum(reported)


def without_time(table):
    """Return the columns of a table but for the time in s, with whole stamps."""
    stamp_ns, _, *others = table
    return stamp_ns.tolist(), *others


def write_bag(folder, setup, columns):
    """Write a bag of a drive in process, as a recording in lockstep."""
    topics = message_filing.bag_topics(contract.load(), LOCKSTEP)
    info = simulation.run_info(setup) | {'mode': LOCKSTEP}
    bag = BagWriter(folder, topics, {'run': info})
    index = {topic.name: i for i, topic in enumerate(topics)}
    for name, (kind, encoded) in ENCODED.items():
        table = columns[name]
        rows = table.values if kind is None else map(kind, *without_time(table))
        for value in rows:
            data = ros.serialize(encoded(value))
            bag.write(index[name], value.stamp_ns, value.stamp_ns, data)
    bag.close()
    return folder
