"""topics.yaml: what is read, what is a mistake, and what the shipped file promises."""

from importlib import import_module
from pathlib import Path
from types import SimpleNamespace as Has

import pytest

from msgs_yaml import contract, field_paths, share
from msgs_yaml.contract import ContractError
from node_runtime import ros

LINES = (Path(__file__).parent / 'small_contract.yaml').read_text().splitlines()
SHIPPED = contract.load()


def load(tmp_path, lines):
    path = tmp_path / 'topics.yaml'
    path.write_text('\n'.join(lines) + '\n')
    return contract.read_contract(path)


# line, text in it, what stands there in its place, the error; test_yaml.py has those of any schema
MISTAKES = [
    (3, 'keep_all', 'keep_last', 'profiles.all: depth belongs to keep_last'),
    (3, 'keep_all', 'keep_all, depth: 3', 'profiles.all: depth belongs to keep_last'),
    (2, 'depth: 1', 'depth: 0', 'profiles.latched.depth: is 0; allowed 1 to 1e+06 messages'),
    (2, 'depth: 1', 'depth: 1, deadline_ms: -5', 'deadline_ms: is -5; allowed 0.001 to 1e+06 ms'),
    (5, '/vehicle', 'vehicle', 'topics.vehicle/odometry: allowed a leading /'),
    (7, 'Odometry', 'Odometer', "did you mean 'nav_msgs/msg/Odometry'"),
    (8, 'plant', "''", "odometry.publisher: is ''; allowed a text that is not empty"),
    (9, ', realtime: 100', '', "rate_hz: key 'realtime' is missing"),
    (9, '1000', '-1', 'rate_hz.lockstep: is -1; allowed 0 to 10000 Hz'),
    (12, 'all', 'al', "did you mean 'all'"),
    (14, '-20', '200', 'linear.x: low 200.0 is above high 120.0'),
    (14, 'low: -20, ', '', 'linear.x: low belongs to a number, and a number needs it'),
    (14, 'unit: m/s', 'unit: word', 'linear.x: low belongs to a number'),
    (14, '1.2e2', '1.2e2, value: v', 'linear.x: value needs a column'),
    (14, '1.2e2', '1.2e2, column: vx_mps', 'linear.x: vx_mps is not among the columns'),
    (14, '.linear', '..linear', 'is no field path'),
    (23, '[2, 5000]', '[5000, 2]', 'sizes.poses: least 5000 is above most 2'),
    (34, '[steer]', '', 'a field of a JointState is written as position[name]'),
    (34, '[steer]', '[*]', 'a field of a JointState is written as position[name]'),
]


@pytest.mark.parametrize(('line', 'old', 'new', 'error'), MISTAKES)
def test_a_mistake_is_named_with_its_line_and_key(tmp_path, line, old, new, error):
    changed = LINES[line - 1].replace(old, new, 1)
    with pytest.raises(ContractError) as caught:
        load(tmp_path, [*LINES[: line - 1], changed, *LINES[line:]])
    assert str(caught.value).startswith(f'{tmp_path}/topics.yaml:{line}: ')
    assert error in str(caught.value)


def replaced(lines, old, new):
    return [line.replace(old, new) for line in lines]


ODOMETRY = LINES[4:14]
DERIVED = replaced(ODOMETRY, 'nav_msgs/msg/Odometry', 'tf2_msgs/msg/TFMessage')
STATUS = replaced(LINES, 'sensor_msgs/msg/JointState', contract.DIAGNOSTICS)


@pytest.mark.parametrize(
    ('lines', 'error'),
    [
        ([*LINES[:3], LINES[2].replace('all', 'spare', 1), *LINES[3:]], ':4: profiles.spare: no t'),
        (STATUS, r'is written as status\[\*\].values\[key\].value'),
        ([*LINES, 'derived:', *ODOMETRY], r'derived./vehicle/odometry.type: is .*; allowed std'),
        ([*LINES, 'derived:', *DERIVED], 'fields belong to topics'),
    ],
)
def test_a_mistake_that_takes_several_lines_is_named(tmp_path, lines, error):
    with pytest.raises(ContractError, match=error):
        load(tmp_path, lines)


