"""Where the time of a tick went, from bags whose every time is made up."""

import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bags import cli
from bags.commands import timing
from bags.errors import BagError
from bags.evaluation import bag_summary, tick_timing
from bags.storage import message_filing, read
from bags.storage.bag_writer import BagWriter
from bags.storage.read import Bag, Recording
from msgs_yaml import contract, encode
from msgs_yaml.types import Command, VehicleState, Why
from node_runtime import ros

MS, S = 1_000_000, 1_000_000_000
TICK = 50 * MS
TOPICS = {topic.name: topic for topic in message_filing.bag_topics(contract.load(), 'realtime')}
STATE, COMMAND, WHY = '/vehicle/odometry', '/controller/command', '/controller/why'


def recording(name, messages):
    """`messages` are (wall time of sending, message)."""
    sent_ns = np.array([ns for ns, _ in messages], dtype=np.int64)
    payloads = [ros.serialize(msg) for _, msg in messages]
    return Recording(TOPICS[name], sent_ns, sent_ns, 1 + np.arange(len(messages)), payloads)


def state(stamp_ns):
    return encode.odometry(VehicleState(stamp_ns, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0))


def why(stamp_ns, reason, values):
    named = {'rung': 'solved', 'reason': reason, 'gate': 'passed'}
    return encode.why(Why(stamp_ns, 0, '', named | values))


def ring(ticks, latency_ms=lambda k: 12.0, answered=lambda k: True, blind=()):
    """States every 50 ms sent 1 ms late, heard 2 ms after that; waits 0.5, prepares 1, solves 4."""
    states, commands, whys = [], [], []
    for k in range(ticks + 1):
        stamp = S + k * TICK
        sent = stamp + MS
        states.append((sent, state(stamp)))
        answer = stamp + 20 * MS + 1 if k in blind else stamp
        if not (answered(k) or k in blind):
            continue
        times = {'time.wait_ms': 0.5, 'time.prepare_ms': 1.0, 'time.solve_ms': 4.0}
        times |= {'time.heard_ns': sent + 2 * MS}
        sending = {'time.publish_ms': 0.25 * (k % 2)}
        command = sent + round(latency_ms(k) * MS)
        commands.append((command, encode.command(Command(answer, 0.0, 0.0, 0.0, 0.0))))
        reason = 'state_stale' if k in blind else 'converged'
        whys.append((command, why(answer, reason, sending if k in blind else times | sending)))
    result = {STATE: states, COMMAND: commands, WHY: whys}
    built = {name: recording(name, item) for name, item in result.items()}
    return Bag(path=Path('bag'), files=(), recordings=built, records={}, damage=None)


def test_the_parts_of_a_tick_are_told_apart_and_sum_up():
    result = tick_timing.tick_parts(ring(20))
    assert len(result.total) == 20  # of the last one, how long sending took is not known
    assert result.total == pytest.approx([12.0] * 20)
    assert result.transport == pytest.approx([2.0] * 20)
    assert result.wait == pytest.approx([0.5] * 20)
    assert result.prepare == pytest.approx([1.0] * 20)
    assert result.solve == pytest.approx([4.0] * 20)
    # told by the tick after
    assert result.publish == pytest.approx([0.25, 0.0] * 10)
    assert sum(result[1:]) == pytest.approx(result.total)


def test_a_tick_without_an_answer_or_with_a_late_one_is_missed():
    slow = ring(20, latency_ms=lambda k: 51.0 if k == 7 else 12.0, answered=lambda k: k != 3)
    assert tick_timing.count_ticks(slow) == (20, 1, 1, 0)
    assert tick_timing.count_ticks(slow).missed == 2
    assert tick_timing.count_ticks(ring(20)).missed == 0


def test_the_period_is_that_of_the_controller_that_drove():
    # ten times a second instead of twenty times
    slow = ring(20, latency_ms=lambda k: 80.0, answered=lambda k: k % 2 == 0)
    told = json.dumps({'controller': {'model.step_s': 0.1}})
    assert tick_timing.count_ticks(slow).missed == 10 + 11
    slow = slow._replace(records={'run': {'mode': 'realtime', 'parameters': told}})
    assert tick_timing.count_ticks(slow) == (10, 0, 0, 0)


