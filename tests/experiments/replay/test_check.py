"""What counts as a difference, and what a recording cannot repeat."""

import dataclasses
import json
import math

import numpy as np
import pytest

from bags.errors import BagError, OlderRunWarning
from experiments.configuration import set_option
from experiments.replay import check, recorded_ticks, replayed_controller
from experiments.replay.recorded_ticks import RecordedTopic
from mpcc_controller import car_file
from mpcc_controller.parameters import CarParams
from mpcc_controller.problem import stage_parameters
from msgs_yaml import encode
from msgs_yaml.types import Command, Prediction, Why
from node_runtime import node_parameters, parameters, ros

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


def test_all_values_of_a_report_are_compared_except_times():
    one = why(rung='solved', **{'cost.con': 20.0, 'time.solve_ms': 1.0})
    assert differing(check.pair_reports(one, why(**one.values | {'time.solve_ms': 9.0}))) == []
    assert differing(check.pair_reports(one, why(**one.values | {'rung': 'braking'}))) == ['rung']
    assert differing(check.pair_reports(one, why(**one.values | {'cost.con': 20.00003}))) == [
        'cost.con'
    ]
    assert differing(check.pair_reports(one, why(**one.values | {'cost.con': 20.00001}))) == []


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


def timed_by(bag, mode):
    """Return a bag that says it was recorded in another mode."""
    return bag._replace(records=bag.records | {'run': bag.run_info | {'mode': mode}})


def test_a_replay_by_the_wall_clock_gives_the_same_answers(golden):
    report = check.check(timed_by(golden('mpcc'), 'realtime'), {})
    assert not report.failures
    assert report.repeatable == len(report.ticks)


def test_a_tick_decided_by_the_clock_and_those_after_it_are_no_failures(golden):
    bag = golden('mpcc')
    ticks = recorded_ticks.read_ticks(bag)
    one = ticks[60]
    values = one.why.values | {'solver.message': recorded_ticks.TIME_LIMIT}
    ticks[60] = one._replace(
        gaps=tuple(recorded_ticks.find_gaps(one.why._replace(values=values), one.command))
    )
    controller = replayed_controller.from_run_info(bag.run_info, {'tolerances.lag_m': 0.4}, 'mpcc')
    compared = check.compare_ticks(ticks, controller)
    assert [one.tick.number for one in compared if one.gap] == list(range(60, 60 + check.SHADOW))
    assert 'time limit' in compared[60].gap


def test_a_lost_command_is_a_gap_and_the_replay_continues_from_its_own_answer(golden):
    bag = golden('mpcc')
    ticks = recorded_ticks.read_ticks(bag)
    ticks[30] = ticks[30]._replace(
        command=None, gaps=tuple(recorded_ticks.find_gaps(ticks[30].why, None))
    )
    compared = check.compare_ticks(
        ticks, replayed_controller.from_run_info(bag.run_info, {}, 'mpcc')
    )
    assert 'lost' in compared[30].gap
    assert not any(one.differing for one in compared)


def without(bag, topic, row, mode='lockstep'):
    """Return a bag that lost one message, recorded by another clock where one is given."""
    one = bag.recordings[topic]
    rows = np.delete(np.arange(len(one.payloads)), row)
    times = (column[rows] for column in (one.log_ns, one.publish_ns, one.sequence))
    cut = one.topic, *times, [one.payloads[i] for i in rows]
    recordings = bag.recordings | {topic: type(one)(*cut)}
    return timed_by(bag._replace(recordings=recordings), mode)


@pytest.mark.parametrize('topic', [recorded_ticks.STATE, recorded_ticks.OBSTACLES])
def test_in_lockstep_a_lost_input_is_an_error_that_names_it(golden, topic):
    with pytest.raises(BagError, match=f'{topic} has no message of stamp'):
        recorded_ticks.read_ticks(without(golden('mpcc'), topic, 40))


