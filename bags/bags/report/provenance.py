"""Where each run came from: commit, versions, machine, mode, and the parameters that differ."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bags.verdict import alike

ABSENT = '–'
# told apart from the parameters of the nodes: paths that differ between any two runs
PER_RUN = ('out', 'run_info')


class Row(NamedTuple):
    """One fact of every run."""

    name: str
    values: list[str]
    differs: bool


def origin(infos: Sequence[Mapping[str, str]]) -> list[Row]:
    """Return mode, commit, scenario, versions and machine of the runs."""
    found = []
    for info in infos:
        facts = {
            'mode': info.get('mode'),
            'commit': info.get('git_commit') or None,
            'scenario': info.get('scenario'),
            'scenario SHA-256': info.get('scenario_sha256', '')[:12] or None,
        }
        for group in ('versions', 'machine'):
            noted = json.loads(info.get(group, '{}'))
            facts |= {name.replace('_', ' '): value for name, value in noted.items()}
        found.append(facts)
    return _rows(found)


def parameters(infos: Sequence[Mapping[str, str]]) -> dict[str, list[Row]]:
    """Return every parameter of the runs by role of the node, in the order of their names."""
    noted = [alike.parameters(info) for info in infos]
    roles = sorted({role for one in noted for role in one})
    return {
        role: [row for row in _rows([one.get(role, {}) for one in noted]) if _counts(role, row)]
        for role in roles
    }


def _counts(role, row):
    return role != 'recorder' or row.name not in PER_RUN


def _rows(found: Sequence[Mapping[str, Any]]):
    names = dict.fromkeys(name for one in found for name in one)
    rows = []
    for name in names:
        values = [one.get(name) for one in found]
        differs = any(value != values[0] for value in values)
        rows.append(Row(name, [_text(value) for value in values], differs))
    return rows


def _text(value):
    if value is None:
        return ABSENT
    return value if isinstance(value, str) else json.dumps(value)
