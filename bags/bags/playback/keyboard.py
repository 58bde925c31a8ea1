"""Keys of a terminal, one by one as they are pressed, without Enter."""

import os
import select
import sys
import termios
import tty
from collections.abc import Callable
from threading import Thread

WAKE_S = 0.1  # longest time until `close` is noticed


class Keyboard:
    """Calls `pressed(key)`, from a thread of its own, for every key until `close`.

    Does nothing where standard input is no terminal, or that of a program in the foreground while
    this one is in the background. Ctrl-C stays a signal. `close` gives the terminal back as it was.
    """

    def __init__(self, pressed: Callable[[str], None]):
        self._pressed = pressed
        self._closing = False
        self._thread = self._before = None
        self.attached = _in_the_foreground()
        if self.attached:
            self._descriptor = sys.stdin.fileno()
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor)
            self._thread = Thread(target=self._read, daemon=True)
            self._thread.start()

    def _read(self):
        while not self._closing:
            ready, _, _ = select.select([self._descriptor], [], [], WAKE_S)
            keys = os.read(self._descriptor, 1) if ready else b''
            if ready and not keys:  # the terminal is gone
                return
            for key in keys.decode('ascii', 'ignore'):
                self._pressed(key)

    def close(self) -> None:
        """Stop reading, restore the terminal."""
        self._closing = True
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)


def _in_the_foreground():
    # whoever changes the terminal from the background is stopped by it
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError, AttributeError):  # closed, or none at all
        return False
