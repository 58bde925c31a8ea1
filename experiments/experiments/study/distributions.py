"""Every metric over paired runs around the operating point, and beside it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.study import case, provenance, samples, statistics, tables, targets
from experiments.study.drives import Drives, Record
from experiments.study.quantities import QUANTITIES
from experiments.study.samples import Draw
from experiments.study.variants import CONTROLLERS, SCENARIO, Variant, plain

POINT_KPH = 75.0  # the operating point, fixed before anything was tuned
SPEEDS_KPH = (POINT_KPH, POINT_KPH - 5.0, POINT_KPH + 5.0)
RUNS = 60
STEM = 'distributions'
COMMAND = 'experiments study distributions'


class Distributions(NamedTuple):
    """What was driven, by nominal speed [km/h] and variant, one record per draw, in their order."""

    draws: list[Draw]
    records: Mapping[float, Mapping[str, list[Record]]]
    medians: Mapping[float, Draw]  # the draw that stands for the others, see statistics.median_run
    rows: list[dict[str, Any]]  # speed, controller, quantity, median, least, most ...
    targets: list[dict[str, Any]]  # see targets.of
    files: list[Path]

    def median_case(self, controller: str, speed_kph: float = POINT_KPH) -> case.Case:
        """Return the drive of a controller that the figures show."""
        number = self.medians[speed_kph].number
        return self.records[speed_kph][controller][number - 1].case


def run(
    drives: Drives,
    out: Path,
    controllers: Sequence[str | Variant] = CONTROLLERS,
    runs: int = RUNS,
    speeds_kph: Sequence[float] = SPEEDS_KPH,
    scenario: str = SCENARIO,
    seed: int = samples.SEED,
    command: str = COMMAND,
) -> Distributions:
    """Drive `runs` draws per controller and speed; write distributions.md, .csv, .json, figures.

    `controllers` are names in mpcc_controller/config, YAML files or Variants; `command`
    is what the files name as the one that made them. Raises BagError.
    """
    from experiments.study import distribution_figure

    chosen = [one if isinstance(one, Variant) else plain([one])[0] for one in controllers]
    draws = samples.draws(runs, seed)
    records = {kph: at_speed(drives, chosen, kph, draws, scenario) for kph in speeds_kph}
    medians = {kph: draws[statistics.median_run(found)] for kph, found in records.items()}
    rows = [row for kph in speeds_kph for row in _rows(kph, records[kph])]
    found = provenance.of(
        command,
        scenario,
        seed,
        {one.name: one.controller for one in chosen},
        runs=runs,
        speeds_kph=list(speeds_kph),
        median_runs={f'{kph:g}': draw._asdict() for kph, draw in medians.items()},
    )
    aims = targets.of(records[speeds_kph[0]])
    text = ''.join(_told(kph, records[kph], medians[kph], rows) for kph in speeds_kph)
    text += targets.told(aims, speeds_kph[0])
    files = tables.write(out, STEM, 'Distributions over paired runs', rows, text, found)
    files += distribution_figure.write(records, medians, out)
    return Distributions(draws, records, medians, rows, aims, files)


def at_speed(
    drives: Drives, chosen: Sequence[Variant], kph: float, draws: Sequence[Draw], scenario: str
) -> dict[str, list[Record]]:
    """Return the records of every variant at a nominal speed [km/h], one per draw."""
    cases = [case.of(one, kph, draw, scenario) for draw in draws for one in chosen]
    records = drives.of(cases, f'{kph:g} km/h, {len(chosen)} controllers')
    return {one.name: records[k :: len(chosen)] for k, one in enumerate(chosen)}


def _rows(kph, records):
    for quantity in QUANTITIES:
        for name, runs in records.items():
            over = statistics.summary([run.value(quantity.name) for run in runs])
            yield {
                'speed_kph': kph,
                'controller': name,
                'quantity': quantity.name,
                'unit': quantity.unit,
                **over._asdict(),
                'of': len(runs),
            }


def _told(kph, records, median, rows):
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
        f'{tables.markdown(header, lines)}\n'
        f'Median run: number {median.number} ({median.speed_kph:+.2f} km/h, grip '
        f'{median.grip:.3f}, tolerance {median.tolerance:.1e}).\n\n'
    )


def _cell(quantity, row):
    median, least, most = (quantity.told(row[name]) for name in ('median', 'least', 'most'))
    if not row['runs']:
        return '–'
    missing = f' ({row["runs"]} of {row["of"]})' if row['runs'] < row['of'] else ''
    return f'{median} [{least}, {most}]{missing}'
