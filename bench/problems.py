"""The problems of closed loops, how each solver starts on them, and how good its answers are.

An answer is compared with what IPOPT finds from the same start; other minima are identified. Cost
and residual are evaluated from the stage functions.
"""

import hashlib
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import closed_loops
import numpy as np
from closed_loops import Loop

from experiments import simulation
from mpcc_controller.driving import guesses, tick_solvers
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import Plans
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import Fallback
from mpcc_controller.path import reference_path
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from mpcc_controller.problem.stage_parameters import Scene
from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solution import SOLVED, SolverOptions
from stage_solver.solver import StageSolver
from stage_solver.stage_problem import Bounds, Plan, StageProblem, shift

RECORDING_SOLVER = 'fatrop'  # its plans are driven
POP_UP_EVERY = 6  # ticks
POP_UP_AHEAD_M = (15.0, 40.0)
POP_UP_BESIDE_M = (-1.5, 1.5)
POP_UP_RADIUS_M = (0.4, 1.2)
POP_UP_SEED = 1
FIRST, WARM, COLD, POP_UP = 'first', 'warm', 'cold', 'pop-up'
REFERENCE = SolverOptions(max_iterations=1000, tolerance=1e-8)  # of every cost gap
MAX_GAP = 1e-4  # of the cost
MIN_COST = 1e-2  # gaps are relative to this where the cost is lower
MAX_RESIDUAL = 1e-4  # solver units
APART = 1e-2  # solver units (m, rad, kN, ...): minima that differ more are not the same
GOOD, OTHER_MINIMUM, WORSE, INFEASIBLE = 'good', 'other minimum', 'worse', 'infeasible'


class Posed(NamedTuple):
    """The problem of a tick, SI units.

    The numbers P of the stages depend on the guess around which they are made: `P` belongs to the
    plan moved on, `cold_P` to the drive along the path that starts a controller, `pop_up_P`, at
    some ticks, to the plan moved on with one obstacle more than a tick before.
    """

    loop: str
    tick: int
    x0: np.ndarray  # (nx,)
    P: np.ndarray  # (N + 1, np)
    bounds: Bounds
    cold_P: np.ndarray
    cold: Plan
    pop_up_P: np.ndarray | None


class Task(NamedTuple):
    """One solve: what kind of start it has, then the arguments of StageSolver.solve.

    FIRST is the first of a loop, which has no plan to start from; WARM has one; COLD could have one
    but must do without; POP_UP has one, but an obstacle has appeared.
    """

    kind: str
    x0: np.ndarray
    P: np.ndarray
    bounds: Bounds
    start: Plan


def record(loops: Iterable[Loop]) -> list[Posed]:
    """Drive the loops and return their problems; equal loops give equal problems."""
    random = np.random.default_rng(POP_UP_SEED)
    return [posed for loop in loops for posed in _recorded(loop, random)]


def _recorded(loop, random) -> Iterator[Posed]:
    setup = closed_loops.make_setup(loop)
    controller = Controller(setup.params, setup.vehicle)
    parts, model = controller.parts, setup.params.model
    options = tick_solvers.solver_options(setup.params, limit_time=False)
    parts.solvers.followed = ReferenceSolver(parts.model.problem, RECORDING_SOLVER, options)
    stage_parameters = parts.model.formulation.stage_parameters
    for number, step in enumerate(simulation.steps(setup, controller)):
        if number >= loop.ticks.stop:
            return
        attempt = step.record.attempt
        if not attempt or controller.memory.plans.plan is None or number not in loop.ticks:
            continue
        problem = attempt.problem
        scene, x0, guess = problem.scene, problem.x0, problem.guess_local
        cold = guesses.from_path(scene.path, x0, controller.car, model.horizon, model.step_s)
        pop_up_P = None
        if number % POP_UP_EVERY == 0 and setup.params.priorities.obstacle > 0:
            pop_up_P = stage_parameters(_popped_up(scene, x0, random), guess.X).P
        P, cold_P = problem.parameters.P, stage_parameters(scene, cold.X).P
        yield Posed(loop.name, number, guess.X[0], P, problem.bounds, cold_P, cold, pop_up_P)


def _popped_up(scene: Scene, x0: State, random) -> Scene:
    """Return the scene with one more obstacle beside the path ahead."""
    at, _ = reference_path.arcs_at(scene.path, [x0.theta + random.uniform(*POP_UP_AHEAD_M)])
    X, Y, psi = (float(field[0]) for field in (at.X, at.Y, at.psi))
    beside = random.uniform(*POP_UP_BESIDE_M)
    known = scene.obstacles
    obstacle = PredictedObstacle(
        id=1 + max((o.id for o in known.items), default=0),
        X=X - beside * np.sin(psi),
        Y=Y + beside * np.cos(psi),
        r_obs=random.uniform(*POP_UP_RADIUS_M),
        vX=0.0,
        vY=0.0,
    )
    return scene._replace(obstacles=known._replace(items=(*known.items, obstacle)))


