"""How long does it take to make a controller: the first time, and with a full cache?"""

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager

import closed_loops
from rich.progress import Progress
from tables import TextTable, number

from mpcc_controller.parameters import ControllerParams
from stage_solver import solver

CACHE = 'MPCC_CACHE_DIR'
DRY = 1.0  # friction


def measure(params: ControllerParams, progress: Progress) -> tuple[TextTable, dict]:
    """Return a table and its figures [s] by solver."""
    figures = {}
    for name in progress.track(list(solver.SOLVERS), description='starting up'):
        chosen = closed_loops.with_solver(params, name)
        with empty_cache():
            figures[name] = {'cold_s': seconds(chosen), 'cached_s': seconds(chosen)}
    rows = [(name, number(one['cold_s']), number(one['cached_s'])) for name, one in figures.items()]
    columns = ('solver', 'empty cache', 'full cache')
    return TextTable('Making a controller (s)', columns, rows), figures


def seconds(params: ControllerParams) -> float:
    """Return how long it takes to make a controller [s]."""
    began = time.perf_counter()
    closed_loops.make_controller(params, DRY)
    return time.perf_counter() - began


@contextmanager
def empty_cache() -> Iterator[None]:
    """Compile into a folder of its own."""
    before = os.environ.get(CACHE)
    with tempfile.TemporaryDirectory() as folder:
        os.environ[CACHE] = folder
        try:
            yield
        finally:
            os.environ.pop(CACHE)
            if before is not None:
                os.environ[CACHE] = before
