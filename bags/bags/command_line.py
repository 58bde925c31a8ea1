"""A program of subcommands: one module each, with HELP, add_arguments(parser) and run(args).

main           run a subcommand
add_bag ...    arguments that several subcommands have
table          a table without lines
print_...      a summary as JSON or for a person, lines, paths
"""

import argparse
import gc
import json
import os
import re
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from msgs_yaml.strict_yaml import InputError, closest
from node_runtime import provenance

GARBAGE_THRESHOLD = 50_000  # new objects between two collections
NOTHING_MEANT: Mapping[str, str] = MappingProxyType({})
UNBOUNDED = 1000  # characters of a line
INTERRUPTED = 130  # what shells report for SIGINT
EXIT_CODES = {
    0: 'the command did what was asked',
    1: 'it could not: bad input or a failure, one line on stderr; or the answer is no',
    2: 'wrong options: usage on stderr',
    INTERRUPTED: 'SIGINT (Ctrl-C); what was finished is kept',
    143: 'SIGTERM, likewise',
}


def main(
    program: str,
    description: str,
    commands: Sequence[str],
    arguments: Sequence[str] | None = None,
    meant: Mapping[str, str] = NOTHING_MEANT,
) -> int:
    """Run one subcommand; return its exit code. Errors are one line on stderr.

    The module of a command is <program>.commands.<command>, hyphens are underscores there. `meant`
    has the command to suggest for a word that is none: 'bags compare' for 'plot'.
    """
    # imports and figures create many objects and hardly any cycles: looking for these less often
    # saves a tenth of the time
    gc.set_threshold(GARBAGE_THRESHOLD)
    _print_warnings_once()
    parser = _Parser(prog=program, description=description)
    parser.meant = meant
    # without `dest`: `bags play` takes every attribute of the options as a parameter
    subparsers = parser.add_subparsers(title='commands', required=True, metavar='COMMAND')
    for name in commands:
        module = import_module(f'{program}.commands.{name.replace("-", "_")}')
        example = f'example: {module.EXAMPLE}' if hasattr(module, 'EXAMPLE') else None
        command = subparsers.add_parser(
            name, help=module.HELP, description=module.__doc__, epilog=example
        )
        command.set_defaults(command=module.run)
        module.add_arguments(command)
    parser.commands = subparsers.choices.values()
    args = parser.parse_args(arguments)
    try:
        return args.command(args)
    except ModuleNotFoundError as error:
        missing = str(error.name).partition('.')[0]
        if missing in provenance.PACKAGES:
            raise
        text = f'{program} needs the module {missing} for this: `make studies`, or pip, installs it'
        print(f'error: {text}', file=sys.stderr)
        return 1
    except (InputError, OSError) as error:
        text = str(error)
        if isinstance(error, OSError) and error.strerror and error.filename:
            # the file first, without the errno of the system
            text = f'{error.filename}: {error.strerror}'
        print(f'error: {" ".join(text.split())}', file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print(': '.join(('interrupted', *map(str, interrupt.args))), file=sys.stderr)
        return getattr(interrupt, 'exit_code', INTERRUPTED)


def _print_warnings_once():
    """Print a warning of ours as one line, and only once; others as Python formats them."""
    others = warnings.formatwarning

    def text(message, category, *place):
        is_ours = issubclass(category, UserWarning)
        return f'warning: {message}\n' if is_ours else others(message, category, *place)

    warnings.simplefilter('once', UserWarning)
    warnings.formatwarning = text


def add_bag(parser: Any, **options: Any) -> None:
    """Add the argument of a bag."""
    options = {'metavar': 'BAG', 'help': 'folder of a bag, or its MCAP file'} | options
    parser.add_argument('bag', **options)


def add_summary_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a command that ends with `print_summary`."""
    add_bag(parser)
    parser.add_argument('--json', action='store_true', help='print everything as one JSON object')


def add_out(parser: argparse.ArgumentParser, default: Path | str, content: str) -> None:
    """Add the option --out for the folder that receives `content`.

    A default that is a text describes what the command does without the option.
    """
    path = default if isinstance(default, Path) else None
    text = f'receives {content} (default: {default})'
    parser.add_argument('--out', type=Path, default=path, metavar='DIR', help=text)


def wide_console(width: int = UNBOUNDED) -> Any:
    """Return a console of so many characters in a file or pipe, unless COLUMNS says otherwise."""
    from rich.console import Console

    is_free = not sys.stdout.isatty() and 'COLUMNS' not in os.environ
    return Console(width=width) if is_free else Console()


def print_summary(
    summary: Mapping[str, Any], as_json: bool, show: Callable[[Mapping[str, Any], Any], None]
) -> int:
    """Print a summary as JSON, or by `show(summary, console)`; return exit code 0."""
    if as_json:
        print(json.dumps(summary, indent=2))
    else:
        show(summary, wide_console())
    return 0


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    left: Collection[str] | None = None,
    **column: Any,
) -> Any:
    """Return a table (rich) of texts, which may have markup.

    The columns `left`, by default the first, are aligned to the left, the others to the right;
    `column` are further settings of all of them.
    """
    from rich.markup import escape
    from rich.table import Table

    left = columns[:1] if left is None else left
    result = Table(box=None, padding=(0, 2, 0, 0))
    for name in columns:
        result.add_column(escape(name), justify='left' if name in left else 'right', **column)
    for row in rows:
        result.add_row(*row)
    return result


def print_text(console: Any, text: str, style: str | None = None) -> None:
    """Print a line as it is: without markup, colours of its parts, and line breaks."""
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def print_paths(console: Any, paths: Mapping[str, Path]) -> None:
    """Print where files were written, by what they are."""
    for label, path in paths.items():
        print_text(console, f'{label}: {os.path.relpath(path)}')


def number_text(value: float | None, form: str) -> str:
    """Return a number as text, a dash for none."""
    return '-' if value is None else f'{value:{form}}'


class _Parser(argparse.ArgumentParser):
    """Suggests the closest command, choice or option for a misspelt one."""

    meant = NOTHING_MEANT  # the command to suggest for a word that is none
    commands: Sequence['_Parser'] = ()

    def error(self, message):
        """Print the usage and the message with a suggestion; exit 2."""
        choice = re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", message)
        unknown = re.search(r'unrecognized arguments:.*?(--[^\s=]+)', message)
        if choice and choice[1] in self.meant:
            message += f'; did you mean {self.meant[choice[1]]!r}?'
        elif choice:
            message += closest(choice[1], re.findall(r"[^\s,']+", choice[2]))
        elif unknown:
            texts = (parser.format_help() for parser in (self, *self.commands))
            options = {name for text in texts for name in re.findall(r'--[\w-]+', text)}
            message += closest(unknown[1], options)
        super().error(message)
