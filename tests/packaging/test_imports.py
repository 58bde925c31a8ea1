"""Who may import whom: the packages depend on each other in one direction only."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OURS = ('msgs_yaml', 'scenario_publisher', 'mpcc_controller', 'vehicle_plant', 'bags')
ROS = (
    'builtin_interfaces',
    'diagnostic_msgs',
    'geometry_msgs',
    'nav_msgs',
    'rcl_interfaces',
    'rclpy',
    'rosgraph_msgs',
    'rosidl_runtime_py',
    'sensor_msgs',
    'std_msgs',
    'tf2_msgs',
    'visualization_msgs',
)
# drives in process and recorded ticks stand on the cores of the others: one small package, so that
# nothing else in bags can come to depend on them
CLOSED_LOOP = sorted((ROOT / 'bags/bags/closed_loop').glob('*.py'))
MODULES = [path for name in OURS for path in sorted((ROOT / name / name).rglob('*.py'))]


def imported(path):
    """Return every absolute module name that a file imports, wherever in the file."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.update(f'{node.module}.{alias.name}' for alias in node.names)
    return found


def tops(path):
    return {name.split('.')[0] for name in imported(path)}


def package_of(path):
    return path.relative_to(ROOT).parts[0]


def relative(path):
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize('path', MODULES, ids=relative)
def test_packages_meet_only_in_the_contract(path):
    package = package_of(path)
    allowed = {package} if package == 'msgs_yaml' else {package, 'msgs_yaml'}
    if path in CLOSED_LOOP:
        allowed |= {'scenario_publisher', 'mpcc_controller', 'vehicle_plant'}
    assert tops(path) & set(OURS) <= allowed


@pytest.mark.parametrize('path', CLOSED_LOOP, ids=relative)
def test_the_closed_loop_uses_cores_and_no_node(path):
    assert not [name for name in imported(path) if 'node' in name]


@pytest.mark.parametrize('path', MODULES, ids=relative)
def test_ros_stays_in_nodes_and_glue(path):
    glue = path.name.endswith('_node.py') or path.name in ('ros.py', 'qos.py', 'encode.py')
    assert glue or not tops(path) & set(ROS)


@pytest.mark.parametrize('path', MODULES, ids=relative)
def test_casadi_stays_with_the_models(path):
    at_home = package_of(path) in ('mpcc_controller', 'vehicle_plant')
    assert at_home or 'casadi' not in tops(path)


@pytest.mark.parametrize('path', MODULES, ids=relative)
def test_no_core_imports_its_node(path):
    nodes = [name for name in imported(path) if name.endswith('_node')]
    assert path.name.endswith('_node.py') or not nodes


def test_who_stores_does_not_judge():
    storing = [path for path in MODULES if path.parent.name == 'storage']
    assert storing
    assert not [
        f'{relative(path)}: {name}'
        for path in storing
        for name in imported(path)
        if name.startswith('bags.verdict')
    ]


def test_the_walk_sees_every_package():
    assert {package_of(path) for path in MODULES} == set(OURS)
