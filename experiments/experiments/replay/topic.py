"""One topic of a bag, its messages decoded when they are asked for: by row, stamp or time."""

import numpy as np

from bags.errors import BagError
from bags.storage import read
from bags.storage.decoding import DECODE_ERRORS, decode_message, stamp_reader
from msgs_yaml.decode import DecodeError

# a tick is joined with these by its stamp: an invalid one says that the controller had none
JOINED = ('/vehicle/odometry', '/vehicle/actuators', '/scenario/obstacles')


class Topic:
    """The messages of one topic; BagError for one without any that can be used.

    Messages without a legible stamp are left out, and so are, but of the topics in JOINED, those
    that break the contract: nodes turn them down.
    """

    def __init__(self, bag, name):
        recorded = read.recording(bag, name)
        self.path, self.topic = bag.path, recorded.topic
        self.known = {}
        stamp_of = {}
        for row, payload in enumerate(recorded.payloads):
            stamp_ns = _stamp_ns(self.topic, payload)
            if stamp_ns is not None and (name in JOINED or self._decoded(payload) is not None):
                stamp_of[row] = stamp_ns
        if not stamp_of:
            raise BagError(f'{bag.path}: no valid message of {name}')
        self.rows = np.array([*stamp_of])  # in the recording
        self.stamp_ns = np.array([*stamp_of.values()], dtype=np.int64)
        self.payloads = [recorded.payloads[row] for row in stamp_of]
        # a time in order, whatever small steps the clock of the wall made
        self.sent_ns = np.maximum.accumulate(recorded.publish_ns)[self.rows]
        self.sequence = recorded.sequence[self.rows]
        # the first of a stamp: a state that waits for its answer is sent again
        self.row_of = {int(stamp_ns): i for i, stamp_ns in reversed([*enumerate(self.stamp_ns)])}

    def value(self, i: int):
        """Return the value of a message; None when it breaks the contract: nodes turn it down."""
        return self._decoded(self.payloads[i])

    def _decoded(self, payload):
        if payload not in self.known:
            try:
                self.known[payload] = decode_message(self.topic, payload)
            except DECODE_ERRORS:
                self.known[payload] = None
        return self.known[payload]

    def of_stamp(self, stamp_ns: int):
        """Return the value of a stamp, None when it breaks the contract.

        Raises BagError when it was not recorded, and for two unlike valid ones.
        """
        if stamp_ns not in self.row_of:
            raise BagError(
                f'{self.path}: {self.topic.name} has no message of stamp {stamp_ns} ns, which '
                'the controller answered: it was lost, and the tick cannot be repeated'
            )
        sent = {self.payloads[i] for i in np.flatnonzero(self.stamp_ns == stamp_ns)}
        valid = [payload for payload in sent if self._decoded(payload) is not None]
        if len(valid) > 1:
            raise BagError(
                f'{self.path}: {self.topic.name} has unlike messages of stamp {stamp_ns} ns: the '
                'bag holds two drives, and their ticks cannot be told apart'
            )
        return self._decoded(valid[0]) if valid else None

    def begins_anew(self, before: int, row: int) -> bool:
        """Tell whether the time or the publisher's count went back from one row to a later one."""
        back = self.stamp_ns[row] < self.stamp_ns[before]
        return bool(back or 0 < self.sequence[row] <= self.sequence[before])

    def any_between(self, after_ns: int, before_ns: int) -> bool:
        """Tell whether there is a message with a stamp between two others."""
        return bool(np.any((self.stamp_ns > after_ns) & (self.stamp_ns < before_ns)))

    def find(self, stamp_ns: int):
        """Return the value of a stamp; None when it was not recorded."""
        return self.value(self.row_of[stamp_ns]) if stamp_ns in self.row_of else None

    def newest(self, count: int):
        """Return the newest valid value of the first `count` messages; of one at least."""
        values = (self.value(i) for i in reversed(range(max(count, 1))))
        return next((value for value in values if value is not None), None)


def _stamp_ns(topic, payload):
    try:
        return stamp_reader(topic.type)(payload)
    except DecodeError:
        return None
