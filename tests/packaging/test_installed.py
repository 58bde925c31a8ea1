"""What pip and colcon install, outside of the repository: files, commands, nodes that drive."""

import importlib.util
import json
import os
import subprocess
import sys
import zipfile
from fnmatch import fnmatch
from pathlib import Path

import pytest
from installation import PACKAGES, ROOT, environment, run_checked
from packaging.utils import parse_wheel_filename

FOLDERS = ('config', 'examples', 'launch', 'resource', 'scenarios', 'scripts', 'viewers')
# what decides which files are installed, and how; the data themselves; new modules and packages
MANIFESTS = [
    *('*/setup.*', '*/package.xml', 'pyproject.toml', 'LICENSE', 'Makefile', '.ci/install.py'),
    *(f'{package}/{folder}/*' for package in PACKAGES for folder in FOLDERS),
    *('*/py.typed', '*.c', '*.h', '*.css', '*.html', '*.js'),
    *('requirements*', '*/__init__.py', '*/share.py', '*/tune.py', '*/cli.py'),
    *('tests/packaging/*', 'tests/helpers/installation.py'),
]
builds = [
    pytest.mark.slow,
    pytest.mark.timeout(1200, func_only=True),
    pytest.mark.reads(*MANIFESTS),
]
EXECUTABLES = {
    'scenario_publisher': ('scenario_node', 'converter_node'),
    'state_estimator': ('estimator_node',),
    'mpcc_controller': ('controller_node', 'mpcc_node', 'frenet_node'),
    'vehicle_plant': ('plant_node', 'identify', 'manoeuvre'),
    'bags': ('markers_node', 'player_node', 'recorder_node', 'bags'),
    'experiments': ('experiments',),
}
WHERE = f'import {", ".join(PACKAGES)}; print(*(p.__file__ for p in ({", ".join(PACKAGES)})))'
# the begin of a straight road: a second and a half
SHORT = ('straight', '--set', 'plant.stop.x_m=22.0', '--set', 'plant.stop.armed_after_m=1.0')


def files_to_install(package):
    """Yield the files of a package that it needs where it is installed."""
    for folder in (*FOLDERS, package):
        for path in (ROOT / package / folder).rglob('*'):
            is_example = package == 'stage_solver' and folder == 'examples'
            if path.is_file() and '__pycache__' not in path.parts and not is_example:
                yield path


def check_share(prefix):
    """Both ways to install put what `ros2 run` and `share` look for at the same places."""
    for package in {*PACKAGES} & {path.name for path in (prefix / 'share').iterdir()}:
        assert (prefix / 'share/ament_index/resource_index/packages' / package).exists()
        for path in files_to_install(package):
            folder, *names = path.relative_to(ROOT / package).parts
            if folder not in (package, 'resource', 'scripts'):
                assert prefix.joinpath('share', package, folder, *names).exists(), path
        for name in EXECUTABLES.get(package, ()):
            assert os.access(prefix / 'lib' / package / name, os.X_OK), name


def check_drive(python, prefix, commands, folder, sourced):
    """Drive with what is installed below a prefix, and not with what is here."""
    files = run_checked([python, '-c', WHERE], cwd=folder, env=sourced).split()
    assert len(files) == len(PACKAGES)
    for file in files:
        assert prefix in Path(file).parents, file
    experiments, bags = (commands(name) for name in ('experiments', 'bags'))
    run_checked([experiments, 'run', *SHORT], cwd=folder, env=sourced)
    out = folder / 'bags/runs/straight'
    metrics = json.loads((out / 'comparison.json').read_text())['runs']['mpcc']
    assert metrics['ticks'] > 20
    assert metrics['fallbacks'] == 0
    assert (out / 'report.html').is_file()
    info = run_checked([bags, 'info', out / 'mpcc'], cwd=folder, env=sourced)
    assert '/controller/command' in info


def test_pip_installs_every_executable():
    prefix = Path(sys.prefix)
    for package, names in EXECUTABLES.items():
        assert importlib.util.find_spec(package)
        for name in names:
            assert os.access(prefix / 'lib' / package / name, os.X_OK), name


def test_a_change_of_what_is_installed_beside_modules_selects_the_builds():
    for package in PACKAGES:
        for path in files_to_install(package):
            name = path.relative_to(ROOT).as_posix()
            is_module = path.suffix == '.py' and name.startswith(f'{package}/{package}/')
            if not is_module:
                assert any(fnmatch(name, pattern) for pattern in MANIFESTS), name


class TestBuilds:
    """Wheels and a workspace of colcon."""

    pytestmark = builds

    def test_a_wheel_holds_licence_data_and_programs_for_every_python(self, wheels):
        names = [parse_wheel_filename(wheel.name) for wheel in wheels]
        assert sorted(name for name, *_ in names) == sorted(n.replace('_', '-') for n in PACKAGES)
        assert {str(tag) for *_, tags in names for tag in tags} == {'py3-none-any'}
        for package in PACKAGES:
            (wheel,) = (wheel for wheel in wheels if wheel.name.startswith(f'{package}-'))
            inside = {Path(name).name for name in zipfile.ZipFile(wheel).namelist()}
            data = {'LICENSE', *(path.name for path in files_to_install(package))}
            assert len(data) > 3
            assert data <= inside

    def test_wheels_drive_in_an_environment_with_what_make_demo_installs(self, installed, tmp_path):
        prefix = installed.parents[1]
        check_share(prefix)
        check_drive(installed, prefix, installed.with_name, tmp_path, environment())
        tune = [installed.with_name('experiments'), 'tune', 'mpcc', '--out', tmp_path / 'tuning']
        done = subprocess.run(tune, env=environment(), capture_output=True, text=True, timeout=240)
        assert done.returncode == 1
        assert done.stderr == (
            'error: experiments needs the module sklearn for this: `make studies`, or pip, '
            'installs it\n'
        )

    def test_what_colcon_installs_drives(self, colcon, empty, tmp_path):
        prefixes = [Path(path) for path in colcon['AMENT_PREFIX_PATH'].split(os.pathsep)]
        mine = {path.name: path for path in prefixes if path.name in PACKAGES}
        assert mine.keys() == {*PACKAGES}
        for prefix in mine.values():
            check_share(prefix)
        base = mine['bags'].parent
        check_drive(empty, base, lambda name: mine[name] / f'lib/{name}/{name}', tmp_path, colcon)
