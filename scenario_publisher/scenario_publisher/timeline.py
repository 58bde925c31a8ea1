"""Messages of a scenario under a stamp, and the rates at which they are repeated. No ROS."""

from msgs_yaml import contract, conversions
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Health, Obstacles
from node_runtime.input_monitor import OK, STALE
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario

NAME = 'scenario'
PLANT = 'plant'
RUN_START_KEY = 'run_began_ns'  # in /diagnostics of the plant
LATEST_NS = 2**31 * conversions.NS_PER_S  # ROS counts seconds in 32 bits


class RateLimiter:
    """Limits an action to a rate [Hz] of stamps; stamps that come late do not lower the rate."""

    def __init__(self, rate_hz: float):
        self._period_ns = round(conversions.NS_PER_S / rate_hz)
        self._last_ns = None
        self._due_ns = 0

    def is_due(self, stamp_ns: int) -> bool:
        """Return whether the action is due at a stamp; if so, it counts as done."""
        last_ns, self._last_ns = self._last_ns, stamp_ns
        # time that jumps back starts another run
        if last_ns is None or stamp_ns < last_ns:
            self._due_ns = stamp_ns
        if stamp_ns < self._due_ns:
            return False
        self._due_ns += self._period_ns
        # what a gap left out is not made up for
        if self._due_ns <= stamp_ns:
            self._due_ns = stamp_ns + self._period_ns
        return True


class Timeline:
    """A scenario over the stamps of one run."""

    def __init__(self, scn: Scenario, mode: str):
        self._scn = scn
        self._start_ns = scenario.START_NS if mode == 'lockstep' else None
        self._is_lockstep = mode == 'lockstep'
        self.has_plant = self._is_lockstep  # in lockstep the run starts at a known stamp
        topics = contract.load().topics
        self.rate_hz = topics['/scenario/obstacles'].rate_hz[mode]
        self.road_rate = RateLimiter(topics['/scenario/reference'].rate_hz[mode])
        self.health_rate = RateLimiter(topics['/diagnostics'].rate_hz[mode])

    def update_run_start(self, health: Health) -> None:
        """Take the start of the run from the plant's health: obstacles move from then on.

        It may come in the middle of a run, after a restart of this node. Raises DecodeError for a
        value that is no instant; the last valid one stands.
        """
        if health.name == PLANT and not self._is_lockstep:
            self._start_ns = _check_instant(health.values.get(RUN_START_KEY))
            self.has_plant = True

    def obstacles(self, stamp_ns: int) -> Obstacles:
        """Return the obstacles at a stamp; before the run, those of its start."""
        start_ns = stamp_ns if self._start_ns is None else self._start_ns
        return scenario.obstacles_at(self._scn, conversions.ns_to_s(stamp_ns - start_ns), stamp_ns)

    def health(self, stamp_ns: int) -> Health:
        """Return the health of the node."""
        if not self.has_plant:
            message = 'waiting for the start of the run in /diagnostics of the plant'
            return Health(stamp_ns, NAME, STALE, message, {'obstacles': 0})
        count = len(self.obstacles(stamp_ns).items)
        return Health(stamp_ns, NAME, OK, f'publishing {self._scn.name}', {'obstacles': count})


def _check_instant(start_ns):
    """Return a valid instant, None for a run that has not started."""
    # bool is an int, too; and a float has lost nanoseconds
    if start_ns is None or (type(start_ns) is int and 0 < start_ns < LATEST_NS):
        return start_ns
    allowed = f'allowed are whole numbers above 0 and below {LATEST_NS}'
    raise DecodeError(f'{RUN_START_KEY} is {start_ns!r:.40}, {allowed}')
