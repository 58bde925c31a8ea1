"""Rules that people expect, of drives whose answers are known in closed form.

The car of `drive_of`, 4.8 m by 1.8 m, drives at 20 m/s along a road of 6 m; a lane of 3.5 m around
y = 0 is its own.
"""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from straight_drive import drive_of, obstacle, straight_scene

from bags.evaluation.metrics import rules
from bags.evaluation.metrics.registry import EvaluatedDrive

NOBODY, COMES, BESIDE = (), (90.0, 2.8, -20.0), (50.0, 2.8)


def value(metric, *places, y=0.0, **scene):
    """Return a metric of the drive at y past obstacles at (x, y, vx)."""
    crowd = [obstacle(number, *place) for number, place in enumerate(places, start=1)]
    drive = drive_of(y=y, scene=straight_scene(crowd)._replace(**scene))
    return EvaluatedDrive(drive).value(metric)


def swerve(x):
    """Return 1.5 m to the left from 40 to 60 m."""
    return 1.5 * ((x > 40.0) & (x < 60.0))


@pytest.mark.parametrize(
    ('metric', 'y', 'other', 'expected'),
    [
        (rules.lane_excess_m, 0.0, NOBODY, 0.0),
        (rules.lane_excess_m, swerve, NOBODY, 1.5 + 0.9 - 1.75),
        # nobody who keeps another lane gives a reason, and who stands or comes in the own one does
        (rules.lane_excess_m, swerve, BESIDE, 1.5 + 0.9 - 1.75),
        (rules.lane_excess_m, swerve, (50.0, 1.0), 0.0),
        (rules.lane_excess_m, swerve, (110.0, 0.0, -20.0), 0.0),
        # that was passed, or is met, more than 4 s away
        (rules.lane_excess_m, lambda x: 1.5 * (x > 90.0), (0.0, 0.0), 1.5 + 0.9 - 1.75),
        (rules.lane_excess_m, lambda x: 1.5 * ((x > 70.0) & (x < 80.0)), (0.0, 0.0), 0.0),
        (rules.dodge_m, -0.7, COMES, 0.7),
        (rules.dodge_m, -0.7, NOBODY, 0.0),
        (rules.dodge_m, -0.7, BESIDE, 0.0),
        # they are past each other at 2.34 s, at 46.7 m
        (rules.dodge_m, lambda x: -0.7 * (x > 48.0), COMES, 0.0),
        # from the first of 20 times a second, behind 0.165 s, until then
        (rules.in_the_way_s, 1.5, COMES, 2.15),
        (rules.in_the_way_s, 0.0, COMES, 0.0),
        (rules.in_the_way_s, 1.5, BESIDE, 0.0),
        (rules.in_the_way_s, -1.5, COMES, 0.0),
        # 0.5 m beside the strip in which it comes
        (rules.in_the_way_s, 0.9, (90.0, 3.4, -20.0), 0.0),
        # 5 m/s faster, 34.4 m behind its middle: 31 m of clearance become 6 m in 5 s
        (rules.min_time_gap_s, 0.0, (34.4, 0.0, 15.0), 6.0 / 20.0),
        (rules.min_time_gap_s, 0.0, COMES, None),
        (rules.min_time_gap_s, 0.0, NOBODY, None),
    ],
)
def test_what_a_rule_measures(metric, y, other, expected):
    found = value(metric, *([other] if other else []), y=y)
    assert found == (None if expected is None else pytest.approx(expected, abs=1e-6))


def test_on_a_narrow_road_the_lane_ends_at_the_edge():
    edges = {'left': [[0.0, 1.2], [120.0, 1.2]], 'right': [[0.0, -2.0], [120.0, -2.0]]}
    assert value(rules.lane_excess_m, y=-0.4, **edges) == pytest.approx(0.4 + 0.9 - 1.2)


@settings(max_examples=25)
@given(st.floats(30, 40), st.floats(-1.5, 1.5), st.floats(13.5, 15), st.sampled_from([0, 4.0]))
def test_the_time_gap_is_clearance_over_speed_once_one_is_settled_ahead(ahead, aside, speed, until):
    """One that is `until` s in another lane, and then moves over for less than 2 s."""
    car = obstacle(1, ahead, aside, speed)
    late = car.x * 0 + 3.0 * (car.x < ahead + speed * until)
    drive = drive_of(scene=straight_scene([car._replace(y=car.y + late)]))
    found = EvaluatedDrive(drive).value(rules.min_time_gap_s)
    # the clearance when the drive ends at 5 s, or while there was one
    left = ahead - 1.0 - 2.4 - (20.0 - speed) * 5.0
    if until or abs(aside) > 0.95:
        assert found is None
    elif abs(aside) < 0.85 and left > 0.0:
        assert found == pytest.approx(left / 20.0, abs=1e-6)
