"""One drive of a study: what is driven, and the key under which its result is kept."""

import dataclasses
import hashlib
import json
from functools import cache
from typing import Any, NamedTuple

from experiments import simulation
from experiments.configuration import inputs
from experiments.configuration.inputs import KPH
from experiments.study import code_version
from experiments.study.samples import Draw
from experiments.study.variants import Variant


class Case(NamedTuple):
    """A controller with its settings in one situation."""

    scenario: str  # a name, or the path of a file
    controller: str
    settings: tuple[tuple[str, Any], ...]  # parameters of the controller by dotted name
    speed_kph: float  # constant desired speed, also that of the start
    grip: float  # plant friction over that of the scenario
    tolerance: float  # of the solver


def of(variant: Variant, speed_kph: float, draw: Draw, scenario: str, **settings) -> Case:
    """Return the drive of a variant at a nominal speed, changed by a draw.

    `settings` are further parameters by dotted name, the dots written as two underscores.
    """
    more = tuple((name.replace('__', '.'), value) for name, value in settings.items())
    return Case(
        scenario,
        variant.controller,
        variant.settings + more,
        speed_kph + draw.speed_kph,
        draw.grip,
        draw.tolerance,
    )


def prepared(case: Case) -> simulation.Setup:
    """Return the drive ready to be made. Raises BagError for what cannot be used."""
    base = _base(case.scenario, case.controller, case.settings)
    solver = dataclasses.replace(base.params.solver, tolerance=case.tolerance)
    return base._replace(
        scn=_at_speed(case.scenario, case.speed_kph),
        params=dataclasses.replace(base.params, solver=solver),
        friction=base.friction * case.grip,
    )


def key(case: Case) -> str:
    """Return the SHA-256 of all that decides the result: setup, code, libraries, processor."""
    base = _base(case.scenario, case.controller, case.settings)
    decides = (base.params, base.vehicle, base.plant, base.friction)
    drawn = (case.speed_kph, case.grip, case.tolerance)
    content = [code_version.digest(), base.controller, base.scn.text, repr(decides), *drawn]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


@cache
def _base(scenario, controller, settings):
    return simulation.prepare(scenario, controller, {'controller': dict(settings)})


@cache
def _at_speed(scenario, speed_kph):
    return inputs.load_scenario(scenario, speed_kph / KPH)
