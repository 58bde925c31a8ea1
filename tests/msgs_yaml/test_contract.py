"""topics.yaml is read strictly: every mistake stops the reader and names line and key."""

from pathlib import Path

import pytest

from msgs_yaml import contract, share
from msgs_yaml.contract import ContractError

LINES = (Path(__file__).parent / 'small_contract.yaml').read_text().splitlines()


def write(tmp_path, lines):
    path = tmp_path / 'topics.yaml'
    path.write_text('\n'.join(lines) + '\n')
    return path


def test_what_is_written_is_what_is_read(tmp_path):
    topics = contract.load(write(tmp_path, LINES)).topics
    odometry = topics['/vehicle/odometry']
    assert (odometry.type, odometry.publisher) == ('nav_msgs/msg/Odometry', 'plant')
    assert odometry.rate_hz == {'lockstep': 1000, 'realtime': 100}
    assert (odometry.frame, odometry.child_frame) == ('map', 'base_link')
    assert odometry.qos['lockstep'].history == 'keep_all'
    assert odometry.qos['realtime'] == contract.Qos(
        'reliable', 'transient_local', 'keep_last', 1, None
    )
    assert odometry.profiles['realtime'] == 'latched'
    vx = odometry.fields['twist.twist.linear.x']
    assert vx == contract.Field('vx', 'm/s', -20.0, 120.0)
    assert topics['/scenario/reference'].sizes == {'poses': contract.Size(2, 5000)}
    assert topics['/scenario/reference'].child_frame is None


def test_joints_stand_in_the_order_of_their_first_use(tmp_path):
    topics = contract.load(write(tmp_path, LINES)).topics
    assert topics['/vehicle/actuators'].joints == ('steer', 'front_axle')
    assert topics['/vehicle/odometry'].joints == ()


MISTAKES = [
    # line, replacement, the error
    (
        2,
        '  latched: {reliability: reliable}',
        r':2: profiles.latched.durability: is missing; allowed vol',
    ),
    (
        3,
        LINES[2].replace('reliable', 'sure'),
        r":3: profiles.all.reliability: is 'sure'; allowed reliable or",
    ),
    (3, LINES[2].replace('keep_all', 'keep_last'), ':3: profiles.all: depth belongs to keep_last'),
    (3, LINES[2].replace('keep_all', 'keep_all, depth: 3'), ':3: profiles.all: depth belongs'),
    (2, LINES[1].replace('depth: 1', 'depth: 0'), ':2: profiles.latched.depth: is 0; allowed 1 to'),
    (
        2,
        LINES[1].replace('depth: 1', 'depth: 1, deadline_ms: -5'),
        ':2: .*deadline_ms: is -5; allowed',
    ),
    (2, LINES[1].replace('depth: 1', 'depth: 1, depth: 2'), ':2: .*latched.depth: appears twice'),
    (5, '  vehicle/odometry:', ':5: topics.vehicle/odometry: allowed a leading /'),
    (6, '    meanig: Motion.', r":6: .*odometry.meanig: unknown key; did you mean 'meaning'\?"),
    (7, '    type: nav_msgs/msg/Odometer', r":7: .*type: .* did you mean 'nav_msgs/msg/Odometry'"),
    (8, "    publisher: ''", ":8: .*odometry.publisher: is ''; allowed a text"),
    (8, '    publisher: 7', ':8: .*odometry.publisher: must be a text, is 7'),
    (9, '    rate_hz: {lockstep: 1000}', ":9: .*rate_hz: key 'realtime' is missing"),
    (9, '    rate_hz: {lockstep: -1, realtime: 1}', ':9: .*rate_hz.lockstep: is -1; allowed 0 to'),
    (9, '    rate_hz: 1000', ":9: .*rate_hz: must be a mapping, is '1000'"),
    (10, '    frame: 3', ':10: .*frame: must be a text, is 3'),
    (12, '    qos: {lockstep: al, realtime: latched}', ":12: .*did you mean 'all'"),
    (14, LINES[13].replace('m/s', 'km/h'), ":14: .*linear.x.unit: is 'km/h'; allowed m or"),
    (14, LINES[13].replace('-20', '200'), ':14: .*linear.x: low 200.0 is above high 120.0'),
    (14, LINES[13].replace('-20', '.nan'), ':14: .*linear.x.low: must be finite, is .nan'),
    (14, LINES[13].replace('-20', 'true'), ':14: .*linear.x.low: must be a number, is true'),
    (14, LINES[13].replace('low: -20, ', ''), ':14: .*linear.x: low belongs to a number, and a n'),
    (14, LINES[13].replace('unit: m/s', 'unit: word'), ':14: .*linear.x: low belongs to a number'),
    (14, LINES[13].replace('.linear', '..linear'), ':14: .*is no field path'),
    (15, '  /vehicle/odometry:', ':15: topics./vehicle/odometry: appears twice'),
    (23, '      poses: [5000, 2]', ':23: .*sizes.poses: least 5000 is above most 2'),
    (23, '      poses: [2]', r':23: .*sizes.poses: has 1 elements; allowed exactly 2'),
    (23, '      poses: 2', ":23: .*sizes.poses: must be a list, is '2'"),
    (34, LINES[33].replace('[steer]', ''), ':34: .*JointState is written as'),
    (34, LINES[33].replace('[steer]', '[*]'), ':34: .*JointState is written as'),
    (4, 'topic:', ":4: topic: unknown key; did you mean 'topics'"),
    (4, 'topics: [', r':\d+: no valid YAML'),
    (8, '    [a, b]: plant', ':8: topics./vehicle/odometry: a key must be one word'),
]


