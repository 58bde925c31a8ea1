"""Metrics of drives whose answers are known in closed form.

The road of `drive_of` is straight, its edges are 3 m to either side, and the car of 4.8 m by 1.8 m
drives along y = 0 at 20 m/s; its circle has a radius of 1.1 m, the finish line is at 90 m.
"""

import json

import numpy as np
import pytest
from straight_drive import MS, START_NS, drive_of, straight_scene

from bags.errors import BagError
from bags.evaluation import drive as drives
from bags.evaluation import metrics
from bags.evaluation.drive import Obstacle, Ticks
from bags.evaluation.metrics import driving
from bags.evaluation.metrics.registry import EvaluatedDrive

TRACK = 1.6
WHEELS = tuple((x, y) for x in (1.4, -1.4) for y in (TRACK / 2, -TRACK / 2))
KEYS = """verdict completed finish_at_m collided collided_by left_road left_road_at_m beyond_edge_m
    lost lost_how lost_at_m entered_unsafe_area outline_entered_unsafe_area min_v2o_m
    min_v2o_per_obstacle_m min_v2e_m
    min_v2e_per_edge_m min_outline_gap_m min_outline_gap_per_obstacle_m min_outline_v2e_m
    min_outline_v2e_per_edge_m finished stopped following wheel_off_road_m survived lost_by
    overshoots peak_overshoot_m peak_brake_mps2 peak_sideslip_deg
    peak_sideslip_at_m min_speed_mps brake_onset_at_m brake_onset_hard_at_m
    planned_brake_onset_at_m planned_brake_onset_hard_at_m braking_s
    counter_steer_s peak_counter_steer_deg peak_lat_acc_mps2 held_lat_acc_mps2
    lateral_limit_use_plant rms_lat_jerk_mps3 peak_lat_acc_share
    peak_brake_share rms_contouring_m solve_ms solve_cpu_ms ticks deadline_misses fallbacks
    stopped_early"""


def near(value, tolerance=None):
    return pytest.approx(value, abs=tolerance)


def case(name, drive, **expected):
    """Return a drive and metrics of it; of the verdict, a part."""
    return pytest.param(drive, expected, id=name)


def past(*places, radius=1.0, **facts):
    """Return the scene of obstacles at (x, y) or (x, y, vx, vy), numbered 1, 2, ..."""
    t = np.arange(101) * 0.05
    crowd = []
    for number, (x, y, *velocity) in enumerate(places, start=1):
        vx, vy = velocity or (0.0, 0.0)
        still = np.ones(len(t))
        item = Obstacle(number, x + vx * t, y + vy * t, vx * still, vy * still, radius)
        crowd.append(item)
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


def judged(drive):
    """Return a drive whose wheels are known, which the judge of emergencies needs."""
    return put(drive, 'facts', wheels=WHEELS)


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


LEAVING = {'y': lambda x: x / 10.0}  # the edge is 3 m away, half the width is 0.9 m
BULGE = np.array([[0.0, 3.0], [49.0, 3.0], [50.0, 1.5], [51.0, 3.0], [120.0, 3.0]])
LATE_EDGES = np.array([[20.0, 0.0], [0.0, 0.0]])
PERIOD_M = 20 * np.pi  # of the steering, 0.1 rad sin(x / 10 m)
# |0.1 rad sin| > 1 deg is the narrower of both conditions
AGAINST = 1 - 2 * np.arcsin(driving.STEERED_RAD / 0.1) / np.pi
NEVER = np.empty(0, dtype=np.int64)
NOT_LOST = {'lost': False, 'lost_how': None, 'lost_at_m': None}
ON_ROAD = {'left_road': False, 'left_road_at_m': None, 'beyond_edge_m': None}
SLOW = {'last_reason': 'too_slow'}
LEAST = {'least_speed': 7.0}
NOTHING = dict.fromkeys(('min_v2o_m', 'min_outline_gap_m', 'brake_onset_at_m', 'survived'))
NOTHING |= dict.fromkeys(('lost_by', 'wheel_off_road_m', 'lateral_limit_use_plant'))
SIDEWAYS = {'yaw': np.pi / 2}
ABOVE_97 = np.arange(1.0, 101.0)
TIMES = {'mean': 50.5, 'p50': 50.5, 'p99': 99.01, 'max': 100}
FINISHED = 'reached the finish line at 90 m; '
LEFT = 'left the road at 21 m, by up to 7.90 m; '
TOO_SLOW = 'too_slow: below 7 m/s it only brakes); '
SPIN = {'lost': True, 'lost_how': 'spun', 'lost_at_m': near(60.0, 0.05)}