def test_the_shipped_contract_is_read_once_and_finds_topics_and_what_others_derive():
    nodes = ('scenario', 'controller', 'plant', 'estimator', 'recorder')
    events = {f'/{node}/transition_event' for node in nodes}
    assert set(SHIPPED.derived) == events | {'/tf', '/tf_static', '/robot_description', '/rosout'}
    assert SHIPPED.find('/tf').type == 'tf2_msgs/msg/TFMessage'
    assert SHIPPED.find('/clock') is SHIPPED.topics['/clock']
    with pytest.raises(KeyError):
        SHIPPED.find('/map')
    assert contract.load() is SHIPPED
    assert contract.read_contract(share.path('msgs_yaml', 'topics.yaml')) == SHIPPED


@pytest.mark.parametrize('name', SHIPPED.topics)
def test_lockstep_loses_nothing_and_facts_are_latched(name):
    topic = SHIPPED.topics[name]
    lockstep = topic.qos['lockstep']
    assert lockstep.reliability == 'reliable'
    latched = lockstep.durability == 'transient_local'
    assert latched == (name in ('/scenario/reference', '/scenario/road_edges'))
    if latched:  # what is lost is sent again after 3 s at most; lockstep is up to 3.3 x real time
        assert lockstep.depth >= 3.0 * 3.3 * topic.rate_hz['lockstep']
    elif name != '/diagnostics' and not topic.on_request:
        assert lockstep.history == 'keep_all'


def test_realtime_state_may_be_lost_but_a_command_may_not():
    assert SHIPPED.topics['/vehicle/odometry'].qos['realtime'].reliability == 'best_effort'
    topic = SHIPPED.topics['/controller/command']
    command = topic.qos['realtime']
    assert (command.reliability, command.depth) == ('reliable', 1)
    assert command.deadline_ms > 1000.0 / topic.rate_hz['realtime']


NUMBERS = ('double', 'float', 'int32', 'uint32', 'int64', 'uint8')  # the last one: packed


def end_type(cls, path):
    """Return the type name at the end of a path; fail where the message has no such field."""
    declared = None
    for step in field_paths.parse(path):
        declared = cls.get_fields_and_field_types()[step.attribute]
        is_array = declared.startswith('sequence<') or declared.endswith(']')
        assert is_array == (step.selector is not None), f'{path}: {step.attribute} is {declared}'
        declared = declared.removeprefix('sequence<').removesuffix('>').partition('[')[0]
        if '/' in declared:
            package, name = declared.split('/')
            cls = getattr(import_module(f'{package}.msg'), name)
    return declared


@pytest.mark.parametrize('name', SHIPPED.topics)
def test_every_path_exists_in_its_message_and_ends_at_a_number_of_a_range(name):
    topic, cls = SHIPPED.topics[name], ros.message_type(name)
    wanted = ('string',) if topic.type == contract.DIAGNOSTICS else NUMBERS
    for path, field in topic.fields.items():
        assert end_type(cls, path) in wanted
        assert field.unit == contract.WORD or field.low <= field.high
    for path in topic.sizes:
        end_type(cls, f'{path}[*]')
    has_child = 'child_frame_id' in cls.get_fields_and_field_types()
    assert has_child == (topic.child_frame is not None)


LEFT = Has(ns='left', points=[Has(x=1.0), Has(x=2.0)])
RIGHT = Has(ns='right', points=[Has(x=3.0)])
MESSAGE = Has(markers=[LEFT, RIGHT], pose=Has(x=7.0), status=[Has(name='a', level=1)])


@pytest.mark.parametrize(
    ('path', 'values'),
    [
        ('pose.x', [7.0]),
        ('markers', [[LEFT, RIGHT]]),
        ('markers[*].ns', ['left', 'right']),
        ('markers[*].points[*].x', [1.0, 2.0, 3.0]),
        ('markers[*ght].points[*].x', [3.0]),
        ('markers[centre].points[*].x', []),
        ('markers[right]', [RIGHT]),
        ('status[a].level', [1]),
    ],
)
def test_a_field_path_gives_every_value_it_leads_to_in_order(path, values):
    assert field_paths.getter(path)(MESSAGE) == values


@pytest.mark.parametrize('path', ['', '.', 'a..b', 'a[', 'a[]', 'A', 'a[*]b', 'a.b.', 'a b', '1'])
def test_what_is_no_field_path_is_rejected(path):
    with pytest.raises(ValueError, match='is no field path'):
        field_paths.parse(path)