@pytest.mark.parametrize(('line', 'text', 'error'), MISTAKES, ids=lambda value: str(value)[:40])
def test_a_mistake_is_named_with_its_line_and_key(tmp_path, line, text, error):
    path = write(tmp_path, [*LINES[: line - 1], text, *LINES[line:]])
    with pytest.raises(ContractError, match=error) as caught:
        contract.load(path)
    assert str(caught.value).startswith(f'{path}:')


def test_a_profile_that_nothing_uses_is_a_mistake(tmp_path):
    extra = '  spare: {reliability: reliable, durability: volatile, history: keep_all}'
    with pytest.raises(ContractError, match=r':4: profiles.spare: no topic uses this profile'):
        contract.load(write(tmp_path, [*LINES[:3], extra, *LINES[3:]]))


@pytest.mark.parametrize('text', ['', '# nothing\n', '\x00'])
def test_an_empty_or_broken_file_is_named(tmp_path, text):
    path = tmp_path / 'topics.yaml'
    path.write_text(text)
    with pytest.raises(ContractError, match=r'topics\.yaml:1: (the file is empty|no valid YAML)'):
        contract.load(path)


def test_the_shipped_contract_names_every_topic_of_the_ring():
    assert set(contract.load().topics) == {
        '/scenario/reference',
        '/scenario/road_edges',
        '/scenario/obstacles',
        '/vehicle/odometry',
        '/vehicle/actuators',
        '/vehicle/imu',
        '/vehicle/wheels',
        '/vehicle/run_start',
        '/controller/command',
        '/controller/prediction',
        '/controller/why',
        '/diagnostics',
        '/markers/vehicle',
        '/markers/safety',
        '/markers/prediction',
        '/clock',
    }
    assert contract.load() is contract.load()
    assert contract.load(share.path('msgs_yaml', 'topics.yaml')) == contract.load()


def test_what_others_derive_is_found_but_is_no_topic_of_the_ring():
    shipped = contract.load()
    nodes = ('scenario', 'controller', 'plant', 'recorder')
    assert set(shipped.derived) == {
        *('/tf', '/tf_static', '/robot_description', '/rosout'),
        *(f'/{node}/transition_event' for node in nodes),
    }
    assert shipped.find('/tf').type == 'tf2_msgs/msg/TFMessage'
    assert shipped.find('/clock') is shipped.topics['/clock']
    assert not shipped.derived.keys() & shipped.topics.keys()
    with pytest.raises(KeyError):
        shipped.find('/map')


DERIVED = """
derived:
  /tf:
    meaning: Frames.
    type: tf2_msgs/msg/TFMessage
    publisher: plant
    rate_hz: {lockstep: 50, realtime: 50}
    frame: map
    qos: {lockstep: all, realtime: all}
""".splitlines()[1:]


def test_a_derived_topic_has_no_fields_and_a_type_of_its_own(tmp_path):
    derived = contract.load(write(tmp_path, [*LINES, *DERIVED])).derived['/tf']
    assert (derived.fields, derived.sizes, derived.rate_hz['realtime']) == ({}, {}, 50)
    wrong = [line.replace('tf2_msgs/msg/TFMessage', 'nav_msgs/msg/Path') for line in DERIVED]
    with pytest.raises(ContractError, match=r"derived./tf.type: is 'nav_msgs/msg/Path'; "):
        contract.load(write(tmp_path, [*LINES, *wrong]))
    with pytest.raises(ContractError, match=r'derived./tf: fields belong to topics that are not'):
        contract.load(
            write(tmp_path, [*LINES, *DERIVED, '    fields: {x: {symbol: x, unit: word}}'])
        )


def test_lockstep_loses_nothing_and_facts_are_latched():
    for topic in contract.load().topics.values():
        lockstep = topic.qos['lockstep']
        assert lockstep.reliability == 'reliable', topic.name
        latched = lockstep.durability == 'transient_local'
        assert latched == (topic.name in ('/scenario/reference', '/scenario/road_edges'))
        if not latched and topic.name != '/diagnostics' and not topic.on_request:
            assert lockstep.history == 'keep_all', topic.name
        if (
            latched
        ):  # what is lost is sent again after 3 s at most; lockstep is up to 3.3 x real time
            assert lockstep.depth >= 3.0 * 3.3 * topic.rate_hz['lockstep']


def test_realtime_state_may_be_lost_but_a_command_may_not():
    topics = contract.load().topics
    assert topics['/vehicle/odometry'].qos['realtime'].reliability == 'best_effort'
    command = topics['/controller/command'].qos['realtime']
    assert (command.reliability, command.depth) == ('reliable', 1)
    assert command.deadline_ms > 1000.0 / topics['/controller/command'].rate_hz['realtime']


def test_every_number_has_a_unit_and_a_range():
    for topic in contract.load().topics.values():
        for path, field in topic.fields.items():
            assert field.unit in contract.UNITS, path
            assert field.unit == contract.WORD or field.low <= field.high, path
