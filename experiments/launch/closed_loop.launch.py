"""One run of the node graph: scenario, controller, plant and recorder, until the plant ends.

ros2 launch experiments closed_loop.launch.py scenario:=double_lane_change controller:=mpcc
ros2 launch experiments closed_loop.launch.py --show-args

Exit code 0 means that the car crossed the finish line, on the road or beside it, and that the
recorder completed the bag; `bags compare BAG` checks whether the car was on the road. Any other end
gives 1, the only code of `ros2 launch` for errors: another end of the plant, the failure of a node,
Ctrl-C, an argument that cannot be used. The recording is kept.
"""

import os
import shlex
from functools import partial
from pathlib import Path

from launch.logging import launch_config
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from bags.errors import BagError
from experiments.configuration import inputs, node_config, run_advice, set_option
from experiments.run import domain, launch_arguments, node_graph, processes, staging
from experiments.run.launch_arguments import ARGUMENTS
from launch import LaunchDescription, actions

DECLARED = [
    actions.DeclareLaunchArgument(
        argument.name,
        default_value=argument.default,
        description=argument.meaning,
        choices=argument.choices and list(argument.choices),
    )
    for argument in ARGUMENTS
]
# seconds from SIGINT until launch sends SIGTERM
SHUTDOWN_S = {'recorder': node_graph.RECORDER_S}


class RunFailedError(Exception):
    """The run was not completed, or not recorded completely."""


class RunMonitor:
    """Decides at the end of a node whether launch goes on, shuts down, or fails.

    Launch returns 1 when an event handler raises, and shuts down the remaining nodes.
    """

    def __init__(self):
        self.is_finished = self.has_failed = False

    def on_exit(self, role, executable, event, context):
        """Return what to do at the exit of a node."""
        code = event.returncode
        if role == 'plant' and code == node_graph.FINISHED and not context.is_shutdown:
            self.is_finished = True
            return actions.Shutdown(reason='the plant ended')
        was_asked = code == 0 and context.is_shutdown
        if was_asked and (self.is_finished or self.has_failed):
            return None
        self.has_failed = True
        if was_asked:
            raise RunFailedError('the drive was interrupted')
        end = processes.describe_exit(code)
        raise RunFailedError(f'the drive failed: {executable} ended {end}')


def start_nodes(context):
    """Return the actions that start the nodes; BagError or OSError for arguments of no use."""
    given = {
        argument.name: LaunchConfiguration(argument.name).perform(context) for argument in ARGUMENTS
    }
    scn = inputs.load_scenario(given['scenario'])
    controller = node_config.find_controller(given['controller'])
    record, mode = given['record'] == 'true', given['mode']
    if mode == 'realtime' and given['use_sim_time'] == 'true':
        raise BagError('use_sim_time:=true: nobody publishes /clock with mode:=realtime; leave it')
    folder = Path(launch_config.log_dir)
    bag = _new_bag(given['out'], scn, controller) if record else folder / node_config.BAG_FOLDER
    run_info = folder / node_config.RUN_INFO_FILE
    overrides, origins = _overrides(given)
    nodes = inputs.build_nodes(scn, given['scenario'], controller, overrides, origins, mode, record)
    nodes = inputs.record_to(nodes, bag, run_info)
    checked = inputs.check_parameters(nodes)
    if given['any_car'] == 'false':
        inputs.check_car_fits(
            nodes, checked, 'set:=controller.car_file=./my_car.yaml', 'any_car:=true'
        )
    inputs.check_problem(checked, controller.name)
    loaded = inputs.loaded_facts(checked)
    node_config.write_run_info(scn, controller, mode, nodes, run_info, loaded)
    if given['markers'] == 'true':
        nodes = [node_config.build_markers_node(nodes), *nodes]
    monitor, warnings = RunMonitor(), run_advice.find_warnings(scn, given['scenario'], checked)
    others = domain.describe_others({'ROS_DOMAIN_ID': '0', **os.environ})
    return [
        *([actions.LogInfo(msg=f'warning: {others}')] if others else ()),
        *(actions.LogInfo(msg=f'warning, {controller.name}: {text}') for text in warnings),
        *(_start(node, folder, monitor, given) for node in nodes),
    ]


def _new_bag(out, scn, controller):
    """Return the folder for the bag, absolute; raise BagError where it cannot be created."""
    bag = Path(out, scn.name, controller.name).absolute()
    if os.path.exists(bag):  # Path.exists raises below a folder without permission to enter
        raise BagError(f'out: {bag} exists already; move it, or name another folder')
    with staging.created_folder(bag.parent, f'out:={out}'):
        pass  # a check: the recorder creates it
    return bag


def _overrides(given):
    """Return the parameters of `params_file` and `set` by role, and their sources."""
    paths = shlex.split(given['params_file'])
    values, sources = launch_arguments.read_files(paths, given['namespace'])
    settings = set_option.parse_overrides(shlex.split(given['set']), 'set:=')
    for role, own in settings.items():
        values[role] = values.get(role, {}) | own
        sources[role] = sources.get(role, {}) | {name: f'set:={role}.{name}' for name in own}
    return values, sources


def _start(node, folder, monitor, given):
    parameter_file = node_config.write_parameter_file(node, folder)
    arguments = ['--log-level', given['log_level']]
    arguments += [part for rule in node.remappings for part in ('-r', rule)]
    if given['use_sim_time'] == 'true':
        # rclpy listens to the clock of the root, whatever the namespace is
        arguments += ['-p', 'use_sim_time:=true', '-r', '/clock:=clock']
    if given['autostart'] == 'false' and node.role in node_config.ROLES:
        arguments += ['-p', 'autostart:=false']
    return Node(
        package=node.package,
        executable=node.executable,
        namespace=given['namespace'] or None,
        parameters=[*map(str, node.files), str(parameter_file)],
        ros_arguments=arguments,
        output='screen',
        # launch ends by SIGTERM or a kill without a word to its nodes, which would drive on
        prefix='setpriv --pdeathsig INT',
        sigterm_timeout=str(SHUTDOWN_S.get(node.role, processes.INTERRUPT_S)),
        on_exit=partial(monitor.on_exit, node.role, node.executable),
    )


def generate_launch_description():
    """Return what `ros2 launch` runs."""
    defaults, fixed = processes.DEFAULT_ENVIRONMENT, processes.FIXED_ENVIRONMENT
    environment = {**defaults, **os.environ, **fixed}
    return LaunchDescription(
        [
            *DECLARED,
            *(
                actions.SetEnvironmentVariable(name, environment[name])
                for name in (*defaults, *fixed)
            ),
            actions.OpaqueFunction(function=start_nodes),
        ]
    )
