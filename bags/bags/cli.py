"""The command `bags`: play, compare, describe and repair recordings."""

import sys
from collections.abc import Sequence

from bags import command_line

COMMANDS = ('play', 'compare', 'overview', 'film', 'distances', 'info', 'timing', 'repair')
# until version 0.1; now commands of `experiments`
MOVED = ('run', 'replay-check', 'resolve', 'golden', 'tune', 'study', 'paper')
# words that are no command, and the command that has what they ask for
MEANT = {
    'plot': 'bags compare',
    'report': 'bags compare',
    'show': 'bags info',
    'load': 'bags info',
    'scenario': 'experiments scenario',
}
USAGE_ERROR = 2  # exit code of argparse


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr."""
    words = sys.argv[1:] if arguments is None else arguments
    if words and words[0] in MOVED:
        print(f'error: bags {words[0]} is now: experiments {words[0]}', file=sys.stderr)
        return USAGE_ERROR
    return command_line.main('bags', __doc__, COMMANDS, words, MEANT)


if __name__ == '__main__':
    sys.exit(main())
