"""Filters against repeated log lines. No ROS."""

from collections import Counter

PERIOD_NS = 5_000_000_000  # least time between two lines with counts


class ChangeFilter:
    """Passes a line only if it differs from the line before."""

    def __init__(self):
        self._last = ''

    def has_changed(self, line: str) -> bool:
        """Return whether a line differs from the one before; the first is compared with ''."""
        changed, self._last = line != self._last, line
        return changed


class RejectionLog:
    """Counts the rejected messages of one topic by kind, which is a word of a small fixed set."""

    def __init__(self, topic: str):
        self._topic = topic
        self._counts = Counter()
        self._counted_ns: int | None = None  # when the counts were last logged

    def line(self, kind: str, reason: str, now_ns: int) -> str:
        """Count a message; return the line to log, '' if there is none.

        The first message of each kind is logged with its reason; after that counts and the last
        reason, at most once per PERIOD_NS.
        """
        self._counts[kind] += 1
        if self._counts[kind] == 1:
            self._counted_ns = self._counted_ns or now_ns
            return f'{self._topic} rejected ({kind}): {reason}'
        if now_ns - self._counted_ns < PERIOD_NS:
            return ''
        self._counted_ns = now_ns
        counts = ', '.join(f'{count} {kind}' for kind, count in sorted(self._counts.items()))
        return f'{self._topic} rejected so far: {counts}; the last: {reason}'
