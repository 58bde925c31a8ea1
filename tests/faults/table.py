"""Write what came of the faults into the table of docs/faults.md, from verdicts.json of runs.

    python tests/faults/table.py OUT/verdicts.json [MORE/verdicts.json ...]

A fault in several files counts as in the last one. Every fault of the catalogue has a row; one that
no file holds says so.
"""

import json
import sys
from pathlib import Path

import catalogue

PAGE = catalogue.HERE.parents[1] / 'docs' / 'faults.md'
BEGIN, END = '<!-- faults: made by tests/faults/table.py -->', '<!-- end of faults -->'
HEAD = """| fault | mode | expected | within [s] | found | after [s] | notes |
|---|---|---|---|---|---|---|"""


class TableError(ValueError):
    """The page or a file of verdicts is not as it must be."""


def verdicts(paths: list[Path]) -> dict[str, dict]:
    """Return the verdict of each fault by its name."""
    found = {}
    for path in paths:
        found |= {verdict['name']: verdict for verdict in json.loads(path.read_text())}
    return found


def row(fault: catalogue.Fault, verdict: dict | None) -> str:
    """Return the row of a fault."""
    said = [f'`{fault.name}`', fault.mode, fault.expect, f'{fault.within_s:g}']
    if verdict is None:
        return '| ' + ' | '.join([*said, 'not run', '', '']) + ' |'
    if verdict['expected'] != fault.expect:
        raise TableError(f'{fault.name}: was run when {verdict["expected"]} was expected')
    notes = list(verdict['remarks'])
    if verdict['tries'] > 1:
        notes.append(f'try {verdict["tries"]}')
    if verdict['disturbed']:
        notes.append(verdict['disturbed'])
    found = verdict['found'] + (' **no**' if verdict['remarks'] else '')
    after = verdict['settled_s']
    return '| ' + ' | '.join([*said, found, f'{after:.2f}', '; '.join(notes)]) + ' |'


def block(faults: list[catalogue.Fault], found: dict[str, dict]) -> str:
    """Return the table and its sum."""
    unknown = found.keys() - {fault.name for fault in faults}
    if unknown:
        raise TableError(f'no such fault: {", ".join(sorted(unknown))}')
    passed = sum(not verdict['remarks'] for verdict in found.values())
    bad = sum(verdict['nonsense'] for verdict in found.values())
    rows = [row(fault, found.get(fault.name)) for fault in faults]
    total = (
        f'{passed} of {len(found)} as expected, {len(faults) - len(found)} not run, '
        f'{bad} commands that must not be.'
    )
    return '\n'.join([total, '', HEAD, *rows])


def written(page: str, table: str) -> str:
    """Return a page with another table; raises TableError when it has no place for one."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise TableError(f'the page lacks {BEGIN} or {END}')
    return f'{before}{BEGIN}\n{table}\n{END}{after}'


def main() -> int:
    """Rewrite the table."""
    table = block(catalogue.load(), verdicts([Path(name) for name in sys.argv[1:]]))
    PAGE.write_text(written(PAGE.read_text(), table))
    return 0


if __name__ == '__main__':
    sys.exit(main())
