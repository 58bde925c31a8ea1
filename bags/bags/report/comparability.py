"""Whether runs are comparable (same scenario, same plant), what drove, and its provenance.

Provenance: commit, versions, machine, mode, and the parameters that differ. All of it is in the
metadata record `run` of a bag, here `info`.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from bags.errors import BagError
from node_runtime.provenance import CONTROLLER_TEXT

# how the plant is run, and names of its files; all other parameters are physical
NOT_PHYSICAL = (
    'mode',
    'recorders',
    'lockstep_timeout_s',
    'imu_wheels_period_ms',
    'publish_tf',
    'tyre_set',
    'start.from',
)
LISTED = 3  # differences that an error lists before it counts the rest
FORCE = 'their numbers are not comparable; --force compares them anyway'
ABSENT = '–'
HASH_DIGITS = 10  # of commits and files; comparison.json and the bag have all
# paths of the recorder, which differ between any two runs
PER_RUN = ('out', 'run_info')
SCENARIO_TEXT = 'scenario_text'
UNKNOWN = 'the recording holds no description'


def check_comparable(paths: Sequence[Path | str], infos: Sequence[Mapping[str, str]]) -> None:
    """Raise BagError when a run differs from the first in scenario or plant.

    A run without this information counts as different.
    """
    for path, info in zip(paths[1:], infos[1:]):
        both = f'{paths[0]} and {path}'
        if info.get('scenario_sha256') != infos[0].get('scenario_sha256'):
            ours, theirs = (run.get('scenario', '?') for run in (infos[0], info))
            differ = f'{ours!r} and {theirs!r}' if ours != theirs else f'two versions of {ours!r}'
            raise BagError(f'{both} drove different scenarios ({differ}): {FORCE}')
        differing = describe_plants(infos[0], info)
        if differing:
            raise BagError(f'{both} drove different plants ({differing}): {FORCE}')


def describe_plants(info: Mapping[str, str], other: Mapping[str, str]) -> str:
    """Return the first physical parameters of the plant that differ, with both values, or ''."""
    plants = [node_parameters(each).get('plant', {}) for each in (info, other)]
    rows = [row for row in sorted(_rows(plants)) if row.differs and row.name not in NOT_PHYSICAL]
    listed = [f'{row.name} {" and ".join(row.values)}' for row in rows[:LISTED]]
    if len(rows) > LISTED:
        listed.append(f'and {len(rows) - LISTED} more')
    return ', '.join(listed).replace(ABSENT, 'unknown')


def node_parameters(info: Mapping[str, str]) -> dict[str, dict]:
    """Return the recorded parameters of a run by role of the node; {} without any."""
    return json.loads(info.get('parameters', '{}'))


class ProvenanceRow(NamedTuple):
    """One entry with its value in every run."""

    name: str
    values: list[str]
    differs: bool


def origin_rows(infos: Sequence[Mapping[str, str]]) -> list[ProvenanceRow]:
    """Return mode, commit, scenario, versions and machine of the runs."""
    origins = []
    for info in infos:
        facts = {
            'mode': info.get('mode'),
            'commit': _short(info.get('git_commit', '')),
            'scenario': info.get('scenario'),
            'scenario SHA-256': _short(info.get('scenario_sha256', '')),
        }
        for group in ('versions', 'machine'):
            entries = json.loads(info.get(group, '{}'))
            facts |= {name.replace('_', ' '): value for name, value in entries.items()}
        origins.append(facts)
    return _rows(origins)


def _short(digest):
    """Return the first digits of a hash, with the marks behind it; None without one."""
    digits, dash, mark = digest.partition('-')
    return f'{digits[:HASH_DIGITS]}{dash}{mark}' or None


def parameter_rows(infos: Sequence[Mapping[str, str]]) -> dict[str, list[ProvenanceRow]]:
    """Return every parameter of the runs by role of the node, in the order of their names."""
    runs = [node_parameters(info) for info in infos]
    roles = sorted({role for run in runs for role in run})
    rows = {role: _rows([run.get(role, {}) for run in runs]) for role in roles}
    if 'recorder' in rows:
        rows['recorder'] = [row for row in rows['recorder'] if row.name not in PER_RUN]
    return rows


def _rows(runs: Sequence[Mapping[str, Any]]):
    rows = []
    for name in dict.fromkeys(name for run in runs for name in run):
        values = [run.get(name) for run in runs]
        texts = [v if isinstance(v, str) else json.dumps(v) for v in values]
        texts = [ABSENT if v is None else text for v, text in zip(values, texts)]
        rows.append(ProvenanceRow(name, texts, any(value != values[0] for value in values)))
    return rows


def describe_runs(names: Sequence[str], infos: Sequence[Mapping[str, str]]) -> dict[str, Any]:
    """Return what the report says of runs by their names; `infos` are their metadata records `run`.

    They are the texts `scenario` and `scenario_file`, '' where the recording does not hold it, and
    `controllers` by run.
    """
    text = infos[0].get(SCENARIO_TEXT, '')
    controllers = {name: info.get(CONTROLLER_TEXT) or UNKNOWN for name, info in zip(names, infos)}
    try:
        described = yaml.safe_load(text)['description']
    except (yaml.YAMLError, TypeError, KeyError):
        described = None
    return {
        'scenario': str(described or UNKNOWN),
        'scenario_file': text,
        'controllers': controllers,
    }
