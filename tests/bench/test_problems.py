"""The problems of closed loops: the same every time, what they claim to be, and warm starts."""

from itertools import pairwise

import closed_loops
import numpy as np
import problems
import pytest
from problems import COLD, FIRST, POP_UP, WARM

from mpcc_controller.model.single_track import State
from mpcc_controller.problem import mpcc_formulation
from node_runtime import named_vector
from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solution import FAILED, Solution, SolverOptions


def fatrop(problem):
    return ReferenceSolver(problem, 'fatrop', SolverOptions())


def stage_numbers(P):
    return named_vector.build(mpcc_formulation.symbolic_ocp(1, 4).template, P.T)


def test_the_same_loops_give_the_same_problems_to_the_last_bit(recorded, driven_loops, small):
    for one, again in zip(recorded, problems.record(driven_loops, small), strict=True):
        assert (one.loop, one.tick) == (again.loop, again.tick)
        for a, b in zip(named_vector.leaves(one[2:]), named_vector.leaves(again[2:]), strict=True):
            np.testing.assert_array_equal(a, b)


def test_the_ticks_of_each_loop_are_recorded(recorded):
    assert [posed.tick for posed in recorded] == [*range(55, 62), *range(17, 24)]
    assert [posed.loop for posed in recorded] == ['swerve'] * 7 + ['pop-up'] * 7


def test_every_guess_begins_where_the_car_is(recorded):
    for posed in recorded:
        np.testing.assert_array_equal(posed.cold.X[0], posed.x0)


def test_an_obstacle_popped_up_in_the_distance_that_was_asked_for(recorded):
    surprised = [posed for posed in recorded if posed.pop_up_P is not None]
    assert [posed.tick for posed in surprised] == [60, 18]
    for posed in surprised:
        before, after = (stage_numbers(P).obstacles for P in (posed.P, posed.pop_up_P))
        known = {(o.X[0], o.Y[0]) for o in before}
        new = [o for o in after if (o.X[0], o.Y[0]) not in known and o.r_obs[0] > 0]
        assert len(new) == 1
        x = State(*posed.x0)
        away = np.hypot(new[0].X[0] - x.X, new[0].Y[0] - x.Y)
        assert 13 < away < 41


def test_a_pop_up_changes_nothing_but_the_obstacles(recorded, problem):
    for posed in recorded:
        if posed.pop_up_P is not None:
            changed = np.any(posed.pop_up_P != posed.P, axis=0)
            names = {name for name, is_new in zip(problem.parameters, changed) if is_new}
            assert names
            assert all(name.startswith('obstacles.') for name in names)


def tasks_of(problem, recorded, params, solver):
    return problems.tasks(problem, recorded, params.fallback, solver, 5)


def test_only_the_first_tick_of_a_loop_has_to_start_cold(problem, recorded, params):
    given = tasks_of(problem, recorded, params, fatrop(problem))
    kinds = [task.kind for task in given]
    assert kinds == [FIRST, *[WARM] * 6] * 2 + [COLD] * 3 + [POP_UP] * 2
    for task, k in zip(given[14:17], (0, 5, 10)):
        np.testing.assert_array_equal(task.start.X, recorded[k].cold.X)
        np.testing.assert_array_equal(task.P, recorded[k].cold_P)
    surprised = [k for k, posed in enumerate(recorded) if posed.pop_up_P is not None]
    for task, k in zip(given[17:], surprised):
        assert task.start is given[k].start
        assert not np.array_equal(task.P, given[k].P)


def test_a_warm_start_is_the_solvers_own_plan_moved_on(problem, recorded, params):
    made = fatrop(problem)
    for before, after in pairwise(tasks_of(problem, recorded, params, made)[2:7]):
        plan = made.solve(*before[1:]).plan
        np.testing.assert_allclose(after.start.U[:-1], plan.U[1:], atol=1e-9)
        assert after.start.multipliers is not None
        np.testing.assert_array_equal(after.start.X[0], after.x0)


class Refuses:
    """A solver that never succeeds."""

    def __init__(self):
        self.starts = []

    def solve(self, x0, P, bounds, guess):
        self.starts.append(guess)
        return Solution(guess, 0.0, FAILED, 'refused', 0, np.inf, np.inf, 0.0)


def test_a_solver_that_fails_gets_the_cold_starts_of_the_controller(problem, recorded, params):
    refuses = Refuses()
    given = tasks_of(problem, recorded, params, refuses)
    assert [task.kind for task in given[:7]] == [FIRST, *[WARM] * 6]
    for posed, start in zip(recorded[:7], refuses.starts):
        np.testing.assert_array_equal(start.X, posed.cold.X)


def test_another_speed_is_driven_at_that_speed():
    slow, fast = (closed_loops.load_scenario('double_lane_change', v) for v in (10.0, 20.0))
    assert fast.start.speed == 20.0
    np.testing.assert_allclose(slow.reference.t, 2 * fast.reference.t)
    np.testing.assert_array_equal(slow.reference.X, fast.reference.X)


@pytest.mark.parametrize('loop', closed_loops.FULL, ids=lambda loop: loop.name)
def test_every_scenario_of_the_benchmark_is_valid(loop):
    scn = closed_loops.load_scenario(loop.scenario, loop.speed)
    if loop.speed is not None:
        assert scn.start.speed == pytest.approx(loop.speed)
    assert scn.text