CASES = [
    case(
        'empty road',
        drive_of(),
        **NOTHING,
        **NOT_LOST,
        **ON_ROAD,
        verdict=FINISHED + 'no collision',
        completed=True,
        collided=False,
        entered_unsafe_area=False,
        min_v2o_per_obstacle_m={},
        overshoots=[],
        min_speed_mps=20.0,
        rms_contouring_m=near(0.0, 1e-12),
        min_v2e_per_edge_m=near({'left': 1.9, 'right': 1.9}),
        peak_brake_mps2=near(5.0),
        peak_lat_acc_mps2=near(8.0, 0.001),
        ticks=100,
        deadline_misses=0,
    ),
    # distances
    case(
        'past two',
        drive_of(scene=past((50.0, 3.0), (70.0, -4.0))),
        min_v2o_per_obstacle_m=near({'1': 0.9, '2': 1.9}),
        min_v2o_m=near(0.9),
        min_outline_gap_m=near(3.0 - 0.9 - 1.0),
        min_outline_gap_per_obstacle_m=near({'1': 1.1, '2': 2.1}),
        collided=False,
    ),
    case(
        'outside the unsafe area',
        drive_of(scene=past((50.0, 2.61))),
        entered_unsafe_area=False,
        collided=False,
        outline_entered_unsafe_area=False,
    ),
    case(
        'inside it',
        drive_of(scene=past((50.0, 2.59))),
        entered_unsafe_area=True,
        collided=False,
        outline_entered_unsafe_area=False,
    ),
    # half of 1.8 m, 1.0 m of the obstacle, 0.5 m of safety distance
    case('outline outside', drive_of(scene=past((50.0, 2.41))), outline_entered_unsafe_area=False),
    case('outline inside', drive_of(scene=past((50.0, 2.39))), outline_entered_unsafe_area=True),
    case('beside the edge', drive_of(y=1.59), outline_entered_unsafe_area=False),
    case('too near to the edge', drive_of(y=1.61), outline_entered_unsafe_area=True),
    case('sideways in the middle', drive_of(**SIDEWAYS), outline_entered_unsafe_area=False),
    case('the nose too near', drive_of(y=0.2, **SIDEWAYS), outline_entered_unsafe_area=True),
    case(
        'sideways past an obstacle',
        drive_of(scene=past((50.0, 3.0)), **SIDEWAYS),
        min_v2o_m=near(0.9),
        min_outline_gap_m=near(3.0 - 2.4 - 1.0),
        collided=True,
    ),
    case(
        'two circles see the nose',
        drive_of(scene=past((50.0, 4.0)), circles=(1.1, -1.1), **SIDEWAYS),
        min_v2o_m=near(4.0 - 1.1 - 1.0 - 1.1),
    ),
    case(
        'an obstacle moves between two messages',
        drive_of(scene=past((3.0, 5.0, 20.0, 0.0))),
        min_v2o_m=near(np.hypot(3.0, 5.0) - 2.1, 1e-06),
    ),
    case(
        'an obstacle counts while it is there',
        drive_of(scene=absent_from_2_s(past((50.0, 0.0)))),
        min_v2o_m=near(10.0 - 2.1, 0.03),
    ),
    case(
        'beyond an edge',
        drive_of(y=4.0),
        min_v2e_per_edge_m=near({'left': -2.1, 'right': 5.9}),
        entered_unsafe_area=True,
        collided=False,
    ),
    case('no touch', drive_of(scene=past((50.0, 2.2))), collided=False, collided_by=None),
    case(
        'circles touch',
        drive_of(scene=past((50.0, 2.0))),
        collided=True,
        collided_by='circle',
        verdict='obstacle 1 (circle, overlap 0.10 m; outline passed by 0.10 m)',
    ),
    case(
        'outlines touch',
        drive_of(scene=past((50.0, 1.7))),
        collided_by='outline',
        verdict='obstacle 1 (outline, overlap 0.20 m)',
    ),
    case(
        'out over the edge',
        drive_of(**LEAVING),
        left_road=True,
        left_road_at_m=near(21.0, 0.3),
        beyond_edge_m=near(10.0 + 0.9 - 3.0, 0.03),
        completed=False,
        verdict=LEFT + 'passed the finish line beside the road at 90 m; no collision',
    ),
    # the edge is 3 m away, half the width is 0.9 m
    case('within the left edge', drive_of(y=2.09), **ON_ROAD),
    case('within the right edge', drive_of(y=-2.09), **ON_ROAD),
    case('beyond the left edge', drive_of(y=2.11), left_road=True, beyond_edge_m=near(0.01)),
    case('beyond the right edge', drive_of(y=-4.0), left_road=True, beyond_edge_m=near(1.9)),
    case('out with its nose', drive_of(y=1.0, **SIDEWAYS), beyond_edge_m=near(1.0 + 2.4 - 3.0)),
    case(
        'an edge that bulges between the wheels',
        drive_of(scene=past(left=BULGE), y=0.8),
        beyond_edge_m=near(0.2 / np.hypot(1.0, 1.5), 0.02),
    ),
    case(
        'before its beginning an edge goes on straight',
        drive_of(
            scene=past(
                left=straight_scene().left + LATE_EDGES, right=straight_scene().right + LATE_EDGES
            ),
            y=lambda x: 2.5 * (x < 5.0),
        ),
        left_road_at_m=0.0,
        beyond_edge_m=near(2.5 + 0.9 - 3.0),
    ),
    # out of control: 3 deg of sideslip per metre from 50 m on
    case(
        'spin',
        turning_round(drive_of(), 50.0),
        **SPIN,
        peak_sideslip_deg=near(150.0),
        verdict=FINISHED + 'spun at 60 m; ',
    ),
    *(
        case(
            f'slide of {peak * side} deg',
            moving(drive_of(), lambda x, a=peak * side: a * np.sin(np.pi * x / 100.0)),
            lost=peak > 30.0,
            lost_how='sideslip' if peak > 30.0 else None,
            verdict=f'(sideslip angle up to {peak:.0f} deg)' if peak > 30.0 else FINISHED,
        )
        for peak in (29.9, 30.1, 89.0)
        for side in (-1, 1)
    ),
    case(
        'a car that crawls has no sideslip',
        moving(drive_of(), lambda x: np.full(len(x), 170.0), speed=2.9),
        peak_sideslip_deg=None,
        peak_sideslip_at_m=None,
        lost=False,
    ),
    case(
        'sideslip',
        drive_of(vy=dip),
        peak_sideslip_deg=near(6.0),
        peak_sideslip_at_m=near(63.0, 0.02),
    ),
    # how it ended
    case(
        'stood still',
        standing(drive_of(**LEAST), 42.0),
        verdict='stood still at 42 m; ',
        min_speed_mps=0.0,
    ),
    case(
        'too slow',
        put(standing(drive_of(**LEAST), 42.0), 'ticks', **SLOW),
        verdict='stood still at 42 m (reason of the controller: ' + TOO_SLOW,
    ),
    case(
        'causes before their effects',
        put(
            standing(turning_round(drive_of(y=lambda x: x / 20.0, **LEAST), 40.0), 80.0),
            'ticks',
            **SLOW,
        ),
        verdict='left the road at 42 m, by up to 2.90 m; spun at 50 m; stood still at 80 m; no ',
        completed=False,
    ),
    case(
        'cut',
        drive_of(metres=50.0),
        verdict='did not reach the finish line: ended at 50 m with 20.0 m/s; no collision',
        completed=False,
    ),
    case('just before the end', drive_of(metres=89.0), completed=False),
    case('just at the end', drive_of(metres=90.0), completed=True),
    case(
        'started beyond the line',
        drive_of(stop=(-5.0, 0.0), armed_after=0.0),
        completed=False,
        verdict='started beyond the finish line',
    ),
    case(
        'without commands',
        drive_of()._replace(ticks=Ticks(NEVER, *[np.empty(0)] * 3)),
        verdict='; no command answered a state',
        solve_ms=dict.fromkeys(TIMES),
        deadline_misses=100,
    ),
    # braking; planned onsets are found in samples of 10 ms
    case(
        'a ramp of force',
        drive_of(force=lambda x: np.minimum(0.0, -100.0 * (x - 30.0))),
        brake_onset_at_m=near(35.0, 0.03),
        brake_onset_hard_at_m=near(45.0, 0.03),
    ),
    case(
        'a peak is no planned onset',
        planned(drive_of(force=ramp_after_a_peak)),
        planned_brake_onset_at_m=near(35.2, 0.21),
        planned_brake_onset_hard_at_m=near(45.2, 0.21),
        brake_onset_at_m=near(20.0, 0.03),
    ),
    case('no report', drive_of(force=brakes_at_30), planned_brake_onset_at_m=None),
    case(
        'no plan converged',
        planned(drive_of(force=brakes_at_30), False),
        planned_brake_onset_at_m=None,
        planned_brake_onset_hard_at_m=None,
    ),
    case(
        'plans from 40 m on',
        planned(drive_of(force=brakes_at_30), lambda at: at > 39.9),
        planned_brake_onset_at_m=near(40.0, 0.21),
        planned_brake_onset_hard_at_m=near(40.0, 0.21),
    ),
    case(
        'beyond the last obstacle',
        planned(drive_of(force=brakes_at_30, scene=past((20.0, 5.0), (29.0, -5.0)))),
        planned_brake_onset_at_m=None,
    ),
    case(
        'before the last obstacle',
        planned(drive_of(force=brakes_at_30, scene=past((33.0, 5.0), (20.0, -5.0)))),
        planned_brake_onset_at_m=near(30.0, 0.21),
    ),
    case(
        'braking time',
        drive_of(force=lambda x: np.where((x > 20.0) & (x < 60.0), -800.0, -100.0)),
        braking_s=near(2.0, 0.02),
        brake_onset_hard_at_m=None,
    ),
    # steering and grip
    case(
        'against the turn',
        drive_of(yaw=lambda x: 0.2 * np.cos(x / 10.0), metres=PERIOD_M),
        counter_steer_s=near(AGAINST * PERIOD_M / 20.0, 0.05),
        peak_counter_steer_deg=near(np.degrees(0.1), 0.006),
    ),
    case('straight ahead', drive_of(), counter_steer_s=0.0, peak_counter_steer_deg=0.0),
    case(
        'into the turn',
        drive_of(yaw=lambda x: -0.2 * np.cos(x / 10.0)),
        counter_steer_s=0.0,
        peak_counter_steer_deg=0.0,
    ),
    case(
        'shares of the friction',
        drive_of(friction=0.8),
        peak_lat_acc_share=near(8.0 / (0.8 * 9.81), 0.001),
        peak_brake_share=near(5.0 / (0.8 * 9.81)),
    ),
    # 8 sin(2 t): 0.05 s before and after its peak it is 8 cos(0.1)
    case(
        'held for a tenth of a second',
        drive_of(lateral_limit=7.5),
        held_lat_acc_mps2=near(8.0 * np.cos(0.1), 0.02),
        lateral_limit_use_plant=near(8.0 * np.cos(0.1) / 7.5, 0.003),
    ),
    *(
        case(
            f'a peak of less is not held, {sign}',
            put(
                drive_of(),
                'accelerations',
                ay=lambda x, s=sign: (
                    s * np.select([abs(x / 20 - 2) < 0.045, abs(x / 20 - 3) < 0.06], [9.0, 4.0], 1)
                ),
            ),
            held_lat_acc_mps2=near(4.0),
        )
        for sign in (1.0, -1.0)
    ),
    case(
        'a slope of 3 m/s^3',
        put(drive_of(), 'accelerations', ay=lambda x: 3.0 * x / 20.0),
        rms_lat_jerk_mps3=near(3.0),
    ),
    case(
        'contouring',
        drive_of(y=lambda x: 0.3 * np.sin(2.0 * np.pi * x / 10.0)),
        rms_contouring_m=near(0.3 / np.sqrt(2.0), 0.0003),
    ),
    # answers; on the wall clock the car is held until the first one
    case(
        'three ticks without a command',
        put(drive_of(), 'ticks', answered_ns=np.delete(drive_of().ticks.answered_ns, [3, 4, 50])),
        deadline_misses=3,
    ),
    case(
        'the time before the first command',
        put(drive_of(), 'ticks', answered_ns=drive_of().ticks.answered_ns[20:] + 7 * MS),
        ticks=80,
        deadline_misses=0,
    ),
    case(
        'solve times and fallbacks',
        put(drive_of(), 'ticks', solve_ms=ABOVE_97, fallback=(ABOVE_97 > 97.0).astype(float)),
        solve_ms=near(TIMES),
        solve_cpu_ms=near(dict.fromkeys(TIMES, 4.0)),
        fallbacks=3,
        stopped_early=0,
    ),
    # of seven that did not converge, three were not followed
    case(
        'stopped early',
        put(drive_of(), 'ticks', fallback=ABOVE_97 <= 3.0, converged=ABOVE_97 > 7.0),
        stopped_early=4,
    ),
    # the judge of emergencies
    case(
        'survives',
        judged(drive_of()),
        survived=True,
        lost_by=None,
        finished=True,
        wheel_off_road_m=0.0,
    ),
    case(
        'survives by stopping',
        judged(standing(drive_of(), 40.0)),
        finished=False,
        stopped=True,
        survived=True,
    ),
    case(
        'under way at the end',
        judged(drive_of(metres=50.0)),
        finished=False,
        stopped=False,
        lost_by='neither finished nor stopped',
    ),
    case('beside it', judged(drive_of(scene=past((40.0, 1.95)))), survived=True, lost_by=None),
    case(
        'touched',
        judged(drive_of(scene=past((40.0, 1.85)))),
        survived=False,
        lost_by='touched obstacle 1',
    ),
    *(
        case(
            f'a wheel off the road by {off} m, {side}',
            judged(drive_of(y=side * (3.0 - TRACK / 2 + off))),
            wheel_off_road_m=near(off),
            lost_by=None if off < 0.5 else 'left the road',
        )
        for off in (0.45, 0.55)
        for side in (1.0, -1.0)
    ),
    *(
        case(
            f'slides at {angle} deg and {speed} m/s',
            judged(moving(drive_of(), lambda x, a=angle: np.full(len(x), a), speed)),
            survived=not slid,
            lost_by='slid' if slid else None,
        )
        for angle, speed, slid in (
            *((29.0, 20.0, False), (31.0, 20.0, True)),
            *((-31.0, 20.0, True), (80.0, 4.9, False)),
        )
    ),
    case(
        'the first cause',
        judged(drive_of(scene=past((60.0, 0.0), (30.0, 0.0)))),
        lost_by='touched obstacle 2',
    ),
    case(
        'slides before it touches',
        judged(moving(drive_of(scene=past((60.0, 0.0))), lambda x: np.full(len(x), 45.0))),
        lost_by='slid',
    ),
]


