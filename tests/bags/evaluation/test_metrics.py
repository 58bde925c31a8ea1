"""Metrics of drives whose answers are known in closed form.

The road of `drive_of` is straight, its edges are 3 m to either side, and the car of 4.8 m by 1.8 m
drives along y = 0 at 20 m/s; its circle has a radius of 1.1 m, the finish line is at 90 m.
"""

import json

import numpy as np
import pytest
from straight_drive import MS, START_NS, drive_of, obstacle, straight_scene

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.drive import Ticks, obstacle_position, obstacle_tracks
from bags.evaluation.metrics import driving
from bags.evaluation.metrics.registry import EvaluatedDrive
from msgs_yaml import types

TRACK = 1.6
WHEELS = tuple((x, y) for x in (1.4, -1.4) for y in (TRACK / 2, -TRACK / 2))
# the public names of comparison.json, in its order
KEYS = """verdict completed finish_at_m collided collided_by left_road left_road_at_m
    beyond_edge_m lost lost_how lost_at_m entered_unsafe_area outline_entered_unsafe_area
    min_v2o_m min_v2o_per_obstacle_m min_v2e_m min_v2e_per_edge_m min_outline_gap_m
    min_outline_gap_per_obstacle_m min_outline_v2e_m min_outline_v2e_per_edge_m finished
    stopped following wheel_off_road_m survived lost_by lane_excess_m dodge_m in_the_way_s
    min_time_gap_s overshoots peak_overshoot_m peak_sideslip_deg peak_sideslip_at_m
    min_speed_mps brake_onset_at_m peak_brake_mps2 brake_onset_hard_at_m
    planned_brake_onset_at_m planned_brake_onset_hard_at_m braking_s counter_steer_s
    peak_counter_steer_deg peak_lat_acc_mps2 held_lat_acc_mps2 lateral_limit_use_plant
    rms_lat_jerk_mps3 peak_lat_acc_share peak_brake_share rms_contouring_m solve_ms
    solve_cpu_ms ticks deadline_misses fallbacks stopped_early"""


def judged(drive, *names):
    """Return some metrics of a drive."""
    result = metrics.compute_metrics(drive)
    return tuple(result[name] for name in names)


def near(value, tolerance=None):
    return pytest.approx(value, abs=tolerance)


def past(*places, **facts):
    """Return the scene of obstacles at (x, y) or (x, y, vx, vy), numbered 1, 2, ..."""
    crowd = [obstacle(number, *place) for number, place in enumerate(places, start=1)]
    return straight_scene(crowd)._replace(**facts)


def put(drive, part, **columns):
    """Return a drive with other columns in a part of it: numbers, arrays, or functions of x."""
    old = getattr(drive, part)
    x = (old.stamp_ns - START_NS) * 1e-9 * 20.0 if hasattr(old, 'stamp_ns') else None
    made = {name: value(x) if callable(value) else value for name, value in columns.items()}
    return drive._replace(**{part: old._replace(**made)})


def moving(drive, direction_deg, speed=20.0):
    """Return a drive whose velocity has an angle in the car's frame that depends on x."""
    angle = np.radians(direction_deg(drive.motion.x))
    return put(drive, 'motion', vx=speed * np.cos(angle), vy=speed * np.sin(angle))


def standing(drive, from_m):
    """Return a drive that ends at a place of x [m], where the car stands."""
    motion = drive.motion
    there = motion.x >= from_m
    slow = {name: np.where(there, 0.0, getattr(motion, name)) for name in ('vx', 'vy')}
    return put(drive, 'motion', x=np.minimum(motion.x, from_m), **slow)


def turning_round(drive, from_m, deg_per_m=3.0):
    return moving(drive, lambda x: deg_per_m * np.maximum(x - from_m, 0.0))


def planned(drive, converged=True):
    """Return the drive with a report per tick; `converged` is of the station of the tick [m]."""
    stamp_ns = drive.ticks.answered_ns
    at = (stamp_ns - START_NS) * 1e-9 * 20.0
    values = converged(at) if callable(converged) else np.full(len(at), converged)
    return put(drive, 'ticks', stamp_ns=stamp_ns, converged=values)


def dip(x):
    return -20.0 * np.tan(np.radians(6.0)) * np.exp(-(((x - 63.0) / 5.0) ** 2))


def brakes_at_30(x):
    return np.where(x < 30.0, 0.0, -2000.0)


