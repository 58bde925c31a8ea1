"""The obstacles that a plan is made for: measured with errors, expected to move, remembered.

/scenario/obstacles holds every known obstacle. What is not in it is unknown from then on, whether
it went away or was only missed. So what vanishes is kept for
`surroundings.memory_s` after it was last seen, wherever it was then, and forgotten after that;
an obstacle that is gone is avoided for that time at most. SI units.
"""

from typing import NamedTuple

from mpcc_controller.driving import measurement_errors
from mpcc_controller.parameters import ControllerParams, Surroundings
from mpcc_controller.problem import road_following
from mpcc_controller.problem.obstacle_motion import AnyObstacle, ObstacleObserver, moved
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import Obstacles, VehicleState


class Sighting(NamedTuple):
    """An obstacle as it was last seen."""

    stamp_ns: int
    obstacle: AnyObstacle


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


class ObstaclePerception:
    """From the obstacles of the messages, tick by tick, to those that the controller knows."""

    def __init__(self, params: ControllerParams, true_state: VehicleState):
        self._errors = params.measurement_errors
        self._surroundings = params.surroundings
        self._observer = ObstacleObserver(params.surroundings)
        self._memory = ObstacleMemory(params.surroundings)
        self.true_state = true_state  # of the car, from which it sees them

    def reset(self) -> None:
        """Forget the obstacles of earlier messages."""
        self._observer.reset()
        self._memory.reset()

    def observe(self, scene: Scene, true_state: VehicleState, seen_ns: int) -> None:
        """Take the obstacles of the last message as seen at an instant from a state of the car."""
        self.true_state = true_state
        if scene.obstacles is not None:
            self._observer.observe(self._measured(scene.obstacles, seen_ns))
            self._memory.remember(self._expected(scene, seen_ns))

    def known(self, scene: Scene, seen_ns: int) -> Obstacles:
        """Return the obstacles of the last message as seen at an instant, and remembered ones."""
        return self._memory.complete(self._expected(scene, seen_ns))

    def _expected(self, scene, seen_ns) -> Obstacles:
        """Return the obstacles of a message as seen at an instant, and how they go on."""
        seen = self._observer.predict(self._measured(scene.obstacles, seen_ns))
        if scene.path is None or scene.road is None:
            return seen
        return road_following.along_road(seen, scene.path, scene.road, self._surroundings)

    def _measured(self, obstacles, seen_ns) -> Obstacles:
        return measurement_errors.measured_obstacles(
            obstacles, self.true_state, seen_ns, self._errors
        )
