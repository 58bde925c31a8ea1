"""Health of the plant for /diagnostics: level, causes, counters."""

from msgs_yaml.types import Health
from node_runtime.input_monitor import ERROR, OK, STALE, WARN, HeldLevel
from vehicle_plant.stepping import LockstepStepper, RealtimeStepper

NODE = 'plant'
RUNNING = 'running'
AGE_MESSAGES = {
    WARN: 'commands come late',
    ERROR: 'no command came for a while, the plant braked the car',
}


class HealthMonitor:
    """Derives the health of a run: all faults present now or within the last two seconds.

    The most severe fault comes first; within a level rejections come before late steps.
    """

    def __init__(self, stepper: LockstepStepper | RealtimeStepper):
        self._stepper = stepper
        self._rejected = self._missed = 0  # at the last call
        self._held = [HeldLevel() for _ in range(3)]
        self._messages = [''] * 3  # of the last occurrence of each fault

    def health(self, stamp_ns: int) -> Health:
        """Return the health of a running plant at a stamp."""
        stepper, gate = self._stepper, self._stepper.car.gate
        present = (
            (stepper.controller_gone, ERROR, stepper.stop.message),
            (gate.rejected > self._rejected, WARN, f'commands refused: {gate.last_reason}'),
            (stepper.missed_steps > self._missed, WARN, 'steps came late and were caught up'),
        )
        self._rejected, self._missed = gate.rejected, stepper.missed_steps
        shown = []
        for i, (is_present, level, message) in enumerate(present):
            if is_present:
                self._messages[i] = message
            level = self._held[i].update(level if is_present else OK, stamp_ns)
            shown.append((level, self._messages[i]))
        age_level, age = OK, {}
        if isinstance(stepper, RealtimeStepper):
            stepper.command_monitor.update(stamp_ns)
            age_level = stepper.command_monitor.held_level
            age = stepper.command_monitor.diagnostics(stamp_ns)
        is_gone = shown[0][0] != OK  # which implies the age
        shown.append((age_level, '' if is_gone else AGE_MESSAGES.get(age_level, '')))
        # a stable sort: within a level in the order above
        shown.sort(key=lambda fault: -fault[0])
        message = '; '.join(text for level, text in shown if level != OK and text) or RUNNING
        values = {
            'commands_rejected': gate.rejected,
            'last_rejection': gate.last_reason or 'none',
            **{f'rejected.{code}': count for code, count in sorted(gate.rejections.items())},
            'missed_steps': stepper.missed_steps,
            'longest_gap_steps': stepper.longest_gap,
            'controller_gone': stepper.controller_gone,
            **age,
        }
        return Health(stamp_ns, NODE, shown[0][0], message, values)


def waiting(stamp_ns: int, message: str) -> Health:
    """Return the health of a plant whose run has not begun."""
    return Health(stamp_ns, NODE, STALE, message, {})