def ramp_after_a_peak(x):  # beyond both thresholds for 1 m, 0.05 s, at 20 m
    return np.where(abs(x - 20.5) < 0.5, -3000.0, np.minimum(0.0, -100.0 * (x - 30.0)))


def absent_from_2_s(scene):
    """Let the obstacle of a scene disappear when the car is at 40 m."""
    (item,) = scene.obstacles
    gone = np.arange(101) * 0.05 >= 2.0
    return scene._replace(obstacles=(item._replace(x=np.where(gone, np.nan, item.x)),))


def sliding(deg, speed=20.0, **given):
    return moving(drive_of(**given), lambda x: np.full(len(x), deg), speed)


def measured(ay):
    return put(drive_of(), 'accelerations', ay=ay)


def short_peak(x, sign):  # 9 m/s^2 for less than a tenth of a second, 4 for more
    return sign * np.select([abs(x / 20 - 2) < 0.045, abs(x / 20 - 3) < 0.06], [9.0, 4.0], 1.0)


LEAVING = {'y': lambda x: x / 10.0}
SIDEWAYS = {'yaw': np.pi / 2}
BRAKING = {'force': brakes_at_30}
LEAST = {'least_speed': 7.0}
BULGE = np.array([[0.0, 3.0], [49.0, 3.0], [50.0, 1.5], [51.0, 3.0], [120.0, 3.0]])
LATE = {
    side: edge + np.array([[20.0, 0.0], [0.0, 0.0]])
    for side, edge in (('left', straight_scene().left), ('right', straight_scene().right))
}
PERIOD_M = 20 * np.pi  # of the steering, 0.1 rad sin(x / 10 m)
# |0.1 rad sin| > 1 deg is the narrower of both conditions
AGAINST = 1 - 2 * np.arcsin(driving.STEERED_RAD / 0.1) / np.pi
TICKS_NS = drive_of().ticks.answered_ns
COUNT = np.arange(1.0, 101.0)
TIMES = {'mean': 50.5, 'p50': 50.5, 'p99': 99.01, 'max': 100}
NONE = (
    *('min_v2o_m', 'min_outline_gap_m', 'brake_onset_at_m', 'survived', 'lost_by'),
    *('wheel_off_road_m', 'lateral_limit_use_plant', 'lost_at_m', 'left_road_at_m'),
)


@pytest.mark.parametrize(
    ('drive', 'expected'),
    [
        (
            drive_of(),
            {
                **dict.fromkeys(NONE),
                'min_v2o_per_obstacle_m': {},
                'min_v2e_per_edge_m': near({'left': 1.9, 'right': 1.9}),
                'overshoots': [],
                'min_speed_mps': 20.0,
                'rms_contouring_m': near(0.0, 1e-12),
                'peak_brake_mps2': near(5.0),
                'peak_lat_acc_mps2': near(8.0, 1e-3),
                'counter_steer_s': 0.0,
                'peak_counter_steer_deg': 0.0,
                'ticks': 100,
                'deadline_misses': 0,
            },
        ),
        (
            drive_of(scene=past((50.0, 3.0), (70.0, -4.0))),
            {
                'min_v2o_per_obstacle_m': near({'1': 0.9, '2': 1.9}),
                'min_v2o_m': near(0.9),
                'min_outline_gap_m': near(3.0 - 0.9 - 1.0),
                'min_outline_gap_per_obstacle_m': near({'1': 1.1, '2': 2.1}),
            },
        ),
        (
            drive_of(scene=past((50.0, 3.0)), **SIDEWAYS),
            {'min_v2o_m': near(0.9), 'min_outline_gap_m': near(3.0 - 2.4 - 1.0), 'collided': True},
        ),
        (
            drive_of(y=4.0),
            {'min_v2e_per_edge_m': near({'left': -2.1, 'right': 5.9}), 'collided': False},
        ),
    ],
    ids=['empty road', 'past two', 'sideways', 'beyond an edge'],
)
def test_distances_and_what_has_no_meaning(drive, expected):
    result = metrics.compute_metrics(drive)
    assert list(result) == [*metrics.METRICS]
    assert [name for name in result if name in KEYS.split()] == KEYS.split()
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    assert {name: result[name] for name in expected} == expected


