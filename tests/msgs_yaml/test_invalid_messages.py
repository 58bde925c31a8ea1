"""A message that violates the contract is refused; the error names topic, field and range."""

import math
import re
import time
from array import array

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from example_messages import FAST, canonical, decoded, encoded, load_example, put
from geometry_msgs.msg import Point, PoseStamped
from visualization_msgs.msg import Marker, MarkerArray

from msgs_yaml import (
    conformance,
    contract,
    conversions,
    decode,
    encode,
    field_paths,
    point_cloud,
)
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import (
    Actuators,
    Branch,
    Health,
    Imu,
    Obstacle,
    Obstacles,
    Prediction,
    Predictions,
    Reference,
    VehicleState,
    Wheels,
    Why,
)
from node_runtime import ros

S = 1_000_000_000
TOPICS = contract.load().topics


def refused(topic, message):
    """Return why a message is refused, from decode; readers of its bytes refuse it, too."""
    with pytest.raises(DecodeError) as caught:
        decoded(topic, message)
    assert topic not in FAST or FAST[topic](canonical(topic, message)) is None
    return str(caught.value).removeprefix(f'{topic}: ')


def place_of(topic, message, path):
    """Return where the number of a path of the contract is in a message, in the last element."""
    place, owner = [], message
    for attribute, selector in field_paths.parse(path):
        owner = getattr(owner, attribute)
        place.append(attribute)
        if selector in TOPICS[topic].joints:
            place.append(str(TOPICS[topic].joints.index(selector)))
        elif selector and selector.isdigit():
            place.append(selector)
        elif selector:
            labels = [selector if selector == '*' else element.ns for element in owner]
            k = max(k for k, label in enumerate(labels) if label == selector)
            place.append(str(k))
            owner = owner[k]
    return '.'.join(place)


NUMBERS = [
    (topic.name, path)
    for topic in TOPICS.values()
    if topic.type not in (contract.DIAGNOSTICS, contract.POINT_CLOUD)
    and not topic.name.startswith('/markers')
    for path in topic.fields
    if topic.name != '/clock'
]


@pytest.mark.parametrize(('topic', 'path'), NUMBERS)
def test_every_number_may_be_at_its_bounds_and_is_named_with_its_range_beyond_them(topic, path):
    field, place = TOPICS[topic].fields[path], place_of(topic, load_example(topic), path)
    named = f'{topic}: {path} ({field.symbol}) is '
    allowed = f'; allowed {field.low:g} to {field.high:g} {field.unit}'
    for bound, beyond in ((field.low, -math.inf), (field.high, math.inf)):
        at_bound = put(load_example(topic), place, bound)
        assert not any(str(v).startswith(named) for v in conformance.check(topic, at_bound))
        for bad in (np.nextafter(bound, beyond).item(), beyond, math.nan):
            message = put(load_example(topic), place, bad)
            told = [str(violation) for violation in conformance.check(topic, message)]
            expected = f'{named}{bad}{allowed}'
            if topic in FAST and TOPICS[topic].joints and not math.isfinite(bad):
                expected = (
                    f'{topic}: {place.partition(".")[0]} is not finite; allowed finite numbers'
                )
            assert expected in told
            if topic != '/scenario/obstacles':
                assert f'{topic}: {refused(topic, message)}' == told[0]


