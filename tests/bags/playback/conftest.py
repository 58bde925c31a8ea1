"""Bags made by hand, of messages that are numbers only."""

import pytest

from bags.storage import read
from bags.storage.bag_writer import BagWriter
from bags.storage.rosbag2_metadata import BagTopic, qos_text

MS = 1_000_000
START_NS = 5_000_000_000
LATCHED = qos_text('keep_last', 1, 'reliable', 'transient_local')
PLAIN = qos_text('keep_last', 5, 'best_effort', 'volatile')


@pytest.fixture
def make_bag(tmp_path):
    """make({topic: [ms of each message]}, latched=[topic]) -> Bag; each payload names itself."""

    def make(times, latched=()):
        topics = [
            BagTopic(n, 'std_msgs/msg/String', 'string data\n', '', (PLAIN, LATCHED)[n in latched])
            for n in times
        ]
        writer = BagWriter(tmp_path / 'bag', topics, {})
        for index, (name, each) in enumerate(times.items()):
            for i, ms in enumerate(each):
                writer.write(index, START_NS + round(ms * MS), 1, f'{name}{i}'.encode(), i + 1)
        writer.close()
        return read.load(tmp_path / 'bag')

    return make
