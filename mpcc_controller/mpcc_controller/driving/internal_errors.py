"""Internal errors of a controller: counted by kind, and told once per kind. No ROS."""

from collections import Counter
from pathlib import Path

INTERNAL_ERROR = 'internal_error'  # the reason of a tick that raised; in diagnostics, which error


class InternalErrors:
    """Counts exceptions by their kind: their type, and the line that raised them."""

    def __init__(self):
        self.counts = Counter()
        self.latest = ''  # kind and text of the last one
        self._untold: list[str] = []

    def add(self, error: Exception) -> None:
        """Count an exception that was caught."""
        kind = _kind(error)
        self.latest = f'{kind}: {error}'
        if not self.counts[kind]:
            self._untold.append(self.latest)
        self.counts[kind] += 1

    def take_new(self) -> list[str]:
        """Return a line for each kind that is new since the last call."""
        lines, self._untold = self._untold, []
        return lines


def _kind(error) -> str:
    """Return type and place, as 'ValueError in braking.py, line 40, max_braking_force'."""
    place, name = '', type(error).__name__
    trace = error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        place = f' in {Path(code.co_filename).name}, line {trace.tb_lineno}, {code.co_name}'
        trace = trace.tb_next
    return name + place
