"""The examples: riccati and IPOPT agree, and the results obey physics."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stage_solver import SOLVED, SolverOptions, make_solver
from stage_solver.reference_solvers import ReferenceSolver

FOLDER = Path(__file__).parents[2] / 'stage_solver/examples'
NAMES = ('cart_pole', 'point_robot', 'quadrotor')


def load(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def solve_by_both(name, *arguments):
    """Return the module, and its solutions by riccati and by IPOPT."""
    module = load(name)
    problem = module.make_problem()
    options = SolverOptions(max_iterations=500, tolerance=1e-7)
    solvers = make_solver(problem, options), ReferenceSolver(problem, 'ipopt', options)
    numbers = module.make_arguments(problem, *arguments)
    return module, [solver.solve(*numbers) for solver in solvers]


def assert_equal_solutions(own, reference):
    assert own.status == reference.status == SOLVED
    assert own.cost == pytest.approx(reference.cost, rel=1e-5)
    assert np.allclose(own.plan.X, reference.plan.X, atol=2e-3)


def test_every_example_is_tested():
    assert sorted(path.stem for path in FOLDER.glob('*.py')) == sorted(NAMES)


def test_the_pole_is_swung_up_within_track_and_force():
    module, (own, reference) = solve_by_both('cart_pole')
    assert_equal_solutions(own, reference)
    X, U = own.plan.X, own.plan.U
    assert np.allclose(X[-1], [module.GOAL_M, np.pi, 0.0, 0.0], atol=1e-5)
    assert np.abs(X[:, 0]).max() <= module.TRACK_M + 1e-6
    assert np.abs(U).max() <= module.FORCE_N + 1e-5


def test_the_energy_of_the_cart_pole_changes_by_the_work_of_the_force_alone():
    module = load('cart_pole')
    m, M, length, g = module.POLE_KG, module.CART_KG, module.LENGTH_M, module.GRAVITY

    def energy(x):
        _, angle, v, w = x
        bob = (v + length * w * np.cos(angle)) ** 2 + (length * w * np.sin(angle)) ** 2
        return M * v**2 / 2 + m * bob / 2 - m * g * length * np.cos(angle)

    rng = np.random.default_rng(1)
    for _ in range(50):
        x, force = rng.uniform(-2.0, 2.0, 4), rng.uniform(-20.0, 20.0)
        slope = np.array(module.rates(x, [force], None)).ravel().astype(float)
        h = 1e-6
        change = (energy(x + h * slope) - energy(x - h * slope)) / (2 * h)
        assert change == pytest.approx(force * x[2], abs=1e-6)


def test_the_quadrotor_passes_the_discs_as_closely_as_it_may():
    module, (own, reference) = solve_by_both('quadrotor')
    assert_equal_solutions(own, reference)
    assert np.allclose(own.plan.X[-1], [*module.GOAL, 0.0, 0.0, 0.0, 0.0], atol=1e-5)
    assert own.plan.U.min() >= -1e-6
    assert own.plan.U.max() <= module.MAX_THRUST_N + 1e-5
    assert min(module.clearances(own.plan.X)) == pytest.approx(0.0, abs=1e-4)


def test_a_straight_path_takes_the_time_of_the_closed_form():
    module, (own, reference) = solve_by_both(
        'point_robot', np.zeros(load('point_robot').HORIZON + 1)
    )
    assert_equal_solutions(own, reference)
    assert own.cost == pytest.approx(module.straight_time_s(), rel=1e-5)


def test_in_a_bend_the_whole_acceleration_is_used_everywhere():
    module, (own, reference) = solve_by_both('point_robot', load('point_robot').bend_curvature())
    assert_equal_solutions(own, reference)
    lateral = module.bend_curvature()[:-1] * own.plan.X[:-1, 0]
    whole = np.hypot(own.plan.U[:, 0], lateral)
    assert whole.max() <= module.MAX_ACCELERATION_MPS2 + 1e-5
    assert np.median(whole) == pytest.approx(module.MAX_ACCELERATION_MPS2, rel=1e-3)
    assert own.cost > module.straight_time_s()


@pytest.mark.parametrize('name', NAMES)
def test_an_example_runs_as_its_first_lines_say(name):
    result = subprocess.run(
        [sys.executable, FOLDER / f'{name}.py'], capture_output=True, text=True, timeout=240
    )
    assert result.returncode == 0, result.stderr
    assert 'solved after' in result.stdout


@pytest.mark.needs('compiler')
def test_the_benchmark_writes_a_row_per_problem_start_and_solver(tmp_path):
    script = FOLDER.parent / 'benchmark.py'
    command = [sys.executable, script, '--quick', '--out', tmp_path]
    result = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert result.returncode == 0, result.stderr
    rows = (tmp_path / 'benchmark.md').read_text().splitlines()[6:]
    assert len(rows) == 2 * 2 * 3
    assert all(row.endswith('| 2/2 |') for row in rows), rows
