"""SIGINT and SIGTERM: while a node is made they interrupt, while it runs they ask it to end.

An interrupt in the middle of a callback would leave half a message or half a record behind.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def caught() -> Iterator[None]:
    """Turn both signals into KeyboardInterrupt, and put the handlers back at the end.

    A signal that is ignored stays ignored: so a shell protects its background jobs from Ctrl-C.
    """
    heard = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _interrupt) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            # None: a handler that C code had installed and Python cannot put back
            signal.signal(number, handler or signal.SIG_DFL)


def ask_instead(request: Callable[[], None]) -> None:
    """From now on call `request` between two steps of Python; it must take no lock.

    Handlers that a node has installed for itself stay.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, lambda *_: request())


def _interrupt(number, frame):
    raise KeyboardInterrupt
