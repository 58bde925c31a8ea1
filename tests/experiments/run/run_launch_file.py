"""`ros2 launch FILE name:=value ...` where the command is not installed.

Uses `launch` and `launch_ros` where they are, and their stand-in elsewhere.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import launch_stand_in


def run_installed(file: Path, arguments: dict[str, str]) -> int:
    """Run the file as ros2launch does: included in another description."""
    from launch.actions import IncludeLaunchDescription
    from launch.launch_description_sources import AnyLaunchDescriptionSource

    from launch import LaunchDescription, LaunchService

    source = AnyLaunchDescriptionSource(str(file))
    included = IncludeLaunchDescription(source, launch_arguments=arguments.items())
    service = LaunchService()
    service.include_launch_description(LaunchDescription([included]))
    return service.run()


def main() -> int:
    """Return the exit code of the launch."""
    file, *given = sys.argv[1:]
    arguments = dict(text.split(':=', 1) for text in given)
    is_installed = find_spec('launch_ros') is not None
    run = run_installed if is_installed else launch_stand_in.run
    return run(Path(file), arguments)


if __name__ == '__main__':
    sys.exit(main())
