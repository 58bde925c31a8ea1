"""The solvers of a tick and what each is for: the followed plan, a slide, other candidates."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from mpcc_controller.driving import fallback
from mpcc_controller.driving.parallel_solves import ParallelSolves
from mpcc_controller.driving.prediction_model import PredictionModel, TickProblem
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import CONVERGED, ControllerParams
from mpcc_controller.problem import cost_terms
from stage_solver.solution import FAILED, STOPPED_EARLY, OneStep, Solution, SolverOptions
from stage_solver.solver import StageSolver, make_solver
from stage_solver.stage_problem import Plan

# of theta between a plan and the guess around which its arcs were taken: over less an arc of the
# double lane change (curvature changing by 0.01 1/m^2) is off by less than a millimetre
REFRESH_FROM_M = 0.5
MOST_REFRESHES = 3  # per tick
SLIDING_FACTOR = 3  # of `max_iterations` while a car slides
RELAXATION = 1e4  # of the weights of soft limits: tolerances 100 times as large
RELAXED = 'stuck; the plan is that of relaxed soft limits'
HANGS = 'did not return within the time limit'
THETA = State._fields.index('theta')


class TickSolvers:
    """Solves the problem of a tick within the time of the tick; solutions are in the map.

    `began` is when the time of the solvers began, by the clock [s].
    """

    def __init__(self, prediction: PredictionModel, limit_time: bool, clock: Callable[[], float]):
        """`limit_time` lets the solvers stop at their wall-time limits."""
        params, problem = prediction.params, prediction.problem
        self.prediction, self.limit_time, self.clock = prediction, limit_time, clock
        options = solver_options(params, limit_time)
        self.followed = make_solver(problem, options)
        self.sliding: StageSolver | None = None
        if params.fallback.recovery:
            # From the guess of the recovery law 44 % of 100 random slides had a plan that may be
            # driven within 100 iterations, 86 % within 300 (mpcc, sideslip to 60 deg, yaw rate to
            # 2 rad/s). In realtime the time limit holds.
            most = SLIDING_FACTOR * options.max_iterations
            longer = replace(options, max_iterations=most, one_step=None)
            self.sliding = make_solver(problem, longer)
            limits = {f'weights.{name}' for name in cost_terms.SOFT_LIMITS}
            self._soft_limits = [  # their columns in the stage parameters
                i for i, name in enumerate(problem.parameters) if name in limits
            ]
        self.parallel: ParallelSolves | None = None
        if (params.candidates.most or 1) > 1:
            most = params.candidates.max_iterations
            shorter = replace(options, max_iterations=most, one_step=None)
            self.parallel = ParallelSolves(
                lambda: make_solver(problem, shorter), params.candidates.most - 1
            )

    def warm_up(self, problem: TickProblem) -> None:
        """Let all other solvers solve a problem once, except those at work."""
        candidates = self.parallel.idle if self.parallel else ()
        for solver in (self.sliding, *candidates):
            if solver is not None:
                _solve(solver, problem, problem.guess_local._replace(multipliers=None))

    def solve(
        self, problem: TickProblem, guess: Plan | None = None, began: float | None = None
    ) -> Solution:
        """Return the solution of the followed plan; of a car that slides, see `_solve_relaxed`.

        It starts from the guess of the problem, and its time begins now, unless they are given.
        """
        guess = problem.guess_local if guess is None else guess
        began = self.clock() if began is None else began
        chosen = self._chosen(problem)
        # the paper's controller shares that time with nothing: its solver has all of it
        self._limit(chosen, began if self.parallel or self.sliding else self.clock())
        first = self._run(chosen, problem, guess)
        if chosen is not self.sliding or self.is_usable(first):
            return first
        return self._solve_relaxed(problem, guess, first, began)

    def _solve_relaxed(
        self, problem: TickProblem, guess: Plan, first: Solution, began: float
    ) -> Solution:
        """Return the solution of a car that slides by way of a relaxed problem.

        A slide breaks every soft limit: road, distances, envelope. What that costs is larger than
        all else by orders of magnitude, and Newton's method may get stuck, as in `first`. Then the
        problem in which it costs RELAXATION times less is solved from the same guess, and the true
        one from its plan; where that gets stuck, too, the relaxed plan may be driven: as an early
        end of the true problem, with the cost that it has there.
        """
        P = problem.parameters.P.copy()
        P[:, self._soft_limits] /= RELAXATION
        relaxed = problem._replace(parameters=problem.parameters._replace(P=P))
        self._limit(self.sliding, began)
        on_the_way = self._run(self.sliding, relaxed, guess._replace(multipliers=None))
        self._limit(self.sliding, began)
        start = self.prediction.formulation.to_local(on_the_way.plan, problem.scene.path)
        second = self._run(self.sliding, problem, start._replace(multipliers=None))
        best = first
        if self.is_usable(second):
            best = second
        elif self.is_usable(on_the_way):
            cost = self.prediction.evaluator.cost(start, problem.parameters.P)
            best = on_the_way._replace(cost=cost, status=STOPPED_EARLY, message=RELAXED)
        return _with_effort_of(best, (first, on_the_way, second))

    def solve_candidates(
        self,
        problems: Sequence[TickProblem],
        began: float,
        own: Callable[[], Any] = lambda: None,
    ) -> tuple[Any, list[Solution]]:
        """Return the result of `own`, called in this thread, and the solutions of candidates.

        All of them in parallel, within the time limit of the followed plan, where there is one.
        Then a candidate that does not return in the time of all solvers has failed, and this thread
        solves none of them.
        """

        def job(problem, solver):  # called in any thread
            self._limit(solver, began)
            return _solve(solver, problem, problem.guess_local)

        def patience_s():
            limit_s = self.prediction.params.solver.patience_s
            return max(limit_s - (self.clock() - began), 0.0) if self.limit_time else None

        jobs = [partial(job, problem) for problem in problems]
        result, solved = self.parallel.run(own, jobs, patience_s)
        solved = [s or _failed(p.guess_local, HANGS) for s, p in zip(solved, problems)]
        return result, [*map(self.prediction.to_map, solved, problems)]

    def refresh_arcs(
        self, model: PredictionModel, problem: TickProblem, first: Solution, began: float
    ) -> tuple[TickProblem, Solution, int]:
        """Solve again, around the plan, while theta of the plan is far from that of the guess.

        `model` built the problem. Arcs of the path, edges and slots of obstacles are those around
        the guess. Returns the last problem, its solution with the time and the iterations of all,
        and the number of further solves: at most MOST_REFRESHES, none where theta moved by up to
        REFRESH_FROM_M. A further solution that may not be driven is dropped.
        """
        chosen, refreshes = self._chosen(problem), 0
        while refreshes < MOST_REFRESHES and self.is_usable(first):
            moved = np.abs(first.plan.X[:, THETA] - problem.guess_map.X[:, THETA])
            is_late = self.limit_time and self._remaining_s(began) <= 0
            if np.max(moved) <= REFRESH_FROM_M or is_late:
                break
            self._limit(chosen, began)
            again = model.build_problem(
                problem.x0, problem.scene, first.plan, problem.car, problem.sliding
            )
            solution = self._run(chosen, again, again.guess_local)
            refreshes += 1
            if not self.is_usable(solution):
                return problem, _with_effort_of(first, (first, solution)), refreshes
            problem, first = again, _with_effort_of(solution, (first, solution))
        return problem, first, refreshes

    def is_usable(self, solution: Solution) -> bool:
        """Return whether a solution may be driven."""
        return not fallback.rejection_reason(solution, self.prediction.params.fallback)

    def _chosen(self, problem: TickProblem) -> StageSolver:
        """Return the solver of the followed plan; of a slide, one that iterates longer."""
        return self.sliding if problem.sliding and self.sliding else self.followed

    def _limit(self, solver: StageSolver, began: float) -> None:
        """Let a solver stop where the time of its tick ends."""
        if self.limit_time:
            solver.set_time_limit(self._remaining_s(began))

    def _remaining_s(self, began: float) -> float:
        limit_s = self.prediction.params.solver.time_limit_s
        return max(limit_s - (self.clock() - began), 0.0)

    def _run(self, solver: StageSolver, problem: TickProblem, guess: Plan) -> Solution:
        return self.prediction.to_map(_solve(solver, problem, guess), problem)


def solver_options(params: ControllerParams, limit_time: bool) -> SolverOptions:
    """Return the options of the solver of every tick."""
    chosen = params.solver
    one_step = OneStep(chosen.one_step_residual, chosen.one_step_decrease)
    return SolverOptions(
        max_iterations=chosen.max_iterations,
        tolerance=chosen.tolerance,
        time_limit_s=chosen.time_limit_s if limit_time else None,
        one_step=None if chosen.mode == CONVERGED else one_step,
    )


def _solve(solver: StageSolver, problem: TickProblem, guess: Plan) -> Solution:
    """Return the solution; a solver that raises has failed: the car needs a command anyway."""
    try:
        return solver.solve(problem.guess_local.X[0], problem.parameters.P, problem.bounds, guess)
    except Exception as error:
        return _failed(guess, str(error))


def _failed(guess: Plan, message: str) -> Solution:
    return Solution(guess, np.nan, FAILED, message, 0, np.inf, np.inf, 0.0, 0.0)


def _with_effort_of(solution: Solution, solves: Sequence[Solution]) -> Solution:
    """Return a solution with the iterations and times of all solves that led to it."""
    return solution._replace(
        iterations=sum(s.iterations for s in solves),
        solve_s=sum(s.solve_s for s in solves),
        cpu_s=sum(s.cpu_s for s in solves),
    )