@pytest.mark.parametrize(
    ('drive', 'metric', 'value'),
    [
        # two circles see the nose of a sideways car
        (
            drive_of(scene=past((50.0, 4.0)), circles=(1.1, -1.1), **SIDEWAYS),
            'min_v2o_m',
            near(4.0 - 1.1 - 1.0 - 1.1),
        ),
        # between two messages an obstacle keeps moving
        (
            drive_of(scene=past((3.0, 5.0, 20.0, 0.0))),
            'min_v2o_m',
            near(np.hypot(3.0, 5.0) - 2.1, 1e-6),
        ),
        # it counts while it is there
        (drive_of(scene=absent_from_2_s(past((50.0, 0.0)))), 'min_v2o_m', near(7.9, 0.03)),
        (drive_of(vy=dip), 'peak_sideslip_deg', near(6.0)),
        (drive_of(vy=dip), 'peak_sideslip_at_m', near(63.0, 0.02)),
        (standing(drive_of(), 42.0), 'min_speed_mps', 0.0),
        (drive_of(force=ramp_after_a_peak), 'brake_onset_at_m', near(20.0, 0.03)),
        (drive_of(force=lambda x: -100.0 * (x - 30.0)), 'brake_onset_at_m', near(35.0, 0.03)),
        (drive_of(force=lambda x: -100.0 * (x - 30.0)), 'brake_onset_hard_at_m', near(45.0, 0.03)),
        (drive_of(force=lambda x: -8.0 * x), 'brake_onset_hard_at_m', None),
        (
            drive_of(force=lambda x: np.where((x > 20.0) & (x < 60.0), -800.0, -100.0)),
            'braking_s',
            near(2.0, 0.02),
        ),
        (
            drive_of(yaw=lambda x: 0.2 * np.cos(x / 10.0), metres=PERIOD_M),
            'counter_steer_s',
            near(AGAINST * PERIOD_M / 20.0, 0.05),
        ),
        (
            drive_of(yaw=lambda x: 0.2 * np.cos(x / 10.0)),
            'peak_counter_steer_deg',
            near(np.degrees(0.1), 6e-3),
        ),
        (drive_of(yaw=lambda x: -0.2 * np.cos(x / 10.0)), 'counter_steer_s', 0.0),
        (drive_of(friction=0.8), 'peak_lat_acc_share', near(8.0 / (0.8 * 9.81), 1e-3)),
        (drive_of(friction=0.8), 'peak_brake_share', near(5.0 / (0.8 * 9.81))),
        # 8 sin(2 t): 0.05 s before and after its peak it is 8 cos(0.1)
        (drive_of(), 'held_lat_acc_mps2', near(8.0 * np.cos(0.1), 0.02)),
        (
            drive_of(lateral_limit=7.5),
            'lateral_limit_use_plant',
            near(8.0 * np.cos(0.1) / 7.5, 3e-3),
        ),
        (measured(lambda x: short_peak(x, 1.0)), 'held_lat_acc_mps2', near(4.0)),
        (measured(lambda x: short_peak(x, -1.0)), 'held_lat_acc_mps2', near(4.0)),
        (measured(lambda x: 3.0 * x / 20.0), 'rms_lat_jerk_mps3', near(3.0)),
        (
            drive_of(y=lambda x: 0.3 * np.sin(2.0 * np.pi * x / 10.0)),
            'rms_contouring_m',
            near(0.3 / np.sqrt(2.0), 3e-4),
        ),
        (
            put(drive_of(), 'ticks', answered_ns=np.delete(TICKS_NS, [3, 4, 50])),
            'deadline_misses',
            3,
        ),
        # on the wall clock the car is held until the first answer, to any state of a period
        (put(drive_of(), 'ticks', answered_ns=TICKS_NS[20:] + 7 * MS), 'ticks', 80),
        (put(drive_of(), 'ticks', answered_ns=TICKS_NS[20:] + 7 * MS), 'deadline_misses', 0),
        (put(drive_of(), 'ticks', answered_ns=TICKS_NS[:0]), 'deadline_misses', 100),
        (put(drive_of(), 'ticks', solve_ms=COUNT), 'solve_ms', near(TIMES)),
        (put(drive_of(), 'ticks', solve_ms=COUNT[:0]), 'solve_ms', dict.fromkeys(TIMES)),
        (drive_of(), 'solve_cpu_ms', near(dict.fromkeys(TIMES, 4.0))),
        (put(drive_of(), 'ticks', fallback=COUNT > 97.0), 'fallbacks', 3),
        (put(drive_of(), 'ticks', fallback=COUNT > 97.0), 'stopped_early', 0),  # unknown
        # of seven that did not converge, three were not followed
        (
            put(drive_of(), 'ticks', fallback=COUNT <= 3.0, converged=COUNT > 7.0),
            'stopped_early',
            4,
        ),
    ],
)
def test_a_metric_has_its_closed_form(drive, metric, value):
    assert judged(drive, metric) == (value,)


