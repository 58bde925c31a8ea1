"""Metrics of drives whose answers are known in closed form."""

import json

import numpy as np
import pytest

from bags.evaluation import metrics
from bags.evaluation.drive import Obstacle
from bags.evaluation.metrics import driving
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.series import compute_series

MS = 1_000_000
START_NS = 1_000_000_000
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


def with_obstacle(scene, x, y, vx=0.0, vy=0.0, radius=1.0, number=1):
    t = (scene.obstacle_stamp_ns - START_NS) * 1e-9
    speed = np.ones(len(t))
    item = Obstacle(number, x + vx * t, y + vy * t, vx * speed, vy * speed, radius)
    return scene._replace(obstacles=(*scene.obstacles, item))


@pytest.fixture
def straight(make_drive):
    return make_drive().scene


def test_every_number_of_the_interface_is_there_and_is_json(make_drive):
    result = metrics.compute_metrics(make_drive())
    assert list(result) == KEYS.split()
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_an_empty_straight_road_has_no_obstacle_no_overshoot_and_no_braking(make_drive):
    result = metrics.compute_metrics(make_drive())
    assert result['completed'] is True
    assert result['collided'] is False
    assert result['entered_unsafe_area'] is False
    assert result['min_v2o_m'] is None
    assert result['min_v2o_per_obstacle_m'] == {}
    assert result['min_outline_gap_m'] is None
    assert result['overshoots'] == []
    assert result['brake_onset_at_m'] is None
    assert result['min_speed_mps'] == 20.0
    assert result['rms_contouring_m'] == pytest.approx(0.0, abs=1e-12)
    assert result['min_v2e_per_edge_m'] == pytest.approx({'left': 1.9, 'right': 1.9})


def test_passing_a_standing_obstacle_leaves_its_offset_minus_both_radii(make_drive, straight):
    scene = with_obstacle(with_obstacle(straight, 50.0, 3.0), 70.0, -4.0, number=7)
    result = metrics.compute_metrics(make_drive(scene=scene))
    assert result['min_v2o_per_obstacle_m'] == pytest.approx({'1': 0.9, '7': 1.9})
    assert result['min_v2o_m'] == pytest.approx(0.9)
    assert result['min_outline_gap_m'] == pytest.approx(3.0 - 0.9 - 1.0)
    assert result['collided'] is False


@pytest.mark.parametrize(
    ('offset', 'unsafe', 'collided'),
    [
        pytest.param(2.61, False, False, id='outside the unsafe area'),
        pytest.param(2.59, True, False, id='inside it'),
        pytest.param(2.09, True, True, id='circles touch, outlines do not'),
    ],
)
def test_safety_distance_and_collision_at_an_obstacle(
    make_drive, straight, offset, unsafe, collided
):
    result = metrics.compute_metrics(make_drive(scene=with_obstacle(straight, 50.0, offset)))
    assert (result['entered_unsafe_area'], result['collided']) == (unsafe, collided)


@pytest.mark.parametrize(
    ('offset', 'unsafe'),
    [
        pytest.param(2.41, False, id='outline outside the unsafe area'),
        pytest.param(2.39, True, id='outline inside it'),
    ],
)
def test_the_outline_is_judged_by_the_safety_distance_to_an_obstacle(
    make_drive, straight, offset, unsafe
):
    # half of 1.8 m, 1.0 m of the obstacle, 0.5 m of safety distance
    result = metrics.compute_metrics(make_drive(scene=with_obstacle(straight, 50.0, offset)))
    assert result['outline_entered_unsafe_area'] is unsafe


@pytest.mark.parametrize(
    ('y', 'yaw', 'unsafe'),
    [
        pytest.param(1.59, 0.0, False, id='beside the edge'),
        pytest.param(1.61, 0.0, True, id='too near to the edge'),
        pytest.param(0.0, np.pi / 2, False, id='sideways in the middle'),
        pytest.param(0.2, np.pi / 2, True, id='sideways, the nose too near'),
    ],
)
def test_the_outline_is_judged_by_the_safety_distance_to_an_edge(make_drive, y, yaw, unsafe):
    # edges 3 m to either side, half a width of 0.9 m, 2.4 m from the centre to the nose
    result = metrics.compute_metrics(make_drive(y=y, yaw=yaw))
    assert result['outline_entered_unsafe_area'] is unsafe


