"""Both ways to install give `ros2 run <package> <executable>` and the same share data."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from setuptools.config.setupcfg import read_configuration

ROOT = Path(__file__).parents[2]
EXECUTABLES = {
    'msgs_yaml': (),
    'node_runtime': (),
    'stage_solver': (),
    'scenario_publisher': ('scenario_node',),
    'mpcc_controller': ('controller_node', 'mpcc_node', 'frenet_node'),
    'vehicle_plant': ('plant_node', 'identify', 'manoeuvre'),
    'bags': ('markers_node', 'player_node', 'recorder_node', 'bags'),
    'experiments': ('experiments',),
}
SHARED = {
    'msgs_yaml': 'topics.yaml',
    'node_runtime': 'package.xml',
    'stage_solver': 'package.xml',
    'scenario_publisher': 'scenarios/double_lane_change.yaml',
    'mpcc_controller': 'config/mpcc.yaml',
    'vehicle_plant': 'config/bmw_545i.yaml',
    'bags': 'config/recorder.yaml',
    'experiments': 'launch/closed_loop.launch.py',
}
PAIRS = [(package, name) for package, names in EXECUTABLES.items() for name in names]


def find_executable(prefixes, package, name):
    """Resolve as `ros2 run` does: lib/<package>/<name> below the prefix that holds the package."""
    for prefix in map(Path, prefixes):
        if (prefix / 'share/ament_index/resource_index/packages' / package).exists():
            return prefix / 'lib' / package / name
    raise LookupError(package)


def prints_its_module(executable, environment, domain):
    """Ask the executable where its code lies: an unknown option makes argparse or rclpy answer."""
    result = subprocess.run(
        [executable, '--ros-args', '-p', 'no_such_parameter:=1'],
        env={**environment, 'ROS_DOMAIN_ID': str(domain)},
        capture_output=True,
        text=True,
        timeout=240,
    )
    return result.returncode, result.stdout + result.stderr


@pytest.mark.slow
@pytest.mark.parametrize(('package', 'name'), PAIRS)
def test_colcon_installs_every_executable(colcon, package, name):
    prefixes = colcon['AMENT_PREFIX_PATH'].split(os.pathsep)
    executable = find_executable(prefixes, package, name)
    assert os.access(executable, os.X_OK)


@pytest.mark.parametrize(('package', 'name'), PAIRS)
def test_pip_installs_every_executable(package, name):
    assert os.access(find_executable([sys.prefix], package, name), os.X_OK)


@pytest.mark.slow
@pytest.mark.parametrize('name', ['pip', 'colcon'])
def test_an_installed_node_refuses_an_unknown_parameter_by_name(colcon, domain, name):
    environment = colcon if name == 'colcon' else dict(os.environ)
    prefixes = colcon['AMENT_PREFIX_PATH'].split(os.pathsep) if name == 'colcon' else [sys.prefix]
    executable = find_executable(prefixes, 'scenario_publisher', 'scenario_node')
    code, output = prints_its_module(executable, environment, domain)
    assert code != 0
    assert 'no_such_parameter' in output


@pytest.mark.slow
@pytest.mark.parametrize('package', EXECUTABLES)
def test_share_data_is_installed_both_ways(colcon, package):
    for prefixes in (colcon['AMENT_PREFIX_PATH'].split(os.pathsep), [sys.prefix]):
        executable = find_executable(prefixes, package, 'none')  # LookupError where it is in none
        assert (executable.parents[2] / 'share' / package / SHARED[package]).is_file()


@pytest.mark.parametrize('package', EXECUTABLES)
def test_package_manifest_and_setup_agree(package):
    manifest = ElementTree.parse(ROOT / package / 'package.xml').getroot()
    setup = read_configuration(ROOT / package / 'setup.cfg')
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == package
    for name in ('name', 'version', 'license'):
        assert manifest.findtext(name) == setup['metadata'][name]
    assert manifest.findtext('license') == 'Apache-2.0'
    assert manifest.findtext('export/build_type') == 'ament_python'
    commands = setup['options'].get('entry_points', {}).get('console_scripts', ())
    assert {line.split(' = ')[0] for line in commands} == set(EXECUTABLES[package])
    for name in EXECUTABLES[package]:
        assert os.access(ROOT / package / 'scripts' / name, os.X_OK)