PATH, EDGES, STATE = '/scenario/reference', '/scenario/road_edges', '/vehicle/odometry'
NAMES = 'steer, front_axle, rear_axle'
NOW = Time(sec=1, nanosec=5)
LATE = 'poses[2].header.stamp is 0.500000000 s after the first pose; allowed above 0.500000000 s'
STOP, EARLY = '/controller/stop_plan', 'time_from_start is 0.100000000 s; allowed'
MISTAKES = [
    (STATE, 'header.frame_id', 'odom', "header.frame_id is 'odom'; allowed 'map'"),
    (STATE, 'child_frame_id', 'foot', "child_frame_id is 'foot'; allowed 'base_link'"),
    (STATE, 'header.stamp', Time(), 'header.stamp is 0.000000000 s; allowed above 0 s'),
    (STATE, 'header.stamp.sec', -1, 'header.stamp is -1.050000000 s; allowed above 0 s'),
    (STATE, 'pose.pose.orientation.w', 0.0, 'orientation is of squared length 0.00249792; allowed'),
    (STATE, 'pose.pose.orientation.x', 0.01, 'orientation.x (q_x) is 0.01; allowed 0 to 0 -'),
    ('/clock', 'clock', Time(), 'clock (t) is 0 s: no time yet; allowed above 0 s'),
    ('/clock', 'clock.sec', -1, 'clock.sec (t) is -1; allowed 0 to 2.14748e+09 s'),
    ('/vehicle/run_start', 'nanosec', S, 'nanosec (t) is 1000000000; allowed 0 to 1e+09 ns'),
    ('/vehicle/imu', 'header.stamp', Time(), 'header.stamp is 0.000000000 s; allowed'),
    *[
        ('/controller/command', 'name', names.split(), f'name is {told}; allowed {NAMES}')
        for names, told in {
            'front_axle steer rear_axle': '3 long: front_axle, steer, rear_axle',
            'steer front_axle': '2 long: steer, front_axle',
            'steer front_axle rear_axle more': '4 long: steer, front_axle, rear_axle',
            'x front_axle rear_axle': '3 long: x, front_axle, rear_axle',
            '': '0 long: ',
        }.items()
    ],
    *[
        ('/controller/command', array, numbers, f'{array} is {len(numbers)} long; allowed 3 ele')
        for array in contract.JOINT_ARRAYS
        for numbers in ([], [0.0, 0.0], [0.0] * 4)
    ],
    ('/controller/command', 'velocity.2', math.nan, 'velocity is not finite; allowed finite'),
    (PATH, 'poses', [PoseStamped()], 'poses is 1 long; allowed 2 to 40000 elements'),
    (PATH, 'poses.1.header.frame_id', 'mop', "poses[*].header.frame_id is 'mop'; allowed 'map'"),
    (PATH, 'poses.2.header.stamp', Time(sec=1, nanosec=500_000_000), LATE),
    (PATH, 'poses.1.header.stamp.sec', -3, 'poses[*].header.stamp is -3.500000000 s; allowed'),
    (PATH, 'poses.0.pose.orientation.w', 0.9, 'orientation is of squared length 0.81; allowed'),
    (PATH, 'poses.0.pose.orientation.w', 1e300, 'orientation.w (cos(psi/2)) is 1e+300; allowed'),
    (EDGES, 'markers', [Marker()], 'markers is 1 long; allowed 2 to 2 elements'),
    (EDGES, 'markers.1.points', [Point()], 'markers[*].points is 1 long; allowed 2 to 40000'),
    (EDGES, 'markers.1.ns', 'left', "markers are both 'left'; allowed left, right"),
    (EDGES, 'markers.0.ns', 'centre', "ns is 'centre'; allowed left, right"),
    (EDGES, 'markers.0.type', Marker.POINTS, 'type is 8; allowed 4 with ns left'),
    (EDGES, 'markers.0.action', Marker.DELETE, 'action is 2; allowed 0 (ADD)'),
    (EDGES, 'markers.0.header.stamp', NOW, 'markers have 2 stamps; allowed one for all'),
    (EDGES, 'markers.0.header.frame_id', 'odom', "header.frame_id is 'odom'; allowed 'map'"),
    (STOP, 'joint_names', ['a', 'b', 'c'], f'joint_names is a, b, c; allowed {NAMES}'),
    (STOP, 'joint_names', ['steer'], 'joint_names is 1 long; allowed 3 to 3 elements'),
    (STOP, 'points', [], 'points is 0 long; allowed 1 to 1000 elements'),
    (STOP, 'points.1.positions', [0.0], 'points[*].positions is 1 long; allowed 3 to 3'),
    (STOP, 'points.1.effort', [0.0] * 4, 'points[*].effort is 4 long; allowed 3 to 3'),
    (STOP, 'points.1.time_from_start.nanosec', 10**8, f'points[1].{EARLY} above 0.100000000 s'),
    (STOP, 'points.0.time_from_start.nanosec', 0, 'points[0].time_from_start is 0.000000000 s'),
    ('/controller/why', 'status', [DiagnosticStatus()] * 2, 'status is 2 long; allowed 1 to 1'),
]  # fmt: skip


