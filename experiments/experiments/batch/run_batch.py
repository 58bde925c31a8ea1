"""`experiments batch`: simulate what is missing of a study, and write its table."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pandas
from rich.console import Console
from rich.table import Table

from bags.errors import BagError
from experiments import code_version, drive_row, row_runner
from experiments import console as tables
from experiments.batch import study_file, study_rows
from experiments.batch.study_file import StudyFile
from experiments.drive_row import Pairs, Row
from experiments.pool import Pool
from experiments.progress import CountProgress
from experiments.simulation import Setup
from scenario_publisher import scenario

SHARES = ('completed', 'collided', 'left_road', 'lost')


def run(
    options: argparse.Namespace,
    console: Console,
    drive: Callable[[Setup], dict[str, Any]] = drive_row.drive,
) -> int:
    """Simulate a study, write the table and show its summary; return 0 when no drive failed.

    `options` are those of `experiments batch`; `drive` is what the processes call. Raises BagError
    for a study that cannot be used, and KeyboardInterrupt after the table of the drives so far was
    written.
    """
    study = study_file.load(options.study)
    with (
        CountProgress(console) as progress,
        Pool(options.jobs, options.dask, code_version.describe) as pool,
    ):
        given = drive_row.as_pairs(options.settings)
        rows = check_rows(study, pool, progress, given)
        notes = {'study': study.text}
        lines = row_runner.run_rows(
            rows, options.out, pool, progress, options.time_limit_s, notes, drive
        )
    console.print(summarise(lines))
    return 1 if any(line['error'] for line in lines) else 0


def check_rows(
    study: StudyFile, pool: Pool, progress: CountProgress, given: Pairs = ()
) -> list[Row]:
    """Check every combination of a study and return its rows. Raises BagError.

    `given` are settings of all rows, over which those of the study win.
    """
    combinations = [
        row._replace(settings=(*given, *row.settings)) for row in study_rows.combine(study)
    ]
    rows = study_rows.rows_of(study, combinations)
    names = {drawn.name for drawn in study.drawn}
    # the drawn settings that are words, each combination of them once
    words = dict.fromkeys(tuple(pair for pair in row.words if pair[0] in names) for row in rows)
    checked = [
        combination._replace(settings=(*combination.settings, *chosen))
        for combination in combinations
        for chosen in words
    ]
    warnings = []
    ended = pool.finish_each(study_rows.check, [(row,) for row in checked])
    for done, finished in enumerate(ended, start=1):
        if isinstance(finished.error, BagError):
            combination = combinations[finished.number // len(words)]
            located = study_rows.locate_error(study, combination, finished.error)
            study_rows.check_drawn(study, [combination])  # a word may be the cause
            raise located
        if finished.error:
            raise finished.error
        warnings.append((finished.number, finished.value))
        progress.show('checked', done, len(checked))
    study_rows.check_drawn(study, combinations)
    for line in dict.fromkeys(line for _, line in sorted(warnings) if line):
        progress.print_line(f'warning: {line}')
    roads: dict[str, str] = {}
    for road in study.scenarios:
        other = roads.setdefault(scenario.load(road).name, road)
        if other != road:
            raise BagError(
                f'{study.path}: scenarios: {other} and {road} have one name, '
                f'{scenario.load(road).name!r}; give one of them another'
            )
    return rows


def summarise(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table of scenarios and controllers: drives without an error, and how they ended.

    The draws of a family count as one scenario.
    """
    texts = []
    frame = pandas.DataFrame(rows)
    frame['road'] = frame['family'].fillna(frame['scenario'])
    for pair, drives in frame.groupby(['road', 'controller'], sort=False):
        driven = drives[drives['error'] == '']
        count = f'{len(driven):,}' + ('' if len(driven) == len(drives) else f' of {len(drives):,}')
        shares = (f'{driven[name].mean():.1%}' if len(driven) else '–' for name in SHARES)
        texts.append([*pair, count, *shares])
    columns = 'scenario', 'controller', 'drives', *(share.replace('_', '\n') for share in SHARES)
    return tables.table(columns, texts, left=columns[:2], overflow='fold', min_width=9)
