"""A bag is followed while it grows."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from bags.storage import message_filing
from bags.storage.bag_writer import BagWriter
from experiments.run.live_position import LivePosition, PositionReader
from msgs_yaml import contract, encode
from msgs_yaml.types import VehicleState

REFERENCE = np.array([[0.0, 0.0], [500.0, 0.0]])
MS = 1_000_000


@pytest.fixture
def drive(tmp_path):
    """Return drive(from_ms, to_ms) that records states at 20 m/s, and the folder of the bag."""
    topics = message_filing.bag_topics(contract.load(), 'lockstep')
    index = [topic.name for topic in topics].index('/vehicle/odometry')
    bag = BagWriter(tmp_path / 'bag', topics, {})

    def drive(from_ms, to_ms):
        for ms in range(from_ms, to_ms):
            stamp_ns = (1000 + ms) * MS
            state = VehicleState(stamp_ns, 0.02 * ms, 1.0, 0.0, 16.0, 12.0, 0.0)
            bag.write(index, stamp_ns, stamp_ns, serialize_message(encode.odometry(state)))
        bag.flush()

    yield drive, tmp_path / 'bag'
    bag.close()


def test_each_poll_gives_the_position_at_the_end_of_the_last_chunk(drive):
    record, folder = drive
    reader = PositionReader(folder, REFERENCE)
    assert reader.poll() is None
    record(0, 1001)
    assert reader.poll() == pytest.approx(LivePosition(t=1.0, station=20.0, speed=20.0))
    assert reader.poll() is None
    record(1001, 1501)
    record(1501, 2001)
    assert reader.poll() == pytest.approx(LivePosition(t=2.0, station=40.0, speed=20.0))


def test_a_state_that_breaks_the_contract_is_ignored(tmp_path):
    topics = message_filing.bag_topics(contract.load(), 'lockstep')
    index = [topic.name for topic in topics].index('/vehicle/odometry')
    bag = BagWriter(tmp_path / 'bag', topics, {})
    reader = PositionReader(tmp_path / 'bag', REFERENCE)
    for ms, vx in ((0, 20.0), (1000, float('nan')), (2000, 20.0)):
        stamp_ns = (1000 + ms) * MS
        message = encode.odometry(VehicleState(stamp_ns, 0.02 * ms, 1.0, 0.0, 20.0, 0.0, 0.0))
        message.twist.twist.linear.x = vx
        bag.write(index, stamp_ns, stamp_ns, serialize_message(message))
        bag.flush()
        seen = reader.poll()
        assert (seen is None) == (vx != vx)
    bag.close()


@pytest.mark.parametrize('size', [0, 3, 30, 150])
def test_a_torn_state_is_ignored(tmp_path, size):
    topics = message_filing.bag_topics(contract.load(), 'lockstep')
    index = [topic.name for topic in topics].index('/vehicle/odometry')
    bag = BagWriter(tmp_path / 'torn', topics, {})
    reader = PositionReader(tmp_path / 'torn', REFERENCE)
    for ms, end in ((0, None), (1000, size), (2000, None)):
        stamp_ns = (1000 + ms) * MS
        state = encode.odometry(VehicleState(stamp_ns, 0.02 * ms, 1.0, 0.0, 20.0, 0.0, 0.0))
        bag.write(index, stamp_ns, stamp_ns, serialize_message(state)[:end])
        bag.flush()
        assert (reader.poll() is None) == (end is not None)
    bag.close()


def test_a_bag_that_does_not_exist_yet_gives_no_position(tmp_path):
    assert PositionReader(tmp_path / 'later', REFERENCE).poll() is None


def test_half_a_chunk_is_left_for_the_next_poll(drive, tmp_path):
    record, folder = drive
    record(0, 501)
    record(501, 1001)
    whole = (folder / 'bag_0.mcap').read_bytes()
    growing = tmp_path / 'growing/growing_0.mcap'
    growing.parent.mkdir()
    reader = PositionReader(growing.parent, REFERENCE)
    seen = []
    for size in range(0, len(whole), 997):
        growing.write_bytes(whole[:size])
        seen.append(reader.poll())
    growing.write_bytes(whole)
    seen.append(reader.poll())
    stations = [sight.station for sight in seen if sight]
    assert stations == pytest.approx([10.0, 20.0])