@pytest.mark.filterwarnings('error::RuntimeWarning')  # of numbers too large to square
@pytest.mark.parametrize(('topic', 'path', 'value', 'error'), MISTAKES)
def test_what_is_wrong_in_the_form_of_a_message_is_named(topic, path, value, error):
    assert error in refused(topic, put(load_example(topic), path, value))


@pytest.mark.parametrize(
    ('key', 'value', 'error'),
    [
        ('cost.con', math.nan, 'cost.con (cost term) is nan; allowed 0 to inf -'),
        ('cost.con', -1.0, 'cost.con (cost term) is -1.0; allowed 0 to inf -'),
        ('time.solve_ms', 'soon', 'time.solve_ms (computing time) is soon; allowed 0 to 1e+06 ms'),
        ('speling', 1, "key 'speling' is unknown; allowed the keys of topics.yaml"),
        ('set_point.delta', 3.0, 'set_point.delta (delta) is 3.0; allowed -1.2 to 1.2 rad'),
        # the first pattern that fits counts: solver.* is at least 0
        (
            'solver.iterations',
            -3,
            'solver.iterations (count or residual) is -3; allowed 0 to inf -',
        ),
        ('solver.cost', -3.0, ''),
        ('solver.message', 'ok', ''),
        ('v2o.1', math.inf, ''),
    ],
)
def test_the_reasons_of_a_tick_are_checked_by_their_key_and_stay_readable(key, value, error):
    message = encode.why(Why(S, 2, 'lost', {key: value}))
    told = ''.join(map(str, conformance.check('/controller/why', message)))
    assert told == (error and f'/controller/why: {error}')
    read = decode.why(message)  # a failed tick must stay readable
    assert (read.level, str(read.values[key])) == (2, str(value))


def test_every_node_has_its_own_health_keys():
    health = Health(S, 'plant', 0, 'running', {'steps': 5, 'anything': 'goes', 'nan': math.nan})
    assert conformance.check('/diagnostics', encode.health(health)) == []


FAST_MPS = 100.0  # the fastest start of a scenario
FAR = 10_000.0 + 600.0 * FAST_MPS  # m: from the end of the longest road, for the longest run
FOUR = (0.0,) * 4


@pytest.mark.parametrize('sign', [-1, 1])
@pytest.mark.parametrize('degrees', range(0, 180, 15))
def test_every_state_that_a_car_can_reach_is_legal(degrees, sign):
    slides, far, spin = math.radians(degrees), sign * FAR, (sign * FAST_MPS / 0.25,) * 4
    along, across = sign * FAST_MPS * math.cos(slides), sign * FAST_MPS * math.sin(slides)
    ahead = np.array([far, far + sign * 2.5 * FAST_MPS])
    legal = {
        STATE: VehicleState(S, far, -far, 1.0, along, across, sign * 4 * math.pi),
        '/vehicle/imu': Imu(S, -sign * 30.0, 30.0, -sign * 4 * math.pi),
        '/scenario/obstacles': Obstacles(S, (Obstacle(1, far, -far, 1.0, along, across),)),
        '/controller/prediction': Prediction(S, ahead, -ahead, np.zeros(2), np.array([0.0, 2.5])),
        '/vehicle/wheels': Wheels(
            S, spin, FOUR, FOUR, (sign * 20.0,) * 4, FOUR, (sign * math.pi / 2,) * 4, FOUR
        ),
        '/vehicle/actuators': Actuators(S, sign * 0.6, 0.0, far / 4, far / 4, (sign * 6e3,) * 4),
    }
    for topic, value in legal.items():
        assert conformance.check(topic, encoded(topic, value)) == []


LINE = Reference(S, np.array([0.0, 10.0]), np.zeros(2), np.array([3.0, 3.3]), np.array([2.0, 2.5]))


def test_a_path_starts_at_zero_and_its_headings_are_unwrapped_a_plan_keeps_its_times():
    path = decode.reference(encode.reference(LINE))
    assert path.t.tolist() == [0.0, 0.5]
    assert np.allclose(path.psi, LINE.psi)
    plan = decode.prediction(encode.prediction(Prediction(*LINE)))
    assert plan.t.tolist() == [2.0, 2.5]
    assert np.allclose(plan.psi, LINE.psi)


