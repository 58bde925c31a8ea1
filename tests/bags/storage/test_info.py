"""`bags info` and `bags timing`: what a bag holds, what was lost, where the time of a tick went."""

import json
from pathlib import Path

import numpy as np
import pytest
from one_second import expected, in_memory, recording, write_recordings
from rich.console import Console
from straight_drive import drive_of

from bags.commands import timing
from bags.errors import BagError
from bags.evaluation import bag_summary
from bags.evaluation.bag_summary import summarize_bag
from bags.storage import read
from bags.storage.read import Recording
from msgs_yaml import encode
from msgs_yaml.types import Command, VehicleState, Why
from node_runtime import ros

MS, S = 1_000_000, 1_000_000_000
TICK = 50 * MS
STATE, COMMAND, WHY = '/vehicle/odometry', '/controller/command', '/controller/why'
GOLDEN = Path(__file__).parents[3] / 'bags/reference/double_lane_change/mpcc'


def thinned(recorded, left_out):
    """Return a recording without these rows."""
    return recorded.rows(np.delete(np.arange(len(recorded.payloads)), left_out))


@pytest.fixture
def limping(tmp_path, bag_folder):
    """A bag in which states 3 and 4 were lost, one tick is unanswered and one fell back."""
    recordings = read.load(bag_folder).recordings
    states = thinned(recordings[STATE], [3, 4])
    states = states._replace(publish_ns=states.log_ns)
    commands = thinned(recordings[COMMAND], [7])
    # every command is sent 4 ms after its state, the last one 9 ms
    delays_ns = np.where(commands.sequence == 20, 9 * MS, 4 * MS)
    commands = commands._replace(publish_ns=commands.log_ns + delays_ns)
    whys, clock = recordings[WHY], recordings['/clock']
    whys.payloads[5] = whys.payloads[5].replace(b'solved', b'shifte')
    entries = {'scenario': 's', 'scenario_sha256': 'f' * 64}
    return write_recordings(tmp_path / 'bag', [states, commands, whys, clock], entries)


def test_summary_counts_rates_gaps_losses_latency_and_fallbacks(limping):
    result = summarize_bag(read.load(limping))
    state = result['topics'][STATE]
    assert (state['messages'], state['lost'], state['lost_places']) == (998, 2, 1)
    assert (state['lost_longest'], state['sent_before']) == (2, 0)
    assert state['longest_gap_s'] == pytest.approx(0.003)
    assert state['rate_hz'] == pytest.approx(997 / 0.999)
    assert result['topics'][COMMAND]['longest_gap_s'] == pytest.approx(0.1)
    assert (result['start_s'], result['duration_s']) == pytest.approx((1.0, 0.999))
    assert result['mode'] == 'lockstep'
    p99 = np.percentile([4.0] * 18 + [9.0], 99)
    assert result['latency_ms'] == pytest.approx({'p50': 4.0, 'p99': p99, 'max': 9.0})
    # an unanswered period is a miss, and lockstep is never late
    ticks = {'count': 20, 'missed': 1, 'unanswered': 1, 'late': 0, 'blind': 0}
    assert result['ticks'] == ticks
    assert result['rungs'] == {'solved': 19, 'shifte': 1}
    assert sum(result['fallbacks'].values()) == 1


def test_what_a_bag_cannot_tell_is_none(tmp_path, bag_folder, bags_prints):
    recordings = read.load(bag_folder).recordings
    health = recordings['/diagnostics']
    times = np.ones(5, dtype=np.int64)
    # numbers of several publishers say nothing about losses
    several = Recording(
        health.topic, times, times, np.array([1, 1, 2, 2, 5]), health.payloads[:1] * 5
    )
    recordings = [several, thinned(recordings[COMMAND], range(1, 20))]
    folder = write_recordings(tmp_path / 'bag', recordings, {})
    result = summarize_bag(read.load(folder))
    assert result['topics']['/diagnostics']['lost'] is None
    assert result['topics'][COMMAND]['rate_hz'] is None
    names = ('latency_ms', 'ticks', 'rungs', 'fallbacks', 'reports')
    assert [result[name] for name in names] == [None] * 5
    assert bags_prints('info', folder)


