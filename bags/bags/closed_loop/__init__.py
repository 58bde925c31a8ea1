"""What stands on the cores of scenario, controller and plant: drives, and recorded ticks again.

The only package that may import those cores. `ring` closes the ring in process, without ROS:

metrics.of(closed_loop.drive(closed_loop.setup('double_lane_change', 'mpcc', speed_mps=21.0)))

`again` gives a recorded controller's ticks to today's controller, `posed` takes one of its
problems apart.
"""

from bags.closed_loop.ring import (
    NO_SETTINGS,
    Setup,
    check_parameters,
    drive,
    load_scenario,
    run,
    run_info,
    scenario_facts,
    setup,
    stop_params,
)

__all__ = [
    'NO_SETTINGS',
    'Setup',
    'check_parameters',
    'drive',
    'load_scenario',
    'run',
    'run_info',
    'scenario_facts',
    'setup',
    'stop_params',
]
