"""Parameters of the node."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NodeParams:
    """What scenario_node takes besides `mode`."""

    scenario: str