@pytest.mark.parametrize('stamp', [Time(), Time(sec=1), Time(sec=77), Time(sec=1_795_000_000)])
def test_a_path_whose_poses_have_one_stamp_or_none_says_no_speed(stamp):
    message = encode.reference(LINE)
    for pose in message.poses:
        pose.header.stamp, pose.header.frame_id = stamp, ''
    path = decode.reference(message)
    assert path.t.tolist() == [0.0, 0.0]
    assert path.X.tolist() == LINE.X.tolist()


def test_a_million_elements_are_refused_at_once():
    path, edges = load_example(PATH), load_example(EDGES)
    command = load_example('/controller/command')
    path._poses = [PoseStamped()] * 1_000_000
    edges.markers[1]._points = [Point()] * 1_000_000
    command._name = ['steer'] * 1_000_000
    start = time.process_time()
    for read, message in (
        (decode.reference, path),
        (decode.road_edges, edges),
        (decode.command, command),
    ):
        with pytest.raises(DecodeError, match='is 1000000 long'):
            read(message)
    assert time.process_time() - start < 0.2


OBSTACLES = Obstacles(
    S, (Obstacle(1, 5.0, 0.0, 0.5, 0.0, 0.0), Obstacle(2, 9.0, 1.0, 0.5, 3.0, 0.0))
)
LONE = Obstacle(9, 40.0, 1.0, 0.5, 0.0, 0.0)
DISCS = {'type': Marker.SPHERE_LIST, 'points': [Point(), Point(x=2.0)]}
SIZE = r'scale.x \(2 r_obs\) is .*; allowed 0.01 to 100 m'
FAULTS = {
    'no size': ({'scale.x': 0.0, 'scale.y': 0.0}, 'field', SIZE),
    'giant': ({'scale.x': 1e3, 'scale.y': 1e3}, 'field', SIZE),
    'nan size': ({'scale.x': math.nan}, 'field', SIZE),
    'nan place': ({'pose.position.y': math.nan}, 'field', r'position.y \(Y_obs\) is nan'),
    'frame': ({'header.frame_id': 'odom'}, 'field', "frame_id is 'odom'; allowed 'map'"),
    'no stamp': ({'header.stamp': Time()}, 'field', 'stamp is 0.000000000 s'),
    'oval': ({'scale.y': 3.0}, 'shape', 'scale.y is 3.0; allowed scale.x = 1.0'),
    'cube': ({'type': Marker.CUBE}, 'type', 'type is 1; allowed 3, 7'),
    'foreign': ({'ns': 'tree'}, 'ns', 'allowed ns obstacle, velocity'),
    'action': ({'action': 77}, 'action', 'action is 77; allowed 0'),
    'no disc': ({'type': Marker.SPHERE_LIST}, 'shape', 'no points; allowed 1 or more'),
    'discs': (DISCS | {'points': [Point()] * 17}, 'field', '17 long; allowed 0 to 16'),
    'disc': (DISCS | {'points': [Point(x=1e3)]}, 'field', 'x of a disc.* is 1000.0; .* to 100 m'),
    'nan disc': (DISCS | {'points': [Point(y=math.nan)]}, 'field', 'y of a disc.* is nan'),
    'oval discs': (DISCS | {'scale.y': 3.0}, 'shape', 'scale.y is 3.0; allowed scale.x = 1.0'),
    'tilted': (DISCS | {'pose.orientation.x': 0.5}, 'shape', r'allowed a turn about z'),
    'nan turn': (DISCS | {'pose.orientation.z': math.nan}, 'shape', r'nan.*a turn about z'),
    'twin': ({'id': 1}, 'id', 'another one before it has this id'),
    'stamp': ({'header.stamp': Time(sec=99)}, 'stamp', 'not that of most markers'),
}


def crowd(*changes):
    """Return the message of OBSTACLES and changes of its marker, as (place, {path: value})."""
    message = encode.obstacles(OBSTACLES)
    for place, fields in changes:
        for path, value in fields.items():
            put(message.markers[place], path, value)
    return message


