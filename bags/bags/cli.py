"""The command `bags`: run experiments, compare and look after their recordings."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from bags.errors import BagError
from msgs_yaml.parameters import ParameterError

COMMANDS = (
    'run',
    'play',
    'view',
    'compare',
    'paper',
    'study',
    'tune',
    'distances',
    'info',
    'timing',
    'repair',
    'replay-check',
    'golden',
    'resolve',
)
INTERRUPTED = 130  # what shells report for SIGINT


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr."""
    chosen = _parser().parse_args(arguments)
    try:
        return chosen.command(chosen)
    except (BagError, ParameterError, OSError) as error:
        print(f'error: {" ".join(_message(error).split())}', file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print(': '.join(('interrupted', *map(str, interrupt.args))), file=sys.stderr)
        return getattr(interrupt, 'exit_code', INTERRUPTED)


def _message(error):
    """Return an error in words: the file first, without the number of the system's error."""
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f'{error.filename}: {error.strerror}'
    return str(error)


def _parser():
    parser = argparse.ArgumentParser(prog='bags', description=__doc__)
    commands = parser.add_subparsers(title='commands', required=True, metavar='COMMAND')
    for name in COMMANDS:
        module = import_module(f'bags.commands.{name.replace("-", "_")}')
        command = commands.add_parser(name, help=module.HELP, description=module.__doc__)
        command.set_defaults(command=module.run)
        module.add_arguments(command)
    return parser


if __name__ == '__main__':
    sys.exit(main())
