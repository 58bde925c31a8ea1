"""Compiles controllers in a process of its own while the first run is prepared and driven.

A run on a machine with an empty cache would otherwise wait for the compiler once per formulation,
on one core. A node that needs what is being compiled waits for it, as for another node.
"""

import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.process import BaseProcess

from experiments.worker_pool import exit_with_parent, main_left_out
from mpcc_controller.parameters import CarParams, ControllerParams
from stage_solver import compile_cache

LEAVE_S = 5.0  # to end the compiler and to remove its files


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
    # spawned: a fork would copy the threads of the progress display
    process = get_context('spawn').Process(target=_compile, args=(controllers,), daemon=True)
    with main_left_out():
        process.start()
    try:
        yield
    finally:
        _end(process)


def _end(process: BaseProcess) -> None:
    if process.is_alive():
        # the group has its compilers; there is none before the process has begun its work
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        process.terminate()
    process.join(LEAVE_S)
    if process.exitcode is None:
        process.kill()
        process.join()


def _compile(controllers):
    os.setpgid(0, 0)  # Ctrl-C is for the parent, which then ends this one
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # temporary files are removed
    exit_with_parent()
    from mpcc_controller.driving.controller import Controller

    for params, vehicle in controllers:
        # what cannot be compiled is reported by the node that needs it
        with suppress(Exception):
            Controller(params, vehicle)
