"""An exception in each function that a tick calls, while the car changes lanes.

Which functions these are is found by tracing a drive. Each is made to raise in a process of its
own, forked in the middle of the drive: for one tick, and for good.
"""

import gc
import json
import os
import random
import sys
import traceback
import types
from contextlib import contextmanager, nullcontext
from functools import cache, partial
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
SAMPLE = 6  # functions of each controller that are tried in every run of the tests
SEED = 'INJECTION_SEED'  # environment variable that repeats a sample; each commit draws another
HALF_WIDTH_M, EDGES_M = 0.92, (-2.5, 6.0)
INJECTED = 'injected'
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


def raising(code):
    """Return code that raises, and that fits the functions of `code`."""
    cells = [f'c{i}' for i in range(len(code.co_freevars))]
    text = f"""
def outer({', '.join(cells)}):
    def stub(*_, **__):
        {', '.join(cells) or 'pass'}
        raise RuntimeError({INJECTED!r})
    return stub
"""
    scope = {}
    exec(text, scope)
    return scope['outer'](*cells).__code__


def replaced(inside, old, new):
    """Return code with a nested function replaced; itself if it is not nested there."""
    constants = tuple(
        new if c is old else replaced(c, old, new) if isinstance(c, types.CodeType) else c
        for c in inside.co_consts
    )
    same = all(a is b for a, b in zip(constants, inside.co_consts))
    return inside if same else inside.replace(co_consts=constants)


def changes(code):
    """Return every function that has this code, or code around it, with code that raises."""
    gc.unfreeze()  # objects of modules that were frozen are not among all objects
    stub, found = raising(code), []
    for function in [f for f in gc.get_objects() if isinstance(f, types.FunctionType)]:
        own = function.__code__
        new = stub if own is code else replaced(own, code, stub)
        if new is not own:
            found.append((function, own, new))
    assert found, code
    for cached in [o for o in gc.get_objects() if hasattr(type(o), 'cache_clear')]:
        if getattr(cached, '__wrapped__', None) in [function for function, _, _ in found]:
            cached.cache_clear()  # it may know this tick from the drive that was traced
    return found


@contextmanager
def failing(changed):
    """Let functions raise."""
    for function, _, new in changed:
        function.__code__ = new
    try:
        yield
    finally:
        for function, own, _ in changed:
            function.__code__ = own


def drive_with(loop, failure):
    """Drive on with a function that fails; return what the car and the commands did."""
    first, past, changed = len(loop.records), 0, changes(failure.code)
    while not loop.outcome and (failure.for_good or past < AFTER) and loop.car.state.vx > 0.3:
        is_failing = len(loop.records) == first or failure.for_good
        loop.tick(failing(changed) if is_failing else nullcontext())
        past += 1
    commands = [record.command for record in loop.records[max(first - 1, 0) :]]
    values = np.array([command[1:] for command in commands])
    rates = np.diff(np.column_stack((values[:, 0], values[:, 2] + values[:, 3])), axis=0) / 0.05
    Y = [x.Y for x in loop.states[first:]]
    errors = loop.controller.errors
    return {
        'finite': bool(np.isfinite(values).all()),
        'steer_rad': float(np.max(np.abs(values[:, 0]))),
        'steer_rate_radps': float(np.max(np.abs(rates[:, 0]))),
        'force_rate_nps': float(np.max(np.abs(rates[:, 1]))),
        'Y': [min(Y), max(Y)],
        'rejected': loop.car.gate.rejected,
        'errors': errors.counts.total(),
        'unsolved': sum(record.decision.level != 'solved' for record in loop.records[first:]),
        'braked': len([*takewhile(has_raised, reversed(loop.records[first:]))]),
        'vx': loop.states[-1].vx,
    }


def has_raised(record):
    """Return whether the car braked because the tick raised."""
    return record.decision.reason == INTERNAL_ERROR


def in_a_fork(work):
    """Return what a function returns in a copy of this process."""
    receiver, sender = os.pipe()
    child = os.fork()
    if not child:
        try:
            text = json.dumps(work())
        except BaseException:
            text = json.dumps(traceback.format_exc())
        with os.fdopen(sender, 'w') as file:
            file.write(text)
        os._exit(0)
    os.close(sender)
    with os.fdopen(receiver) as file:
        text = file.read()
    os.waitpid(child, 0)
    result = json.loads(text)
    assert not isinstance(result, str), result
    return result


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
        entries = {getattr(Controller, entry).__code__ for entry in ENTRIES}
        found = [
            Failure(code, next((t for t in ticks if t >= TICK), ticks[-1]), for_good)
            for code, ticks in calls.items()
            if code not in entries
            for for_good in (False, True)
        ]
        return sorted(found, key=lambda failure: failure.tick)

    return find


def judge(loop, failure, result):
    """Return what is wrong after a failure, '' if nothing is."""
    limits, r = loop.controller.params.limits, result
    wrong = {
        'a value is not finite': not r['finite'],
        'the angle is out of range': r['steer_rad'] > limits.steer_rad * (1 + 1e-6),
        'it steers too fast': r['steer_rate_radps'] > limits.steer_rate_radps * (1 + 1e-6),
        'the force changes too fast': r['force_rate_nps'] > limits.force_rate_nps * (1 + 1e-6),
        'the plant rejected a command': r['rejected'] > 0,
        'the car left the road': (
            r['Y'][0] - HALF_WIDTH_M < EDGES_M[0] or r['Y'][1] + HALF_WIDTH_M > EDGES_M[1]
        ),
        'nothing failed': not r['errors'] and not r['unsolved'],
        # what fails only at speed works again when the car is slow, and then it drives on
        'it brakes and does not stop': failure.for_good and r['braked'] > 60 and r['vx'] > 1,
    }
    text = ', '.join(what for what, is_so in wrong.items() if is_so)
    return f'{failure}: {text}: {result}' if text else ''


def inject(name, chosen):
    """Return what is wrong after each of the chosen failures, in the order of their ticks."""
    loop, faults = loop_of(name), []
    for failure in chosen:
        while len(loop.records) < failure.tick:
            loop.tick()
        result = in_a_fork(partial(drive_with, loop, failure))
        faults.append(judge(loop, failure, result))
    return [fault for fault in faults if fault]


@pytest.mark.slow
@pytest.mark.parametrize('name', CONTROLLERS)
def test_some_function_of_a_tick_raises_and_the_car_stays_on_the_road(failures, name):
    every, seed = failures(name), commit_seed.seed(SEED)
    print(f'{SAMPLE} of {len(every)} failures; {SEED}={seed} repeats them')
    chosen = sorted(random.Random(seed).sample(range(len(every)), SAMPLE))
    assert inject(name, [every[i] for i in chosen]) == []


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize('name', CONTROLLERS)
def test_every_function_of_a_tick_raises_and_the_car_stays_on_the_road(failures, name):
    every = failures(name)
    print(f'{len(every)} failures')
    assert len(every) > 200
    assert inject(name, every) == []
