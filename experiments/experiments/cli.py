"""Run scenarios, replay recordings, tune and study controllers, reproduce the paper."""

import sys
from collections.abc import Sequence

from bags import command_line

COMMANDS = (
    'run',
    'demo',
    'parameters',
    'scenario',
    'batch',
    'table',
    'plot',
    'library',
    'survivable',
    'identify',
    'validate',
    'replay-check',
    'resolve',
    'golden',
    'compile',
    'tune',
    'study',
    'paper',
)
# words that are no command, and the command that has what they ask for
MEANT = {
    'drive': 'experiments run',
    'simulate': 'experiments run',
    'sweep': 'experiments batch',
    'replay': 'experiments replay-check',
    'compare': 'bags compare',
    'report': 'bags compare',
    'info': 'bags info',
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr."""
    return command_line.main('experiments', __doc__, COMMANDS, arguments, MEANT)


if __name__ == '__main__':
    sys.exit(main())
