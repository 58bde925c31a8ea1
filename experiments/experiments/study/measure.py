"""One drive of a study and what is kept of it: the metrics, and how the solver fared."""

import numpy as np

from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import simulation
from experiments.study import case as cases

SOLVED = 'solved'


def measured(case: cases.Case) -> dict:
    """Drive once and return {'metrics', 'solver'}, as JSON takes it.

    Raises BagError for a drive that cannot be set up.
    """
    prepared = cases.prepared(case)
    columns = simulation.run(prepared)
    info = simulation.run_info(prepared)
    return {
        'metrics': metrics.compute_metrics(drive_from_columns(columns, info, prepared.controller)),
        'solver': solver([why.values for why in columns['/controller/why'].values]),
    }


def solver(reports: list[dict]) -> dict:
    """Return how the solver fared in the ticks that asked it.

    `failed` counts the ticks in which the first solver did not converge to its tolerance;
    iterations are its own.
    """
    asked = [report for report in reports if 'solver.iterations' in report]
    iterations = np.array([report['solver.iterations'] for report in asked], dtype=float)
    failed = sum(report['solver.status'] != SOLVED for report in asked)
    known = bool(asked)
    return {
        'asked': len(asked),
        'failed': failed,
        'failed_share': failed / len(asked) if known else None,
        'iterations_mean': float(iterations.mean()) if known else None,
        'iterations_p99': float(np.percentile(iterations, 99)) if known else None,
        'iterations_max': int(iterations.max()) if known else None,
        'time_per_iteration_ms': _per_iteration(asked),
    }


def _per_iteration(asked):
    count = sum(report['solver.iterations'] for report in asked)
    return sum(report['time.solve_cpu_ms'] for report in asked) / count if count else None
