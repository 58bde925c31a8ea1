"""The command `bags`: play, view, compare and look after recordings."""

import sys
from collections.abc import Sequence

from bags import command_line

COMMANDS = ('play', 'view', 'compare', 'distances', 'info', 'timing', 'repair')
# until version 0.1; the command `experiments` has them now
MOVED = ('run', 'replay-check', 'resolve', 'golden', 'tune', 'study', 'paper')
USAGE_ERROR = 2  # what argparse ends with


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr."""
    given = sys.argv[1:] if arguments is None else arguments
    if given and given[0] in MOVED:
        print(f'error: bags {given[0]} is now: experiments {given[0]}', file=sys.stderr)
        return USAGE_ERROR
    return command_line.main('bags', __doc__, COMMANDS, given)


if __name__ == '__main__':
    sys.exit(main())