def test_info_prints_a_row_per_topic_or_json(bag_folder, messages, bags_prints):
    output = bags_prints('info', bag_folder)
    for topic, sent in messages.items():
        (row,) = (line for line in output.splitlines() if line.startswith(topic))
        assert f' {len(sent)} ' in row
    assert 'state to command in ms: p50' in output
    assert 'scenario: double_lane_change' in output
    result = json.loads(bags_prints('info', bag_folder, '--json'))
    assert result['fallbacks'] == {}
    counts = {name: result['topics'][name]['messages'] for name in messages}
    assert counts == expected(messages)


def test_info_says_places_of_losses_keeps_hashes_whole_and_rows_in_one_line(limping, bags_prints):
    output = bags_prints('info', limping)
    assert '2 in 1 places' in output
    assert f'scenario_sha256: {"f" * 64}\n' in output
    # as awk and grep read it; a terminal has a width
    lines = bags_prints('info', GOLDEN).splitlines()
    (row,) = (line for line in lines if line.startswith(STATE))
    topic, count, rate, gap, lost, *places = row.split()
    assert (topic, rate, gap) == (STATE, '20.00', '0.050')
    assert int(lost) > 7000  # 49 of 50 states are cut out of a golden bag
    assert places == ['in', str(int(count) - 1), 'places']


def test_answers_to_the_last_state_are_reports_but_no_ticks(write_bag, bags_prints):
    drive = drive_of(metres=20.0)
    last_ns = int(drive.motion.stamp_ns[-1])
    ticks = drive.ticks._replace(answered_ns=drive.motion.stamp_ns[::50])
    blind = {'rung': 'braking', 'reason': 'state_stale'}  # braking without a state is no answer
    for extra in ((), [last_ns + k * TICK for k in range(5)]):
        reports = [(WHY, ns, ros.serialize(encode.why(Why(ns, 0, '', blind)))) for ns in extra]
        folder = write_bag(drive._replace(ticks=ticks), f'with {len(extra)}', extra=reports)
        output = bags_prints('info', folder)
        assert '20 ticks' in output
        assert f'{21 + len(extra)} reports of the controller, 1 of them on the last' in output
        assert ('rungs: solved 21' in output) or extra


# where the time of a tick went, from bags whose every time is made up


def ring(ticks, latency_ms=lambda k: 12.0, answered=lambda k: True, blind=(), unheard=False):
    """States every 50 ms sent 1 ms late, heard 2 ms after that; waits 0.5, prepares 1, solves 4."""
    sent = {STATE: [], COMMAND: [], WHY: []}
    for k in range(ticks + 1):
        stamp = S + k * TICK
        state = VehicleState(stamp, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0)
        sent[STATE].append((stamp + MS, encode.odometry(state)))
        if not (answered(k) or k in blind):
            continue
        answer = stamp + 20 * MS + 1 if k in blind else stamp
        values = {'rung': 'solved', 'reason': 'state_stale' if k in blind else 'converged'}
        values['gate'] = 'passed'
        if k not in blind:
            values |= {'time.wait_ms': 0.5, 'time.prepare_ms': 1.0, 'time.solve_ms': 4.0}
            values |= {} if unheard else {'time.heard_ns': stamp + 3 * MS}
        values['time.publish_ms'] = 0.25 * (k % 2)
        command_ns = stamp + MS + round(latency_ms(k) * MS)
        sent[COMMAND].append((command_ns, encode.command(Command(answer, 0.0, 0.0, 0.0, 0.0))))
        sent[WHY].append((command_ns, encode.why(Why(answer, 0, '', values))))
    made = []
    for name, rows in sent.items():
        sent_ns = [ns for ns, _ in rows]
        made.append(recording(name, [message for _, message in rows], sent_ns, sent_ns))
    return in_memory(*made, path=Path('bag'))


