"""Compare riccati with fatrop and IPOPT on the examples and on a family of problems that scale.

    python stage_solver/benchmark.py [--quick] [--instances 20] [--passes 3] [--out FOLDER]

Writes benchmark.md. Every problem is solved from disturbed initial states: cold, from a guess
without multipliers, and warm, from the solver's own cold solution for another disturbance. All
solvers evaluate compiled functions. They take turns, instance by instance, so other load on the
machine slows all of them alike; the time of an instance is the median over the passes.
"""

import argparse
import gc
import itertools
import platform
import time
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from examples import cart_pole, point_robot, quadrotor
from stage_solver import (
    SOLVED,
    SolverOptions,
    StageProblem,
    make_solver,
    no_bounds,
    reference_solvers,
    rk2,
    zero_plan,
)
from stage_solver.reference_solvers import ReferenceSolver

OWN = 'riccati'
SOLVERS = (OWN, *reference_solvers.NAMES)
STAGES, STATES = (20, 50, 100, 200), (4, 8, 12)
STEP_S, MAX_FORCE_N = 0.1, 1.0
DISTURBANCE = 0.05  # of the initial state, solver units
SEED = 1
HEAD = """| problem | start | solver | iterations median | max | ms median | max | solved |
|---|---|---|---:|---:|---:|---:|---:|"""


class Case(NamedTuple):
    """A problem and the arguments of its undisturbed solve."""

    problem: StageProblem
    arguments: tuple  # x0, P, bounds, guess


class Result(NamedTuple):
    """One solver on the instances of one case, from one kind of start."""

    seconds: np.ndarray  # (passes, instances)
    iterations: np.ndarray  # (instances,)
    solved: np.ndarray  # (instances,) bool


def make_chain(horizon: int, states: int) -> Case:
    """Return a chain of masses between nonlinear springs; forces on both ends bring it to rest."""
    masses = states // 2
    x, u, p = ca.SX.sym('x', states), ca.SX.sym('u', 2), ca.SX.sym('p', 0)

    def rates(x, u, p):
        lengths = ca.vertcat(x[:masses], 0) - ca.vertcat(0, x[:masses])
        tension = lengths + 0.5 * lengths**3
        force = tension[1:] - tension[:-1]
        force[0] += u[0]
        force[masses - 1] += u[1]
        return ca.vertcat(x[masses:], force)

    problem = StageProblem(
        name=f'chain_{horizon}_{states}',
        states=tuple(f'x{k}' for k in range(states)),
        inputs=('first_force', 'last_force'),
        parameters=(),
        horizon=horizon,
        dynamics=ca.Function('F', [x, u, p], [rk2(rates, STEP_S)(x, u, p)]),
        stage_cost=ca.Function('l', [x, u, p], [ca.sumsqr(x) + 0.1 * ca.sumsqr(u)]),
        terminal_cost=ca.Function('m', [x, p], [10 * ca.sumsqr(x)]),
    )
    bounds = no_bounds(problem)
    bounds.u_low[:], bounds.u_high[:] = -MAX_FORCE_N, MAX_FORCE_N
    x0 = np.concatenate([np.linspace(0.5, 1.5, masses), np.zeros(masses)])
    return Case(problem, (x0, np.zeros((horizon + 1, 0)), bounds, zero_plan(problem)))


def make_cases(quick: bool) -> dict[str, Case]:
    """Return the cases by their labels in the table."""
    cases = {}
    for module, *more in ((cart_pole,), (quadrotor,), (point_robot, point_robot.bend_curvature())):
        problem = module.make_problem()
        cases[problem.name] = Case(problem, module.make_arguments(problem, *more))
    sizes = [(N, nx) for nx in STATES for N in STAGES]
    for N, nx in sizes[:1] if quick else sizes:
        cases[f'chain, {nx} states, {N} stages'] = make_chain(N, nx)
    return {name: cases[name] for name in list(cases)[-2:]} if quick else cases


def run_case(case: Case, instances: int, passes: int) -> dict[tuple[str, str], Result]:
    """Return the results by (start, solver)."""
    problem, (x0, P, bounds, guess) = case
    options = SolverOptions(max_iterations=300, tolerance=1e-6)
    solvers = {OWN: make_solver(problem, options)}
    for name in reference_solvers.NAMES:
        solvers[name] = ReferenceSolver(problem, name, options, compiled=True)
    noise = np.abs(np.random.default_rng(SEED).standard_normal((2, instances, problem.nx)))
    initial_states = x0 + DISTURBANCE * noise * problem.scale_x
    results, plans, order = {}, {}, list(SOLVERS)
    gc.collect()
    gc.disable()  # no collection within a measured call
    for start, states in zip(('cold', 'warm'), initial_states):
        for name in SOLVERS:
            counts = np.zeros(instances, int), np.zeros(instances, bool)
            results[start, name] = Result(np.zeros((passes, instances)), *counts)
        for a_pass, i in itertools.product(range(passes), range(instances)):
            order = order[1:] + order[:1]  # no solver always follows the same one
            for name in order:
                first = guess if start == 'cold' else plans[name, i]
                began = time.perf_counter()
                solution = solvers[name].solve(states[i], P, bounds, first)
                result = results[start, name]
                result.seconds[a_pass, i] = time.perf_counter() - began
                result.iterations[i] = solution.iterations
                result.solved[i] = solution.status == SOLVED
                if start == 'cold':
                    plans[name, i] = solution.plan
    gc.enable()
    return results


def make_table(all_results: dict[str, dict[tuple[str, str], Result]]) -> str:
    """Return the table in Markdown."""
    lines = [HEAD]
    for label, results in all_results.items():
        for (start, name), (seconds, iterations, solved) in results.items():
            ms = 1e3 * np.median(seconds, axis=0)
            counts = f'{np.median(iterations):g} | {iterations.max()}'
            times = f'{np.median(ms):.2f} | {ms.max():.2f}'
            share = f'{solved.sum()}/{len(solved)}'
            lines.append(f'| {label} | {start} | {name} | {counts} | {times} | {share} |')
    return '\n'.join(lines)


def main():
    """Solve all cases; print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--quick', action='store_true', help='two cases, two instances, one pass')
    parser.add_argument('--instances', type=int, default=20)
    parser.add_argument('--passes', type=int, default=3)
    parser.add_argument('--out', type=Path, default=Path(__file__).parent, help='folder')
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    instances, passes = (2, 1) if options.quick else (options.instances, options.passes)
    results = {}
    for label, case in make_cases(options.quick).items():
        results[label] = run_case(case, instances, passes)
        print(make_table({label: results[label]}), flush=True)
    heading = (
        '# Benchmark of stage_solver\n\nGenerated by `python stage_solver/benchmark.py`: '
        f'{instances} disturbed initial states per problem, times of the whole call, median of '
        f'{passes} passes. {platform.machine()}, CasADi {ca.__version__}.\n\n'
    )
    (options.out / 'benchmark.md').write_text(f'{heading}{make_table(results)}\n')


if __name__ == '__main__':
    main()
