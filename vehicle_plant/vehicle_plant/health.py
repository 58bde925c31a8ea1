"""The plant's health in one line and a few numbers: /diagnostics."""

from typing import Any

from msgs_yaml.ages import ERROR, OK, STALE, WARN, Held
from msgs_yaml.types import Health
from vehicle_plant.ring import Lockstep, Realtime

NODE = 'plant'
AGED = {WARN: 'commands come late', ERROR: 'no command came for a while, the car braked straight'}
BEGAN = 'run_began_ns'  # the instant at which the car was let go; the scenario reads it


class Monitor:
    """Tells the health of a run; what has happened counts for a while (`ages.Held`)."""

    def __init__(self, ring: Lockstep | Realtime):
        self._ring = ring
        self._rejected = self._missed = 0  # when it was told last
        self._held = Held()
        self._message = {OK: 'running'}

    def health(self, stamp_ns: int) -> Health:
        """Return the health of a running plant at a stamp."""
        ring, gate = self._ring, self._ring.car.gate
        # in this order: what is said last is what counts most
        level = max(self._aged(stamp_ns), self._held.take(self._level(), stamp_ns))
        values = {
            'commands_rejected': gate.rejected,
            'last_rejection': gate.last_reason or 'none',
            **{f'rejected.{code}': count for code, count in sorted(gate.rejections.items())},
            'missed_steps': ring.missed_steps,
            'longest_gap_steps': ring.longest_gap,
            'controller_gone': ring.gone,
            **self._ages(stamp_ns),
        }
        return Health(stamp_ns, NODE, level, self._message[level], values)

    def _aged(self, stamp_ns):
        """Return the level of the last command's age, and remember why."""
        if not isinstance(self._ring, Realtime):
            return OK
        self._ring.watch.look(stamp_ns)
        level = self._ring.watch.held
        if level in AGED:
            self._message[level] = AGED[level]
        return level

    def _level(self):
        """Return the level of this instant, and remember why."""
        ring, gate = self._ring, self._ring.car.gate
        refused, self._rejected = gate.rejected > self._rejected, gate.rejected
        missed, self._missed = ring.missed_steps > self._missed, ring.missed_steps
        for level, found, message in (
            (ERROR, ring.gone, 'no command comes, braking straight'),
            (WARN, refused, f'commands refused: {gate.last_reason}'),
            (WARN, missed, 'steps came late and were caught up'),
        ):
            if found:
                self._message[level] = message
                return level
        return OK

    def _ages(self, stamp_ns) -> dict[str, Any]:
        if not isinstance(self._ring, Realtime):
            return {}
        return {BEGAN: self._ring.began_ns, **self._ring.watch.values(stamp_ns)}


def waiting(stamp_ns: int, message: str) -> Health:
    """Return the health of a plant whose run has not begun."""
    return Health(stamp_ns, NODE, STALE, message, {})
