"""A parameter file is found by its name in a package, or by its path."""

import re

import pytest
from data_package import put

from node_runtime import named_file


def test_a_bare_name_is_a_file_of_config_and_a_name_with_a_separator_a_path(installed, monkeypatch):
    in_config = put(installed / 'venv', 'config')
    monkeypatch.chdir(installed)
    (installed / 'a.yaml').write_text('here')
    (installed / 'sub').mkdir()
    (installed / 'sub/a.yaml').write_text('below')
    assert named_file.config('some_pkg', 'a.yaml') == in_config
    assert named_file.config('some_pkg', './a.yaml').read_text() == 'here'
    assert named_file.config('some_pkg', 'sub/a.yaml').read_text() == 'below'
    assert named_file.config('some_pkg', str(installed / 'a.yaml')).read_text() == 'here'
    monkeypatch.setenv('HOME', str(installed / 'sub'))
    assert named_file.config('some_pkg', '~/a.yaml').read_text() == 'below'


def test_a_file_that_is_not_there_is_named_with_those_that_are_and_the_form_of_a_path(installed):
    put(installed / 'venv', 'config')
    for name in ('b.yaml', ''):
        with pytest.raises(FileNotFoundError, match=rf'config/{name}; it has a.yaml; .*\./{name}'):
            named_file.config('some_pkg', name)
    for name in ('./b.yaml', '~nosuchuser/b.yaml'):
        with pytest.raises(FileNotFoundError, match=f'no file {re.escape(name)}'):
            named_file.config('some_pkg', name)
