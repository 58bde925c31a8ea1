"""Run scenarios, replay recordings, tune and study controllers, reproduce the paper."""

import sys
from collections.abc import Sequence

from bags import command_line

COMMANDS = (
    'run',
    'parameters',
    'scenario',
    'batch',
    'table',
    'plot',
    'library',
    'survivable',
    'replay-check',
    'resolve',
    'golden',
    'tune',
    'study',
    'paper',
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr."""
    return command_line.main('experiments', __doc__, COMMANDS, arguments)


if __name__ == '__main__':
    sys.exit(main())
