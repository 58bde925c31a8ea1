"""One recorded tick, solved again, changed, and asked how it would answer to its weights."""

import re
from functools import cache

import numpy as np
import pytest
from closed_loops import fixed_weights

from bags.errors import BagError
from experiments import cli
from experiments.configuration import set_option
from experiments.configuration.set_option import Changes
from experiments.replay import (
    recorded_problem,
    recorded_ticks,
    replayed_controller,
    resolve,
)

from .conftest import GOLDEN

WEIGHTS = fixed_weights('mpcc')
BUSY = 45  # a tick whose plan runs into the safety zone of the first obstacle


@pytest.fixture(scope='module')
def posed(golden):
    """Return a function from controller and tick to the tick with its problem."""
    return cache(lambda name, tick: resolve.pose(golden(name), tick))


@pytest.fixture(scope='module')
def problem(golden, posed):
    """Return a problem with weights that do not depend on what ships."""
    params = replayed_controller.recorded_params(golden('mpcc').run_info, WEIGHTS, 'mpcc')
    return posed('mpcc', BUSY).problem.with_params(*params)


@pytest.fixture
def ask(golden, posed):
    """Return a function that asks about a tick."""

    def ask(name, tick=BUSY, parameters=None, factors=None):
        changes = Changes(parameters or {}, factors or {})
        return resolve.answer(golden(name), posed(name, tick), changes)

    return ask


@pytest.mark.parametrize(('name', 'tick'), [('mpcc', 0), ('mpcc', BUSY), ('frenet', 110)])
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


def test_a_changed_weight_or_formulation_changes_the_plan_and_none_nothing(ask):
    answer = ask('mpcc', factors={'con': 0.0})
    assert answer.solved.terms['con'] > 1e-3
    assert answer.changed.terms['con'] == answer.changed.weights['con'] == 0.0
    assert answer.changed.command != answer.solved.command
    # each is the best plan of its own problem, so without the term the other one's costs more
    assert answer.changed.cost < answer.solved.cost - answer.solved.terms['con']
    same = ask('frenet', parameters={'safety.edge_m': 0.5})
    assert same.changed.command == same.solved.command
    # half a tolerance is four times the weight
    by_parameter = ask('mpcc', parameters={'tolerances.brake_split': 0.158}).changed
    by_factor = ask('mpcc', factors={'lambda_b': 4.0}).changed
    assert by_parameter.weights == pytest.approx(by_factor.weights)
    assert by_parameter.command == pytest.approx(by_factor.command, rel=1e-9)
    frenet = {'name': 'frenet', 'distance': 'path', 'lag': False}
    answer = ask('mpcc', parameters={f'formulation.{name}': v for name, v in frenet.items()})
    assert answer.changed.is_feasible
    assert set(answer.changed.terms) - set(answer.solved.terms) == {'e', 'dpsi'}
    hurried = {'solver.max_iterations': 1, 'fallback.acceptable_residual': 1e-9}
    rejected = ask('mpcc', parameters=hurried).changed
    assert not rejected.is_feasible
    assert rejected.status == 'plan_not_feasible: iteration limit'


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'factors': {'lagg': 0.0}}, r"no such weight; there are con, lag.*; did you mean 'lag'"),
        ({'factors': {'lag': -1.0}}, 'allowed from 0'),
        ({'parameters': {'model.horizon': 40}}, 'cannot be changed in one tick'),
        ({'tick': -1}, r'no tick -1; it has 0 to 1\d\d$'),
    ],
)
def test_an_impossible_question_is_refused_with_the_reason(ask, changes, expected):
    with pytest.raises(BagError, match=expected):
        ask('mpcc', **changes)


def test_a_tick_without_a_solve_is_refused(golden):
    bag = golden('mpcc')
    (tick,) = recorded_ticks.read_ticks(bag, 1)
    blind = tick._replace(inputs=tick.inputs._replace(state=None))
    with pytest.raises(BagError, match='no problem was solved: braking: state_not_finite'):
        recorded_problem.pose(replayed_controller.from_run_info(bag.run_info, {}, 'mpcc'), blind)


def test_sensitivities_are_those_of_the_cost_and_predict_the_effect_of_a_weight(problem):
    found = resolve.find_sensitivities(problem)
    assert {one.weight for one in found} == set(problem.weights)
    large = [one for one in found if one.cost > 1e-3]
    assert len(large) >= 5
    for one in large:
        assert one.cost_difference == pytest.approx(one.cost, rel=1e-5)
    before = problem.solve().least_v2o
    by_weight = {one.weight: one.v2o for one in found}
    assert by_weight['v2o'] > 0 > by_weight['con']
    for name in ('v2o', 'con'):
        after = problem.scale_weights({name: 1.02}).solve().least_v2o
        assert after - before == pytest.approx(0.02 * by_weight[name], rel=0.05)
    # a weight of zero is not varied
    without = resolve.find_sensitivities(problem.scale_weights({'lag': 0.0}))
    assert {one.weight for one in without} == set(problem.weights) - {'lag'}


