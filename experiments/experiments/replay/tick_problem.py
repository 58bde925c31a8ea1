"""The problem of one recorded tick, to be solved again, as it was or changed. SI units."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from experiments.replay import active
from experiments.replay.active import Active
from experiments.replay.feed import Tick
from experiments.replay.replayed_controller import Again
from mpcc_controller.driving import fallback, setpoints
from mpcc_controller.driving.planner import Planner, TickProblem
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.ocp import Constraints
from msgs_yaml.strict_yaml import closest
from msgs_yaml.types import Command, Obstacle
from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan


class Distance(NamedTuple):
    """The distance to one obstacle or edge over the horizon."""

    name: str  # 'obstacle 1', 'left edge'
    D: np.ndarray  # (N + 1,) m
    safe: float  # m, D_sft
    weight: np.ndarray  # (N + 1,) 1/m^2, in force


class Solved(NamedTuple):
    """What came of solving a problem once. Arrays over the stages are (N + 1,), of inputs (N,)."""

    good: bool  # the plan may be driven
    told: str  # how the solver ended, for a person
    iterations: int
    command: Command  # before the gate
    t: np.ndarray  # s after the state takes hold
    states: dict[str, np.ndarray]  # in the map, by the names of `State`
    inputs: dict[str, np.ndarray]  # by the names of `Input`
    limits: dict[str, tuple[float, float]]  # of states and inputs that have some
    terms: dict[str, float]  # of the cost, by the names of the weights
    weights: dict[str, float]
    distances: tuple[Distance, ...]
    obstacles: tuple[Obstacle, ...]  # those of the problem, where they are when it begins
    friction: dict[str, np.ndarray]  # front, rear: share that is used
    active: tuple[Active, ...]
    circles: tuple[float, tuple[float, ...]]  # radius and offsets of the vehicle's circles [m]
    plan: Plan  # in the map, with its multipliers: the guess of a neighbouring problem

    @property
    def cost(self) -> float:
        """The sum of the terms."""
        return sum(self.terms.values())

    @property
    def least_v2o(self) -> float:
        """The least distance to any obstacle of the plan [m]; NaN without obstacles."""
        rings = [one.D for one in self.distances if one.name.startswith('obstacle')]
        return float(np.min(rings)) if rings else np.nan


class Problem:
    """One problem with the solver that it was given to."""

    def __init__(self, horizon: Planner, vehicle: CarParams, posed: TickProblem, stamp_ns: int):
        self.horizon, self.vehicle = horizon, vehicle
        self.posed, self.stamp_ns = posed, stamp_ns

    @property
    def weights(self) -> dict[str, float]:
        """The weight of every term of the cost."""
        found = self.posed.parameters.stages.weights._asdict()
        return {name: float(weight) for name, weight in found.items()}

    def changed(self, params: ControllerParams, vehicle: CarParams) -> 'Problem':
        """Return the problem of a controller with other parameters, from the same guess.

        Raises BagError for another horizon: the guess would not fit.
        """
        before = self.horizon.params.model
        if (params.model.horizon, params.model.step_s) != (before.horizon, before.step_s):
            raise BagError(
                'model.horizon and model.step_s cannot be changed in one tick: its first guess is '
                'the plan of the tick before'
            )
        horizon = self._horizon(params, vehicle)
        start = self.posed.guess_map
        if params.formulation.name != self.horizon.params.formulation.name:
            start = start._replace(multipliers=None)  # of other constraints
        posed = horizon.build_problem(self.posed.x0, self.posed.scene, start)
        return Problem(horizon, vehicle, posed, self.stamp_ns)

    def precise(self, tolerance: float) -> 'Problem':
        """Return the same problem for a solver that ends at another tolerance."""
        params = self.horizon.params
        params = replace(params, solver=replace(params.solver, tolerance=tolerance))
        return Problem(self._horizon(params, self.vehicle), self.vehicle, self.posed, self.stamp_ns)

    def weighted(self, factors: Mapping[str, float]) -> 'Problem':
        """Return the same problem with some weights multiplied.

        Raises BagError for a weight that the formulation does not have, and for a factor below 0.
        """
        known = self.weights
        for name, factor in factors.items():
            if name not in known:
                hint = closest(name, known)
                raise BagError(
                    f'weights.{name}: no such weight; there are {", ".join(known)}{hint}'
                )
            if not 0.0 <= factor < np.inf:
                raise BagError(f'weights.{name}: {factor!r} is out of range; allowed from 0')
        numbers = self.posed.parameters
        scaled = {name: factor * known[name] for name, factor in factors.items()}
        stages_ = numbers.stages._replace(weights=numbers.stages.weights._replace(**scaled))
        numbers = stage_parameters.to_matrix(stages_, numbers.obstacles, len(numbers.P))
        return self._with(self.posed._replace(parameters=numbers))

    def begun_at(self, solved: Solved) -> 'Problem':
        """Return the same problem with a solution, multipliers included, as its first guess."""
        begin = self.horizon.formulation.to_local(solved.plan, self.posed.scene.path)
        return self._with(self.posed._replace(guess_map=solved.plan, guess_local=begin))

    def _horizon(self, params, vehicle):
        return Planner(params, vehicle, limit_time=False, clock=self.horizon.clock)

    def _with(self, posed):
        return Problem(self.horizon, self.vehicle, posed, self.stamp_ns)

    def solve(self) -> Solved:
        """Solve it, with the second solver where the first one fails, and look at the plan."""
        rules = self.horizon.params.fallback
        first, second = self.horizon.solve(self.posed)
        if second is not None and not fallback.rejection_reason(second, rules):
            return self._looked_at(second, fallback.SECOND_SOLVER)
        return self._looked_at(first, fallback.rejection_reason(first, rules) or first.status)

    def _looked_at(self, solution: Solution, rung: str) -> Solved:
        horizon, posed = self.horizon, self.posed
        params, numbers, plan = horizon.params, posed.parameters, solution.plan
        view = horizon.evaluator.evaluate(
            horizon.formulation.to_local(plan, posed.scene.path), numbers.P
        )
        names = [f'obstacle {one.id}' for one in numbers.obstacles]
        rings = [*zip(names, view.v2o, view.priority_o), *_edges(view)]
        safe = stage_parameters.safety_distance(params)
        return Solved(
            good=not fallback.rejection_reason(solution, params.fallback),
            told=f'{rung}: {solution.message}',
            iterations=solution.iterations,
            command=self._command(plan),
            t=params.model.step_s * np.arange(len(plan.X)),
            states=State(*plan.X.T)._asdict(),
            inputs=Input(*plan.U.T)._asdict(),
            limits=self._limits(),
            terms={name: float(np.sum(term)) for name, term in view.costs._asdict().items()},
            weights=self.weights,
            distances=tuple(
                Distance(
                    name,
                    D,
                    *(safe.o, self.weights['v2o'] * q)
                    if name in names
                    else (safe.e, self.weights['v2e'] * q),
                )
                for name, D, q in rings
            ),
            obstacles=numbers.obstacles,
            friction=view.friction._asdict(),
            active=self._active(plan) if plan.multipliers is not None else (),
            circles=(params.body.circle_radius_m, tuple(params.body.circle_offsets_m)),
            plan=plan,
        )

    def _command(self, plan) -> Command:
        params, car, x0 = self.horizon.params, self.horizon.car, self.posed.x0
        goal = setpoints.target_of_plan(plan, car, params.limits)
        now = Setpoints(x0.delta, x0.Fx)
        return setpoints.command_to(goal, now, car, params.model.step_s, self.stamp_ns)

    def _limits(self):
        """The last stage's: limits of states and inputs are the same at all of them."""
        bounds = self.posed.bounds
        state = self.horizon.formulation.ocp.state
        found = dict(zip(state._fields, zip(bounds.x_low[-1], bounds.x_high[-1])))
        found |= dict(zip(Input._fields, zip(bounds.u_low[-1], bounds.u_high[-1])))
        return {name: pair for name, pair in found.items() if np.any(np.isfinite(pair))}

    def _active(self, plan):
        problem, posed = self.horizon.problem, self.posed
        P, bounds, m = posed.parameters.P, posed.bounds, plan.multipliers
        X = self.horizon.formulation.to_local(plan, posed.scene.path).X
        g = problem.constraints(X[:-1].T, plan.U.T, P[:-1].T).full().T
        h = problem.terminal_constraints(X[-1], P[-1]).full().T
        even = np.ones(len(Constraints._fields))
        last = problem.horizon
        groups = (
            active.Group(
                problem.states, X[1:], bounds.x_low[1:], bounds.x_high[1:], m.x[1:],
                np.array(problem.scale_x), first=1,
            ),
            active.Group(
                problem.inputs, plan.U, bounds.u_low, bounds.u_high, m.u, np.array(problem.scale_u)
            ),
            active.Group(Constraints._fields, g, bounds.g_low, bounds.g_high, m.g, even),
            active.Group(
                ('total',), h, bounds.h_low[None], bounds.h_high[None], m.h[None], even[:1],
                first=last,
            ),
        )  # fmt: skip
        return tuple(one for group in groups for one in active.of(group))


def of_tick(repeated: Again, tick: Tick) -> Problem:
    """Answer a tick and return the problem that was solved for it.

    Raises BagError when none was: the controller braked without asking a solver.
    """
    horizon = repeated.controller.planner
    before = horizon.last_problem
    _, _, why = repeated.answer(tick.told, tick.stamp_ns)
    if horizon.last_problem is before:
        raise BagError(f'tick {tick.number}: no problem was solved: {why.message}')
    return Problem(horizon, repeated.vehicle, horizon.last_problem, tick.stamp_ns)


def _edges(view):
    return zip(('left edge', 'right edge'), view.v2e, view.priority_e)
