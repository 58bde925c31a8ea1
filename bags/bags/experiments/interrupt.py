"""Signals as something to ask about, so that they never tear what is being started or written."""

import signal
import threading
import time

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LOOK_EVERY_S = 0.1


class Interrupt:
    """Within this context a signal only raises a flag; `sleep` and `check` see it.

    Programs started inside do not inherit an ignored SIGINT, as a shell gives to background jobs.
    """

    def __init__(self):
        self._raised = threading.Event()
        self._before = {}

    def __enter__(self):
        self._before = {n: signal.signal(n, self._note) for n in SIGNALS}
        return self

    def __exit__(self, *error):
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number, frame):
        self._raised.set()

    def check(self):
        """Raise KeyboardInterrupt when a signal has come."""
        if self._raised.is_set():
            raise KeyboardInterrupt

    def sleep(self):
        """Wait a moment, then check."""
        time.sleep(LOOK_EVERY_S)
        self.check()
