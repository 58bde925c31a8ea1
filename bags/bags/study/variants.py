"""The controllers that are compared: as configured, tuned, and with single factors switched."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from msgs_yaml import share

CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
# penalty.py derives it: the step at this share of P_k pushes as hard as the Gaussian where the
# MPCC plans its intrusions
EQUAL_PENALTY = 0.25
FIXED_SPLIT = 0.65  # front; Brown's lineage fixes 0.6 to 0.7
OBSTACLE, EDGE = 1000.0, 300.0  # P_k of mpcc.yaml and frenet.yaml; a test compares


class Variant(NamedTuple):
    """One row of a study."""

    name: str
    controller: str  # a name in mpcc_controller/config, or a YAML file
    settings: tuple[tuple[str, Any], ...] = ()
    tuned: bool = False


class Switch(NamedTuple):
    """Two rows that differ in one factor only."""

    factor: str
    before: str
    after: str


def plain(controllers: Iterable[str] = CONTROLLERS) -> list[Variant]:
    """Return controllers as they are configured."""
    return [Variant(name, name) for name in controllers]


def tuned(files: Iterable[Path] = ()) -> list[Variant]:
    """Return the tuned controllers: the files given, else those in mpcc_controller/config/tuned.

    Raises BagError for a file that is not there, and for two of one name.
    """
    chosen = [Path(file) for file in files]
    if not chosen:
        chosen = sorted(share.path('mpcc_controller', 'config').glob('tuned/*.yaml'))
    for file in chosen:
        if not file.is_file():
            raise BagError(f'no tuned controller {file}: there is no such file')
    found = [Variant(f'{file.stem} tuned', str(file.absolute()), tuned=True) for file in chosen]
    names = [one.name for one in found]
    if len(set(names)) < len(names):
        raise BagError(f'two tuned controllers have one name: {", ".join(sorted(names))}')
    return found


def _formulated(distance, lag, priority, share=1.0):
    settings = {
        'formulation.distance': distance,
        'formulation.lag': lag,
        'formulation.priority': priority,
        **_weighed(share),
    }
    return tuple(settings.items())


def _weighed(share):
    if share == 1.0:
        return {}
    return {'priorities.obstacle': share * OBSTACLE, 'priorities.edge': share * EDGE}


def _frenet(priority='step', share=1.0):
    return tuple({'formulation.priority': priority, **_weighed(share)}.items())


def _on_mpcc():
    return [
        Variant(
            ' '.join((distance, 'lag' if lag else 'no-lag', priority)),
            'mpcc',
            _formulated(distance, lag, priority),
        )
        for distance in ('cartesian', 'path')
        for lag in (True, False)
        for priority in ('gaussian', 'step')
    ]


BASE = 'cartesian lag gaussian'  # is mpcc
BASELINE = 'frenet'


def ablation() -> list[Variant]:
    """Return the rows of the ablation, the tuned ones apart."""
    low, high = EQUAL_PENALTY, 1 / EQUAL_PENALTY
    fixed = tuple((f'limits.brake_front_share_{end}', FIXED_SPLIT) for end in ('min', 'max'))
    return [
        *_on_mpcc(),
        Variant('cartesian lag step/4', 'mpcc', _formulated('cartesian', True, 'step', low)),
        Variant('path no-lag step/4', 'mpcc', _formulated('path', False, 'step', low)),
        Variant(
            'cartesian lag gaussian x4', 'mpcc', _formulated('cartesian', True, 'gaussian', high)
        ),
        Variant('no priority', 'mpcc_no_ca'),
        Variant(BASELINE, 'frenet'),
        Variant('frenet gaussian', 'frenet', _frenet('gaussian')),
        Variant('frenet step/4', 'frenet', _frenet('step', low)),
        Variant('frenet fixed split', 'frenet', fixed),
    ]


# from the MPCC towards the baseline, then from the baseline back
SWITCHES = (
    Switch('frame of the distances', BASE, 'path lag gaussian'),
    Switch('lag error', BASE, 'cartesian no-lag gaussian'),
    Switch('priority, equal P_k', BASE, 'cartesian lag step'),
    Switch('priority, equal penalty', BASE, 'cartesian lag step/4'),
    Switch('size of the priority', BASE, 'cartesian lag gaussian x4'),
    Switch('priority at all', BASE, 'no priority'),
    Switch('priority back, equal P_k', BASELINE, 'frenet gaussian'),
    Switch('size back', BASELINE, 'frenet step/4'),
    Switch('states back to the map', BASELINE, 'path no-lag step'),
    Switch('brake split fixed', BASELINE, 'frenet fixed split'),
)
