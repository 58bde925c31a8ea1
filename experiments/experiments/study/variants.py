"""The controllers that are compared: as configured, tuned, and with single factors switched."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments import simulation
from msgs_yaml import share

SCENARIO = 'double_lane_change'
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
# penalty.py derives it: the step at this share of P_k pushes as hard as the Gaussian where the
# MPCC plans its intrusions
EQUAL_PENALTY = 0.25
FIXED_SPLIT = 0.65  # front; Brown's lineage fixes 0.6 to 0.7
# who plays which part: names in mpcc_controller/config, or YAML files
ROLES: Mapping[str, str] = {name: name for name in CONTROLLERS}


class Variant(NamedTuple):
    """One row of a study."""

    name: str
    controller: str  # a name in mpcc_controller/config, or a YAML file
    settings: tuple[tuple[str, Any], ...] = ()


class Switch(NamedTuple):
    """Two rows that differ in one factor only."""

    factor: str
    before: str
    after: str


def plain(controllers: Iterable[str] = CONTROLLERS) -> list[Variant]:
    """Return controllers as they are configured."""
    return [Variant(name, name) for name in controllers]


def others(roles: Mapping[str, str], files: Iterable[Path] = ()) -> list[Variant]:
    """Return the plain and the tuned controllers that avoid collisions and play no role.

    Tuned ones are the files given, else every *_tuned.yaml in mpcc_controller/config. Raises
    BagError for a file that is not there, and for two of one name.
    """
    tuned = [Path(file) for file in files]
    if not tuned:
        tuned = sorted(share.path('mpcc_controller', 'config').glob('*_tuned.yaml'))
    for file in tuned:
        if not file.is_file():
            raise BagError(f'no tuned controller {file}: there is no such file')
    names = [file.stem if file.stem not in CONTROLLERS else f'{file.stem} tuned' for file in tuned]
    if len(set(names)) < len(names):
        raise BagError(f'two tuned controllers have one name: {", ".join(sorted(names))}')
    playing = {one.controller for one in cast(roles)}
    found = [Variant(f'{name} untuned', name) for name in ('mpcc', 'frenet')]
    found += [Variant(name, str(file.absolute())) for name, file in zip(names, tuned)]
    return [one for one in found if not playing & {one.controller, one.name}]


def cast(roles: Mapping[str, str] = ROLES) -> list[Variant]:
    """Return the controllers of a comparison, named by their roles. Raises BagError."""
    unknown = sorted(set(roles) - set(CONTROLLERS))
    if unknown:
        raise BagError(f'no role {unknown[0]!r}; there are {", ".join(CONTROLLERS)}')
    return [Variant(role, file) for role, file in {**ROLES, **roles}.items()]


BASE = 'cartesian lag gaussian'  # is mpcc
BASELINE = 'frenet'
NO_PRIORITY = 'no priority'  # is mpcc_no_ca


def ablation(roles: Mapping[str, str] = ROLES, scenario: str = SCENARIO) -> list[Variant]:
    """Return the rows of the ablation, the tuned ones apart. Raises BagError."""
    playing = {one.name: one.controller for one in cast(roles)}
    mpcc, frenet = playing['mpcc'], playing['frenet']
    smaller, larger = EQUAL_PENALTY, 1 / EQUAL_PENALTY
    step = {'formulation.priority': 'step'}
    gaussian = {'formulation.priority': 'gaussian'}
    on_path = {'formulation.distance': 'path', 'formulation.lag': False}
    headed, unheaded = {'formulation.heading': True}, {'formulation.heading': False}
    fixed = {f'limits.brake_front_share_{end}': FIXED_SPLIT for end in ('min', 'max')}
    small_mpcc, large_mpcc = (_weighed(mpcc, share, scenario) for share in (smaller, larger))
    return [
        *_on_mpcc(mpcc),
        _row('cartesian lag step/4', mpcc, step | small_mpcc),
        _row('path no-lag step/4', mpcc, on_path | step | small_mpcc),
        _row('cartesian lag gaussian x4', mpcc, large_mpcc),
        _row('cartesian lag gaussian heading', mpcc, headed),
        _row('path no-lag step heading', mpcc, on_path | step | headed),
        _row(NO_PRIORITY, playing['mpcc_no_ca'], {}),
        _row(BASELINE, frenet, {}),
        _row('frenet gaussian', frenet, gaussian),
        _row('frenet step/4', frenet, _weighed(frenet, smaller, scenario)),
        _row('frenet no heading', frenet, unheaded),
        _row('frenet fixed split', frenet, fixed),
    ]


def switched(roles: Mapping[str, str] = ROLES, scenario: str = SCENARIO) -> list[Variant]:
    """Return the rows of the ablation in which something is switched. Raises BagError."""
    played = (BASE, BASELINE, NO_PRIORITY)
    return [one for one in ablation(roles, scenario) if one.name not in played]


def _on_mpcc(controller):
    return [
        _row(
            ' '.join((distance, 'lag' if lag else 'no-lag', priority)),
            controller,
            {
                'formulation.distance': distance,
                'formulation.lag': lag,
                'formulation.priority': priority,
            },
        )
        for distance in ('cartesian', 'path')
        for lag in (True, False)
        for priority in ('gaussian', 'step')
    ]


def _row(name, controller, settings):
    return Variant(name, controller, tuple(settings.items()))


def _weighed(controller, share, scenario):
    """Return the settings that multiply the priorities of a controller."""
    weights = simulation.prepare(scenario, controller).params.priorities
    return {
        'priorities.obstacle': share * weights.obstacle,
        'priorities.edge': share * weights.edge,
    }


# from the MPCC towards the baseline, then from the baseline back
SWITCHES = (
    Switch('frame of the distances', BASE, 'path lag gaussian'),
    Switch('lag error', BASE, 'cartesian no-lag gaussian'),
    Switch('priority, equal P_k', BASE, 'cartesian lag step'),
    Switch('priority, equal penalty', BASE, 'cartesian lag step/4'),
    Switch('size of the priority', BASE, 'cartesian lag gaussian x4'),
    Switch('heading error', BASE, 'cartesian lag gaussian heading'),
    Switch('priority at all', BASE, NO_PRIORITY),
    Switch('priority back, equal P_k', BASELINE, 'frenet gaussian'),
    Switch('size back', BASELINE, 'frenet step/4'),
    Switch('heading error dropped', BASELINE, 'frenet no heading'),
    Switch('states back to the map', BASELINE, 'path no-lag step heading'),
    Switch('brake split fixed', BASELINE, 'frenet fixed split'),
)
