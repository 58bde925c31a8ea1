"""Watchdog of the controller: the ages of its inputs, and its health on /diagnostics. Times in ns.

In realtime inputs age; one that is too old makes the car brake, a state once the last plan has
ended. In lockstep simulated time waits for every input, so none ages. Missed ticks are counted from
the bag (`bags timing`), not here.
"""

from collections import Counter
from typing import Any

from mpcc_controller.driving.actuator_faults import FAULT
from mpcc_controller.driving.tick_report import ERROR, OK, WARN
from mpcc_controller.parameters import Ages
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Health, Why
from node_runtime.input_monitor import STALE, HeldLevel, InputMonitor

STATE, REFERENCE, EDGES, OBSTACLES = 'state', 'reference', 'edges', 'obstacles'
STATE_STALE = 'state_stale'
MESSAGES = {
    OK: 'every step solved',
    WARN: 'some steps followed an unfinished or older plan',
    ERROR: 'some steps braked, or the gate turned a command back',
}


class Watchdog:
    """Monitors the ages of four inputs, counts the levels of fallback, and reports the health.

    Once per second: of the clock, or in lockstep of the stamps of the steps.
    """

    def __init__(self, name: str, ages: Ages | None):
        """`name` is that of the health; without `ages`, in lockstep, no input ages."""
        self.name = name
        limits_s = ages and {
            STATE: ages.state_s,
            REFERENCE: ages.reference_s,
            EDGES: ages.reference_s,
            OBSTACLES: ages.obstacles_s,
        }
        self.inputs = {key: InputMonitor(key, limit_s) for key, limit_s in (limits_s or {}).items()}
        self._level_counts = Counter()  # since the start, as the next two
        self._rejections = self._internal_errors = 0
        self._worst, self._actuators = OK, ''  # since the last report; what did not follow
        self._steps = HeldLevel()
        self._reported: int | None = None  # ns, in lockstep the second

    def check(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Return '' or why the stamp of an input would be rejected; it counts as not received."""
        return self.inputs[name].check(stamp_ns, now_ns) if self.inputs else ''

    def offer(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Offer the stamp of an input; return '' or why it is rejected."""
        return self.inputs[name].accept(stamp_ns, now_ns) if self.inputs else ''

    def reject(self, name: str, reason: str) -> str:
        """Count a message that violates the contract; return the reason."""
        return self.inputs[name].reject(reason) if self.inputs else reason

    def fault(self, now_ns: int) -> str:
        """Return the reason for which no plan can be computed, '' if there is none."""
        return next((f'{monitor.name}_stale' for monitor in self._stale(now_ns)), '')

    def is_state_lost(self, now_ns: int) -> bool:
        """Return whether the state is too old to be answered."""
        return any(monitor.name == STATE for monitor in self._stale(now_ns))

    def describe(self, now_ns: int) -> str:
        """Return a text that names every input that is too old, with its age."""
        return '; '.join(monitor.describe(now_ns) for monitor in self._stale(now_ns))

    def on_step(self, why: Why) -> Health | None:
        """Add the report of a step; in lockstep return the health at the first one of a second."""
        self._level_counts[why.values['rung']] += 1
        self._rejections = why.values['gate.rejections']
        self._internal_errors = why.values.get('internal_errors', 0)
        self._actuators = why.values.get(FAULT, '') or self._actuators
        self._worst = max(self._worst, why.level, WARN if self._actuators else OK)
        second = why.stamp_ns // NS_PER_S
        if self.inputs or second == self._reported:
            return None
        self._reported = second
        return self._report(why.stamp_ns, self._worst, self._message(self._worst), {})

    def on_timer(self, now_ns: int, waiting: str) -> Health | None:
        """Check every age; in realtime return the health once per second.

        `waiting` names what the first step waits for, '' once it was done.
        """
        inputs = self.inputs.values()
        for monitor in inputs:
            monitor.update(now_ns)
        is_early = self._reported is not None and now_ns - self._reported < NS_PER_S
        if not inputs or is_early:
            return None
        self._reported = now_ns
        steps = self._steps.update(self._worst, now_ns)
        level = max(steps, *(monitor.held_level for monitor in inputs))
        message = self._message(steps)
        if waiting:
            level, message = STALE, waiting
        elif level != OK and level != steps:
            causes = [m.describe(now_ns) for m in inputs if m.held_level == level]
            message = '; '.join(causes)
        ages = {k: v for monitor in inputs for k, v in monitor.diagnostics(now_ns).items()}
        return self._report(now_ns, level, message, ages)

    def _stale(self, now_ns):
        return [m for m in self.inputs.values() if m.level(now_ns) == ERROR]

    def _message(self, level: int) -> str:
        """Return what the steps since the last report mean, that led to a level."""
        if not self._actuators or level == OK:
            return MESSAGES[level]
        fault = f'actuators do not follow their set-points: {self._actuators}'
        return f'{MESSAGES[level]}; {fault}' if level == ERROR else fault

    def _report(self, stamp_ns: int, level: int, message: str, ages: dict[str, Any]) -> Health:
        """Return the health with all counts; starts the next reporting period."""
        values = {f'rung.{name}': count for name, count in sorted(self._level_counts.items())}
        values |= {'gate.rejections': self._rejections} | ages
        if self._internal_errors:
            values['internal_errors'] = self._internal_errors
        if self._actuators:
            values[FAULT] = self._actuators
        self._worst, self._actuators = OK, ''
        return Health(stamp_ns, self.name, level, message, values)
