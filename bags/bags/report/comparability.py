"""Whether runs may be compared: they drove the same scenario with the same plant.

Where each run came from: commit, versions, machine, mode, and the parameters that differ."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError

# how the plant is run and what its files are called; what it drives like is in the other numbers
NOT_PHYSICAL = (
    'mode',
    'recorders',
    'lockstep_timeout_s',
    'imu_wheels_period_ms',
    'tyre_set',
    'start.from',
)
NAMED = 3  # differences that an error names before it counts the rest
FORCE = 'their numbers do not compare; --force compares them all the same'
ABSENT = '–'
# told apart from the parameters of the nodes: paths that differ between any two runs
PER_RUN = ('out', 'run_info')


def check_comparable(paths: Sequence[Path | str], infos: Sequence[Mapping[str, str]]) -> None:
    """Raise BagError when a run differs from the first in scenario or plant.

    `infos` are the notes of each run. A run that has noted nothing of the kind is as good as one
    that drove something else.
    """
    for path, info in zip(paths[1:], infos[1:]):
        both = f'{paths[0]} and {path}'
        if info.get('scenario_sha256') != infos[0].get('scenario_sha256'):
            ours, theirs = (one.get('scenario', '?') for one in (infos[0], info))
            differ = f'{ours!r} and {theirs!r}' if ours != theirs else f'two versions of {ours!r}'
            raise BagError(f'{both} drove unlike scenarios ({differ}): {FORCE}')
        unlike = plant_differences([infos[0], info])
        if unlike:
            named = [f'{name} {_both(values)}' for name, values in list(unlike.items())[:NAMED]]
            more = [f'and {len(unlike) - NAMED} more'] if len(unlike) > NAMED else []
            raise BagError(f'{both} drove unlike plants ({", ".join(named + more)}): {FORCE}')


def _both(values):
    return ' and '.join('unknown' if value is None else json.dumps(value) for value in values)


def plant_differences(infos: Sequence[Mapping[str, str]]) -> dict[str, list]:
    """Return the physical parameters of the plant that differ: name -> value of each run."""
    found = [node_parameters(info).get('plant', {}) for info in infos]
    differ = differences(found)
    return {name: values for name, values in differ.items() if name not in NOT_PHYSICAL}


def node_parameters(info: Mapping[str, str]) -> dict[str, dict]:
    """Return the parameters that a run noted, by role; empty when it noted none."""
    return json.loads(info.get('parameters', '{}'))


def differences(found: Sequence[Mapping]) -> dict[str, list]:
    """Return what is not the same in every mapping: key -> value of each, None where absent."""
    names = sorted({name for one in found for name in one})
    rows = {name: [one.get(name) for one in found] for name in names}
    return {name: row for name, row in rows.items() if any(value != row[0] for value in row)}


class ProvenanceRow(NamedTuple):
    """One fact of every run."""

    name: str
    values: list[str]
    differs: bool


def origin_rows(infos: Sequence[Mapping[str, str]]) -> list[ProvenanceRow]:
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


def parameter_rows(infos: Sequence[Mapping[str, str]]) -> dict[str, list[ProvenanceRow]]:
    """Return every parameter of the runs by role of the node, in the order of their names."""
    noted = [node_parameters(info) for info in infos]
    roles = sorted({role for one in noted for role in one})
    return {
        role: [row for row in _rows([one.get(role, {}) for one in noted]) if _is_shown(role, row)]
        for role in roles
    }


def _is_shown(role, row):
    return role != 'recorder' or row.name not in PER_RUN


def _rows(found: Sequence[Mapping[str, Any]]):
    names = dict.fromkeys(name for one in found for name in one)
    rows = []
    for name in names:
        values = [one.get(name) for one in found]
        differs = any(value != values[0] for value in values)
        rows.append(ProvenanceRow(name, [_value_text(value) for value in values], differs))
    return rows


def _value_text(value):
    if value is None:
        return ABSENT
    return value if isinstance(value, str) else json.dumps(value)