def test_a_sideways_car_touches_with_its_nose_though_its_circle_is_clear(make_drive, straight):
    scene = with_obstacle(straight, 50.0, 3.0)
    result = metrics.compute_metrics(make_drive(scene=scene, yaw=np.pi / 2))
    assert result['min_v2o_m'] == pytest.approx(0.9)
    assert result['min_outline_gap_m'] == pytest.approx(3.0 - 2.4 - 1.0)
    assert result['collided'] is True


def test_two_circles_see_the_nose_of_a_sideways_car(make_drive, straight):
    scene = with_obstacle(straight, 50.0, 4.0)
    result = metrics.compute_metrics(make_drive(scene=scene, yaw=np.pi / 2, circles=(1.1, -1.1)))
    assert result['min_v2o_m'] == pytest.approx(4.0 - 1.1 - 1.0 - 1.1)
    assert result['min_v2e_per_edge_m'] == pytest.approx({'left': 0.8, 'right': 0.8})


def test_an_oncoming_obstacle_is_met_where_the_two_are_at_that_time(make_drive, straight):
    # it crosses the path 60 m ahead just when the car is there: 3 s at 20 m/s
    scene = with_obstacle(straight, 60.0, 30.0, vy=-10.0)
    result = metrics.compute_metrics(make_drive(scene=scene))
    assert result['min_v2o_m'] == pytest.approx(-2.1, abs=0.02)
    passed = with_obstacle(straight, 60.0, -30.0, vy=-10.0)
    assert metrics.compute_metrics(make_drive(scene=passed))['min_v2o_m'] > 20.0


def test_between_two_messages_an_obstacle_keeps_moving(make_drive, straight):
    moving = with_obstacle(straight, 3.0, 5.0, vx=20.0)
    result = metrics.compute_metrics(make_drive(scene=moving))
    assert result['min_v2o_m'] == pytest.approx(np.hypot(3.0, 5.0) - 2.1, abs=1e-6)


def test_an_obstacle_counts_only_while_it_is_there(make_drive, straight):
    scene = with_obstacle(straight, 50.0, 0.0)
    gone_by = scene.obstacle_stamp_ns >= START_NS + 2000 * MS  # the car is at 40 m
    absent = scene.obstacles[0]._replace(x=np.where(gone_by, np.nan, 50.0))
    result = metrics.compute_metrics(make_drive(scene=scene._replace(obstacles=(absent,))))
    assert result['min_v2o_m'] == pytest.approx(10.0 - 2.1, abs=0.03)


def test_beyond_an_edge_the_distance_is_negative(make_drive):
    result = metrics.compute_metrics(make_drive(y=4.0))
    assert result['min_v2e_per_edge_m'] == pytest.approx({'left': -2.1, 'right': 5.9})
    assert result['entered_unsafe_area'] is True
    assert result['collided'] is False


def test_sideslip_is_the_angle_between_heading_and_velocity(make_drive):
    def sideways(x):
        return -20.0 * np.tan(np.radians(6.0)) * np.exp(-(((x - 63.0) / 5.0) ** 2))

    result = metrics.compute_metrics(make_drive(vy=sideways))
    assert result['peak_sideslip_deg'] == pytest.approx(6.0)
    assert result['peak_sideslip_at_m'] == pytest.approx(63.0, abs=0.02)


def test_braking_begins_where_the_force_first_falls_to_the_threshold(make_drive):
    driven = make_drive(force=lambda x: np.minimum(0.0, -100.0 * (x - 30.0)))
    run = EvaluatedDrive(driven, compute_series(driven))
    assert metrics.compute_metrics(driven)['brake_onset_at_m'] == pytest.approx(35.0, abs=0.03)
    assert driving.brake_onset(run, -1500.0) == pytest.approx(45.0, abs=0.03)
    assert driving.brake_onset(run, -1e6) is None


def planned(drive, converged=True):
    """Return the drive with a report per tick; `converged` is of the station of the tick [m]."""
    stamp_ns = drive.ticks.answered_ns
    at = (stamp_ns - START_NS) * 1e-9 * 20.0
    values = converged(at) if callable(converged) else np.full(len(at), converged)
    return drive._replace(ticks=drive.ticks._replace(stamp_ns=stamp_ns, converged=values))


def onsets(drive):
    result = metrics.compute_metrics(drive)
    return [result[f'planned_brake_onset{kind}_at_m'] for kind in ('', '_hard')]


