"""Compare riccati with fatrop and IPOPT on the examples and on a family of problems that scale.

    python stage_solver/benchmark.py [--quick] [--instances 20] [--passes 3] [--out FOLDER]

Writes benchmark.md. Every problem is solved from disturbed initial states: cold, from a guess
without multipliers, and warm, from the solver's own cold solution for another disturbance. All
solvers evaluate compiled functions. They take turns, instance by instance; the time of an instance
is the median over the passes.
"""

import argparse
import platform
from pathlib import Path

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
STAGES, STATES = (20, 50, 100, 200), (4, 8, 12)
STEP_S, MAX_FORCE_N = 0.1, 1.0
DISTURBANCE = 0.05  # of the initial state, solver units
SEED = 1
HEAD = """| problem | start | solver | iterations median | max | ms median | max | solved |
|---|---|---|---:|---:|---:|---:|---:|"""


def make_chain(horizon: int, states: int) -> tuple[StageProblem, tuple]:
    """Return a chain of masses between nonlinear springs; forces on both ends bring it to rest.

    With the arguments of its undisturbed solve.
    """
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
    return problem, (x0, np.zeros((horizon + 1, 0)), bounds, zero_plan(problem))


def make_cases(quick: bool) -> dict[str, tuple[StageProblem, tuple]]:
    """Return problems and the arguments of their undisturbed solves, by their labels."""
    cases = {}
    for module, *more in ((cart_pole,), (quadrotor,), (point_robot, point_robot.bend_curvature())):
        problem = module.make_problem()
        cases[problem.name] = problem, module.make_arguments(problem, *more)
    sizes = [(N, nx) for nx in STATES for N in STAGES]
    for N, nx in sizes[:1] if quick else sizes:
        cases[f'chain, {nx} states, {N} stages'] = make_chain(N, nx)
    return dict(list(cases.items())[-2:]) if quick else cases


def run_case(
    label: str, problem: StageProblem, arguments: tuple, instances: int, passes: int
) -> list[str]:
    """Return the rows of the table in Markdown, one per start and solver."""
    x0, P, bounds, guess = arguments
    options = SolverOptions(max_iterations=300, tolerance=1e-6)
    solvers = {OWN: make_solver(problem, options)}
    for name in reference_solvers.NAMES:
        solvers[name] = ReferenceSolver(problem, name, options, compiled=True)
    noise = np.abs(np.random.default_rng(SEED).standard_normal((2, instances, problem.nx)))
    initial_states = x0 + DISTURBANCE * noise * problem.scale_x
    plans, rows = {name: [guess] * instances for name in solvers}, []
    for start, states in zip(('cold', 'warm'), initial_states):
        given = {
            name: [(x, P, bounds, plan) for x, plan in zip(states, plans[name])] for name in plans
        }
        solutions, seconds = reference_solvers.solve_in_turn(solvers, given, passes)
        for name, answers in solutions.items():
            iterations = [answer.iterations for answer in answers]
            times = 1e3 * np.median(seconds[name], axis=0)
            solved = sum(answer.status == SOLVED for answer in answers)
            rows.append(
                f'| {label} | {start} | {name} | {np.median(iterations):g} | {max(iterations)} '
                f'| {np.median(times):.2f} | {times.max():.2f} | {solved}/{instances} |'
            )
            plans[name] = [answer.plan for answer in answers]
    return rows


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
    rows = []
    print(HEAD)
    for label, case in make_cases(options.quick).items():
        rows += run_case(label, *case, instances, passes)
        print('\n'.join(rows[-2 * (1 + len(reference_solvers.NAMES)) :]), flush=True)
    heading = (
        '# Benchmark of stage_solver\n\nGenerated by `python stage_solver/benchmark.py`: '
        f'{instances} disturbed initial states per problem, times of the whole call, median of '
        f'{passes} passes. {platform.machine()}, CasADi {ca.__version__}.\n\n'
    )
    (options.out / 'benchmark.md').write_text('\n'.join([heading + HEAD, *rows, '']))


if __name__ == '__main__':
    main()
