"""From a state to a plan: projection, first guess, numbers, bounds, solvers, ladder. SI units."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from mpcc_controller import limits_in_force
from mpcc_controller.driving import chosen, explain, guess, ladder
from mpcc_controller.driving.ladder import Decision, Ladder
from mpcc_controller.driving.target import SetPoints
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path import reference
from mpcc_controller.problem import bounds, formulation, ocp, stages
from mpcc_controller.problem.insight import Insight
from mpcc_controller.problem.stages import Numbers, Scene
from msgs_yaml.types import VehicleState
from stage_solver.solution import FAILED, ONE_STEP, Solution, StageSolver
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Bounds, Plan, shift


class Outcome(NamedTuple):
    """What came of one attempt."""

    decision: Decision
    tell: Callable[[], dict]  # values for `Why`, worked out when asked for: the command goes first


class Posed(NamedTuple):
    """The problem of one tick, as the solvers were given it, and what it was made from."""

    x0: State  # stage 0, in the map
    scene: Scene
    start: Plan  # the first guess, in the map
    begin: Plan  # the same, in the states of the problem
    numbers: Numbers
    bounds: Bounds

    @property
    def arguments(self) -> tuple:
        """What a `StageSolver` takes before the guess."""
        return self.begin.X[0], self.numbers.P, self.bounds


class Horizon:
    """Solves the problem once per tick and carries plan and path distance to the next one.

    Plans are in the map here, whatever the states of the problem are (`formulation`).
    """

    def __init__(
        self,
        params: ControllerParams,
        vehicle: CarParams,
        limit_time: bool,
        clock: Callable[[], float],
    ):
        self.params = params = limits_in_force.apply(params, vehicle)
        self.car = stages.car(params, vehicle)
        self.clock = clock
        self.formulation = formulation.make(params, self.car)
        formula = self.formulation.formula
        self.problem = ocp.build(formula, params.model.horizon, params.model.step_s)
        self.solver = make_solver(self.problem, chosen.options(params, limit_time))
        self.second = chosen.second(params, self.problem, limit_time, self.solver)
        self.limit_time = limit_time
        self.insight = Insight(formula)
        self.motion = single_track.step(params.model.step_s)
        self.forget()

    def forget(self) -> None:
        """Drop the plan and the place on the path: the next tick starts anew."""
        self.ladder = Ladder(self.params.fallback)
        self.theta: float | None = None  # m, last foot on the path
        self.posed: Posed | None = None  # the problem that was solved last
        self.expected: Plan | None = None  # solves the problem that is expected next

    def foot(self, x: VehicleState, scene: Scene) -> float:
        """Return the distance [m] along the path of the point next to the car."""
        reach = self.params.surroundings.path_search_m
        self.theta = reference.project(scene.path, x.X, x.Y, self.theta, reach)
        return self.theta

    def initial_state(self, x: VehicleState, now: SetPoints, scene: Scene) -> State:
        """Return the state at stage 0: the heading near the path's, theta by projection."""
        theta = self.foot(x, scene)
        arcs, _ = reference.at(scene.path, theta)
        turns = np.round((arcs.psi - x.psi) / (2 * np.pi))
        return State(
            X=x.X,
            Y=x.Y,
            psi=float(x.psi + 2 * np.pi * turns),
            vx=x.vx,
            vy=x.vy,
            r=x.r,
            theta=theta,
            delta=now.delta,
            Fx=now.Fx,
        )

    def solve(self, x0: State, scene: Scene) -> Outcome:
        """Return the rung for this tick, and what there is to say about it."""
        began = self.clock()
        model = self.params.model
        moved_on = self._moved_on(x0)
        warm = self.ladder.is_warm
        start = moved_on
        if not warm:
            start = guess.from_path(scene.path, x0, self.car, model.horizon, model.step_s)
        elif self.ladder.failures:
            start = moved_on._replace(multipliers=None)  # they led the solver nowhere
        posed = self.posed = self.pose(x0, scene, start)
        prepared = self.clock()
        first, second = self.attempt(posed)
        decision = self.ladder.decide(first, second, moved_on)
        said = explain.solved(first, second, prepared - began, warm)
        said |= {'plan.age': self.ladder.age, 'plan.failures': self.ladder.failures}
        return Outcome(decision, partial(self._told, said, posed, decision.plan))

    def _told(self, said: dict, posed: Posed, plan: Plan | None) -> dict:
        numbers, path = posed.numbers, posed.scene.path
        told = explain.surroundings(posed.x0, posed.scene, numbers.obstacles, self.params)
        if plan is not None:
            view = self.insight.of(self.formulation.enter(plan, path), numbers.P)
            told |= explain.planned(view, numbers, plan.U)
        return said | told

    def prepare(self, scene: Scene) -> Solution | None:
        """Solve the problem that is expected at the next tick, and keep its plan to start there.

        The expected state is that of the plan, `scene` that of the next tick. Returns the
        solution; None where there is no plan, or the last one was hard to find.
        """
        plan = self.ladder.plan
        self.expected = None
        if plan is None or self.ladder.failures:
            return None
        x0 = State(*plan.X[1])
        posed = self.pose(x0, scene, guess.moved_on(plan, self.motion, self.car, x0))
        found = self._asked(self.solver, posed, posed.begin)
        if not ladder.fault(found, self.params.fallback):
            self.expected = found.plan
        return found

    def _begin(self, posed: Posed) -> Plan:
        """Return the first guess: the plan that was prepared for this tick, where there is one.

        The numbers of the problem stay those around the last plan moved on, so that preparation
        changes the way to the solution and not the problem.
        """
        expected, self.expected = self.expected, None
        if expected is None or posed.start.multipliers is None:
            return posed.begin
        return self.formulation.enter(guess.start_at(expected, posed.x0), posed.scene.path)

    def pose(self, x0: State, scene: Scene, start: Plan) -> Posed:
        """Return the problem from `x0`, its numbers around the first guess `start` in the map."""
        model, form = self.params.model, self.formulation
        numbers = form.numbers(scene, start.X)
        limits = bounds.build(
            self.params.limits, self.car, x0.Fx, model.horizon, model.step_s, form.formula.state
        )
        return Posed(x0, scene, start, form.enter(start, scene.path), numbers, limits)

    def attempt(self, posed: Posed) -> tuple[Solution, Solution | None]:
        """Return the first solver's solution, and the second one's where it had to be asked."""
        began = self.clock()
        first = self._asked(self.solver, posed, self._begin(posed))
        if not self.second or not ladder.fault(first, self.params.fallback):
            return first, None
        if self.limit_time:
            left_s = self.params.solver.fallback_limit_s - (self.clock() - began)
            self.second.set_time_limit(max(left_s, 0.0))
        unaided = posed.begin._replace(multipliers=None)
        return first, self._asked(self.second, posed, unaided)

    def brake(self, reason: str, x0: State, scene: Scene) -> Outcome:
        """Return the last rung without solving, and the distances there are to tell."""

        def tell():
            here = State(*(np.array([value]) for value in x0))
            near = stages.most_dangerous(self.params, scene.obstacles, here, np.zeros(1))
            return explain.surroundings(x0, scene, near, self.params)

        return Outcome(self.ladder.brake(reason), tell)

    def without_state(self, reason: str) -> Decision:
        """Return the rung for a tick whose state is not known: the plan goes on as planned."""
        plan = self.ladder.plan
        if plan is not None:
            plan = shift(plan, self.motion, np.array(self.car))
        return self.ladder.without_solution(reason, plan)

    def _asked(self, asked: StageSolver, posed: Posed, begin: Plan) -> Solution:
        """Return the solution, in the map; one that raises is a failed one.

        The car needs a command all the same.
        """
        try:
            found = asked.solve(*posed.arguments, begin)
        except Exception as error:
            found = Solution(begin, np.nan, FAILED, str(error), 0, np.inf, np.inf, 0.0, 0.0)
        plan = self.formulation.leave(found.plan, posed.scene.path)
        if found.status == ONE_STEP:  # what is driven obeys the dynamics without a rest
            first = self.motion(plan.X[0], plan.U[0], np.array(self.car)).full().ravel()
            plan = plan._replace(X=np.vstack([plan.X[:1], first, plan.X[2:]]))
        return found._replace(plan=plan)

    def _moved_on(self, x0) -> Plan | None:
        if self.ladder.plan is None:
            return None
        return guess.moved_on(self.ladder.plan, self.motion, self.car, x0)
