"""Messages take the forms of topics.yaml, so that viewers and plotters show them as they are."""

import runpy
from typing import NamedTuple

import long_paths
import pytest
from example_messages import decoded, encoded, load_example
from visualization_msgs.msg import Marker

from msgs_yaml import conformance, contract, decode, encode, flat_fields, raw_scenario, share
from msgs_yaml.contract import ContractError
from msgs_yaml.types import Command, Imu, Obstacle, Obstacles
from node_runtime import ros

S = 1_000_000_000
IMU = '/vehicle/imu'


@pytest.mark.parametrize('topic', ['/vehicle/wheels', '/vehicle/actuators', '/controller/command'])
def test_the_numbers_of_a_joint_state_stand_where_topics_yaml_says_and_no_array_is_empty(topic):
    columns = flat_fields.load(topic).columns
    numbers = iter(range(1, 100))
    parts = [tuple(float(next(numbers)) for _ in paths) for paths in columns.values()]
    fields = [part if len(part) > 1 else part[0] for part in parts]
    message = encoded(topic, flat_fields.TYPES[topic](S, *fields))
    for paths, part in zip(columns.values(), parts):
        for path, number in zip(paths, part):
            array, _, name = path.removesuffix(']').partition('[')
            assert getattr(message, array)[message.name.index(name)] == number
    lengths = {len(message.position), len(message.velocity), len(message.effort)}
    assert lengths == {len(message.name)}


def test_an_imu_measures_no_orientation_and_a_header_has_stamp_and_frame():
    assert encode.imu(Imu(S, 1.0, 2.0, 3.0)).orientation_covariance[0] == -1.0
    header = encode.command(Command(S + 5, 0.1, 0.2, 3.0, 4.0)).header
    frame = contract.load().topics['/controller/command'].frame
    assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (1, 5, frame)


def test_a_moving_obstacle_is_a_cylinder_and_an_arrow_of_one_id_and_none_deletes_all():
    still, moving = Obstacle(1, 5.0, 0.0, 0.5, 0.0, 0.0), Obstacle(2, 9.0, 1.0, 0.5, 3.0, 0.0)
    message = encode.obstacles(Obstacles(S, (still, moving)))
    assert [(m.ns, m.type, m.id, m.action) for m in message.markers] == [
        ('obstacle', Marker.CYLINDER, 1, Marker.ADD),
        ('obstacle', Marker.CYLINDER, 2, Marker.ADD),
        ('velocity', Marker.ARROW, 2, Marker.ADD),
    ]
    # viewers drop what is not sent again, four periods of 50 ms later
    assert (message.markers[0].lifetime.sec, message.markers[0].lifetime.nanosec) == (
        0,
        2 * S // 10,
    )
    assert (message.markers[0].scale.x, message.markers[0].scale.z) == (1.0, 1.0)
    assert message.markers[0].pose.position.z == 0.5
    (marker,) = encode.obstacles(Obstacles(5 * S, ())).markers
    assert (marker.action, marker.header.stamp.sec) == (Marker.DELETEALL, 5)


TOPICS = contract.load().topics


@pytest.mark.parametrize('topic', TOPICS)
def test_every_topic_has_an_example_that_obeys_the_contract_and_can_be_decoded(topic):
    message = load_example(topic)
    assert conformance.check(topic, message) == []
    if not TOPICS[topic].on_request:
        decoded(topic, message)
    name = topic.strip('/').replace('/', '-')
    head = share.path('msgs_yaml', 'examples', f'{name}.yaml').read_text().split('\n\n')[0]
    assert f'{topic} {TOPICS[topic].type} ' in head


