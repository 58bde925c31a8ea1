"""From a state to a plan: projection, first guess, numbers, bounds, solver, ladder. SI units."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mpcc_controller import bounds, explain, guess, mpcc_ocp, reference, solver, stages
from mpcc_controller.insight import Insight
from mpcc_controller.ladder import Decision, Ladder
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.shooting import Plan
from mpcc_controller.single_track import State
from mpcc_controller.stages import Scene
from mpcc_controller.target import SetPoints
from msgs_yaml.types import VehicleState


class Outcome(NamedTuple):
    """What came of one attempt."""

    decision: Decision
    said: dict  # values for `Why`


class Horizon:
    """Solves the problem once per tick and carries plan and path distance to the next one."""

    def __init__(
        self,
        params: ControllerParams,
        vehicle: CarParams,
        limit_time: bool,
        clock: Callable[[], float],
    ):
        self.params = params
        self.car = stages.car(params, vehicle)
        self.clock = clock
        size = len(params.body.circle_offsets_m), params.surroundings.max_obstacles
        self.problem = mpcc_ocp.build(params.model.horizon, params.model.step_s, *size)
        self.solver = solver.make(self.problem, _options(params, limit_time))
        self.insight = Insight(mpcc_ocp.template(*size))
        self.forget()

    def forget(self) -> None:
        """Drop the plan and the place on the path: the next tick starts anew."""
        self.ladder = Ladder(self.params.fallback)
        self.theta: float | None = None  # m, last foot on the path
        self.P: np.ndarray | None = None  # (N + 1, np), the numbers of the last solve

    def initial_state(self, x: VehicleState, now: SetPoints, scene: Scene) -> State:
        """Return the state at stage 0: the heading near the path's, theta by projection."""
        reach = self.params.surroundings.path_search_m
        self.theta = reference.project(scene.path, x.X, x.Y, self.theta, reach)
        arcs, _ = reference.at(scene.path, self.theta)
        turns = np.round((arcs.psi - x.psi) / (2 * np.pi))
        return State(
            X=x.X,
            Y=x.Y,
            psi=float(x.psi + 2 * np.pi * turns),
            vx=x.vx,
            vy=x.vy,
            r=x.r,
            theta=self.theta,
            delta=now.delta,
            Fx=now.Fx,
        )

    def solve(self, x0: State, scene: Scene) -> Outcome:
        """Return the rung for this tick, and what there is to say about it."""
        began = self.clock()
        model, ladder = self.params.model, self.ladder
        moved_on = self._moved_on(x0)
        start = moved_on
        if not ladder.is_warm:
            start = guess.from_path(scene.path, x0, self.car, model.horizon, model.step_s)
        numbers = stages.numbers(self.params, self.car, scene, start.X)
        limits = bounds.build(self.params.limits, self.car, x0.Fx, model.horizon, model.step_s)
        prepared = self.clock()
        solution = self.solver.solve(np.array(x0), numbers.P, limits, start)
        warm = ladder.is_warm
        decision = ladder.decide(solution, moved_on)
        self.P = numbers.P
        said = explain.solved(solution, prepared - began, warm)
        said |= {'plan.age': ladder.age, 'plan.failures': ladder.failures}
        if decision.plan is not None:
            view = self.insight.of(decision.plan, numbers.P)
            said |= explain.planned(view, numbers, decision.plan.U)
        return Outcome(decision, said)

    def _moved_on(self, x0) -> Plan | None:
        if self.ladder.plan is None:
            return None
        return guess.moved_on(self.ladder.plan, self.P, self.problem.dynamics, x0)


def _options(params: ControllerParams, limit_time: bool) -> solver.SolverOptions:
    rules = params.solver
    return solver.SolverOptions(
        name=rules.name,
        max_iterations=rules.max_iterations,
        tolerance=rules.tolerance,
        time_limit_s=rules.time_limit_s if limit_time else None,
        compiled=rules.compiled,
    )
