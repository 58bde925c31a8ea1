"""Every fallback level, forced in the controller with its reason."""

import numpy as np
import pytest

from mpcc_controller.driving import solver_selection, tick_solvers
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import BRAKING, SECOND_SOLVER, SHIFTED
from mpcc_controller.driving.tick import TickInputs, unknown_state
from msgs_yaml import conformance, encode
from stage_solver.solution import FAILED, SOLVED, STOPPED_EARLY

TICK = 50_000_000


def fail(solution):
    return solution._replace(status=FAILED)


def not_finite(solution):
    return solution._replace(plan=solution.plan._replace(U=solution.plan.U * np.nan))


def rough(solution):
    return solution._replace(status=STOPPED_EARLY, primal_residual=0.5)


def early(solution):
    return solution._replace(status=STOPPED_EARLY, primal_residual=1e-5)


def level_and_reason(controller, x):
    record = controller.step(TickInputs(x))
    _, why = controller.report(record)
    return why.values['rung'], why.values['reason']


def test_level_1_a_converged_plan(controller, world):
    assert level_and_reason(controller, world.rolling(X=25.0)) == (SOLVED, 'converged')


def test_level_2_a_plan_stopped_early_that_is_good_enough(controller, world, modify_solver):
    modify_solver(early)
    assert level_and_reason(controller, world.rolling(X=25.0)) == (STOPPED_EARLY, 'good_enough')


@pytest.mark.parametrize(
    ('modify', 'reason'),
    [(fail, 'solver_failed'), (not_finite, 'plan_not_finite'), (rough, 'plan_not_feasible')],
)
def test_level_3_the_plan_of_the_second_solver(controller, world, modify_solver, modify, reason):
    modify_solver(modify)
    modify_solver(lambda s: s._replace(solve_s=0.03, cpu_s=0.02, iterations=7), 'second')
    command, _, why = world.tick(controller, world.rolling(X=25.0))
    v = why.values
    assert (v['rung'], v['reason']) == (SECOND_SOLVER, reason)
    assert (v['fallback.status'], v['fallback.iterations']) == (SOLVED, 7)
    assert v['plan.failures'] == 1
    # its time is part of the solve time and is reported separately
    assert v['time.fallback_ms'] == pytest.approx(30.0)
    first = controller.planner.solvers.first.solutions[-1]
    assert v['time.solve_ms'] == pytest.approx(30.0 + 1e3 * first.solve_s)
    assert v['time.solve_cpu_ms'] == pytest.approx(20.0 + 1e3 * first.cpu_s)
    plan = controller.planner.solvers.second.solutions[-1].plan
    assert command.delta == plan.X[1, 7]
    assert 'cost.total' in v


def test_the_second_solver_runs_only_after_a_failure_of_the_first(controller, world, modify_solver):
    second = modify_solver(lambda s: s, 'second')
    *_, why = world.tick(controller, world.rolling(X=25.0))
    assert not second.guesses
    assert not any(name.startswith(('fallback.', 'time.fallback')) for name in why.values)


def test_the_second_solver_differs_from_the_first_or_there_is_none(world):
    params, vehicle = world.load(
        solver__name='fatrop', solver__fallback='fatrop', solver__compiled=False
    )
    assert Controller(params, vehicle).planner.solvers.second is None
    params, vehicle = world.load(
        solver__name='ipopt', solver__fallback='fatrop', solver__compiled=False
    )
    controller = world.set_inputs(Controller(params, vehicle), world.lane_change())
    controller.planner.solvers.first = world.ModifiedSolver(controller.planner.solvers.first, fail)
    assert level_and_reason(controller, world.rolling(X=25.0)) == (SECOND_SOLVER, 'solver_failed')
    params, vehicle = world.load(
        solver__name='ipopt', solver__fallback='none', solver__compiled=False
    )
    assert Controller(params, vehicle).planner.solvers.second is None


def test_both_solvers_share_the_time_limit_of_the_fallback(world, monkeypatch):
    solver_options = []

    def make(problem, options):
        solver_options.append(options)
        return options  # has the name of the solver

    for module in (tick_solvers, solver_selection):
        monkeypatch.setattr(module, 'make_solver', make)
    params, vehicle = world.load(solver__name='ipopt')
    Controller(params, vehicle, limit_time=True)
    Controller(params, vehicle)
    assert [(options.name, options.time_limit_s) for options in solver_options] == [
        ('ipopt', 0.02),
        ('fatrop', pytest.approx(0.02)),
        ('ipopt', None),
        ('fatrop', None),
    ]


def test_a_solver_that_raises_counts_as_failed(controller, world, modify_solver):
    def raise_(solution):
        raise RuntimeError('nobody expected this')

    world.tick(controller, world.rolling(X=25.0))
    modify_solver(raise_)
    *_, why = world.tick(controller, world.rolling(X=26.0, stamp_ns=TICK))
    v = why.values
    assert (v['rung'], v['reason']) == (SHIFTED, 'solver_failed')
    assert v['solver.message'] == 'nobody expected this'
    assert not conformance.check('/controller/why', encode.why(why))


