"""Whether runs may be compared: they drove the same scenario with the same plant."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

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


def check(paths: Sequence[Path | str], infos: Sequence[Mapping[str, str]]) -> None:
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
    found = [parameters(info).get('plant', {}) for info in infos]
    differ = differences(found)
    return {name: values for name, values in differ.items() if name not in NOT_PHYSICAL}


def parameters(info: Mapping[str, str]) -> dict[str, dict]:
    """Return the parameters that a run noted, by role; empty when it noted none."""
    return json.loads(info.get('parameters', '{}'))


def differences(found: Sequence[Mapping]) -> dict[str, list]:
    """Return what is not the same in every mapping: key -> value of each, None where absent."""
    names = sorted({name for one in found for name in one})
    rows = {name: [one.get(name) for one in found] for name in names}
    return {name: row for name, row in rows.items() if any(value != row[0] for value in row)}
