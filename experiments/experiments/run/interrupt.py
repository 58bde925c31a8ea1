"""Signals as something to ask about, so that they never tear what is being started or written."""

import signal
import time
from pathlib import Path

# what shells report for a program that a signal ended: this plus its number
SHELL_SIGNAL = 128
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LOOK_EVERY_S = 0.1


class Interrupted(KeyboardInterrupt):
    """A signal asked this program to end.

    number  of the signal
    kept    where the recording so far was kept, None for nowhere
    """

    def __init__(self, number: int, *message: str):
        super().__init__(*message)
        self.number = number
        self.kept: Path | None = None

    @property
    def exit_code(self) -> int:
        """Exit code that shells report for the signal: 130 for SIGINT, 143 for SIGTERM."""
        return SHELL_SIGNAL + self.number


class Interrupt:
    """Within this context a signal only raises a flag; `sleep` and `check` see it.

    SIGHUP stays ignored where it was, as under nohup. SIGINT and SIGTERM always count: a shell lets
    programs in the background ignore SIGINT, but a SIGINT that is sent to one is meant.
    """

    def __init__(self):
        self._number: int | None = None  # of the first signal
        self._before = {}

    def __enter__(self):
        # a hang-up that is ignored stays so: that is what nohup asks for
        keeps_hangup_ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
        caught = [n for n in SIGNALS if n != signal.SIGHUP or not keeps_hangup_ignored]
        self._before = {number: signal.signal(number, self._note) for number in caught}
        return self

    def __exit__(self, *error):
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number, frame):
        self._number = self._number or number

    def check(self):
        """Raise Interrupted when a signal has come."""
        if self._number is not None:
            raise Interrupted(self._number)

    def sleep(self):
        """Wait a moment, then check."""
        time.sleep(LOOK_EVERY_S)
        self.check()
