"""Show a bag, or the running nodes, to Foxglove over a WebSocket on this machine."""

import argparse
import os
import signal
import threading
from importlib.util import find_spec

from bags import command_line
from bags.errors import BagError
from msgs_yaml import share

HELP = 'show a bag or the running nodes to Foxglove (ws://127.0.0.1:8765)'
PORT = 8765
FASTEST = 100.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags view`."""
    source = parser.add_mutually_exclusive_group(required=True)
    command_line.add_bag(source, nargs='?')
    source.add_argument('--live', action='store_true', help='the nodes of this ROS_DOMAIN_ID')
    parser.add_argument(
        '--port', type=_port, default=PORT, metavar='N', help=f'of the server (default: {PORT})'
    )
    parser.add_argument(
        '--rate', type=_rate, default=1.0, metavar='R', help='of a bag: times as fast (default: 1)'
    )
    parser.add_argument('--loop', action='store_true', help='start a bag again at its end')


def _port(text):
    value = int(text)
    if not 0 <= value <= 65535:
        raise argparse.ArgumentTypeError(f'must lie in 0 to 65535, is {text}')
    return value


def _rate(text):
    value = float(text)
    if not 0.0 < value <= FASTEST:
        raise argparse.ArgumentTypeError(f'must be above 0 and at most {FASTEST:g}, is {text}')
    return value


def run(args: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM. Raises BagError."""
    if find_spec('foxglove') is None:
        raise BagError('bags view needs the package foxglove-sdk: pip install foxglove-sdk')
    if args.live:
        command = share.node_command('bags', 'view_node')
        os.execv(command[0], [*command, '--port', str(args.port)])
    # Foxglove's library takes half a second to load
    from bags.storage import read
    from bags.viewers.foxglove_server import connection_hint
    from bags.viewers.playback_server import PlaybackServer

    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    server = PlaybackServer(read.load(args.bag), args.port, args.rate, args.loop)
    print(connection_hint(server.url), flush=True)
    try:
        server.run(stop.is_set)
    finally:
        server.close()
    return 0
