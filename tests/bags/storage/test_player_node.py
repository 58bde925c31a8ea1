"""A real player over Fast DDS: what a recorder hears is what was recorded."""

import itertools
import os
import re
import signal
import termios
import time

import numpy as np
import pytest
from one_second import of_contract
from wait_until import wait_until

from bags import cli
from bags.storage import read, repair

STATE = '/vehicle/odometry'
LATE_S = 0.01  # a machine that does nothing else wakes a thread in a tenth of that


@pytest.fixture
def start_player(start_node):
    """Factory of players that wait for one recorder."""

    def start(bag, recorders=1, **options):
        given = {'bag': bag, 'delay_s': 0.0, 'recorders': recorders, **options}
        return start_node('bags.player_node', **given)

    return start


def said_by(player):
    """Return everything that a player says, once it has ended by itself."""
    code, output = player.wait()
    assert code == 0, output
    return output


def payloads(folder):
    return {name: r.payloads for name, r in of_contract(folder).items()}


def insist_on_the_end(node):
    """Send signals of both kinds until a node has ended; return its exit code."""
    signals = itertools.cycle([signal.SIGTERM, signal.SIGINT])

    def insist():
        node.process.send_signal(next(signals))
        time.sleep(0.002)

    wait_until(lambda: node.process.poll() is not None, 90.0, node.said, pause=insist)
    return node.wait()[0]


@pytest.mark.smoke
def test_round_trip_keeps_every_byte_count_order_and_stamp(
    tmp_path, bag_folder, start_recorder, start_player
):
    noted = tmp_path / 'run.json'
    noted.write_text('{"scenario": "double_lane_change", "parameters": {"N": 50}}')
    inside = start_recorder(tmp_path / 'inside', namespace='/car1', run_info=noted)
    outside = start_recorder(tmp_path / 'outside')
    output = said_by(start_player(bag_folder, namespace='/car1'))
    assert insist_on_the_end(inside) == outside.end()[0] == 0
    before, after = of_contract(bag_folder), of_contract(tmp_path / 'inside')
    assert after.keys() == before.keys()
    for name, recorded in before.items():
        assert after[name].payloads == recorded.payloads, name
        # in lockstep a message is filed under its header stamp
        assert after[name].log_ns.tolist() == recorded.log_ns.tolist(), name
        assert after[name].sequence.tolist() == recorded.sequence.tolist(), name
        age_s = time.time() - after[name].publish_ns / 1e9
        assert ((age_s > 0.0) & (age_s < 3600.0)).all(), name
    assert f'played {sum(len(r.payloads) for r in before.values())} messages' in output
    known = read.run_info(bag_folder) | {'namespace': '/car1'}
    assert read.run_info(tmp_path / 'inside') == known
    assert repair.repair_bag(tmp_path / 'inside').intact
    assert of_contract(tmp_path / 'outside') == {}


@pytest.mark.alone
def test_messages_are_sent_when_they_were_recorded(
    tmp_path, bag_folder, start_recorder, start_player
):
    recorder = start_recorder(tmp_path / 'again')
    said_by(start_player(bag_folder, start_s=0.2, duration_s=0.5, topics=f'[{STATE}]'))
    assert recorder.end()[0] == 0
    state = of_contract(tmp_path / 'again')[STATE]
    assert state.payloads == payloads(bag_folder)[STATE][200:701]
    late_ns = state.publish_ns - state.log_ns
    # the median: single messages wait while the machine does something else
    late_s = (late_ns - late_ns.min()) / 1e9
    assert np.median(late_s) < LATE_S
    # and at no time is the player ahead or behind for long
    assert np.ptp([part.min() for part in np.array_split(late_s, 5)]) < LATE_S


def test_rate_and_loop_repeat_a_damaged_bag_up_to_the_damage_faster(
    tmp_path, bag_folder, start_player
):
    whole, cut = (bag_folder / 'mpcc_0.mcap').read_bytes(), tmp_path / 'cut.mcap'
    cut.write_bytes(whole[: 3 * len(whole) // 4])
    with pytest.warns(UserWarning, match='damaged'):
        sent = read.load(cut).recordings['/vehicle/imu'].log_ns
    arguments = {'rate': 10.0, 'loop': 'true', 'topics': '[/vehicle/imu]', 'clock_hz': 0.0}
    player = start_player(cut, recorders=0, **arguments)
    played = f'played {len(sent)} messages'
    output = player.until(lambda output: output.count(played) >= 6)
    assert player.end()[0] == 0
    assert output.count(f'{cut}: damaged at byte ') >= 6
    # the times of the log
    lines = (line for line in output.splitlines() if played in line)
    ends = [float(re.search(r'\[(\d+\.\d+)\]', line)[1]) for line in lines]
    # by the clock of the player
    least_s = np.ptp(sent) / 1e10
    assert 0.99 * least_s < min(np.diff(ends)) < 5 * least_s


def test_keys_pause_step_and_end(bag_folder, start_player, tmp_path, start_recorder):
    recorder = start_recorder(tmp_path / 'again')
    leader, follower = os.openpty()
    before = termios.tcgetattr(follower)
    keys = {'topics': f'[{STATE}]', 'clock_hz': 0.0, 'paused': 'true', 'step_s': 0.004}
    player = start_player(bag_folder, terminal=follower, **keys)
    try:
        for said, key in (
            ('space: pause and resume', b's'),
            ('paused at 0.004 s', b's'),
            ('paused at 0.008 s', b'q'),
            ('ended at 0.009 s', b''),
        ):
            player.until(lambda output, said=said: said in output)
            os.write(leader, key)
        assert player.wait()[0] == 0
        assert termios.tcgetattr(follower) == before
    finally:
        os.close(leader)
        os.close(follower)
    assert recorder.end()[0] == 0
    assert payloads(tmp_path / 'again')[STATE] == payloads(bag_folder)[STATE][:9]


def test_command_becomes_the_player_with_every_option(monkeypatch):
    became = []
    monkeypatch.setattr(os, 'execv', lambda path, words: became.append(words))
    options = '--rate 2 --start 1 --duration 3 --loop --topics /a /b --clock 0 --paused --step 0.1'
    cli.main(['play', '1.0', *options.split()])
    (words,) = became
    arguments = [word for word in words if ':=' in word]
    assert arguments == [
        *('bag:="1.0"', 'rate:=2.0', 'start_s:=1.0', 'duration_s:=3.0', 'loop:=true'),
        *('topics:=["/a", "/b"]', 'clock_hz:=0.0', 'paused:=true', 'step_s:=0.1'),
    ]