@pytest.mark.parametrize(('drive', 'expected'), CASES)
def test_metrics_have_their_closed_form(drive, expected):
    result = metrics.compute_metrics(drive)
    assert list(result) == KEYS.split()
    assert json.loads(json.dumps(result, allow_nan=False)) == result
    for name, value in expected.items():
        if name == 'verdict':
            assert value in result[name]
        else:
            assert result[name] == value, name


@pytest.mark.parametrize('y', [0.0, 1.3, -2.5])
@pytest.mark.parametrize('yaw', [0.0, 0.3, -1.2])
def test_the_distance_of_the_outline_to_an_edge_is_that_of_its_farthest_corner(y, yaw):
    result = metrics.compute_metrics(drive_of(y=y, yaw=yaw))
    aside = 2.4 * abs(np.sin(yaw)) + 0.9 * np.cos(yaw)
    margins = {'left': 3.0 - y - aside, 'right': 3.0 + y - aside}
    assert result['min_outline_v2e_per_edge_m'] == near(margins)
    assert result['min_outline_v2e_m'] == near(min(margins.values()))


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
    t = np.arange(101) * 0.05 - 2.5
    still = np.zeros(len(t))
    # it comes at the end: nothing touches before
    x = np.where(t < -0.1, np.nan, 50.0 + 2.4 + 1.0 + ahead + speed * t)
    scene = straight_scene([Obstacle(1, x, still + aside, still + speed, still, 1.0)])
    result = metrics.compute_metrics(judged(drive_of(metres=50.0, scene=scene)))
    assert result['following'] is result['survived'] is follows


