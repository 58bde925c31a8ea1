"""package.xml and setup.cfg name everything that a package and its launch files import."""

import ast
import re
import sys
import xml.etree.ElementTree as ElementTree

import pytest
from installation import PACKAGES, ROOT
from setuptools.config.setupcfg import read_configuration

# rosdep keys of modules that do not come with a ROS package; None: there is no key, pip installs it
ROSDEP_KEYS = {
    'bokeh': 'python3-bokeh-pip',
    'casadi': 'casadi-pip',
    'cmaes': None,
    'distributed': None,
    'jinja2': 'python3-jinja2',
    'lz4': None,
    'matplotlib': 'python3-matplotlib',
    'mcap': None,
    'numpy': 'python3-numpy',
    'optuna': None,
    'PIL': 'python3-pil',
    'pandas': 'python3-pandas',
    'pyarrow': None,
    'rich': 'python3-rich',
    'scipy': 'python3-scipy',
    'sklearn': 'python3-sklearn',
    'yaml': 'python3-yaml',
    'zstandard': None,
}
# where the name differs
DISTRIBUTIONS = {
    'PIL': 'pillow',
    'sklearn': 'scikit-learn',
    'yaml': 'pyyaml',
}
# modules that a package does without, by the distribution that an extra of its setup.cfg installs
OPTIONAL = {'vehiclemodels': 'commonroad-vehicle-models'}
# packages that do without a module which others need, by package
OPTIONAL_FOR = {'bags': {'pandas': 'pandas'}}
NOT_IMPORTED = {'ros2launch'}  # the command that finds the launch files


def imports(package):
    """Return the modules outside of this package and of Python that its files need."""
    return all_imports(package) - set(optional_for(package))


def optional_for(package):
    return OPTIONAL | OPTIONAL_FOR.get(package, {})


def all_imports(package):
    folder = ROOT / package
    found = set()
    for path in (*(folder / package).rglob('*.py'), *(folder / 'launch').glob('*.py')):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found.update(alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module.split('.')[0])
    return found - set(sys.stdlib_module_names) - {package}


def run_dependencies(package):
    manifest = ElementTree.parse(ROOT / package / 'package.xml').getroot()
    return {tag.text for kind in ('depend', 'exec_depend') for tag in manifest.iter(kind)}


@pytest.mark.parametrize('package', PACKAGES)
def test_the_manifest_names_what_is_imported_and_nothing_else(package):
    keys = {ROSDEP_KEYS.get(module, module) for module in imports(package)} - {None}
    assert run_dependencies(package) - NOT_IMPORTED == keys


@pytest.mark.parametrize('package', PACKAGES)
def test_the_manifest_says_which_imports_have_no_key(package):
    text = (ROOT / package / 'package.xml').read_text()
    comments = ''.join(re.findall('<!--(.*?)-->', text, re.S))
    without_key = {module for module in imports(package) if ROSDEP_KEYS.get(module, '') is None}
    for module in without_key:
        assert re.search(rf'\b{DISTRIBUTIONS.get(module, module)}\b', comments), module


def test_what_pip_installs_for_want_of_a_key_is_in_the_installation_for_ubuntu():
    (line,) = re.findall('^pip install (.*)$', (ROOT / 'docs/howto/ubuntu.md').read_text(), re.M)[
        :1
    ]
    by_hand = {module for package in PACKAGES for module in imports(package)}
    for module in by_hand & {name for name, key in ROSDEP_KEYS.items() if key is None}:
        assert DISTRIBUTIONS.get(module, module) in line.split(), module


@pytest.mark.parametrize('package', PACKAGES)
def test_setup_names_every_import_that_pip_installs(package):
    required = read_configuration(ROOT / package / 'setup.cfg')['options']['install_requires']
    installed = {re.match(r'[\w-]+', entry).group() for entry in required} - {'setuptools'}
    outside = imports(package) & set(ROSDEP_KEYS)
    assert installed == {DISTRIBUTIONS.get(module, module) for module in outside}


@pytest.mark.parametrize('package', PACKAGES)
def test_an_extra_installs_each_optional_import(package):
    extras = read_configuration(ROOT / package / 'setup.cfg')['options']['extras_require']
    offered = {entry for entries in extras.values() for entry in entries}
    known = optional_for(package)
    optional = all_imports(package) & set(known)
    assert {known[module] for module in optional} == offered & set(known.values())


def test_a_package_with_launch_files_depends_on_what_starts_them():
    with_files = [package for package in PACKAGES if list((ROOT / package).glob('launch/*'))]
    assert with_files
    for package in with_files:
        assert run_dependencies(package) >= {'launch', 'launch_ros', 'ros2launch'}
