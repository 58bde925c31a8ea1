"""Python as it stands in docstrings and notebooks runs, on real recordings and drives."""

import inspect
import json
import re
import shutil
import textwrap
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import pytest

NOTEBOOKS = sorted((Path(__file__).parents[2] / 'docs/notebooks').glob('*.ipynb'))
MODULES = ['bags', 'bags.run', 'bags.run_set', 'experiments', 'experiments.scripting']
INDENTED = re.compile(r'(?:^(?: {4}.*)?\n)+', re.MULTILINE)
ABSOLUTE = re.compile(r'(?<![\w.:/])/(?:home|root|tmp|work|usr|opt)/\S+')
THIS = 'tests/docs/test_python_examples.py'


def cells_of(notebook):
    return json.loads(notebook.read_text())['cells']


@pytest.fixture
def repository(recorded_runs, tmp_path, monkeypatch):
    """Change to a folder in which recordings are where the examples look for them."""
    (tmp_path / 'bags').mkdir()
    (tmp_path / 'bags/runs').symlink_to(recorded_runs.out)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(mpl, 'rcParams', mpl.rcParams.copy())
    return tmp_path


@pytest.mark.slow
@pytest.mark.reads(THIS, *(f'*/{name.replace(".", "/")}*.py' for name in MODULES))
@pytest.mark.parametrize('module', MODULES)
def test_the_example_of_a_docstring_runs(module, repository):
    text = inspect.getdoc(import_module(module)) + '\n'
    blocks = (textwrap.dedent(block) for block in INDENTED.findall(text))
    (code,) = (block for block in blocks if 'import ' in block)
    exec(compile(code, module, 'exec'), {})


@pytest.mark.slow
@pytest.mark.reads(THIS, 'docs/notebooks/*', '*/scripting.py', 'bags/bags/run*.py')
@pytest.mark.parametrize('notebook', NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_runs(notebook, repository, monkeypatch):
    """In a folder like its own, so that its paths lead to the recordings."""
    folder = repository / 'docs/notebooks'
    shutil.copytree(notebook.parent, folder)
    monkeypatch.syspath_prepend(notebook.parent)
    cells = import_module('execute').execute(folder / notebook.name, folder).cells
    assert [cell.source for cell in cells] == [''.join(c['source']) for c in cells_of(notebook)]


@pytest.mark.parametrize('notebook', NOTEBOOKS, ids=lambda file: file.stem)
def test_a_notebook_has_its_output_and_no_path_of_a_machine(notebook):
    """The site shows what is in the file: `make notebooks` puts it there."""
    code = [cell for cell in cells_of(notebook) if cell['cell_type'] == 'code']
    # in one run, from the first cell to the last
    assert [cell['execution_count'] for cell in code] == [*range(1, len(code) + 1)]
    for output in (output for cell in code for output in cell['outputs']):
        assert output['output_type'] in ('stream', 'execute_result', 'display_data')
        assert output.get('name') != 'stderr'
        text = (*output.get('text', ()), *output.get('data', {}).get('text/plain', ()))
        assert not ABSOLUTE.search(''.join(text))
