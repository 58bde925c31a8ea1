"""Recordings are answered again as they were, whatever of them is lost, torn or foreign."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

from bags.errors import BagError, OlderRunWarning
from bags.storage import message_filing, read
from experiments import cli
from experiments.configuration import set_option
from experiments.replay import check, recorded_ticks, replayed_controller
from experiments.replay.recorded_ticks import (
    COMMAND,
    EDGES,
    OBSTACLES,
    REFERENCE,
    STATE,
    STOP_PLAN,
    WHY,
    RecordedTopic,
    has_same_content,
    read_ticks,
)
from mpcc_controller import run_time_parameters
from mpcc_controller.parameters import CarParams
from msgs_yaml import contract, encode
from msgs_yaml.types import Command, Prediction, Why
from node_runtime import node_parameters, parameters, ros

from .conftest import FOLDERS, GOLDEN, in_mode, with_columns

CAR_FILE = node_parameters.find_config('mpcc_controller', 'car.yaml')
compiler = pytest.mark.needs('compiler')  # without one another solver answers
STAMP = 1_000_000_000
NAME = 'tolerances.steer_rate_radps'
ONE = Command(STAMP, 0.1, 0.2, -300.0, 400.0)
STILL = np.zeros(3)
PLAN = Prediction(STAMP, STILL, STILL, STILL, STILL)
REPORT = {'rung': 'solved', 'cost.con': 20.0, 'time.solve_ms': 1.0}


def differing(pairs):
    return [pair.field for pair in pairs if pair.differs]


def pair_reports(ours, theirs):
    return check.pair_reports(*(Why(STAMP, 0, 'solved', values) for values in (ours, theirs)))


def pair_plans(ours, theirs):
    return check.pair_stages('prediction', check.POSES, ours, theirs)


def test_every_controller_of_the_paper_has_a_golden_recording():
    assert {'mpcc', 'mpcc_no_ca', 'frenet'} <= set(FOLDERS)


@compiler
@pytest.mark.parametrize('name', FOLDERS)
def test_a_golden_recording_is_small_and_answered_as_it_was_recorded(golden, name, capsys):
    bag = golden(name)
    assert (
        sum(file.stat().st_size for file in FOLDERS[name].iterdir()) < recorded_ticks.LARGEST_BYTES
    )
    assert bag.damage is None
    assert set(json.loads(bag.run_info['parameters'])) == set(recorded_ticks.ROLES)
    assert not [value for value in bag.run_info.values() if '/home' in value or '/tmp' in value]
    assert cli.main(['replay-check', str(FOLDERS[name])]) == 0
    assert re.search(r'the same in \d{3} ticks\n', capsys.readouterr().out)


@compiler
def test_a_weight_that_is_one_percent_larger_is_detected_and_shown(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    noted = json.loads(read.run_info(GOLDEN / 'mpcc')['parameters'])['controller']
    setting = f'controller.{NAME}={noted[NAME] / 1.01**0.5}'
    assert cli.main(['replay-check', str(GOLDEN / 'mpcc'), '--set', setting]) == 1
    text = capsys.readouterr().out
    for part in ('first in tick 0 at 0.00 s', 'command.', 'weight.'):
        assert part in text
    assert max(map(len, text.splitlines()[1:])) <= 80
    assert int(text.partition('differs in ')[2].split()[0]) > 100


@pytest.mark.parametrize(
    ('compare', 'one', 'other', 'found'),
    [
        # a command may differ by a millionth of its unit
        (check.pair_commands, ONE, ONE._replace(Fxr=400.0 + 9e-7), []),
        (check.pair_commands, ONE, ONE._replace(Fxr=400.0 + 2e-6), ['command.Fxr']),
        (check.pair_commands, ONE, ONE._replace(delta=math.nan), ['command.delta']),
        # of a report all values are compared except times
        (pair_reports, REPORT, REPORT | {'time.solve_ms': 9.0}, []),
        (pair_reports, REPORT, REPORT | {'candidates.1.cpu_ms': 9.0}, []),
        (pair_reports, REPORT, REPORT | {'rung': 'braking'}, ['rung']),
        (pair_reports, REPORT, REPORT | {'cost.con': 20.00003}, ['cost.con']),
        (pair_reports, REPORT, REPORT | {'cost.con': 20.00001}, []),
        (pair_reports, REPORT, REPORT | {'guide': 'plan'}, ['guide']),
        (pair_plans, PLAN, PLAN._replace(X=STILL[:1]), ['prediction.stages']),
    ],
)
def test_what_differs_between_two_answers_is_named(compare, one, other, found):
    assert differing(compare(one, other)) == differing(compare(other, one)) == found


def test_plans_are_compared_where_they_differ_most():
    other = PLAN._replace(Y=np.array([0.0, -2e-6, 1e-6]))
    (found,) = [pair for pair in pair_plans(PLAN, other) if pair.differs]
    assert (found.field, found.replayed) == ('prediction.Y', -2e-6)


@pytest.fixture(scope='session')
def all_ticks(mpcc):
    return tuple(read_ticks(mpcc))


@pytest.fixture
def ticks(all_ticks):
    return [*all_ticks]


@pytest.fixture
def replayed(mpcc):
    """Return a function from settings to the controller of the recording."""
    return lambda **settings: replayed_controller.from_run_info(mpcc.run_info, settings, 'mpcc')


def test_a_tick_decided_by_the_clock_and_those_after_it_are_no_failures(ticks, replayed):
    tick = ticks[20]
    late = tick.why._replace(values=tick.why.values | {'solver.message': recorded_ticks.TIME_LIMIT})
    ticks[20] = tick._replace(gaps=tuple(recorded_ticks.find_gaps(late, tick.command)))
    compared = check.compare_ticks(ticks[:50], replayed(**{'tolerances.lag_m': 0.4}))
    shadow = [*range(20, 20 + check.SHADOW)]
    assert [one.tick.number for one in compared if one.gap] == shadow
    assert 'time limit' in compared[20].gap


def test_a_lost_command_is_a_gap_and_the_replay_continues_from_its_own_answer(ticks, replayed):
    gaps = tuple(recorded_ticks.find_gaps(ticks[30].why, None))
    ticks[30] = ticks[30]._replace(command=None, gaps=gaps)
    compared = check.compare_ticks(ticks[:60], replayed())
    assert 'lost' in compared[30].gap
    assert not any(one.differing for one in compared)


def drive_again(ticks, recorder, change_inputs):
    """Let a controller answer ticks with changed inputs; return them as if they were recorded."""
    for k, tick in enumerate(ticks):
        inputs = tick.inputs._replace(**change_inputs(k))
        command, plan, why, stop = recorder.step(inputs, tick.stamp_ns)
        recorder.continue_from(command)
        inputs = inputs._replace(
            fault=recorded_ticks.stale_input(why), changes=run_time_parameters.reported(why.values)
        )
        yield tick._replace(command=command, prediction=plan, why=why, stop=stop, inputs=inputs)


def test_ticks_that_braked_or_had_other_weights_are_repeated(ticks, replayed):
    later = {'tolerances.contouring_m': 0.2, 'limits.friction_use': 0.7}

    def change(k):
        # a controller that was started again in tick 30 has the values of the start
        fault = 'obstacles_stale' if k in (10, 11) else ''
        return {'fault': fault, 'changes': later if 15 <= k < 30 else {}}

    ticks = [*drive_again(ticks[:40], replayed(), change)]
    rungs = [tick.why.values['rung'] for tick in ticks[9:13]]
    assert rungs == ['solved', 'braking', 'braking', 'solved']
    assert [k for k, tick in enumerate(ticks) if tick.inputs.fault] == [10, 11]
    assert [k for k, tick in enumerate(ticks) if tick.inputs.changes] == [*range(15, 30)]
    assert ticks[20].why.values['weight.con'] == pytest.approx(25.0)
    assert not any(one.differing for one in check.compare_ticks(ticks, replayed()))
    unaware = [tick._replace(inputs=tick.inputs._replace(changes={})) for tick in ticks]
    compared = check.compare_ticks(unaware, replayed())
    assert next(one.tick.number for one in compared if one.differing) == 15
    # a parameter that is set for a replay wins over what the run changed
    _, _, why, _ = replayed(**{'tolerances.contouring_m': 0.8}).step(ticks[20].inputs, STAMP)
    assert why.values['weight.con'] == pytest.approx(0.8**-2)


@compiler
def test_stop_plans_are_read_and_repeated(mpcc, ticks, replayed):
    recorded = [*drive_again(ticks[:20], replayed(), lambda k: {})]
    rows = mpcc.recordings[COMMAND].rows(np.arange(20))
    messages = [ros.serialize(encode.stop_plan(tick.stop)) for tick in recorded]
    topic = message_filing.bag_topic(contract.load().topics[STOP_PLAN], contract.LOCKSTEP)
    sent = rows._replace(topic=topic, payloads=messages)
    bag = mpcc._replace(recordings=mpcc.recordings | {STOP_PLAN: sent})
    again = read_ticks(bag, 21)
    assert again[20].stop is None
    for before, after in zip(recorded, again):
        assert all(np.array_equal(*columns) for columns in zip(before.stop, after.stop))
    again[7] = again[7]._replace(stop=again[7].stop._replace(Fxr=again[7].stop.Fxr + 0.1))
    again[8] = again[8]._replace(stop=again[8].stop._replace(t=STILL))
    differ = {one.tick.number: one.differing for one in check.compare_ticks(again, replayed())}
    assert {k: [pair.field for pair in pairs] for k, pairs in differ.items() if pairs} == {
        7: ['stop_plan.Fxr'],
        8: ['stop_plan.stages'],
    }


def without(bag, topic, row):
    """Return a bag that lost one message."""
    recording = bag.recordings[topic]
    columns = {name: np.delete(getattr(recording, name), row) for name in recording._fields[1:4]}
    payloads = [payload for i, payload in enumerate(recording.payloads) if i != row]
    return with_columns(bag, topic, **columns, payloads=payloads)


@pytest.mark.parametrize('topic', [STATE, OBSTACLES])
def test_in_lockstep_a_lost_input_is_an_error_that_names_it(mpcc, topic):
    with pytest.raises(BagError, match=f'{topic} has no message of stamp'):
        read_ticks(without(mpcc, topic, 40))


def test_in_realtime_a_lost_message_is_a_gap_in_the_replay(mpcc, all_ticks):
    lost = {
        (STATE, 40): 'its state was lost',
        (COMMAND, 60): 'its command was lost',
        (WHY, 80): 'a tick without a message of /controller/why',
    }
    bag = in_mode(mpcc, 'realtime')
    for topic, tick in lost:
        row = RecordedTopic(mpcc, topic).row_of[all_ticks[tick].stamp_ns]
        bag = without(bag, topic, row)
    # how many it heard before the first tick is a matter of the machine
    while not read_ticks(bag, 1)[0].gaps:
        bag = without(bag, OBSTACLES, 0)
    gaps = {tick.number: tick.gaps for tick in read_ticks(bag) if tick.gaps}
    unknown = ('what it knew of /scenario/obstacles was not recorded',)
    first = [tick for tick, gap in gaps.items() if gap == unknown]
    assert first == [*range(len(first))]
    assert 0 < len(first) < 5
    assert gaps == {tick: (gap,) for (_, tick), gap in lost.items()} | dict.fromkeys(first, unknown)


def test_torn_messages_of_other_publishers_do_not_end_a_replay(mpcc, all_ticks):
    torn = mpcc
    for topic in (WHY, COMMAND, REFERENCE, EDGES, OBSTACLES, STATE):
        recording = mpcc.recordings[topic]
        middle = len(recording.payloads) // 2
        columns = {name: getattr(recording, name) for name in recording._fields[1:4]}
        columns = {n: np.insert(column, middle, column[middle]) for n, column in columns.items()}
        before, after = recording.payloads[:middle], recording.payloads[middle:]
        torn = with_columns(torn, topic, **columns, payloads=[*before, after[0][:20], *after])
    found, expected = read_ticks(torn, 120), all_ticks[:120]
    for name in ('stamp_ns', 'gaps', 'command'):
        assert [getattr(tick, name) for tick in found] == [getattr(tick, name) for tick in expected]
    assert [tick.inputs.state for tick in found] == [tick.inputs.state for tick in expected]
    for a, b in zip(found, expected):
        assert has_same_content(a.inputs.reference, b.inputs.reference)


def with_reports(bag, changed):
    """Return a bag in which some reports, by row, say something else under some keys."""
    topic, payloads = RecordedTopic(bag, WHY), [*bag.recordings[WHY].payloads]
    for row, values in changed.items():
        report = topic.value(row)
        payloads[row] = ros.serialize(encode.why(report._replace(values=report.values | values)))
    return with_columns(bag, WHY, payloads=payloads)


def test_an_impossible_duration_counts_as_zero(mpcc):
    bag, names = in_mode(mpcc, 'realtime'), ('time.lead_ms', 'time.prepare_ms', 'time.solve_ms')
    impossible = ('n/a', math.nan, math.inf, -math.inf, 1e300, -1e12, 1e12)
    reports = {20 + k: dict.fromkeys(names, value) for k, value in enumerate(impossible)}
    found, expected = read_ticks(with_reports(bag, reports), 28), read_ticks(bag, 28)
    for k in reports:
        assert found[k].inputs.acts_ns == found[k].stamp_ns
    assert [tick.inputs.state for tick in found] == [tick.inputs.state for tick in expected]


def test_reports_whose_reason_is_no_text_belong_to_no_tick(mpcc):
    bag = in_mode(mpcc, 'realtime')
    foreign = {20: {'reason': 12}, 22: {'reason': 0.5}, 24: {'reason': True}}
    found, expected = read_ticks(with_reports(bag, foreign), 40), read_ticks(bag, 43)
    wanted = [tick.why for k, tick in enumerate(expected) if k not in foreign]
    assert [tick.why for tick in found] == wanted


def test_two_drives_in_one_bag_are_refused(mpcc, golden):
    first, second = (bag.recordings[STATE] for bag in (mpcc, golden('frenet')))
    names = first._fields[1:4]
    columns = {n: np.concatenate([getattr(first, n), getattr(second, n)]) for n in names}
    both = with_columns(mpcc, STATE, **columns, payloads=first.payloads + second.payloads)
    with pytest.raises(BagError, match='the bag holds two drives'):
        read_ticks(both)


def test_a_controller_begins_at_the_actuators_when_started_again_or_after_braking_blindly(
    mpcc, monkeypatch
):
    sequence = mpcc.recordings[WHY].sequence.copy()
    sequence[60:] -= sequence[59]
    found = read_ticks(with_columns(mpcc, WHY, sequence=sequence), 70)
    assert [tick.number for tick in found if tick.inputs.actuators] == [0, 60]
    assert found[60].inputs.actuators.stamp_ns == found[60].stamp_ns
    value = RecordedTopic.value

    def blind(topic, row):
        found = value(topic, row)
        if topic.topic.name == WHY and row in (20, 21):
            return found._replace(values={'reason': 'state_stale', 'rung': 'braking'})
        return found

    monkeypatch.setattr(RecordedTopic, 'value', blind)
    inputs = [tick.inputs for tick in read_ticks(in_mode(mpcc, 'realtime'), 40)]
    assert [k for k, one in enumerate(inputs) if one.state is None] == [20, 21]
    assert [k for k, one in enumerate(inputs) if one.fault] == [20, 21]
    assert [k for k, one in enumerate(inputs) if one.actuators] == [0, 22]


def params_of(run_info, **settings):
    """Return the parameters and the car of a run with some settings."""
    return replayed_controller.recorded_params(run_info, settings, 'mpcc')


def noting(run_info, **changes):
    """Return run information with other parameters of the controller; None removes one."""
    noted = json.loads(run_info['parameters'])
    removed = [name for name, value in changes.items() if value is None]
    values = {k: v for k, v in (noted['controller'] | changes).items() if k not in removed}
    return run_info | {'parameters': json.dumps(noted | {'controller': values})}


def test_parameters_that_a_run_lacks_or_has_besides_are_named(mpcc):
    params, car = params_of(mpcc.run_info)
    with pytest.warns(OlderRunWarning, match=r'assumed: safety\.edge_m = 0\.5'):
        made = params_of(noting(mpcc.run_info, **{'safety.edge_m': None}))
    assert made == (params, car)
    with pytest.warns(OlderRunWarning, match=r'left out: weights\.gone = 3'):
        made = params_of(noting(mpcc.run_info, **{'weights.gone': 3}))
    assert made == (params, car)
    with pytest.raises(BagError, match=r'tyre\.front_friction: is missing'):
        params_of(noting(mpcc.run_info, **{'tyre.front_friction': None}))
    with pytest.raises(BagError, match='does not say the parameters'):
        params_of({})


@pytest.mark.parametrize(
    ('settings', 'expected'),
    [
        ({'solver.mdoe': 'one_step'}, r"^--set: solver\.mdoe: .* did you mean 'solver\.mode'\?"),
        ({'limits.steer_rate_radps': 0.9}, r'limits\.steer_rate_radps: is 0\.9; allowed up to 0.8'),
        ({'car_file': './no.yaml'}, r'^--set.*car_file.*no\.yaml'),
        ({'car_file': 'mpcc.yaml'}, r'^--set.*car_file.*mpcc\.yaml'),
        ({'car_file': 1}, '^--set.*car_file.*1'),
        ({'tyre.front': 1.0}, 'tyre.front'),
    ],
)
def test_a_setting_that_cannot_be_used_is_refused(mpcc, settings, expected):
    car = parameters.read_file(CAR_FILE).values
    newer = noting(mpcc.run_info, **{n: v for n, v in car.items() if n.startswith('actuators.')})
    params_of(newer, **{'limits.steer_rate_radps': 0.8})
    with pytest.raises(BagError, match=expected):
        params_of(newer, **settings)


def test_a_car_file_replaces_the_car_of_the_run_and_single_settings_win_over_it(mpcc, tmp_path):
    own = tmp_path / 'my_car.yaml'
    own.write_text(CAR_FILE.read_text().replace('mass_kg: 1850.0', 'mass_kg: 1234.0'))
    shipped = parameters.load(CarParams, CAR_FILE)
    params, vehicle = params_of(mpcc.run_info, car_file=str(own))
    assert params.car_file == str(own)
    lighter = dataclasses.replace(shipped.car, mass_kg=1234.0)
    assert vehicle == dataclasses.replace(shipped, car=lighter)
    _, vehicle = params_of(mpcc.run_info, **{'car_file': str(own), 'car.mass_kg': 1500.0})
    assert vehicle.car.mass_kg == 1500.0


def test_settings_of_a_replay_are_of_the_controller_whose_name_may_be_left_out():
    texts = ['solver.mode=one_step', 'controller.tolerances.lag_m=4e-1']
    values = {'solver.mode': 'one_step', 'tolerances.lag_m': 0.4}
    assert set_option.parse_controller_settings(texts) == values
    for text, expected in (
        ('plant.friction=0.5', 'only parameters of the controller'),
        ('controller.tolerances.lag_m', r'must be \[controller\.\]parameter=value'),
        ('weights.lag=0', r'experiments resolve.*controller\.tolerances'),
    ):
        with pytest.raises(BagError, match=expected):
            set_option.parse_controller_settings([text])


def test_cutting_a_golden_recording_once_more_changes_nothing(golden, tmp_path, monkeypatch):
    bag = golden('frenet')
    again = read.load(recorded_ticks.cut(bag, tmp_path / 'frenet'))
    assert again.run_info == bag.run_info
    for topic, recorded in bag.recordings.items():
        assert again.recordings[topic].payloads == recorded.payloads
    monkeypatch.setattr(recorded_ticks, 'LARGEST_BYTES', 1000)
    with pytest.raises(BagError, match='at most 1000'):
        recorded_ticks.cut(bag, tmp_path / 'large')
