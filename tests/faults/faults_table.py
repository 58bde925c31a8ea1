"""Print the results of the fault runs as a table.

    python tests/faults/faults_table.py OUT/verdicts.json [MORE/verdicts.json ...]

Of a fault in several files the last result is used. Every fault of the catalogue has a row, also
without a result. The measured commit is that of the latest result; rows of other commits name it.
"""

import statistics
import sys
from collections import Counter
from pathlib import Path

import catalogue
import fault_results
from fault_results import FaultResult

COMMIT_DIGITS = 10
HEAD = """| fault | mode | expected | within [s] | final state | after [s] | tries | notes |
|---|---|---|---|---|---|---|---|"""


class TableError(ValueError):
    """The results are not those of the catalogue."""


def row(fault: catalogue.Fault, result: FaultResult | None, commit: str) -> str:
    """Return the row of a fault; `commit` is the one measured."""
    cells = [f'`{fault.name}`', fault.mode, fault.expect, f'{fault.within_s:g}']
    if result is None:
        return '| ' + ' | '.join([*cells, 'not run', '', '', '']) + ' |'
    if (result.expected, result.within_s) != (fault.expect, fault.within_s):
        former = f'{result.expected} within {result.within_s:g} s'
        raise TableError(f'{fault.name}: the run expected {former}')
    notes = list(result.remarks)
    if result.tries > 1:
        notes.append(f'first try: {"; ".join(result.first_try)}')
    if result.was_stalled:
        notes.append(f'the machine stalled for {result.stall_s:.2f} s')
    if result.commit != commit:
        notes.append(f'on {named(result.commit)}')
    final = result.final_state + ('' if result.passed else ' **no**')
    after = f'{result.settled_s:.2f}'
    tries = str(result.tries)
    return '| ' + ' | '.join([*cells, final, after, tries, '; '.join(notes)]) + ' |'


def named(commit: str) -> str:
    """Return the text that names a commit."""
    if not commit:
        return 'an unknown commit'
    return f'`{commit[:COMMIT_DIGITS]}`' + (
        '' if fault_results.is_clean(commit) else ' with changes'
    )


def block(faults: list[catalogue.Fault], results: dict[str, FaultResult]) -> str:
    """Return totals, measured commits and table; raises TableError without results."""
    if not results:
        raise TableError('there is no result')
    unknown = results.keys() - {fault.name for fault in faults}
    if unknown:
        raise TableError(f'no such fault: {", ".join(sorted(unknown))}')
    commit = max(results.values(), key=lambda result: result.at).commit
    rows = [row(fault, results.get(fault.name), commit) for fault in faults]
    total = f'{fault_results.summarize(results.values())} {len(faults) - len(results)} not run.'
    return '\n'.join([total, '', measured(results, commit), '', HEAD, *rows])


def measured(results: dict[str, FaultResult], commit: str) -> str:
    """Return the commits and machines of the runs as a sentence."""
    counts = Counter(result.commit for result in results.values())
    commits = [f'{counts.pop(commit)} on commit {named(commit)}']
    commits += [f'{count} on the older {named(other)}' for other, count in counts.most_common()]
    machines = '; '.join(sorted({result.machine for result in results.values()}))
    loads = [result.load for result in results.values()]
    load = f'{min(loads):.1f} to {max(loads):.1f}, median {statistics.median(loads):.1f}'
    return f'{", ".join(commits)}. {machines}. Load average at the start of a fault: {load}.'


def main() -> int:
    """Print the table."""
    results = {}
    for name in sys.argv[1:]:
        results |= fault_results.load(Path(name))
    print(block(catalogue.load(), results))
    return 0


if __name__ == '__main__':
    sys.exit(main())
