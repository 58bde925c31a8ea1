"""A bag is followed while it grows."""

import math

import numpy as np
import pytest

from bags.storage import message_filing
from bags.storage.bag_writer import BagWriter
from experiments.run.live_position import LivePosition, PositionReader
from msgs_yaml import contract, encode
from msgs_yaml.types import VehicleState
from node_runtime import ros

REFERENCE = np.array([[0.0, 0.0], [500.0, 0.0]])
TOPICS = [message_filing.bag_topic(t, 'lockstep') for t in contract.load().topics.values()]
STATE = [topic.name for topic in TOPICS].index('/vehicle/odometry')


@pytest.fixture
def bag(tmp_path):
    """Return the writer of a bag that grows."""
    writer = BagWriter(tmp_path / 'bag', TOPICS, {})
    yield writer
    writer.close()


def record(bag, *times_ms, length=None, vx=16.0):
    """Write a chunk of states at 20 m/s, cut to a length in bytes where given."""
    for ms in times_ms:
        stamp_ns = (1000 + ms) * 1_000_000
        state = encode.odometry(VehicleState(stamp_ns, 0.02 * ms, 1.0, 0.0, 16.0, 12.0, 0.0))
        state.twist.twist.linear.x = vx
        bag.write(STATE, stamp_ns, stamp_ns, ros.serialize(state)[:length])
    bag.flush()


def test_each_poll_gives_the_position_at_the_end_of_the_last_chunk(bag, tmp_path):
    assert PositionReader(tmp_path / 'later', REFERENCE).poll() is None
    reader = PositionReader(tmp_path / 'bag', REFERENCE)
    assert reader.poll() is None
    record(bag, *range(1001))
    assert reader.poll() == pytest.approx(LivePosition(t=1.0, station=20.0, speed=20.0))
    assert reader.poll() is None
    record(bag, *range(1001, 1501))
    record(bag, *range(1501, 2001))
    assert reader.poll() == pytest.approx(LivePosition(t=2.0, station=40.0, speed=20.0))


@pytest.mark.parametrize(
    'damage', [{'length': 0}, {'length': 3}, {'length': 30}, {'length': 150}, {'vx': math.nan}]
)
def test_a_state_that_is_torn_or_breaks_the_contract_is_ignored(bag, tmp_path, damage):
    reader = PositionReader(tmp_path / 'bag', REFERENCE)
    seen = []
    for ms, how in ((0, {}), (1000, damage), (2000, {})):
        record(bag, ms, **how)
        seen.append(reader.poll())
    assert [sight is None for sight in seen] == [False, True, False]


def test_half_a_chunk_is_left_for_the_next_poll(bag, tmp_path):
    record(bag, *range(501))
    record(bag, *range(501, 1001))
    whole = (tmp_path / 'bag/bag_0.mcap').read_bytes()
    growing = tmp_path / 'growing/growing_0.mcap'
    growing.parent.mkdir()
    reader = PositionReader(growing.parent, REFERENCE)
    seen = []
    for size in (*range(0, len(whole), 997), len(whole)):
        growing.write_bytes(whole[:size])
        seen.append(reader.poll())
    assert [sight.station for sight in seen if sight] == pytest.approx([10.0, 20.0])