@pytest.mark.parametrize(
    'topic',
    [
        recorded_ticks.WHY,
        recorded_ticks.COMMAND,
        recorded_ticks.REFERENCE,
        recorded_ticks.EDGES,
        recorded_ticks.OBSTACLES,
        recorded_ticks.STATE,
    ],
)
def test_a_torn_message_of_another_publisher_does_not_end_a_replay(golden, topic):
    bag = golden('mpcc')
    one = bag.recordings[topic]
    middle = len(one.payloads) // 2
    times = (np.insert(column, middle, column[middle]) for column in one[1:4])
    payloads = [*one.payloads[:middle], one.payloads[middle][:20], *one.payloads[middle:]]
    torn = bag._replace(recordings=bag.recordings | {topic: type(one)(one.topic, *times, payloads)})
    expected, found = recorded_ticks.read_ticks(bag, 120), recorded_ticks.read_ticks(torn, 120)
    assert [one.stamp_ns for one in found] == [one.stamp_ns for one in expected]
    assert [one.gaps for one in found] == [one.gaps for one in expected]
    assert all(
        recorded_ticks.has_same_content(a.inputs.reference, b.inputs.reference)
        for a, b in zip(found, expected)
    )
    assert [one.inputs.state for one in found] == [one.inputs.state for one in expected]
    assert [one.command for one in found] == [one.command for one in expected]


def with_report(bag, row, payload):
    """Return a bag with another report in the place of one."""
    one = bag.recordings[recorded_ticks.WHY]
    payloads = [*one.payloads[:row], payload, *one.payloads[row + 1 :]]
    return bag._replace(
        recordings=bag.recordings | {recorded_ticks.WHY: one._replace(payloads=payloads)}
    )


def changed_report(bag, row, **values):
    """Return a report of a bag as bytes, which says something else under some keys."""
    one = RecordedTopic(bag, recorded_ticks.WHY).value(row)
    return ros.serialize(encode.why(one._replace(values=one.values | values)))


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
@pytest.mark.parametrize('time', ['n/a', math.nan, math.inf, -math.inf, 1e300, -1e12, 1e12])
def test_an_impossible_duration_counts_as_zero(golden, mode, time):
    bag = timed_by(golden('mpcc'), mode)
    times = dict.fromkeys(('time.lead_ms', 'time.prepare_ms', 'time.solve_ms'), time)
    found = recorded_ticks.read_ticks(with_report(bag, 20, changed_report(bag, 20, **times)), 22)
    assert len(found) == 22
    assert found[20].inputs.acts_ns == found[20].stamp_ns
    assert found[20].inputs.state == recorded_ticks.read_ticks(bag, 22)[20].inputs.state


@pytest.mark.parametrize('reason', [12, 0.5, True])
def test_a_report_whose_reason_is_no_text_belongs_to_no_tick(golden, reason):
    bag = timed_by(golden('mpcc'), 'realtime')
    found = recorded_ticks.read_ticks(
        with_report(bag, 20, changed_report(bag, 20, reason=reason)), 40
    )
    expected = recorded_ticks.read_ticks(bag, 41)
    assert [one.why for one in found] == [one.why for one in (*expected[:20], *expected[21:])]


def test_two_drives_in_one_bag_are_refused(golden):
    bag, other = golden('mpcc'), golden('frenet').recordings[recorded_ticks.STATE]
    one = bag.recordings[recorded_ticks.STATE]
    columns = (np.concatenate([a, b]) for a, b in zip(one[1:4], other[1:4]))
    both = type(one)(one.topic, *columns, one.payloads + other.payloads)
    with pytest.raises(BagError, match='the bag holds two drives'):
        recorded_ticks.read_ticks(
            bag._replace(recordings=bag.recordings | {recorded_ticks.STATE: both})
        )


@pytest.mark.parametrize(
    ('topic', 'tick', 'gap'),
    [
        (recorded_ticks.STATE, 40, 'its state was lost'),
        (recorded_ticks.WHY, 40, 'a tick without a message of /controller/why'),
        (recorded_ticks.COMMAND, 40, 'its command was lost'),
        (recorded_ticks.OBSTACLES, 0, 'what it knew of /scenario/obstacles was not recorded'),
    ],
)
def test_in_realtime_a_lost_message_is_a_gap_in_the_replay(golden, topic, tick, gap):
    bag = golden('mpcc')
    row = RecordedTopic(bag, topic).row_of[recorded_ticks.read_ticks(bag)[tick].stamp_ns]
    found = recorded_ticks.read_ticks(without(bag, topic, row, 'realtime'))
    assert [one.number for one in found if one.gaps] == [tick]
    assert found[tick].gaps == (gap,)


def test_a_controller_that_was_started_again_begins_at_the_actuators(golden):
    bag = golden('mpcc')
    one = bag.recordings[recorded_ticks.WHY]
    sequence = np.concatenate([one.sequence[:60], one.sequence[60:] - one.sequence[59]])
    begun = bag._replace(
        recordings=bag.recordings | {recorded_ticks.WHY: one._replace(sequence=sequence)}
    )
    found = recorded_ticks.read_ticks(begun)
    assert [one.number for one in found if one.inputs.actuators] == [0, 60]
    assert found[60].inputs.actuators.stamp_ns == found[60].stamp_ns


