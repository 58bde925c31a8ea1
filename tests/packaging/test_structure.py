"""What a linter that reads one file does not see: who imports whom, and what names there are."""

import ast
import importlib
import importlib.util
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from installation import PACKAGES, ROOT

# the packages that each package may import, besides itself
CONTRACT = {'msgs_yaml', 'node_runtime'}
ALLOWED = {
    'msgs_yaml': set(),
    'node_runtime': {'msgs_yaml'},
    'stage_solver': set(),
    'scenario_publisher': CONTRACT,
    'state_estimator': CONTRACT,
    'mpcc_controller': CONTRACT | {'stage_solver'},
    'vehicle_plant': CONTRACT | {'stage_solver'},
    'bags': CONTRACT,
    'experiments': {*PACKAGES} - {'experiments'},
}
ROS = re.compile(r'rclpy|launch|rosidl_\w+|\w+_(msgs|interfaces)')
GLUE = re.compile(r'.*_node|ros|encode')  # modules that may import ROS
OF_MODELS = ('stage_solver', 'mpcc_controller', 'vehicle_plant')
# what of a package must be annotated. Not vehicle_plant and mpcc_controller, whose functions of
# symbols take arrays, CasADi expressions and numbers alike
TYPED = {
    'msgs_yaml': '*.py',
    'node_runtime': '*.py',
    'stage_solver': '*.py',
    'scenario_publisher': '*.py',
    'state_estimator': '*.py',
    'bags': '*run*.py',
    'experiments': '*.py',
}
# they say nothing about the thing that they name; `told` and `said` hide who tells what to whom
MEANINGLESS = {'found', 'made', 'of', 'one', 'ones', 'said', 'told'}
# a value of `solver.mode` and its parameters
ESTABLISHED = re.compile(r'_?one_?step(_decrease|_residual)?', re.IGNORECASE)


def dotted(path):
    """Return the name of a module; a folder has its own."""
    parts = path.relative_to(ROOT).with_suffix('').parts[1:]
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


SOURCES = {
    dotted(path): path for name in PACKAGES for path in sorted((ROOT / name / name).rglob('*.py'))
}
TESTS = [path for folder in ('tests', 'bench') for path in sorted((ROOT / folder).rglob('*.py'))]


@cache
def nodes(path):
    return [*ast.walk(ast.parse(path.read_text()))]


@cache
def imported(path):
    """Return every absolute name that a file imports, anywhere in the file."""
    names = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f'{path}:{node.lineno}: imports are absolute'
            names.update(f'{node.module}.{alias.name}' for alias in node.names)
    return names


def tops(path):
    return {name.partition('.')[0] for name in imported(path)}


def imports_of(package):
    return {name: path for name, path in SOURCES.items() if name.partition('.')[0] == package}


@pytest.mark.parametrize('package', PACKAGES)
def test_a_package_imports_what_it_may(package):
    sources = imports_of(package)
    assert len(sources) > 3
    for name, path in sources.items():
        assert tops(path) & {*PACKAGES} - ALLOWED[package] <= {package}, path
        module = name.rpartition('.')[2]
        if not GLUE.fullmatch(module):
            assert not [*filter(ROS.fullmatch, tops(path))], path
        if not module.endswith('_node'):
            assert not [other for other in imported(path) if other.endswith('_node')], path
        if package not in OF_MODELS:
            assert 'casadi' not in tops(path), path
        if '.storage.' in name:  # who stores does not judge
            assert not any(other.startswith('bags.evaluation') for other in imported(path)), path


def test_the_plant_takes_the_compiler_alone_from_the_solver():
    """A plant that shared model or solver with the controller could not validate them."""
    names = {name for path in imports_of('vehicle_plant').values() for name in imported(path)}
    names = {name for name in names if name.startswith('stage_solver')}
    assert names == {'stage_solver.compile_cache'}


def folder_of(module):
    """Return `package.folder`; at the root of a package every module is its own unit."""
    return '.'.join(module.split('.')[:2])


