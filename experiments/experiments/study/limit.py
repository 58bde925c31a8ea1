"""The limit speed: the highest entry speed at which nearly every run clears the scenario."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.study import run_spec, run_statistics, tables, variants
from experiments.study.run_spec import Draw
from experiments.study.runner import Runner
from experiments.study.variants import CONTROLLERS, Variant

SHARE = 0.95
SLOWEST_KPH, FASTEST_KPH = 50.0, 140.0
STEP_KPH = 0.5
RUNS = 20  # per probe
STEM = 'limit'


class Probe(NamedTuple):
    """One tested speed; runs after the deciding one were not simulated."""

    speed_kph: float
    cleared: int
    runs: int
    holds: bool  # whether SHARE of the draws are cleared


class Limit(NamedTuple):
    """The limit speed of one controller, None when it is below the range."""

    name: str
    speed_kph: float | None
    probes: list[Probe]


def run(
    runner: Runner,
    out: Path,
    controllers: Sequence[str | Variant] = CONTROLLERS,
    runs: int = RUNS,
) -> list[Path]:
    """Find the limit of every controller; write limit.md, .csv, .json; return their paths.

    Bisection between SLOWEST_KPH and FASTEST_KPH to STEP_KPH, `runs` draws of grip and tolerance
    per probe, the same for every controller and speed. Raises BagError.
    """
    chosen = variants.plain_variants(controllers)
    draws = run_spec.draw_runs(runs, speed_kph=0.0)
    rows = [_row(find_limit(runner, variant, draws), runs) for variant in chosen]
    origin = tables.build_provenance(
        'experiments study limit',
        [variant for variant in chosen if not variant.settings],
        runs=runs,
        share=SHARE,
        switched={variant.name: dict(variant.settings) for variant in chosen if variant.settings},
    )
    return tables.write_tables(out, STEM, 'Limit speed', rows, _markdown(rows, runs), origin)


def find_limit(runner: Runner, variant: Variant, draws: Sequence[Draw]) -> Limit:
    """Return the limit of one controller, by bisection on the grid of STEP_KPH."""
    probes: list[Probe] = []

    def holds(step):
        kph = SLOWEST_KPH + STEP_KPH * step
        probes.append(probe_speed(runner, variant, kph, draws))
        return probes[-1].holds

    low, high = 0, round((FASTEST_KPH - SLOWEST_KPH) / STEP_KPH)
    if not holds(low):
        return Limit(variant.name, None, probes)
    if holds(high):
        return Limit(variant.name, FASTEST_KPH, probes)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return Limit(variant.name, SLOWEST_KPH + STEP_KPH * low, probes)


def probe_speed(runner: Runner, variant: Variant, kph: float, draws: Sequence[Draw]) -> Probe:
    """Simulate the draws at one speed until it is known whether SHARE of them is cleared."""
    allowed = len(draws) - math.ceil(SHARE * len(draws))
    cleared = simulated = 0
    for start in range(0, len(draws), runner.jobs):
        batch = draws[start : start + runner.jobs]
        specs = [run_spec.build_spec(variant, kph, draw) for draw in batch]
        records = runner.run(specs, f'limit of {variant.name}', start, len(draws))
        simulated += len(records)
        cleared += sum(record.is_cleared for record in records)
        if simulated - cleared > allowed:
            break
    return Probe(kph, cleared, simulated, simulated - cleared <= allowed)


def _row(limit, runs) -> dict[str, Any]:
    probe = next((probe for probe in limit.probes if probe.speed_kph == limit.speed_kph), None)
    counts = run_statistics.share_of_counts(probe.cleared, probe.runs) if probe else [None] * 4
    cleared, _, low, high = counts
    return {
        'controller': limit.name,
        'limit_kph': limit.speed_kph,
        'runs_per_probe': runs,
        'cleared_at_limit': cleared,
        'low': low,
        'high': high,
        'probes': [f'{probe.speed_kph:g}:{probe.cleared}/{probe.runs}' for probe in limit.probes],
    }


def _markdown(rows, runs):
    header = ['controller', 'limit [km/h]', f'cleared there, of {runs}', 'probes']
    lines = [[row['controller'], *_limit_cells(row), ', '.join(row['probes'])] for row in rows]
    return (
        f'Highest entry speed at which at least {SHARE:.0%} of {runs} paired runs clear all '
        f'obstacles and both edges; probes as speed:cleared/driven, ended early when the share '
        f'cannot be reached any more.\n\n{tables.markdown_table(header, lines)}\n'
    )


def _limit_cells(row):
    if row['limit_kph'] is None:
        return f'< {SLOWEST_KPH:g}', '–'
    interval = f'[{row["low"]:.2f}, {row["high"]:.2f}]'
    return f'{row["limit_kph"]:.1f}', f'{row["cleared_at_limit"]} {interval}'
