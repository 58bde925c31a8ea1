"""Changes of a recorded controller, as `--set` takes them."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bags.errors import BagError
from bags.experiments import experiment

ROLE = 'controller'
WEIGHTS = 'weights.'


class Changes(NamedTuple):
    """What is asked for."""

    parameters: Mapping[str, Any]  # by dotted name
    factors: Mapping[str, float]  # of weights, by the name of their term


def of_controller(texts: Sequence[str]) -> dict[str, Any]:
    """Return {parameter: value} of `controller.parameter=value` texts.

    Raises BagError for another form, and for another node: a replay has none.
    """
    found = experiment.overrides(list(texts))
    others = [role for role in found if role != ROLE]
    if others:
        raise BagError(
            f'--set {others[0]}.…: only parameters of the controller can be changed in a replay'
        )
    return found.get(ROLE, {})


def of_problem(texts: Sequence[str]) -> Changes:
    """Return parameters of the controller, and factors given as `weights.<term>=<factor>`.

    Raises BagError as above, and for a factor that is no number.
    """
    weights = [text for text in texts if text.startswith(WEIGHTS)]
    factors = {}
    for text in weights:
        name, _, value = text.removeprefix(WEIGHTS).partition('=')
        try:
            factors[name] = float(value)
        except ValueError:
            raise BagError(
                f'--set {text}: must be weights.<term>=<factor>; 1 changes nothing, 0 switches '
                'the term off'
            ) from None
    return Changes(of_controller([text for text in texts if text not in weights]), factors)
