"""Every violation of the contract is reported, fast enough for a whole bag."""

import math
import time

import numpy as np
import pytest

from msgs_yaml import conformance, encode
from msgs_yaml.types import (
    Actuators,
    Command,
    Health,
    Imu,
    Obstacle,
    Obstacles,
    Prediction,
    VehicleState,
    Wheels,
    Why,
)

S = 1_000_000_000
FOUR = (0.1, 0.2, 0.3, 0.4)
STATE = encode.odometry(VehicleState(S, 1.0, 2.0, 0.3, 20.0, -0.1, 0.2))
ACTUATORS = encode.actuators(Actuators(S, 0.1, 0.2, -3000.0, -2000.0, FOUR))
IMU = encode.imu(Imu(S, 1.0, 2.0, 0.1))
WHEELS = encode.wheels(Wheels(S, *[FOUR] * 7))
COMMAND = encode.command(Command(S, 0.1, 0.2, -3000.0, -2000.0))
PLAN = encode.prediction(Prediction(S, *np.zeros((3, 51)), np.arange(51) * 0.05))


def why(**values):
    named = {name.replace('__', '.'): value for name, value in values.items()}
    return encode.why(Why(S, 0, 'solved', {'rung': 'solved', **named}))


def test_a_good_message_has_no_violation():
    assert conformance.check('/vehicle/odometry', STATE) == []
    assert conformance.check('/vehicle/actuators', ACTUATORS) == []
    assert conformance.check('/vehicle/imu', IMU) == []
    assert conformance.check('/vehicle/wheels', WHEELS) == []
    assert conformance.check('/controller/command', COMMAND) == []
    assert conformance.check('/controller/prediction', PLAN) == []
    assert conformance.check('/controller/why', why(cost__con=1.0, v2o__1=math.inf)) == []
    assert conformance.check('/clock', encode.clock(S)) == []


def test_every_violation_is_listed_not_only_the_first():
    message = encode.odometry(VehicleState(S, math.nan, 2e5, 0.3, 20.0, -0.1, 99.0))
    fields = [violation.field for violation in conformance.check('/vehicle/odometry', message)]
    assert fields == [
        'pose.pose.position.x (X)',
        'pose.pose.position.y (Y)',
        'twist.twist.angular.z (r)',
    ]


def test_a_violation_reads_as_a_sentence():
    message = encode.command(Command(S, 2.0, 0.2, -3000.0, -2000.0))
    (violation,) = conformance.check('/controller/command', message)
    assert str(violation) == (
        '/controller/command: position[steer] (delta) is 2.0; allowed -1.2 to 1.2 rad'
    )


def test_one_bad_pose_of_many_is_reported():
    plan = encode.prediction(Prediction(S, *np.zeros((3, 51)), np.arange(51) * 0.05))
    plan.poses[37].pose.position.y = math.inf
    (violation,) = conformance.check('/controller/prediction', plan)
    assert violation.field == 'poses[*].pose.position.y (Y)'


def test_bounds_belong_to_the_range():
    assert conformance.check('/controller/command', encode.command(Command(S, 1.2, 0, 0, 0))) == []
    beyond = encode.command(Command(S, math.nextafter(1.2, 2), 0, 0, 0))
    assert len(conformance.check('/controller/command', beyond)) == 1


@pytest.mark.parametrize(
    ('values', 'error'),
    [
        ({'cost__con': math.nan}, 'cost.con (cost term) is nan; allowed 0 to inf -'),
        ({'cost__con': -1.0}, 'cost.con (cost term) is -1.0; allowed 0 to inf -'),
        (
            {'time__solve_ms': 'soon'},
            r'time.solve_ms (computing time) is soon; allowed 0 to 1e+06 ms',
        ),
        ({'speling': 1}, "key 'speling' is unknown; allowed the keys of topics.yaml"),
        ({'set_point__delta': 3.0}, 'set_point.delta (delta) is 3.0; allowed -1.2 to 1.2 rad'),
    ],
)
def test_reasons_are_checked_by_their_key(values, error):
    (violation,) = conformance.check('/controller/why', why(**values))
    assert str(violation) == f'/controller/why: {error}'


def test_the_first_pattern_that_fits_a_key_counts():
    # solver.* is at least 0, but solver.cost may be negative and solver.message is a text
    assert conformance.check('/controller/why', why(solver__cost=-3.0, solver__message='ok')) == []
    assert len(conformance.check('/controller/why', why(solver__iterations=-3))) == 1


def test_every_node_has_its_own_health_keys():
    health = Health(S, 'plant', 0, 'running', {'steps': 5, 'anything': 'goes', 'nan': math.nan})
    assert conformance.check('/diagnostics', encode.health(health)) == []


def test_obstacles_are_checked_by_their_namespace():
    fast = Obstacles(S, (Obstacle(1, 0.0, 0.0, 0.5, 500.0, 0.0),))
    (violation,) = conformance.check('/scenario/obstacles', encode.obstacles(fast))
    assert violation.field == 'markers[velocity].points[*].x (vX 1 s)'
    assert conformance.check('/scenario/obstacles', encode.obstacles(Obstacles(S, ()))) == []


def test_a_topic_outside_the_contract_is_an_error():
    with pytest.raises(KeyError):
        conformance.check('/vehicle/odometer', STATE)


def test_a_whole_bag_is_checked_in_seconds():
    # 20 s of driving: the rates of the contract
    bag = [
        ('/vehicle/odometry', STATE, 20_000),
        ('/vehicle/actuators', ACTUATORS, 20_000),
        ('/vehicle/imu', IMU, 2_000),
        ('/vehicle/wheels', WHEELS, 2_000),
        ('/controller/command', COMMAND, 400),
        ('/controller/prediction', PLAN, 400),
    ]
    start = time.process_time()
    for topic, message, count in bag:
        for _ in range(count):
            assert not conformance.check(topic, message)
    assert time.process_time() - start < 10.0