@pytest.mark.parametrize('fault', FAULTS)
@pytest.mark.parametrize('place', [0, 3])
def test_an_object_that_breaks_the_contract_is_refused_alone(fault, place):
    change, kind, reason = FAULTS[fault]
    (marker,) = encode.obstacles(Obstacles(S, (LONE,))).markers
    message = crowd()
    message.markers.insert(3 if kind == 'id' else place, marker)
    for path, value in change.items():
        put(marker, path, value)
    read = decode.obstacles(message)
    assert (read.stamp_ns, read.items) == (S, OBSTACLES.items)
    (refusal,) = read.refused
    assert refusal.kind == kind
    assert re.fullmatch(f'{marker.ns} {marker.id}: .*{reason}.*', refusal.reason)
    if kind not in ('id', 'stamp'):  # objects none of which can be used are no free road
        message.markers = [marker]
        assert re.search(reason, refused('/scenario/obstacles', message))


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'points': [Point()]}, r'velocity 2: .*points is 1 long; allowed 2 to 2'),
        ({'points': [Point(), Point(x=math.inf)]}, r'velocity 2: .*vX 1 s.* is inf'),
        ({'id': 7}, 'velocity 7: belongs to no obstacle; allowed same id'),
    ],
)
def test_an_arrow_that_breaks_the_contract_costs_the_velocity_alone(change, reason):
    read = decode.obstacles(crowd((2, change)))
    assert read.items == tuple(item._replace(vX=0.0, vY=0.0) for item in OBSTACLES.items)
    (refusal,) = read.refused
    assert re.match(reason, refusal.reason)


def test_the_discs_of_an_object_turn_with_its_pose():
    (marker,) = encode.obstacles(Obstacles(S, (LONE._replace(others=((2.0, 0.0),)),))).markers
    marker.points = [Point(x=1.0), Point(x=1.0, y=2.0)]
    marker.pose.orientation.z, marker.pose.orientation.w = conversions.heading_to_quaternion(0.5)
    (read,) = decode.obstacles(MarkerArray(markers=[marker])).items
    cos, sin = math.cos(0.5), math.sin(0.5)
    first, second = ((disc.X, disc.Y) for disc in read.discs())
    assert first == pytest.approx((LONE.X + cos, LONE.Y + sin))
    assert second == pytest.approx((LONE.X + cos - 2.0 * sin, LONE.Y + sin + 2.0 * cos))


def test_markers_that_delete_are_no_objects_and_only_the_length_of_an_arrow_counts():
    message = crowd((2, {'points': [Point(x=9.0, y=1.0), Point(x=12.0, y=1.0)]}))
    message.markers[:0] = encode.obstacles(Obstacles(S, ())).markers
    message.markers.append(Marker(ns='obstacle', id=3, action=Marker.DELETE))
    assert decode.obstacles(message) == OBSTACLES
    assert decode.obstacles(encode.obstacles(Obstacles(5 * S, ()))) == Obstacles(5 * S, ())
    assert decode.obstacles(ros.message_type('/scenario/obstacles')()) == Obstacles(0, ())


PREDICTIONS = '/scenario/predictions'
LINE_AHEAD = Branch(
    S, 0.5, np.array([0.0, 1.0]), np.array([10.0, 15.0]), np.zeros(2), np.array([np.eye(2)] * 2)
)


def packed(change=None):
    """Return predictions of obstacles 3, 4 and 5 as a message, some numbers of 4 changed."""
    by_id = dict.fromkeys((3, 4, 5), (LINE_AHEAD, LINE_AHEAD))
    message = encode.predictions(Predictions(S, by_id))
    rows = np.frombuffer(bytes(message.data), point_cloud.ROW).copy()
    for (row, name), value in (change or {}).items():
        rows[name][4 + row] = value
    message.data = array('B', rows.tobytes())
    return message


