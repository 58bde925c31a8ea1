"""SIGINT and SIGTERM: while a node is made they interrupt, while it runs they ask it to end.

An interrupt in the middle of a callback would leave half a message or half a record behind. One
that comes when the node is closed must not turn its exit code into that of a kill.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def caught() -> Iterator[None]:
    """Turn both signals into KeyboardInterrupt, and ignore them at the end, as the process ends.

    Also a signal that was ignored at the start, as shells do for background jobs: whoever starts
    nodes from a script ends them with SIGINT.
    """
    for number in SIGNALS:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        # the interpreter gives every handler of Python back to the system before it has ended
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def ask_instead(request: Callable[[], None]) -> None:
    """From now on call `request` between two steps of Python; it must take no lock.

    Handlers that a node has installed for itself stay.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, lambda *_: request())


def _interrupt(number, frame):
    raise KeyboardInterrupt
