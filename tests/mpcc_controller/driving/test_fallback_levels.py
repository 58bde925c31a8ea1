"""Every rung of the ladder, forced in the controller with its reason."""

import numpy as np
import pytest

from mpcc_controller.driving import planner, solver_selection
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


def told(controller, x):
    record = controller.step(TickInputs(x))
    _, why = controller.report(record)
    return why.values['rung'], why.values['reason']


def test_rung_1_a_converged_plan(changing, world):
    assert told(changing, world.rolling(X=25.0)) == (SOLVED, 'converged')


def test_rung_2_an_early_stop_that_is_good_enough(changing, world, spoilt):
    spoilt(early)
    assert told(changing, world.rolling(X=25.0)) == (STOPPED_EARLY, 'good_enough')


@pytest.mark.parametrize(
    ('spoil', 'reason'),
    [(fail, 'solver_failed'), (not_finite, 'plan_not_finite'), (rough, 'plan_not_feasible')],
)
def test_rung_3_the_second_solver_s_plan(changing, world, spoilt, spoil, reason):
    spoilt(spoil)
    spoilt(lambda s: s._replace(solve_s=0.03, cpu_s=0.02, iterations=7), 'second_solver')
    command, _, why = world.tick(changing, world.rolling(X=25.0))
    v = why.values
    assert (v['rung'], v['reason']) == (SECOND_SOLVER, reason)
    assert (v['fallback.status'], v['fallback.iterations']) == (SOLVED, 7)
    assert v['plan.failures'] == 1
    # its time counts, and its share is told
    assert v['time.fallback_ms'] == pytest.approx(30.0)
    first = changing.planner.first_solver.solutions[-1]
    assert v['time.solve_ms'] == pytest.approx(30.0 + 1e3 * first.solve_s)
    assert v['time.solve_cpu_ms'] == pytest.approx(20.0 + 1e3 * first.cpu_s)
    plan = changing.planner.second_solver.solutions[-1].plan
    assert command.delta == plan.X[1, 7]
    assert 'cost.total' in v


def test_the_second_solver_is_asked_only_after_a_failure(changing, world, spoilt):
    second = spoilt(lambda s: s, 'second_solver')
    *_, why = world.tick(changing, world.rolling(X=25.0))
    assert not second.guesses
    assert not any(name.startswith(('fallback.', 'time.fallback')) for name in why.values)


def test_the_second_solver_is_another_one_or_there_is_none(world):
    params, vehicle = world.load(
        solver__name='fatrop', solver__fallback='fatrop', solver__compiled=False
    )
    assert Controller(params, vehicle).planner.second_solver is None
    params, vehicle = world.load(
        solver__name='ipopt', solver__fallback='fatrop', solver__compiled=False
    )
    made = world.tell(Controller(params, vehicle), world.lane_change())
    made.planner.first_solver = world.Spoilt(made.planner.first_solver, fail)
    assert told(made, world.rolling(X=25.0)) == (SECOND_SOLVER, 'solver_failed')
    params, vehicle = world.load(
        solver__name='ipopt', solver__fallback='none', solver__compiled=False
    )
    assert Controller(params, vehicle).planner.second_solver is None


def test_both_solvers_together_have_the_time_of_the_fallback(world, monkeypatch):
    made = []

    def make(problem, options):
        made.append(options)
        return options  # has the name of the solver

    for module in (planner, solver_selection):
        monkeypatch.setattr(module, 'make_solver', make)
    params, vehicle = world.load(solver__name='ipopt')
    Controller(params, vehicle, limit_time=True)
    Controller(params, vehicle)
    assert [(one.name, one.time_limit_s) for one in made] == [
        ('ipopt', 0.02),
        ('fatrop', pytest.approx(0.02)),
        ('ipopt', None),
        ('fatrop', None),
    ]


def test_a_solver_that_raises_has_failed(changing, world, spoilt):
    def raise_(solution):
        raise RuntimeError('nobody expected this')

    world.tick(changing, world.rolling(X=25.0))
    spoilt(raise_)
    *_, why = world.tick(changing, world.rolling(X=26.0, stamp_ns=TICK))
    v = why.values
    assert (v['rung'], v['reason']) == (SHIFTED, 'solver_failed')
    assert v['solver.message'] == 'nobody expected this'
    assert not conformance.check('/controller/why', encode.why(why))


def test_rung_4_the_last_plan_moved_on_for_five_ticks_then_rung_5_braking(changing, world, spoilt):
    x = world.rolling(X=25.0)
    world.tick(changing, x)
    planned = changing.planner.fallback.plan.X[:, 7]
    spoilt(fail)
    seen, commands, whys = [], [], []
    for k in range(1, 8):
        command, _, why = world.tick(changing, x._replace(stamp_ns=k * TICK))
        seen.append((why.values['rung'], why.values['reason'], why.values['plan.age']))
        commands.append(command)
        whys.append(why.values)
    assert seen[:5] == [(SHIFTED, 'solver_failed', age) for age in range(1, 6)]
    assert seen[5:] == [(BRAKING, 'solver_failed', 0)] * 2
    assert [c.delta for c in commands[:5]] == pytest.approx(planned[2:7], abs=1e-9)
    assert [v.get('guide') for v in whys] == [None] * 5 + ['plan'] * 2
    assert commands[6].Fxf + commands[6].Fxr < commands[5].Fxf + commands[5].Fxr < 0
    assert not changing.gate.rejections


