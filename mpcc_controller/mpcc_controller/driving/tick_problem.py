"""The optimal control problem of one tick."""

from typing import NamedTuple

import numpy as np

from mpcc_controller.model.single_track import State
from mpcc_controller.problem.stage_parameters import Scene, StageParameters
from stage_solver.stage_problem import Bounds, Plan


class TickProblem(NamedTuple):
    """The optimal control problem of one tick, and what it was built from."""

    x0: State  # stage 0, in the map
    scene: Scene
    guess_map: Plan  # the initial guess, in the map
    guess_local: Plan  # the same in the states of the formulation
    parameters: StageParameters
    bounds: Bounds
    sliding: bool = False  # the car slides and is to be recovered

    @property
    def solver_arguments(self) -> tuple[np.ndarray, np.ndarray, Bounds]:
        """What a `StageSolver` takes before the guess."""
        return self.guess_local.X[0], self.parameters.P, self.bounds
