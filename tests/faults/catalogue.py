"""The faults of `faults.yaml`, read strictly."""

from pathlib import Path
from typing import Any, NamedTuple

import yaml
from relay import EFFECTS

HERE = Path(__file__).parent
FAULTS = HERE / 'faults.yaml'
ROAD = HERE / 'fault_road.yaml'
STATES = ('OK', 'degraded', 'braking', 'stopped')
MODES = ('realtime', 'lockstep')
KEYS = {'name', 'expect', 'within_s', 'mode', 'road', 'scenario', 'fault'}
ROLES = ('recorder', 'scenario', 'controller', 'plant')
TELEMETRY = (
    '/vehicle/actuators',
    '/vehicle/imu',
    '/vehicle/wheels',
    '/controller/prediction',
    '/controller/why',
    '/diagnostics',
)
# actions and their settings
ACTIONS = {
    'relay': {'do', 'for_s', 'delay_s', 'shift_s'},
    'kill': set(),
    'freeze': {'for_s'},
    'restart': {'after_s'},
    'clock_s': set(),
    'fail_ticks': set(),
    'disk_bytes': set(),
    'at_s': set(),
}


class CatalogueError(ValueError):
    """An entry of the data file is invalid."""


class Fault(NamedTuple):
    """One fault and the state that it must lead to."""

    name: str
    expect: str  # of STATES
    within_s: float
    mode: str
    scenario: dict[str, Any]  # the scenario file
    action: str  # of ACTIONS
    target: Any  # topics, role or amount
    settings: dict[str, Any]


def load(path: Path = FAULTS) -> list[Fault]:
    """Return every fault in the order of the file; raises CatalogueError."""
    document = yaml.safe_load(path.read_text())
    road = yaml.safe_load(ROAD.read_text())
    faults = [_fault(entry, road, document['roads']) for entry in document['faults']]
    names = [fault.name for fault in faults]
    for name in names:
        if names.count(name) > 1:
            raise CatalogueError(f'{name}: the name is not unique')
    return faults


def _fault(entry, road, roads):
    name = entry.get('name')
    unknown = entry.keys() - KEYS
    if unknown:
        raise CatalogueError(f'{name}: unknown: {", ".join(sorted(unknown))}')
    mode, expect = entry.get('mode', MODES[0]), entry['expect']
    if expect not in STATES or mode not in MODES:
        raise CatalogueError(f'{name}: expect is one of {STATES}, mode one of {MODES}')
    settings = dict(entry['fault'])
    (action,) = settings.keys() & ACTIONS.keys()
    target, allowed = settings.pop(action), ACTIONS[action]
    if settings.keys() - allowed:
        raise CatalogueError(f'{name}: {action} takes {sorted(allowed)}, not {sorted(settings)}')
    if action == 'relay':
        target = TELEMETRY if target == ['telemetry'] else tuple(target)
        if settings.get('do') not in EFFECTS:
            raise CatalogueError(f'{name}: do is one of {EFFECTS}')
    elif action in ('kill', 'freeze', 'restart') and target not in ROLES:
        raise CatalogueError(f'{name}: {action} takes one of {ROLES}')
    other_road = roads[entry['road']] if 'road' in entry else {}
    scenario = road | other_road | entry.get('scenario', {}) | {'name': f'fault_{name}'}
    within_s = float(entry['within_s'])
    return Fault(name, expect, within_s, mode, scenario, action, target, settings)
