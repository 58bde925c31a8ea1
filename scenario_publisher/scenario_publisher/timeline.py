"""What is to be said at a stamp: obstacles of the moment, and whether facts are to be repeated."""

from msgs_yaml import contract, conversions
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Health, Obstacles, Reference, RoadEdges
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario

NAME = 'scenario'
PLANT = 'plant'
BEGAN = 'run_began_ns'  # what the plant calls the instant at which its car was let go
LATEST_NS = 2**31 * conversions.NS_PER_S  # ROS counts seconds in 32 bits
OK, STALE = 0, 3


class Beat:
    """Tells whether something is due that is to happen at a rate [Hz] of stamps."""

    def __init__(self, rate_hz: float):
        self._period_ns = round(conversions.NS_PER_S / rate_hz)
        self._last_ns = None

    def is_due(self, stamp_ns: int) -> bool:
        """Tell whether it is due at a stamp; if so, it counts as done."""
        last = self._last_ns
        # time that jumps back starts another run
        if last is not None and 0 <= stamp_ns - last < self._period_ns:
            return False
        self._last_ns = stamp_ns
        return True


class Timeline:
    """A scenario over the stamps of one run."""

    def __init__(self, scn: Scenario, mode: str):
        self._scn = scn
        self._origin_ns = scenario.START_NS if mode == 'lockstep' else None
        self._follows_clock = mode == 'lockstep'
        self.knows_plant = self._follows_clock  # there the run begins at a known stamp
        topics = contract.load().topics
        self.rate_hz = topics['/scenario/obstacles'].rate_hz[mode]
        self.facts = Beat(topics['/scenario/reference'].rate_hz[mode])
        self.health_beat = Beat(topics['/diagnostics'].rate_hz[mode])

    def hear(self, health: Health) -> None:
        """Learn from the plant when its run began: obstacles move and appear from then on.

        Also in the midst of a run, after this node was started again. Raises DecodeError for
        what is no instant; the one known before stands.
        """
        if health.name == PLANT and not self._follows_clock:
            self._origin_ns = _instant(health.values.get(BEGAN))
            self.knows_plant = True

    def obstacles(self, stamp_ns: int) -> Obstacles:
        """Return the obstacles at a stamp; before the beginning, those of the beginning."""
        origin = stamp_ns if self._origin_ns is None else self._origin_ns
        return scenario.obstacles_at(self._scn, conversions.ns_to_s(stamp_ns - origin), stamp_ns)

    def reference(self, stamp_ns: int) -> Reference:
        """Return the coarse path under a stamp."""
        return self._scn.reference._replace(stamp_ns=stamp_ns)

    def edges(self, stamp_ns: int) -> RoadEdges:
        """Return the edges under a stamp."""
        return self._scn.edges._replace(stamp_ns=stamp_ns)

    def health(self, stamp_ns: int) -> Health:
        """Return the health of the node."""
        if not self.knows_plant:
            told = 'waiting for the plant to say on /diagnostics when its run began'
            return Health(stamp_ns, NAME, STALE, told, {'obstacles': 0})
        there = len(self.obstacles(stamp_ns).items)
        return Health(stamp_ns, NAME, OK, f'publishing {self._scn.name}', {'obstacles': there})


def _instant(began_ns):
    """Return an instant as it is, None for one that is still to come."""
    # a truth is an int, too; and a float has lost nanoseconds, if it is a time at all
    if began_ns is None or (type(began_ns) is int and 0 < began_ns < LATEST_NS):
        return began_ns
    told = f'{began_ns!r:.40}'
    allowed = f'allowed are whole numbers above 0 and below {LATEST_NS}'
    raise DecodeError(f'{BEGAN} is {told}, {allowed}')
