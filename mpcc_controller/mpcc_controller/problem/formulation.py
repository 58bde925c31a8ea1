"""The two controllers behind one face: the paper's MPCC and its baseline.

Outside a formulation a plan is in the map: its states are `single_track.State`, its theta the
distance along the path. Inside it is in the states of the problem that is solved.
"""

from typing import Protocol

import numpy as np

from mpcc_controller.model.single_track import Car
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path.reference import Path
from mpcc_controller.problem import frenet_stages, stages
from mpcc_controller.problem.ocp import Formula
from mpcc_controller.problem.stages import Numbers, Scene
from node_runtime.parameters import ParameterError
from stage_solver.stage_problem import Plan


class Formulation(Protocol):
    """What a receding horizon needs to know of a problem."""

    formula: Formula

    def numbers(self, scene: Scene, guess: np.ndarray) -> Numbers:
        """Return the numbers of every stage around guessed states in the map (N + 1, 9)."""

    def enter(self, plan: Plan, path: Path) -> Plan:
        """Return a plan in the map in the states of the problem."""

    def leave(self, plan: Plan, path: Path) -> Plan:
        """Return a plan of the problem in the map."""


class Mpcc:
    """The paper's: its states are those of the map."""

    def __init__(self, params: ControllerParams, car: Car):
        self.params, self.car = params, car
        self.formula = stages.formula(params)

    def numbers(self, scene: Scene, guess: np.ndarray) -> Numbers:
        """See `Formulation`."""
        return stages.numbers(self.params, self.car, scene, guess)

    def enter(self, plan: Plan, path: Path) -> Plan:
        """See `Formulation`."""
        return plan

    leave = enter


class Frenet:
    """The baseline of Brown & Gerdes: its states lie along the coarse path."""

    def __init__(self, params: ControllerParams, car: Car):
        self.params, self.car = params, car
        self.formula = frenet_stages.formula(params)

    def numbers(self, scene: Scene, guess: np.ndarray) -> Numbers:
        """See `Formulation`."""
        return frenet_stages.numbers(self.params, self.car, scene, guess)

    def enter(self, plan: Plan, path: Path) -> Plan:
        """See `Formulation`."""
        return frenet_stages.entered(plan, path)

    def leave(self, plan: Plan, path: Path) -> Plan:
        """See `Formulation`."""
        return frenet_stages.left(plan, path)


FORMULATIONS = {'mpcc': Mpcc, 'frenet': Frenet}


def make(params: ControllerParams, car: Car) -> Formulation:
    """Return the formulation that the parameters name.

    Raises ParameterError for a rule that the baseline does not have.
    """
    chosen = params.formulation
    if chosen.name == 'frenet' and (chosen.distance != 'path' or chosen.lag):
        raise ParameterError(
            'formulation: frenet measures along the path and has no lag error; '
            "allowed with it: distance 'path' and lag false"
        )
    return FORMULATIONS[chosen.name](params, car)
