"""What the controller may still believe: the ages of its inputs. Times are arguments, in ns.

On the wall clock (`Awake`) inputs age, and what grew too old makes the car brake. In lockstep
(`Asleep`) time waits for every input, so nothing does.
"""

from mpcc_controller.driving.health import TOLD, Monitor
from mpcc_controller.parameters import Ages
from msgs_yaml import conversions
from msgs_yaml.types import Health, Why
from node_runtime.input_monitor import ERROR, OK, STALE, HeldLevel, InputMonitor

STATE, REFERENCE, EDGES, OBSTACLES = 'state', 'reference', 'edges', 'obstacles'
STATE_STALE = 'state_stale'


class Asleep:
    """Nothing ages; health is told once per second of the steps."""

    def __init__(self, monitor: Monitor):
        self._monitor = monitor

    def offer(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Take the stamp of an input, whatever it is."""
        return ''

    def refuse(self, name: str, reason: str) -> str:
        """Return the reason for which a message was turned down."""
        return reason

    def fault(self, now_ns: int) -> str:
        """Return what is too old to plan with: nothing."""
        return ''

    def lost(self, now_ns: int) -> bool:
        """Tell whether the state is too old to be answered."""
        return False

    def told(self, now_ns: int) -> str:
        """Return what is too old, in words."""
        return ''

    def on_step(self, why: Why) -> Health | None:
        """Take what a step said; return the health when it is to be told."""
        return self._monitor.on_step(why)

    def on_beat(self, now_ns: int, waiting: str) -> Health | None:
        """Return the health when it is to be told without a step."""
        return None


class Awake:
    """Watches four inputs; health is told once per second of the clock."""

    def __init__(self, monitor: Monitor, ages: Ages):
        self._monitor = monitor
        limits_s = {
            STATE: ages.state_s,
            REFERENCE: ages.reference_s,
            EDGES: ages.reference_s,
            OBSTACLES: ages.obstacles_s,
        }
        self.watches = {name: InputMonitor(name, limit_s) for name, limit_s in limits_s.items()}
        self._steps = HeldLevel()
        self._beat_ns: int | None = None

    def offer(self, name: str, stamp_ns: int, now_ns: int) -> str:
        """Take the stamp of an input; return '' or why it is refused."""
        return self.watches[name].accept(stamp_ns, now_ns)

    def refuse(self, name: str, reason: str) -> str:
        """Count a message that breaks the contract."""
        return self.watches[name].reject(reason)

    def fault(self, now_ns: int) -> str:
        """Return the reason for which no plan can be made, '' when there is none."""
        for name, watch in self.watches.items():
            if watch.level(now_ns) == ERROR:
                return f'{name}_stale'
        return ''

    def lost(self, now_ns: int) -> bool:
        """Tell whether the state is too old to be answered."""
        return self.watches[STATE].level(now_ns) == ERROR

    def told(self, now_ns: int) -> str:
        """Return what is too old, in words."""
        stale = [w for w in self.watches.values() if w.level(now_ns) == ERROR]
        return '; '.join(watch.describe(now_ns) for watch in stale)

    def on_step(self, why: Why) -> Health | None:
        """Take what a step said; the health comes with the beat."""
        self._monitor.note(why)
        return None

    def on_beat(self, now_ns: int, waiting: str) -> Health | None:
        """Look at every age; return the health once per second.

        `waiting` says what the first step waits for, '' once it was taken.
        """
        watches = self.watches.values()
        for watch in watches:
            watch.update(now_ns)
        if self._beat_ns is not None and now_ns - self._beat_ns < conversions.NS_PER_S:
            return None
        self._beat_ns = now_ns
        steps = self._steps.update(self._monitor.worst, now_ns)
        level, message = max(steps, *(watch.held_level for watch in watches)), TOLD[steps]
        if waiting:
            level, message = STALE, waiting
        elif level != OK and level != steps:
            message = '; '.join(
                watch.describe_held(now_ns) for watch in watches if watch.held_level == level
            )
        ages = {k: v for watch in watches for k, v in watch.diagnostics(now_ns).items()}
        return self._monitor.report(now_ns, level, message, ages)


def make(mode: str, monitor: Monitor, ages: Ages) -> Asleep | Awake:
    """Return the watchdog of a mode of the contract."""
    return Awake(monitor, ages) if mode == 'realtime' else Asleep(monitor)
