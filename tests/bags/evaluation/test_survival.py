"""The judge of emergencies against drives whose end is known in closed form."""

import numpy as np
import pytest

from bags.evaluation import drive as drives
from bags.evaluation import metrics
from bags.evaluation.drive import Obstacle

# the straight road of `make_drive` lies between y = -3 and 3 m, its car drives along y = 0
HALF_ROAD = 3.0
TRACK = 1.6
WHEELS = tuple((x, y) for x in (1.4, -1.4) for y in (TRACK / 2, -TRACK / 2))


@pytest.fixture
def judge(make_drive):
    """Return judge(**drive): the metrics of a drive whose wheels are known."""

    def judge(change=lambda drive: drive, **given):
        driven = make_drive(**given)
        driven = driven._replace(facts=driven.facts._replace(wheels=WHEELS))
        return metrics.compute_metrics(change(driven))

    return judge


def obstacle(scene, x, y, radius=1.0, number=1):
    still = np.zeros(len(scene.obstacle_stamp_ns))
    item = Obstacle(number, still + x, still + y, still, still, radius)
    return scene._replace(obstacles=(*scene.obstacles, item))


def slides(angle_deg, speed=20.0):
    angle = np.radians(angle_deg)

    def change(driven):
        ones = np.ones(len(driven.motion.x))
        vx, vy = speed * np.cos(angle) * ones, speed * np.sin(angle) * ones
        return driven._replace(motion=driven.motion._replace(vx=vx, vy=vy))

    return change


def stands_at(x):
    def change(driven):
        motion = driven.motion
        vx = np.where(motion.x >= x, 0.0, motion.vx)
        return driven._replace(motion=motion._replace(x=np.minimum(motion.x, x), vx=vx))

    return change


def test_a_car_that_drives_straight_to_the_finish_survives(judge):
    result = judge()
    assert (result['survived'], result['lost_by'], result['finished']) == (True, None, True)
    assert result['wheel_off_road_m'] == 0.0


def test_a_car_that_stops_before_the_finish_survives(judge):
    result = judge(stands_at(40.0))
    assert (result['finished'], result['stopped'], result['survived']) == (False, True, True)


def test_a_car_that_is_under_way_at_the_end_of_the_run_does_not_survive(judge):
    result = judge(metres=50.0)
    assert (result['finished'], result['stopped']) == (False, False)
    assert result['lost_by'] == 'neither finished nor stopped'


@pytest.mark.parametrize(
    ('ahead', 'aside', 'speed', 'follows'),
    [
        (10.0, 0.0, 20.0, True),
        (10.0, 0.0, 25.0, True),
        (10.0, 0.0, 19.1, True),
        (10.0, 0.0, 18.9, False),  # the gap closes too fast
        (10.0, 0.0, 0.0, False),
        (10.0, 0.0, -20.0, False),
        (42.5, 0.0, 20.0, True),
        (43.5, 0.0, 20.0, False),  # more than 3 m and 2 s at 20 m/s away
        (-20.0, 0.0, 20.0, False),
        (10.0, -1.8, 20.0, True),
        (10.0, 2.0, 20.0, False),  # half of the car and a radius of 1 m are 1.925 m
    ],
)
def test_a_car_that_follows_another_at_the_end_survives(
    judge, make_drive, ahead, aside, speed, follows
):
    """The car drives 50 m at 20 m/s; the other one is `ahead` of its nose at the end."""
    driven = make_drive(metres=50.0)
    motion, scene = driven.motion, driven.scene
    end = motion.x[-1] + driven.facts.outline.front + ahead + 1.0
    t = (scene.obstacle_stamp_ns - motion.stamp_ns[-1]) * 1e-9
    still = np.zeros(len(t))
    x = np.where(t < -0.1, np.nan, end + speed * t)  # it comes at the end: nothing touches before
    item = Obstacle(1, x, still + aside, still + speed, still, 1.0)
    result = judge(metres=50.0, scene=scene._replace(obstacles=(item,)))
    assert result['following'] is follows
    assert result['survived'] is follows


@pytest.mark.parametrize(('gap', 'survived'), [(0.05, True), (-0.05, False)])
def test_touching_is_that_of_the_outline(judge, make_drive, gap, survived):
    beside = make_drive().facts.outline.width / 2 + 1.0 + gap
    result = judge(scene=obstacle(make_drive().scene, 40.0, beside))
    assert result['survived'] is survived
    assert result['lost_by'] == (None if survived else 'touched obstacle 1')


@pytest.mark.parametrize(('off', 'survived'), [(0.45, True), (0.55, False)])
def test_a_wheel_may_leave_the_road_by_half_a_metre(judge, off, survived):
    y = HALF_ROAD - TRACK / 2 + off
    for side in (1.0, -1.0):
        result = judge(y=side * y)
        assert result['wheel_off_road_m'] == pytest.approx(off)
        assert result['survived'] is survived
        assert result['lost_by'] == (None if survived else 'left the road')


@pytest.mark.parametrize(
    ('angle_deg', 'speed', 'survived'),
    [(29.0, 20.0, True), (31.0, 20.0, False), (-31.0, 20.0, False), (80.0, 4.9, True)],
)
def test_a_slide_is_30_deg_of_sideslip_above_5_mps(judge, angle_deg, speed, survived):
    result = judge(slides(angle_deg, speed))
    assert result['survived'] is survived
    assert result['lost_by'] == (None if survived else 'slid')


def test_the_cause_is_what_happened_first(judge, make_drive):
    scene = obstacle(obstacle(make_drive().scene, 60.0, 0.0), 30.0, 0.0, number=2)
    assert judge(scene=scene)['lost_by'] == 'touched obstacle 2'
    # the car slides from the start on
    assert judge(slides(45.0), scene=scene)['lost_by'] == 'slid'


def test_without_track_widths_nobody_is_judged(make_drive):
    result = metrics.compute_metrics(make_drive())
    assert (result['survived'], result['lost_by'], result['wheel_off_road_m']) == (None,) * 3


def test_wheels_are_where_wheelbase_and_tracks_put_them():
    parameters = {
        'car.body.cog_to_front_m': 1.2,
        'car.body.cog_to_rear_m': 1.5,
        'car.suspension.front.track_m': 1.6,
        'car.suspension.rear.track_m': 1.7,
    }
    wheels = drives._wheels(parameters)
    assert set(wheels) == {(1.2, 0.8), (1.2, -0.8), (-1.5, 0.85), (-1.5, -0.85)}
