"""Every name that a file takes from a module of ours is defined there.

Branches that rename in one and use in the other merge without a conflict; a linter reads one file.
"""

import ast
import re
from functools import cache

import pytest
from installation import PACKAGES, ROOT

SOURCES = {
    '.'.join(path.relative_to(ROOT / package).with_suffix('').parts): path
    for package in PACKAGES
    for path in sorted((ROOT / package / package).rglob('*.py'))
}
READERS = [
    *SOURCES.values(),
    *sorted(path for folder in ('tests', 'bench') for path in (ROOT / folder).rglob('*.py')),
]


@cache
def parsed(path):
    return ast.parse(path.read_text())


@cache
def defined(module):
    """Return the names that a module binds anywhere, or None where it computes them on demand."""
    path = SOURCES.get(module) or SOURCES[f'{module}.__init__']
    names = {other.removeprefix(f'{module}.').split('.')[0] for other in SOURCES if module in other}
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names.update((alias.asname or alias.name).split('.')[0] for alias in node.names)
    return None if '__getattr__' in names else names


def is_ours(module):
    return module in SOURCES or f'{module}.__init__' in SOURCES


def taken(path):
    """Yield (module of ours, name) of everything that a file takes from one."""
    modules = {}
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and is_ours(node.module):
            for alias in node.names:
                yield node.module, alias.name
                full = f'{node.module}.{alias.name}'
                if is_ours(full):
                    modules[alias.asname or alias.name] = full
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = modules.get(node.value.id)
            if module and not node.attr.startswith('__'):
                yield module, node.attr


@pytest.mark.parametrize('package', [*PACKAGES, 'tests', 'bench'])
def test_every_name_taken_from_a_module_is_defined_there(package):
    readers = [path for path in READERS if path.relative_to(ROOT).parts[0] == package]
    assert readers
    missing = {
        f'{path.relative_to(ROOT)}: {module}.{name}'
        for path in readers
        for module, name in taken(path)
        if defined(module) is not None and name not in defined(module)
    }
    assert missing == set()


# they say nothing about the thing that they name; `told` and `said` hide who tells what to whom
MEANINGLESS = {'found', 'made', 'of', 'one', 'ones', 'said', 'told'}
# a value of `solver.mode` and its parameters
ESTABLISHED = re.compile(r'_?one_?step(_decrease|_residual)?', re.IGNORECASE)


def bound_names(path):
    """Yield (line, name) of what a file defines: modules, classes, functions, variables."""
    yield 0, path.stem
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.alias) and node.asname:
            yield node.lineno, node.asname


def carries_no_meaning(name):
    """Return whether a name is one of the words, or a verb of them with a preposition."""
    words = [word.lower() for word in re.findall(r'[A-Z]?[a-z0-9]+', name)]
    return words[-1:] and (words[0] in MEANINGLESS or words[-1] in MEANINGLESS - {'of'})


@pytest.mark.parametrize('package', PACKAGES)
def test_names_avoid_the_words_that_say_nothing(package):
    paths = [path for path in SOURCES.values() if path.relative_to(ROOT).parts[0] == package]
    assert paths
    meaningless = {
        f'{path.relative_to(ROOT)}:{line}: {name}'
        for path in paths
        for line, name in bound_names(path)
        if carries_no_meaning(name) and not ESTABLISHED.fullmatch(name)
    }
    assert meaningless == set()
