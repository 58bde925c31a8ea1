"""Signals as flags to poll, so that they never interrupt the start of a node or a file write."""

import signal
import time
from pathlib import Path

# exit code that shells report for a program ended by a signal: this plus its number
SHELL_SIGNAL = 128
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
POLL_S = 0.1


class Interrupted(KeyboardInterrupt):
    """A signal requested the end of this program.

    number  of the signal
    kept    path of the recording that was kept, None without one
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
    """A context in which a signal only sets a flag, which `sleep` and `check` read.

    An ignored SIGHUP stays ignored, as under nohup. SIGINT and SIGTERM always count: shells make
    background programs ignore SIGINT, but a SIGINT sent to one is intended.
    """

    def __init__(self):
        self._number: int | None = None  # of the first signal
        self._before = {}

    def __enter__(self):
        keeps_hangup_ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
        caught = [n for n in SIGNALS if n != signal.SIGHUP or not keeps_hangup_ignored]
        self._before = {number: signal.signal(number, self._set_flag) for number in caught}
        return self

    def __exit__(self, *error):
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _set_flag(self, number, frame):
        self._number = self._number or number

    def check(self) -> None:
        """Raise Interrupted when a signal has come."""
        if self._number is not None:
            raise Interrupted(self._number)

    def sleep(self) -> None:
        """Wait POLL_S, then check."""
        time.sleep(POLL_S)
        self.check()
