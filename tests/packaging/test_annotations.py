"""Packages that tell type checkers to use their annotations (PEP 561) have them."""

import ast
import importlib.util
import re
from pathlib import Path

import pytest
from installation import PACKAGES, ROOT

# package and what of it must be annotated. Not in vehicle_plant and mpcc_controller, whose
# functions of symbols take arrays, CasADi expressions and numbers alike
TYPED = {
    'msgs_yaml': '*.py',
    'node_runtime': '*.py',
    'stage_solver': '*.py',
    'scenario_publisher': '*.py',
    'bags': '*run*.py',
    'experiments': '*.py',
}


def public_functions(body, owner=''):
    """Yield name, function and whether it is a method, of what has no underscore."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
            yield from public_functions(node.body, f'{node.name}.')
        is_public = isinstance(node, ast.FunctionDef) and re.match('[^_]|__init__$', node.name)
        if is_public:
            decorators = {getattr(one, 'id', '') for one in node.decorator_list}
            yield owner + node.name, node, bool(owner) and 'staticmethod' not in decorators


def lacking(function, is_method):
    """Return the names of arguments without annotation, and 'return' without one."""
    given = function.args
    arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs][int(is_method) :]
    found = [argument.arg for argument in arguments if argument.annotation is None]
    return found + ['return'] * (function.returns is None and function.name != '__init__')


@pytest.mark.parametrize('package', TYPED)
def test_every_public_function_is_annotated(package):
    files = [
        file
        for file in (ROOT / package / package).rglob(TYPED[package])
        if not file.name.endswith('_node.py')  # a program, which nobody imports
    ]
    assert files
    found = {
        f'{file.relative_to(ROOT)}: {name}': missing
        for file in files
        for name, function, is_method in public_functions(ast.parse(file.read_text()).body)
        if (missing := lacking(function, is_method))
    }
    assert found == {}


@pytest.mark.parametrize('package', PACKAGES)
def test_the_installed_package_says_whether_it_has_annotations(package):
    installed = Path(importlib.util.find_spec(package).origin).with_name('py.typed')
    assert installed.is_file() == (package in TYPED)


def test_a_missing_annotation_is_found():
    (cls,) = ast.parse('class A:\n  def f(self, x: int, y): pass').body
    ((name, function, is_method),) = public_functions([cls])
    assert (name, lacking(function, is_method)) == ('A.f', ['y', 'return'])
