"""One drive through a scenario: scenario, controller, plant and recorder, until the plant ends.

ros2 launch experiments closed_loop.launch.py scenario:=double_lane_change controller:=mpcc

Exit code 0 means that the car crossed the finish line, on the road or beside it, and that the
recorder completed the bag; `bags compare BAG` judges whether the car was on the road. Whatever else
ends the drive gives 1, the only code of `ros2 launch` for errors: another end of the plant, the
death of a node, Ctrl-C, an argument that cannot be used. What was recorded is kept.
"""

import os
from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    LogInfo,
    OpaqueFunction,
    SetEnvironmentVariable,
    Shutdown,
    TimerAction,
)
from launch.logging import launch_config
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from bags.errors import BagError
from experiments.configuration import experiment, inputs
from experiments.run import folders, node_graph, processes
from experiments.run.launch import DEFAULT_ENVIRONMENT, FIXED_ENVIRONMENT, NOTES, note
from launch import LaunchDescription

ARGUMENTS = (
    DeclareLaunchArgument(
        'scenario',
        default_value='double_lane_change',
        description='name of a scenario, or the path of a YAML file',
    ),
    DeclareLaunchArgument(
        'controller',
        default_value='mpcc',
        description='name of a file in mpcc_controller/config, or the path of a YAML file',
    ),
    DeclareLaunchArgument(
        'mode',
        default_value='lockstep',
        choices=['lockstep', 'realtime'],
        description='lockstep: simulated time; realtime: wall clock',
    ),
    DeclareLaunchArgument(
        'out',
        default_value='bags/runs',
        description='folder that receives <scenario>/<controller>, which must not exist yet',
    ),
    DeclareLaunchArgument(
        'markers',
        default_value='false',
        choices=['true', 'false'],
        description='whether markers_node draws the run for RViz and Foxglove',
    ),
)
# in seconds, from SIGINT until launch sends SIGTERM
PATIENCE_S = {'recorder': node_graph.RECORDER_S}


class DriveFailedError(Exception):
    """The drive was not completed, or not recorded completely."""


class Drive:
    """Decides what the end of a node means: launch goes on, shuts down, or fails.

    Launch returns 1 when a handler of an event raises, and shuts down what still runs.
    """

    def __init__(self):
        self.is_finished = self.has_failed = False

    def on_exit(self, role, executable):
        """Return the handler for the exit of a node."""
        return lambda event, context: self._ended(role, executable, event.returncode, context)

    def _ended(self, role, executable, code, context):
        if role == 'plant' and code == node_graph.FINISHED and not context.is_shutdown:
            self.is_finished = True
            # the state at the end is answered, too, and the answer is recorded
            return TimerAction(
                period=node_graph.SETTLE_S, actions=[Shutdown(reason='the plant ended')]
            )
        if code == 0 and context.is_shutdown and (self.is_finished or self.has_failed):
            return None
        interrupted = code == 0 and context.is_shutdown
        self.has_failed = True
        raise DriveFailedError(
            'the drive was interrupted'
            if interrupted
            else f'the drive failed: {executable} ended {processes.how_it_ended(code)}'
        )


def start_nodes(context):
    """Return the actions that start the nodes; raise BagError for arguments that cannot be used."""
    given = {one.name: LaunchConfiguration(one.name).perform(context) for one in ARGUMENTS}
    facts = inputs.scenario_facts(given['scenario'])
    chosen = experiment.controller(given['controller'])
    bag = Path(given['out'], facts.name, chosen.name).absolute()
    if os.path.exists(bag):  # not Path.exists, which raises below a folder that may not be entered
        raise BagError(f'out: {bag} exists already; move it, or name another folder')
    with folders.created(bag.parent, f'out:={given["out"]}'):
        pass  # it can be created, which is what the recorder does
    folder = Path(launch_config.log_dir)
    run_info = folder / NOTES
    ring = experiment.nodes(facts, chosen, given['mode'], bag, run_info, experiment.NO_OVERRIDES)
    read = inputs.check_parameters(ring)
    warnings = inputs.warnings_of(facts, read)
    note(facts, chosen, given['mode'], ring, run_info, inputs.file_values(read))
    if given['markers'] == 'true':
        ring = [experiment.markers(ring), *ring]
    drive = Drive()
    return [
        *(LogInfo(msg=f'warning, {chosen.name}: {text}') for text in warnings),
        *(_start(node, folder, drive) for node in ring),
    ]


def _start(node, folder, drive):
    written = experiment.write_parameters(node, folder)
    return Node(
        package=node.package,
        executable=node.executable,
        parameters=[*map(str, node.files), str(written)],
        output='screen',
        sigterm_timeout=str(PATIENCE_S.get(node.role, processes.INTERRUPT_S)),
        on_exit=drive.on_exit(node.role, node.executable),
    )


def generate_launch_description():
    """Return what `ros2 launch` runs."""
    environment = {**DEFAULT_ENVIRONMENT, **os.environ, **FIXED_ENVIRONMENT}
    names = (*DEFAULT_ENVIRONMENT, *FIXED_ENVIRONMENT)
    return LaunchDescription(
        [
            *ARGUMENTS,
            *(SetEnvironmentVariable(name, environment[name]) for name in names),
            OpaqueFunction(function=start_nodes),
        ]
    )
