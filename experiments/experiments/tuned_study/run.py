"""Drive the study, replicate by replicate, and keep every row.

`folder`/replicate_NN has the records of the drives of a replicate, so that an interrupted call goes
on, until the replicate has ended and its rows are in the tables of the study:

tuned.parquet    the weights that each search has chosen, and their cost
trials.parquet   every point of the searches
drives.parquet   every drive: those that judge (`judged`), and those of the searches
picture.parquet  the draws from which the nearest to the paper's picture are taken

Only these are decided: nobody looks at a study that goes on.
"""

import json
import os
import shutil
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from bags.errors import BagError
from experiments import code_version
from experiments.pool import Pool
from experiments.row_runner import DriveRecords
from experiments.tuned_study import analysis, arms, picture, search
from experiments.tuned_study.arms import COMPARED, Driver
from experiments.tuned_study.plan import FILE
from node_runtime import provenance

ORIGIN = 'origin.json'  # what decides the rows in a folder
TABLES = ('tuned', 'trials', 'drives')  # by replicate
PICTURE = 'picture'
ROOTS = (*code_version.ROOTS, __name__)
Plan = Mapping[str, Any]


def run(plan: Plan, folder: Path, pool: Pool, replicates: int | None = None) -> None:
    """Drive replicates until the rule of the plan stops them, or a number; then the picture.

    Writes the tables of all; where nothing is missing nothing is driven. Raises BagError while
    another program drives them, for a folder with rows of another plan, and before a drive for one
    with rows of another version of the code.
    """
    _check_origin(plan, folder, driving=False)
    number, is_over = 0, False
    while not is_over:
        number += 1
        if number not in kept_replicates(folder):
            _check_origin(plan, folder)
            replicate(plan, number, folder, pool)
        is_over = number >= (replicates or plan['stop']['cap'])
        if not replicates and number >= plan['stop']['from']:
            drives = read(folder, 'drives').query('replicate <= @number')
            is_over = is_over or analysis.stop(plan, drives).startswith('stop')
    if not (folder / f'{PICTURE}.parquet').is_file():
        _check_origin(plan, folder)
        with DriveRecords(folder / PICTURE) as records:
            driver = Driver(records, pool)
            picture.drive(plan, driver)
        write(pd.DataFrame(driver.lines), folder, PICTURE)


def replicate(plan: Plan, number: int, folder: Path, pool: Pool) -> None:
    """Search, judge and add the rows of a replicate to the tables, or finish what is missing of it.

    Raises BagError while another program drives it.
    """
    begin_s, part = time.monotonic(), folder / f'replicate_{number:02}'
    with DriveRecords(part) as records:
        driver = Driver(records, pool)
        seed = plan['seeds']['training'] + number
        trials = {arm: search_arm(plan, arm, seed, driver) for arm in plan['tuned']}
        tuned = {arm: points[-1] for arm, points in trials.items()}
        _judge(plan, number, {arm: trial.weights for arm, trial in tuned.items()}, driver)
    frames = (
        as_frame(tuned.items()),
        as_frame((arm, trial) for arm, points in trials.items() for trial in points),
        pd.DataFrame(driver.lines),
    )
    for name, frame in zip(TABLES, frames):
        frame.insert(0, 'replicate', number)
        add(frame, folder, name)
    shutil.rmtree(part)
    count = len(driver.lines)
    pool.progress.print_line(
        f'replicate {number}: {count:,} drives in {time.monotonic() - begin_s:.0f} s, cost '
        + ', '.join(f'{arm} {trial.cost:.2f}' for arm, trial in tuned.items())
    )


def search_arm(plan: Plan, arm: str, seed: int, driver: Driver) -> list[search.Trial]:
    """Return the trials of the search for the weights of an arm; the last is the recommended one.

    `plan` describes the arm under `tuned`; drives are kept by the driver.
    """

    def drive(points, begin, end):
        rows = [
            arms.row(plan, arm, chosen, seed, index, labels=weights.items())
            for weights in points
            for chosen in [arms.settings(plan, arm, {arm: weights})]
            for index in range(begin, end)
        ]
        outcomes = driver.drive(rows, judged=False)
        costs = [arms.cost(values, plan['search']['cost']) for values in outcomes]
        return np.reshape(costs, (len(points), end - begin))

    names = arms.tuned_parameters(plan, arm)
    return search.search(plan['search']['ranges'], names, plan['search'], seed, drive)