def test_planned_braking_begins_where_the_force_first_stays_at_the_threshold(make_drive):
    def ramp_after_a_peak(x):  # beyond both thresholds for 1 m, 0.05 s, at 20 m
        return np.where(abs(x - 20.5) < 0.5, -3000.0, np.minimum(0.0, -100.0 * (x - 30.0)))

    drive = make_drive(force=ramp_after_a_peak)
    assert onsets(planned(drive)) == pytest.approx([35.2, 45.2], abs=0.21)  # samples of 10 ms
    assert metrics.compute_metrics(drive)['brake_onset_at_m'] == pytest.approx(20.0, abs=0.03)


def test_braking_without_a_converged_plan_is_no_onset(make_drive):
    drive = make_drive(force=lambda x: np.where(x < 30.0, 0.0, -2000.0))
    assert onsets(drive) == [None, None]  # no report at all
    assert onsets(planned(drive, False)) == [None, None]
    # plans from 40 m on: the onset is the first one that is planned
    late = planned(drive, lambda at: at > 39.9)
    assert onsets(late) == pytest.approx([40.0, 40.0], abs=0.21)


@pytest.mark.parametrize(('x', 'braked'), [(29.0, False), (33.0, True)])
def test_braking_beyond_the_last_obstacle_is_no_onset(make_drive, straight, x, braked):
    drive = make_drive(
        force=lambda x: np.where(x < 30.0, 0.0, -2000.0),
        scene=with_obstacle(with_obstacle(straight, 20.0, 5.0), x, -5.0, number=2),
    )
    assert [onset is not None for onset in onsets(planned(drive))] == [braked, braked]


def test_a_lateral_acceleration_counts_as_held_after_a_tenth_of_a_second(make_drive):
    # 8 sin(2 t): 0.05 s before and after its peak it is 8 cos(0.1)
    result = metrics.compute_metrics(make_drive(lateral_limit=7.5))
    assert result['held_lat_acc_mps2'] == pytest.approx(8.0 * np.cos(0.1), abs=0.02)
    assert result['lateral_limit_use_plant'] == pytest.approx(8.0 * np.cos(0.1) / 7.5, abs=3e-3)
    assert metrics.compute_metrics(make_drive())['lateral_limit_use_plant'] is None


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_peak_of_less_than_a_tenth_of_a_second_is_not_held(make_drive, sign):
    drive = make_drive()
    t = (drive.accelerations.stamp_ns - START_NS) * 1e-9
    ay = sign * np.select([abs(t - 2.0) < 0.045, abs(t - 3.0) < 0.06], [9.0, 4.0], 1.0)
    held = drive._replace(accelerations=drive.accelerations._replace(ay=ay))
    assert metrics.compute_metrics(held)['held_lat_acc_mps2'] == pytest.approx(4.0)


@pytest.mark.parametrize('y', [0.0, 1.3, -2.5])
@pytest.mark.parametrize('yaw', [0.0, 0.3, -1.2, np.pi / 2])
def test_the_distance_of_the_outline_to_an_edge_is_that_of_its_farthest_corner(make_drive, y, yaw):
    result = metrics.compute_metrics(make_drive(y=y, yaw=yaw))
    aside = 2.4 * abs(np.sin(yaw)) + 0.9 * np.cos(yaw)
    margins = {'left': 3.0 - y - aside, 'right': 3.0 + y - aside}
    assert result['min_outline_v2e_per_edge_m'] == pytest.approx(margins)
    assert result['min_outline_v2e_m'] == pytest.approx(min(margins.values()))


def test_the_gap_of_the_outline_is_known_for_each_obstacle(make_drive, straight):
    scene = with_obstacle(with_obstacle(straight, 50.0, 3.0), 70.0, -4.0, number=7)
    result = metrics.compute_metrics(make_drive(scene=scene))
    assert result['min_outline_gap_per_obstacle_m'] == pytest.approx({'1': 1.1, '7': 2.1})


def test_peaks_of_acceleration_are_magnitudes(make_drive):
    result = metrics.compute_metrics(make_drive())
    assert result['peak_brake_mps2'] == pytest.approx(5.0)
    assert result['peak_lat_acc_mps2'] == pytest.approx(8.0, abs=1e-3)


