"""The rows of a study: the full grid of its values, in the order of the file, draws and runs.

Draw k is point k of the scrambled Sobol points of what is drawn, and draw k of a family: it is the
same for every controller and setting. Run 1 is as configured. Further runs differ in entry speed
and grip; run k has the same offset for every scenario, controller, setting and draw. Rows of one
draw and run are pairs, and a longer batch begins with the draws and runs of a shorter one.

The offsets are Halton points shifted by a seeded vector (Cranley and Patterson 1976).
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from bags.errors import BagError
from experiments import drive_row
from experiments.batch import distributions
from experiments.batch.study_file import StudyFile
from experiments.configuration import inputs, node_config
from experiments.drive_row import ANY_ROAD, NOMINAL, Offset, Row

CAR = f'plant.{inputs.PLANT_CAR}'
PLANT_FILE = f'plant.{node_config.PLANT_DEFAULTS}'
INSIDE = 0.3819660113  # share of a distribution: a value that is no whole number
SPEED_SPREAD_KPH = 0.5  # either way
GRIP_SPREAD = 0.03  # likewise


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
    samples = distributions.sample(drawn, len(study.draws), study.seed, study.draws.start)
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
    """Refuse a combination that no node takes; return what `describe_misfit` says of it.

    A draw of a family is checked on another road. Raises BagError.
    """
    row = combination._replace(scenario=ANY_ROAD) if combination.draw else combination
    drive_row.prepare(row, any_car=True)
    return describe_misfit(row)


def describe_misfit(row: Row) -> str:
    """Return a line about a plant file that is another car than the controller knows, '' for none.

    The file alone counts: single parameters of the plant's car are varied on purpose.
    """
    settings = tuple(pair for pair in row.settings if not pair[0].startswith(CAR))
    chosen = dict(settings)
    if PLANT_FILE not in chosen:
        return ''
    setup = drive_row.prepare(row._replace(settings=settings), any_car=True)
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
                return BagError(str(item.error(str(alone))))
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
                    raise BagError(str(drawn.item.error(f'{end}: {error}'))) from None
