"""Messages of a scenario under a stamp, and the rates at which they are repeated. No ROS."""

from msgs_yaml import contract, conversions
from msgs_yaml.types import Health, Obstacles, Predictions
from node_runtime.input_monitor import OK, STALE
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario

NAME = 'scenario'
RUN_START = '/vehicle/run_start'


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
        self.car = (scn.start.X, scn.start.Y)  # m, where it is: what is seen depends on it
        self._start_ns = scenario.START_NS if mode == 'lockstep' else None
        self.has_plant = mode == 'lockstep'  # there the run starts at a known stamp
        topics = contract.load().topics
        self.rate_hz = topics['/scenario/obstacles'].rate_hz[mode]
        self.road_rate = RateLimiter(topics['/scenario/reference'].rate_hz[mode])
        self.health_rate = RateLimiter(topics['/diagnostics'].rate_hz[mode])

    def update_run_start(self, start_ns: int) -> None:
        """Take the start of the run, from which on obstacles move; 0 before it.

        It may come in the middle of a run, after a restart of this node.
        """
        self._start_ns = start_ns or None
        self.has_plant = True

    def obstacles(self, stamp_ns: int) -> Obstacles:
        """Return the obstacles at a stamp; before the run, those of its start."""
        return scenario.obstacles_at(self._scn, self._since_start(stamp_ns), stamp_ns, self.car)

    def predictions(self, obstacles: Obstacles) -> Predictions:
        """Return where obstacles will be, exactly."""
        t = self._since_start(obstacles.stamp_ns)
        return scenario.predictions_at(self._scn, t, obstacles)

    def _since_start(self, stamp_ns):
        start_ns = stamp_ns if self._start_ns is None else self._start_ns
        return conversions.ns_to_s(stamp_ns - start_ns)

    def health(self, stamp_ns: int) -> Health:
        """Return the health of the node."""
        if not self.has_plant:
            message = f'waiting for the plant ({RUN_START})'
            return Health(stamp_ns, NAME, STALE, message, {'obstacles': 0})
        count = len(self.obstacles(stamp_ns).items)
        return Health(stamp_ns, NAME, OK, f'publishing {self._scn.name}', {'obstacles': count})
