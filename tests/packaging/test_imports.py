"""Who may import whom: packages and folders depend on each other in one direction only."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
# who may import whom, besides itself
CONTRACT = {'msgs_yaml', 'node_runtime'}
ALLOWED = {
    'msgs_yaml': set(),
    'node_runtime': {'msgs_yaml'},
    'stage_solver': set(),
    'scenario_publisher': CONTRACT,
    'mpcc_controller': CONTRACT | {'stage_solver'},
    'vehicle_plant': CONTRACT | {'stage_solver'},
    'bags': CONTRACT,
    'experiments': {
        *CONTRACT,
        'stage_solver',
        'scenario_publisher',
        'mpcc_controller',
        'vehicle_plant',
        'bags',
    },
}
OURS = tuple(ALLOWED)
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


def test_packages_import_one_way():
    def forbidden(path):
        own = package_of(path)
        return tops(path) & set(OURS) - ALLOWED[own] - {own}

    assert offences(MODULES, forbidden) == {}


def test_the_plant_takes_the_compiler_alone_from_the_solver():
    """Model and solver of the controller prove nothing about a plant that shares them."""
    plant = [path for path in MODULES if package_of(path) == 'vehicle_plant']
    found = {n for path in plant for n in imported(path) if n.startswith('stage_solver')}
    assert found == {'stage_solver.compile_cache'}


def unit_of(path):
    """Return what may not import in a circle: a folder, at the root of a package each module."""
    below = path.relative_to(ROOT / package_of(path)).with_suffix('')
    return below.parts[:2] if len(below.parts) > 2 else below.parts


def unit_named(name, units):
    """Return the unit of an imported name, None outside of this project."""
    parts = tuple(name.split('.'))
    return next((parts[:n] for n in (2, 1) if parts[:n] in units), None)


def test_no_two_folders_import_each_other():
    units = {unit_of(path) for path in MODULES}
    graph = {unit: set() for unit in units}
    for path in MODULES:
        graph[unit_of(path)] |= {unit_named(name, units) for name in imported(path)}
    for unit, others in graph.items():
        others -= {unit, None}
    # raises CycleError, which names the circle
    assert len(list(TopologicalSorter(graph).static_order())) == len(units)


def test_ros_stays_in_nodes_and_glue():
    def is_glue(path):
        return path.name.endswith('_node.py') or path.name in ('ros.py', 'encode.py')

    core = [path for path in MODULES if not is_glue(path)]
    assert offences(core, lambda path: tops(path) & set(ROS)) == {}


def test_casadi_stays_with_the_models():
    allowed = ('stage_solver', 'mpcc_controller', 'vehicle_plant')
    others = [p for p in MODULES if package_of(p) not in allowed]
    assert offences(others, lambda path: tops(path) & {'casadi'}) == {}


def test_no_core_imports_its_node():
    core = [path for path in MODULES if not path.name.endswith('_node.py')]
    assert offences(core, lambda path: {n for n in imported(path) if n.endswith('_node')}) == {}


def test_who_stores_does_not_judge():
    storing = [path for path in MODULES if path.parent.name == 'storage']
    assert storing
    judging = offences(
        storing, lambda path: {n for n in imported(path) if n.startswith('bags.evaluation')}
    )
    assert judging == {}


def test_the_walk_sees_every_package():
    assert {package_of(path) for path in MODULES} == set(OURS)
