"""Whatever was published comes back out of the bag, bit for bit."""

import time

import numpy as np
import pytest

from bags.errors import BagError, DamagedBagWarning
from bags.storage import read
from bags.storage.bag_writer import BagWriter
from bags.storage.columns import TOPICS, names
from msgs_yaml import conversions, types


def fields_as_received(value):
    """Return the fields of a value after its stamp, with the heading of a receiver."""
    if isinstance(value, types.VehicleState):
        value = conversions.odometry_as_received(value)
    _, *fields = value
    return fields


def assert_equal(found, sent):
    """Compare values of msgs_yaml.types, arrays and tuples inside them included."""
    if isinstance(sent, tuple):
        assert len(found) == len(sent)
        for item, other in zip(found, sent):
            assert_equal(item, other)
    elif isinstance(sent, np.ndarray):
        np.testing.assert_allclose(found, sent, rtol=0.0, atol=1e-9)
    else:
        assert found == sent


@pytest.mark.parametrize('topic', TOPICS)
def test_columns_are_the_published_numbers_to_the_last_bit(bag_folder, messages, topic):
    table = read.columns(bag_folder)[topic]
    assert table.stamp_ns.tolist() == [value.stamp_ns for value in messages[topic]]
    expected = zip(*map(fields_as_received, messages[topic]))
    for name, column in zip(names(topic)[2:], expected, strict=True):
        np.testing.assert_array_equal(getattr(table, name), np.array(column), err_msg=name)


def test_values_of_every_topic_are_the_published_ones(bag_folder, messages):
    bag = read.load(bag_folder)
    for topic, sent in messages.items():
        result = read.values(bag, topic)
        assert len(result) == len(sent)
        for item, other in zip(result, sent):
            if topic == '/vehicle/odometry':
                other = other._replace(psi=conversions.heading_as_received(other.psi))
            assert_equal(item, other)


def test_time_is_counted_from_the_first_state_on_every_topic(bag_folder):
    columns = read.columns(bag_folder)
    for topic, table in columns.items():
        assert table.t_s[0] == 0.0, topic
    np.testing.assert_allclose(np.diff(columns['/vehicle/imu'].t_s), 0.01, atol=1e-12)


def test_only_the_topics_asked_for_are_read(bag_folder):
    assert list(read.columns(bag_folder, ['/clock'])) == ['/clock']
    assert hasattr(read.columns(bag_folder, ['/clock'])['/clock'], 'values')


def test_facts_of_the_run_come_back_as_text(bag_folder):
    assert read.run_info(bag_folder) == {
        'scenario': 'double_lane_change',
        'parameters': '{"N": 50}',
        'namespace': '/',
    }


def test_missing_topic_is_refused_with_the_names_that_are_there(bag_folder):
    with pytest.raises(BagError, match=r'no message of /tf; it has /scenario/reference, .*/clock'):
        read.columns(bag_folder, ['/tf'])
    with pytest.raises(BagError, match='no message of /tf'):
        read.values(bag_folder, '/tf')


def test_what_is_no_bag_is_refused_by_name(tmp_path):
    with pytest.raises(BagError, match='no such bag'):
        read.load(tmp_path / 'nothing')
    with pytest.raises(BagError, match=r'must hold one file \*\.mcap, or .* it holds none'):
        read.load(tmp_path)
    (tmp_path / 'mpcc_road').mkdir()
    (tmp_path / 'mpcc_road' / 'mpcc_road_0.mcap').touch()
    road = str(tmp_path / 'mpcc_road')
    expected = f"mpc_road: there is no such bag; .* holds mpcc_road; did you mean '{road}'"
    with pytest.raises(BagError, match=expected):
        read.load(tmp_path / 'mpc_road')
    with pytest.raises(BagError, match=r'is no bag, but holds some; give one of them: mpcc_road$'):
        read.load(tmp_path)
    text = tmp_path / 'notes.mcap'
    text.write_text('not a recording')
    with pytest.raises(BagError, match='does not begin as an MCAP file'):
        read.load(text)
    text.write_bytes(b'')
    with pytest.raises(BagError, match='the file is empty'):
        read.load(text)


def test_bag_without_a_message_is_refused(tmp_path, bag_folder):
    topics = [recorded.topic for recorded in read.load(bag_folder).recordings.values()]
    BagWriter(tmp_path / 'bag', topics, {}).close()
    with pytest.raises(BagError, match='holds no message'):
        read.load(tmp_path / 'bag')


def test_truncated_bag_is_read_up_to_the_damage_and_says_so(tmp_path, bag_folder):
    whole = (bag_folder / 'mpcc_0.mcap').read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[:-100])
    with pytest.warns(DamagedBagWarning, match=r'damaged at byte \d+ .*`bags repair'):
        bag = read.load(cut)
    assert len(bag.recordings['/vehicle/odometry'].payloads) == 1000
    assert 'cut off' in bag.damage


def test_state_sent_again_while_it_waits_for_an_answer_is_one_row(tmp_path, bag_folder):
    recordings = read.load(bag_folder).recordings
    first, second = recordings['/vehicle/odometry'].payloads[:2]
    writer = BagWriter(tmp_path / 'bag', [recordings['/vehicle/odometry'].topic], {})
    for data in (first, first, first, second):
        writer.write(0, 1, 1, data)
    writer.close()
    table = read.columns(tmp_path / 'bag')['/vehicle/odometry']
    assert table.stamp_ns.tolist() == [1_000_000_000, 1_001_000_000]
    assert len(read.values(tmp_path / 'bag', '/vehicle/odometry')) == 4


def test_message_that_breaks_the_contract_is_named(tmp_path, bag_folder):
    recordings = read.load(bag_folder).recordings
    writer = BagWriter(tmp_path / 'bag', [recordings['/controller/why'].topic], {})
    writer.write(0, 1, 1, recordings['/controller/why'].payloads[0][:40])
    writer.close()
    with pytest.raises(BagError, match=r'message 0 of /controller/why: .* do not fit'):
        read.columns(tmp_path / 'bag')


def test_a_minute_at_full_rate_is_read_in_six_seconds(tmp_path, bag_folder):
    recordings = {n: r for n, r in read.load(bag_folder).recordings.items() if r.payloads}
    writer = BagWriter(tmp_path / 'bag', [r.topic for r in recordings.values()], {})
    written = 0
    for second in range(105):
        for index, recorded in enumerate(recordings.values()):
            ahead = second * conversions.NS_PER_S
            for log_ns, data in zip(recorded.log_ns.tolist(), recorded.payloads):
                sec = int.from_bytes(data[4:8], 'little') + second
                if not recorded.topic.type.endswith('MarkerArray'):
                    data = data[:4] + sec.to_bytes(4, 'little') + data[8:]
                writer.write(index, log_ns + ahead, log_ns + ahead, data)
                written += 1
    writer.close()
    assert written >= 240_000
    began = time.process_time()
    columns = read.columns(tmp_path / 'bag')
    assert time.process_time() - began <= 6.0
    assert columns['/vehicle/odometry'].t_s[-1] == pytest.approx(104.999)
    assert isinstance(columns['/controller/why'].values[-1], types.Why)
