"""Print every name that a user may rely on, one per line, sorted, its kind first.

    .venv/bin/python .ci/inventory.py [FOLDER] > after.txt

FOLDER is a clone, by default this one: run it on two commits and compare the outputs to see what a
large change kept, renamed and took away. The names come from where users see them: parsers of
commands, reference pages, tracked files, reference drives. It needs what `make studies` installs.
Exit code 1 if a kind has no name or cannot be read; the others are printed all the same.
"""

import argparse
import contextlib
import inspect
import io
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from fnmatch import filter as matching
from importlib import import_module
from pathlib import Path
from unittest import mock

ROOT = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[1]).resolve()
TRACKED = ('git', '-C', str(ROOT), 'ls-files', '--', '.', ':!tests', ':!bench')
FILES = subprocess.check_output(TRACKED, text=True).splitlines()
PACKAGES = sorted(name.split('/')[0] for name in matching(FILES, '*/package.xml'))
sys.path[:0] = [str(ROOT / name) for name in (*PACKAGES, 'docs/_extensions')]
DRIVES = matching(FILES, '*/reference/double_lane_change/*/metadata.yaml')
DRIVES = [str((ROOT / name).parent) for name in DRIVES]
CELL = r'^\| `([^`]+)` \|'  # the first of a row
IMPORT = re.compile(r'^ *from ([\w.]+) import (?:\(([^)]*)\)|(.*))|^ *import ([\w.]+)', re.M)


def in_files(files: str, pattern: str) -> list:
    """Return what a pattern finds in tracked files."""
    texts = ((ROOT / name).read_text() for name in matching(FILES, files))
    return [found for text in texts for found in re.findall(pattern, text, re.M)]


# module and function by name
PROGRAMS = dict(in_files('*/setup.cfg', r'^ +(\w+) = ([\w.]+:\w+)$'))


def printed_by(program: str, *words: str) -> str:
    """Return what a program prints; it runs in this process."""
    module, _, function = PROGRAMS[program].partition(':')
    main = getattr(import_module(module), function)
    with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.suppress(SystemExit):
        main(list(words))
    return printed.getvalue()


def walk(parser: argparse.ArgumentParser, words: str) -> Iterator[str]:
    """Yield a command, its arguments, options and choices, and the commands below it."""
    yield words
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, child in action.choices.items():
                yield from walk(child, f'{words} {name}')
        elif not isinstance(action, argparse._HelpAction):
            for name in action.option_strings or [action.metavar or action.dest]:
                yield f'{words} {name}'
                yield from (f'{words} {name} {choice}' for choice in action.choices or ())


def commands() -> Iterator[str]:
    """Yield the commands of every program that is no node, from the parser that it makes."""
    for name in PROGRAMS:
        parsers = []
        if not name.endswith('_node'):
            with mock.patch.object(argparse.ArgumentParser, 'parse_args', autospec=True) as parse:
                parse.side_effect = lambda parser, *_, to=parsers: (to.append(parser), sys.exit())
                printed_by(name)
            yield from walk(parsers[0], name)


def reference(kind: str, names: str = CELL) -> Iterator[str]:
    """Yield names in the reference pages of a kind, after the rest of the name of their page."""
    for page, text in import_module('reference_pages').pages().items():
        if page.startswith(kind):
            own = page.removeprefix(kind)
            found = re.finditer(names, text, re.M)
            yield from (' '.join((own, *match.groups())).strip() for match in found)


def columns() -> Iterator[str]:
    """Yield the columns of the tables of the reference drives, after their topic."""
    for run in map(import_module('bags').load, DRIVES):
        yield from (f'{topic} {column}' for topic in run.topics for column in run.frame(topic))


def figures() -> Iterator[str]:
    """Yield the files that a comparison of the reference drives writes."""
    with tempfile.TemporaryDirectory() as out:
        printed_by('bags', 'compare', '--figures', *DRIVES, '--out', out)
        yield from (str(p.relative_to(out)) for p in Path(out).rglob('*') if p.is_file())


def python() -> Iterator[str]:
    """Yield what packages export, with its arguments and members, and what pages import."""
    for package in map(import_module, PACKAGES):
        for name in getattr(package, '__all__', ()):
            full, value = f'{package.__name__}.{name}', getattr(package, name)
            found = set()
            with contextlib.suppress(TypeError, ValueError):  # it takes no arguments
                found.update(inspect.signature(value).parameters)
            for base in getattr(value, '__mro__', ()):
                if base.__module__.split('.')[0] in PACKAGES:
                    found.update(vars(base), vars(base).get('__annotations__', ()))
            yield full
            yield from (f'{full} {key}' for key in found if key[0] != '_')
    for block in in_files('*.md', r'```python\n((?:.*\n)*?)```'):
        for module, *names, alone in IMPORT.findall(block):
            if (module or alone).split('.')[0] in PACKAGES:
                words = re.findall(r'(\w+)(?: as \w+)?', ' '.join(names).partition('#')[0])
                yield from (f'{module}.{word}' for word in words) if module else [alone]


KINDS: dict[str, Callable[[], Iterable[str]]] = {
    'command': commands,
    'node': lambda: matching(PROGRAMS, '*_node'),
    'parameter': lambda: reference('parameters_'),
    'config': lambda: (Path(name).name for name in matching(FILES, '*/config/*.yaml')),
    'controller': lambda: reference('controller_files', r'^## `(\w+)\.yaml`'),
    'scenario': lambda: (Path(name).stem for name in matching(FILES, '*/scenarios/*.yaml')),
    'key': lambda: reference('scenario_keys'),  # of a scenario file
    'family': lambda: re.findall(
        r'^(\w+)', printed_by('experiments', 'library', '--list').partition('\nentry ')[0], re.M
    )[1:],
    'topic': lambda: reference('topics', r'^##+ `(/\S+)`\n\n.*\n\n`(\S+)`;'),
    'column': columns,
    'metric': lambda: reference('metrics'),
    'figure': figures,
    'launch': lambda: reference('launch_arguments'),
    'make': lambda: in_files('Makefile', r'^(\w+):(?!=)'),
    'python': python,
}


def main() -> int:
    """Print the names of every kind; return the exit code."""
    code = 0
    for kind, names in KINDS.items():
        try:
            found = sorted({f'{kind} {name}' for name in names()})
            print(*found, sep='\n')
            assert found, 'there is none'
        except Exception as error:
            print(f'no {kind}: {type(error).__name__}: {error}', file=sys.stderr)
            code = 1
    return code


if __name__ == '__main__':
    sys.exit(main())
