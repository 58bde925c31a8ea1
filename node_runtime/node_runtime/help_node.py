"""The command line of a node without ROS: what it prints for --help. No ROS runs for it."""

import argparse
import sys

from rclpy.utilities import remove_ros_args

_PARAMETERS = """\
parameters follow `--ros-args`, as `-p NAME:=VALUE` or `--params-file FILE`; their names, ranges,
units and defaults:
  experiments parameters         of all nodes of a run
  ros2 param list                of the nodes that run
  ros2 param describe NODE NAME

example:
  %(prog)s {example}"""


def parser(about: str, example: str) -> argparse.ArgumentParser:
    """Return the parser of a node for what it does, and for an example of its arguments."""
    return argparse.ArgumentParser(
        description=about,
        epilog=_PARAMETERS.format(example=example),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def parse(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Return the arguments of this process; what ROS reads is left out.

    Prints help and exits with 0 for `--help`; exits with 2 and one line for words that nothing
    reads. Call it before the node and its context are created.
    """
    return parser.parse_args(remove_ros_args(sys.argv)[1:])
