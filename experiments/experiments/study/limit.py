"""The highest entry speed at which a controller clears obstacles and edges almost always."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.study import case, provenance, run_verdicts, samples, statistics, tables, variants
from experiments.study.drives import Drives
from experiments.study.variants import CONTROLLERS, SCENARIO, Variant

SHARE = 0.95
SLOWEST_KPH, FASTEST_KPH = 50.0, 140.0
STEP_KPH = 0.5
RUNS = 20  # per probe
STEM = 'limit'


class Probe(NamedTuple):
    """One speed that was tried; drives after the one that decided it were not made."""

    speed_kph: float
    cleared: int
    driven: int
    holds: bool


class Limit(NamedTuple):
    """The limit speed of one controller, None when it is below the range."""

    name: str
    speed_kph: float | None
    probes: list[Probe]


class Limits(NamedTuple):
    """The limit of every controller."""

    limits: list[Limit]
    files: list[Path]


def run(
    drives: Drives,
    out: Path,
    controllers: Sequence[str | Variant] = CONTROLLERS,
    runs: int = RUNS,
    scenario: str = SCENARIO,
    seed: int = samples.SEED,
) -> Limits:
    """Find the limit of every controller; write limit.md, .csv, .json.

    Bisection between SLOWEST_KPH and FASTEST_KPH to STEP_KPH, `runs` draws of grip and tolerance
    per probe, the same ones for every controller and speed. Raises BagError.
    """
    chosen = [one if isinstance(one, Variant) else variants.plain([one])[0] for one in controllers]
    draws = samples.draws(runs, seed, speed_kph=0.0)
    found = [of(drives, one, draws, scenario) for one in chosen]
    rows = [_row(one, runs) for one in found]
    driven = {one.name: one.controller for one in chosen if not one.settings}
    switched = {one.name: dict(one.settings) for one in chosen if one.settings}
    where = provenance.of(
        'experiments study limit', scenario, seed, driven, runs=runs, share=SHARE, switched=switched
    )
    files = tables.write(out, STEM, 'Limit speed', rows, _told(rows, runs), where)
    return Limits(found, files)


def of(
    drives: Drives, variant: Variant, draws: Sequence[samples.Draw], scenario: str = SCENARIO
) -> Limit:
    """Return the limit of one controller, by bisection on the grid of STEP_KPH."""
    probes: list[Probe] = []

    def holds(step):
        kph = SLOWEST_KPH + STEP_KPH * step
        probes.append(probe(drives, variant, kph, draws, scenario))
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


def probe(
    drives: Drives,
    variant: Variant,
    kph: float,
    draws: Sequence[samples.Draw],
    scenario: str = SCENARIO,
) -> Probe:
    """Drive the draws at one speed until it is known whether SHARE of them is cleared."""
    allowed = len(draws) - math.ceil(SHARE * len(draws))
    cleared = driven = 0
    for start in range(0, len(draws), drives.jobs):
        batch = draws[start : start + drives.jobs]
        cases = [case.of(variant, kph, draw, scenario) for draw in batch]
        records = drives.of(cases, f'limit of {variant.name}', start, len(draws))
        driven += len(records)
        cleared += sum(run_verdicts.cleared(record) for record in records)
        if driven - cleared > allowed:
            break
    return Probe(kph, cleared, driven, driven - cleared <= allowed)


def _row(found, runs):
    at_limit = next((one for one in found.probes if one.speed_kph == found.speed_kph), None)
    over = statistics.share_of(at_limit.cleared, at_limit.driven) if at_limit else None
    return {
        'controller': found.name,
        'limit_kph': found.speed_kph,
        'runs_per_probe': runs,
        'cleared_at_limit': over.holds if over else None,
        'low': over.low if over else None,
        'high': over.high if over else None,
        'probes': [f'{one.speed_kph:g}:{one.cleared}/{one.driven}' for one in found.probes],
    }


def _limit_told(row):
    if row['limit_kph'] is None:
        return f'< {SLOWEST_KPH:g}', '–'
    interval = f'[{row["low"]:.2f}, {row["high"]:.2f}]'
    return f'{row["limit_kph"]:.1f}', f'{row["cleared_at_limit"]} {interval}'


def _told(rows: Sequence[dict[str, Any]], runs: int) -> str:
    header = ['controller', 'limit [km/h]', f'cleared there, of {runs}', 'probes']
    lines = [
        [
            row['controller'],
            *_limit_told(row),
            ', '.join(row['probes']),
        ]
        for row in rows
    ]
    return (
        f'Highest entry speed at which at least {SHARE:.0%} of {runs} paired runs clear all '
        f'obstacles and both edges; probes as speed:cleared/driven, ended early when the share '
        f'cannot be reached any more.\n\n{tables.markdown(header, lines)}\n'
    )
