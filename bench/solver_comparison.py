"""How fast and how good are the solvers? Rows of docs/performance.md, tables of docs/solver.md.

    .venv/bin/python bench/solver_comparison.py [--quick] [--passes 3] [--out bench]

They solve the problems of closed loops. Writes solver.md into the folder --out: warm, cold and
surprised starts in turn and alone, the slowest problems, the time to make a controller, and closed
loops with one iteration per tick against converged plans.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import closed_loops
import numpy as np
import pandas as pd
import problems
from problems import (
    COLD,
    GOOD,
    MAX_GAP,
    MAX_RESIDUAL,
    OTHER_MINIMUM,
    POP_UP,
    WARM,
    WORSE,
    Assessor,
)
from rich.progress import Progress
from tables import machine, markdown, number, pin, share

from experiments import simulation
from experiments.simulation import Setup
from mpcc_controller.driving import tick_solvers
from mpcc_controller.driving.controller import Controller
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem import formulation, ocp, stage_parameters
from stage_solver import compiled_functions, reference_solvers, solver
from stage_solver.reference_solvers import ReferenceSolver, solve_in_turn
from stage_solver.solution import SolverOptions
from stage_solver.solver import StageSolver
from stage_solver.stage_problem import StageProblem

FULL_PASSES, QUICK_PASSES = 3, 2
COLD_EVERY = 5  # problems
OURS, ONE_STEP, BASELINE, NATIVE = 'ours', 'ours_one_step', 'fatrop_c', 'fatrop_c_native'
NATIVE_FLAGS = ('-O3', '-march=native')  # what our own solver may use, too
SLOWEST = 8  # problems to be shown
CACHE = 'MPCC_CACHE_DIR'
KINDS = (WARM, COLD, POP_UP)
FORMATS = {'good': share, **dict.fromkeys(('max gap', 'max residual'), '{:.0e}'.format)}
# whatever comes of the first step
ENDLESS = {'one_step_residual': 1.0, 'one_step_decrease': 1e3}
# the first one is what the others are compared with
SCHEMES = {
    'converged': {'mode': 'converged'},
    'one_step': {'mode': 'one_step'},
    'one_step_prepared': {'mode': 'one_step', 'prepare': True},
    'single_step': {'mode': 'one_step', **ENDLESS},
}
METHOD = (
    'Every solver starts from its own plans (and multipliers, where it takes them) of the tick '
    'before, moved on as the controller does it. The solvers take turns on one core, problem by '
    'problem; the time of a problem is the median over the passes, measured around the call; '
    'median, p99 and max are over the problems. Absolute times depend on what else the machine '
    f'does, ratios do not; they leave out the problems that {BASELINE} does not solve. The first '
    'tick of a loop has no plan to start from and is not among the warm starts. "Alone": the same '
    'problems, one solver after the other, so that each has the caches of the processor for '
    'itself, as in a controller. "Pop-up": an obstacle has appeared 15 to 40 m ahead. `_c`: CasADi '
    f'functions compiled by gcc -O2; `{NATIVE}`: with {" ".join(NATIVE_FLAGS)}, as'
    f' our own solver may use it. `{ONE_STEP}`: from a plan it ends after the first step that '
    'leaves little to gain (docs/solver.md); without a plan it converges.\n\n'
    f'Good: residual of every constraint at most {MAX_RESIDUAL:g} (m, rad, kN, ...) and cost '
    f'within {MAX_GAP:g} (relative) of what IPOPT finds with a tolerance of 1e-8 from the same '
    'start. An answer within that of a minimum that IPOPT finds from the answer, while from the '
    'start it finds another one, is at another minimum and counts neither way. Costs and residuals '
    'are evaluated from the stage functions, not taken from the solvers.\n'
)


class Variant(NamedTuple):
    """A solver, or a way to use it."""

    label: str
    options: SolverOptions
    reference: str = ''  # of `reference_solvers.NAMES`; '' is our own solver
    flags: tuple[str, ...] = ()  # of the compiler for the functions of a reference

    def make(self, problem: StageProblem) -> StageSolver | ReferenceSolver:
        """Return the solver; compiles what is not in the cache."""
        if not self.reference:
            return solver.make_solver(problem, self.options)
        return ReferenceSolver(problem, self.reference, self.options, True, self.flags)


def available(params: ControllerParams) -> list[Variant]:
    """Return the available variants, ours first."""
    stepping = replace(params, solver=replace(params.solver, mode='one_step'))
    one_step = tick_solvers.solver_options(stepping, limit_time=False)
    options = replace(one_step, one_step=None)
    variants = [Variant(OURS, options), Variant(ONE_STEP, one_step)]
    for name in reference_solvers.NAMES:
        variants.append(Variant(f'{name}_c', options, name, compiled_functions.FLAGS))
        if f'{name}_c' == BASELINE:
            variants.append(Variant(NATIVE, options, name, NATIVE_FLAGS))
    return variants


def spread(ms: pd.Series) -> list[float]:
    """Return median, 99th percentile and maximum."""
    return [ms.median(), ms.quantile(0.99), ms.max()]


def summarise(driven: pd.DataFrame) -> pd.DataFrame:
    """Return a row of numbers per start and solver, in their order.

    `good` is the share of good answers without those at other minima. Ratios are taken over the
    tasks that the baseline solved: its slow failures would favour the other solvers.
    """
    rows = []
    for kind in KINDS:
        of_kind = driven[driven.start == kind]
        baseline = of_kind[of_kind.solver == BASELINE].set_index('number')
        solved = baseline.index[baseline.kind.isin((GOOD, OTHER_MINIMUM))]
        for label, own in of_kind.groupby('solver', sort=False):
            counted = own[own.kind != OTHER_MINIMUM]
            gaps = own.gap[own.kind.isin((GOOD, WORSE))]
            times = [spread(of.ms[of.number.isin(solved)]) for of in (own, baseline.reset_index())]
            rows.append(
                {
                    'start': kind,
                    'solver': label,
                    **dict(zip(('median', 'p99', 'max'), spread(own.ms))),
                    'iterations': f'{own.iterations.median():.0f} / {own.iterations.max()}',
                    'good': (counted.kind == GOOD).mean() if len(counted) else 1.0,
                    'other minima': int((own.kind == OTHER_MINIMUM).sum()),
                    'max gap': gaps.max() if gaps.notna().any() else 0.0,
                    'max residual': own.residual.max(),
                    **{
                        f'/ {BASELINE}: {name}': ratio
                        for name, ratio in zip(('median', 'p99', 'max'), np.divide(*times))
                    },
                    **{
                        f'alone: {name}': ms
                        for name, ms in zip(('median', 'p99', 'max'), spread(own.alone_ms))
                    },
                }
            )
    return pd.DataFrame(rows)


def texts(driven: pd.DataFrame) -> list[str]:
    """Return the tables of what was driven, in Markdown."""
    summary = summarise(driven)
    shown = summary.apply(
        lambda column: column.map(
            FORMATS.get(column.name, number if column.dtype == float else str)
        )
    )
    warm = driven[(driven.solver == OURS) & (driven.start == WARM)]
    slowest = [
        (row.number, row.iterations, *map(number, (row.ms, row.least, row.most)), row.message)
        for row in warm.nlargest(SLOWEST, 'ms').itertuples()
    ]
    columns = ('problem', 'iterations', 'median ms', 'least of the passes', 'most', 'ending')
    return [
        markdown('Starts (ms)', shown.columns, shown.itertuples(index=False)),
        markdown(f'The slowest warm starts of {OURS}', columns, slowest),
    ]


def compare(
    given: list[problems.Posed],
    problem: StageProblem,
    params: ControllerParams,
    chosen: list[Variant],
    passes: int,
    track: Callable[..., Iterable],
) -> pd.DataFrame:
    """Solve the problems by every variant in turn, then by each alone; return a row per solve."""
    solvers = {one.label: one.make(problem) for one in track(chosen, description='compiling')}
    tasks = {
        label: problems.tasks(problem, given, params.fallback, one, COLD_EVERY)
        for label, one in track(solvers.items(), description='making warm starts')
    }
    arguments = {label: [task[1:] for task in own] for label, own in tasks.items()}
    answers, in_turn = solve_in_turn(solvers, arguments, passes)
    alone = {}
    for label, one in track(solvers.items(), description='solving, each alone'):
        alone |= solve_in_turn({label: one}, {label: arguments[label]}, passes)[1]
    assessor, tables = Assessor(problem), []
    for label, own in track(tasks.items(), description='assessing'):
        quality = [assessor.assess(task, one.plan) for task, one in zip(own, answers[label])]
        ms = 1e3 * in_turn[label]
        row_per_task = {
            'solver': label,
            'start': [task.kind for task in own],
            'number': range(len(own)),
            'ms': np.median(ms, axis=0),  # of the passes
            'least': ms.min(axis=0),
            'most': ms.max(axis=0),
            'alone_ms': 1e3 * np.median(alone[label], axis=0),
            'iterations': [answer.iterations for answer in answers[label]],
            'message': [answer.message for answer in answers[label]],
        }
        tables.append(pd.DataFrame(row_per_task).join(pd.DataFrame(quality)))
    return pd.concat(tables, ignore_index=True)


def start_up(setup: Setup) -> str:
    """Return how long it takes to make a controller: the first time, and once more."""

    def seconds():
        began = time.perf_counter()
        Controller(setup.params, setup.vehicle)
        return number(time.perf_counter() - began)

    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, {CACHE: folder}):
        row = seconds(), seconds()
    return markdown('Making a controller (s)', ('empty cache', 'full cache'), [row])


def one_step_table(track: Callable[..., Iterable]) -> str:
    """Return the drives of every loop in every scheme.

    The cost of a drive is the sum of the stage costs of what was driven: state, input and numbers
    of stage 0 at every tick.
    """
    rows = []
    for loop in track(closed_loops.FULL, description='driving with one step per tick'):
        setup = closed_loops.make_setup(loop)
        drives = {name: driven(setup, settings) for name, settings in SCHEMES.items()}
        converged = np.nansum(drives['converged'][0])
        for name, (costs, ms, more, prepared_ms) in drives.items():
            cost = np.nansum(costs)
            row = [loop.name, name, number(cost), f'{100 * (cost / converged - 1):+.2f} %']
            row += [number(np.median(ms)), number(ms.max()), f'{100 * more.mean():.1f} %']
            row += [number(ms[more].mean() if more.any() else 0.0), number(np.median(prepared_ms))]
            rows.append([*row, len(costs), int(np.isnan(costs).sum())])
    columns = ('loop', 'scheme', 'cost', 'difference', 'median', 'max', 'iterations > 1')
    columns += ('their mean', 'after the command', 'ticks', 'without a plan')
    title = 'Closed loops: one step per tick against converged (ms from state to plan)'
    return markdown(title, columns, rows)


def driven(setup: Setup, settings: dict) -> tuple[np.ndarray, ...]:
    """Drive a whole loop with our solver and settings of it.

    Returns the stage cost of every tick (NaN where there was no plan to follow: the car braked),
    the time of every solve between a state and its command [ms], whether it took more than one
    iteration, and the time of what was computed before each state [ms].
    """
    params = setup.params
    setup = setup._replace(params=replace(params, solver=replace(params.solver, **settings)))
    costs, prepared_s, solutions = [], [], []
    for step in simulation.steps(setup):
        memory, model = step.controller.memory, step.controller.parts.model
        plan, cost = memory.plans.plan, np.nan
        if plan is not None:
            P = memory.solved.problem.parameters.P
            cost = float(model.problem.stage_cost(plan.X[0], plan.U[0], P[0]))
        costs.append(cost)
        solutions += [step.record.attempt.solution] if step.record.attempt else []
        prepared_s.append(step.record.prepared_s or 0.0)
    ms, prepared_ms = 1e3 * np.array([s.solve_s for s in solutions]), 1e3 * np.array(prepared_s)
    return np.array(costs), ms, np.array([s.iterations for s in solutions]) > 1, prepared_ms


def main() -> None:
    """Measure, print the tables, and write them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--quick', action='store_true', help='few problems, starts only')
    parser.add_argument('--passes', type=int, help='how often each problem is solved')
    parser.add_argument('--out', type=Path, default=Path(__file__).parent, help='folder to write')
    options = parser.parse_args()
    passes = options.passes or (QUICK_PASSES if options.quick else FULL_PASSES)
    if passes < 1:
        parser.error('--passes must be 1 or more')
    facts = machine() | {'runs on': pin()}
    setup = closed_loops.make_setup(closed_loops.FULL[0])
    params = setup.params
    car = stage_parameters.car(params, setup.vehicle)
    symbolic = formulation.make(params, car).ocp
    problem = ocp.build(symbolic, params.model.horizon, params.model.step_s)
    with Progress() as progress:
        loops = closed_loops.QUICK if options.quick else closed_loops.FULL
        given = problems.record(progress.track(loops, description='driving'))
        chosen = available(params)
        parts = texts(compare(given, problem, params, chosen, passes, progress.track))
        if not options.quick:
            parts += [start_up(setup), one_step_table(progress.track)]
    lines = '\n'.join(f'- {name}: {value}' for name, value in facts.items())
    head = (
        f'# Solvers\n\nMade by `make bench`: {len(given)} problems, {passes} passes.\n\n{lines}\n'
    )
    print('\n'.join(parts))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / 'solver.md').write_text('\n'.join([head, METHOD, *parts]))
    print(f'written: {options.out / "solver.md"}')


if __name__ == '__main__':
    main()
