"""Every topic and field that a layout names exists in the messages of a drive made just now."""

import json
import re
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
import yaml
from example_messages import encoded

from bags import markers_node
from experiments import simulation
from msgs_yaml import contract, flat_fields, share
from msgs_yaml.types import Health

FOXGLOVE, PLOTJUGGLER, RVIZ = 'foxglove.json', 'plotjuggler.xml', 'ring.rviz'
RVIZ_TYPES = {
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'rviz_default_plugins/Path': 'nav_msgs/msg/Path',
    'rviz_default_plugins/Odometry': 'nav_msgs/msg/Odometry',
}
JOINT_ARRAYS = ('position', 'velocity', 'effort')


def text(name):
    return share.path('bags', 'viewers', name).read_text()


@pytest.fixture(scope='module')
def messages():
    """Return a message of every topic, of the middle of a drive of the default controller."""
    setup = simulation.prepare('double_lane_change', 'mpcc')
    result = {'/diagnostics': encoded('/diagnostics', Health(1, 'plant', 0, 'ok', {}))}
    for topic, table in simulation.run(setup).items():
        k = len(table.stamp_ns) // 2
        if topic in flat_fields.TYPES:
            _, _, *fields = (column[k] for column in table)
            plain = [tuple(f.tolist()) if f.ndim else float(f) for f in fields]
            value = flat_fields.TYPES[topic](int(table.stamp_ns[k]), *plain)
        else:
            value = table.values[k]
        result[topic] = encoded(topic, value)
    return result


def resolve(message, path):
    """Follow a Foxglove path: fields, [index], [:], {key=="value"}; return what it leads to."""
    result = [message]
    for name, index, key, value in re.findall(r'\.(\w+)|\[(\d+|:)\]|\{(\w+)==\"([^\"]*)\"\}', path):
        if name:
            result = [getattr(item, name) for item in result]
        elif index == ':':
            result = [element for item in result for element in item]
        elif index:
            result = [item[int(index)] for item in result]
        else:
            result = [item for item in result if getattr(item, key) == value]
    return result


def foxglove_paths():
    for panel, config in json.loads(text(FOXGLOVE))['configById'].items():
        for path in config.get('paths', ()):
            yield pytest.param(path['value'], path['label'], id=f'{panel} {path["label"]}')


@pytest.mark.parametrize(('path', 'label'), foxglove_paths())
def test_foxglove_plots_what_a_drive_has(messages, path, label):
    topic, fields = re.fullmatch(r'(/[\w/]+)(\..*)', path).groups()
    assert re.fullmatch(r'(\.\w+|\[(\d+|:)\]|\{\w+=="[^"]*"\})+', fields)
    message = messages[topic]
    (value,) = resolve(message, fields)
    assert isinstance(float(value), float)
    joint = re.fullmatch(r'\.(\w+)\[(\d+)\]', fields)
    if joint:
        assert joint[1] in JOINT_ARRAYS
        assert message.name[int(joint[2])] == label
        assert f'{joint[1]}[{label}]' in contract.load().topics[topic].fields


def test_foxglove_shows_topics_of_the_contract_in_panels_that_exist():
    layout = json.loads(text(FOXGLOVE))
    shown = layout['configById']['3D!road']['topics']
    assert {markers_node.VEHICLE, markers_node.SAFETY, markers_node.PREDICTION} <= set(shown)
    topics = contract.load().topics
    assert set(shown) <= set(topics)
    for config in layout['configById'].values():
        assert config.get('topicToRender', '/diagnostics') in topics

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node['first']) + leaves(node['second'])

    assert sorted(leaves(layout['layout'])) == sorted(layout['configById'])
    frames = {layout['configById']['3D!road'][key] for key in ('fixedFrame', 'followTf')}
    odometry = topics['/vehicle/odometry']
    assert frames == {odometry.frame, odometry.child_frame}


def series(topic, message):
    """Return the names of the numbers of a message as PlotJuggler's parser of ROS 2 calls them."""
    if hasattr(message, 'status'):
        return {
            '/'.join((topic, item.hardware_id, item.name, pair.key))
            for item in message.status
            for pair in item.values
        }
    if hasattr(message, 'name'):
        return {f'{topic}/{name}/{array}' for name in message.name for array in JOINT_ARRAYS}
    return set(_numbers(topic, message))


def _numbers(prefix, message):
    if isinstance(message, (int, float)):
        yield prefix
    for name in getattr(message, 'get_fields_and_field_types', dict)():
        yield from _numbers(f'{prefix}/{name}', getattr(message, name))


def test_plotjuggler_plots_what_a_drive_has(messages):
    known = set().union(*(series(topic, message) for topic, message in messages.items()))
    curves = [item.get('name') for item in ElementTree.fromstring(text(PLOTJUGGLER)).iter('curve')]
    assert len(curves) > 5
    assert set(curves) <= known, set(curves) - known


def test_rviz_shows_topics_of_the_contract_and_takes_what_is_offered():
    config = yaml.safe_load(text(RVIZ))['Visualization Manager']
    topics = contract.load().topics
    assert config['Global Options']['Fixed Frame'] == topics['/vehicle/odometry'].frame
    shown = [item for item in config['Displays'] if 'Topic' in item]
    assert {markers_node.VEHICLE, markers_node.SAFETY, markers_node.PREDICTION} <= {
        item['Topic']['Value'] for item in shown
    }
    for item in shown:
        topic = topics[item['Topic']['Value']]
        assert RVIZ_TYPES[item['Class']] == topic.type
        wanted = SimpleNamespace(
            reliable=item['Topic']['Reliability Policy'] == 'Reliable',
            latched=item['Topic']['Durability Policy'] == 'Transient Local',
        )
        for qos in topic.qos.values():
            assert qos.reliability == 'reliable' or not wanted.reliable, topic.name
            assert (qos.durability == 'transient_local') == wanted.latched, topic.name
