"""Slow driving on the plant: pull away, stop behind a queue and drive on, creep."""

import numpy as np
import pytest
import yaml

from experiments import simulation
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


def queue_end(behind_m):
    """Return the last car of a queue: it drives, stands for 3 s at station 77 m and drives on."""
    stations = ((45.0, 8.0), (62.0, 8.0), (77.0, 0.0), (97.0, 8.0), (190.0, 8.0))
    points = [{'station_m': s + behind_m, 'offset_m': 0.0, 'speed_mps': v} for s, v in stations]
    points[2]['wait_s'] = 3.0
    return {'waypoints': points, 'radius_m': 1.05}


@pytest.fixture(scope='module')
def drive():
    setup = simulation.prepare('straight', 'mpcc', {'controller': {'model.low_speed': True}})

    def driven(speed, start, stop, obstacles=()):
        document = yaml.safe_load(setup.scn.text) | {
            'road': ROAD,
            'path': PATH,
            'speed': {'constant_mps': speed},
            'start': {'progress_m': 0.0, 'speed_mps': start},
            'stop': stop,
            'obstacles': list(obstacles),
        }
        scn = scenario.parse(yaml.safe_dump(document), 'slow')
        columns = simulation.run(setup._replace(scn=scn), explain=False)
        whys = columns['/controller/why'].values
        return columns['/vehicle/odometry'], [why.values for why in whys], columns

    return driven


def test_it_pulls_away_from_standstill_to_the_desired_speed(drive):
    odometry, whys, _ = drive(10.0, 0.0, {'progress_m': 60.0, 'time_s': 15.0})
    assert odometry.vx_mps[0] == 0.0
    assert odometry.x_m[-1] >= 60.0
    assert odometry.vx_mps[-1] == pytest.approx(10.0, abs=0.2)
    assert odometry.vx_mps.min() > -0.05
    assert {why['rung'] for why in whys} <= {'solved', 'stopped_early'}


def test_it_stops_behind_a_queue_and_drives_on_with_it(drive):
    stop = {'progress_m': 95.0, 'time_s': 40.0, 'standstill_s': 10.0}
    odometry, whys, columns = drive(10.0, 10.0, stop, [queue_end(0.0), queue_end(2.7)])
    stands = np.abs(odometry.vx_mps) < 0.1
    assert 1.0 < stands.sum() * 1e-3 < 6.0
    assert odometry.x_m[-1] >= 95.0
    assert {why['rung'] for why in whys} <= {'solved', 'stopped_early'}
    t = odometry.t_s[::50]
    last = np.array([o.items[0].X for o in columns['/scenario/obstacles'].values])
    count = min(len(t), len(last))
    gaps = last[:count] - 1.05 - odometry.x_m[::50][:count]
    assert gaps.min() > 1.1  # the circle of the car


@pytest.mark.parametrize('repeated', [True, False], ids=['last pose repeated', 'slow at the end'])
def test_it_drives_to_the_stop_at_the_end_of_the_path_and_is_held_there(repeated):
    """10 m/s, from 35 m on down by 2 m/s^2 to 0 at 60 m."""
    setup = simulation.prepare('straight', 'mpcc_road')
    X = np.arange(0.0, 60.1, 0.5)
    v = np.minimum(np.sqrt(4.0 * (60.0 - X)), 10.0)
    t = np.concatenate(([0.0], np.cumsum(0.5 / ((v[1:] + v[:-1]) / 2))))
    if repeated:
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
    columns = simulation.run(setup._replace(scn=scn._replace(reference=path)), explain=False)
    odometry, command = columns['/vehicle/odometry'], columns['/controller/command']
    assert odometry.x_m[-1] == pytest.approx(60.0, abs=1.0)
    assert odometry.vx_mps[-1] == pytest.approx(0.0, abs=0.02)
    assert np.diff(odometry.vx_mps[::100]).min() > -0.4  # m/s in 0.1 s
    assert command.front_x_n[-1] + command.rear_x_n[-1] < -1000.0  # N
    whys = [why.values for why in columns['/controller/why'].values]
    assert {why['rung'] for why in whys if abs(why['vx']) > 0.5} <= {'solved', 'stopped_early'}
    assert {why['reason'] for why in whys[-20:]} == {'path_ended'}


def test_it_creeps(drive):
    odometry, whys, _ = drive(1.5, 8.0, {'progress_m': 25.0, 'time_s': 20.0})
    assert odometry.x_m[-1] >= 25.0
    assert odometry.vx_mps[-1] == pytest.approx(1.5, abs=0.1)
    assert odometry.vx_mps.min() > 0.5
    assert {why['rung'] for why in whys} <= {'solved', 'stopped_early'}
