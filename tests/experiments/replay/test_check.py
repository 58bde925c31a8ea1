"""What counts as a difference, and what a recording cannot repeat."""

import numpy as np
import pytest

from experiments.replay import check, recorded_ticks, replayed_controller
from mpcc_controller import run_time_parameters
from msgs_yaml.types import Command, Prediction, Why

from .conftest import in_mode

STAMP = 1_000_000_000


def why(**values):
    return Why(STAMP, 0, 'solved', values)


def differing(pairs):
    return [pair.field for pair in pairs if pair.differs]


def test_a_command_may_differ_by_a_millionth_of_its_unit():
    one = Command(STAMP, 0.1, 0.2, -300.0, 400.0)
    assert differing(check.pair_commands(one, one._replace(Fxr=400.0 + 9e-7))) == []
    assert differing(check.pair_commands(one, one._replace(Fxr=400.0 + 2e-6))) == ['command.Fxr']
    assert differing(check.pair_commands(one, one._replace(delta=np.nan))) == ['command.delta']


@pytest.mark.parametrize(
    ('change', 'found'),
    [
        ({'time.solve_ms': 9.0}, []),
        ({'candidates.1.cpu_ms': 9.0}, []),
        ({'rung': 'braking'}, ['rung']),
        ({'cost.con': 20.00003}, ['cost.con']),
        ({'cost.con': 20.00001}, []),
    ],
)
def test_all_values_of_a_report_are_compared_except_times(change, found):
    one = why(rung='solved', **{'cost.con': 20.0, 'time.solve_ms': 1.0})
    assert differing(check.pair_reports(one, why(**one.values | change))) == found


@pytest.mark.parametrize('turned', [False, True])
def test_a_value_that_only_one_of_them_has_is_a_difference(turned):
    pair = why(guide='plan'), why()
    assert differing(check.pair_reports(*(reversed(pair) if turned else pair))) == ['guide']


def test_plans_are_compared_where_they_differ_most():
    still = np.zeros(3)
    one = Prediction(STAMP, still, still, still, still)
    other = one._replace(Y=np.array([0.0, -2e-6, 1e-6]))
    (found,) = [pair for pair in check.pair_predictions(one, other) if pair.differs]
    assert (found.field, found.replayed) == ('prediction.Y', -2e-6)
    shorter = one._replace(X=still[:1])
    assert differing(check.pair_predictions(one, shorter)) == ['prediction.stages']


@pytest.fixture
def ticks(mpcc):
    return recorded_ticks.read_ticks(mpcc)


@pytest.fixture
def replayed(mpcc):
    """Return a function from settings to the controller of the recording."""
    return lambda **settings: replayed_controller.from_run_info(mpcc.run_info, settings, 'mpcc')


def test_a_replay_by_the_wall_clock_gives_the_same_answers(mpcc):
    report = check.check(in_mode(mpcc, 'realtime'), {})
    assert not report.failures
    assert report.repeatable == len(report.ticks)


def test_a_tick_decided_by_the_clock_and_those_after_it_are_no_failures(ticks, replayed):
    one = ticks[60]
    late = one.why._replace(values=one.why.values | {'solver.message': recorded_ticks.TIME_LIMIT})
    ticks[60] = one._replace(gaps=tuple(recorded_ticks.find_gaps(late, one.command)))
    compared = check.compare_ticks(ticks, replayed(**{'tolerances.lag_m': 0.4}))
    assert [one.tick.number for one in compared if one.gap] == list(range(60, 60 + check.SHADOW))
    assert 'time limit' in compared[60].gap


def test_a_lost_command_is_a_gap_and_the_replay_continues_from_its_own_answer(ticks, replayed):
    gaps = tuple(recorded_ticks.find_gaps(ticks[30].why, None))
    ticks[30] = ticks[30]._replace(command=None, gaps=gaps)
    compared = check.compare_ticks(ticks, replayed())
    assert 'lost' in compared[30].gap
    assert not any(one.differing for one in compared)


def test_a_tick_that_braked_because_of_an_old_input_is_repeated(ticks, replayed):
    recorder, ticks = replayed(), ticks[:40]
    for k, tick in enumerate(ticks):
        fault = 'obstacles_stale' if k in (20, 21) else ''
        command, plan, why = recorder.step(tick.inputs._replace(fault=fault), tick.stamp_ns)
        recorder.continue_from(command)
        inputs = tick.inputs._replace(fault=recorded_ticks.stale_input(why))
        ticks[k] = tick._replace(command=command, prediction=plan, why=why, inputs=inputs)
    rungs = [one.why.values['rung'] for one in ticks[19:23]]
    assert rungs == ['solved', 'braking', 'braking', 'solved']
    faults = [one.inputs.fault for one in ticks[19:23]]
    assert faults == ['', 'obstacles_stale', 'obstacles_stale', '']
    assert not any(one.differing for one in check.compare_ticks(ticks, replayed()))


def test_a_replay_uses_the_weights_and_limits_that_were_in_force_at_each_tick(ticks, replayed):
    recorder, ticks = replayed(), ticks[:40]
    later = {'tolerances.contouring_m': 0.2, 'limits.friction_use': 0.7}
    for k, tick in enumerate(ticks):
        # a controller that was started again in tick 30 has the values of the start
        inputs = tick.inputs._replace(changes=later if 15 <= k < 30 else {})
        command, plan, why = recorder.step(inputs, tick.stamp_ns)
        recorder.continue_from(command)
        inputs = inputs._replace(changes=run_time_parameters.reported(why.values))
        ticks[k] = tick._replace(command=command, prediction=plan, why=why, inputs=inputs)
    assert [bool(tick.inputs.changes) for tick in ticks] == [15 <= k < 30 for k in range(40)]
    assert ticks[20].why.values['weight.con'] == pytest.approx(25.0)
    assert not any(one.differing for one in check.compare_ticks(ticks, replayed()))
    unaware = [tick._replace(inputs=tick.inputs._replace(changes={})) for tick in ticks]
    differing = [
        one.tick.number for one in check.compare_ticks(unaware, replayed()) if one.differing
    ]
    assert differing[0] == 15


def test_a_parameter_that_is_set_for_a_replay_wins_over_what_the_run_changed(ticks, replayed):
    tick = ticks[0]._replace(inputs=ticks[0].inputs._replace(changes={'tolerances.lag_m': 0.2}))
    controller = replayed(**{'tolerances.lag_m': 0.8})
    _, _, why = controller.step(tick.inputs, tick.stamp_ns)
    assert why.values['weight.lag'] == pytest.approx(0.8**-2)
