"""The examples, the program of the README and the benchmark run; their results obey physics."""

import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_problems import make

import stage_solver
from stage_solver import SOLVED

FOLDER = Path(__file__).parents[2] / 'stage_solver'
EXAMPLES = FOLDER / 'examples'


@pytest.fixture
def load(capsys):
    """Return load(name): what an example defines; as a program it prints its solution."""

    def run(name):
        names = runpy.run_path(str(EXAMPLES / f'{name}.py'), run_name='__main__')
        assert 'solved after' in capsys.readouterr().out
        return SimpleNamespace(**names)

    return run


def solve(module, *arguments):
    """Return the solution of an example, which is that of IPOPT."""
    problem = module.make_problem()
    numbers = module.make_arguments(problem, *arguments)
    own, reference = (
        make(name, problem, max_iterations=500, tolerance=1e-7).solve(*numbers)
        for name in ('riccati', 'ipopt')
    )
    assert own.status == reference.status == SOLVED
    assert own.cost == pytest.approx(reference.cost, rel=1e-5)
    assert np.allclose(own.plan.X, reference.plan.X, atol=2e-3)
    return own


def test_the_pole_is_swung_up_within_track_and_force(load):
    module = load('cart_pole')
    X, U, _ = solve(module).plan
    assert np.allclose(X[-1], [module.GOAL_M, np.pi, 0.0, 0.0], atol=1e-5)
    assert np.abs(X[:, 0]).max() <= module.TRACK_M + 1e-6
    assert np.abs(U).max() <= module.FORCE_N + 1e-5


def test_the_energy_of_the_cart_pole_changes_by_the_work_of_the_force_alone(load):
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


def test_the_quadrotor_passes_the_discs_as_closely_as_it_may(load):
    module = load('quadrotor')
    X, U, _ = solve(module).plan
    assert np.allclose(X[-1], [*module.GOAL, 0.0, 0.0, 0.0, 0.0], atol=1e-5)
    assert np.all((U >= -1e-6) & (module.MAX_THRUST_N + 1e-5 >= U))
    assert min(module.clearances(X)) == pytest.approx(0.0, abs=1e-4)


def test_the_point_robot_takes_the_time_of_the_closed_form_and_more_in_a_bend(load):
    module = load('point_robot')
    straight = solve(module, np.zeros(module.HORIZON + 1))
    assert straight.cost == pytest.approx(module.straight_time_s(), rel=1e-5)
    bend = solve(module, module.bend_curvature())
    lateral = module.bend_curvature()[:-1] * bend.plan.X[:-1, 0]
    whole = np.hypot(bend.plan.U[:, 0], lateral)
    assert whole.max() <= module.MAX_ACCELERATION_MPS2 + 1e-5
    assert np.median(whole) == pytest.approx(module.MAX_ACCELERATION_MPS2, rel=1e-3)
    assert bend.cost > straight.cost


def test_the_benchmark_writes_a_row_per_problem_start_and_solver(tmp_path):
    command = [sys.executable, FOLDER / 'benchmark.py', '--quick', '--out', tmp_path]
    result = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert result.returncode == 0, result.stderr
    rows = (tmp_path / 'benchmark.md').read_text().splitlines()[6:]
    assert len(rows) == 2 * 2 * 3
    assert all(row.endswith('| 2/2 |') for row in rows), rows


def test_the_program_of_the_readme_pushes_with_full_force_at_first():
    (program,) = re.findall(r'```python\n(.*?)```', (FOLDER / 'README.md').read_text(), re.S)
    names = {}
    exec(program, names)
    assert names['force'] == pytest.approx([1.0], abs=1e-5)
    first = names['solution']
    arguments = first.plan.X[1], names['P'], names['bounds'], names['guess']
    again = names['solver'].solve(*arguments)
    assert again.status == SOLVED
    assert again.iterations < first.iterations


def test_every_public_name_exists_and_is_in_the_help():
    assert all(getattr(stage_solver, name) for name in stage_solver.__all__)
    assert set(re.findall(r'\w+', stage_solver.__doc__)) >= set(stage_solver.__all__)
    with pytest.raises(AttributeError, match="no attribute 'solve'"):
        stage_solver.solve  # noqa: B018
