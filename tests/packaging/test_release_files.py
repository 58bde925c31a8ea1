"""Versions, licences, change logs and manifests are what ROS and pip read from a package."""

import importlib.metadata as metadata
import importlib.util
import re
import shutil

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.changelog_generator import FORTHCOMING_LABEL
from catkin_pkg.package import parse_package
from installation import PACKAGES, ROOT
from setuptools.config.setupcfg import read_configuration

# of catkin_pkg, which docutils warns
pytestmark = pytest.mark.filterwarnings('ignore:nodes.Node.traverse')
SCHEMA = 'http://download.ros.org/schema/package_format3.xsd'
RELEASED = '# Changelog\n\n## 1.2.0 (2026-01-31)\n\n- It drives.\n'
NEXT = '# Changelog\n\n## 1.3.0 (unreleased)\n\n- It brakes.\n\n## 1.2.0 (2026-01-31)\n'


def _load_tool():
    spec = importlib.util.spec_from_file_location('set_version', ROOT / '.ci' / 'set_version.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


set_version = _load_tool()


@pytest.fixture
def copies(tmp_path):
    """A folder with copies of the files that hold a version."""
    names = ('package.xml', 'setup.cfg', 'CHANGELOG.rst')
    for path in (path for name in names for path in ROOT.glob(f'*/{name}')):
        (tmp_path / path.parent.name).mkdir(exist_ok=True)
        shutil.copy(path, tmp_path / path.parent.name)
    shutil.copy(ROOT / 'CITATION.cff', tmp_path)
    return tmp_path


def write_version(folder, changelog):
    (folder / 'CHANGELOG.md').write_text(changelog)
    for path, text in set_version.changed(folder).items():
        path.write_text(text)


def versions(folder):
    """Return the released versions that ROS reads from the change log of a package."""
    return [version for version, _, _ in get_changelog_from_path(str(folder)).foreach_version()]


def has_forthcoming(folder):
    """Return whether a change log has the heading that ROS tools replace at a release."""
    return f'\n{FORTHCOMING_LABEL}\n---' in (folder / 'CHANGELOG.rst').read_text()


def test_every_file_has_the_version_of_the_change_log():
    assert set_version.changed(ROOT) == {}, 'make version'


@pytest.mark.parametrize('package', PACKAGES)
def test_the_installed_package_has_the_version_of_its_manifest(package):
    assert metadata.version(package) == parse_package(str(ROOT / package)).version


def test_a_release_gives_what_was_forthcoming_a_version_and_a_date(copies):
    write_version(copies, RELEASED)
    for package in PACKAGES:
        assert parse_package(str(copies / package)).version == '1.2.0'
        assert read_configuration(copies / package / 'setup.cfg')['metadata']['version'] == '1.2.0'
        assert versions(copies / package) == ['1.2.0']
        assert not has_forthcoming(copies / package)
    citation = (copies / 'CITATION.cff').read_text()
    assert 'version: 1.2.0\ndate-released: 2026-01-31\n' in citation
    assert set_version.changed(copies) == {}


def test_work_after_a_release_is_forthcoming(copies):
    write_version(copies, RELEASED)
    write_version(copies, NEXT)
    for package in PACKAGES:
        assert parse_package(str(copies / package)).version == '1.3.0'
        assert versions(copies / package) == ['1.2.0']
        assert has_forthcoming(copies / package)
    citation = (copies / 'CITATION.cff').read_text()
    assert 'version: 1.3.0\n' in citation
    assert 'date-released' not in citation


@pytest.mark.parametrize('text', ['# Changelog\n', '## 1.2.0 (soon)\n', '## 1.2 (unreleased)\n'])
def test_a_change_log_without_a_version_is_refused(text):
    with pytest.raises(ValueError, match=r'1\.2\.3|isoformat'):
        set_version.newest(text)


@pytest.mark.parametrize('package', PACKAGES)
def test_the_manifest_is_valid(package):
    warnings = []
    manifest = parse_package(str(ROOT / package), warnings=warnings)
    manifest.validate(warnings=warnings)
    assert warnings == []
    # for xmllint, which is told by this line where the schema is
    assert f'<?xml-model href="{SCHEMA}"' in (ROOT / package / 'package.xml').read_text()


@pytest.mark.parametrize('package', PACKAGES)
def test_the_change_log_of_a_package_can_be_read_when_it_is_released(copies, package):
    write_version(copies, RELEASED)
    log = get_changelog_from_path(str(copies / package), package)
    assert log.get_content_of_version('1.2.0')
    assert log.get_date_of_version('1.2.0').date().isoformat() == '2026-01-31'


@pytest.mark.parametrize('package', PACKAGES)
def test_every_package_has_the_licence(package):
    assert (ROOT / package / 'LICENSE').read_text() == (ROOT / 'LICENSE').read_text()


def test_the_extra_installs_the_ros_that_the_tests_use():
    pins = re.findall('^ros-.*$', (ROOT / 'requirements.in').read_text(), re.M)
    extras = read_configuration(ROOT / 'node_runtime/setup.cfg')['options']['extras_require']
    assert extras['ros'] == pins
