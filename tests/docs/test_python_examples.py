"""Python as it stands in pages, docstrings and notebooks runs, on real recordings and drives."""

import inspect
import json
import re
import shutil
import sys
import textwrap
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = ROOT / 'docs/notebooks'
PAGES = ['docs/howto/python.md']
MODULES = [
    'bags',
    'bags.run',
    'bags.run_set',
    'experiments',
    'experiments.scripting',
]
BLOCK = re.compile(r'```python\n(.*?)```\n', re.DOTALL)
INDENTED = re.compile(r'(?:^(?: {4}.*)?\n)+', re.MULTILINE)
ABSOLUTE = re.compile(r'(?<![\w.:/])/(?:home|root|tmp|work|usr|opt)/\S+')


def example(module):
    """Return the indented Python in the docstring of a module."""
    text = inspect.getdoc(import_module(module)) + '\n'
    blocks = (textwrap.dedent(block) for block in INDENTED.findall(text))
    (code,) = (block for block in blocks if 'import ' in block)
    return code


def cells_of(notebook):
    return json.loads(notebook.read_text())['cells']


def source(cell):
    return ''.join(cell['source'])


@pytest.fixture
def repository(recorded_runs, tmp_path, monkeypatch):
    """Change to a folder in which recordings are where the examples look for them."""
    (tmp_path / 'bags').mkdir()
    (tmp_path / 'bags/runs').symlink_to(recorded_runs.out)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(mpl, 'rcParams', mpl.rcParams.copy())
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize('page', PAGES)
def test_the_python_of_a_page_runs(page, repository):
    blocks = BLOCK.findall((ROOT / page).read_text())
    assert blocks
    names = {}
    for block in blocks:
        exec(compile(block, page, 'exec'), names)


@pytest.mark.slow
@pytest.mark.parametrize('module', MODULES)
def test_the_example_of_a_docstring_runs(module, repository):
    exec(compile(example(module), module, 'exec'), {})


@pytest.mark.slow
@pytest.mark.parametrize('notebook', sorted(NOTEBOOKS.glob('*.ipynb')), ids=lambda file: file.stem)
def test_a_notebook_runs(notebook, repository):
    """In a folder like its own, so that its paths lead to the recordings."""
    folder = repository / 'docs/notebooks'
    shutil.copytree(NOTEBOOKS, folder)
    sys.path.insert(0, str(NOTEBOOKS))
    try:
        from execute import execute
    finally:
        sys.path.remove(str(NOTEBOOKS))
    executed = execute(folder / notebook.name, folder)
    assert [cell.source for cell in executed.cells] == [*map(source, cells_of(notebook))]


@pytest.mark.parametrize('notebook', sorted(NOTEBOOKS.glob('*.ipynb')), ids=lambda file: file.stem)
def test_a_notebook_has_its_output_and_no_path_of_a_machine(notebook):
    """The site shows what is in the file: `make notebooks` puts it there."""
    code = [cell for cell in cells_of(notebook) if cell['cell_type'] == 'code']
    # in one run, from the first cell to the last
    assert [cell['execution_count'] for cell in code] == [*range(1, len(code) + 1)]
    outputs = [output for cell in code for output in cell['outputs']]
    assert {output['output_type'] for output in outputs} <= {
        'stream',
        'execute_result',
        'display_data',
    }
    assert all(output.get('name') != 'stderr' for output in outputs)
    text = ''.join(
        line
        for output in outputs
        for line in (*output.get('text', ()), *output.get('data', {}).get('text/plain', ()))
    )
    assert not ABSOLUTE.search(text)
