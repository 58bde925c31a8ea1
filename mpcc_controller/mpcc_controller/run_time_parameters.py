"""Parameters that may be changed while the controller drives: weights and limits. No ROS.

They are numbers in the problem, so a change builds and compiles nothing. It takes effect with the
next step. /controller/why reports every parameter that was changed since the start as `set.NAME`,
from the first step with its new value on: a replay takes the values from there.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mpcc_controller import car_file
from mpcc_controller.car_file import EMERGENCY_LIMITS, LEAST_SHARE
from mpcc_controller.in_force import in_force
from mpcc_controller.parameters import CarParams, ControllerParams, Limits
from node_runtime import parameters
from node_runtime.parameters import ParameterError

GROUPS = ('tolerances', 'priorities', 'safety', 'envelope', 'limits')
REPORTED = 'set.'  # before the name, in /controller/why
SOURCE = 'set'  # in errors, in place of the file and line of a value


def names(params: ControllerParams) -> frozenset[str]:
    """Return the dotted names of the parameters that may be changed.

    These are the numbers of GROUPS. One that is left out has no place in the problem and cannot be
    given a value while the controller drives.
    """
    leaves, values = parameters.leaves(ControllerParams), parameters.flatten(params)
    return frozenset(
        name
        for name, leaf in leaves.items()
        if leaf.kind is float and name.partition('.')[0] in GROUPS and values[name] is not None
    )


def change(params: ControllerParams, changes: Mapping[str, Any]) -> ControllerParams:
    """Return parameters with other values, by dotted name.

    Raises ParameterError `set: <name>: <what>` for a name that is not one of `names`, a value out
    of its range or not finite, and a lower end of a range above its upper one.
    """
    allowed = names(params)
    for name in changes:
        if name not in allowed:
            raise ParameterError(
                f'{SOURCE}: {name}: cannot be changed while the controller drives; '
                f'allowed {", ".join(f"{group}.*" for group in GROUPS)} with a value at the start'
            )
    values = {k: v for k, v in parameters.flatten(params).items() if v is not None}
    return parameters.build(ControllerParams, values | dict(changes), SOURCE)


def check_effect(
    after: ControllerParams, changed: Sequence[str], vehicle: CarParams, in_problem: Iterable[str]
) -> None:
    """Raise ParameterError for a changed parameter that would have no effect, or not its own.

    `in_problem` names the tolerances, priorities and shares of the envelope that the problem has.
    """
    car_file.check_limits(after, vehicle, dict.fromkeys(changed, SOURCE))
    asked, driven = parameters.flatten(after), parameters.flatten(in_force(after, vehicle))
    known = set(in_problem)
    for name in changed:
        is_weight = name.partition('.')[0] in ('tolerances', 'priorities', 'envelope')
        if is_weight and name not in known:
            raise ParameterError(
                f'{SOURCE}: {name}: has no effect, the term is not in the problem of this '
                f'controller; allowed {", ".join(sorted(known))}'
            )
        if asked[name] != driven[name]:
            raise ParameterError(
                f'{SOURCE}: {name}: has no effect, other parameters fix it at {driven[name]:g}; '
                'see model.low_speed and formulation.brake_split'
            )


def check_emergency_limits(after: ControllerParams, start: Limits) -> None:
    """Raise ParameterError for a limit with which plans could hardly brake or swerve any more."""
    why = f'{LEAST_SHARE:g} of its value at the start'
    least = {name: (LEAST_SHARE * getattr(start, name), why) for name in EMERGENCY_LIMITS}
    car_file.require(after.limits, least, {f'limits.{name}': SOURCE for name in least})


def reported(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the parameters that a report of /controller/why names as changed, by dotted name."""
    return {
        key.removeprefix(REPORTED): value
        for key, value in values.items()
        if key.startswith(REPORTED) and key.removeprefix(REPORTED).partition('.')[0] in GROUPS
    }
