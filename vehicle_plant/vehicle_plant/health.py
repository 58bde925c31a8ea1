"""The plant's health in one line and a few numbers: /diagnostics."""

from msgs_yaml.types import Health
from vehicle_plant.ring import Lockstep, Realtime

NODE = 'plant'
_OK, _WARN, _ERROR = range(3)


def health(ring: Lockstep | Realtime, stamp_ns: int) -> Health:
    """Return the health of a running plant at a stamp."""
    gate = ring.car.gate
    values = {
        'commands_rejected': gate.rejected,
        'last_rejection': gate.last_reason or 'none',
        **{f'rejected.{code}': count for code, count in sorted(gate.rejections.items())},
        'missed_steps': ring.missed_steps,
        'longest_gap_steps': ring.longest_gap,
        'controller_gone': ring.gone,
    }
    if ring.gone:
        return Health(stamp_ns, NODE, _ERROR, 'no command comes, braking straight', values)
    if gate.rejected:
        return Health(stamp_ns, NODE, _WARN, f'commands refused: {gate.last_reason}', values)
    if ring.missed_steps:
        return Health(stamp_ns, NODE, _WARN, 'steps came late and were caught up', values)
    return Health(stamp_ns, NODE, _OK, 'running', values)
