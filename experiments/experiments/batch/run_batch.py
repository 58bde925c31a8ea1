"""`experiments batch`: the rows of a study are checked, those that are missing driven; a table.

The rows are the full grid of its values, in the order of the file, draws and runs. Draw k is point
k of the scrambled Sobol points of what is drawn, and draw k of a family: it is the same for every
controller and setting. Run 1 is as configured. Further runs differ in entry speed and grip; run k
has the same offset for every scenario, controller, setting and draw. Rows of one draw and run are
pairs, and a longer batch begins with the draws and runs of a shorter one.

The offsets are Halton points shifted by a seeded vector (Cranley and Patterson 1976).
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas
from rich.console import Console
from rich.table import Table

from bags.command_line import table
from bags.errors import BagError
from experiments import drive_row, row_runner
from experiments.batch import study_file
from experiments.batch.study_file import StudyFile
from experiments.configuration import inputs, node_config
from experiments.drive_row import ANY_ROAD, NOMINAL, Offset, Pairs, Row
from experiments.pool import Pool
from experiments.simulation import Setup
from scenario_publisher import scenario

SHARES = ('completed', 'collided', 'left_road', 'lost')
CAR = f'plant.{inputs.PLANT_CAR}'
PLANT_FILE = f'plant.{node_config.PLANT_DEFAULTS}'
INSIDE = 0.3819660113  # share of a distribution: a value that is no whole number
SPEED_SPREAD_KPH = 0.5  # either way
GRIP_SPREAD = 0.03  # likewise


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
    with row_runner.driving(options, console) as pool:
        given = drive_row.as_pairs(options.settings)
        rows = check_rows(study, pool, given)
        notes = {'study': study.text}
        limit_s = options.time_limit_s
        lines = row_runner.run_rows(rows, options.out, pool, limit_s, notes, drive)
    console.print(summarise(lines))
    return 1 if any(line['error'] for line in lines) else 0


def check_rows(study: StudyFile, pool: Pool, given: Pairs = ()) -> list[Row]:
    """Check every combination of a study and return its rows. Raises BagError.

    `given` are settings of all rows, over which those of the study win.
    """
    combinations = [row._replace(settings=(*given, *row.settings)) for row in combine(study)]
    rows = rows_of(study, combinations)
    names = {drawn.name for drawn in study.drawn}
    # the drawn settings that are words, each combination of them once
    words = dict.fromkeys(tuple(pair for pair in row.words if pair[0] in names) for row in rows)
    checked = [
        combination._replace(settings=(*combination.settings, *chosen))
        for combination in combinations
        for chosen in words
    ]
    warnings = []
    ended = pool.finish_each(check, [(row,) for row in checked])
    for done, finished in enumerate(ended, start=1):
        if isinstance(finished.error, BagError):
            combination = combinations[finished.number // len(words)]
            located = locate_error(study, combination, finished.error)
            check_drawn(study, [combination])  # a word may be the cause
            raise located
        if finished.error:
            raise finished.error
        warnings.append((finished.number, finished.value))
        pool.progress.show('checked', done, len(checked))
    check_drawn(study, combinations)
    for line in dict.fromkeys(line for _, line in sorted(warnings) if line):
        pool.progress.print_line(f'warning: {line}')
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
    return table(columns, texts, left=columns[:2], overflow='fold', min_width=9)


def combine(study: StudyFile) -> list[Row]:
    """Return a row per scenario or family, controller, and value of every setting.

    The last setting changes first. The scenario of a family is its first draw. Raises BagError.
    """
    try:
        controllers = node_config.find_controllers(study.controllers)
    except BagError as error:
        raise BagError(f'{study.path}: controllers: {error}') from None
    names = [setting.name for setting in study.settings]
    values = [setting.values for setting in study.settings]
    roads = (*study.scenarios, *(f'{family}:0' for family in study.families))
    drawn = study.seed, study.difficulty
    return [
        Row(road, controller.name_or_path, tuple(zip(names, chosen)), *drawn)
        for road, controller, *chosen in product(roads, controllers, *values)
    ]


def rows_of(study: StudyFile, combinations: Sequence[Row]) -> list[Row]:
    """Return the row of every drive: every run of every draw of every combination."""
    drawn = {drawn.name: drawn.distribution for drawn in study.drawn}
    samples = study_file.sample(drawn, len(study.draws), study.seed, study.draws.start)
    draws = [(number, tuple(values.items())) for number, values in zip(study.draws, samples)]
    offsets = draw_offsets(study.runs, study.seed)
    # a limit takes as long to find as a run, and that of a drawn car serves no other drive
    knows_limit = not any(name.startswith(CAR) for name in drawn)
    rows = []
    for base in combinations:
        family = base.draw.family if base.draw else ''
        for number, values in draws if family or drawn else [(None, ())]:
            labels = {} if number is None else {'draw': number}
            for run, offset in enumerate(offsets, start=1):
                labels |= {'run': run, 'seed': study.seed}
                row = base._replace(
                    scenario=f'{family}:{number}' if family else base.scenario,
                    settings=(*base.settings, *values),
                    offset=offset,
                    knows_limit=knows_limit,
                    labels=tuple(labels.items()),
                )
                rows.append(row)
    return rows


def draw_offsets(runs: int, seed: int) -> list[Offset]:
    """Return the offset of every run; that of the first changes nothing."""
    from scipy.stats import qmc

    shift = np.random.default_rng(seed).random(2)
    points = (qmc.Halton(d=2, scramble=False).random(runs - 1) + shift) % 1.0
    speeds, grips = 2 * points.T - 1
    offsets = zip(SPEED_SPREAD_KPH * speeds, 1 + GRIP_SPREAD * grips)
    return [NOMINAL, *(Offset(float(speed), float(grip)) for speed, grip in offsets)]


def check(combination: Row) -> str:
    """Refuse a combination that no node takes; return a warning of another car, '' for none.

    That is a plant file which the controller's car file does not fit: the file alone counts, as
    single parameters of the plant's car are varied on purpose. A draw of a family is checked on
    another road. Raises BagError.
    """
    row = combination._replace(scenario=ANY_ROAD) if combination.draw else combination
    drive_row.prepare(row, any_car=True)
    chosen = dict(pair for pair in row.settings if not pair[0].startswith(CAR))
    if PLANT_FILE not in chosen:
        return ''
    setup = drive_row.prepare(row._replace(settings=(*chosen.items(),)), any_car=True)
    reasons = inputs.car_mismatches(setup.params, setup.vehicle, setup.plant)
    if not reasons:
        return ''
    return (
        f'{PLANT_FILE}={chosen[PLANT_FILE]} is driven although car_file {setup.params.car_file} of '
        f'{setup.controller} does not fit it: {"; ".join(reasons)}; `identify --car` writes one '
        'for controller.car_file'
    )


def locate_error(study: StudyFile, combination: Row, error: BagError) -> BagError:
    """Return the error of `check` with the place in the file that causes it."""
    if combination.draw is None:
        try:
            inputs.load_scenario(combination.scenario)
        except BagError as alone:
            return BagError(f'{study.path}: scenarios: {alone}')
    try:
        check(combination._replace(settings=()))
    except BagError as alone:
        return BagError(f'{study.path}: controllers: {alone}')
    for setting in study.settings:
        for value, item in zip(setting.values, setting.items):
            if (setting.name, value) not in combination.settings:
                continue
            try:
                check(combination._replace(settings=((setting.name, value),)))
            except BagError as alone:
                return item.error(str(alone))
    return BagError(f'{study.path}: {combination}: {error}')


def check_drawn(study: StudyFile, combinations: Sequence[Row]) -> None:
    """Raise BagError where a node refuses an end of what is drawn, or a choice, whoever drives.

    Values between the ends are within the range of a parameter, too; one of them tells whether it
    takes whole numbers only. Values that a node refuses only together cost the rows of their
    drives.
    """
    first = {combination.controller: combination for combination in reversed(combinations)}
    for drawn in study.drawn:
        for combination in first.values():
            for end in (*drawn.distribution.ends, drawn.distribution.value(INSIDE)):
                settings: tuple[Any, ...] = (*combination.settings, (drawn.name, end))
                try:
                    check(combination._replace(settings=settings))
                except BagError as error:
                    raise drawn.item.error(f'{end}: {error}') from None
