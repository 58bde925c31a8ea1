"""Bookkeeping of a recorder: which time a message is filed under, and what was lost."""

from collections.abc import Callable

from bags.errors import BagError
from bags.storage import definitions, losses, stamps
from bags.storage.rosbag2_layout import BagTopic, qos_text
from msgs_yaml.contract import Contract
from msgs_yaml.decode import DecodeError
from msgs_yaml.stamp import NS_PER_S

LOCKSTEP = 'lockstep'
# by how much the time of a topic may fall back: DDS may deliver what it had to send again late
SLACK_NS = {LOCKSTEP: 0, 'realtime': 100_000_000}


def bag_topics(contract: Contract, mode: str) -> list[BagTopic]:
    """Return every topic of the contract as a bag describes it, in the order of the contract."""
    return [
        BagTopic(
            name=topic.name,
            type=topic.type,
            schema=definitions.schema_text(topic.type),
            type_hash=definitions.type_hash(topic.type),
            qos=_qos(topic.qos[mode]),
        )
        for topic in contract.topics.values()
    ]


def _qos(qos):
    deadline_ns = None if qos.deadline_ms is None else round(qos.deadline_ms * 1e6)
    return qos_text(qos.history, qos.depth, qos.reliability, qos.durability, deadline_ns)


class ClockError(BagError):
    """A clock was set back while it was recorded."""


class Filing:
    """Files the messages of one topic: into a bag, under the right time."""

    def __init__(
        self,
        topic: BagTopic,
        mode: str,
        write: Callable[[int, int, bytes, int], None],
        alone: bool = True,
    ):
        """`alone`: the topic has one publisher, so its time never falls back."""
        self.counter = losses.Counter()
        self._topic, self._mode, self._alone = topic, mode, alone
        self._write = write
        self._stamp_ns = stamps.reader(topic.type) if mode == LOCKSTEP else None
        self._last_log_ns = 0

    def put(self, data: bytes, source_ns: int, received_ns: int, sequence: int | None):
        """File one message under its stamp (lockstep) or its time of arrival (realtime).

        `source_ns` and `sequence` are the publisher's, 0 and None where the middleware knows none.
        Raises ClockError, and files nothing, when that time has fallen back.
        """
        log_ns = received_ns if self._stamp_ns is None else self._stamped(data)
        if self._alone and log_ns < self._last_log_ns - SLACK_NS[self._mode]:
            raise self._fell_back(log_ns)
        self._last_log_ns = log_ns
        self.counter.add(sequence)
        self._write(log_ns, source_ns or log_ns, data, sequence or 0)

    def _stamped(self, data):
        """Return the stamp, the last one where there is none; a bag holds nothing before 1970."""
        try:
            return max(self._stamp_ns(data), 0)
        except DecodeError:
            return self._last_log_ns

    def _fell_back(self, log_ns):
        before, now = self._last_log_ns / NS_PER_S, log_ns / NS_PER_S
        cause = (
            'was the plant started again, or are there two?'
            if self._mode == LOCKSTEP
            else 'the clock of the machine was set back'
        )
        return ClockError(
            f'{self._topic.name}: the clock jumped backwards from {before:.9f} s to {now:.9f} s: '
            f'{cause}'
        )
