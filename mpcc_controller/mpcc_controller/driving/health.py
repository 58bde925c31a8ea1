"""The controller's health: /diagnostics."""

from collections import Counter
from typing import Any

from mpcc_controller.driving.explain import ERROR, OK, WARN
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Health, Why


class Monitor:
    """Counts the rungs that were taken since the start."""

    def __init__(self, name: str):
        self.name = name
        self.rungs = Counter()
        self.rejections = 0
        self.worst = OK  # since the last report
        self.second: int | None = None

    def note(self, why: Why) -> None:
        """Take what a step said."""
        self.rungs[why.values['rung']] += 1
        self.rejections = why.values['gate.rejections']
        self.worst = max(self.worst, why.level)

    def on_step(self, why: Why) -> Health | None:
        """Take what a step said; return the health when a new second has begun."""
        self.note(why)
        second = why.stamp_ns // NS_PER_S
        if second == self.second:
            return None
        self.second = second
        return self.report(why.stamp_ns, self.worst, TOLD[self.worst], {})

    def report(self, stamp_ns: int, level: int, message: str, more: dict[str, Any]) -> Health:
        """Return the health with the counts and `more`; the next report begins anew."""
        self.worst = OK
        counts = {f'rung.{rung}': count for rung, count in sorted(self.rungs.items())}
        values = counts | {'gate.rejections': self.rejections} | more
        return Health(stamp_ns, self.name, level, message, values)


TOLD = {
    OK: 'every step solved',
    WARN: 'some steps followed an unfinished or older plan',
    ERROR: 'some steps braked, or the gate turned a command back',
}