@pytest.mark.parametrize('bad', [math.nan, math.inf, -1e30, 1e30])
@pytest.mark.parametrize('name', [n for n in point_cloud.ROW.names[2:] if n != 'z'])
def test_every_number_of_a_prediction_has_its_range(name, bad):
    field, message = TOPICS[PREDICTIONS].fields[f'data[{name}]'], packed({(1, name): bad})
    wanted = (
        f'({field.symbol}) is {float(np.float32(bad))}; allowed {field.low:g} to {field.high:g}'
    )
    told = [str(violation) for violation in conformance.check(PREDICTIONS, message)]
    assert f'{PREDICTIONS}: data[{name}] {wanted} {field.unit}' in told
    read = decode.predictions(message)
    assert [*read.by_id] == [3, 5]
    (refusal,) = read.refused
    assert refusal == ('field', f'prediction 4: {name} {wanted} {field.unit}')


@pytest.mark.parametrize(
    ('change', 'kind', 'reason'),
    [
        ({(1, 't'): 0.0}, 'times', 't is 0.0 s in branch 0; allowed above the t of the point'),
        ({(0, 't'): 1.5}, 'times', 't is 1.0 s in branch 0; allowed above'),
        ({(3, 'probability'): 0.25}, 'probability', 'probability is 0.25; allowed one for a br'),
        ({(k, 'probability'): 0.7 for k in range(4)}, 'probability', 'more than 1 in sum; allowed'),
        (
            {(2, 'cov_xy'): 1.5},
            'covariance',
            'cov_xy is 1.5 m^2; allowed up to the root of 1.0 x 1',
        ),
        (
            {(2, 'var_x'): 0.0, (2, 'cov_xy'): 0.1},
            'covariance',
            'allowed up to the root of 0.0 x 1',
        ),
    ],
)
def test_a_prediction_that_breaks_the_contract_is_refused_alone(change, kind, reason):
    read = decode.predictions(packed(change))
    assert ([*read.by_id], read.stamp_ns) == ([3, 5], S)
    (refusal,) = read.refused
    assert refusal.kind == kind
    assert refusal.reason.startswith('prediction 4: ')
    assert reason in refusal.reason


def test_points_may_come_in_any_order_of_obstacles_with_further_fields_and_longer_numbers():
    kinds = {'id': '>u4', 'branch': 'u1'}
    names = ('rgb', *point_cloud.COLUMNS)
    dtype = np.dtype([(name, kinds.get(name, '>f8')) for name in names])
    message, wanted = packed(), decode.predictions(packed())
    rows = np.zeros(12, dtype)
    for name in point_cloud.ROW.names:
        rows[name] = np.frombuffer(bytes(message.data), point_cloud.ROW)[name]
    rows = rows[[8, 0, 4, 9, 1, 10, 2, 6, 5, 11, 3, 7]]  # each branch keeps its order
    message.is_bigendian, message.point_step = True, rows.itemsize
    for field in message.fields:
        field.offset = dtype.fields[field.name][1]
        field.datatype = point_cloud.COLUMNS[field.name][-1]
    message.data = array('B', rows.tobytes())
    assert str(decode.predictions(message)) == str(wanted)


@pytest.mark.parametrize(
    ('path', 'value', 'error'),
    [
        ('header.frame_id', 'odom', "header.frame_id is 'odom'; allowed 'map'"),
        ('header.stamp', Time(), 'header.stamp is 0.000000000 s; allowed above 0 s'),
        ('fields.3.name', 'time', 'fields is without t; allowed id, branch, probability, t, x'),
        ('fields.3.datatype', 5, 'fields (t) is 1 of datatype 5; allowed 1 of datatype 7 or 8'),
        ('fields.3.count', 2, 'fields (t) is 2 of datatype 7; allowed 1 of datatype'),
        ('fields.3.offset', 40, 'point_step is 37; allowed 44 or more'),
        ('width', 5, 'data is 444 long; allowed 185 elements, width x height x point_step'),
        ('fields', [], 'fields is 0 long; allowed 10 to 64 elements'),
    ],
)
def test_predictions_of_another_layout_are_refused_as_a_whole(path, value, error):
    assert error in refused(PREDICTIONS, put(packed(), path, value))


def test_points_that_are_none_with_rows_too_long_for_numpy_are_refused():
    none = encode.predictions(Predictions(S, {}))
    assert 'point_step is 2147483648; allowed' in refused(
        PREDICTIONS, put(none, 'point_step', 2**31)
    )