def test_lateral_jerk_is_the_root_mean_square_of_the_slope(make_drive):
    driven = make_drive()
    stamp_ns = START_NS + np.arange(0, 400) * 10 * MS
    slope = driven.accelerations._replace(
        stamp_ns=stamp_ns,
        ax=np.zeros(400),
        ay=3.0 * (stamp_ns - START_NS) * 1e-9,  # 3 m/s^3
    )
    run = EvaluatedDrive(driven._replace(accelerations=slope), None)
    assert driving.rms_lat_jerk_mps3(run) == pytest.approx(3.0)
    short = slope._replace(stamp_ns=stamp_ns[:5], ax=slope.ax[:5], ay=slope.ay[:5])
    run = EvaluatedDrive(driven._replace(accelerations=short), None)
    assert driving.rms_lat_jerk_mps3(run) is None
    gaps = np.where(np.arange(400) % 50 < 5, np.nan, slope.ay)
    run = EvaluatedDrive(driven._replace(accelerations=slope._replace(ay=gaps)), None)
    assert driving.rms_lat_jerk_mps3(run) == pytest.approx(3.0)
    broken = slope._replace(ay=np.full(400, np.nan))
    run = EvaluatedDrive(driven._replace(accelerations=broken), None)
    assert driving.rms_lat_jerk_mps3(run) is None


def test_contouring_is_a_root_mean_square(make_drive):
    result = metrics.compute_metrics(make_drive(y=lambda x: 0.3 * np.sin(2.0 * np.pi * x / 10.0)))
    assert result['rms_contouring_m'] == pytest.approx(0.3 / np.sqrt(2.0), rel=1e-3)


@pytest.mark.parametrize(('metres', 'done'), [(89.0, False), (90.0, True)])
def test_a_run_is_complete_when_it_reaches_the_stop(make_drive, metres, done):
    assert metrics.compute_metrics(make_drive(metres=metres))['completed'] is done


def test_a_drive_that_starts_beyond_the_finish_line_has_not_reached_it(make_drive):
    result = metrics.compute_metrics(make_drive(stop=(-5.0, 0.0), armed_after=0.0))
    assert result['completed'] is False
    assert result['verdict'].startswith('started beyond the finish line')


def test_a_stop_that_the_last_lap_does_not_pass_again_is_not_reached_at_the_end_of_the_path(
    make_drive,
):
    # one lap and a quarter; the stop lies at a half, the drive begins behind it in the second lap
    angle = np.linspace(0.0, 2.5 * np.pi, 901)
    path = 20.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    scene = make_drive().scene._replace(reference=path)
    driven = make_drive(scene=scene, stop=(0.0, 40.0), armed_after=5.0)
    phi = np.pi * (1.1 + 1.4 * np.linspace(0.0, 1.0, len(driven.motion.x)))
    motion = driven.motion._replace(x=20.0 * np.sin(phi), y=20.0 - 20.0 * np.cos(phi))
    result = metrics.compute_metrics(driven._replace(motion=motion))
    assert result['completed'] is False
    assert result['finish_at_m'] == pytest.approx(20.0 * np.pi, abs=0.2)


def test_a_lap_is_complete_only_at_its_end(make_drive):
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    lap = 20.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    scene = make_drive().scene._replace(reference=lap)

    def around(share):
        driven = make_drive(scene=scene, stop=(0.0, 0.0), armed_after=60.0)
        phi = np.linspace(0.0, 2.0 * np.pi * share, len(driven.motion.x))
        motion = driven.motion._replace(x=20.0 * np.sin(phi), y=20.0 - 20.0 * np.cos(phi))
        return metrics.compute_metrics(driven._replace(motion=motion))['completed']

    assert around(1.0) is True
    assert around(0.9) is False
    assert around(0.02) is False


def lane_change(x, at, length, width):
    """Return the quintic step: no heading and no curvature at either end."""
    u = np.clip((x - at) / length, 0.0, 1.0)
    return width * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


@pytest.fixture
def lanes(straight):
    x = np.arange(0.0, 121.0, 0.5)
    y = lane_change(x, 20.0, 20.0, 3.5) - lane_change(x, 60.0, 20.0, 3.5)
    return straight._replace(reference=np.column_stack([x, y]))


def reference_y(x):
    return lane_change(x, 20.0, 20.0, 3.5) - lane_change(x, 60.0, 20.0, 3.5)


def bump(x, at, amount):
    return amount * np.cos(np.clip((x - at) / 10.0, -1.0, 1.0) * np.pi / 2.0) ** 2


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
def test_overshoot_is_running_wide_of_a_bend(make_drive, lanes, at, amount, counted):
    driven = make_drive(scene=lanes, y=lambda x: reference_y(x) + bump(x, at, amount))
    result = metrics.compute_metrics(driven)['overshoots']
    if counted:
        assert len(result) == 1
        assert result[0]['x_m'] == pytest.approx(at, abs=2.0)
        assert result[0]['amount_m'] == pytest.approx(abs(amount), rel=0.1)
    else:
        assert result == []
