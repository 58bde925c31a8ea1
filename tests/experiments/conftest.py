"""Tasks of a pool in the process of the tests."""

import math

import pytest

from bags.errors import BagError
from experiments.pool import Finished, Pool


def _finish_each(pool, function, tasks, limit_s=math.inf):
    for number, task in enumerate(tasks):
        try:
            yield Finished(number, function(*task))
        except BagError as error:
            yield Finished(number, None, error)


@pytest.fixture
def tasks_here(monkeypatch):
    """Let pools do their tasks in this process, which has imported what they need.

    What only a process of its own shows is in test_pool.py and batch/test_run_batch.py.
    """
    monkeypatch.setattr(Pool, 'finish_each', _finish_each)
