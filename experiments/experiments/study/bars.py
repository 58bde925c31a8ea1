"""What a person sees while a study drives: one bar per part, drives done and time to go."""

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


class Bars:
    """A context whose `show` is the progress of Drives; no terminal: a line as a part begins."""

    def __init__(self, console: Console):
        self.console = console
        self._tasks = {}
        self._bars = Progress(
            SpinnerColumn(finished_text=' '),
            TextColumn('{task.description}'),
            BarColumn(24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )

    def __enter__(self):
        self._bars.start()
        return self

    def __exit__(self, *error):
        self._bars.stop()

    def show(self, what: str, done: int, total: int) -> None:
        """Show how far a part is."""
        if what not in self._tasks:
            self._tasks[what] = self._bars.add_task(what, total=total)
            if not self.console.is_terminal:
                self.console.print(f'{what} ...', markup=False, highlight=False)
        self._bars.update(self._tasks[what], completed=done, total=total)
