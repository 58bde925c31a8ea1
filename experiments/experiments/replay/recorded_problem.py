"""The optimal control problem of one recorded tick, solved again as it was or changed. SI units."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from experiments.replay.recorded_ticks import Tick
from experiments.replay.replayed_controller import ReplayedController
from mpcc_controller.driving import fallback, setpoints
from mpcc_controller.driving.parts import Parts
from mpcc_controller.driving.prediction_model import PredictionModel, TickProblem
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.ocp import Constraints
from msgs_yaml.strict_yaml import closest
from msgs_yaml.types import Command, Obstacle
from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan


class ActiveLimit(NamedTuple):
    """One limit that is active over neighbouring stages."""

    quantity: str
    side: str  # lower or upper
    first: int  # stage
    last: int
    limit: float  # SI units, at the stage of the largest multiplier
    multiplier: float  # cost per SI unit, the largest
    at: int  # stage of it


class Distance(NamedTuple):
    """The distance to one obstacle or edge over the horizon."""

    name: str  # 'obstacle 1', 'left edge'
    D: np.ndarray  # (N + 1,) m
    safe: float  # m, D_sft
    weight: np.ndarray  # (N + 1,) 1/m^2, in force


class Solved(NamedTuple):
    """The solution of a problem. Arrays over the stages are (N + 1,), of inputs (N,)."""

    is_feasible: bool  # the plan may be driven
    status: str  # of the solver, for a person
    iterations: int
    command: Command  # before the gate
    t: np.ndarray  # s after the state takes effect
    states: dict[str, np.ndarray]  # in the map, by the names of `State`
    inputs: dict[str, np.ndarray]  # by the names of `Input`
    limits: dict[str, tuple[float, float]]  # of the limited states and inputs
    terms: dict[str, float]  # of the cost, by the names of the weights
    weights: dict[str, float]
    distances: tuple[Distance, ...]
    obstacles: tuple[Obstacle, ...]  # of the problem, at its first stage
    friction: dict[str, np.ndarray]  # front, rear: share that is used
    active: tuple[ActiveLimit, ...]
    circles: tuple[float, tuple[float, ...]]  # radius and offsets of the vehicle's circles [m]
    plan: Plan  # in the map, with its multipliers: the guess of a neighbouring problem

    @property
    def cost(self) -> float:
        """The sum of the terms."""
        return sum(self.terms.values())

    @property
    def least_v2o(self) -> float:
        """The least distance of the plan to any obstacle [m]; NaN without obstacles."""
        distances = [d.D for d in self.distances if d.name.startswith('obstacle')]
        return float(np.min(distances)) if distances else np.nan


@dataclass(frozen=True, eq=False, repr=False)
class Problem:
    """One problem with its solver."""

    parts: Parts
    vehicle: CarParams
    tick_problem: TickProblem
    stamp_ns: int

    @property
    def prediction(self) -> PredictionModel:
        """What its plans are made with."""
        return self.parts.model

    @property
    def weights(self) -> dict[str, float]:
        """The weight of every term of the cost."""
        weights = self.tick_problem.parameters.stages.weights._asdict()
        return {name: float(weight) for name, weight in weights.items()}

    def with_params(self, params: ControllerParams, vehicle: CarParams) -> 'Problem':
        """Return the problem of a controller with other parameters, from the same guess.

        Raises BagError for another horizon: the guess would not fit.
        """
        model = self.prediction.params.model
        if (params.model.horizon, params.model.step_s) != (model.horizon, model.step_s):
            raise BagError(
                'model.horizon and model.step_s cannot be changed in one tick: its first guess is '
                'the plan of the tick before'
            )
        return self.with_parts(Parts(params, vehicle, False, self.parts.clock))

    def with_parts(self, parts: Parts) -> 'Problem':
        """Return the problem of the parts of another controller of the same horizon."""
        params = parts.params
        guess = self.tick_problem.guess_map
        if params.formulation.name != self.prediction.params.formulation.name:
            guess = guess._replace(multipliers=None)  # of other constraints
        before = self.tick_problem
        share = before.car.mu_f / self.prediction.car.mu_f  # of the friction, as it was believed
        believed = share * self.prediction.params.model.friction
        car = parts.model.car_on(min(believed, params.model.friction))
        problem = parts.model.build_problem(before.x0, before.scene, guess, car, before.sliding)
        return Problem(parts, parts.model.vehicle, problem, self.stamp_ns)

    def with_tolerance(self, tolerance: float) -> 'Problem':
        """Return the same problem with another tolerance of the solver."""
        params = self.prediction.params
        params = replace(params, solver=replace(params.solver, tolerance=tolerance))
        return replace(self, parts=Parts(params, self.vehicle, False, self.parts.clock))

    def scale_weights(self, factors: Mapping[str, float]) -> 'Problem':
        """Return the same problem with some weights multiplied.

        Raises BagError for a weight that the formulation does not have, and for a factor below 0.
        """
        known = self.weights
        for name, factor in factors.items():
            if name not in known:
                there = f'{", ".join(known)}{closest(name, known)}'
                raise BagError(f'weights.{name}: no such weight; there are {there}')
            if not 0.0 <= factor < np.inf:
                raise BagError(f'weights.{name}: {factor!r} is out of range; allowed from 0')
        parameters = self.tick_problem.parameters
        scaled = {name: factor * known[name] for name, factor in factors.items()}
        weights = parameters.stages.weights._replace(**scaled)
        stages = parameters.stages._replace(weights=weights)
        matrix = stage_parameters.to_matrix(stages, *parameters[2:], len(parameters.P))
        return replace(self, tick_problem=self.tick_problem._replace(parameters=matrix))

    def start_from(self, solved: Solved) -> 'Problem':
        """Return the same problem with a solution, multipliers included, as its initial guess."""
        local = self._to_local(solved.plan)
        problem = self.tick_problem._replace(guess_map=solved.plan, guess_local=local)
        return replace(self, tick_problem=problem)

    def _to_local(self, plan):
        return self.prediction.formulation.to_local(plan, self.tick_problem.scene.path)

    def solve(self) -> Solved:
        """Solve it, and evaluate the plan."""
        solution = self.parts.solvers.solve(self.tick_problem)
        rejection = fallback.rejection_reason(solution, self.prediction.params.fallback)
        return self._evaluate(solution, rejection or solution.status)

    def _evaluate(self, solution: Solution, level: str) -> Solved:
        params, plan = self.prediction.params, solution.plan
        parameters = self.tick_problem.parameters
        view = self.prediction.evaluator.evaluate(self._to_local(plan), parameters.P)
        car, x0, step_s = self.tick_problem.car, self.tick_problem.x0, params.model.step_s
        target, now = setpoints.target_of_plan(plan, car, params.limits), Setpoints(x0.delta, x0.Fx)
        # the limits of the last stage: those of states and inputs are equal at all
        bounds, state = self.tick_problem.bounds, self.prediction.formulation.ocp.state
        limits = dict(zip(state._fields, zip(bounds.x_low[-1], bounds.x_high[-1])))
        limits |= dict(zip(Input._fields, zip(bounds.u_low[-1], bounds.u_high[-1])))
        return Solved(
            is_feasible=not fallback.rejection_reason(solution, params.fallback),
            status=f'{level}: {solution.message}',
            iterations=solution.iterations,
            command=setpoints.command_to(target, now, car, step_s, self.stamp_ns),
            t=step_s * np.arange(len(plan.X)),
            states=State(*plan.X.T)._asdict(),
            inputs=Input(*plan.U.T)._asdict(),
            limits={name: ends for name, ends in limits.items() if np.isfinite(ends).any()},
            terms={name: float(np.sum(term)) for name, term in view.costs._asdict().items()},
            weights=self.weights,
            distances=tuple(self._distances(view)),
            obstacles=parameters.obstacles,
            friction=view.friction._asdict(),
            active=self._active(plan) if plan.multipliers is not None else (),
            circles=(params.body.circle_radius_m, tuple(params.body.circle_offsets_m)),
            plan=plan,
        )

    def _distances(self, view):
        parameters, weights = self.tick_problem.parameters, self.weights
        safe = parameters.stages.D_sft
        for key, D, priority in stage_parameters.by_object(parameters, view.v2o, view.priority_o):
            yield Distance(f'obstacle {key}', D, safe.o, weights['v2o'] * priority)
        for side, D, priority in zip(('left', 'right'), view.v2e, view.priority_e):
            edge = float(np.max(safe.e))  # of every stage where it fits the road
            yield Distance(f'{side} edge', D, edge, weights['v2e'] * priority)

    def _active(self, plan):
        problem, bounds = self.prediction.problem, self.tick_problem.bounds
        m = plan.multipliers
        P, X = self.tick_problem.parameters.P, self._to_local(plan).X
        g = problem.constraints(X[:-1].T, plan.U.T, P[:-1].T).full().T
        h = problem.terminal_constraints(X[-1], P[-1]).full().T
        *axles, track = Constraints._fields
        rows = (*axles, *(track,) * (g.shape[1] - len(axles)))
        unit, unscaled, N = np.ones(1), np.ones(len(rows)), problem.horizon
        scale_x, scale_u = np.array(problem.scale_x), np.array(problem.scale_u)
        groups = (
            (problem.states, X[1:], bounds.x_low[1:], bounds.x_high[1:], m.x[1:], scale_x, 1),
            (problem.inputs, plan.U, bounds.u_low, bounds.u_high, m.u, scale_u),
            (rows, g, bounds.g_low, bounds.g_high, m.g, unscaled),
            (('total',), h, *(row[None] for row in (bounds.h_low, bounds.h_high, m.h)), unit, N),
        )
        return tuple(limit for group in groups for limit in find_active_limits(*group))


def pose(controller: ReplayedController, tick: Tick) -> Problem:
    """Answer a tick and return the problem that was solved for it.

    Raises BagError when none was: the controller braked without calling a solver.
    """
    before = controller.controller.memory.solved
    _, _, why, _ = controller.step(tick.inputs, tick.stamp_ns)
    solved = controller.controller.memory.solved
    if solved is None or solved is before:
        raise BagError(f'tick {tick.number}: no problem was solved: {why.message}')
    parts = controller.controller.parts
    return Problem(parts, controller.vehicle, solved.problem, tick.stamp_ns)


def find_active_limits(
    names: Sequence[str],
    values: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    multipliers: np.ndarray,
    scale: np.ndarray,
    first: int = 0,
) -> Iterator[ActiveLimit]:
    """Yield the active limits: the multiplier exceeds the remaining slack, in the solver's units.

    At the end of an interior-point method the product of both is the barrier parameter: one of
    them is large and the other one small. Arrays are (stages, quantities) in SI units.

    multipliers  cost per SI unit, positive where the upper limit pushes
    scale        (quantities,) SI units per unit of the solver
    first        the stage of row 0
    """
    force = np.abs(multipliers) * scale
    upper = multipliers > 0
    limit = np.where(upper, high, low)
    is_active = np.isfinite(limit) & (force > np.abs(limit - values) / scale)
    for i, name in enumerate(names):
        for side, pushes in (('lower', ~upper[:, i]), ('upper', upper[:, i])):
            active = np.flatnonzero(is_active[:, i] & pushes)
            # every unbroken interval of stages
            for rows in np.split(active, np.flatnonzero(np.diff(active) > 1) + 1):
                if len(rows):
                    at = int(rows[np.argmax(force[rows, i])])
                    yield ActiveLimit(
                        name,
                        side,
                        first=first + int(rows[0]),
                        last=first + int(rows[-1]),
                        limit=float(limit[at, i]),
                        multiplier=float(abs(multipliers[at, i])),
                        at=first + at,
                    )
