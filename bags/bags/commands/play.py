"""Play a bag with the recorded QoS, and /clock. Space pauses, s steps, q quits."""

import argparse
import json
import os

from bags import command_line

HELP = 'play the messages of a bag, with /clock'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags play`; the defaults are those of config/player.yaml."""
    command_line.add_bag(parser)
    number = {'type': float, 'metavar': 'S'}
    parser.add_argument('--rate', type=float, help='s of the bag per second (default: 1)')
    parser.add_argument('--start', dest='start_s', help='s after the first message', **number)
    parser.add_argument('--duration', dest='duration_s', help='s of the bag to play', **number)
    parser.add_argument('--loop', action='store_true', default=None, help='start again at the end')
    parser.add_argument('--topics', nargs='+', metavar='TOPIC', help='only these')
    parser.add_argument(
        '--clock', dest='clock_hz', type=float, metavar='HZ', help='rate of /clock; 0: none'
    )
    parser.add_argument('--paused', action='store_true', default=None, help='start paused')
    parser.add_argument('--step', dest='step_s', help='s of the bag per step', **number)


def run(args: argparse.Namespace) -> int:
    """Replace this process by the player, which then owns the terminal and its signals."""
    from msgs_yaml import share

    words = [*share.node_command('bags', 'player_node'), '--ros-args']
    for name, value in vars(args).items():
        if name != 'command' and value is not None:
            # JSON is YAML: a folder called 1.0 stays a string
            words += ['-p', f'{name}:={json.dumps(value)}']
    os.execv(words[0], words)