@pytest.mark.parametrize('unit', [str, folder_of], ids=['modules', 'folders'])
def test_no_import_circles(unit):
    graph = {unit(name): set() for name in SOURCES}
    for module, path in SOURCES.items():
        for name in imported(path):
            while name and name not in SOURCES:
                name = name.rpartition('.')[0]
            graph[unit(module)] |= {unit(name)} - {unit(module), ''}
    # raises CycleError, which names the circle
    assert len([*TopologicalSorter(graph).static_order()]) == len(graph) > 100


def bound_names(path):
    """Yield (line, name) of what a file defines: modules, classes, functions, variables."""
    yield 0, path.stem
    for node in nodes(path):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id if isinstance(node, ast.Name) else node.attr
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.alias):
            yield node.lineno, node.asname or node.name.partition('.')[0]


def taken(path):
    """Yield (module of ours, name) of everything that a file takes from one."""
    modules = {}
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.module in SOURCES:
            for alias in node.names:
                yield node.module, alias.name
                if (full := f'{node.module}.{alias.name}') in SOURCES:
                    modules[alias.asname or alias.name] = full
    for node in nodes(path):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = modules.get(node.value.id)
            if module and not node.attr.startswith('__'):
                yield module, node.attr


def test_every_name_taken_from_a_module_is_defined_there():
    """Branches that rename in one file and use in the other merge without a conflict."""
    missing = {
        f'{path.relative_to(ROOT)}: {module}.{name}'
        for path in (*SOURCES.values(), *TESTS)
        for module, name in taken(path)
        if f'{module}.{name}' not in SOURCES and not hasattr(importlib.import_module(module), name)
    }
    assert missing == set()


def carries_no_meaning(name):
    """Return whether a name is one of the words, or a verb of them with a preposition."""
    words = [word.lower() for word in re.findall(r'[A-Z]?[a-z0-9]+', name)]
    return words[-1:] and (words[0] in MEANINGLESS or words[-1] in MEANINGLESS - {'of'})


def test_names_avoid_the_words_that_say_nothing():
    meaningless = {
        f'{path.relative_to(ROOT)}:{line}: {name}'
        for path in SOURCES.values()
        for line, name in bound_names(path)
        if carries_no_meaning(name) and not ESTABLISHED.fullmatch(name)
    }
    assert meaningless == set()


@pytest.mark.parametrize('package', PACKAGES)
def test_the_docstring_of_a_folder_names_its_modules(package):
    for path in imports_of(package).values():
        folder = path.parent
        if path.name == '__init__.py' and folder.name != 'commands':  # --help lists commands
            modules = {file.stem for file in folder.glob('*.py')} - {'__init__'}
            modules |= {file.parent.name for file in folder.glob('*/__init__.py')}
            text = ast.get_docstring(ast.parse(path.read_text()))
            assert not {name for name in modules if not re.search(rf'\b{name}\b', text)}, folder


def unannotated(body, owner=''):
    """Yield public functions with an argument or a result that has no annotation."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
            yield from unannotated(node.body, f'{node.name}.')
        if isinstance(node, ast.FunctionDef) and re.match('[^_]|__init__$', node.name):
            own = node.args
            arguments = [*own.posonlyargs, *own.args, *own.kwonlyargs]
            lacking = [a.arg for a in arguments if a.annotation is None]
            static = any(getattr(name, 'id', '') == 'staticmethod' for name in node.decorator_list)
            lacking = lacking[1:] if owner and not static else lacking
            if lacking or (node.returns is None and node.name != '__init__'):
                yield owner + node.name


@pytest.mark.parametrize('package', PACKAGES)
def test_a_package_with_annotations_says_so(package):
    """As PEP 561 wants it."""
    installed = Path(importlib.util.find_spec(package).origin).with_name('py.typed')
    assert installed.is_file() == (package in TYPED)
    files = [*(ROOT / package / package).rglob(TYPED.get(package, '-'))]
    assert bool(files) == (package in TYPED)
    for file in files:
        if not file.name.endswith('_node.py'):  # those may import ROS (GLUE)
            assert [*unannotated(ast.parse(file.read_text()).body)] == [], file
