"""Compiles controllers in a process of its own while the first run is prepared and driven.

A run on a machine with an empty cache would otherwise wait for the compiler once per formulation,
on one core. A node that needs what is being compiled waits for it, as for another node.
"""

import pickle
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from experiments.pool import TaskProcess
from mpcc_controller.parameters import CarParams, ControllerParams
from stage_solver import compile_cache


def is_worth_while() -> bool:
    """Return whether the cache has no library.

    What is missing among others is found out by making a controller only, and its node does that.
    """
    return not any(compile_cache.cache_dir().glob('*.so'))


@contextmanager
def compiling(controllers: Sequence[tuple[ControllerParams, CarParams]]) -> Iterator[None]:
    """Compile controllers, in this order, within the context; what is not done then is given up."""
    if not controllers:
        yield
        return
    process = TaskProcess()
    process.begin(pickle.dumps((_compile, (controllers,))))
    try:
        yield
    finally:
        process.terminate()


def _compile(controllers):
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # temporary files are removed
    from mpcc_controller.driving.controller import Controller

    for params, vehicle in controllers:
        # what cannot be compiled is reported by the node that needs it
        with suppress(Exception):
            Controller(params, vehicle)
