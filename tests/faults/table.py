"""Write what came of the faults into the table of docs/faults.md, from verdicts.json of runs.

    python tests/faults/table.py OUT/verdicts.json [MORE/verdicts.json ...]

A fault in several files counts as in the last one. Every fault of the catalogue has a row; one that
no file holds says so. The commit measured is that of the latest verdict; a row of any other commit
names it.
"""

import statistics
import sys
from collections import Counter
from pathlib import Path

import catalogue
import verdicts
from verdicts import Verdict

PAGE = catalogue.HERE.parents[1] / 'docs' / 'faults.md'
BEGIN, END = '<!-- faults: made by tests/faults/table.py -->', '<!-- end of faults -->'
SHORT = 10  # digits of a commit
HEAD = """| fault | mode | expected | within [s] | found | after [s] | tries | notes |
|---|---|---|---|---|---|---|---|"""


class TableError(ValueError):
    """The page or a file of verdicts is not as it must be."""


def row(fault: catalogue.Fault, verdict: Verdict | None, commit: str) -> str:
    """Return the row of a fault; `commit` is the one measured."""
    said = [f'`{fault.name}`', fault.mode, fault.expect, f'{fault.within_s:g}']
    if verdict is None:
        return '| ' + ' | '.join([*said, 'not run', '', '', '']) + ' |'
    if (verdict.expected, verdict.within_s) != (fault.expect, fault.within_s):
        was = f'{verdict.expected} within {verdict.within_s:g} s'
        raise TableError(f'{fault.name}: was run when {was} was expected')
    notes = list(verdict.remarks)
    if verdict.tries > 1:
        notes.append(f'first try: {"; ".join(verdict.earlier)}')
    if verdict.disturbed:
        notes.append(f'the machine stood still for {verdict.stall_s:.2f} s')
    if verdict.commit != commit:
        notes.append(f'on {named(verdict.commit)}')
    found = verdict.found + ('' if verdict.passed else ' **no**')
    after = f'{verdict.settled_s:.2f}'
    tries = str(verdict.tries)
    return '| ' + ' | '.join([*said, found, after, tries, '; '.join(notes)]) + ' |'


def named(commit: str) -> str:
    """Return how a reader is told a commit."""
    if not commit:
        return 'an unknown commit'
    return f'`{commit[:SHORT]}`' + ('' if verdicts.is_clean(commit) else ' with changes')


def block(faults: list[catalogue.Fault], found: dict[str, Verdict]) -> str:
    """Return the table, its sum, and what was measured; TableError without a verdict."""
    if not found:
        raise TableError('there is no verdict')
    unknown = found.keys() - {fault.name for fault in faults}
    if unknown:
        raise TableError(f'no such fault: {", ".join(sorted(unknown))}')
    commit = max(found.values(), key=lambda verdict: verdict.at).commit
    rows = [row(fault, found.get(fault.name), commit) for fault in faults]
    total = f'{verdicts.total(found.values())} {len(faults) - len(found)} not run.'
    return '\n'.join([total, '', measured(found, commit), '', HEAD, *rows])


def measured(found: dict[str, Verdict], commit: str) -> str:
    """Return on which commits and machines the faults were run."""
    counts = Counter(verdict.commit for verdict in found.values())
    said = [f'{counts.pop(commit)} on commit {named(commit)}']
    said += [f'{count} on the older {named(other)}' for other, count in counts.most_common()]
    machines = '; '.join(sorted({verdict.machine for verdict in found.values()}))
    loads = [verdict.load for verdict in found.values()]
    load = f'{min(loads):.1f} to {max(loads):.1f}, median {statistics.median(loads):.1f}'
    return f'{", ".join(said)}. {machines}. Load average at the start of a fault: {load}.'


def written(page: str, table: str) -> str:
    """Return a page with another table; raises TableError when it has no place for one."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise TableError(f'the page lacks {BEGIN} or {END}')
    return f'{before}{BEGIN}\n{table}\n{END}{after}'


def main() -> int:
    """Rewrite the table."""
    found = {}
    for name in sys.argv[1:]:
        found |= verdicts.load(Path(name))
    table = block(catalogue.load(), found)
    PAGE.write_text(written(PAGE.read_text(), table))
    return 0


if __name__ == '__main__':
    sys.exit(main())
