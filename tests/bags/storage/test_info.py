"""`bags info` says what a bag holds, what was lost, and how quickly the controller answered."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from one_second import expected

from bags import cli
from bags.evaluation.bag_summary import summarize_bag
from bags.storage import read
from bags.storage.bag_writer import BagWriter


@pytest.fixture
def limping(tmp_path, bag_folder):
    """A bag in which states 3 and 4 were lost, one tick is unanswered and one fell back."""
    recordings = read.load(bag_folder).recordings
    topics = ['/vehicle/odometry', '/controller/command', '/controller/why', '/clock']
    chosen = [recordings[name] for name in topics]
    writer = BagWriter(tmp_path / 'bag', [r.topic for r in chosen], {'run': {'scenario': 's'}})
    for index, recorded in enumerate(chosen):
        left_out = {0: (3, 4), 1: (7,)}.get(index, ())
        for i, data in enumerate(recorded.payloads):
            if i not in left_out:
                stamp_ns = int(recorded.log_ns[i])
                # every command is sent 4 ms after its state, the last one 9 ms
                delay_ns = (4_000_000, 9_000_000)[i == 19] * (index == 1)
                if index == 2 and i == 5:
                    data = data.replace(b'solved', b'shifte')
                writer.write(index, stamp_ns, stamp_ns + delay_ns, data, i + 1)
    writer.close()
    return tmp_path / 'bag'


def test_summary_counts_rates_gaps_and_losses(limping):
    result = summarize_bag(read.load(limping))
    state = result['topics']['/vehicle/odometry']
    assert state['messages'] == 998
    assert state['lost'] == 2
    assert state['lost_places'] == 1
    assert state['lost_longest'] == 2
    assert state['sent_before'] == 0
    assert state['longest_gap_s'] == pytest.approx(0.003)
    assert state['rate_hz'] == pytest.approx(997 / 0.999)
    assert result['topics']['/controller/command']['longest_gap_s'] == pytest.approx(0.1)
    assert result['duration_s'] == pytest.approx(0.999)
    assert result['mode'] == 'lockstep'


def test_latency_is_from_sending_the_state_to_sending_the_command(limping):
    latency_ms = summarize_bag(read.load(limping))['latency_ms']
    assert latency_ms['p50'] == pytest.approx(4.0)
    assert latency_ms['max'] == pytest.approx(9.0)
    assert latency_ms['p99'] == pytest.approx(np.percentile([4.0] * 18 + [9.0], 99))


def test_unanswered_period_is_a_miss_and_lockstep_is_never_late(limping):
    assert summarize_bag(read.load(limping))['ticks'] == {
        'count': 20,
        'missed': 1,
        'unanswered': 1,
        'late': 0,
        'blind': 0,
    }


def test_fallbacks_are_counted_by_reason(limping, bag_folder):
    result = summarize_bag(read.load(limping))
    assert result['rungs'] == {'solved': 19, 'shifte': 1}
    assert sum(result['fallbacks'].values()) == 1
    assert summarize_bag(read.load(bag_folder))['fallbacks'] == {}


def test_numbers_of_several_publishers_say_nothing_about_losses(tmp_path, bag_folder):
    recorded = read.load(bag_folder).recordings['/diagnostics']
    writer = BagWriter(tmp_path / 'bag', [recorded.topic], {})
    for sequence in (1, 1, 2, 2, 5):
        writer.write(0, 1, 1, recorded.payloads[0], sequence)
    writer.close()
    assert summarize_bag(read.load(tmp_path / 'bag'))['topics']['/diagnostics']['lost'] is None


def test_bag_without_states_is_described_too(tmp_path, bag_folder):
    recorded = read.load(bag_folder).recordings['/controller/command']
    writer = BagWriter(tmp_path / 'bag', [recorded.topic], {})
    writer.write(0, 1, 1, recorded.payloads[0])
    writer.close()
    result = summarize_bag(read.load(tmp_path / 'bag'))
    assert result['latency_ms'] is None
    assert result['topics']['/controller/command']['rate_hz'] is None
    assert cli.main(['info', str(tmp_path / 'bag')]) == 0


def test_command_prints_a_row_per_topic(bag_folder, messages, capsys):
    assert cli.main(['info', str(bag_folder)]) == 0
    output = capsys.readouterr().out
    for topic, sent in messages.items():
        (row,) = (line for line in output.splitlines() if line.startswith(topic))
        assert f' {len(sent)} ' in row
    assert 'state to command in ms: p50' in output
    assert 'scenario: double_lane_change' in output


def test_what_was_lost_is_said_with_its_places(limping, capsys):
    assert cli.main(['info', str(limping)]) == 0
    assert '2 in 1 places' in capsys.readouterr().out


def test_a_hash_stays_one_word(tmp_path, bag_folder, capsys):
    recorded = read.load(bag_folder).recordings['/controller/command']
    entries = {'scenario_sha256': 'f' * 64}
    writer = BagWriter(tmp_path / 'bag', [recorded.topic], {'run': entries})
    writer.write(0, 1, 1, recorded.payloads[0])
    writer.close()
    assert cli.main(['info', str(tmp_path / 'bag')]) == 0
    assert f'scenario_sha256: {"f" * 64}\n' in capsys.readouterr().out


def test_command_prints_json_on_demand(bag_folder, messages, capsys):
    assert cli.main(['info', str(bag_folder), '--json']) == 0
    topics = json.loads(capsys.readouterr().out)['topics']
    assert {name: topics[name]['messages'] for name in messages} == expected(messages)


def test_damage_is_part_of_what_is_printed(tmp_path, bag_folder, capsys):
    (tmp_path / 'cut.mcap').write_bytes((bag_folder / 'mpcc_0.mcap').read_bytes()[:-9])
    assert cli.main(['info', str(tmp_path / 'cut.mcap')]) == 0
    assert 'bags repair' in ' '.join(capsys.readouterr().out.split())


def test_what_cannot_be_read_is_an_error_in_one_line(tmp_path, capsys):
    assert cli.main(['info', str(tmp_path / 'none')]) == 1
    assert capsys.readouterr().err.count('\n') == 1


def test_a_pipe_gets_every_row_in_one_line():
    """As awk and grep read it; a terminal has a width."""
    bag = Path(__file__).parents[3] / 'bags/reference/double_lane_change/mpcc'
    env = {name: value for name, value in os.environ.items() if name != 'COLUMNS'}
    command = [sys.executable, '-m', 'bags.cli', 'info', str(bag)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=env)
    (row,) = (line for line in done.stdout.splitlines() if line.startswith('/vehicle/odometry'))
    topic, count, rate, gap, lost, *places = row.split()
    assert (topic, count, rate, gap) == ('/vehicle/odometry', '162', '20.00', '0.050')
    assert int(lost) > 7000  # 49 of 50 states are cut out of a golden bag
    assert places == ['in', '161', 'places']
