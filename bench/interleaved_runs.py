"""Solve every problem with every solver, in turn: a busy machine slows all of them alike."""

import gc
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from problems import Problems

from mpcc_controller.driving import initial_guess
from mpcc_controller.driving.fallback import FallbackLogic
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import Fallback
from stage_solver.solution import StageSolver
from stage_solver.stage_problem import Bounds, Plan, StageProblem

FIRST, WARM, COLD, POP_UP = 'first', 'warm', 'cold', 'pop-up'


class Task(NamedTuple):
    """One solve: the arguments of StageSolver.solve, and what kind of start it has.

    FIRST is the first of a loop, which has no plan to start from; WARM has one; COLD could have one
    but must do without; POP_UP has one, but an obstacle has appeared.
    """

    kind: str
    x0: np.ndarray
    P: np.ndarray
    bounds: Bounds
    start: Plan

    @property
    def arguments(self) -> tuple:
        """The arguments of StageSolver.solve."""
        return self.x0, self.P, self.bounds, self.start


class Answer(NamedTuple):
    """The answer of a solver to a task, without the cost and residual that it reports."""

    plan: Plan
    iterations: int
    message: str


class Timings(NamedTuple):
    """Tasks, answers and times by label of the solver; `seconds` are (passes, tasks)."""

    tasks: dict[str, list[Task]]
    answers: dict[str, list[Answer]]
    seconds: dict[str, np.ndarray]


def tasks(
    problem: StageProblem, problems: Problems, rules: Fallback, solver: StageSolver, cold_every: int
) -> list[Task]:
    """Return the tasks of one solver: its own plans, moved on as in the controller, start them.

    Every `cold_every`-th problem is to be solved from a cold start as well.
    """
    warm = _chain(problem, problems, rules, solver)
    cold = [
        Task(
            COLD, problems.x0[k], problems.cold_P[k], problems.bounds_of(k), problems.cold_start(k)
        )
        for k in range(0, len(warm), cold_every)
    ]
    pop_up = [
        warm[k]._replace(kind=POP_UP, P=P)
        for k, P in zip(problems.pop_up, problems.pop_up_P)
        if warm[k].kind == WARM
    ]
    return warm + cold + pop_up


def _chain(problem, problems, rules, solver):
    """Solve the problems in their order; each accepted plan is the start of the next one."""
    tasks, fallback = [], None
    for k, x0 in enumerate(problems.x0):
        if not problems.continues(k):
            fallback = FallbackLogic(rules)
        moved_on = None
        if fallback.plan is not None:
            moved_on = initial_guess.shift_to(
                fallback.plan, problem.dynamics, problems.P[k - 1][-1], State(*x0)
            )
        kind = WARM if problems.continues(k) else FIRST
        P, start = problems.P[k], moved_on
        if not fallback.is_warm:
            P, start = problems.cold_P[k], problems.cold_start(k)
        elif fallback.failures:  # as the controller does after a failure
            start = moved_on._replace(multipliers=None)
        task = Task(kind, x0, P, problems.bounds_of(k), start)
        fallback.decide(solver.solve(*task.arguments), None, moved_on)
        tasks.append(task)
    return tasks


def run(
    solvers: dict[str, StageSolver],
    given: dict[str, list[Task]],
    passes: int,
    report: Callable[[], None],
) -> Timings:
    """Solve all tasks `passes` times, the solvers in turn; call `report` after every task."""
    count = len(next(iter(given.values())))
    seconds = {label: np.full((passes, count), np.nan) for label in solvers}
    answers = {label: [None] * count for label in solvers}
    order = list(solvers)
    gc.collect()
    gc.disable()
    try:
        for a_pass in range(passes):
            for j in range(count):
                # no solver always runs after the same one, with the CPU caches of this one
                order = order[1:] + order[:1]
                for label in order:
                    arguments = given[label][j].arguments
                    began = time.perf_counter()
                    solution = solvers[label].solve(*arguments)
                    seconds[label][a_pass, j] = time.perf_counter() - began
                    plan = Plan(solution.plan.X, solution.plan.U)
                    answers[label][j] = Answer(plan, solution.iterations, solution.message)
                report()
    finally:
        gc.enable()
    return Timings(given, answers, seconds)


def run_alone(solvers: dict[str, StageSolver], given: dict[str, list[Task]], *how) -> Timings:
    """Solve all tasks as `run` does, but with one solver after the other.

    As in a controller, nothing but the solver uses the caches of the processor between its solves.
    """
    answers, seconds = {}, {}
    for label, solver in solvers.items():
        alone = run({label: solver}, {label: given[label]}, *how)
        answers |= alone.answers
        seconds |= alone.seconds
    return Timings(given, answers, seconds)
