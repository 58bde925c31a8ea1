"""Weights of tests whose subject is not what a controller file weighs.

Those of mpcc.yaml and frenet.yaml are what a search has found, and change with it.
"""

from collections.abc import Mapping

TOLERANCES = {
    'tolerances.contouring_m': 0.5,
    'tolerances.lag_m': 0.5,
    'tolerances.heading_rad': 0.175,
    'tolerances.velocity_mps': 3.0,
    'tolerances.steer_rate_radps': 0.349,
    'tolerances.force_rate_nps': 20_000.0,
}
PRIORITIES = {'priorities.obstacle': 1000.0, 'priorities.edge': 300.0}


def fixed_weights(controller: str = 'mpcc') -> Mapping[str, float]:
    """Return weights by dotted name; mpcc_no_ca keeps its priorities of zero."""
    return TOLERANCES if controller == 'mpcc_no_ca' else TOLERANCES | PRIORITIES
