"""Health of the plant for /diagnostics: level, causes, counters."""

from typing import Any

from msgs_yaml.types import Health
from node_runtime.input_monitor import ERROR, OK, STALE, WARN, HeldLevel
from vehicle_plant.stepping import LockstepStepper, RealtimeStepper

NODE = 'plant'
NO_COMMAND = 'no command comes, braking straight'
RUNNING = 'running'
AGE_MESSAGES = {
    WARN: 'commands come late',
    ERROR: 'no command came for a while, the car braked straight',
}


class HeldFault:
    """A fault of one level, held for a while after it has ended (`HeldLevel`)."""

    def __init__(self, level: int):
        self._level = level
        self._held = HeldLevel()
        self.level = OK
        self.message = ''  # of its last occurrence

    def update(self, is_present: bool, message: str, now_ns: int) -> None:
        """Take whether the fault is present now, and its message."""
        if is_present:
            self.message = message
        self.level = self._held.update(self._level if is_present else OK, now_ns)


class HealthMonitor:
    """Derives the health of a run: all faults present now or within the last two seconds.

    The most severe fault comes first; within a level rejections come before late steps.
    """

    def __init__(self, stepper: LockstepStepper | RealtimeStepper):
        self._stepper = stepper
        self._rejected = self._missed = 0  # at the last call
        self._gone, self._refused, self._late = map(HeldFault, (ERROR, WARN, WARN))

    def health(self, stamp_ns: int) -> Health:
        """Return the health of a running plant at a stamp."""
        stepper, gate = self._stepper, self._stepper.car.gate
        level, message = self._level_and_message(stamp_ns)
        values = {
            'commands_rejected': gate.rejected,
            'last_rejection': gate.last_reason or 'none',
            **{f'rejected.{code}': count for code, count in sorted(gate.rejections.items())},
            'missed_steps': stepper.missed_steps,
            'longest_gap_steps': stepper.longest_gap,
            'controller_gone': stepper.controller_gone,
            **self._age_values(stamp_ns),
        }
        return Health(stamp_ns, NODE, level, message, values)

    def _level_and_message(self, stamp_ns):
        stepper, gate = self._stepper, self._stepper.car.gate
        refused, late = gate.rejected > self._rejected, stepper.missed_steps > self._missed
        self._rejected, self._missed = gate.rejected, stepper.missed_steps
        self._gone.update(stepper.controller_gone, NO_COMMAND, stamp_ns)
        self._refused.update(refused, f'commands refused: {gate.last_reason}', stamp_ns)
        self._late.update(late, 'steps came late and were caught up', stamp_ns)
        faults = [(fault.level, fault.message) for fault in (self._gone, self._refused, self._late)]
        age_level = self._age_level(stamp_ns)
        if age_level in AGE_MESSAGES and self._gone.level == OK:  # which implies the age
            faults.append((age_level, AGE_MESSAGES[age_level]))
        # a stable sort: within a level in the order above
        faults = sorted((f for f in faults if f[0] != OK), key=lambda fault: -fault[0])
        level = max([age_level, *(level for level, _ in faults)])
        return level, '; '.join(message for _, message in faults) or RUNNING

    def _age_level(self, stamp_ns):
        if not isinstance(self._stepper, RealtimeStepper):
            return OK
        self._stepper.command_monitor.update(stamp_ns)
        return self._stepper.command_monitor.held_level

    def _age_values(self, stamp_ns) -> dict[str, Any]:
        if not isinstance(self._stepper, RealtimeStepper):
            return {}
        return self._stepper.command_monitor.diagnostics(stamp_ns)


def waiting(stamp_ns: int, message: str) -> Health:
    """Return the health of a plant whose run has not begun."""
    return Health(stamp_ns, NODE, STALE, message, {})
