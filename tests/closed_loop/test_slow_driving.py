"""Slow driving: pull away, creep, stop behind a queue or at the end of the path and drive on."""

import numpy as np
import pytest
import yaml
from driven_setups import driven, prepare

from experiments import simulation
from msgs_yaml.conversions import NS_PER_S
from scenario_publisher import scenario

ROAD = {
    'centre_line': {
        'start': {'x_m': -20.0, 'y_m': 0.0, 'yaw_rad': 0.0},
        'segments': [{'straight': {'length_m': 220.0}}],
    },
    'edges': {'left': {'offset_m': 2.2}, 'right': {'offset_m': -2.2}},
}
PATH = {
    'start': {'x_m': 0.0, 'y_m': 0.0, 'yaw_rad': 0.0},
    'segments': [{'straight': {'length_m': 180.0}}],
}
PLANNED = {'solved', 'stopped_early'}


def drive_slowly(speed, start, stop, obstacles=()):
    """Return the Driven of a car on a narrow straight road."""
    setup = prepare('straight', 'mpcc', {'controller': {'model.low_speed': True}})
    document = yaml.safe_load(setup.scn.text) | {
        'road': ROAD,
        'path': PATH,
        'speed': {'constant_mps': speed},
        'start': {'progress_m': 0.0, 'speed_mps': start},
        'stop': stop,
        'obstacles': list(obstacles),
    }
    slow = driven(setup._replace(scn=scenario.parse(yaml.safe_dump(document), 'slow')))
    assert {report['rung'] for report in slow.reports} <= PLANNED
    return slow


@pytest.mark.parametrize(
    ('start', 'speed', 'stop_m', 'least_mps', 'tolerance'),
    [
        pytest.param(0.0, 10.0, 60.0, -0.05, 0.2, id='pulls away'),
        pytest.param(8.0, 1.5, 25.0, 0.5, 0.1, id='creeps'),
    ],
)
def test_it_reaches_the_desired_speed(start, speed, stop_m, least_mps, tolerance):
    slow = drive_slowly(speed, start, {'progress_m': stop_m, 'time_s': 20.0})
    odometry = slow.columns['/vehicle/odometry']
    assert odometry.vx_mps[0] == start
    assert odometry.x_m[-1] >= stop_m
    assert odometry.vx_mps[-1] == pytest.approx(speed, abs=tolerance)
    assert odometry.vx_mps.min() > least_mps


def queue_end(behind_m):
    """Return the last car of a queue: it drives, stands for 3 s at station 77 m and drives on."""
    stations = ((45.0, 8.0), (62.0, 8.0), (77.0, 0.0), (97.0, 8.0), (190.0, 8.0))
    points = [{'station_m': s + behind_m, 'offset_m': 0.0, 'speed_mps': v} for s, v in stations]
    points[2]['wait_s'] = 3.0
    return {'waypoints': points, 'radius_m': 1.05}


def test_it_stops_behind_a_queue_and_drives_on_with_it():
    stop = {'progress_m': 95.0, 'time_s': 40.0, 'standstill_s': 10.0}
    columns = drive_slowly(10.0, 10.0, stop, [queue_end(0.0), queue_end(2.7)]).columns
    odometry = columns['/vehicle/odometry']
    stands = np.abs(odometry.vx_mps) < 0.1
    assert 1.0 < stands.sum() * 1e-3 < 6.0
    assert odometry.x_m[-1] >= 95.0
    last = np.array([o.items[0].X for o in columns['/scenario/obstacles'].values])
    x = odometry.x_m[::50][: len(last)]
    assert (last[: len(x)] - 1.05 - x).min() > 1.1  # the circle of the car


@pytest.fixture(params=[True, False], ids=['last pose repeated', 'slow at the end'])
def stop_here(request):
    """A setup with a path of 10 m/s, from 35 m on down by 2 m/s^2 to 0 at 60 m."""
    setup = simulation.prepare('straight', 'mpcc_road')
    X = np.arange(0.0, 60.1, 0.5)
    v = np.minimum(np.sqrt(4.0 * (60.0 - X)), 10.0)
    t = np.concatenate(([0.0], np.cumsum(0.5 / ((v[1:] + v[:-1]) / 2))))
    if request.param:
        X, t = np.append(X, X[-1]), np.append(t, t[-1] + 1.0)
    document = yaml.safe_load(setup.scn.text) | {
        'road': ROAD,
        'path': PATH,
        'start': {'progress_m': 0.0, 'speed_mps': 10.0},
        'stop': {'progress_m': 150.0, 'time_s': 16.0, 'standstill_s': 2.0},
        'obstacles': [],
    }
    scn = scenario.parse(yaml.safe_dump(document), 'stop')
    path = scn.reference._replace(X=X, Y=0 * X, psi=0 * X, t=t)
    return setup._replace(scn=scn._replace(reference=path))


def test_it_drives_to_the_stop_at_the_end_of_the_path_and_is_held_there(stop_here):
    stopped = driven(stop_here)
    odometry = stopped.columns['/vehicle/odometry']
    command = stopped.columns['/controller/command']
    assert odometry.x_m[-1] == pytest.approx(60.0, abs=1.0)
    assert odometry.vx_mps[-1] == pytest.approx(0.0, abs=0.02)
    assert np.diff(odometry.vx_mps[::100]).min() > -0.4  # m/s in 0.1 s
    assert command.front_x_n[-1] + command.rear_x_n[-1] < -1000.0  # N
    reports = stopped.reports
    assert {report['rung'] for report in reports if abs(report['vx']) > 0.5} <= PLANNED
    assert {report['reason'] for report in reports[-20:]} == {'path_ended'}


def test_it_leaves_a_stop_on_a_path_that_leads_on(stop_here):
    X = np.arange(60.0, 200.0)
    path = stop_here.scn.reference._replace(X=X, Y=0 * X, psi=0 * X, t=(X - X[0]) / 10.0)
    stop = stop_here.scn.stop._replace(X=100.0, time=30.0)
    left_ns = None
    for step in simulation.steps(stop_here._replace(scn=stop_here.scn._replace(stop=stop))):
        stands = abs(step.car.state.vx) < 0.02 and step.record.decision.reason == 'path_ended'
        if stands and left_ns is None:
            left_ns = step.car.stamp_ns
            step.controller.set_reference(path)
    assert step.car.state.X > 100.0
    assert 0.0 < step.car.stamp_ns - left_ns < 11.0 * NS_PER_S