def told_late(bag, reasons):
    """Return the ticks of a bag whose controller had found an input too old at some of them.

    The answers come from a controller with these faults.
    """
    recorded, ticks = (
        replayed_controller.from_run_info(bag.run_info, {}, 'mpcc'),
        recorded_ticks.read_ticks(bag, 40),
    )
    for k, tick in enumerate(ticks):
        command, plan, why = recorded.step(
            tick.inputs._replace(fault=reasons.get(k, '')), tick.stamp_ns
        )
        recorded.continue_from(command)
        ticks[k] = tick._replace(command=command, prediction=plan, why=why)
    return ticks


def test_a_tick_that_braked_because_of_an_old_input_is_repeated(golden):
    bag = golden('mpcc')
    ticks = told_late(bag, dict.fromkeys((20, 21), 'obstacles_stale'))
    assert [one.why.values['rung'] for one in ticks[19:23]] == [
        'solved',
        *['braking'] * 2,
        'solved',
    ]
    faults = [one.inputs._replace(fault=recorded_ticks.stale_input(one.why)) for one in ticks]
    ticks = [one._replace(inputs=inputs) for one, inputs in zip(ticks, faults)]
    assert [one.inputs.fault for one in ticks[19:23]] == ['', *['obstacles_stale'] * 2, '']
    compared = check.compare_ticks(
        ticks, replayed_controller.from_run_info(bag.run_info, {}, 'mpcc')
    )
    assert not any(one.differing for one in compared)


def test_after_braking_without_a_state_a_controller_begins_at_the_actuators(golden, monkeypatch):
    bag = golden('mpcc')
    value = RecordedTopic.value

    def blind(topic, row):
        found = value(topic, row)
        if topic.topic.name == recorded_ticks.WHY and row in (20, 21):
            return found._replace(values={'reason': 'state_stale', 'rung': 'braking'})
        return found

    monkeypatch.setattr(RecordedTopic, 'value', blind)
    inputs = [one.inputs for one in recorded_ticks.read_ticks(timed_by(bag, 'realtime'), 40)]
    assert [k for k, one in enumerate(inputs) if one.state is None] == [20, 21]
    assert [k for k, one in enumerate(inputs) if one.fault] == [20, 21]
    assert [k for k, one in enumerate(inputs) if one.actuators] == [0, 22]


def test_run_information_without_parameters_is_refused(golden):
    with pytest.raises(BagError, match='does not say the parameters'):
        replayed_controller.from_run_info({}, {}, 'mpcc')


def test_a_parameter_that_an_older_run_lacks_is_named_and_takes_its_default(golden):
    run_info = golden('mpcc').run_info
    noted = json.loads(run_info['parameters'])
    del noted['controller']['tolerances.lag_m']
    older = run_info | {'parameters': json.dumps(noted)}
    with pytest.warns(OlderRunWarning, match=r'assumed: tolerances\.lag_m = 0\.5$'):
        made, _ = replayed_controller.recorded_params(older, {}, 'mpcc')
    assert made == replayed_controller.recorded_params(run_info, {}, 'mpcc')[0]


def test_a_parameter_of_the_car_that_the_run_lacks_is_an_error(golden):
    run_info = golden('mpcc').run_info
    noted = json.loads(run_info['parameters'])
    del noted['controller']['tyre.front_friction']
    with pytest.raises(BagError, match=r'tyre\.front_friction: is missing'):
        replayed_controller.recorded_params(
            run_info | {'parameters': json.dumps(noted)}, {}, 'mpcc'
        )


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('plant.friction=0.5', 'only parameters of the controller'),
        ('controller.tolerances.lag_m', r'must be \[controller\.\]parameter=value'),
        ('weights.lag=0', r'experiments resolve.*controller\.tolerances'),
    ],
)
def test_a_setting_of_another_form_is_refused(text, expected):
    with pytest.raises(BagError, match=expected):
        set_option.parse_controller_settings([text])


def test_a_parameter_of_the_controller_needs_no_node_before_it():
    texts = ['solver.name=ipopt', 'controller.tolerances.lag_m=4e-1']
    assert set_option.parse_controller_settings(texts) == {
        'solver.name': 'ipopt',
        'tolerances.lag_m': 0.4,
    }


