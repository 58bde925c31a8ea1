"""The arguments of closed_loop.launch.py, for the launch file and for its page.

They are here and not in the launch file, which only an installation of ROS 2 can load.
"""

from collections.abc import Sequence
from typing import NamedTuple

MODES, SWITCH = ('lockstep', 'realtime'), ('true', 'false')
LEVELS = ('debug', 'info', 'warn', 'error', 'fatal')
PARAMS_FILE = (
    'ROS parameter files, with sections for scenario, controller, plant and recorder; several are '
    'separated by blanks, and the last one counts'
)
SET = (
    'parameters as NODE.parameter=value, such as plant.friction=0.6; several are separated by '
    'blanks; they win over params_file'
)
ANY_CAR = 'whether to drive also with a car file of the controller that is not that of the plant'
AUTOSTART = 'false: the nodes wait, unconfigured, for the transitions of their life cycle '
AUTOSTART += '(ros2 lifecycle set)'


class LaunchArgument(NamedTuple):
    """An argument of the launch file."""

    name: str
    default: str
    meaning: str
    choices: Sequence[str] | None = None  # None: any text


ARGUMENTS = tuple(
    LaunchArgument(*given)
    for given in (
        ('scenario', 'double_lane_change', 'name of a scenario, or the path of a YAML file'),
        ('controller', 'mpcc', 'name of a file in mpcc_controller/config, or path of one'),
        ('mode', 'lockstep', 'lockstep: simulated time; realtime: wall clock', MODES),
        ('out', 'bags/runs', 'folder for <scenario>/<controller>, which must not exist yet'),
        ('record', 'true', 'whether recorder_node records the run', SWITCH),
        ('markers', 'false', 'whether markers_node draws the run for RViz and Foxglove', SWITCH),
        ('namespace', '', 'of every node and topic, such as /car1; empty: the root'),
        ('params_file', '', PARAMS_FILE),
        ('set', '', SET),
        ('any_car', 'false', ANY_CAR, SWITCH),
        ('use_sim_time', 'false', 'whether the clocks and logs of the nodes follow /clock', SWITCH),
        ('log_level', 'info', 'least severity that the nodes log', LEVELS),
        ('autostart', 'true', AUTOSTART, SWITCH),
    )
)