def test_a_command_without_a_state_answers_nothing():
    result = tick_timing.count_ticks(ring(20, blind=(5, 6)))
    assert result == (20, 2, 0, 2)
    assert len(tick_timing.tick_parts(ring(20, blind=(5, 6))).total) == 18


def test_info_and_timing_count_the_same_misses():
    bag = ring(20, latency_ms=lambda k: 51.0 if k == 7 else 12.0, blind=(5, 6))
    counted = tick_timing.count_ticks(bag)
    assert counted.missed == 3
    result = bag_summary.summarize_bag(bag)
    assert result['ticks'] == {**counted._asdict(), 'missed': 3}


def test_in_lockstep_nothing_is_late():
    bag = ring(20, latency_ms=lambda k: 80.0)
    assert tick_timing.count_ticks(bag).late == 21
    simulated = bag._replace(recordings={**bag.recordings, '/clock': bag.recordings[STATE]})
    assert tick_timing.count_ticks(simulated).late == 0


def unheard(bag):
    """The bag of a controller that does not say when it heard a state."""
    messages = []
    for item in read.values(bag, WHY):
        values = {name: v for name, v in item.values.items() if name != 'time.heard_ns'}
        messages.append((item.stamp_ns, why(item.stamp_ns, 'converged', values)))
    return bag._replace(recordings={**bag.recordings, WHY: recording(WHY, messages)})


def unsaid(bag):
    """The bag of a controller that says nothing."""
    return bag._replace(recordings={n: r for n, r in bag.recordings.items() if n != WHY})


SPARSE = {
    'unheard': unheard(ring(20)),
    'unsaid': unsaid(ring(20)),
    'unsolved': ring(3, blind=range(4)),
    'one command': ring(3, answered=lambda k: k == 1),
}


@pytest.mark.parametrize('bag', SPARSE.values(), ids=SPARSE)
def test_what_a_bag_does_not_tell_is_a_dash(bag, capsys):
    result = tick_timing.timing_report(bag)
    timing.show(result, Console(width=120))
    (line,) = (item for item in capsys.readouterr().out.splitlines() if 'transport' in item)
    assert set(line.split()[1:]) == {'-'}


def test_the_report_has_quantiles_intervals_and_the_lateness_of_the_plant():
    result = tick_timing.timing_report(ring(100, latency_ms=lambda k: 10.0 + 10.0 * (k == 50)))
    assert result['mode'] == 'realtime'
    assert result['parts_ms']['total']['p50'] == pytest.approx(10.0)
    assert result['parts_ms']['total']['max'] == pytest.approx(20.0)
    assert result['interval_ms']['mean'] == pytest.approx(50.0)
    assert result['interval_ms']['max'] == pytest.approx(60.0)
    assert result['state_sent_after_its_stamp_ms']['p99'] == pytest.approx(1.0)


def test_a_bag_without_states_says_so():
    bag = ring(5)
    without = bag._replace(recordings={k: v for k, v in bag.recordings.items() if k != STATE})
    with pytest.raises(BagError, match='no message of /vehicle/odometry'):
        tick_timing.timing_report(without)


@pytest.fixture
def folder(tmp_path):
    bag = ring(40)
    writer = BagWriter(tmp_path / 'bag', [item.topic for item in bag.recordings.values()], {})
    for index, item in enumerate(bag.recordings.values()):
        for row, payload in enumerate(item.payloads):
            sent = int(item.publish_ns[row])
            writer.write(index, sent, sent, payload, row + 1)
    writer.close()
    return tmp_path / 'bag'


def test_the_command_prints_a_table_and_json(folder, capsys):
    assert cli.main(['timing', str(folder)]) == 0
    printed = capsys.readouterr().out
    assert 'transport' in printed
    assert '40 ticks, 0 missed' in printed
    assert 'mean interval 50.000 ms' in printed
    assert cli.main(['timing', str(folder), '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['parts_ms']['transport']['p99'] == pytest.approx(2.0)
    assert result['ticks']['missed'] == 0
