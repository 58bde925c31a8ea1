"""Dry road onto ice: there is always a plan, and the car does not slide."""

from concurrent.futures import ThreadPoolExecutor
from random import Random

import ice
import pytest


@pytest.mark.parametrize('drive_n', [3000.0, 6000.0])
def test_the_road_controller_accelerates_onto_ice_without_a_slide(drive_n):
    result = ice.drive(ice.ICE, 'mpcc_road', {'limits.drive_n': drive_n})
    assert not result.failures
    assert result.largest_sideslip_deg <= 5.0
    assert result.end_mps > 20.0


@pytest.mark.parametrize('drive_n', [3000.0, 6000.0])
def test_a_driving_force_beyond_the_ice_leaves_the_problem_solvable(drive_n):
    """All of the friction may drive: the force is beyond what is believed once that falls."""
    settings = {'limits.drive_n': drive_n, 'limits.drive_friction_use': 0.95}
    assert not ice.is_failed(ice.drive(ice.ICE, 'mpcc_road', settings))


@pytest.mark.parametrize('number', range(3))
def test_on_drawn_roads_no_solver_fails(number):
    road = ice.draw(Random(f'test {number}'))
    assert not ice.is_failed(ice.drive(road, 'mpcc_road', {}))
    assert not ice.is_failed(ice.drive(road, 'mpcc_road', {'limits.drive_friction_use': 0.95}))


@pytest.mark.parametrize(
    ('result', 'code'),
    [
        (ice.Result({}, 5.0, 20.0), 0),
        (ice.Result({'shifted: plan_not_feasible': 1}, 1.0, 20.0), 0),
        (ice.Result({}, 5.1, 20.0), 1),
        (ice.Result({}, float('nan'), 20.0), 1),
        (ice.Result({'shifted: solver_failed': 1}, 1.0, 20.0), 1),
    ],
)
def test_the_exit_code_tells_of_slides_and_failures(monkeypatch, capsys, result, code):
    monkeypatch.setattr(ice, 'drive', lambda *_, **__: result)
    monkeypatch.setattr(ice, 'ProcessPoolExecutor', ThreadPoolExecutor)
    assert ice.main(['--drives', '3', '--friction', '0.3', '0.3', '--jobs', '1']) == code
    assert ('0.30, ' in capsys.readouterr().out) == bool(code or result.failures)
