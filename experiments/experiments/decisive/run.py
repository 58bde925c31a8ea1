"""Drive the study, replicate by replicate, and keep every row.

`folder`/replicate_NN has the records of its drives, so that an interrupted call goes on. When a
replicate has ended, its tables are written beside them; those of all are in `folder` at the end:

tuned.parquet    the weights that each search has chosen, and their cost
trials.parquet   every point of the searches
drives.parquet   every drive: those that judge (`judged`), and those of the searches
picture.parquet  the draws from which the nearest to the paper's picture are taken
"""

import json
import os
import time
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from bags.errors import BagError
from experiments import code_version
from experiments.decisive import arms, outcome, picture, report, search
from experiments.decisive.driver import Driver
from experiments.drive_records import DriveRecords
from experiments.pool import Pool
from experiments.progress import CountProgress
from node_runtime import provenance

# what decides the rows in a folder, and the plan as it was read
ORIGIN, PLAN = 'origin.json', 'study.yaml'
ROOTS = (*code_version.ROOTS, __name__)
PART = 'replicate_{:02}'
TABLES = ('tuned', 'trials', 'drives')
Plan = Mapping[str, Any]


def run(
    plan: Plan, folder: Path, pool: Pool, progress: CountProgress, replicates: int | None = None
) -> None:
    """Drive replicates until the rule of the plan stops them, or a number; then the picture.

    Writes the tables of all. Raises BagError while another program drives them, and for a folder
    with rows of another plan or another version of the code.
    """
    _check_origin(plan, folder)
    number, is_over = 0, False
    while not is_over:
        number += 1
        part = folder / PART.format(number)
        if not (part / 'drives.parquet').is_file():
            replicate(plan, number, part, pool, progress)
        tables = {name: _collect(folder, name, number) for name in TABLES}
        is_over = number >= (replicates or plan['stop']['cap'])
        if not replicates and number >= plan['stop']['from']:
            is_over = is_over or report.analyse(plan, tables).stop.startswith('stop')
    with DriveRecords(folder / 'picture') as records:
        driver = Driver(records, pool, progress)
        picture.drive(plan, driver)
    tables['picture'] = pd.DataFrame(driver.lines)
    for name, table in tables.items():
        _write(table, folder / f'{name}.parquet')


def replicate(plan: Plan, number: int, folder: Path, pool: Pool, progress: CountProgress) -> None:
    """Search, judge and keep the tables of a replicate, or finish what is missing of it.

    Raises BagError while another program drives it.
    """
    begin_s = time.monotonic()
    with DriveRecords(folder) as records:
        driver = Driver(records, pool, progress)
        seed = plan['seeds']['training'] + number
        trials = {arm: search_arm(plan, arm, seed, driver) for arm in plan['tuned']}
        tuned = {arm: points[-1] for arm, points in trials.items()}
        _judge(plan, number, {arm: trial.weights for arm, trial in tuned.items()}, driver)
    frames = {
        'tuned': as_frame((arm, trial) for arm, trial in tuned.items()),
        'trials': as_frame((arm, trial) for arm, points in trials.items() for trial in points),
        'drives': pd.DataFrame(driver.lines),
    }
    for name, frame in frames.items():
        frame.insert(0, 'replicate', number)
        _write(frame, folder / f'{name}.parquet')
    count = len(driver.lines)
    progress.print_line(
        f'replicate {number}: {count:,} drives in {time.monotonic() - begin_s:.0f} s, cost '
        + ', '.join(f'{arm} {trial.cost:.2f}' for arm, trial in tuned.items())
    )


def search_arm(plan: Plan, arm: str, seed: int, driver: Driver) -> list[search.Trial]:
    """Return the trials of the search for the weights of an arm; the last is the recommended one.

    `plan` describes the arm under `tuned`; drives are kept by the driver.
    """
    names = arms.tuned_parameters(plan, arm)
    drive = partial(_costs, plan, arm, seed, driver)
    return search.search(plan['search']['ranges'], names, plan['search'], seed, drive)


def as_frame(trials: Iterable[tuple[str, search.Trial]]) -> pd.DataFrame:
    """Return trials of arms as a table."""
    frame = pd.DataFrame({'arm': arm, **t._asdict(), **t.weights} for arm, t in trials)
    return frame.drop(columns='weights')


def _costs(plan, arm, seed, driver, points, begin, end):
    rows = [
        arms.row(
            *(plan, arm, arms.settings(plan, arm, {arm: weights}), seed, index),
            labels=tuple(weights.items()),
        )
        for weights in points
        for index in range(begin, end)
    ]
    outcomes = driver.drive(rows, judged=False)
    costs = [outcome.cost(values, plan['search']['cost']) for values in outcomes]
    return np.reshape(costs, (len(points), end - begin))


def _judge(plan, number, tuned, driver):
    """Drive the fresh tasks: the arms, further starts, and the factorial where both avoid."""
    seed, total = plan['seeds']['judged'] + number, plan['judged_tasks']
    chosen = {
        arm: arms.settings(plan, arm, tuned)
        for arm in (*plan['tuned'], *plan['derived'], *arms.combinations(plan))
    }
    tasks = [arms.task_values(seed, index) for index in range(total)]

    def rows(arm, indices, start=0):
        return [
            arms.row(plan, arm, chosen[arm], seed, index, start, tuple(tasks[index].items()))
            for index in indices
        ]

    avoided = {}
    for arm in (*plan['tuned'], *plan['derived']):
        count = plan['derived'].get(arm, {}).get('tasks', total)
        judged = driver.drive(rows(arm, range(min(count, total))), judged=True)
        avoided[arm] = [values['avoided'] for values in judged]
    starts = plan['starts']
    for arm in ('mpcc', 'frenet'):
        for start in range(1, starts['count'] + 1):
            driver.drive(rows(arm, range(min(starts['tasks'], total)), start), judged=True)
    both = [index for index in range(total) if avoided['mpcc'][index] and avoided['frenet'][index]]
    for arm in arms.combinations(plan):
        driver.drive(rows(arm, both[: plan['factorial_tasks']]), judged=True)


def _collect(folder, name, count):
    files = [folder / PART.format(number) / f'{name}.parquet' for number in range(1, count + 1)]
    return pd.concat([pd.read_parquet(file) for file in files], ignore_index=True)


def _check_origin(plan, folder):
    """Keep what decides the rows in a folder, or compare it with what is kept."""
    file = folder / ORIGIN
    own = {'plan': provenance.digest(yaml.safe_dump(plan)), **code_version.describe(ROOTS)}
    if file.is_file():
        kept = json.loads(file.read_text())
        others = [name for name in own if kept.get(name) != own[name]]
        if others:
            raise BagError(
                f'{file}: {", ".join(others)}: differs from that of the rows in this folder, which '
                'must not be mixed with others; give another --out'
            )
        return
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(own, indent=2) + '\n')
    if not (folder / PLAN).exists():
        (folder / PLAN).write_text(yaml.safe_dump(plan, sort_keys=False))


def _write(frame, path):
    """Write a table, whole or not at all."""
    part = path.with_suffix('.part')
    frame.to_parquet(part, compression='zstd')
    os.replace(part, path)
