"""What a person sees while runs are made: a line per controller with time, station and speed."""

import sys

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars

from bags.experiments.follow import Sight

BAR_WIDTH = 24


class Progress:
    """A context in which runs are shown; without a terminal only how each ended."""

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
        self._task = None

    def __enter__(self):
        self._bars.start()
        return self

    def __exit__(self, *error):
        self._bars.stop()

    def begin(self, controller: str, length_m: float) -> None:
        """Show that a run of this length begins."""
        self._task = self._bars.add_task(controller, total=length_m, said='starting the nodes')

    def show(self, sight: Sight) -> None:
        """Show where the car is."""
        said = f't {sight.t:5.1f} s   station {sight.station:5.1f} m   {sight.speed:4.1f} m/s'
        self._bars.update(self._task, completed=sight.station, said=said)

    def end(self, controller: str, completed: bool, message: str) -> None:
        """Show how the run ended; what went wrong in full, on stderr."""
        first, *_ = message.splitlines()
        self._bars.update(self._task, said=first)
        self._bars.stop_task(self._task)
        if not completed:
            print(f'{controller}: {message}', file=sys.stderr)
        elif not self.console.is_terminal:
            self.console.print(f'{controller}: {message}', markup=False, highlight=False)
