"""The recorded problems: the same every time, complete, and what they claim to be."""

import active_limits
import closed_loops
import numpy as np
import problems
import pytest

from mpcc_controller.model.single_track import State
from mpcc_controller.problem import mpcc_formulation, ocp
from node_runtime import named_vector
from stage_solver.stage_problem import ProblemError


def arrays(given):
    return given._replace(bounds=None)._asdict() | given.bounds._asdict()


def vars_of(bounds):
    return bounds._asdict().items()


def stage_numbers(P):
    return named_vector.build(mpcc_formulation.symbolic_ocp(1, 4).template, P.T)


def test_the_same_loops_give_the_same_problems_to_the_last_bit(recorded, driven_loops, small):
    again = arrays(problems.record(driven_loops, small))
    for name, array in arrays(recorded).items():
        np.testing.assert_array_equal(array, again[name], err_msg=name)


def test_a_file_gives_back_what_was_recorded(recorded, problem, tmp_path):
    problems.save(recorded, tmp_path / 'problems.npz')
    read = arrays(problems.load(tmp_path / 'problems.npz', problem))
    for name, array in arrays(recorded).items():
        np.testing.assert_array_equal(array, read[name], err_msg=name)


def test_the_file_of_another_problem_is_refused(recorded, params, tmp_path):
    problems.save(recorded, tmp_path / 'problems.npz')
    longer = ocp.build(mpcc_formulation.symbolic_ocp(1, 4), params.model.horizon + 1, 0.05)
    with pytest.raises(ProblemError, match='another control problem'):
        problems.load(tmp_path / 'problems.npz', longer)
    wider = ocp.build(mpcc_formulation.symbolic_ocp(1, 5), params.model.horizon, 0.05)
    with pytest.raises(ProblemError, match='another control problem'):
        problems.load(tmp_path / 'problems.npz', wider)


def test_problems_continue_tick_by_tick_within_a_loop_and_never_across(recorded):
    assert list(recorded.tick) == [*range(55, 62), *range(17, 24)]
    starts = [k for k in range(len(recorded.tick)) if not recorded.continues(k)]
    assert starts == [0, 7]


def test_every_guess_begins_where_the_car_is(recorded):
    for x0, cold, driven in zip(recorded.x0, recorded.cold_X, recorded.driven_X):
        np.testing.assert_array_equal(cold[0], x0)
        np.testing.assert_allclose(driven[0], x0, atol=1e-9)


def test_an_obstacle_popped_up_in_the_distance_that_was_asked_for(recorded):
    assert list(recorded.tick[recorded.pop_up]) == [60, 18]
    for k, P in zip(recorded.pop_up, recorded.pop_up_P):
        before, after = (stage_numbers(q).obstacles for q in (recorded.P[k], P))
        known = {(o.X[0], o.Y[0]) for o in before}
        new = [o for o in after if (o.X[0], o.Y[0]) not in known and o.r_obs[0] > 0]
        assert len(new) == 1
        x = State(*recorded.x0[k])
        away = np.hypot(new[0].X[0] - x.X, new[0].Y[0] - x.Y)
        assert 13 < away < 41


def test_a_pop_up_changes_nothing_but_the_obstacles(recorded):
    for k, P in zip(recorded.pop_up, recorded.pop_up_P):
        changed = np.any(recorded.P[k] != P, axis=0)
        names = {str(name) for name in recorded.parameters[changed]}
        assert names
        assert all(name.startswith('obstacles.') for name in names)


def test_loops_without_a_tick_for_a_pop_up_are_refused(small):
    one = closed_loops.FULL[0]._replace(ticks=range(1, 3))
    with pytest.raises(ValueError, match='no tick for a pop-up'):
        problems.record([one], small)


def test_activity_follows_the_plan_and_its_limits(recorded, problem):
    def found(given):
        return active_limits.find_active(problem, given, 1, 4)

    limits = recorded.bounds
    open_wide = {n: np.full_like(v, -np.inf if 'low' in n else np.inf) for n, v in vars_of(limits)}
    free = recorded._replace(bounds=limits._replace(**open_wide))
    active = found(free)
    assert active['obstacle'].any()
    assert not any(active[kind].any() for kind in ('friction', 'track', 'speed', 'actuator'))
    shut = {'g_high': np.full_like(limits.g_high, -np.inf)}
    active = found(free._replace(bounds=free.bounds._replace(**shut)))
    assert all(active[kind].all() for kind in ('friction', 'track'))
    slow = recorded.driven_X.copy()
    slow[:, 0, State._fields.index('vx')] = 1.0
    assert found(free._replace(driven_X=slow))['speed'].all()
    assert active_limits.demanding(active).all()
    steered = free.driven_X.max(axis=(0, 1)) + 1e-4
    held = free.bounds._replace(x_high=np.broadcast_to(steered, limits.x_high.shape))
    active = found(free._replace(bounds=held))
    assert active['actuator'].any()
    assert not active['friction'].any()


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
