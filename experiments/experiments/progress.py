"""Progress on the console: bars on a terminal, plain lines elsewhere, as in a log file."""

import sys
import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from bags.command_line import print_text

BAR_WIDTH = 24
LINE_EVERY_S = 5.0  # without a terminal


class ProgressDisplay:
    """A context that shows one bar per task; `note` is the text behind a bar."""

    def __init__(self, console: Console, *columns):
        self.console = console
        self._bars = Progress(
            SpinnerColumn(finished_text=' '),
            TextColumn('{task.description}', style='bold'),
            BarColumn(BAR_WIDTH),
            *columns,
            TextColumn('{task.fields[note]}'),
            console=console,
            disable=not console.is_terminal,
            # errors belong on the terminal, also when stdout is a file
            redirect_stderr=sys.stderr.isatty(),
        )

    def __enter__(self):
        self._bars.start()
        return self

    def __exit__(self, *error):
        self._bars.stop()

    def print_line(self, text: str) -> None:
        """Print a line where there is no terminal."""
        if not self.console.is_terminal:
            print_text(self.console, text)


class RunProgress(ProgressDisplay):
    """Runs of the node graph: time, station and speed of the car."""

    def __init__(self, console: Console, on_motion: Callable[[], object] | None = None):
        """`on_motion` is called whenever the position of the car is shown."""
        super().__init__(console, TimeElapsedColumn())
        self._on_motion = on_motion
        self._task = self._controller = None
        self._next_line_s = 0.0

    def begin(self, controller: str, length_m: float) -> None:
        """Show the start of a run of this length."""
        note = 'starting the nodes'
        self._controller = controller
        self._task = self._bars.add_task(controller, total=length_m, note=note)
        self._print_line(note)

    def show(self, t: float, station: float, speed: float) -> None:
        """Show time [s], station along the path [m] and speed [m/s] of the car."""
        note = f't {t:5.1f} s   station {station:5.1f} m   {speed:4.1f} m/s'
        self._bars.update(self._task, completed=station, note=note)
        if self._on_motion:
            self._on_motion()
        if time.monotonic() >= self._next_line_s:
            self._print_line(note)

    def end(self, controller: str, completed: bool, message: str) -> None:
        """Show the end of the run; the message of a failed run goes to stderr, whole."""
        self._bars.update(self._task, note=message.splitlines()[0])
        self._bars.stop_task(self._task)
        if completed:
            self._print_line(message)
        else:
            print(f'{controller}: {message}', file=sys.stderr)

    def _print_line(self, text):
        self.print_line(f'{self._controller}: {text}')
        self._next_line_s = time.monotonic() + LINE_EVERY_S


class CountProgress(ProgressDisplay):
    """Many drives in process: the number done of each task, and the time to go."""

    def __init__(self, console: Console):
        super().__init__(console, MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        self._tasks = {}

    def show(self, task: str, done: int, total: int, note: str = '') -> None:
        """Show how many of `total` drives of a task are done."""
        if task not in self._tasks:
            self._tasks[task] = self._bars.add_task(task, total=total, note=note)
            self.print_line(f'{task} ...')
        self._bars.update(self._tasks[task], completed=done, total=total, note=note)
