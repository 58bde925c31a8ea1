"""Who may import whom: the packages depend on each other in one direction only."""

import ast
from functools import cache
from pathlib import Path

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


@cache
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


def offences(paths, forbidden):
    """Return {file: sorted names} of what `forbidden(path)` finds in the imports of each file."""
    found = {relative(path): sorted(forbidden(path)) for path in paths}
    return {file: names for file, names in found.items() if names}


def test_packages_meet_only_in_the_contract():
    def forbidden(path):
        allowed = {package_of(path), 'msgs_yaml'}
        if path in CLOSED_LOOP:
            allowed |= {'scenario_publisher', 'mpcc_controller', 'vehicle_plant'}
        return tops(path) & set(OURS) - allowed

    assert offences(MODULES, forbidden) == {}


def test_the_closed_loop_uses_cores_and_no_node():
    assert CLOSED_LOOP
    found = offences(CLOSED_LOOP, lambda path: {n for n in imported(path) if 'node' in n})
    assert found == {}


def test_ros_stays_in_nodes_and_glue():
    def is_glue(path):
        return path.name.endswith('_node.py') or path.name in ('ros.py', 'qos.py', 'encode.py')

    core = [path for path in MODULES if not is_glue(path)]
    assert offences(core, lambda path: tops(path) & set(ROS)) == {}


def test_casadi_stays_with_the_models():
    others = [p for p in MODULES if package_of(p) not in ('mpcc_controller', 'vehicle_plant')]
    assert offences(others, lambda path: tops(path) & {'casadi'}) == {}


def test_no_core_imports_its_node():
    core = [path for path in MODULES if not path.name.endswith('_node.py')]
    assert offences(core, lambda path: {n for n in imported(path) if n.endswith('_node')}) == {}


def test_who_stores_does_not_judge():
    storing = [path for path in MODULES if path.parent.name == 'storage']
    assert storing
    judging = offences(
        storing, lambda path: {n for n in imported(path) if n.startswith('bags.verdict')}
    )
    assert judging == {}


def test_the_walk_sees_every_package():
    assert {package_of(path) for path in MODULES} == set(OURS)
