"""Manifests name what is imported; versions, licences and change logs are as ROS reads them."""

import ast
import importlib.metadata as metadata
import importlib.util
import os
import re
import shutil
import sys

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.changelog_generator import FORTHCOMING_LABEL
from catkin_pkg.package import parse_package
from installation import PACKAGES, ROOT
from setuptools.config.setupcfg import read_configuration

# of catkin_pkg, which docutils warns
pytestmark = pytest.mark.filterwarnings('ignore:nodes.Node.traverse')
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
DISTRIBUTIONS = {'PIL': 'pillow', 'sklearn': 'scikit-learn', 'yaml': 'pyyaml'}
# modules that a package does without: an extra of its setup.cfg installs them
OPTIONAL = {
    'vehicle_plant': {'vehiclemodels': 'commonroad-vehicle-models'},
    'bags': {'pandas': 'pandas'},
}
LAUNCH = {'launch', 'launch_ros', 'ros2launch'}  # the last one is the command
SCHEMA = 'http://download.ros.org/schema/package_format3.xsd'
RELEASED = '# Changelog\n\n## 1.2.0 (2026-01-31)\n\n- It drives.\n'
NEXT = '# Changelog\n\n## 1.3.0 (unreleased)\n\n- It brakes.\n\n## 1.2.0 (2026-01-31)\n'


def load_tool():
    spec = importlib.util.spec_from_file_location('set_version', ROOT / '.ci/set_version.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


set_version = load_tool()


def imports(package):
    """Return the modules outside of this package and of Python that its files import."""
    folder = ROOT / package
    modules = set()
    for path in (*(folder / package).rglob('*.py'), *(folder / 'launch').glob('*.py')):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                modules.update(alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                modules.add(node.module.split('.')[0])
    return modules - set(sys.stdlib_module_names) - {package}


def options(package):
    return read_configuration(ROOT / package / 'setup.cfg')['options']


@pytest.mark.parametrize('package', PACKAGES)
def test_manifest_and_setup_name_what_is_imported_and_nothing_else(package):
    optional = OPTIONAL.get(package, {})
    modules = imports(package)
    assert optional.keys() <= modules
    modules -= optional.keys()
    manifest = parse_package(str(ROOT / package))
    depends = {dependency.name for dependency in manifest.exec_depends}
    with_launch = LAUNCH if (ROOT / package / 'launch').exists() else set()
    assert depends == {ROSDEP_KEYS.get(m, m) for m in modules} - {None} | with_launch

    text = (ROOT / package / 'package.xml').read_text()
    comments = ''.join(re.findall('<!--(.*?)-->', text, re.S))
    (by_hand,) = re.findall('^pip install (casadi .*)$', ubuntu(), re.M)
    for module in (m for m in modules if ROSDEP_KEYS.get(m, '') is None):
        name = DISTRIBUTIONS.get(module, module)
        assert re.search(rf'\b{name}\b', comments), 'a comment says what has no key'
        assert name in by_hand.split(), 'the guide for Ubuntu installs what has no key'

    setup = options(package)
    required = {re.match(r'[\w-]+', entry).group() for entry in setup['install_requires']}
    outside = {DISTRIBUTIONS.get(m, m) for m in modules & ROSDEP_KEYS.keys()}
    assert required - {'setuptools'} == outside
    offered = {entry for entries in setup['extras_require'].values() for entry in entries}
    assert {*optional.values()} <= offered <= {*optional.values(), 'pytest', *ros_wheels()}


def ubuntu():
    return (ROOT / 'docs/howto/packages.md').read_text().replace('\\\n', ' ')


def ros_wheels():
    return re.findall('^ros-.*$', (ROOT / 'requirements.in').read_text(), re.M)


def test_the_extra_installs_the_ros_that_the_tests_use():
    assert options('node_runtime')['extras_require']['ros'] == ros_wheels()


@pytest.mark.parametrize('file', [*ROOT.glob('requirements*.txt'), ROOT / 'docs/requirements.txt'])
def test_every_requirement_has_one_version(file):
    lines = [line for line in file.read_text().splitlines() if not line.startswith('#')]
    assert lines
    assert [line for line in lines if not re.match(r'[\w.\[\]-]+==[\w.!+]+( ;|$)', line)] == []


@pytest.mark.parametrize('package', PACKAGES)
def test_the_manifest_is_valid_and_agrees_with_setup_and_installation(package):
    warnings = []
    manifest = parse_package(str(ROOT / package), warnings=warnings)
    manifest.validate(warnings=warnings)
    assert warnings == []
    # for xmllint, which is told by this line where the schema is
    assert f'<?xml-model href="{SCHEMA}"' in (ROOT / package / 'package.xml').read_text()
    setup = read_configuration(ROOT / package / 'setup.cfg')
    names = (setup['metadata']['name'], setup['metadata']['version'], setup['metadata']['license'])
    assert names == (package, metadata.version(package), 'Apache-2.0')
    assert (manifest.name, manifest.version, *manifest.licenses) == names
    assert manifest.get_build_type() == 'ament_python'
    assert (ROOT / package / 'LICENSE').read_text() == (ROOT / 'LICENSE').read_text()
    lines = setup['options'].get('entry_points', {}).get('console_scripts', ())
    programs = {file.name: file for file in (ROOT / package).glob('scripts/*')}
    assert {line.split(' = ')[0] for line in lines} == programs.keys()
    assert all(os.access(file, os.X_OK) for file in programs.values())


@pytest.fixture
def copies(tmp_path):
    """A folder with copies of the files that hold a version."""
    for name in ('package.xml', 'setup.cfg', 'CHANGELOG.rst'):
        for path in ROOT.glob(f'*/{name}'):
            (tmp_path / path.parent.name).mkdir(exist_ok=True)
            shutil.copy(path, tmp_path / path.parent.name)
    shutil.copy(ROOT / 'CITATION.cff', tmp_path)
    return tmp_path


def test_every_file_has_the_version_of_the_change_log():
    assert set_version.changed(ROOT) == {}, 'make version'


def test_a_release_and_the_work_after_it_have_their_versions(copies):
    for changelog, version, is_released in ((RELEASED, '1.2.0', True), (NEXT, '1.3.0', False)):
        (copies / 'CHANGELOG.md').write_text(changelog)
        for path, text in set_version.changed(copies).items():
            path.write_text(text)
        assert set_version.changed(copies) == {}
        for package in PACKAGES:
            folder = copies / package
            assert parse_package(str(folder)).version == version
            setup = read_configuration(folder / 'setup.cfg')['metadata']
            assert setup['version'] == version
            log = get_changelog_from_path(str(folder), package)
            assert [entry[0] for entry in log.foreach_version()] == ['1.2.0']
            assert log.get_content_of_version('1.2.0')
            assert log.get_date_of_version('1.2.0').date().isoformat() == '2026-01-31'
            forthcoming = f'\n{FORTHCOMING_LABEL}\n---' in (folder / 'CHANGELOG.rst').read_text()
            assert forthcoming != is_released
        citation = (copies / 'CITATION.cff').read_text()
        assert f'version: {version}\n' in citation
        assert ('date-released: 2026-01-31\n' in citation) == is_released


@pytest.mark.parametrize('text', ['# Changelog\n', '## 1.2.0 (soon)\n', '## 1.2 (unreleased)\n'])
def test_a_change_log_without_a_version_is_refused(text):
    with pytest.raises(ValueError, match=r'1\.2\.3|isoformat'):
        set_version.newest(text)
