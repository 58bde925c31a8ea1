"""A road that is more slippery than the scenario says, late commands, wrong measurements."""

import numpy as np
import pytest

from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import simulation

SCENARIO, KPH = 'double_lane_change', 1 / 3.6


def driven(controller, friction, speed_kph, plant=None, **settings):
    """Return metrics and the estimates of the friction over the ticks of a drive."""
    settings = {'model.friction': 1.0} | {n.replace('__', '.'): v for n, v in settings.items()}
    roles = {'plant': {'friction': friction} | (plant or {}), 'controller': settings}
    setup = simulation.prepare(SCENARIO, controller, roles, speed_mps=speed_kph * KPH)
    columns = simulation.run(setup, explain=False)
    drive = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    reports = [why.values for why in columns['/controller/why'].values]
    estimates = [report.get('friction.estimate', np.nan) for report in reports]
    return metrics.compute_metrics(drive), np.array(estimates)


@pytest.mark.parametrize('friction', [0.6])
def test_what_was_thought_dry_is_driven_at_four_fifths_of_the_true_limit(friction):
    """On the dry road 136 km/h is possible: the speed goes with the root of the friction."""
    found, estimates = driven('mpcc_road', friction, 136 * np.sqrt(0.8 * friction))
    assert found['survived']
    assert found['peak_sideslip_deg'] < 10.0
    used = estimates[len(estimates) // 2 :]
    assert np.median(used) == pytest.approx(friction, abs=0.1)


def test_without_the_estimate_the_same_road_costs_the_car():
    off = {'friction_estimate__on': False}
    found, estimates = driven('mpcc_road', 0.6, 136 * np.sqrt(0.8 * 0.6), **off)
    assert not found['survived']
    assert np.all(np.isnan(estimates))


def test_a_wrong_sideslip_angle_is_not_taken_for_ice():
    found, estimates = driven('mpcc_road', 1.0, 80, measurement_errors__sideslip_bias_rad=0.02)
    assert found['survived']
    assert np.median(estimates[len(estimates) // 2 :]) > 0.8


NOISE = {
    'position_noise_m': 0.05,
    'yaw_noise_rad': 0.005,
    'speed_noise_mps': 0.1,
    'lateral_speed_noise_mps': 0.08,
    'yaw_rate_noise_radps': 0.01,
}


@pytest.mark.parametrize('factor', [1.0, 2.0])
def test_noise_of_the_state_is_not_taken_for_ice(factor):
    """On a straight dry road the car stops before a barrier, and has a plan in every tick."""
    errors = {f'measurement_errors.{name}': factor * value for name, value in NOISE.items()}
    setup = simulation.prepare('closed_road', 'mpcc_road', {'controller': errors})
    columns = simulation.run(setup, explain=False)
    found = metrics.compute_metrics(drive_from_columns(columns, simulation.run_info(setup), ''))
    reports = [why.values for why in columns['/controller/why'].values]
    assert found['survived'], found['lost_by']
    assert {report['reason'] for report in reports} <= {'converged', 'good_enough'}
    assert min(report['friction.estimate'] for report in reports) > 0.6


def test_a_delay_that_is_known_costs_little():
    late = {'command_delay_ms': 40}
    prompt, _ = driven('mpcc', 1.0, 80)
    unknown, _ = driven('mpcc', 1.0, 80, late)
    known, _ = driven('mpcc', 1.0, 80, late, delay__command_s=0.04)
    peaks = [found['peak_sideslip_deg'] for found in (prompt, known, unknown)]
    assert peaks[0] <= peaks[1] + 0.5 < peaks[2]
    assert peaks[1] < 1.3 * peaks[0]
