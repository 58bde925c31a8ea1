"""Drives on the wall clock beside other tests: their nodes have priority, one drive at a time.

Tests get this module from the fixture `wall_clock`: it marks them as `alone` where the user may not
set real-time priority.
"""

from functools import cache

# what else is needed is imported late: every session of tests loads this module


@cache
def may_set_priority() -> bool:
    """Return whether the user may set real-time priority."""
    import stalls

    return stalls.may_set_priority()


@cache
def priorities() -> dict[str, int]:
    """Return the priority of each role, {} where the user may not set it."""
    from realtime import FIFO

    return FIFO if may_set_priority() else {}


def own_drive():
    """Return a context in which no other test drives on the wall clock with priority."""
    import drive_lock

    return drive_lock.hold('realtime')


def with_priority(**settings: dict) -> dict[str, dict]:
    """Return parameters by role: `settings`, and the priority of each node."""
    given = {role: {'realtime.priority': number} for role, number in priorities().items()}
    return {r: settings.get(r, {}) | given.get(r, {}) for r in settings.keys() | given.keys()}


def options() -> list[str]:
    """Return the options of `experiments run` that give every node its priority."""
    given = (f'{role}.realtime.priority={number}' for role, number in priorities().items())
    return [word for setting in given for word in ('--set', setting)]