def test_a_limit_is_active_at_the_stages_where_the_plan_touches_it(ask):
    answer = ask('mpcc', parameters={**WEIGHTS, 'limits.steer_rate_radps': 0.1})
    assert not answer.solved.active
    rate = answer.changed.inputs['d_delta']
    for side, limit in (('lower', -0.1), ('upper', 0.1)):
        touched = set(np.flatnonzero(np.abs(rate - limit) < 1e-5).tolist())
        named = [one for one in answer.changed.active if one.quantity == 'd_delta']
        stages = {k for one in named if one.side == side for k in range(one.first, one.last + 1)}
        assert touched <= stages
        assert np.allclose(rate[[*stages]], limit, atol=1e-3)
        assert touched
    assert all(abs(one.limit) == 0.1 for one in named)


def test_limits_are_grouped_by_stage_and_side_and_infinite_ones_never_active():
    values = np.array([[1.0], [1.0], [0.0], [-1.0], [1.0]])
    push = np.array([[2.0], [3.0], [1e-9], [-4.0], [5.0]])
    bounds = 0 * values - 1, 0 * values + 1
    find = recorded_problem.find_active_limits
    found = [
        (one.side, one.first, one.last, one.multiplier, one.at)
        for one in find(('delta',), values, *bounds, push, np.ones(1), first=1)
    ]
    assert found == [('lower', 4, 4, 4.0, 4), ('upper', 1, 2, 3.0, 2), ('upper', 5, 5, 5.0, 5)]
    wide = values - np.inf, values + np.inf
    assert not list(find(('delta',), values, *wide, push, np.ones(1)))


def test_a_factor_that_is_no_number_is_refused():
    with pytest.raises(BagError, match=r'must be weights\.<term>=<factor>'):
        set_option.parse_tick_changes(['weights.lag=little'])


def test_the_command_prints_tables_that_fit_and_draws_the_horizon(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    settings = {**WEIGHTS, 'limits.steer_rate_radps': 0.1}
    changes = ['weights.lag=0', *(f'controller.{name}={v}' for name, v in settings.items())]
    changes = [word for change in changes for word in ('--set', change)]
    asked = ['resolve', str(GOLDEN / 'mpcc'), '--at', 'closest', *changes, '--sensitivities']
    assert cli.main([*asked, '--out', str(tmp_path)]) == 0
    text = capsys.readouterr().out
    first, *lines, _ = text.splitlines()
    assert re.match(r'tick \d+ .* least distance to obstacle ', first)
    assert 'the command is the recorded one' in text
    assert 'changed: lower limit of d_delta' in text
    assert '…' not in text
    assert max(map(len, lines)) <= 80
    tick = int(first.split()[1])
    for suffix in ('png', 'svg'):
        assert (tmp_path / f'mpcc_tick_{tick}.{suffix}').stat().st_size > 20_000


@pytest.fixture(scope='module')
def ticks(golden):
    """Return a function from a controller to its ticks, read once."""
    read = recorded_ticks.read_ticks
    return cache(lambda name: read(golden(name)))


@pytest.fixture
def choose(golden, ticks, monkeypatch):
    """Return choose(name, moment) -> the tick that is meant."""
    names = {str(golden(name).path): name for name in ('mpcc', 'mpcc_no_ca')}
    monkeypatch.setattr(recorded_ticks, 'read_ticks', lambda bag: ticks(names[str(bag.path)]))
    return lambda name='mpcc', **named: resolve.choose(golden(name), **named)


def gaps_of(ticks):
    """Return the least distance of the car's circle to an obstacle, of each tick."""
    return np.array(
        [
            min(np.hypot(o.X - s.X, o.Y - s.Y) - o.r_obs - 1.1 for o in obstacles.items)
            for s, obstacles in ((tick.inputs.state, tick.inputs.obstacles) for tick in ticks)
        ]
    )


def test_a_time_and_a_station_mean_the_last_tick_until_then(choose):
    assert [choose(time=t).number for t in (2.25, 2.299, 0.0)] == [45, 45, 0]
    assert choose(time=2.25).t == pytest.approx(2.25)
    chosen = choose(station=70.0)
    assert chosen.station <= 70.0 < choose(time=chosen.t + 0.05).station


def test_events_are_where_they_are_largest_or_nearest(choose, ticks):
    # the recording holds the states of the ticks alone
    gaps, states = gaps_of(ticks('mpcc')), [tick.inputs.state for tick in ticks('mpcc')]
    chosen = choose(event='closest')
    assert chosen.number == int(np.argmin(gaps))
    assert chosen.because == f'least distance to obstacle 1, {min(gaps):.2f} m'
    angles = [abs(np.arctan2(s.vy, s.vx)) for s in states]
    chosen = choose(event='sideslip')
    assert chosen.number == int(np.argmax(angles))
    assert f'{np.degrees(max(angles)):.1f} deg' in chosen.because
    assert choose(event='edge').because.startswith('least distance to the ')


def test_loss_is_a_second_before_the_car_was_lost_first(choose, ticks):
    chosen = choose('mpcc_no_ca', event='loss')
    assert re.match(r'1\.0 s before station \d+ m, where it collided with obs', chosen.because)
    assert np.argmax(gaps_of(ticks('mpcc_no_ca')) < 0.0) - chosen.number in (20, 21)


@pytest.mark.parametrize(
    ('named', 'text'),
    [
        ({'event': 'loss'}, 'the car neither collided nor left the road nor slid'),
        ({'station': -50.0}, 'no tick at station -50 m; it has '),
        ({'event': 'fallback'}, 'every tick followed a fresh plan'),
    ],
)
def test_what_the_recording_does_not_have_is_refused_with_what_it_has(choose, named, text):
    with pytest.raises(BagError, match=text):
        choose(**named)
