"""The whole experiment: scenario, controller, plant and recorder; it ends when the plant does.

ros2 launch mpcc_controller closed_loop.launch.py scenario:=double_lane_change controller:=mpcc
"""

from pathlib import Path

from launch.actions import (
    DeclareLaunchArgument,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
    Shutdown,
)
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from msgs_yaml import share
from scenario_publisher import scenario

END_S = '12'  # after SIGINT: last words take 5 s at most, leaving 4
ARGUMENTS = (
    ('scenario', 'double_lane_change', 'name of a scenario, or the path of a YAML file'),
    ('controller', 'mpcc', 'name of a file in mpcc_controller/config'),
    ('mode', 'lockstep', 'lockstep (simulated time) or realtime (wall clock)'),
    ('out', 'bags/runs', 'folder that receives <scenario>/<controller>'),
)


def nodes(context):
    """Start the four nodes with the scenario's start, friction and finish line."""
    chosen = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    driven = scenario.load(chosen['scenario'])
    mode = {'mode': chosen['mode']}
    out = Path(chosen['out'], driven.name, chosen['controller'])
    out.parent.mkdir(parents=True, exist_ok=True)
    config = share.path('mpcc_controller', f'config/{chosen["controller"]}.yaml')
    start = {
        'start.from': 'parameters',
        'start.x_m': driven.start.X,
        'start.y_m': driven.start.Y,
        'start.yaw_rad': driven.start.psi,
        'start.speed_mps': driven.start.speed,
    }
    stop = {
        'stop.x_m': driven.stop.X,
        'stop.y_m': driven.stop.Y,
        'stop.yaw_rad': driven.stop.psi,
        'stop.armed_after_m': driven.stop.armed_after,
        'stop.time_s': driven.stop.time,
    }
    recorded = {'recorders': 1}  # nobody starts before the recorder listens
    friction = {'friction': driven.friction}
    flat = driven.patches._asdict().items()
    patches = {f'patches.{name}': list(values) for name, values in flat if values}
    plant = Node(
        package='vehicle_plant',
        executable='plant_node',
        parameters=[mode, recorded, friction, patches, start, stop],
        output='screen',
        sigterm_timeout=END_S,
    )
    return [
        Node(
            package='bags',
            executable='recorder_node',
            parameters=[mode, {'out': str(out)}],
            output='screen',
            sigterm_timeout=END_S,
        ),
        Node(
            package='scenario_publisher',
            executable='scenario_node',
            parameters=[mode, recorded, {'scenario': chosen['scenario']}],
            output='screen',
            sigterm_timeout=END_S,
        ),
        Node(
            package='mpcc_controller',
            executable='frenet_node' if chosen['controller'].startswith('frenet') else 'mpcc_node',
            parameters=[str(config), mode, recorded, {'model.friction': driven.friction}],
            output='screen',
            sigterm_timeout=END_S,
        ),
        plant,
        RegisterEventHandler(
            OnProcessExit(target_action=plant, on_exit=[Shutdown(reason='the plant has ended')])
        ),
    ]


def generate_launch_description():
    """Return what `ros2 launch` runs."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=meaning)
                for name, default, meaning in ARGUMENTS
            ),
            # the ring talks to this machine only
            SetEnvironmentVariable('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST'),
            OpaqueFunction(function=nodes),
        ]
    )