def test_the_parts_of_a_tick_are_told_apart_and_sum_up():
    result = bag_summary.tick_parts(ring(20))
    # of the last one, how long sending took is not known: the tick after it tells
    parts = {'total': 12.0, 'transport': 2.0, 'wait': 0.5, 'prepare': 1.0, 'solve': 4.0}
    for name, each in parts.items():
        assert getattr(result, name) == pytest.approx([each] * 20)
    assert result.publish == pytest.approx([0.25, 0.0] * 10)
    assert sum(result[1:]) == pytest.approx(result.total)
    stamp_ns, latency_s = bag_summary.command_latency(ring(20))
    assert stamp_ns.tolist() == [S + k * TICK for k in range(21)]
    assert latency_s == pytest.approx([12e-3] * 21)


SLOW = {'latency_ms': lambda k: 51.0 if k == 7 else 12.0}
TENTH = {'latency_ms': lambda k: 80.0, 'answered': lambda k: k % 2 == 0}
PERIOD = {'mode': 'realtime', 'parameters': json.dumps({'controller': {'model.step_s': 0.1}})}


COUNTED = {
    'all answered': (ring(20), (20, 0, 0, 0)),
    'one late, one never': (ring(20, **SLOW, answered=lambda k: k != 3), (20, 1, 1, 0)),
    'the period of the contract': (ring(20, **TENTH), (20, 10, 11, 0)),
    'its period': (ring(20, **TENTH)._replace(records={'run': PERIOD}), (10, 0, 0, 0)),
    # a command without a state answers nothing
    'blind': (ring(20, blind=(5, 6)), (20, 2, 0, 2)),
    'blind and late': (ring(20, **SLOW, blind=(5, 6)), (20, 2, 1, 2)),
}


@pytest.mark.parametrize(('bag', 'counts'), COUNTED.values(), ids=COUNTED)
def test_a_tick_without_an_answer_or_with_a_late_one_is_missed(bag, counts):
    result = bag_summary.count_ticks(bag)
    assert tuple(result.values()) == (counts[0], counts[1] + counts[2], *counts[1:])
    assert summarize_bag(bag)['ticks'] == result  # info counts the same
    simulated = bag._replace(recordings={**bag.recordings, '/clock': bag.recordings[STATE]})
    assert bag_summary.count_ticks(simulated)['late'] == 0


SPARSE = {
    'unheard': ring(20, unheard=True),
    'unsaid': ring(20)._replace(recordings={k: ring(20).recordings[k] for k in (STATE, COMMAND)}),
    'unsolved': ring(3, blind=range(4)),
    'one command': ring(3, answered=lambda k: k == 1),
}


@pytest.mark.parametrize('bag', SPARSE.values(), ids=SPARSE)
def test_what_a_bag_does_not_tell_is_a_dash(bag, capsys):
    timing.show(bag_summary.timing_report(bag), Console(width=120))
    (line,) = (item for item in capsys.readouterr().out.splitlines() if 'transport' in item)
    assert set(line.split()[1:]) == {'-'}


def test_the_report_has_quantiles_intervals_and_the_lateness_of_the_plant(tmp_path, bags_prints):
    bag = ring(100, latency_ms=lambda k: 10.0 + 10.0 * (k == 50))
    folder = write_recordings(tmp_path / 'bag', bag.recordings.values(), {})
    result = json.loads(bags_prints('timing', folder, '--json'))
    assert result['mode'] == 'realtime'
    assert result['ticks']['missed'] == 0
    assert result['parts_ms']['total']['p50'] == pytest.approx(10.0)
    assert result['parts_ms']['total']['max'] == pytest.approx(20.0)
    assert result['parts_ms']['transport']['p99'] == pytest.approx(2.0)
    assert result['interval_ms']['mean'] == pytest.approx(50.0)
    assert result['interval_ms']['max'] == pytest.approx(60.0)
    assert result['state_sent_after_its_stamp_ms']['p99'] == pytest.approx(1.0)
    printed = bags_prints('timing', folder)
    for text in ('transport', '100 ticks, 0 missed', 'mean interval 50.000 ms'):
        assert text in printed
    without = {k: v for k, v in bag.recordings.items() if k != STATE}
    with pytest.raises(BagError, match='no message of /vehicle/odometry'):
        bag_summary.timing_report(bag._replace(recordings=without))
