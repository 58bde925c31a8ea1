"""Refuse a clone that holds more lines, files or megabytes than .ci/budget.txt allows.

Counted is what git tracks, as it is in the working tree; blank lines, comments and docstrings are
lines, too. Prints a table. Exit code 1 if something is above what is allowed. Run by `make budget`
with any Python from 3.10 on, without a package.
"""

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
BUDGET = '.ci/budget.txt'
UNITS: dict[str, Callable[[Path], float]] = {
    'lines': lambda path: len(path.read_bytes().splitlines()),
    'files': lambda path: 1,
    'MB': lambda path: path.stat().st_size / 1e6,
}


class BudgetError(Exception):
    """What cannot be counted, and why."""


class Row(NamedTuple):
    """A quantity: its name, what is allowed, and what it is now."""

    what: str
    unit: str
    now: float
    allowed: float

    def text(self, value: float) -> str:
        """Return a value as it is printed."""
        return f'{value:,.1f}' if self.unit == 'MB' else f'{value:,.0f}'


def tracked(root: Path, pathspecs: Sequence[str]) -> list[Path]:
    """Return the tracked files that git finds for pathspecs. Raises BudgetError."""
    command = ['git', '-C', root, 'ls-files', '-z', '--', *pathspecs]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise BudgetError(done.stderr.strip())
    paths = [root / name for name in done.stdout.split('\0') if name]
    return [path for path in paths if path.is_file()]  # one that was deleted is listed, too


def count(root: Path) -> list[Row]:
    """Return what every line of the budget says. Raises BudgetError, also for a line of no file."""
    rows = []
    for number, line in enumerate((root / BUDGET).read_text().splitlines(), 1):
        words = line.partition('#')[0].split()
        if not words:
            continue
        try:
            what, allowed, unit, first, *others = words
            files = tracked(root, [first, *others])
            rows.append(Row(what, unit, sum(map(UNITS[unit], files)), float(allowed)))
        except (ValueError, KeyError):
            raise BudgetError(
                f'{BUDGET}:{number}: must be `WHAT NUMBER {"|".join(UNITS)} PATHSPEC ...`: {line}'
            ) from None
        if not files:
            raise BudgetError(f'{BUDGET}:{number}: {what}: git tracks no such file')
    return rows


def main() -> int:
    """Count, print and judge; return the exit code."""
    if not (ROOT / '.git').exists():
        print('this is no clone: nothing is counted')
        return 0
    try:
        rows = count(ROOT)
    except BudgetError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    lines = [('what', 'now', 'allowed', '')]
    lines += [(row.what, row.text(row.now), row.text(row.allowed), row.unit) for row in rows]
    for what, now, allowed, unit in lines:
        print(f'{what:<20}{now:>10}{allowed:>10} {unit}'.rstrip())
    above = [row for row in rows if row.now > row.allowed]
    for row in above:
        print(
            f'{row.what} has {row.text(row.now)} {row.unit}, allowed {row.text(row.allowed)}: make '
            f'it smaller, or raise the number in {BUDGET} in a commit that says what users get '
            'for it',
            file=sys.stderr,
        )
    return 1 if above else 0


if __name__ == '__main__':
    sys.exit(main())
