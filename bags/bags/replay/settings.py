"""Changes of a recorded controller, as `--set` takes them."""

from collections.abc import Sequence
from typing import Any

from bags.errors import BagError
from bags.experiments import experiment

ROLE = 'controller'


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
