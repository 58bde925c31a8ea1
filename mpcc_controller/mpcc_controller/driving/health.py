"""The controller's health, once per second of its own steps: /diagnostics."""

from collections import Counter

from mpcc_controller.driving.explain import ERROR, OK, WARN
from msgs_yaml.stamp import NS_PER_S
from msgs_yaml.types import Health, Why


class Monitor:
    """Counts the rungs that were taken since the start."""

    def __init__(self, name: str):
        self.name = name
        self.rungs = Counter()
        self.worst = OK
        self.second: int | None = None

    def on_step(self, why: Why) -> Health | None:
        """Take what a step said; return the health when a new second has begun."""
        self.rungs[why.values['rung']] += 1
        self.worst = max(self.worst, why.level)
        second = why.stamp_ns // NS_PER_S
        if second == self.second:
            return None
        self.second = second
        health = Health(why.stamp_ns, self.name, self.worst, TOLD[self.worst], self._values(why))
        self.worst = OK
        return health

    def _values(self, why):
        counts = {f'rung.{rung}': count for rung, count in sorted(self.rungs.items())}
        return counts | {'gate.rejections': why.values['gate.rejections']}


TOLD = {
    OK: 'every step solved',
    WARN: 'some steps followed an unfinished or older plan',
    ERROR: 'some steps braked, or the gate turned a command back',
}
