"""What is allowed in a scenario and rarely meant is said; nothing else is."""

import copy
import re

import numpy as np
import pytest
import yaml

from scenario_publisher import advice, scenario

HORIZON_S = 2.5
BEND = 100.0  # m, radius; the road is straight for 40 m and bends then
ROAD = {
    'centre_line': {
        'start': {'x_m': 0.0, 'y_m': 0.0, 'yaw_rad': 0.0},
        'segments': [
            {'straight': {'length_m': 40.0}},
            {'arc': {'length_m': 140.0, 'curvature_1pm': 1.0 / BEND}},
        ],
    },
    'edges': {'left': {'offset_m': 4.0}, 'right': {'offset_m': -4.0}},
}


def load(obstacles=(), **changes):
    document = yaml.safe_load(scenario.load('straight').text)
    document |= {
        'road': ROAD,
        'path': copy.deepcopy(ROAD['centre_line']),
        'speed': {'constant_mps': 15.0},
        'start': {'progress_m': 0.0},
        'stop': {'progress_m': 120.0, 'time_s': 20.0},
        'obstacles': list(obstacles),
    }
    return scenario.parse(yaml.safe_dump(document | changes), 'bend.yaml')


def find_advice(scn, horizon_s):
    return advice.flatten(advice.judge(scn, horizon_s))


def checks(scn):
    return {one.check: one for one in advice.judge(scn, HORIZON_S)}


def mover(station=20.0, offset=0.0, **keys):
    return {'station_m': station, 'offset_m': offset, 'radius_m': 0.5, **keys}


def test_a_path_that_ends_within_the_horizon_behind_the_finish_is_named_with_what_it_lacks():
    scn = load(stop={'progress_m': 160.0, 'time_s': 20.0})
    (text,) = find_advice(scn, HORIZON_S)
    assert 'ends 20 m behind the finish line' in text
    assert 'go on for 18 m more' in text
    assert find_advice(scn, 1.0) == []


def test_an_obstacle_that_goes_straight_on_in_a_bend_is_named_with_the_time():
    scn = load([mover(offset=2.0), mover(along_mps=5.0, offset=-2.0)])
    (text,) = find_advice(scn, HORIZON_S)
    assert text.startswith('obstacle 2 goes straight on and leaves the road ')
    # off by its radius where the straight way is 2.5 m outside of its circle
    x = 40.0 + np.sqrt((BEND + 4.5) ** 2 - (BEND + 2.0) ** 2)
    (seconds,) = re.findall(r'road ([0-9.]+) s after the start', text)
    assert float(seconds) == pytest.approx((x - 20.0) / 5.0, abs=0.11)


@pytest.mark.parametrize(
    'obstacle',
    [
        mover(along_mps=5.0, motion='along_road'),
        mover(across_mps=2.0),  # a pedestrian who crosses
        mover(along_mps=5.0, disappears_at_s=2.0),
        {'waypoints': [
            {'station_m': 20.0, 'offset_m': 0.0, 'speed_mps': 5.0},
            {'station_m': 170.0, 'offset_m': 0.0, 'speed_mps': 5.0},
        ], 'radius_m': 0.5},
    ],
)  # fmt: skip
def test_obstacles_that_stay_or_cross_or_vanish_get_no_advice(obstacle):
    assert find_advice(load([obstacle]), HORIZON_S) == []


GRIP, TIME = (
    'the path asks for no more than the grip of the road',
    'there is time to reach the finish line',
)


def test_a_bend_that_is_too_fast_is_named_with_the_speed_that_would_do():
    assert checks(load()).keys() >= {GRIP, TIME}
    assert not checks(load())[GRIP].warnings
    fast = load(speed={'constant_mps': 40.0})
    (text,) = checks(fast)[GRIP].warnings
    assert f'{40.0**2 / BEND / 9.81:.0%} of the grip' in text
    assert f'at {np.sqrt(9.81 * BEND):.1f} m/s the grip would do' in text
    assert text in find_advice(fast, HORIZON_S)


def test_the_grip_of_a_patch_counts_where_the_path_lies_on_it():
    on_it = {'from_m': 60.0, 'to_m': 75.0, 'from_offset_m': -2.0, 'to_offset_m': 2.0}
    beside = on_it | {'from_offset_m': 1.0, 'to_offset_m': 2.0}
    asked = 15.0**2 / BEND / (0.2 * 9.81)
    (text,) = checks(load(friction_patches=[on_it | {'friction': 0.2}]))[GRIP].warnings
    assert f'{asked:.0%} of the grip' in text
    assert 'friction 0.2 holds 2.0' in text
    assert not checks(load(friction_patches=[beside | {'friction': 0.2}]))[GRIP].warnings


def test_a_path_that_lacks_grip_for_an_instant_is_no_warning_before_a_run():
    scn = scenario.load('double_lane_change')
    grip = checks(scn)[GRIP]
    assert '139%' in grip.warnings[0]
    assert 'at 1 other place' in grip.warnings[0]
    assert grip.slight


def test_a_run_that_ends_before_the_obstacle_is_named_with_the_time_that_would_do():
    parked = [mover(station=30.0, offset=3.0), mover(station=110.0, offset=3.0)]
    stop = {'progress_m': 120.0, 'time_s': 5.0}
    (text,) = checks(load(parked, stop=stop))[TIME].warnings
    assert text.startswith('the run ends after 5 s (stop.time_s)')
    assert 'at 75 m, 45 m before the finish line, and before obstacle 2: it needs 8 s' in text
    # the time counts from where the car starts
    assert not checks(load(parked, stop=stop, start={'progress_m': 46.0}))[TIME].warnings
