"""The controllers of a study: as configured, tuned, and with single factors switched."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments import simulation
from msgs_yaml import share
from msgs_yaml.strict_yaml import closest

SCENARIO = 'double_lane_change'
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
# derived in undisturbed_run: the step at this share of P_k pushes as hard as the Gaussian where the
# MPCC plans its intrusions
EQUAL_PENALTY = 0.25
FIXED_SPLIT = 0.65  # front; Brown's lineage fixes 0.6 to 0.7
# controller of each role: a name in mpcc_controller/config, or a YAML file
ROLES: Mapping[str, str] = {name: name for name in CONTROLLERS}
# rows of the ablation that are a role without a switch
BASE = 'cartesian lag gaussian'  # is mpcc
BASELINE = 'frenet'
NO_PRIORITY = 'no priority'  # is mpcc_no_ca


class Variant(NamedTuple):
    """One row of a study: a controller with settings."""

    name: str
    controller: str  # a name in mpcc_controller/config, or a YAML file
    settings: tuple[tuple[str, Any], ...] = ()


class Switch(NamedTuple):
    """Two rows of the ablation that differ in one factor only."""

    factor: str
    before: str
    after: str


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


def plain_variants(controllers: Iterable[str | Variant] = CONTROLLERS) -> list[Variant]:
    """Return controllers as they are configured; a Variant is returned as it is."""
    return [c if isinstance(c, Variant) else Variant(c, c) for c in controllers]


def role_variants(roles: Mapping[str, str] = ROLES) -> list[Variant]:
    """Return the compared controllers, named by their roles. Raises BagError."""
    unknown = sorted(set(roles) - set(CONTROLLERS))
    if unknown:
        hint = closest(unknown[0], CONTROLLERS)
        raise BagError(f'no role {unknown[0]!r}; there are {", ".join(CONTROLLERS)}{hint}')
    return [Variant(role, file) for role, file in {**ROLES, **roles}.items()]


def further_variants(roles: Mapping[str, str], files: Iterable[Path] = ()) -> list[Variant]:
    """Return the plain and the tuned controllers with collision avoidance that have no role.

    Tuned controllers are the files given, else every *_tuned.yaml in mpcc_controller/config. Raises
    BagError for a missing file, and for two of one name.
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
    compared = {variant.controller for variant in role_variants(roles)}
    further = [Variant(f'{name} untuned', name) for name in ('mpcc', 'frenet')]
    further += [Variant(name, str(file.absolute())) for name, file in zip(names, tuned)]
    return [variant for variant in further if not compared & {variant.controller, variant.name}]


def ablation_variants(roles: Mapping[str, str] = ROLES) -> list[Variant]:
    """Return the rows of the ablation without the tuned controllers. Raises BagError."""
    controllers = {variant.name: variant.controller for variant in role_variants(roles)}
    mpcc, frenet = controllers['mpcc'], controllers['frenet']
    step = {'formulation.priority': 'step'}
    gaussian = {'formulation.priority': 'gaussian'}
    on_path = {'formulation.distance': 'path', 'formulation.lag': False}
    heading, no_heading = {'formulation.heading': True}, {'formulation.heading': False}
    fixed_split = {f'limits.brake_front_share_{end}': FIXED_SPLIT for end in ('min', 'max')}
    smaller, larger = (
        _scale_priorities(mpcc, factor) for factor in (EQUAL_PENALTY, 1 / EQUAL_PENALTY)
    )
    return [
        *_factorial_variants(mpcc),
        _variant('cartesian lag step/4', mpcc, step | smaller),
        _variant('path no-lag step/4', mpcc, on_path | step | smaller),
        _variant('cartesian lag gaussian x4', mpcc, larger),
        _variant('cartesian lag gaussian heading', mpcc, heading),
        _variant('path no-lag step heading', mpcc, on_path | step | heading),
        _variant(NO_PRIORITY, controllers['mpcc_no_ca'], {}),
        _variant(BASELINE, frenet, {}),
        _variant('frenet gaussian', frenet, gaussian),
        _variant('frenet step/4', frenet, _scale_priorities(frenet, EQUAL_PENALTY)),
        _variant('frenet no heading', frenet, no_heading),
        _variant('frenet fixed split', frenet, fixed_split),
    ]


def switched_variants(roles: Mapping[str, str] = ROLES) -> list[Variant]:
    """Return the rows of the ablation in which a factor is switched. Raises BagError."""
    plain = (BASE, BASELINE, NO_PRIORITY)
    return [variant for variant in ablation_variants(roles) if variant.name not in plain]


def _factorial_variants(controller):
    """Return the full factorial design of frame, lag error and priority."""
    return [
        _variant(
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


def _variant(name, controller, settings):
    return Variant(name, controller, tuple(settings.items()))


def _scale_priorities(controller, factor):
    """Return the settings that multiply the priorities of a controller."""
    priorities = simulation.prepare(SCENARIO, controller).params.priorities
    return {
        'priorities.obstacle': factor * priorities.obstacle,
        'priorities.edge': factor * priorities.edge,
    }
