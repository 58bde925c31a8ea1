"""One recorded tick, solved again, changed, and asked how it would answer to its weights."""

from functools import cache

import numpy as np
import pytest

from bags.errors import BagError
from experiments import cli
from experiments.configuration import set_option
from experiments.configuration.set_option import Changes
from experiments.replay import recorded_problem, recorded_ticks, replayed_controller, resolve
from experiments.replay.resolve import Request

from .conftest import GOLDEN

BUSY = 45  # a tick whose plan runs into the safety zone of the first obstacle


@pytest.fixture(scope='module')
def posed_(golden):
    """Return a function from controller and tick to the tick with its problem."""
    return cache(lambda name, tick: resolve.pose(golden(name), tick))


@pytest.fixture(scope='module')
def problem(posed_):
    return posed_('mpcc', BUSY).problem


@pytest.fixture
def ask(golden, posed_):
    """Return a function that asks about a tick."""

    def ask(name, tick=BUSY, parameters=None, factors=None):
        changes = Changes(parameters or {}, factors or {})
        return resolve.answer(golden(name), posed_(name, tick), Request(tick, changes, False))

    return ask


@pytest.mark.parametrize(
    ('name', 'tick'), [('mpcc', 0), ('mpcc', BUSY), ('mpcc_no_ca', BUSY), ('frenet', 110)]
)
def test_solved_again_a_tick_gives_its_command_and_its_cost(ask, name, tick):
    answer = ask(name, tick)
    assert answer.is_same
    assert answer.chain == 0
    recorded = answer.tick.why.values
    assert answer.solved.iterations == recorded['solver.iterations']
    for term, value in answer.solved.terms.items():
        assert value == pytest.approx(recorded[f'cost.{term}'], rel=1e-6, abs=1e-9)
    for one in answer.solved.distances:
        kind, _, which = one.name.rpartition(' ')
        least = f'v2o.{which}.least' if kind == 'obstacle' else f'v2e.{one.name[:-5]}.least'
        assert np.min(one.D) == pytest.approx(recorded[least], abs=1e-6)


def test_a_weight_that_is_switched_off_costs_nothing_and_changes_the_plan(ask):
    answer = ask('mpcc', factors={'lag': 0.0})
    assert answer.solved.terms['lag'] > 0.1
    assert answer.changed.terms['lag'] == answer.changed.weights['lag'] == 0.0
    assert answer.changed.command != answer.solved.command
    # each is the best plan of its own problem, so without the term the other one's costs more
    rest = answer.solved.cost - answer.solved.terms['lag']
    assert answer.changed.cost < rest


def test_a_parameter_that_is_set_to_what_it_was_changes_nothing(ask):
    answer = ask('frenet', parameters={'tolerances.contouring_m': 0.5})
    assert answer.changed.command == answer.solved.command


def test_half_a_tolerance_is_four_times_the_weight(ask):
    by_parameter = ask('mpcc', parameters={'tolerances.lag_m': 0.25}).changed
    by_factor = ask('mpcc', factors={'lag': 4.0}).changed
    assert by_parameter.weights == pytest.approx(by_factor.weights)
    assert by_parameter.command == pytest.approx(by_factor.command, rel=1e-9)


def test_a_tick_can_be_solved_with_the_other_formulation(ask):
    frenet = {
        'formulation.name': 'frenet',
        'formulation.distance': 'path',
        'formulation.lag': False,
    }
    answer = ask('mpcc', parameters=frenet)
    assert answer.changed.is_feasible
    assert set(answer.changed.terms) - set(answer.solved.terms) == {'e', 'dpsi'}


def test_a_plan_that_is_rejected_is_reported_as_infeasible(ask):
    hurried = {
        'solver.max_iterations': 1,
        'fallback.acceptable_residual': 1e-9,
    }
    answer = ask('mpcc', parameters=hurried)
    assert not answer.changed.is_feasible
    assert answer.changed.status == 'plan_not_feasible: iteration limit'


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        (
            {'factors': {'lagg': 0.0}},
            r"weights\.lagg: no such weight; there are con, lag.*; did you mean 'lag'",
        ),
        ({'factors': {'lag': -1.0}}, 'allowed from 0'),
        ({'parameters': {'model.horizon': 40}}, 'cannot be changed in one tick'),
    ],
)
def test_an_impossible_change_is_refused_with_the_reason(ask, changes, expected):
    with pytest.raises(BagError, match=expected):
        ask('mpcc', **changes)


