"""One simulated run of a study: how it is drawn, what decides it, and which results are kept.

Draws are Halton points shifted by a seeded vector (Cranley and Patterson 1976), and the same for
every controller: runs are paired. The first n draws of a longer study are those of a study of n.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import code_version, simulation
from experiments.configuration import inputs
from experiments.configuration.inputs import KPH
from experiments.study.variants import SCENARIO, Variant
from node_runtime import provenance

SEED = 1
SPEED_SPREAD_KPH = 0.5  # either way
GRIP_SPREAD = 0.03  # of the plant's friction, either way; the controller assumes the scenario's
TOLERANCE_RANGE = (1e-6, 1e-3)  # of the solver, log-uniform
MAX_RUNS = 10_000
SOLVED = 'solved'
NO_SETTINGS: Mapping[str, Any] = MappingProxyType({})


class Draw(NamedTuple):
    """The random part of one run; run k is the same for every controller."""

    number: int  # from 1
    speed_kph: float  # difference from the nominal speed
    grip: float  # plant friction over that of the scenario
    tolerance: float  # of the solver


class RunSpec(NamedTuple):
    """All that a study chooses about one run."""

    scenario: str  # a name, or the path of a file
    controller: str
    settings: tuple[tuple[str, Any], ...]  # parameters of the controller by dotted name
    speed_kph: float  # constant desired speed, also that of the start
    grip: float  # plant friction over that of the scenario
    tolerance: float  # of the solver


def draw_runs(runs: int, seed: int = SEED, speed_kph: float = SPEED_SPREAD_KPH) -> list[Draw]:
    """Return `runs` draws; `speed_kph` is the spread of the entry speed, either way.

    Raises BagError for a number of runs out of range.
    """
    from scipy.stats import qmc

    if not 1 <= runs <= MAX_RUNS:
        raise BagError(f'runs: must be from 1 to {MAX_RUNS}, is {runs}')
    shift = np.random.default_rng(seed).random(3)
    points = (qmc.Halton(d=3, scramble=False).random(runs) + shift) % 1.0
    low, high = np.log10(TOLERANCE_RANGE)
    return [
        Draw(
            number,
            float(speed_kph * (2 * speed - 1)),
            float(1 + GRIP_SPREAD * (2 * grip - 1)),
            float(10 ** (low + (high - low) * tolerance)),
        )
        for number, (speed, grip, tolerance) in enumerate(points, start=1)
    ]


def build_spec(
    variant: Variant, speed_kph: float, draw: Draw, settings: Mapping[str, Any] = NO_SETTINGS
) -> RunSpec:
    """Return the run of a variant at a nominal speed, changed by a draw and further settings."""
    return RunSpec(
        SCENARIO,
        variant.controller,
        (*variant.settings, *settings.items()),
        speed_kph + draw.speed_kph,
        draw.grip,
        draw.tolerance,
    )


def prepare(spec: RunSpec) -> simulation.Setup:
    """Return the setup of the simulation. Raises BagError for unusable input."""
    base = _base(spec.scenario, spec.controller, spec.settings)
    solver = dataclasses.replace(base.params.solver, tolerance=spec.tolerance)
    return base._replace(
        scn=_scenario_at_speed(spec.scenario, spec.speed_kph),
        params=dataclasses.replace(base.params, solver=solver),
        friction=base.friction * spec.grip,
    )


def cache_key(setup: simulation.Setup) -> str:
    """Return the SHA-256 of all that decides the result: setup, code, libraries, processor."""
    numbers = repr(tuple(setup._replace(scn=None)))
    return provenance.digest('\0'.join((code_version.digest(), setup.scn.text, numbers)))


@cache
def _base(scenario, controller, settings):
    return simulation.prepare(scenario, controller, {'controller': dict(settings)})


@cache
def _scenario_at_speed(scenario, speed_kph):
    return inputs.load_scenario(scenario, speed_kph / KPH)


def measure(spec: RunSpec) -> dict[str, dict[str, Any]]:
    """Simulate a run of a study; see `measure_setup`. Raises BagError for unusable input."""
    return measure_setup(prepare(spec))


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