@pytest.mark.parametrize(
    ('drive', 'unsafe', 'outline_unsafe', 'by'),
    [
        # radii of 1.1 m and 1.0 m, half a width of 0.9 m, 0.5 m of safety distance
        (drive_of(scene=past((50.0, 2.61))), False, False, None),
        (drive_of(scene=past((50.0, 2.59))), True, False, None),
        (drive_of(scene=past((50.0, 2.41))), True, False, None),
        (drive_of(scene=past((50.0, 2.39))), True, True, None),
        (drive_of(scene=past((50.0, 2.09))), True, True, 'circle'),
        (drive_of(scene=past((50.0, 1.7))), True, True, 'outline'),
        # edges 3 m to either side, 2.4 m from the centre to the nose
        (drive_of(y=1.39), False, False, None),
        (drive_of(y=1.59), True, False, None),
        (drive_of(y=1.61), True, True, None),
        (drive_of(**SIDEWAYS), False, False, None),
        (drive_of(y=0.2, **SIDEWAYS), False, True, None),
    ],
)
def test_safety_distance_and_collision(drive, unsafe, outline_unsafe, by):
    areas = 'entered_unsafe_area', 'outline_entered_unsafe_area'
    assert judged(drive, *areas, 'collided_by') == (unsafe, outline_unsafe, by)


@pytest.mark.parametrize(
    ('drive', 'left_at', 'beyond'),
    [
        # the edge is 3 m away, half the width is 0.9 m
        (drive_of(**LEAVING), near(21.0, 0.3), near(10.0 + 0.9 - 3.0, 0.03)),
        (drive_of(y=2.09), None, None),
        (drive_of(y=-2.09), None, None),
        (drive_of(y=2.11), 0.0, near(0.01)),
        (drive_of(y=-4.0), 0.0, near(1.9)),
        (drive_of(y=1.0, **SIDEWAYS), 0.0, near(1.0 + 2.4 - 3.0)),  # with its nose
        # the inside of a bend, with the middle of a side
        (drive_of(scene=past(left=BULGE), y=0.8), near(47.3, 0.5), near(0.2 / 1.803, 0.02)),
        # before its beginning an edge goes on straight
        (drive_of(scene=past(**LATE), y=lambda x: 2.5 * (x < 5.0)), 0.0, near(2.5 + 0.9 - 3.0)),
    ],
)
def test_the_outline_leaves_the_road_before_its_centre_does(drive, left_at, beyond):
    assert judged(drive, 'left_road_at_m', 'beyond_edge_m') == (left_at, beyond)


@pytest.mark.parametrize('side', [-1, 1])
@pytest.mark.parametrize(('peak', 'how'), [(29.9, None), (30.1, 'sideslip'), (89.0, 'sideslip')])
def test_a_slide_is_a_loss_of_control_above_30_deg(peak, how, side):
    angle = side * peak
    drive = moving(drive_of(), lambda x: angle * np.sin(np.pi * x / 100.0))
    lost_how, verdict = judged(drive, 'lost_how', 'verdict')
    assert lost_how == how
    assert ((f'(sideslip angle up to {peak:.0f} deg)') in verdict) == (how is not None)


def test_a_car_that_turns_round_has_spun_and_one_that_crawls_has_no_sideslip():
    # 30 deg at 60 m, backwards from 80 m
    names = 'lost_how', 'lost_at_m', 'peak_sideslip_deg'
    spun = judged(turning_round(drive_of(), 50.0), *names)
    assert spun == ('spun', near(60.0, 0.05), near(150.0))
    assert judged(sliding(170.0, 2.9), *names) == (None, None, None)


SLOW = put(standing(drive_of(**LEAST), 42.0), 'ticks', last_reason='too_slow')
OFF = standing(turning_round(drive_of(y=lambda x: x / 20.0, **LEAST), 40.0), 80.0)


