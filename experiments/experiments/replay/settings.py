"""Changes of a recorded controller, as `--set` takes them.

Only the controller is there to be changed, so its parameters may be given with or without
`controller.`; what begins with `weights.` are factors of the terms of the cost.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments.configuration import experiment

ROLE = 'controller'
WEIGHTS = 'weights.'
OTHERS = tuple(role for role in experiment.ROLES if role != ROLE)


class Changes(NamedTuple):
    """What is asked for."""

    parameters: Mapping[str, Any]  # by dotted name
    factors: Mapping[str, float]  # of weights, by the name of their term


def of_controller(texts: Sequence[str]) -> dict[str, Any]:
    """Return {parameter: value} of `parameter=value` texts, `controller.` before it or not.

    Raises BagError for another form, and for another node: a replay has none. Whether there is such
    a parameter is found out with the parameters of the run.
    """
    found = {}
    for text in texts:
        target, equals, written = text.partition('=')
        if target.startswith(WEIGHTS):
            raise BagError(
                f'--set {text}: weights.<term>=<factor> is for one tick (experiments resolve); '
                'here, change controller.tolerances.* or controller.priorities.*'
            )
        if target.partition('.')[0] in OTHERS:
            raise BagError(
                f'--set {text}: only parameters of the controller can be changed in a replay'
            )
        name = target.removeprefix(f'{ROLE}.')
        if not equals or not name:
            raise BagError(f'--set {text}: must be [controller.]parameter=value')
        found[name] = experiment.value(text, written)
    return found


def of_problem(texts: Sequence[str]) -> Changes:
    """Return parameters of the controller, and factors given as `weights.<term>=<factor>`.

    Raises BagError as above, and for a factor that is no number.
    """
    weights = [text for text in texts if text.startswith(WEIGHTS)]
    factors = {}
    for text in weights:
        name, _, written = text.removeprefix(WEIGHTS).partition('=')
        try:
            factors[name] = float(written)
        except ValueError:
            raise BagError(
                f'--set {text}: must be weights.<term>=<factor>; 1 changes nothing, 0 switches '
                'the term off'
            ) from None
    return Changes(of_controller([text for text in texts if text not in weights]), factors)
