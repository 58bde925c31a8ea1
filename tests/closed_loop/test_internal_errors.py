"""An exception in each function that a tick calls, while the car changes lanes.

Which functions these are is found by tracing a drive. Each is made to raise in a process of its
own, forked in the middle of the drive: for one tick, and for good. Functions inside of functions
are left out: to their callers it is the same whether they raise or what is around them.
"""

import gc
import os
import random
import sys
import traceback
import types
from contextlib import contextmanager, nullcontext
from functools import cache
from itertools import takewhile
from typing import NamedTuple

import commit_seed
import numpy as np
import pytest
from driven_setups import Loop, prepare

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.last_resort import INTERNAL_ERROR

PACKAGES = ('mpcc_controller', 'stage_solver', 'msgs_yaml', 'node_runtime')
CONTROLLERS = ('mpcc_road', 'mpcc')
TICK = 35  # between the lanes; functions that it does not call fail in another tick
AFTER = 20  # ticks driven after an exception
SAMPLE = 4  # functions of each controller that are tried in every run of the tests
SEED = 'INJECTION_SEED'  # environment variable that repeats a sample; each commit draws another
HALF_WIDTH_M, EDGES_M = 0.92, (-2.5, 6.0)
ENTRIES = ('step', 'report', 'prepare')  # of the controller: where exceptions are caught


def loop_of(name):
    setup = prepare('double_lane_change', name)
    return Loop(setup, Controller(setup.params, setup.vehicle))


class Failure(NamedTuple):
    """A function that is to raise, and when."""

    code: types.CodeType
    tick: int
    for_good: bool

    def __str__(self):
        name = f'{os.path.basename(self.code.co_filename)}:{self.code.co_name}'
        return f'{name} in tick {self.tick}{" and after it" if self.for_good else ""}'


@contextmanager
def tracing(calls, tick):
    """Note the functions of the packages that are called, with the tick."""

    def note(frame, event, _):
        code = frame.f_code
        if event == 'call' and any(f'/{p}/{p}/' in code.co_filename for p in PACKAGES):
            calls.setdefault(code, []).append(tick)

    sys.setprofile(note)
    try:
        yield
    finally:
        sys.setprofile(None)


def functions_of(code):
    """Return the functions that have this code; those whose results are kept forget them."""
    found = [f for f in gc.get_referrers(code) if isinstance(f, types.FunctionType)]
    for kept in (o for f in found for o in gc.get_referrers(f)):
        if hasattr(type(kept), 'cache_clear'):
            kept.cache_clear()  # it may know this tick from the drive that was traced
    return found


def stub(*_, **__):
    raise RuntimeError('injected')


@contextmanager
def failing(functions):
    """Let functions of one code raise."""
    codes = [function.__code__ for function in functions]
    for function in functions:
        function.__code__ = stub.__code__
    try:
        yield
    finally:
        for function, code in zip(functions, codes):
            function.__code__ = code


def drive_with(loop, failure):
    """Drive on with a function that fails; return what is wrong then, '' if nothing is."""
    first, functions = len(loop.records), functions_of(failure.code)
    ticks = 0
    while not loop.outcome and (failure.for_good or ticks < AFTER) and loop.car.state.vx > 0.3:
        fails = ticks == 0 or failure.for_good
        loop.tick(failing(functions) if fails else nullcontext())
        ticks += 1
    records = loop.records[max(first - 1, 0) :]
    values = np.array([record.command[1:] for record in records])
    delta, force = values[:, 0], values[:, 2] + values[:, 3]
    steer_rate, force_rate = (np.max(np.abs(np.diff(each))) / 0.05 for each in (delta, force))
    Y = [x.Y for x in loop.states[first:]]
    limits, records = loop.controller.params.limits, loop.records[first:]
    more, braked = 1 + 1e-6, len([*takewhile(has_raised, reversed(records))])
    wrong = {
        'a value is not finite': not np.isfinite(values).all(),
        'the angle is out of range': np.max(np.abs(delta)) > limits.steer_rad * more,
        'it steers too fast': steer_rate > limits.steer_rate_radps * more,
        'the force changes too fast': force_rate > limits.force_rate_nps * more,
        'the plant rejected a command': loop.car.gate.rejected > 0,
        'the car left the road': (
            min(Y) - HALF_WIDTH_M < EDGES_M[0] or max(Y) + HALF_WIDTH_M > EDGES_M[1]
        ),
        'nothing failed': not loop.controller.errors.counts
        and all(record.decision.level == 'solved' for record in records),
        # what fails only at speed works again when the car is slow, and then it drives on
        'it brakes and does not stop': failure.for_good and braked > 60 and loop.states[-1].vx > 1,
    }
    return ', '.join(what for what, is_so in wrong.items() if is_so)


def has_raised(record):
    """Return whether the car braked because the tick raised."""
    return record.decision.reason == INTERNAL_ERROR


def in_a_fork(work, *arguments):
    """Return the text that a function returns in a copy of this process, or its traceback."""
    receiver, sender = os.pipe()
    child = os.fork()
    if not child:
        try:
            text = work(*arguments)
        except BaseException:
            text = traceback.format_exc()
        with os.fdopen(sender, 'w') as file:
            file.write(text)
        os._exit(0)
    os.close(sender)
    with os.fdopen(receiver) as file:
        text = file.read()
    os.waitpid(child, 0)
    return text


@pytest.fixture(scope='module')
def one_processor():
    """Solve in one thread: a fork has no other."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    yield
    os.sched_setaffinity(0, before)


@pytest.fixture(scope='module')
def failures(one_processor):
    """Return a function that gives every failure of a controller, in the order of their ticks."""

    @cache
    def find(name):
        loop_of(name).tick()  # what a process does once, it has done
        loop, calls = loop_of(name), {}
        while not loop.outcome:
            loop.tick(tracing(calls, len(loop.records)))
        assert all(record.decision.plan is not None for record in loop.records)
        gc.unfreeze()  # objects of modules that were frozen are not looked through
        functions = [f for f in gc.get_objects() if isinstance(f, types.FunctionType)]
        whole = {f.__code__ for f in functions if '<locals>' not in f.__qualname__}
        whole -= {getattr(Controller, entry).__code__ for entry in ENTRIES}
        found = [
            Failure(code, next((t for t in ticks if t >= TICK), ticks[-1]), for_good)
            for code, ticks in calls.items()
            if code in whole and not code.co_freevars
            for for_good in (False, True)
        ]
        return sorted(found, key=lambda failure: failure.tick)

    return find


def inject(name, chosen):
    """Return what is wrong after each of the chosen failures, in the order of their ticks."""
    loop, faults = loop_of(name), {}
    for failure in chosen:
        while len(loop.records) < failure.tick:
            loop.tick()
        faults[str(failure)] = in_a_fork(drive_with, loop, failure)
    return {failure: fault for failure, fault in faults.items() if fault}


@pytest.mark.slow
@pytest.mark.parametrize('name', CONTROLLERS)
def test_some_function_of_a_tick_raises_and_the_car_stays_on_the_road(failures, name):
    every, seed = failures(name), commit_seed.seed(SEED)
    print(f'{SAMPLE} of {len(every)} failures; {SEED}={seed} repeats them')
    chosen = sorted(random.Random(seed).sample(range(len(every)), SAMPLE))
    assert inject(name, [every[i] for i in chosen]) == {}


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize('name', CONTROLLERS)
def test_every_function_of_a_tick_raises_and_the_car_stays_on_the_road(failures, name):
    every = failures(name)
    print(f'{len(every)} failures')
    assert len(every) > 200
    assert inject(name, every) == {}
