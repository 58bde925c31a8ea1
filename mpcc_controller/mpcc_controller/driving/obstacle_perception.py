"""The obstacles that a plan is made for: measured with errors, expected to brake, remembered."""

from mpcc_controller.driving import measurement_errors
from mpcc_controller.driving.obstacle_memory import ObstacleMemory
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem.obstacle_motion import ObstacleObserver
from msgs_yaml.types import Obstacles, VehicleState


class ObstaclePerception:
    """From the obstacles of the messages, tick by tick, to those that the controller knows."""

    def __init__(self, params: ControllerParams, true_state: VehicleState):
        self._errors = params.measurement_errors
        self._observer = ObstacleObserver(params.surroundings)
        self._memory = ObstacleMemory(params.surroundings)
        self.true_state = true_state  # of the car, from which it sees them

    def reset(self) -> None:
        """Forget the obstacles of earlier messages."""
        self._observer.reset()
        self._memory.reset()

    def observe(self, obstacles: Obstacles | None, true_state: VehicleState, seen_ns: int) -> None:
        """Take the obstacles of the last message as seen at an instant from a state of the car."""
        self.true_state = true_state
        if obstacles is not None:
            self._observer.observe(self._measured(obstacles, seen_ns))
            self._memory.remember(self._expected(obstacles, seen_ns))

    def known(self, obstacles: Obstacles, seen_ns: int) -> Obstacles:
        """Return the obstacles of the last message as seen at an instant, and remembered ones."""
        return self._memory.complete(self._expected(obstacles, seen_ns))

    def _expected(self, obstacles, seen_ns) -> Obstacles:
        """Return the obstacles of a message as seen at an instant, and how they brake."""
        return self._observer.predict(self._measured(obstacles, seen_ns))

    def _measured(self, obstacles, seen_ns) -> Obstacles:
        return measurement_errors.measured_obstacles(
            obstacles, self.true_state, seen_ns, self._errors
        )