def test_rung_5_without_any_plan_the_car_brakes_along_the_path(changing, world, spoilt):
    spoilt(fail)
    command, prediction, why = world.tick(changing, world.rolling(X=45.0, Y=-0.5))
    assert (why.values['rung'], why.values['guide']) == (BRAKING, 'path')
    assert command.delta > 0.005  # back to the path, which bends to the left
    assert command.Fxf + command.Fxr < 0
    assert len(prediction.X) == 1


def test_rung_5_goes_over_to_the_path_when_the_last_plan_is_too_old(
    changing, world, spoilt, monkeypatch
):
    world.tick(changing, world.rolling(X=25.0))
    spoilt(fail)
    guides = []
    for k in range(1, 34):
        x = world.rolling(X=25.0 + 0.2 * k, stamp_ns=k * TICK)
        guides.append(world.tick(changing, x)[2].values.get('guide'))
    oldest = changing.params.fallback.max_guide_age
    assert guides == [None] * 5 + ['plan'] * (oldest - 5) + ['path'] * (33 - oldest)


@pytest.mark.parametrize('told_later', ['path', 'road', 'obstacles'])
def test_rung_5_whatever_is_missing_is_named(changing, world, told_later):
    changing.scene = changing.scene._replace(**{told_later: None})
    command, prediction, why = world.tick(changing, world.rolling(X=25.0))
    assert (why.values['rung'], why.values['reason']) == (BRAKING, f'no_{told_later}')
    assert why.values['guide'] == ('none' if told_later == 'path' else 'path')
    assert command.Fxf < 0
    assert len(prediction.X) == 1


def test_rung_5_too_slow_still_steers_and_tells_its_distances(changing, world):
    world.tick(changing, world.rolling(v=7.2, X=60.0, Y=2.0, psi=0.1))
    x = world.rolling(v=6.0, X=60.3, Y=2.0, psi=0.1, stamp_ns=TICK)
    command, _, why = world.tick(changing, x)
    assert (why.values['rung'], why.values['reason']) == (BRAKING, 'too_slow')
    assert why.values['guide'] == 'plan'
    assert command.delta != 0
    gap = np.hypot(x.X - 72.0, x.Y - 1.5) - 1.0 - 1.1
    assert why.values['v2o.1'] == pytest.approx(gap, abs=1e-5)
    assert why.values['v2e.left'] == pytest.approx(6.0 - 2.0 - 1.1, abs=1e-3)
    assert why.values['v2e.right'] == pytest.approx(2.0 + 2.5 - 1.1, abs=1e-3)
    assert why.values['set_point.delta'] == pytest.approx(changing.active_ramp.begin.delta)


def test_rung_5_past_the_end_of_the_path_the_car_brakes_straight_on(changing, world):
    X, Y = (column[-1] for column in changing.scene.path.arcs[:2])
    before = world.tick(changing, world.rolling(X=X - 1.0, Y=Y))[2]
    assert before.values['rung'] == 'solved'
    command, _, why = world.tick(changing, world.rolling(X=X + 1.0, Y=Y, stamp_ns=TICK))
    assert (why.values['rung'], why.values['reason']) == (BRAKING, 'path_ended')
    assert command.Fxf < 0
    assert abs(command.delta) < 0.01


def test_an_unknown_state_follows_the_plan_blindly_for_five_ticks_then_brakes_straight(
    changing, world
):
    world.tick(changing, world.rolling(X=40.0))
    planned = changing.planner.fallback.plan.X[:, 7]
    commands, seen = [], []
    for k in range(1, 8):
        command, prediction, why = world.tick(changing, unknown_state(k * TICK))
        commands.append(command)
        seen.append((why.values['rung'], why.values['reason'], why.values.get('guide')))
        assert np.isfinite(command).all()
        assert len(prediction.X) == (51 if k <= 5 else 0)
        assert not conformance.check('/controller/why', encode.why(why))
    assert seen[:5] == [(SHIFTED, 'state_not_finite', None)] * 5
    assert seen[5:] == [(BRAKING, 'state_not_finite', 'none')] * 2
    assert [c.delta for c in commands[:5]] == pytest.approx(planned[2:7], abs=1e-9)
    assert abs(commands[6].delta) <= abs(commands[5].delta)
    # seen again, it drives on
    assert told(changing, world.rolling(X=47.0, stamp_ns=8 * TICK))[0] == SOLVED


def test_a_state_that_comes_back_in_time_finds_its_warm_start(changing, world):
    world.tick(changing, world.rolling(X=40.0))
    world.tick(changing, unknown_state(TICK))
    *_, why = world.tick(changing, world.rolling(X=42.0, stamp_ns=2 * TICK))
    assert why.values['rung'] == SOLVED
    assert why.values['solver.warm']
    assert (why.values['plan.age'], why.values['plan.failures']) == (0, 0)
