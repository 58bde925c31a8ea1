"""Controllers, cars and roads in process, and within what bands each drive has to end."""

import math
import re

import numpy as np
import pytest
from driven_setups import prepare

from experiments import simulation
from msgs_yaml import share
from vehicle_plant import identify, parameters

DOUBLE = 'double_lane_change'
MULTI_BODY = {
    'plant': {'plant_params': parameters.MULTI_BODY_CAR},
    'controller': {'car_file': 'car_commonroad_320i.yaml'},
}
NOISE = {
    'position_noise_m': 0.05,
    'yaw_noise_rad': 0.005,
    'speed_noise_mps': 0.1,
    'lateral_speed_noise_mps': 0.08,
    'yaw_rate_noise_radps': 0.01,
}
# on the dry road 136 km/h is possible: the speed goes with the root of the friction
SLIPPERY, SLIPPERY_KPH = 0.6, 136 * math.sqrt(0.8 * 0.6)
UNTOLD = {'plant': {'friction': SLIPPERY}, 'controller': {'model.friction': 1.0}}
BIAS = {'controller': {'model.friction': 1.0, 'measurement_errors.sideslip_bias_rad': 0.02}}
ICE = {**MULTI_BODY, 'plant': {**MULTI_BODY['plant'], 'friction': 0.4}}
NOT_HIT = {'completed': (True, True), 'collided': (False, False)}
PLANNED = NOT_HIT | {'fallbacks': (0, 0), 'deadline_misses': (0, 0)}
SURVIVED = {'survived': (True, True)}


def noisy(factor):
    errors = {f'measurement_errors.{name}': factor * value for name, value in NOISE.items()}
    return {'controller': errors}


def row(scenario, controller, bands, settings=(), kph=None, name=''):
    label = ' '.join(filter(None, (scenario, controller, name)))
    return pytest.param(scenario, controller, dict(settings), kph, bands, id=label)


@pytest.mark.parametrize(
    ('scenario', 'controller', 'settings', 'kph', 'bands'),
    [
        row(
            DOUBLE,
            'mpcc',
            PLANNED
            | {
                'entered_unsafe_area': (False, False),
                'min_outline_gap_m': (0.3, 1.0),
                'min_v2o_m': (0.5, 0.6),
                'peak_sideslip_deg': (2.0, 10.0),
                'peak_lat_acc_mps2': (0.8 * 9.81, 9.5),
            },
        ),
        row(
            DOUBLE,
            'mpcc_no_ca',
            {'completed': (True, True), 'entered_unsafe_area': (True, True), 'min_v2o_m': (-1, 0)},
        ),
        row(DOUBLE, 'frenet', PLANNED | {'min_v2o_m': (0.3, 1.0), 'peak_sideslip_deg': (2, 10)}),
        row('straight', 'mpcc', PLANNED | {'rms_contouring_m': (0.0, 0.01)}),
        # the runs reach the limit of that car, 8.7 m/s^2 in a steady turn
        *(
            row(
                DOUBLE,
                controller,
                PLANNED | {'min_v2e_m': (0.0, 2.0), 'peak_lat_acc_mps2': (8.0, 9.5)},
                MULTI_BODY,
                75,
                'multi-body',
            )
            for controller in ('mpcc', 'frenet')
        ),
        # never the lateral acceleration of the dry road
        row(
            DOUBLE,
            'mpcc',
            {'peak_lat_acc_mps2': (1.0, 1.15 * 0.4 * 0.85 * 1.0489 * 9.81)},
            ICE,
            60,
            'multi-body on ice',
        ),
        row(
            DOUBLE,
            'mpcc_road',
            SURVIVED | {'peak_sideslip_deg': (0.0, 10.0)},
            UNTOLD,
            SLIPPERY_KPH,
            'slippery',
        ),
        row(DOUBLE, 'mpcc_road', SURVIVED, BIAS, 80, 'wrong sideslip'),
        row('closed_road', 'mpcc_road', SURVIVED, noisy(2.0), None, 'noise'),
        # one that comes in its own lane of the bend is met in the own lane
        row(
            'bend_oncoming',
            'mpcc_road',
            SURVIVED | {'min_outline_gap_m': (0.5, 2.0), 'lane_excess_m': (-3.0, 0.0)},
        ),
    ],
)
def test_a_drive_ends_within_its_bands(drive, scenario, controller, settings, kph, bands):
    metrics = drive(scenario, controller, settings, kph).metrics
    outside = {
        name: metrics[name]
        for name, (low, high) in bands.items()
        if not low <= metrics[name] <= high
    }
    assert outside == {}