def as_frame(trials: Iterable[tuple[str, search.Trial]]) -> pd.DataFrame:
    """Return trials of arms as a table."""
    frame = pd.DataFrame({'arm': arm, **t._asdict(), **t.weights} for arm, t in trials)
    return frame.drop(columns='weights')


def _judge(plan, number, tuned, driver):
    """Drive the fresh tasks: the arms, further starts, and the factorial where both avoid."""
    seed, total = plan['seeds']['judged'] + number, plan['judged_tasks']
    tasks = [arms.task_values(seed, index) for index in range(total)]

    def judge(arm, indices, start=0):
        """Return which of some tasks an arm avoids."""
        chosen = arms.settings(plan, arm, tuned)
        driven = [arms.row(plan, arm, chosen, seed, k, start, tasks[k].items()) for k in indices]
        return [values['avoided'] for values in driver.drive(driven, judged=True)]

    avoided = {}
    for arm in (*plan['tuned'], *plan['derived']):
        count = plan['derived'].get(arm, {}).get('tasks', total)
        avoided[arm] = judge(arm, range(min(count, total)))
    starts = plan['starts']
    for arm in COMPARED:
        for start in range(1, starts['count'] + 1):
            judge(arm, range(min(starts['tasks'], total)), start)
    both = [k for k in range(total) if all(avoided[arm][k] for arm in COMPARED)]
    for arm in arms.combinations(plan):
        judge(arm, both[: plan['factorial_tasks']])


def _check_origin(plan, folder, driving=True):
    """Compare what decides the rows in a folder with what is kept of it, or keep it.

    Where nothing is driven that is the plan alone, and nothing is kept.
    """
    file = folder / ORIGIN
    own = {'plan': provenance.digest(yaml.safe_dump(plan))}
    own |= code_version.describe(ROOTS) if driving else {}
    if file.is_file():
        kept = json.loads(file.read_text())
        others = [name for name in own if kept.get(name) != own[name]]
        if others:
            raise BagError(
                f'{file}: {", ".join(others)}: differs from that of the rows in this folder, which '
                'must not be mixed with others; give another --out'
            )
    elif driving:
        folder.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(own, indent=2) + '\n')
        if not (folder / FILE).exists():
            (folder / FILE).write_text(yaml.safe_dump(plan, sort_keys=False))


def read(folder: Path, name: str) -> pd.DataFrame:
    """Return a table of a study. Raises BagError for a folder without it."""
    path = folder / f'{name}.parquet'
    try:
        return pd.read_parquet(path)
    except OSError as error:
        raise BagError(
            f'{path}: {error.strerror or "cannot be read"}; `experiments study run` writes it when '
            'the study has ended'
        ) from None


def kept_replicates(folder: Path) -> set[int]:
    """Return the replicates that have ended: they are in the last of the tables."""
    path = folder / f'{TABLES[-1]}.parquet'
    return {*pd.read_parquet(path, columns=['replicate'])['replicate']} if path.is_file() else set()


def add(frame: pd.DataFrame, folder: Path, name: str) -> None:
    """Add the rows of a replicate to a table, in place of those that an interrupted call left."""
    if (folder / f'{name}.parquet').is_file():
        kept = read(folder, name)
        others = kept[~kept['replicate'].isin(frame['replicate'])]
        frame = pd.concat([others, frame], ignore_index=True)
    write(frame, folder, name)


def write(frame: pd.DataFrame, folder: Path, name: str) -> None:
    """Write a table, whole or not at all."""
    # numbers that hardly repeat take a fifth less, byte by byte, than in a dictionary
    counts = frame.select_dtypes('float').agg(['nunique', 'count'])
    split = [column for column, (kinds, size) in counts.items() if 2 * kinds > size]
    path = folder / f'{name}.parquet'
    frame.to_parquet(
        path.with_suffix('.part'),
        compression='zstd',
        compression_level=19,
        use_dictionary=[column for column in frame if column not in split],
        column_encoding=dict.fromkeys(split, 'BYTE_STREAM_SPLIT'),
    )
    os.replace(path.with_suffix('.part'), path)
