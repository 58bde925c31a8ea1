"""The command `bags`: play, compare, describe and repair recordings."""

import sys
from collections.abc import Sequence

from bags import command_line

COMMANDS = ('play', 'compare', 'film', 'distances', 'info', 'timing', 'repair')
# words that are no command, and the command that has what they ask for
MEANT = {
    'run': 'experiments run',
    'plot': 'bags compare',
    'report': 'bags compare',
    'show': 'bags info',
    'load': 'bags info',
    'scenario': 'experiments scenario',
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr."""
    words = sys.argv[1:] if arguments is None else arguments
    return command_line.main('bags', __doc__, COMMANDS, words, MEANT)


if __name__ == '__main__':
    sys.exit(main())
