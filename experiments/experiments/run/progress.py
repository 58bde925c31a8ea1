"""What a person sees while runs are made: a line per controller with time, station and speed."""

import sys
import time

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars

from experiments.run.follow import Sight

BAR_WIDTH = 24
LINE_EVERY_S = 5.0  # without a terminal


class Progress:
    """A context in which runs are shown.

    On a terminal as bars that move; without one, as in a log file, as a line every few seconds.
    """

    def __init__(self, console: Console):
        self.console = console
        self._bars = Bars(
            SpinnerColumn(finished_text=' '),
            TextColumn('{task.description}', style='bold'),
            BarColumn(BAR_WIDTH),
            TimeElapsedColumn(),
            TextColumn('{task.fields[said]}'),
            console=console,
            disable=not console.is_terminal,
            # what goes wrong is said there, also when that is a file
            redirect_stderr=sys.stderr.isatty(),
        )
        self._task = self._controller = None
        self._next_line_s = 0.0

    def __enter__(self):
        self._bars.start()
        return self

    def __exit__(self, *error):
        self._bars.stop()

    def begin(self, controller: str, length_m: float) -> None:
        """Show that a run of this length begins."""
        said = 'starting the nodes'
        self._controller = controller
        self._task = self._bars.add_task(controller, total=length_m, said=said)
        self._print_line(said)

    def show(self, sight: Sight) -> None:
        """Show where the car is."""
        said = f't {sight.t:5.1f} s   station {sight.station:5.1f} m   {sight.speed:4.1f} m/s'
        self._bars.update(self._task, completed=sight.station, said=said)
        if time.monotonic() >= self._next_line_s:
            self._print_line(said)

    def end(self, controller: str, completed: bool, message: str) -> None:
        """Show how the run ended; what went wrong in full, on stderr."""
        first, *_ = message.splitlines()
        self._bars.update(self._task, said=first)
        self._bars.stop_task(self._task)
        if not completed:
            print(f'{controller}: {message}', file=sys.stderr)
        else:
            self._print_line(message)

    def _print_line(self, text):
        if not self.console.is_terminal:
            line = f'{self._controller}: {text}'
            self.console.print(line, markup=False, highlight=False, soft_wrap=True)
        self._next_line_s = time.monotonic() + LINE_EVERY_S
