"""A new number of a message costs a line in topics.yaml and one in its type."""

from typing import NamedTuple

import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu as ImuMessage

from msgs_yaml import cdr_templates, conformance, contract, decode, encode, flat_fields, share
from msgs_yaml.contract import ContractError
from msgs_yaml.types import Imu, VehicleState

TOPIC = '/vehicle/imu'
LINE = '      angular_velocity.z: {symbol: r,'
NEW_LINE = (
    '      linear_acceleration.z: {symbol: az, unit: m/s^2, low: -9, high: 9, column: az_mps2}\n'
)


class ImuWithAz(NamedTuple):
    stamp_ns: int
    ax: float
    ay: float
    az: float
    r: float
    p: float


@pytest.fixture
def read_contract(tmp_path, monkeypatch):
    """Return read_contract(text): let every module read this contract."""
    cached = (flat_fields.load, conformance._checks)

    def read(text):
        path = tmp_path / 'topics.yaml'
        path.write_text(text)
        other = contract.load(path)
        monkeypatch.setattr(contract, 'load', lambda: other)
        for function in cached:
            function.cache_clear()

    yield read
    monkeypatch.undo()
    for function in cached:
        function.cache_clear()


@pytest.fixture
def topics():
    return share.path('msgs_yaml', 'topics.yaml').read_text()


@pytest.mark.parametrize('topic', flat_fields.TYPES)
def test_contract_and_type_have_the_same_fields(topic):
    fields = flat_fields.load(topic)
    assert fields.kind is flat_fields.TYPES[topic]
    assert len(fields.columns) == len(fields.kind._fields) - 1
    assert sorted(path for group in fields.columns.values() for path in group) == sorted(
        fields.paths
    )


def test_a_new_number_is_in_messages_templates_values_and_columns(
    topics, read_contract, monkeypatch
):
    read_contract(topics.replace(LINE, NEW_LINE + LINE))
    monkeypatch.setitem(flat_fields.TYPES, TOPIC, ImuWithAz)
    value = ImuWithAz(1_000_000_000, 1.0, 2.0, 3.0, 0.5, 0.1)
    message = encode.imu(value)
    assert message.linear_acceleration.z == 3.0
    assert deserialize_message(cdr_templates.Template(TOPIC).fill(value), ImuMessage) == message
    assert decode.imu(message) == value
    assert flat_fields.load(TOPIC).columns['az_mps2'] == ('linear_acceleration.z',)
    with pytest.raises(decode.DecodeError, match=r'linear_acceleration.z \(az\) is 9.5'):
        decode.imu(encode.imu(value._replace(az=9.5)))


def test_a_type_without_a_field_of_the_contract_is_an_error(topics, read_contract):
    read_contract(topics.replace(LINE, NEW_LINE + LINE))
    with pytest.raises(ContractError, match=r'/vehicle/imu: .* ax, ay, az, r, p; Imu others'):
        flat_fields.load(TOPIC)


def test_a_field_of_two_numbers_is_an_error(topics, read_contract, monkeypatch):
    text = topics.replace('symbol: ay,', 'symbol: ay, value: ax,').replace('ay_mps2', 'ax_mps2')
    read_contract(text)
    without_ay = type('Imu', (), {'_fields': ('stamp_ns', 'ax', 'r', 'p')})
    monkeypatch.setitem(flat_fields.TYPES, TOPIC, without_ay)
    with pytest.raises(ContractError, match='the value ax has 2 fields; allowed 1 or 4'):
        flat_fields.load(TOPIC)


def test_a_value_without_a_column_is_an_error_with_its_line(topics, read_contract):
    with pytest.raises(ContractError, match=r'topics.yaml:\d+: .*: value needs a column'):
        read_contract(
            topics.replace(', column: az_mps2', '').replace('column: ax_mps2', 'value: ax')
        )


def test_numbers_and_value_are_inverse_up_to_the_rounding_of_a_heading():
    state = VehicleState(5, 1.0, 2.0, 0.3, 20.0, -0.1, 0.2)
    fields = flat_fields.load('/vehicle/odometry')
    assert len(fields.to_numbers(state)) == len(fields.paths) == 7
    assert fields.to_value(5, encode.odometry(state)) == pytest.approx(state, abs=1e-15)
    assert repr(fields) == 'FlatFields(VehicleState, 7 numbers)'
    assert repr(flat_fields.load(TOPIC)) == f'FlatFields({Imu.__name__}, 4 numbers)'
