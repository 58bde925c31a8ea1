"""Set-points between two commands: straight lines from where they are to where they are due."""

import numpy as np

from vehicle_plant.state import SetPoints


class Ramp:
    """The set-points over time, counted in steps."""

    def __init__(self, held: SetPoints):
        self._now = held
        self._target = held
        self._left = 0  # steps until the target is due

    @property
    def now(self) -> SetPoints:
        """The set-points at this step."""
        return self._now

    def aim(self, target: SetPoints, due_in: int) -> None:
        """Head for a target that is due in that many steps, at once if none are left."""
        self._target = target
        self._left = max(due_in, 1)

    def take(self, steps: int) -> np.ndarray:
        """Advance; return the set-points at the ends of the steps, (steps + 1, 3)."""
        begin, target = np.array(self._now), np.array(self._target)
        done = np.arange(steps + 1)[:, None] / max(self._left, 1)
        # the last point is the target itself, not a rounded sum
        path = np.where(done < 1, begin + (target - begin) * done, target)
        self._left = max(self._left - steps, 0)
        self._now = SetPoints(*path[-1].tolist())
        return path
