"""Bookkeeping of a recorder: which time a message is filed under, and how many were lost."""

from collections.abc import Callable

from bags.storage import definitions, stamps
from bags.storage.rosbag2_layout import BagTopic, qos_text
from msgs_yaml.contract import Contract
from msgs_yaml.decode import DecodeError

LOCKSTEP = 'lockstep'


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


class Filing:
    """Files the messages of one topic: into a bag, under the right time."""

    def __init__(self, topic: BagTopic, mode: str, write: Callable[[int, int, bytes, int], None]):
        self.lost = 0
        self._write = write
        self._stamp_ns = stamps.reader(topic.type) if mode == LOCKSTEP else None
        self._last_sequence = None
        self._last_log_ns = 0

    def put(self, data: bytes, source_ns: int, received_ns: int, sequence: int | None):
        """File one message under its stamp (lockstep) or its time of arrival (realtime).

        `source_ns` and `sequence` are the publisher's, 0 and None where the middleware knows none.
        """
        log_ns = received_ns
        if self._stamp_ns is not None:
            try:
                log_ns = self._stamp_ns(data)
            except DecodeError:
                log_ns = self._last_log_ns
        self._last_log_ns = log_ns
        last, self._last_sequence = self._last_sequence, sequence
        # a smaller number is another publisher, or one that was started again
        if last is not None and sequence is not None and sequence > last:
            self.lost += sequence - last - 1
        self._write(log_ns, source_ns or log_ns, data, sequence or 0)
