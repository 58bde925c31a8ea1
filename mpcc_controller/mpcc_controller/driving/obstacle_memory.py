"""Obstacles that vanish from the message for a moment are remembered, and moved on. SI units.

/scenario/obstacles holds every known obstacle. What is not in it is unknown from then on, whether
it went away or was only missed. So what vanishes is kept for
`surroundings.memory_s` after it was last seen, wherever it was then, and forgotten after that;
an obstacle that is gone is avoided for that time at most.
"""

from typing import NamedTuple

from mpcc_controller.parameters import Surroundings
from mpcc_controller.problem.obstacle_motion import BrakingObstacle, moved
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import Obstacle, Obstacles


class Sighting(NamedTuple):
    """An obstacle as it was last seen."""

    stamp_ns: int
    obstacle: Obstacle | BrakingObstacle


class ObstacleMemory:
    """Remembers obstacles by their id for `surroundings.memory_s`; without it, none."""

    def __init__(self, params: Surroundings):
        self._memory_s = params.memory_s
        self.reset()

    def reset(self) -> None:
        """Forget every obstacle."""
        self._last: dict[int, Sighting] = {}

    def remember(self, seen: Obstacles) -> None:
        """Take what is seen; forget what was last seen too long ago, or after that (in a loop)."""
        if not self._memory_s:
            return
        self._last |= {o.id: Sighting(seen.stamp_ns, o) for o in seen.items}
        self._last = {
            key: sighting
            for key, sighting in self._last.items()
            if 0.0 <= ns_to_s(seen.stamp_ns - sighting.stamp_ns) <= self._memory_s
        }

    def complete(self, seen: Obstacles) -> Obstacles:
        """Return what is seen and, behind it, what is remembered, moved to the stamp of `seen`."""
        present = {o.id for o in seen.items}
        missed = tuple(
            moved(last.obstacle, ns_to_s(seen.stamp_ns - last.stamp_ns))
            for key, last in self._last.items()
            if key not in present
        )
        return seen._replace(items=seen.items + missed) if missed else seen
