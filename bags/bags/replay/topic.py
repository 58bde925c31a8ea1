"""One topic of a bag, its messages decoded when they are asked for: by row, stamp or time."""

import numpy as np

from bags.errors import BagError
from bags.storage import cdr, read, stamps
from msgs_yaml import decode


class Topic:
    """The messages of one topic that has some; BagError for one without."""

    def __init__(self, bag, name):
        recorded = read.recording(bag, name)
        self.path, self.topic, self.payloads = bag.path, recorded.topic, recorded.payloads
        self.decode = read.DECODERS[name]
        times = map(stamps.reader(self.topic.type), self.payloads)
        self.stamp_ns = np.fromiter(times, np.int64, len(self.payloads))
        # a time in order, whatever small steps the clock of the wall made
        self.sent_ns = np.maximum.accumulate(recorded.publish_ns)
        self.sequence = recorded.sequence
        # the first of a stamp: a state that waits for its answer is sent again
        self.row_of = {int(stamp_ns): i for i, stamp_ns in reversed([*enumerate(self.stamp_ns)])}
        self.known = {}

    def value(self, i: int):
        """Return the value of a message; None when it breaks the contract: nodes turn it down."""
        payload = self.payloads[i]
        if payload not in self.known:
            message = cdr.decode(payload, self.topic.schema, self.topic.type)
            try:
                self.known[payload] = self.decode(message)
            except decode.DecodeError:
                self.known[payload] = None
        return self.known[payload]

    def legible(self, i: int):
        """Return the value of a message; BagError when it breaks the contract."""
        found = self.value(i)
        if found is None:
            raise BagError(f'{self.path}: message {i} of {self.topic.name} breaks the contract')
        return found

    def of_stamp(self, stamp_ns: int):
        """Return the value of a stamp; BagError when it was not recorded, or two unlike ones."""
        if stamp_ns not in self.row_of:
            raise BagError(
                f'{self.path}: {self.topic.name} has no message of stamp {stamp_ns} ns, which '
                'the controller answered: it was lost, and the tick cannot be repeated'
            )
        row = self.row_of[stamp_ns]
        others = np.flatnonzero(self.stamp_ns == stamp_ns)
        if any(self.payloads[i] != self.payloads[row] for i in others):
            raise BagError(
                f'{self.path}: {self.topic.name} has unlike messages of stamp {stamp_ns} ns: the '
                'bag holds two drives, and their ticks cannot be told apart'
            )
        return self.value(row)

    def begins_anew(self, before: int, row: int) -> bool:
        """Tell whether the time or the publisher's count went back from one row to a later one."""
        back = self.stamp_ns[row] < self.stamp_ns[before]
        return bool(back or 0 < self.sequence[row] <= self.sequence[before])

    def any_between(self, after_ns: int, before_ns: int) -> bool:
        """Tell whether there is a message with a stamp between two others."""
        return bool(np.any((self.stamp_ns > after_ns) & (self.stamp_ns < before_ns)))

    def find(self, stamp_ns: int):
        """Return the value of a stamp; None when it was not recorded. Raises BagError."""
        return self.legible(self.row_of[stamp_ns]) if stamp_ns in self.row_of else None

    def newest(self, count: int):
        """Return the newest legible value of the first `count` messages; of one at least."""
        values = (self.value(i) for i in reversed(range(max(count, 1))))
        return next((value for value in values if value is not None), None)
