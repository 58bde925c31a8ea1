"""The Python reference: every module, and docstrings as their authors see them."""

import ast
import subprocess
import sys
import types
from pathlib import Path

import api_pages
import plain_docstrings
import pytest
from installation import PACKAGES

ROOT = Path(__file__).parents[2]
THEORY = (ROOT / 'docs/explanation/theory.md').read_text()
# folders of the controller's equations
EQUATIONS = ('model', 'path', 'problem')


def rest(text):
    return '\n'.join(plain_docstrings.to_rest(text.splitlines()))


def test_every_module_but_those_of_commands_has_a_place():
    described = {m for modules in api_pages.folders(ROOT).values() for m in modules}
    files = {
        '.'.join(path.relative_to(ROOT / package).with_suffix('').parts)
        for package in PACKAGES
        for path in (ROOT / package / package).rglob('*.py')
        if path.name != '__init__.py' and path.parent.name != 'commands'
    }
    assert described == files


def test_every_package_has_pages():
    assert {folder.partition('.')[0] for folder in api_pages.folders(ROOT)} == {*PACKAGES}


def test_markup_characters_mean_themselves():
    assert rest('v_ is |x| of *args') == 'v\\_ is \\|x\\| of \\*args\n'


def test_backticks_are_code_also_beside_letters():
    assert '``a_b``' in rest('the `a_b`s of x')


@pytest.mark.parametrize('text', ['    a: 1\n    b: 2', 'name    meaning\nother   more'])
def test_indented_lines_and_columns_stay_as_they_are(text):
    assert rest(text).startswith('.. code-block:: text\n\n   ')
    assert len(rest(text).rstrip().splitlines()) == 4


def test_a_paragraph_is_one_line():
    assert rest('a\nb\n\nc') == 'a b\n\nc\n'


def test_fields_have_type_range_and_comment(tmp_path, monkeypatch):
    source = (
        'from dataclasses import dataclass\n'
        'from typing import Annotated\n'
        'from node_runtime.parameters import Range\n'
        '@dataclass\n'
        'class Car:\n'
        '    "A car."\n'
        "    mass: Annotated[float, Range(1.0, 9.0, 'kg')] | None  # with driver\n"
        '    # behind the\n'
        '    # front axle\n'
        '    cog: float\n'
        '    _hidden: int = 0\n'
    )
    (tmp_path / 'a_car.py').write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    import a_car

    assert plain_docstrings.class_fields(a_car)['Car'] == [
        ('mass', 'float | None', 'with driver; 1.0 to 9.0 kg'),
        ('cog', 'float', 'behind the front axle'),
    ]


def test_a_module_without_source_has_no_fields():
    assert plain_docstrings.class_fields(types.ModuleType('nothing')) == {}


def functions_of_the_paper():
    """Return the public functions whose docstring cites an equation or section of the paper."""
    found = []
    for folder in EQUATIONS:
        for path in sorted((ROOT / 'mpcc_controller/mpcc_controller' / folder).glob('*.py')):
            module = f'mpcc_controller.{folder}.{path.stem}'
            for node in ast.parse(path.read_text()).body:
                if isinstance(node, ast.FunctionDef) and not node.name.startswith('_'):
                    text = ast.get_docstring(node) or ''
                    if '(paper' in text or "paper's eq" in text:
                        found.append(f'{module}.{node.name}')
    return found


@pytest.mark.parametrize('name', functions_of_the_paper())
def test_the_theory_page_links_every_function_that_cites_the_paper(name):
    assert f'<{name}>' in THEORY


def test_the_functions_of_the_paper_are_found():
    assert len(functions_of_the_paper()) > 10


@pytest.mark.parametrize('number', range(1, 8))
def test_the_theory_page_has_every_equation_of_the_paper(number):
    assert THEORY.count(f'\\tag{{{number}}}') == 1


def test_a_public_function_without_a_docstring_is_an_error(tmp_path):
    """`make lint` sees it: the rules of this repository, on a module of a package."""
    module = tmp_path / 'module.py'
    module.write_text('"""A module."""\n\n\ndef public():\n    return 1\n')
    done = subprocess.run(
        [
            *(sys.executable, '-m', 'ruff', 'check', '--config', ROOT / 'pyproject.toml'),
            *('--output-format', 'concise', module),
        ],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert 'D103' in done.stdout
