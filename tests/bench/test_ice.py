"""Dry road onto ice: there is always a plan, and the car does not slide."""

from random import Random

import ice
import pytest


def failed(result):
    return {name: count for name, count in result.failures.items() if ice.FAILED in name}


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
    assert not failed(ice.drive(ice.ICE, 'mpcc_road', settings))


@pytest.mark.parametrize('number', range(3))
def test_on_drawn_roads_no_solver_fails(number):
    road = ice.draw(Random(f'test {number}'))
    assert not failed(ice.drive(road, 'mpcc_road', {}))
    assert not failed(ice.drive(road, 'mpcc_road', {'limits.drive_friction_use': 0.95}))