def test_a_misspelt_setting_is_refused_with_the_closest_parameter(golden):
    with pytest.raises(BagError, match=r"^--set: solver\.nmae: .* did you mean 'solver\.name'\?"):
        replayed_controller.recorded_params(
            golden('mpcc').run_info, {'solver.nmae': 'ipopt'}, 'mpcc'
        )


def test_a_run_older_than_the_actuators_of_the_car_keeps_its_layout_and_its_limits(golden):
    older = golden('mpcc').run_info
    assert 'actuators' not in older['parameters']
    params, vehicle = replayed_controller.recorded_params(older, {}, 'mpcc')
    assert stage_parameters.car(params, vehicle).lambda_d == 0.0
    assert car_file.limit_to_car(params, vehicle) == params
    wider, vehicle = replayed_controller.recorded_params(
        older, {'limits.steer_rate_radps': 3.0}, 'mpcc'
    )
    assert car_file.limit_to_car(wider, vehicle).limits.steer_rate_radps == 3.0


def test_a_limit_that_the_car_would_cut_is_refused(golden):
    run_info = golden('mpcc').run_info
    noted = json.loads(run_info['parameters'])
    actuators = parameters.read_file(
        node_parameters.find_config('mpcc_controller', 'car.yaml')
    ).values
    noted['controller'] |= {n: v for n, v in actuators.items() if n.startswith('actuators.')}
    newer = run_info | {'parameters': json.dumps(noted)}
    replayed_controller.recorded_params(newer, {'limits.steer_rate_radps': 0.8}, 'mpcc')
    with pytest.raises(BagError, match=r'limits\.steer_rate_radps: is 0\.9; allowed up to 0\.8'):
        replayed_controller.recorded_params(newer, {'limits.steer_rate_radps': 0.9}, 'mpcc')


def test_a_car_file_replaces_the_car_of_the_run_and_single_settings_win_over_it(golden, tmp_path):
    run_info = golden('mpcc').run_info
    text = node_parameters.find_config('mpcc_controller', 'car.yaml').read_text()
    own = tmp_path / 'my_car.yaml'
    own.write_text(text.replace('mass_kg: 1850.0', 'mass_kg: 1234.0'))
    _, recorded = replayed_controller.recorded_params(run_info, {}, 'mpcc')
    shipped = parameters.load(CarParams, node_parameters.find_config('mpcc_controller', 'car.yaml'))
    params, vehicle = replayed_controller.recorded_params(run_info, {'car_file': str(own)}, 'mpcc')
    assert params.car_file == str(own)
    assert recorded.car.mass_kg == 1850.0
    assert vehicle == dataclasses.replace(
        shipped, car=dataclasses.replace(shipped.car, mass_kg=1234.0)
    )
    _, vehicle = replayed_controller.recorded_params(
        run_info, {'car_file': str(own), 'car.mass_kg': 1500.0}, 'mpcc'
    )
    assert vehicle.car.mass_kg == 1500.0


def test_a_new_car_gives_an_older_run_its_drive_layout_too(golden, tmp_path):
    older = golden('mpcc').run_info
    assert 'model.drive_front_share' in older['parameters']
    text = node_parameters.find_config('mpcc_controller', 'car.yaml').read_text()
    own = tmp_path / 'my_car.yaml'
    own.write_text(text.replace('drive_front_share: 0.0', 'drive_front_share: 1.0'))
    for given, used in (
        ({'car_file': str(own)}, 1.0),
        ({'car_file': str(own), 'model.drive_front_share': 0.5}, 0.5),
        ({'car_file': str(own), 'actuators.drive_front_share': 0.3}, 0.3),
        ({'actuators.drive_front_share': 0.3}, 0.3),
    ):
        assert (
            stage_parameters.car(
                *replayed_controller.recorded_params(older, given, 'mpcc')
            ).lambda_d
            == used
        )


@pytest.mark.parametrize('name', ['nosuch.yaml', './nosuch.yaml', 'mpcc.yaml', 1])
def test_a_car_file_that_cannot_be_used_is_refused_with_its_name(golden, name):
    with pytest.raises(BagError, match=rf'^--set.*car_file.*{name}'):
        replayed_controller.recorded_params(golden('mpcc').run_info, {'car_file': name}, 'mpcc')


@pytest.mark.parametrize('name', ['tolerances.lag', 'tyre.front', 'nothing'])
def test_a_setting_that_does_not_exist_is_refused(golden, name):
    with pytest.raises(BagError, match=name):
        replayed_controller.from_run_info(golden('mpcc').run_info, {name: 1.0}, 'mpcc')
