"""Pages with the help of every command, and the exit codes."""

import contextlib
import io
import os
from collections.abc import Callable, Sequence
from importlib import import_module
from unittest import mock

import bags.cli
import experiments.cli
from bags import command_line
from node_runtime import spin_node
from reference_pages.markdown import table, text
from vehicle_plant import identify, manoeuvre, run_end

WIDTH = '90'


def pages() -> dict[str, str]:
    """Return the pages by name."""
    return {
        'commands_experiments': _program('experiments', experiments.cli),
        'commands_bags': _program('bags', bags.cli),
        'commands_plant': '# Commands of the plant\n\n'
        + ''.join(
            f'## `{name}`\n\n{_block(help_of(module.main, ()))}'
            for name, module in (('identify', identify), ('manoeuvre', manoeuvre))
        ),
        'exit_codes': exit_codes(),
    }


def help_of(main: Callable[[Sequence[str]], int], words: Sequence[str]) -> str:
    """Return what a command prints with --help."""
    printed = io.StringIO()
    with (
        mock.patch.dict(os.environ, COLUMNS=WIDTH),
        contextlib.redirect_stdout(printed),
        contextlib.suppress(SystemExit),
    ):
        main([*words, '--help'])
    return printed.getvalue()


def _program(name, module):
    sections = (
        f'## `{name} {command}`\n\n{_block(help_of(module.main, (command,)))}'
        for command in module.COMMANDS
    )
    return (
        f'# The command `{name}`\n\n{text(module.__doc__)}\n\n{_block(help_of(module.main, ()))}'
        + ''.join(sections)
    )


def _block(content):
    return f'```text\n{content.rstrip()}\n```\n\n'


def exit_codes() -> str:
    """Return the page of the exit codes, from the tables beside the code that ends a program."""
    own = {}
    for program, module in (('experiments', experiments.cli), ('bags', bags.cli)):
        for name in module.COMMANDS:
            command = import_module(f'{program}.commands.{name.replace("-", "_")}')
            if hasattr(command, 'EXIT_CODES'):
                own[f'{program} {name}'] = command.EXIT_CODES
    parts = [
        '# Exit codes',
        '## Commands',
        _codes(command_line.EXIT_CODES),
        'Some commands say more with theirs:',
        table(
            ('command', 'code', 'meaning'),
            [
                (f'`{command}`', code, text(meaning))
                for command, codes in own.items()
                for code, meaning in codes.items()
            ],
        ),
        '## Nodes',
        _codes(spin_node.EXIT_CODES),
        'The plant ends a run, and says how:',
        _codes(run_end.EXIT_CODES),
    ]
    return '\n\n'.join(parts) + '\n'


def _codes(codes):
    return table(
        ('code', 'meaning'), [(str(code), text(meaning)) for code, meaning in codes.items()]
    )