@pytest.mark.parametrize(
    ('drive', 'completed', 'verdict'),
    [
        (drive_of(), True, 'reached the finish line at 90 m; no collision'),
        (drive_of(metres=90.0), True, 'reached the finish line at 90 m; no collision'),
        (
            drive_of(metres=89.0),
            False,
            'did not reach the finish line: ended at 89 m with 20.0 m/s',
        ),
        (turning_round(drive_of(), 50.0), True, 'reached the finish line at 90 m; spun at 60 m; '),
        (
            drive_of(**LEAVING),
            False,
            'left the road at 21 m, by up to 7.90 m; passed the finish line beside the road at 90 ',
        ),
        (
            SLOW,
            False,
            'stood still at 42 m (reason of the controller: too_slow: below 7 m/s it only brakes);',
        ),
        # what led to the end comes before it, and without the reason that it makes pointless
        (
            put(OFF, 'ticks', last_reason='too_slow'),
            False,
            'left the road at 42 m, by up to 2.90 m; spun at 50 m; stood still at 80 m; no collis',
        ),
        (drive_of(stop=(-5.0, 0.0), armed_after=0.0), False, 'started beyond the finish line'),
        (
            drive_of()._replace(ticks=Ticks(TICKS_NS[:0], *[np.empty(0)] * 3)),
            True,
            'reached the finish line at 90 m; no collision; no command answered a state',
        ),
        (
            drive_of(scene=past((50.0, 2.0))),
            True,
            'reached the finish line at 90 m; collided with obstacle 1 '
            '(circle, overlap 0.10 m; outline passed by 0.10 m)',
        ),
        (
            drive_of(scene=past((50.0, 1.7))),
            True,
            'reached the finish line at 90 m; collided with obstacle 1 (outline, overlap 0.20 m)',
        ),
    ],
)
def test_the_verdict_says_what_happened_causes_first(drive, completed, verdict):
    is_completed, text = judged(drive, 'completed', 'verdict')
    assert is_completed is completed
    assert text.startswith(verdict)


@pytest.mark.parametrize(
    ('drive', 'onset', 'hard'),
    [
        # samples of 10 ms; the peak at 20 m lasts less than 0.1 s
        (planned(drive_of(force=ramp_after_a_peak)), near(35.2, 0.21), near(45.2, 0.21)),
        (drive_of(**BRAKING), None, None),  # no report at all
        (planned(drive_of(**BRAKING), False), None, None),
        # the first one that is planned
        (planned(drive_of(**BRAKING), lambda at: at > 39.9), near(40.0, 0.21), near(40.0, 0.21)),
        # beyond the last obstacle, and before it
        (planned(drive_of(scene=past((20.0, 5.0), (29.0, -5.0)), **BRAKING)), None, None),
        (
            planned(drive_of(scene=past((33.0, 5.0), (20.0, -5.0)), **BRAKING)),
            near(30.0, 0.21),
            near(30.0, 0.21),
        ),
    ],
)
def test_planned_braking_begins_where_the_force_first_stays_at_the_threshold(drive, onset, hard):
    names = 'planned_brake_onset_at_m', 'planned_brake_onset_hard_at_m'
    assert judged(drive, *names) == (onset, hard)


@pytest.mark.parametrize(
    ('drive', 'lost_by', 'off'),
    [
        (drive_of(), None, 0.0),
        (standing(drive_of(), 40.0), None, 0.0),
        (drive_of(metres=50.0), 'neither finished nor stopped', 0.0),
        # touching is that of the outline
        (drive_of(scene=past((40.0, 1.95))), None, 0.0),
        (drive_of(scene=past((40.0, 1.85))), 'touched obstacle 1', 0.0),
        # a wheel may leave the road by half a metre
        *((drive_of(y=side * (2.2 + 0.45)), None, near(0.45)) for side in (1.0, -1.0)),
        *((drive_of(y=side * (2.2 + 0.55)), 'left the road', near(0.55)) for side in (1.0, -1.0)),
        # a slide is 30 deg of sideslip above 5 m/s
        (sliding(29.0), None, 0.0),
        (sliding(31.0), 'slid', 0.0),
        (sliding(-31.0), 'slid', 0.0),
        (sliding(80.0, 4.9), None, 0.0),
        # what happened first
        (drive_of(scene=past((60.0, 0.0), (30.0, 0.0))), 'touched obstacle 2', 0.0),
        (sliding(45.0, scene=past((60.0, 0.0))), 'slid', 0.0),
    ],
)
def test_the_judge_of_emergencies_names_the_first_cause(drive, lost_by, off):
    names = 'lost_by', 'survived', 'wheel_off_road_m', 'stopped', 'finished'
    stopped = np.hypot(drive.motion.vx[-1], drive.motion.vy[-1]) < 0.5
    expected = (lost_by, lost_by is None, off, stopped, drive.motion.x[-1] >= 90.0)
    assert judged(put(drive, 'facts', wheels=WHEELS), *names) == expected