def test_jerk_is_that_of_what_was_measured():
    slope = put(drive_of(), 'accelerations', ay=lambda x: 3.0 * x / 20.0)

    def jerk(keep=slice(None), **columns):
        part = slope.accelerations._replace(**columns)
        part = type(part)(*(column[keep] for column in part))
        return driving.rms_lat_jerk_mps3(EvaluatedDrive(slope._replace(accelerations=part)))

    ay = slope.accelerations.ay
    assert jerk(ay=np.where(np.arange(len(ay)) % 500 < 50, np.nan, ay)) == near(3.0)
    assert jerk(slice(50)) is None
    assert jerk(ay=np.full(len(ay), np.nan)) is None


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
    result = metrics.compute_metrics(put(drive, 'motion', x=x, y=y))
    assert result['completed'] is done
    if stop:
        assert result['finish_at_m'] == near(20.0 * np.pi, 0.2)


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


def test_wheels_are_where_wheelbase_and_tracks_put_them():
    parameters = {
        'car.body.cog_to_front_m': 1.2,
        'car.body.cog_to_rear_m': 1.5,
        'car.suspension.front.track_m': 1.6,
        'car.suspension.rear.track_m': 1.7,
    }
    wheels = drives._wheels(parameters)
    assert set(wheels) == {(1.2, 0.8), (1.2, -0.8), (-1.5, 0.85), (-1.5, -0.85)}


@pytest.mark.parametrize('part', ['motion', 'accelerations', 'inputs'])
def test_a_drive_longer_than_a_day_is_refused_before_it_fills_the_memory(part):
    stamp_ns = getattr(drive_of(), part).stamp_ns.copy()
    stamp_ns[-1] = 1_700_000_000 * 10**9
    with pytest.raises(BagError, match=r'span 1699999999 s; allowed up to 86400 s'):
        metrics.compute_metrics(put(drive_of(), part, stamp_ns=stamp_ns))
