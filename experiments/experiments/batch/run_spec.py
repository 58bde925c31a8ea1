"""How a further run differs from the first, what decides a run, and which results are kept.

Draws are Halton points shifted by a seeded vector (Cranley and Patterson 1976), and the same for
every controller: runs are paired. The first n draws of a longer study are those of a study of n.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import code_version, simulation
from node_runtime import provenance

SEED = 1
SPEED_SPREAD_KPH = 0.5  # either way
GRIP_SPREAD = 0.03  # of the plant's friction, either way; the controller assumes the scenario's
MAX_RUNS = 10_000
SOLVED = 'solved'


class Draw(NamedTuple):
    """The random part of a run; run k is the same for every controller."""

    speed_kph: float  # difference from the nominal speed
    grip: float  # plant friction over that of the scenario


def draw_runs(runs: int, seed: int = SEED) -> list[Draw]:
    """Return `runs` draws. Raises BagError for a number of runs out of range."""
    from scipy.stats import qmc

    if not 1 <= runs <= MAX_RUNS:
        raise BagError(f'runs: must be from 1 to {MAX_RUNS}, is {runs}')
    shift = np.random.default_rng(seed).random(2)
    points = (qmc.Halton(d=2, scramble=False).random(runs) + shift) % 1.0
    return [
        Draw(float(SPEED_SPREAD_KPH * (2 * speed - 1)), float(1 + GRIP_SPREAD * (2 * grip - 1)))
        for speed, grip in points
    ]


def cache_key(setup: simulation.Setup) -> str:
    """Return the SHA-256 of all that decides the result: setup, code, libraries, processor."""
    numbers = repr(tuple(setup._replace(scn=None)))
    return provenance.digest('\0'.join((code_version.digest(), setup.scn.text, numbers)))


def measure_setup(setup: simulation.Setup) -> dict[str, dict[str, Any]]:
    """Simulate once; return {'metrics': ..., 'solver': ...}, ready for JSON."""
    columns = simulation.run(setup, explain=False)
    drive = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    reports = [why.values for why in columns['/controller/why'].values]
    return {'metrics': metrics.compute_metrics(drive), 'solver': solver_statistics(reports)}


def solver_statistics(reports: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return statistics of the first solver over the ticks that called it, None without any.

    `failed` counts the ticks in which it did not converge to its tolerance. `reports` are the
    values of /controller/why.
    """
    solves = [report for report in reports if 'solver.iterations' in report]
    failed = sum(report['solver.status'] != SOLVED for report in solves)
    iterations = np.array([report['solver.iterations'] for report in solves], dtype=float)
    time_ms = sum(report['time.solve_cpu_ms'] for report in solves)
    is_known, total = bool(solves), int(iterations.sum())
    return {
        'asked': len(solves),
        'failed': failed,
        'failed_share': failed / len(solves) if is_known else None,
        'iterations_mean': float(iterations.mean()) if is_known else None,
        'iterations_p99': float(np.percentile(iterations, 99)) if is_known else None,
        'iterations_max': int(iterations.max()) if is_known else None,
        'time_per_iteration_ms': time_ms / total if total else None,
    }
