"""Data files are found from the source tree, from a workspace and from a virtual environment."""

import pytest
from package_config import write_config

from msgs_yaml import share


def test_the_source_tree_comes_first(installed):
    tree = installed / 'site-packages'
    (tree / 'package.xml').touch()
    (tree / 'config').mkdir()
    (tree / 'config/a.yaml').touch()
    write_config(installed / 'venv', 'installed')
    assert share.path('some_pkg', 'config', 'a.yaml') == (tree / 'config/a.yaml').resolve()


def test_a_workspace_hides_the_virtual_environment(installed, monkeypatch):
    in_venv = write_config(installed / 'venv', 'venv')
    assert share.path('some_pkg', 'config/a.yaml') == in_venv
    second = write_config(installed / 'second', 'second')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{installed / "first"}:{installed / "second"}')
    assert share.path('some_pkg', 'config/a.yaml') == second


def test_a_missing_file_names_every_place_tried(installed, monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(installed / 'workspace'))
    with pytest.raises(FileNotFoundError) as caught:
        share.path('some_pkg', 'config', 'b.yaml')
    assert 'config/b.yaml of package some_pkg' in str(caught.value)
    for prefix in ('workspace', 'venv'):
        assert str(installed / prefix / 'share/some_pkg/config/b.yaml') in str(caught.value)


def test_a_package_that_is_only_data_is_found_too(installed):
    file = installed / 'venv/share/no_module/a.yaml'
    file.parent.mkdir(parents=True)
    file.touch()
    assert share.path('no_module', 'a.yaml') == file
