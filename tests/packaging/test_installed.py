"""Installed packages, outside of the repository: the node graph drives."""

import json
import os
import subprocess
import zipfile
from pathlib import Path

import pytest
from installation import PACKAGES, ROOT, environment, run_checked
from packaging.utils import parse_wheel_filename

pytestmark = [pytest.mark.ros, pytest.mark.timeout(1200, func_only=True)]
WHERE = f'import {", ".join(PACKAGES)}; print(*(p.__file__ for p in ({", ".join(PACKAGES)})))'
RESOLVED = (
    'from msgs_yaml import share; print(share.node_command("vehicle_plant", "plant_node")[0])'
)
# the begin of a straight road: a second and a half
SHORT = (
    *('straight', '--set', 'plant.stop.x_m=22.0'),
    *('--set', 'plant.stop.armed_after_m=1.0'),
)


def check_drive(experiments, bags, folder, sourced):
    """Drive with an installed `experiments run` and look at what it left."""
    run_checked([experiments, 'run', *SHORT], cwd=folder, env=sourced)
    out = folder / 'bags/runs/straight'
    found = json.loads((out / 'comparison.json').read_text())['runs']['mpcc']
    assert found['ticks'] > 20
    assert found['fallbacks'] == 0
    assert (out / 'report.html').is_file()
    info = run_checked([bags, 'info', out / 'mpcc'], cwd=folder, env=sourced)
    assert '/controller/command' in info


def check_place(python, prefix, folder, sourced):
    """Every package and every node comes from below one folder, and so not from here."""
    files = run_checked([python, '-c', WHERE], cwd=folder, env=sourced).split()
    node = run_checked([python, '-c', RESOLVED], cwd=folder, env=sourced).strip()
    assert len(files) == len(PACKAGES)
    for file in (*files, node):
        assert Path(prefix) in Path(file).parents, file


def test_an_environment_of_the_requirements_holds_none_of_our_packages(empty):
    ours = f'import importlib.util as u; print([n for n in {PACKAGES} if u.find_spec(n)])'
    assert run_checked([empty, '-c', ours], cwd='/', env=environment()).strip() == '[]'


def test_there_is_a_wheel_of_every_package_for_every_python(wheels):
    names = [parse_wheel_filename(wheel.name) for wheel in wheels]
    assert sorted(name for name, *_ in names) == sorted(n.replace('_', '-') for n in PACKAGES)
    assert {str(tag) for *_, tags in names for tag in tags} == {'py3-none-any'}


@pytest.mark.parametrize('package', PACKAGES)
def test_a_wheel_holds_the_licence_and_every_file_of_its_package(wheels, package):
    (wheel,) = (wheel for wheel in wheels if wheel.name.startswith(f'{package}-'))
    inside = {Path(name).name for name in zipfile.ZipFile(wheel).namelist()}
    data = {path.name for path in files_to_install(package)}
    assert 'LICENSE' in inside
    assert data
    assert data <= inside


def files_to_install(package):
    """Yield the files of a package that it needs where it is installed."""
    folders = ('config', 'examples', 'launch', 'resource', 'scenarios', 'scripts', 'viewers')
    for folder in (*folders, package):
        for path in (ROOT / package / folder).rglob('*'):
            is_example = package == 'stage_solver' and folder == 'examples'
            if path.is_file() and '__pycache__' not in path.parts and not is_example:
                yield path


def test_a_ring_drives_from_wheels_in_an_empty_environment(installed, tmp_path):
    prefix = installed.parents[1]
    check_place(installed, prefix, tmp_path, environment())
    check_drive(prefix / 'bin/experiments', prefix / 'bin/bags', tmp_path, environment())


def test_a_command_that_lacks_a_package_says_how_to_get_it(installed, tmp_path):
    program = installed.with_name('experiments')
    tune = [program, 'tune', 'mpcc', '--trials', '1', '1', '--out', tmp_path / 'tuning']
    done = subprocess.run(tune, env=environment(), capture_output=True, text=True, timeout=240)
    assert done.returncode == 1
    assert done.stderr == (
        'error: experiments needs optuna for this: `make studies`, or pip, installs it\n'
    )


def test_a_ring_drives_from_what_colcon_installs(colcon, empty, tmp_path):
    here = [Path(p) for p in colcon['AMENT_PREFIX_PATH'].split(os.pathsep)]
    experiments, bags = (
        next(p for p in here if (p / f'lib/{name}').exists()) / f'lib/{name}/{name}'
        for name in ('experiments', 'bags')
    )
    check_place(empty, bags.parents[3], tmp_path, colcon)
    check_drive(experiments, bags, tmp_path, colcon)