def test_level_4_the_shifted_plan_for_five_ticks_then_level_5_braking(
    controller, world, modify_solver
):
    x = world.rolling(X=25.0)
    world.tick(controller, x)
    planned = controller.planner.fallback.plan.X[:, 7]
    modify_solver(fail)
    decisions, commands, whys = [], [], []
    for k in range(1, 8):
        command, _, why = world.tick(controller, x._replace(stamp_ns=k * TICK))
        decisions.append((why.values['rung'], why.values['reason'], why.values['plan.age']))
        commands.append(command)
        whys.append(why.values)
    assert decisions[:5] == [(SHIFTED, 'solver_failed', age) for age in range(1, 6)]
    assert decisions[5:] == [(BRAKING, 'solver_failed', 0)] * 2
    assert [c.delta for c in commands[:5]] == pytest.approx(planned[2:7], abs=1e-9)
    assert [v.get('guide') for v in whys] == [None] * 5 + ['plan'] * 2
    assert commands[6].Fxf + commands[6].Fxr < commands[5].Fxf + commands[5].Fxr < 0
    assert not controller.gate.rejections


def test_level_5_without_a_plan_the_car_brakes_along_the_path(controller, world, modify_solver):
    modify_solver(fail)
    command, prediction, why = world.tick(controller, world.rolling(X=45.0, Y=-0.5))
    assert (why.values['rung'], why.values['guide']) == (BRAKING, 'path')
    assert command.delta > 0.005  # back to the path, which bends to the left
    assert command.Fxf + command.Fxr < 0
    assert len(prediction.X) == 1


def test_level_5_switches_to_the_path_when_the_last_plan_is_too_old(
    controller, world, modify_solver, monkeypatch
):
    world.tick(controller, world.rolling(X=25.0))
    modify_solver(fail)
    lookahead_lines = []
    for k in range(1, 34):
        x = world.rolling(X=25.0 + 0.2 * k, stamp_ns=k * TICK)
        lookahead_lines.append(world.tick(controller, x)[2].values.get('guide'))
    oldest = controller.params.fallback.max_guide_age
    assert lookahead_lines == [None] * 5 + ['plan'] * (oldest - 5) + ['path'] * (33 - oldest)


@pytest.mark.parametrize('missing_input', ['path', 'road', 'obstacles'])
def test_level_5_the_reason_names_the_missing_input(controller, world, missing_input):
    controller.scene = controller.scene._replace(**{missing_input: None})
    command, prediction, why = world.tick(controller, world.rolling(X=25.0))
    assert (why.values['rung'], why.values['reason']) == (BRAKING, f'no_{missing_input}')
    assert why.values['guide'] == ('none' if missing_input == 'path' else 'path')
    assert command.Fxf < 0
    assert len(prediction.X) == 1


def test_level_5_a_car_that_is_too_slow_still_steers_and_reports_its_distances(controller, world):
    world.tick(controller, world.rolling(v=7.2, X=60.0, Y=2.0, psi=0.1))
    x = world.rolling(v=6.0, X=60.3, Y=2.0, psi=0.1, stamp_ns=TICK)
    command, _, why = world.tick(controller, x)
    assert (why.values['rung'], why.values['reason']) == (BRAKING, 'too_slow')
    assert why.values['guide'] == 'plan'
    assert command.delta != 0
    gap = np.hypot(x.X - 72.0, x.Y - 1.5) - 1.0 - 1.1
    assert why.values['v2o.1'] == pytest.approx(gap, abs=1e-5)
    assert why.values['v2e.left'] == pytest.approx(6.0 - 2.0 - 1.1, abs=1e-3)
    assert why.values['v2e.right'] == pytest.approx(2.0 + 2.5 - 1.1, abs=1e-3)
    assert why.values['set_point.delta'] == pytest.approx(controller.active_ramp.begin.delta)


def test_level_5_past_the_end_of_the_path_the_car_brakes_straight_ahead(controller, world):
    X, Y = (column[-1] for column in controller.scene.path.arcs[:2])
    before = world.tick(controller, world.rolling(X=X - 1.0, Y=Y))[2]
    assert before.values['rung'] == 'solved'
    command, _, why = world.tick(controller, world.rolling(X=X + 1.0, Y=Y, stamp_ns=TICK))
    assert (why.values['rung'], why.values['reason']) == (BRAKING, 'path_ended')
    assert command.Fxf < 0
    assert abs(command.delta) < 0.01


def test_without_a_finite_state_the_plan_is_followed_for_five_ticks_then_braked_along(
    controller, world
):
    world.tick(controller, world.rolling(X=40.0))
    planned = controller.planner.fallback.plan.X[:, 7]
    commands, decisions = [], []
    for k in range(1, 8):
        command, prediction, why = world.tick(controller, unknown_state(k * TICK))
        commands.append(command)
        decisions.append((why.values['rung'], why.values['reason'], why.values.get('guide')))
        assert np.isfinite(command).all()
        assert len(prediction.X) == (51 if k <= 5 else 1)
        assert not conformance.check('/controller/why', encode.why(why))
    assert decisions[:5] == [(SHIFTED, 'state_not_finite', None)] * 5
    assert decisions[5:] == [(BRAKING, 'state_not_finite', 'plan')] * 2
    assert [c.delta for c in commands[:5]] == pytest.approx(planned[2:7], abs=1e-9)
    # with a state again, it drives on
    assert level_and_reason(controller, world.rolling(X=47.0, stamp_ns=8 * TICK))[0] == SOLVED


def test_a_state_that_returns_in_time_keeps_the_warm_start(controller, world):
    world.tick(controller, world.rolling(X=40.0))
    world.tick(controller, unknown_state(TICK))
    *_, why = world.tick(controller, world.rolling(X=42.0, stamp_ns=2 * TICK))
    assert why.values['rung'] == SOLVED
    assert why.values['solver.warm']
    assert (why.values['plan.age'], why.values['plan.failures']) == (0, 0)