def tasks(
    problem: StageProblem, given: list[Posed], rules: Fallback, solver: StageSolver, cold_every: int
) -> list[Task]:
    """Return the tasks of one solver: its own plans, moved on as in the controller, start them.

    Every `cold_every`-th problem is to be solved from a cold start as well.
    """
    warm, plans, before = [], Plans(), None
    for posed in given:
        follows = before and (before.loop, before.tick + 1) == (posed.loop, posed.tick)
        if not follows:
            plans = Plans()
        P, start, moved_on = posed.cold_P, posed.cold, None
        if plans.plan is not None:
            state = State(*posed.x0)
            moved_on = guesses.start_at(shift(plans.plan, problem.dynamics, before.P[-1]), state)
        if plans.is_warm(rules):
            P, start = posed.P, moved_on
            if plans.failures:  # as the controller does after a failure
                start = moved_on._replace(multipliers=None)
        task = Task(WARM if follows else FIRST, posed.x0, P, posed.bounds, start)
        plans, _ = plans.decide(rules, solver.solve(*task[1:]), moved_on)
        warm.append(task)
        before = posed
    cold = [Task(COLD, p.x0, p.cold_P, p.bounds, p.cold) for p in given[::cold_every]]
    pop_up = [
        task._replace(kind=POP_UP, P=posed.pop_up_P)
        for task, posed in zip(warm, given)
        if posed.pop_up_P is not None and task.kind == WARM
    ]
    return warm + cold + pop_up


class Assessment(NamedTuple):
    """The quality of one answer."""

    kind: str
    gap: float  # relative, to the reference; nan where there is none or the plan is infeasible
    residual: float  # solver units


class Assessor:
    """Compares answers to one problem with those of a reference solver."""

    def __init__(self, problem: StageProblem):
        self.problem = problem
        functions = problem.stage_cost, problem.dynamics, problem.constraints
        self._stages = [function.map(problem.horizon) for function in functions]
        self._reference = ReferenceSolver(problem, 'ipopt', REFERENCE, compiled=True)
        self._minima: dict[bytes, tuple[Plan, float] | None] = {}

    def assess(self, task: Task, plan: Plan) -> Assessment:
        """Return the assessment of a plan that answers a task.

        GOOD: feasible, and the cost is that of the minimum which the reference finds from the same
        start. OTHER_MINIMUM: feasible, and the cost is that of the minimum which the reference
        finds from that plan, which is APART from the former. WORSE: feasible, none of these.
        """
        cost, residual = self.evaluate(task, plan)
        if residual > MAX_RESIDUAL:
            return Assessment(INFEASIBLE, np.nan, residual)
        reference = self._minimum(task, task.start)
        gap = np.nan if reference is None else _gap(cost, reference[1])
        if abs(gap) <= MAX_GAP:
            return Assessment(GOOD, gap, residual)
        near = self._minimum(task, plan)
        if near is None or abs(_gap(cost, near[1])) > MAX_GAP:
            return Assessment(WORSE, gap, residual)
        if reference is None:
            return Assessment(GOOD, _gap(cost, near[1]), residual)
        apart = np.max(np.abs(near[0].X - reference[0].X) / self.problem.scale_x)
        return Assessment(OTHER_MINIMUM if apart > APART else WORSE, gap, residual)

    def evaluate(self, task: Task, plan: Plan) -> tuple[float, float]:
        """Return cost and residual of a plan that answers a task.

        The residual is the largest violation of start, dynamics, bounds or constraints in solver
        units; that of a plan that is not finite is inf.
        """
        (X, U, _), P, bounds, problem = plan, task.P, task.bounds, self.problem
        scale_x = np.array(problem.scale_x)
        costs, X_next, g = (f(X[:-1].T, U.T, P[:-1].T).full().T for f in self._stages)
        h = problem.terminal_constraints(X[-1], P[-1]).full().ravel()
        limited = (
            (X[0] / scale_x, task.x0 / scale_x, task.x0 / scale_x),
            (X[1:] / scale_x, X_next / scale_x, X_next / scale_x),
            (X[1:] / scale_x, bounds.x_low[1:] / scale_x, bounds.x_high[1:] / scale_x),
            (U / problem.scale_u, bounds.u_low / problem.scale_u, bounds.u_high / problem.scale_u),
            (g, bounds.g_low, bounds.g_high),
            (h, bounds.h_low, bounds.h_high),
        )
        violations = (np.maximum(low - x, x - high) for x, low, high in limited)
        # numpy's maximum propagates NaN, Python's does not
        largest = float(np.max([np.max(v, initial=0.0) for v in violations]))
        cost = float(costs.sum() + problem.terminal_cost(X[-1], P[-1]))
        return cost, largest if np.isfinite(largest) else np.inf

    def _minimum(self, task, start):
        """Return the reference's plan and its cost from a start, None where it fails."""
        content = b''.join(array.tobytes() for array in (task.x0, task.P, start.X, start.U))
        key = hashlib.sha256(content).digest()
        if key not in self._minima:
            solution = self._reference.solve(*task[1:-1], start)
            cost, residual = self.evaluate(task, solution.plan)
            is_minimum = solution.status == SOLVED and residual <= MAX_RESIDUAL
            self._minima[key] = (solution.plan, cost) if is_minimum else None
        return self._minima[key]


def _gap(cost, reference):
    return (cost - reference) / max(abs(reference), MIN_COST)
