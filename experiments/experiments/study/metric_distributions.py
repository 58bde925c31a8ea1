"""Distributions: every metric over paired runs at the operating point and at speeds beside it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.study import run_spec, run_statistics, tables, variants
from experiments.study.claims import D_SFT, KEPT, STABLE_DEG
from experiments.study.run_spec import Draw, RunSpec
from experiments.study.run_statistics import QUANTITIES
from experiments.study.runner import Record, Runner
from experiments.study.variants import Variant

POINT_KPH = 75.0  # the operating point, fixed before any tuning
SPEEDS_KPH = (POINT_KPH, POINT_KPH - 5.0, POINT_KPH + 5.0)
RUNS = 60
STEM = 'distributions'
COMMAND = 'experiments study distributions'
TARGET_SHARE = 0.95


class Distributions(NamedTuple):
    """The result by nominal speed [km/h] and variant, one record per draw, in their order."""

    records: Mapping[float, Mapping[str, list[Record]]]
    medians: Mapping[float, Draw]  # see run_statistics.find_median_run
    rows: list[dict[str, Any]]  # speed, controller, quantity, median, least, most ...
    files: list[Path]

    def __repr__(self) -> str:
        return f'Distributions({[*self.records]} km/h, {len(self.rows)} rows)'

    def median_spec(self, controller: str, speed_kph: float = POINT_KPH) -> RunSpec:
        """Return the median run of a controller, which the figures show."""
        number = self.medians[speed_kph].number
        return self.records[speed_kph][controller][number - 1].spec


class Sweep(NamedTuple):
    """What is driven: every controller at every speed, with the same draws."""

    controllers: Sequence[str | Variant]  # names in mpcc_controller/config, YAML files or Variants
    runs: int  # draws per controller and speed
    speeds_kph: Sequence[float]


def run(runner: Runner, out: Path, sweep: Sweep, command: str = COMMAND) -> Distributions:
    """Simulate a sweep; write distributions.md, .csv, .json and the figures.

    `command` is recorded in the files. Raises BagError.
    """
    from experiments.study import study_figures

    controllers, runs, speeds_kph = sweep
    chosen = variants.plain_variants(controllers)
    draws = run_spec.draw_runs(runs)
    records = {kph: run_at_speed(runner, chosen, kph, draws) for kph in speeds_kph}
    medians = {
        kph: draws[run_statistics.find_median_run(by_name)] for kph, by_name in records.items()
    }
    rows = [row for kph in speeds_kph for row in _rows(kph, records[kph])]
    origin = tables.build_provenance(
        command,
        chosen,
        runs=runs,
        speeds_kph=list(speeds_kph),
        median_runs={f'{kph:g}': draw._asdict() for kph, draw in medians.items()},
    )
    targets = check_targets(records[speeds_kph[0]])
    text = ''.join(_markdown(kph, records[kph], medians[kph], rows) for kph in speeds_kph)
    text += _targets_markdown(targets, speeds_kph[0])
    files = tables.write_tables(out, STEM, 'Distributions over paired runs', rows, text, origin)
    files += study_figures.write_distributions(records, medians, out / STEM)
    return Distributions(records, medians, rows, files)


def run_at_speed(
    runner: Runner,
    chosen: Sequence[Variant],
    kph: float,
    draws: Sequence[Draw],
    settings: Mapping[str, Any] = run_spec.NO_SETTINGS,
    label: str = '',
) -> dict[str, list[Record]]:
    """Return the records of every variant at a nominal speed [km/h], one per draw.

    `settings` are further parameters of the controllers; `label` names the runs in the progress.
    """
    specs = [
        run_spec.build_spec(variant, kph, draw, settings) for draw in draws for variant in chosen
    ]
    records = runner.run(specs, label or f'{kph:g} km/h, {len(chosen)} controllers')
    return {variant.name: records[k :: len(chosen)] for k, variant in enumerate(chosen)}


def _rows(kph, records):
    for quantity in QUANTITIES:
        for name, runs in records.items():
            yield {
                'speed_kph': kph,
                'controller': name,
                'quantity': quantity.name,
                'unit': quantity.unit,
                **run_statistics.summarise_runs(runs, quantity.name)._asdict(),
                'of': len(runs),
            }


def _markdown(kph, records, median, rows):
    header = ['median [least, most]', 'unit', *records]
    lines = []
    for quantity in QUANTITIES:
        cells = [
            _cell(quantity, row)
            for row in rows
            if row['speed_kph'] == kph and row['quantity'] == quantity.name
        ]
        lines.append([quantity.title, quantity.unit, *cells])
    count = len(next(iter(records.values())))
    return (
        f'## {kph:g} km/h, {count} runs per controller\n\n'
        f'{tables.markdown_table(header, lines)}\n'
        f'Median run: number {median.number} ({median.speed_kph:+.2f} km/h, grip '
        f'{median.grip:.3f}, tolerance {median.tolerance:.1e}).\n\n'
    )


def _cell(quantity, row):
    median, least, most = (quantity.format(row[name]) for name in ('median', 'least', 'most'))
    if not row['runs']:
        return '–'
    missing = f' ({row["runs"]} of {row["of"]})' if row['runs'] < row['of'] else ''
    return f'{median} [{least}, {most}]{missing}'


def check_targets(records: Mapping[str, Sequence[Record]]) -> list[dict[str, Any]]:
    """Return the targets of the operating point for the simulated controllers, with the results."""
    rows = []
    if 'mpcc' in records:
        runs = records['mpcc']
        rows += [
            _share_target('mpcc: completed', [run.value('completed') for run in runs]),
            _median_target('mpcc: min V2O [m]', runs, 'min_v2o_m', least=KEPT * D_SFT),
            _median_target('mpcc: min V2E [m]', runs, 'min_v2e_m', least=KEPT * D_SFT),
            _median_target(
                'mpcc: peak sideslip angle [deg]', runs, 'peak_sideslip_deg', most=STABLE_DEG
            ),
        ]
    if 'mpcc_no_ca' in records:
        gaps = [run.value('min_v2o_per_obstacle_m.1') for run in records['mpcc_no_ca']]
        rows.append(_share_target('mpcc_no_ca: V2O < 0 at obstacle 1', [gap < 0 for gap in gaps]))
    return rows


def _share_target(name, holds):
    share = run_statistics.share(holds)
    return {
        'target': name,
        'wanted': f'>= {TARGET_SHARE:.0%} of the runs',
        'measured': f'{share.holds} of {share.runs} [{share.low:.3f}, {share.high:.3f}]',
        'met': share.share >= TARGET_SHARE,
    }


def _median_target(name, runs, quantity, least=-float('inf'), most=float('inf')):
    summary = run_statistics.summarise_runs(runs, quantity)
    is_upper = most < float('inf')
    return {
        'target': name,
        'wanted': f'median <= {most:g}' if is_upper else f'median >= {least:g}',
        'measured': f'{summary.median:.3f} [{summary.least:.3f}, {summary.most:.3f}]',
        'met': least <= summary.median <= most,
    }


def _targets_markdown(targets, kph):
    if not targets:
        return ''
    header = ['target', 'wanted', 'measured', 'met']
    lines = [
        [row['target'], row['wanted'], row['measured'], 'yes' if row['met'] else '**no**']
        for row in targets
    ]
    return f'## Targets at {kph:g} km/h\n\n{tables.markdown_table(header, lines)}\n'
