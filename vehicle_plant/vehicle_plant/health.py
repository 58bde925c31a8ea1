"""The plant's health in one line and a few numbers: /diagnostics."""

from typing import Any

from msgs_yaml.types import Health
from node_runtime.input_monitor import ERROR, OK, STALE, WARN, HeldLevel
from vehicle_plant.stepping import LockstepStepper, RealtimeStepper

NODE = 'plant'
RUNNING = 'running'
AGED = {WARN: 'commands come late', ERROR: 'no command came for a while, the car braked straight'}
BEGAN = 'run_began_ns'  # the instant at which the car was let go; the scenario reads it


class Cause:
    """A fault of one level that is held for a while after it was seen (`HeldLevel`)."""

    def __init__(self, level: int):
        self._level = level
        self._held = HeldLevel()
        self.held = OK
        self.message = ''  # of when it was seen last

    def take(self, seen: bool, message: str, now_ns: int) -> None:
        """Take whether it is there now, and what it says."""
        if seen:
            self.message = message
        self.held = self._held.update(self._level if seen else OK, now_ns)


class Monitor:
    """Tells the health of a run: everything that is or was lately wrong.

    The heaviest first, within a level refusals before late steps.
    """

    def __init__(self, ring: LockstepStepper | RealtimeStepper):
        self._ring = ring
        self._rejected = self._missed = 0  # when it was told last
        self._causes = tuple(Cause(level) for level in (ERROR, WARN, WARN))

    def health(self, stamp_ns: int) -> Health:
        """Return the health of a running plant at a stamp."""
        ring, gate = self._ring, self._ring.car.gate
        level, message = self._verdict(stamp_ns)
        values = {
            'commands_rejected': gate.rejected,
            'last_rejection': gate.last_reason or 'none',
            **{f'rejected.{code}': count for code, count in sorted(gate.rejections.items())},
            'missed_steps': ring.missed_steps,
            'longest_gap_steps': ring.longest_gap,
            'controller_gone': ring.gone,
            **self._ages(stamp_ns),
        }
        return Health(stamp_ns, NODE, level, message, values)

    def _verdict(self, stamp_ns):
        """Return the level, and every cause that is held."""
        gone, refused, late = self._causes
        ring, gate = self._ring, self._ring.car.gate
        gone.take(ring.gone, 'no command comes, braking straight', stamp_ns)
        refused.take(
            gate.rejected > self._rejected, f'commands refused: {gate.last_reason}', stamp_ns
        )
        late.take(ring.missed_steps > self._missed, 'steps came late and were caught up', stamp_ns)
        self._rejected, self._missed = gate.rejected, ring.missed_steps
        aged = self._aged(stamp_ns)
        held = [(cause.held, cause.message) for cause in self._causes if cause.held != OK]
        if aged in AGED and gone.held == OK:  # which says the same, and what follows
            held.append((aged, AGED[aged]))
        # within a level in the order above
        held.sort(key=lambda found: -found[0])
        level = max([aged, *(level for level, _ in held)])
        return level, '; '.join(message for _, message in held) or RUNNING

    def _aged(self, stamp_ns):
        """Return the level of the last command's age."""
        if not isinstance(self._ring, RealtimeStepper):
            return OK
        self._ring.watch.update(stamp_ns)
        return self._ring.watch.held_level

    def _ages(self, stamp_ns) -> dict[str, Any]:
        if not isinstance(self._ring, RealtimeStepper):
            return {}
        return {BEGAN: self._ring.began_ns, **self._ring.watch.diagnostics(stamp_ns)}


def waiting(stamp_ns: int, message: str) -> Health:
    """Return the health of a plant whose run has not begun."""
    return Health(stamp_ns, NODE, STALE, message, {})
