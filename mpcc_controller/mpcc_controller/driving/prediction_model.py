"""What plans are made with: parameters, car and formulation, which may change between ticks."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import guesses
from mpcc_controller.in_force import in_force
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path import compiled_queries
from mpcc_controller.problem import (
    bounds,
    formulation,
    ocp,
    problem_check,
    stage_parameters,
)
from mpcc_controller.problem.ocp import PlanEvaluator
from mpcc_controller.problem.stage_parameters import Scene, StageParameters
from stage_solver.compiled_functions import BufferedFunction
from stage_solver.solution import ONE_STEP, Solution
from stage_solver.stage_problem import Bounds, Plan, shift

CHECKED = 1024  # problems that a process remembers as checked: those of a sweep
BRAKING_PROBE = 1.15  # friction that braking uses over the one that is believed


class TickProblem(NamedTuple):
    """The optimal control problem of one tick, and what it was built from."""

    x0: State  # stage 0, in the map
    scene: Scene
    car: Car  # on the friction that is believed
    guess_map: Plan  # the initial guess, in the map
    guess_local: Plan  # the same in the states of the formulation
    parameters: StageParameters
    bounds: Bounds
    sliding: bool = False  # the car slides and is to be recovered


class PredictionModel:
    """The model of the car, the formulation of the problem, and their present parameters.

    Plans are in the map here, whatever the states of the formulation are.
    """

    def __init__(self, params: ControllerParams, vehicle: CarParams):
        self.vehicle = vehicle
        self.params = params = in_force(params, vehicle)
        self.car = stage_parameters.car(params, vehicle)  # on a road of `model.friction`
        self.formulation = formulation.make(params, self.car)
        compiled_queries.library()  # compiled now, not when the first path is set
        symbolic = self.formulation.ocp
        _check_problem(symbolic, params, self.car)
        self.problem = ocp.build(symbolic, params.model.horizon, params.model.step_s)
        self.evaluator = PlanEvaluator(symbolic)
        self._step = BufferedFunction(
            single_track.step(params.model.step_s, single_track.structure(self.car))
        )

    def car_on(self, friction: float) -> Car:
        """Return the car on a road of a friction."""
        if friction == self.params.model.friction:
            return self.car
        share, car = friction / self.params.model.friction, self.car
        return car._replace(mu_f=share * car.mu_f, mu_r=share * car.mu_r)

    def car_to_brake(self, friction: float) -> Car:
        """Return the car on a road of a little more friction than is believed.

        What is believed is cautious, and only forces beyond it tell whether the road has more. A
        car that brakes without a plan finds it so; where it is not there, the belief falls at once.
        """
        return self.car_on(min(BRAKING_PROBE * friction, self.params.model.friction))

    def change(self, params: ControllerParams) -> None:
        """Plan with other weights and limits from now on; see `run_time_parameters`."""
        self.params = in_force(params, self.vehicle)
        self.formulation.set_params(self.params)

    def step(self, x: np.ndarray, u: np.ndarray, car: Car) -> np.ndarray:
        """Return the state (9,) one tick after `x` (9,) under the input `u` (4,)."""
        return self._step(x=x, u=u, car=car)['x_next'].copy()

    def shift_to(self, plan: Plan, x0: State, car: Car) -> Plan:
        """Return a plan one tick later, starting at the predicted state `x0`."""
        return guesses.start_at(shift(plan, self.step, np.array(car)), x0)

    def build_problem(
        self, x0: State, scene: Scene, guess: Plan, car: Car, sliding: bool = False
    ) -> TickProblem:
        """Return the problem from `x0`, its stage parameters taken around the guess."""
        model, form = self.params.model, self.formulation
        parameters = form.stage_parameters(scene, guess.X, car)
        limits = bounds.build(
            self.params.limits,
            car,
            x0,
            model.horizon,
            model.step_s,
            form.ocp.state,
            len(self.params.body.circle_offsets_m),
        )
        guess_local = form.to_local(guess, scene.path)
        return TickProblem(x0, scene, car, guess, guess_local, parameters, limits, sliding)

    def to_map(self, solution: Solution, problem: TickProblem) -> Solution:
        """Return a solution in the states of its problem as one in the map."""
        plan = self.formulation.to_map(solution.plan, problem.scene.path)
        if solution.status == ONE_STEP:  # the driven step obeys the dynamics exactly
            driven = self.step(plan.X[0], plan.U[0], problem.car)
            plan = plan._replace(X=np.vstack([plan.X[:1], driven, plan.X[2:]]))
        return solution._replace(plan=plan)


@lru_cache(CHECKED)
def _check_problem(_, params, car):
    """Check the problem of a controller; of the last CHECKED ones only those that are new.

    The symbols, first, are those that the formulation of these parameters has now.
    """
    problem_check.check(formulation.make(params, car), params)
