"""What stands on the cores of scenario, controller and plant: drives, and recorded ticks again.

The only package that may import those cores. `ring` closes the ring in process, without ROS:

metrics.of(closed_loop.drive(closed_loop.setup('double_lane_change', 'mpcc', speed_mps=21.0)))

`again` gives a recorded controller's ticks to today's controller, `posed` takes one of its
problems apart. `inputs` checks scenario and parameters.

A module is loaded when a name of it is first used: `inputs` needs no solver, so an error in what a
user gave is found without waiting for one.
"""

from importlib import import_module
from typing import Any

_INPUTS = (
    'check_parameters',
    'file_values',
    'load_scenario',
    'scenario_facts',
    'stop_params',
    'warnings_of',
)
_RING = ('Setup', 'drive', 'run', 'run_info', 'setup')
_MODULE_OF = {**dict.fromkeys(_INPUTS, 'inputs'), **dict.fromkeys(_RING, 'ring')}


def __getattr__(name: str) -> Any:
    """Return a public name from the module that defines it."""
    if name not in _MODULE_OF:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULE_OF[name]}'), name)