@pytest.mark.parametrize('y', [0.0, 1.3, -2.5])
@pytest.mark.parametrize('yaw', [0.0, 0.3, -1.2])
def test_the_distance_of_the_outline_to_an_edge_is_that_of_its_farthest_corner(y, yaw):
    aside = 2.4 * abs(np.sin(yaw)) + 0.9 * np.cos(yaw)
    margins = {'left': 3.0 - y - aside, 'right': 3.0 + y - aside}
    names = 'min_outline_v2e_per_edge_m', 'min_outline_v2e_m'
    assert judged(drive_of(y=y, yaw=yaw), *names) == (near(margins), near(min(margins.values())))


@pytest.mark.parametrize(
    ('ahead', 'aside', 'speed', 'follows'),
    [
        (10.0, 0.0, 20.0, True),
        (10.0, 0.0, 25.0, True),
        (10.0, 0.0, 19.1, True),
        (10.0, 0.0, 18.9, False),  # the gap closes too fast
        (10.0, 0.0, -20.0, False),
        (42.5, 0.0, 20.0, True),
        (43.5, 0.0, 20.0, False),  # more than 3 m and 2 s at 20 m/s away
        (-20.0, 0.0, 20.0, False),
        (10.0, -1.8, 20.0, True),
        (10.0, 2.0, 20.0, False),  # half of the car and a radius of 1 m are 1.9 m
    ],
)
def test_a_car_that_follows_another_at_the_end_survives(ahead, aside, speed, follows):
    """The car drives 50 m at 20 m/s; the other one is `ahead` of its nose at the end."""
    other = obstacle(1, 50.0 + 2.4 + 1.0 + ahead - 2.5 * speed, aside, speed)
    # it comes at the end: nothing touches before
    is_there = np.arange(101) * 0.05 >= 2.4
    scene = straight_scene([other._replace(x=np.where(is_there, other.x, np.nan))])
    drive = drive_of(metres=50.0, scene=scene, wheels=WHEELS)
    assert judged(drive, 'following', 'survived') == (follows, follows)


def test_jerk_is_that_of_what_was_measured():
    slope = measured(lambda x: 3.0 * x / 20.0)
    acc = slope.accelerations
    torn = np.where(np.arange(len(acc.ay)) % 500 < 50, np.nan, acc.ay)
    for part, jerk in (
        (acc._replace(ay=torn), near(3.0)),
        (type(acc)(*(column[:50] for column in acc)), None),
        (acc._replace(ay=np.full(len(acc.ay), np.nan)), None),
    ):
        run = EvaluatedDrive(slope._replace(accelerations=part))
        assert driving.rms_lat_jerk_mps3(run) == jerk


@pytest.mark.parametrize(
    ('turns', 'stop', 'share', 'driven', 'done'),
    [
        pytest.param(1.0, 0.0, 60.0, (0.0, 2.0), True, id='a whole lap'),
        pytest.param(1.0, 0.0, 60.0, (0.0, 1.8), False, id='most of a lap'),
        pytest.param(1.0, 0.0, 60.0, (0.0, 0.04), False, id='the start of a lap'),
        # the stop lies at a half, the drive begins behind it in the second lap
        pytest.param(1.25, 40.0, 5.0, (1.1, 2.5), False, id='not passed again'),
    ],
)
def test_a_lap_is_complete_only_where_the_stop_is_passed_at_its_end(
    turns, stop, share, driven, done
):
    def around(phi):
        return 20.0 * np.sin(phi), 20.0 - 20.0 * np.cos(phi)

    path = np.column_stack(around(np.linspace(0.0, 2.0 * np.pi * turns, 901)))
    drive = drive_of(scene=past(reference=path), stop=(0.0, stop), armed_after=share)
    x, y = around(np.pi * np.linspace(*driven, len(drive.motion.x)))
    completed, finish_m = judged(put(drive, 'motion', x=x, y=y), 'completed', 'finish_at_m')
    assert completed is done
    if stop:
        assert finish_m == near(20.0 * np.pi, 0.2)


