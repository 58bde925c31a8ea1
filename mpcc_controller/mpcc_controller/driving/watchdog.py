"""Watchdog and health of the controller: the ages of its inputs, and /diagnostics. Times in ns.

In realtime (`RealtimeWatchdog`) inputs age; one that is too old makes the car brake. In lockstep
(`LockstepWatchdog`) simulated time waits for every input, so none ages. Missed ticks are counted
from the bag (`bags timing`), not here.
"""

from collections import Counter
from typing import Any

from mpcc_controller.driving.actuator_monitor import FAULT
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


class HealthMonitor:
    """Counts the levels of fallback since the start."""

    def __init__(self, name: str):
        self.name = name
        self.level_counts = Counter()
        self.rejections = 0
        self.internal_errors = 0
        self.actuators = ''  # those that did not follow their set-points since the last report
        self.worst = OK  # since the last report
        self._second: int | None = None

    def add(self, why: Why) -> None:
        """Add the report of a step."""
        self.level_counts[why.values['rung']] += 1
        self.rejections = why.values['gate.rejections']
        self.internal_errors = why.values.get('internal_errors', 0)
        self.actuators = why.values.get(FAULT, '') or self.actuators
        self.worst = max(self.worst, why.level, WARN if self.actuators else OK)

    def on_step(self, why: Why) -> Health | None:
        """Add the report of a step; return the health at the first step of each second."""
        self.add(why)
        second = why.stamp_ns // NS_PER_S
        if second == self._second:
            return None
        self._second = second
        return self.report(why.stamp_ns, self.worst, self.message(self.worst), {})

    def message(self, level: int) -> str:
        """Return what the steps since the last report mean, that led to a level."""
        if not self.actuators or level == OK:
            return MESSAGES[level]
        fault = f'actuators do not follow their set-points: {self.actuators}'
        return f'{MESSAGES[level]}; {fault}' if level == ERROR else fault

    def report(self, stamp_ns: int, level: int, message: str, extra: dict[str, Any]) -> Health:
        """Return the health with the counts and `extra`; starts the next reporting period."""
        self.worst, actuators, self.actuators = OK, self.actuators, ''
        counts = {f'rung.{name}': count for name, count in sorted(self.level_counts.items())}
        values = counts | {'gate.rejections': self.rejections} | extra
        if self.internal_errors:
            values['internal_errors'] = self.internal_errors
        if actuators:
            values[FAULT] = actuators
        return Health(stamp_ns, self.name, level, message, values)


class LockstepWatchdog:
    """No input ages; the health is reported once per second of the steps."""

    def __init__(self, monitor: HealthMonitor):
        self._monitor = monitor

    def check(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Return '': no stamp is too old."""
        return ''

    def offer(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Accept the stamp of an input, whatever it is."""
        return ''

    def reject(self, name: str, reason: str) -> str:
        """Return the reason for which a message is rejected."""
        return reason

    def fault(self, now_ns: int) -> str:
        """Return '': no input is too old."""
        return ''

    def is_state_lost(self, now_ns: int) -> bool:
        """Return whether the state is too old to be answered: never."""
        return False

    def describe(self, now_ns: int) -> str:
        """Return '': no input is too old."""
        return ''

    def on_step(self, why: Why) -> Health | None:
        """Add the report of a step; return the health when it is due."""
        return self._monitor.on_step(why)

    def on_timer(self, now_ns: int, waiting: str) -> Health | None:
        """Return None: the health is due with steps only."""
        return None


class RealtimeWatchdog:
    """Monitors the ages of four inputs; the health is reported once per second of the clock."""

    def __init__(self, monitor: HealthMonitor, ages: Ages):
        self._monitor = monitor
        limits_s = {
            STATE: ages.state_s,
            REFERENCE: ages.reference_s,
            EDGES: ages.reference_s,
            OBSTACLES: ages.obstacles_s,
        }
        self.inputs = {name: InputMonitor(name, limit_s) for name, limit_s in limits_s.items()}
        self._steps = HeldLevel()
        self._reported_ns: int | None = None

    def check(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Return '' or why the stamp of an input would be rejected; it counts as not received."""
        return self.inputs[name].check(stamp_ns, now_ns)

    def offer(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Offer the stamp of an input; return '' or why it is rejected."""
        return self.inputs[name].accept(stamp_ns, now_ns)

    def reject(self, name: str, reason: str) -> str:
        """Count a message that violates the contract; return the reason."""
        return self.inputs[name].reject(reason)

    def fault(self, now_ns: int) -> str:
        """Return the reason for which no plan can be computed, '' if there is none."""
        for name, monitor in self.inputs.items():
            if monitor.level(now_ns) == ERROR:
                return f'{name}_stale'
        return ''

    def is_state_lost(self, now_ns: int) -> bool:
        """Return whether the state is too old to be answered."""
        return self.inputs[STATE].level(now_ns) == ERROR

    def describe(self, now_ns: int) -> str:
        """Return a text that names every input that is too old, with its age."""
        stale = [monitor for monitor in self.inputs.values() if monitor.level(now_ns) == ERROR]
        return '; '.join(monitor.describe(now_ns) for monitor in stale)

    def on_step(self, why: Why) -> Health | None:
        """Add the report of a step; the health is due with the timer."""
        self._monitor.add(why)
        return None

    def on_timer(self, now_ns: int, waiting: str) -> Health | None:
        """Check every age; return the health once per second.

        `waiting` names what the first step waits for, '' once it was done.
        """
        inputs = self.inputs.values()
        for monitor in inputs:
            monitor.update(now_ns)
        if self._reported_ns is not None and now_ns - self._reported_ns < NS_PER_S:
            return None
        self._reported_ns = now_ns
        steps = self._steps.update(self._monitor.worst, now_ns)
        level = max(steps, *(monitor.held_level for monitor in inputs))
        message = self._monitor.message(steps)
        if waiting:
            level, message = STALE, waiting
        elif level != OK and level != steps:
            causes = [
                monitor.describe_held(now_ns) for monitor in inputs if monitor.held_level == level
            ]
            message = '; '.join(causes)
        ages = {k: v for monitor in inputs for k, v in monitor.diagnostics(now_ns).items()}
        return self._monitor.report(now_ns, level, message, ages)


def make(mode: str, monitor: HealthMonitor, ages: Ages) -> LockstepWatchdog | RealtimeWatchdog:
    """Return the watchdog of a mode, 'lockstep' or 'realtime'."""
    return RealtimeWatchdog(monitor, ages) if mode == 'realtime' else LockstepWatchdog(monitor)
