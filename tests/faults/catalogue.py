"""The faults as data: `faults.yaml`, read strictly."""

from pathlib import Path
from typing import Any, NamedTuple

import yaml
from relay import DEEDS

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
# what a fault does, and what may be said about it
DOES = {
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
    """An entry of the data file cannot be used."""


class Fault(NamedTuple):
    """One fault and what it must lead to."""

    name: str
    expect: str  # of STATES
    within_s: float
    mode: str
    scenario: dict[str, Any]  # the scenario file
    does: str  # of DOES
    to: Any  # whom or how much
    settings: dict[str, Any]


def load(path: Path = FAULTS) -> list[Fault]:
    """Return every fault in the order of the file; raises CatalogueError."""
    document = yaml.safe_load(path.read_text())
    road = yaml.safe_load(ROAD.read_text())
    faults = [_fault(entry, road, document['roads']) for entry in document['faults']]
    names = [fault.name for fault in faults]
    for name in names:
        if names.count(name) > 1:
            raise CatalogueError(f'{name}: there are two of this name')
    return faults


def _fault(entry, road, roads):
    name = entry.get('name')
    unknown = entry.keys() - KEYS
    if unknown:
        raise CatalogueError(f'{name}: unknown: {", ".join(sorted(unknown))}')
    mode, expect = entry.get('mode', MODES[0]), entry['expect']
    if expect not in STATES or mode not in MODES:
        raise CatalogueError(f'{name}: expect is one of {STATES}, mode one of {MODES}')
    given = dict(entry['fault'])
    (does,) = given.keys() & DOES.keys()
    to = given.pop(does)
    if given.keys() - DOES[does]:
        raise CatalogueError(f'{name}: {does} takes {sorted(DOES[does])}, not {sorted(given)}')
    if does == 'relay':
        to = TELEMETRY if to == ['telemetry'] else tuple(to)
        if given.get('do') not in DEEDS:
            raise CatalogueError(f'{name}: do is one of {DEEDS}')
    elif does in ('kill', 'freeze', 'restart') and to not in ROLES:
        raise CatalogueError(f'{name}: {does} takes one of {ROLES}')
    other = roads[entry['road']] if 'road' in entry else {}
    scenario = road | other | entry.get('scenario', {}) | {'name': f'fault_{name}'}
    within_s = float(entry['within_s'])
    return Fault(name, expect, within_s, mode, scenario, does, to, given)
