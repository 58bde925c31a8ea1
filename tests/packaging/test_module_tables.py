"""The docstring of each folder is a table of contents: it names every module in the folder."""

import ast
import re

import pytest
from installation import PACKAGES, ROOT

# commands are listed by --help
FOLDERS = [
    path.parent
    for package in PACKAGES
    for path in sorted((ROOT / package / package).rglob('__init__.py'))
    if path.parent.name != 'commands'
]


@pytest.mark.parametrize('folder', FOLDERS, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_folder_lists_its_modules(folder):
    text = ast.get_docstring(ast.parse((folder / '__init__.py').read_text()))
    modules = {path.stem for path in folder.glob('*.py')} - {'__init__'}
    modules |= {path.parent.name for path in folder.glob('*/__init__.py')}
    assert {name for name in modules if not re.search(rf'\b{name}\b', text)} == set()
