"""Drive the study, replicate by replicate, and keep every row.

`folder`/replicate_NN has the records of its drives, so that an interrupted call goes on; when a
replicate has ended, its tables are written beside them:

tuned.parquet    the weights that each search has chosen, and their cost
trials.parquet   every point of the searches
drives.parquet   every drive, those of the searches, too (`stage` 1 to 3; 0: judged)
"""

import json
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pandas as pd

from bags.errors import BagError
from experiments import drive_row
from experiments.decisive import arms, outcome, search
from experiments.drive_records import DriveRecords
from experiments.drive_row import Row
from experiments.pool import Pool
from experiments.progress import CountProgress

LIMIT_S = 120.0  # of wall time for a drive
TABLES = ('tuned', 'trials', 'drives')
Plan = Mapping[str, Any]


def replicate(plan: Plan, number: int, folder: Path, pool: Pool, progress: CountProgress) -> None:
    """Search, judge and keep the tables of a replicate, or finish what is missing of it.

    Raises BagError while another program drives it.
    """
    begin_s = time.monotonic()
    with DriveRecords(folder) as records:
        driver = Driver(records, pool, progress)
        tuned, trials = _search_all(plan, number, driver)
        _judge(plan, number, {arm: trial.weights for arm, trial in tuned.items()}, driver)
    frames = {
        'tuned': _as_frame((arm, trial) for arm, trial in tuned.items()),
        'trials': _as_frame((arm, trial) for arm, points in trials.items() for trial in points),
        'drives': pd.DataFrame(driver.lines),
    }
    for name, frame in frames.items():
        frame.insert(0, 'replicate', number)
        frame.to_parquet(folder / f'{name}.parquet', compression='zstd')
    count = len(driver.lines)
    progress.print_line(
        f'replicate {number}: {count:,} drives in {time.monotonic() - begin_s:.0f} s, cost '
        + ', '.join(f'{arm} {trial.cost:.2f}' for arm, trial in tuned.items())
    )


class Driver:
    """Drives rows that have no record, and keeps a line of the table for each."""

    def __init__(self, records: DriveRecords, pool: Pool, progress: CountProgress):
        self.records, self.pool, self.progress = records, pool, progress
        self.lines: list[dict[str, Any]] = []

    def drive(self, rows: Sequence[Row], **labels: Any) -> list[Mapping[str, Any]]:
        """Return the outcome of each row; that of a drive without a result is a failure."""
        keys = [drive_row.key(row) for row in rows]
        missing = {key: row for key, row in zip(keys, rows) if key not in self.records}
        errors: dict[str, str] = {}
        tasks = [(row, key, outcome.measure) for key, row in missing.items()]
        ended = self.pool.finish_each(drive_row.drive_unchanged, tasks, LIMIT_S)
        for done, finished in enumerate(ended, start=len(rows) - len(missing) + 1):
            key = list(missing)[finished.number]
            if finished.error:
                errors[key] = ' '.join(str(finished.error).split())
            else:
                self.records.add(key, finished.value)
            self.progress.show('drives', done, len(rows), f'{len(self.lines):,} before')
        results = []
        for row, key in zip(rows, keys):
            values = json.loads(self.records.get(key, json.dumps(outcome.FAILED)))
            self.lines.append(
                {**labels, **dict(row.labels), **values, 'error': errors.get(key, '')}
            )
            results.append(values)
        return results


def _search_all(plan, number, driver):
    """Return the winner of each tuned arm and all of its trials."""
    winners, trials = {}, {}
    seed = plan['seeds']['training'] + number
    for arm in plan['tuned']:
        names = arms.tuned_parameters(plan, arm)
        ranges = {name: plan['search']['ranges'][name] for name in names}
        drive = partial(_costs, plan, arm, seed, driver)
        trials[arm] = search.search(ranges, plan['search'], seed, drive)
        winners[arm] = search.winner(trials[arm])
    return winners, trials


def _costs(plan, arm, seed, driver, points, begin, end):
    rows = [
        arms.row(
            plan,
            arm,
            arms.settings(plan, arm, {arm: weights}),
            seed,
            index,
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
        # the same offsets for every arm
        offsets = (0.0 if not start else _offset(plan, seed, index, start) for index in indices)
        return [
            arms.row(plan, arm, chosen[arm], seed, index, speed_kph)._replace(
                labels=(('arm', arm), ('task', index), ('start', start), *tasks[index].items())
            )
            for index, speed_kph in zip(indices, offsets)
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


def _offset(plan, seed, index, start):
    most = plan['starts']['speed_kph']
    return Random(f'{seed} {index} {start}').uniform(-most, most)


def _as_frame(trials):
    return pd.DataFrame(
        {'arm': arm, 'stage': t.stage, 'cost': t.cost, 'drives': t.drives, **t.weights}
        for arm, t in trials
    )


def read(folder: Path, table: str) -> pd.DataFrame:
    """Return a table of all replicates that have ended. Raises BagError where there is none."""
    files = sorted(folder.glob(f'replicate_*/{table}.parquet'))
    if not files:
        raise BagError(f'{folder}: has no replicate that has ended')
    return pd.concat([pd.read_parquet(file) for file in files], ignore_index=True)
