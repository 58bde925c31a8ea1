"""The share of runs that clear the scenario over the entry speed, for every controller.

Every speed of a grid is driven with the same draws, so nothing is assumed of the share: whether it
falls with the speed is tested (`success_curve`).
"""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.study import run_spec, tables, variants
from experiments.study.metric_distributions import Sweep, run_at_speed
from experiments.study.runner import Runner
from experiments.study.success_curve import LEVELS, SuccessCurve, fit_curve

SPEEDS_KPH = tuple(50.0 + 10.0 * step for step in range(10))  # 50 .. 140
RUNS = 20  # per speed
UNEVEN = 0.05  # p-value below which the share does not fall with the speed
STEM = 'limit'


def run(runner: Runner, out: Path, sweep: Sweep) -> list[Path]:
    """Simulate a sweep; write limit.md, .csv, .json and the figure.

    Grip and tolerance are drawn, the speed is exact. Returns the paths. Raises BagError.
    """
    from experiments.study import study_figures

    controllers, runs, speeds_kph = sweep
    chosen = variants.plain_variants(controllers)
    draws = run_spec.draw_runs(runs, speed_kph=0.0)
    cleared: dict[str, list[int]] = {variant.name: [] for variant in chosen}
    for kph in speeds_kph:
        for name, records in run_at_speed(runner, chosen, kph, draws).items():
            cleared[name].append(sum(record.is_cleared for record in records))
    curves = [fit_curve(name, speeds_kph, counts, runs) for name, counts in cleared.items()]
    origin = tables.build_provenance(
        'experiments study limit',
        [variant for variant in chosen if not variant.settings],
        runs=runs,
        speeds_kph=list(speeds_kph),
        levels=list(LEVELS),
        switched={variant.name: dict(variant.settings) for variant in chosen if variant.settings},
    )
    rows = [_row(curve) for curve in curves]
    text, title = _markdown(curves, runs), 'Cleared runs over the entry speed'
    files = tables.write_tables(out, STEM, title, rows, text, origin)
    return [*files, *study_figures.write_curves(curves, out / STEM)]


def _row(curve: SuccessCurve) -> dict[str, Any]:
    speeds = zip(curve.speeds_kph, curve.shares, curve.monotone)
    return {
        'controller': curve.name,
        'runs_per_speed': curve.shares[0].runs,
        'falls_with_speed_p': curve.monotone_p,
        **{
            f'falls_below_{crossing.level:g}': {
                'kph': _finite(crossing.kph),
                'low_kph': _finite(crossing.low),
                'high_kph': _finite(crossing.high),
            }
            for crossing in curve.crossings
        },
        'cleared': {
            f'{kph:g} km/h': {
                'cleared': share.holds,
                'low': share.low,
                'high': share.high,
                'fit': fit,
            }
            for kph, share, fit in ((kph, share, float(fit)) for kph, share, fit in speeds)
        },
    }


def _finite(kph):
    """Return a speed for JSON: None beyond the range of the speeds."""
    return kph if np.isfinite(kph) else None


def _markdown(curves, runs):
    speeds = curves[0].speeds_kph
    falls = [f'falls below {level:.0%} at [km/h]' for level in LEVELS]
    header = ['controller', *(f'{kph:g}' for kph in speeds), *falls, 'falls evenly']
    lines = [
        [
            curve.name,
            *(str(share.holds) for share in curve.shares),
            *(_crossing_cell(crossing, speeds) for crossing in curve.crossings),
            'yes' if curve.monotone_p > UNEVEN else f'no (p = {curve.monotone_p:.3f})',
        ]
        for curve in curves
    ]
    return (
        f'Runs of {runs} that clear all obstacles and both edges, by entry speed [km/h]; grip and '
        'tolerance are drawn, alike at all speeds and for all controllers. The speeds at which '
        'the share falls through a level are those of the closest shares that do not rise, with '
        f'95 % intervals; where the share does not fall evenly they mean little.\n\n'
        f'{tables.markdown_table(header, lines)}\n'
    )


def _crossing_cell(crossing, speeds):
    def text(kph):
        if np.isfinite(kph):
            return f'{kph:.0f}'
        return f'< {speeds[0]:g}' if kph < 0 else f'> {speeds[-1]:g}'

    return f'{text(crossing.kph)} [{text(crossing.low)}, {text(crossing.high)}]'
