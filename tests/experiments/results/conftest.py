"""A table of drives whose results are known functions of its columns."""

import numpy as np
import pandas
import pytest

from experiments import drive_table

DRAWS, RUNS = 200, 2


@pytest.fixture(scope='session')
def true_share():
    """Return the share of drives that survive, which falls with speed and grows with friction."""
    return lambda speed, friction: 1 / (1 + np.exp(0.8 * (speed - 12.0 - 14.0 * friction)))


@pytest.fixture(scope='session')
def rows(true_share):
    """Return drives of two controllers: the second keeps 0.1 m more, whatever the draw."""
    rng = np.random.default_rng(7)
    speed, friction = rng.uniform(14.0, 30.0, DRAWS), rng.uniform(0.4, 1.0, DRAWS)
    survived = rng.random(DRAWS) < true_share(speed, friction)
    clearance = rng.normal(0.5, 0.2, DRAWS)
    one = pandas.DataFrame({'draw': np.arange(DRAWS), 'speed': speed, 'friction': friction})
    parts = []
    for controller, more in (('a', 0.0), ('b', 0.1)):
        for run in range(1, RUNS + 1):
            part = one.assign(
                scenario='road',
                controller=controller,
                family=None,
                run=run,
                error='',
                survived=survived.astype(object),
                clearance_m=clearance + more + 0.01 * rng.standard_normal(DRAWS),
                lost_by=np.where(survived, None, 'collision'),
            )
            parts.append(part)
    table = pandas.concat(parts, ignore_index=True)
    before = ['scenario', 'controller', 'family', 'draw', 'speed', 'friction', 'run', 'error']
    table = table[[*before, *(name for name in table if name not in before)]]
    table.loc[0, ['error', 'survived']] = ['its process ended', None]
    table.loc[[0, 1], 'clearance_m'] = np.nan
    return table


@pytest.fixture
def folder(tmp_path, rows):
    """Return the folder of the table."""
    rows.to_parquet(tmp_path / 'results.parquet')
    return tmp_path


@pytest.fixture
def table(folder):
    return drive_table.load(folder)
