"""Allowed imports: packages, folders and modules depend on each other in one direction only."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# the packages that each package may import, besides itself
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
    """Return every absolute module name that a file imports, anywhere in the file."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.update(f'{node.module}.{alias.name}' for alias in node.names)
    return names


def tops(path):
    return {name.split('.')[0] for name in imported(path)}


def package_of(path):
    return path.relative_to(ROOT).parts[0]


def relative(path):
    return str(path.relative_to(ROOT))


def offences(paths, forbidden):
    """Return {file: sorted names} of the imports that `forbidden(path)` returns for each file."""
    names = {relative(path): sorted(forbidden(path)) for path in paths}
    return {file: forbidden for file, forbidden in names.items() if forbidden}


def test_packages_import_one_way():
    def forbidden(path):
        own = package_of(path)
        return tops(path) & set(OURS) - ALLOWED[own] - {own}

    assert offences(MODULES, forbidden) == {}


def test_the_plant_takes_the_compiler_alone_from_the_solver():
    """A plant that shared model or solver with the controller could not validate them."""
    plant = [path for path in MODULES if package_of(path) == 'vehicle_plant']
    names = {n for path in plant for n in imported(path) if n.startswith('stage_solver')}
    assert names == {'stage_solver.compile_cache'}


def module_of(path):
    """Return the dotted name of a file; a package has the name of its folder."""
    parts = path.relative_to(ROOT / package_of(path)).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def folder_of(module):
    """Return the folder of a module: of `package.folder.any.thing` the first two names.

    At the root of a package every module is its own unit.
    """
    return '.'.join(module.split('.')[:2])


def import_graph(unit):
    """Return {unit: units that it imports}; `unit` maps the name of a module to its unit."""
    names = {module_of(path) for path in MODULES}
    graph = {unit(name): set() for name in names}
    for path in MODULES:
        for name in imported(path):
            while name and name not in names:
                name = name.rpartition('.')[0]
            if name and name != module_of(path):
                graph[unit(module_of(path))].add(unit(name))
    return {name: others - {name} for name, others in graph.items()}


@pytest.mark.parametrize('unit', [str, folder_of], ids=['modules', 'folders'])
def test_no_import_circles(unit):
    graph = import_graph(unit)
    # raises CycleError, which names the circle
    assert len(list(TopologicalSorter(graph).static_order())) == len(graph)


def test_imports_are_absolute():
    """`imported` sees no others."""
    for path in MODULES:
        nodes = ast.walk(ast.parse(path.read_text()))
        assert not any(isinstance(n, ast.ImportFrom) and n.level for n in nodes), path


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