def test_every_example_is_of_a_topic_and_holds_what_its_comment_says():
    names = {path.stem for path in share.path('msgs_yaml', 'examples').iterdir()}
    assert names == {topic.strip('/').replace('/', '-') for topic in TOPICS}
    assert decode.odometry(load_example('/vehicle/odometry')).psi == pytest.approx(0.1, abs=1e-12)
    path = decode.reference(load_example('/scenario/reference'))
    assert (path.X.tolist(), path.t.tolist()) == ([0.0, 10.0, 20.0], [0.0, 0.5, 1.0])
    seen = decode.obstacles(load_example('/scenario/obstacles')).items
    assert seen[:2] == (
        Obstacle(1, 50.0, 0.5, 0.5, 0.0, 0.0),
        Obstacle(2, 90.0, 2.0, 0.8, -5.0, 0.0),
    )
    across = [(disc.X, disc.Y, disc.r_obs) for disc in seen[2].discs()]
    assert across == [pytest.approx(place) for place in ((120, -1.3, 1), (120, 1.3, 1))]
    (keeps, turns) = decode.predictions(load_example('/scenario/predictions')).by_id[2]
    assert (keeps.probability, turns.probability) == (0.75, 0.25)
    assert (turns.t.tolist(), turns.X.tolist(), turns.Y.tolist()) == ([0, 2], [90, 80], [2, 0])
    assert turns.covariance[1].tolist() == [[0.25, 0.0], [0.0, 0.25]]
    assert decode.clock(load_example('/clock')) == 1_050_000_000
    assert decode.why(load_example('/controller/why')).values['solver.iterations'] == 7


COLUMNS = '    columns:\n'
LINE = f'column: roll_rate_radps}}\n{COLUMNS}'
AZ = 'linear_acceleration.z: {symbol: az, unit: m/s^2, low: -9, high: 9, column: az_mps2}'


class ImuWithAz(NamedTuple):
    stamp_ns: int
    ax: float
    ay: float
    r: float
    p: float
    az: float


@pytest.fixture
def read_contract(tmp_path, monkeypatch):
    """Return read_contract(old, new): let every module read the contract with this change."""
    cached = (flat_fields.load, conformance._checks)

    def read(old, new):
        path = tmp_path / 'topics.yaml'
        path.write_text(share.path('msgs_yaml', 'topics.yaml').read_text().replace(old, new))
        other = contract.read_contract(path)
        monkeypatch.setattr(contract, 'load', lambda: other)
        for function in cached:
            function.cache_clear()

    yield read
    monkeypatch.undo()
    for function in cached:
        function.cache_clear()


def test_a_new_number_costs_lines_in_topics_yaml_and_its_type(read_contract, monkeypatch):
    new = f'      {AZ}\n{COLUMNS}      az_mps2: {{meaning: upwards}}\n'
    read_contract(LINE, LINE.replace(COLUMNS, new))
    with pytest.raises(ContractError, match=r'/vehicle/imu: .* ax, ay, r, p, az; Imu others'):
        flat_fields.load(IMU)
    monkeypatch.setitem(flat_fields.TYPES, IMU, ImuWithAz)
    value = ImuWithAz(1_000_000_000, 1.0, 2.0, 0.5, 0.1, 3.0)
    message = encode.imu(value)
    assert message.linear_acceleration.z == 3.0
    assert ros.deserialize(IMU, flat_fields.load(IMU).fill(value)) == message
    assert decode.imu(message) == value
    assert flat_fields.load(IMU).columns['az_mps2'] == ('linear_acceleration.z',)
    with pytest.raises(decode.DecodeError, match=r'linear_acceleration.z \(az\) is 9.5'):
        decode.imu(encode.imu(value._replace(az=9.5)))


@pytest.mark.parametrize(('letters', 'fits'), [(3, True), (4, False), (11, True)])
def test_serialised_paths_have_the_frame_of_the_contract(read_contract, letters, fits):
    frame = 'earth_fixed'[:letters]
    read_contract('frame: map', f'frame: {frame}')
    if not fits:
        with pytest.raises(ContractError, match="the frame 'eart' has 4 characters; allowed 3, 11"):
            runpy.run_path(raw_scenario.__file__)
        return
    message = encode.reference(long_paths.path(3))
    raw = ros.serialize(message)
    read = runpy.run_path(raw_scenario.__file__)['read_reference']
    assert frame.encode() in raw
    assert long_paths.are_equal(read(raw), decode.reference(message))
    assert read(raw.replace(frame.encode(), b'x' * letters)) is None


def test_a_field_of_two_numbers_is_an_error(read_contract, monkeypatch):
    read_contract('symbol: ay, unit: m/s^2, low: -100, high: 100, column: ay_mps2', TWO)
    without_ay = type('Imu', (), {'_fields': ('stamp_ns', 'ax', 'r', 'p')})
    monkeypatch.setitem(flat_fields.TYPES, IMU, without_ay)
    with pytest.raises(ContractError, match='the value ax has 2 fields; allowed 1 or 4'):
        flat_fields.load(IMU)


TWO = 'symbol: ay, value: ax, unit: m/s^2, low: -100, high: 100, column: ax_mps2'
