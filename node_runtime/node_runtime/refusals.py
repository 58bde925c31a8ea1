"""What is logged of messages that are turned down: the first of each kind, then counts. No ROS."""

from collections import Counter

PERIOD_NS = 5_000_000_000  # between two lines of counts


class Refusals:
    """Counts the refused messages of one topic by kind, which is a word of a small fixed set."""

    def __init__(self, topic: str):
        self._topic = topic
        self._counts = Counter()
        self._counted_ns: int | None = None  # when the counts were logged last

    def line(self, kind: str, reason: str, now_ns: int) -> str:
        """Count a message; return the line to log, '' when there is none.

        The first message of each kind is logged with its reason. What follows is counted, and the
        counts are logged with the last reason, once per PERIOD_NS at most.
        """
        self._counts[kind] += 1
        if self._counts[kind] == 1:
            self._counted_ns = self._counted_ns or now_ns
            return f'{self._topic} turned down ({kind}): {reason}'
        if now_ns - self._counted_ns < PERIOD_NS:
            return ''
        self._counted_ns = now_ns
        counts = ', '.join(f'{count} {kind}' for kind, count in sorted(self._counts.items()))
        return f'{self._topic} turned down so far: {counts}; the last: {reason}'