def test_a_drive_that_is_not_explained_is_the_same_to_the_last_bit(drive):
    brief = drive(DOUBLE, 'mpcc').columns
    explained = simulation.run(prepare(DOUBLE, 'mpcc'))
    assert set(explained) - set(brief) == {'/controller/prediction', '/controller/stop_plan'}
    for topic, table in brief.items():
        if not hasattr(table, 'values'):
            for name, column in vars(table).items():
                assert np.array_equal(column, getattr(explained[topic], name)), (topic, name)
    reports = (brief['/controller/why'].values, explained['/controller/why'].values)
    for own, other in zip(*reports, strict=True):
        assert own._replace(values={}) == other._replace(values={})
        timeless = {name: v for name, v in own.values.items() if not name.startswith('time.')}
        assert timeless == {name: other.values[name] for name in timeless}
        assert {'solver.iterations', 'gate', 'theta'} <= set(own.values) < set(other.values)


def estimates(driven):
    return np.array([report.get('friction.estimate', np.nan) for report in driven.reports])


def test_the_friction_of_a_slippery_road_is_estimated_and_without_that_the_car_is_lost(drive):
    used = estimates(drive(DOUBLE, 'mpcc_road', UNTOLD, SLIPPERY_KPH))
    assert np.median(used[len(used) // 2 :]) == pytest.approx(SLIPPERY, abs=0.1)
    off = {**UNTOLD, 'controller': {**UNTOLD['controller'], 'friction_estimate.on': False}}
    without = drive(DOUBLE, 'mpcc_road', off, SLIPPERY_KPH)
    assert not without.metrics['survived']
    assert np.all(np.isnan(estimates(without)))


def test_a_wrong_sideslip_is_not_taken_for_ice(drive):
    biased = estimates(drive(DOUBLE, 'mpcc_road', BIAS, 80))
    assert np.median(biased[len(biased) // 2 :]) > 0.8


def test_a_delay_that_is_known_costs_little(drive):
    late = {'plant': {'command_delay_ms': 40}}
    known = {**late, 'controller': {'delay.command_s': 0.04}}
    peaks = [
        drive(DOUBLE, 'mpcc', settings, 80).metrics['peak_sideslip_deg']
        for settings in ({}, known, late)
    ]
    assert peaks[0] <= peaks[1] + 0.5 < peaks[2]
    assert peaks[1] < 1.3 * peaks[0]


def test_the_file_that_identify_writes_is_all_that_another_car_needs(drive, tmp_path):
    """Front-wheel drive, and it steers more slowly than mpcc.yaml asks."""
    file = tmp_path / 'gti.yaml'
    assert identify.main(['--car', 'vw_gti.yaml', '--out', str(file)]) == 0
    settings = {'plant': {'plant_params': 'vw_gti.yaml'}, 'controller': {'car_file': str(file)}}
    driven = drive(DOUBLE, 'mpcc', settings)
    assert driven.metrics['completed']
    assert not driven.metrics['collided']
    assert driven.metrics['min_v2e_m'] > 0.3
    assert driven.metrics['min_v2o_m'] > 0.5
    assert driven.metrics['fallbacks'] == 0
    assert driven.setup.params.limits.steer_rate_radps > 0.5
    rates = driven.columns['/controller/command'].steer_rate_radps
    assert abs(rates).max() == pytest.approx(0.349, rel=1e-6)
    # the layout in the controller wins over the file: the car leaves the road
    wrong = {**settings['controller'], 'model.drive_front_share': 0.0}
    rear = drive(DOUBLE, 'mpcc', {**settings, 'controller': wrong}).metrics
    assert not rear['completed'] or rear['min_v2e_m'] < 0.0


def test_the_car_file_of_the_multi_body_car_is_what_identify_makes(tmp_path):
    out = tmp_path / 'car.yaml'
    assert identify.main(['--car', parameters.MULTI_BODY_CAR, '--out', str(out)]) == 0
    committed = share.path('mpcc_controller', 'config', 'car_commonroad_320i.yaml').read_text()

    def numbers(text):
        # the last digits differ between processors
        return [float(x) for x in re.findall(r': (-?[\d.]+)', text)]

    assert numbers(out.read_text()) == pytest.approx(numbers(committed), rel=1e-3)