@pytest.mark.parametrize('tick', [400, -1])
def test_a_tick_that_the_bag_does_not_have_is_refused(golden, tick):
    with pytest.raises(BagError, match=f'no tick {tick}; it has 0 to 161'):
        resolve.pose(golden('mpcc'), tick)


def test_a_tick_without_a_solve_is_refused(golden):
    bag = golden('mpcc')
    (tick,) = recorded_ticks.read_ticks(bag, 1)
    blind = tick._replace(inputs=tick.inputs._replace(state=None))
    with pytest.raises(BagError, match='no problem was solved: braking: state_not_finite'):
        recorded_problem.pose(replayed_controller.from_run_info(bag.run_info, {}, 'mpcc'), blind)


def test_the_sensitivity_of_the_cost_to_a_weight_equals_its_term(problem):
    found = resolve.find_sensitivities(problem)
    assert {one.weight for one in found} == set(problem.weights)
    large = [one for one in found if one.cost > 1e-3]
    assert len(large) >= 5
    for one in large:
        assert one.cost_difference == pytest.approx(one.cost, rel=1e-5)


def test_the_sensitivity_of_the_distance_predicts_the_effect_of_a_weight(problem):
    before = problem.solve().least_v2o
    by_weight = {one.weight: one.v2o for one in resolve.find_sensitivities(problem)}
    assert by_weight['v2o'] > 0 > by_weight['con']
    for name in ('v2o', 'con'):
        after = problem.scale_weights({name: 1.02}).solve().least_v2o
        assert after - before == pytest.approx(0.02 * by_weight[name], rel=0.05)


def test_a_weight_of_zero_is_not_varied(problem):
    assert 'lag' not in [
        one.weight for one in resolve.find_sensitivities(problem.scale_weights({'lag': 0.0}))
    ]


def test_a_limit_is_active_at_the_stages_where_the_plan_touches_it(ask):
    answer = ask('mpcc', parameters={'limits.steer_rate_radps': 0.2})
    assert not answer.solved.active
    rate = answer.changed.inputs['d_delta']
    for side, limit in (('lower', -0.2), ('upper', 0.2)):
        touched = set(np.flatnonzero(np.abs(rate - limit) < 1e-5).tolist())
        named = [one for one in answer.changed.active if one.quantity == 'd_delta']
        stages = {k for one in named if one.side == side for k in range(one.first, one.last + 1)}
        assert stages == touched
        assert stages
    assert all(abs(one.limit) == 0.2 for one in named)


def test_limits_are_grouped_by_stage_and_side():
    values = np.array([[1.0], [1.0], [0.0], [-1.0], [1.0]])
    push = np.array([[2.0], [3.0], [1e-9], [-4.0], [5.0]])
    group = recorded_problem.LimitGroup(
        ('delta',), values, 0 * values - 1, 0 * values + 1, push, np.ones(1), first=1
    )
    found = [
        (one.side, one.first, one.last, one.multiplier, one.at)
        for one in recorded_problem.find_active_limits(group)
    ]
    assert found == [('lower', 4, 4, 4.0, 4), ('upper', 1, 2, 3.0, 2), ('upper', 5, 5, 5.0, 5)]


def test_an_infinite_limit_is_never_active():
    still = np.zeros((3, 1))
    group = recorded_problem.LimitGroup(
        ('X',), still, still - np.inf, still + np.inf, still + 1, np.ones(1)
    )
    assert not list(recorded_problem.find_active_limits(group))


@pytest.mark.parametrize('text', ['weights.lag', 'weights.lag=little', 'weights.lag='])
def test_a_factor_that_is_no_number_is_refused(text):
    with pytest.raises(BagError, match=r'must be weights\.<term>=<factor>'):
        set_option.parse_tick_changes([text])


def test_the_command_prints_tables_that_fit_and_draws_the_horizon(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    changes = ['--set', 'weights.lag=0', '--set', 'controller.limits.steer_rate_radps=0.2']
    asked = ['resolve', str(GOLDEN / 'mpcc'), '--tick', str(BUSY), *changes, '--sensitivities']
    assert cli.main([*asked, '--out', str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert 'the command is the recorded one' in text
    assert 'changed: lower limit of d_delta' in text
    assert '…' not in text
    assert max(map(len, text.splitlines()[:-1])) <= 80
    for suffix in ('png', 'svg'):
        assert (tmp_path / f'mpcc_tick_{BUSY}.{suffix}').stat().st_size > 20_000
