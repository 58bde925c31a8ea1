"""Which commands answer a state: the controller also sends some without one, and says so."""

from collections.abc import Iterable

import numpy as np

from msgs_yaml.types import Why

BLIND = 'state_stale'  # the reason of a command that answers no state


def are(command_ns: np.ndarray, whys: Iterable[Why]) -> np.ndarray:
    """Return, command by command (n,), whether it answers a state; by stamp [ns].

    `whys` are what the controller said; without any, every command counts as an answer.
    """
    blind = [why.stamp_ns for why in whys if why.values.get('reason') == BLIND]
    return ~np.isin(command_ns, blind)
