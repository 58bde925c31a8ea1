"""A program of subcommands: one module each, with HELP, add_arguments(parser) and run(args)."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from bags.errors import BagError
from node_runtime.parameters import ParameterError

INTERRUPTED = 130  # what shells report for SIGINT


def main(
    program: str, description: str, commands: Sequence[str], arguments: Sequence[str] | None = None
) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr.

    The module of a command is <program>.commands.<command>, hyphens are underscores there.
    """
    args = _parser(program, description, commands).parse_args(arguments)
    try:
        return args.command(args)
    except (BagError, ParameterError, OSError) as error:
        print(f'error: {" ".join(_message(error).split())}', file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print(': '.join(('interrupted', *map(str, interrupt.args))), file=sys.stderr)
        return getattr(interrupt, 'exit_code', INTERRUPTED)


def _message(error):
    """Return the text of an error: the file first, without the errno of the system."""
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f'{error.filename}: {error.strerror}'
    return str(error)


def _parser(program, description, commands):
    parser = argparse.ArgumentParser(prog=program, description=description)
    subparsers = parser.add_subparsers(title='commands', required=True, metavar='COMMAND')
    for name in commands:
        module = import_module(f'{program}.commands.{name.replace("-", "_")}')
        example = f'example: {module.EXAMPLE}' if hasattr(module, 'EXAMPLE') else None
        command = subparsers.add_parser(
            name, help=module.HELP, description=module.__doc__, epilog=example
        )
        command.set_defaults(command=module.run)
        module.add_arguments(command)
    return parser