def lane_change(x, at, length, width):
    """Return the quintic step: no heading and no curvature at either end."""
    u = np.clip((x - at) / length, 0.0, 1.0)
    return width * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def two_changes(x):
    return lane_change(x, 20.0, 20.0, 3.5) - lane_change(x, 60.0, 20.0, 3.5)


@pytest.mark.parametrize(
    ('at', 'amount', 'counted'),
    [
        pytest.param(45.0, 0.6, True, id='beyond the line after changing to the left'),
        pytest.param(85.0, -0.4, True, id='beyond the line after changing to the right'),
        pytest.param(65.0, 0.5, True, id='late into the change to the right'),
        pytest.param(65.0, -0.5, False, id='cutting into it'),
        pytest.param(8.0, 0.5, False, id='before any bend'),
        pytest.param(85.0, -0.05, False, id='too small to notice'),
    ],
)
def test_overshoot_is_running_wide_of_a_bend(at, amount, counted):
    def bumpy(x):
        bump = amount * np.cos(np.clip((x - at) / 10.0, -1.0, 1.0) * np.pi / 2.0) ** 2
        return two_changes(x) + bump

    x = np.arange(0.0, 121.0, 0.5)
    scene = past(reference=np.column_stack([x, two_changes(x)]))
    result = metrics.compute_metrics(drive_of(scene=scene, y=bumpy))
    wide = [(item['x_m'], item['amount_m']) for item in result['overshoots']]
    expected = [(near(at, 2.0), pytest.approx(abs(amount), rel=0.1))] if counted else []
    assert wide == expected
    assert result['peak_overshoot_m'] == max((item[1] for item in wide), default=0.0)


@pytest.mark.parametrize('part', ['motion', 'accelerations', 'inputs'])
def test_a_drive_longer_than_a_day_is_refused_before_it_fills_the_memory(part):
    stamp_ns = getattr(drive_of(), part).stamp_ns.copy()
    stamp_ns[-1] = 1_700_000_000 * 10**9
    with pytest.raises(BagError, match=r'span 1699999999 s; allowed up to 86400 s'):
        metrics.compute_metrics(put(drive_of(), part, stamp_ns=stamp_ns))


def test_an_object_of_several_discs_is_one_obstacle_as_near_as_the_nearest_of_them():
    def past_discs(*discs):
        return EvaluatedDrive(drive_of(scene=straight_scene(discs)))

    far, close = obstacle(1, 40.0, 4.0), obstacle(1, 44.0, 2.5)._replace(disc=1)
    both = past_discs(far, close)
    assert both.value(metrics.outcome.min_v2o_per_obstacle_m) == {'1': near(2.5 - 1.0 - 1.1, 1e-6)}
    assert list(both.series.outline_gaps) == [1]
    alone = [past_discs(disc).series.outline_gaps[1] for disc in (far, close._replace(disc=0))]
    assert np.array_equal(both.series.outline_gaps[1], np.minimum(*alone))


def test_between_two_messages_a_lorry_turns():
    t = np.arange(5) * 0.05
    stamp_ns = START_NS + (t * 1e9).astype(np.int64)
    turned = 0.5 * t
    others = (((-6.0 * np.cos(a), -6.0 * np.sin(a)), (2.0, 0.0)) for a in turned)
    messages = [
        types.Obstacles(ns, (types.Obstacle(3, 10.0 * s, 1.0, 1.2, 10.0, 0.0, places),))
        for ns, s, places in zip(stamp_ns.tolist(), t, others)
    ]
    messages[4] = messages[4]._replace(items=())
    tracks = obstacle_tracks(stamp_ns, messages)
    assert [(o.id, o.disc, o.radius) for o in tracks] == [(3, k, 1.2) for k in range(3)]
    scene = straight_scene(tracks)._replace(obstacle_stamp_ns=stamp_ns)
    asked = np.linspace(0.0, 0.149, 30)
    x, y = obstacle_position(tracks[1], scene, START_NS + np.round(asked * 1e9).astype(np.int64))
    assert x == near(10.0 * asked - 6.0 * np.cos(0.5 * asked), 2e-3)
    assert y == near(1.0 - 6.0 * np.sin(0.5 * asked), 2e-3)
    assert np.isnan(tracks[1].x[4])
    assert np.isfinite(tracks[1].vx[:4]).all()
    assert tracks[2].vx[:4] == near(10.0)
