"""No end of a recorder costs more than a second, and one that cannot begin says so in one line."""

import resource
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from capabilities import report_missing
from one_second import counts, endless, expected
from wait_until import wait_until

from bags.errors import BagError, DamagedBagWarning
from bags.storage import read, repair
from bags.storage.mcap_reader import read_mcap
from node_runtime import shutdown

pytestmark = pytest.mark.usefixtures('domain')
LOST_BY_A_KILL_S = 1.0
ENDS_S = 90.0


def publish_until_it_ends(ring, recorder, messages):
    """Send states until the recorder ends."""
    states = endless(messages['/vehicle/odometry'])

    def publish():
        ring.publish('/vehicle/odometry', next(states))
        time.sleep(0.0005)

    ended = recorder.process.poll
    wait_until(lambda: ended() is not None, ENDS_S, 'the recorder goes on', pause=publish)


@pytest.mark.alone
def test_kill_costs_less_than_the_last_second(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag')
    end = time.monotonic() + 2.0
    sent = []
    for value in endless(messages['/vehicle/odometry']):
        ring.publish('/vehicle/odometry', value)
        sent.append(time.monotonic())
        time.sleep(0.001)
        if sent[-1] > end:
            break
    recorder.end(signal.SIGKILL)
    folder = tmp_path / 'bag'
    assert not (folder / 'metadata.yaml').exists()
    done = repair.repair_bag(folder)
    recovered = done.messages['/vehicle/odometry']
    assert not done.intact
    assert sent[-1] - sent[recovered - 1] < LOST_BY_A_KILL_S
    assert read_mcap(folder / 'bag_0.mcap').indexed
    assert counts(folder) == {'/vehicle/odometry': recovered}


HELD = """
import ctypes, sys
from rclpy.node import Node
from bags import recorder_node
Node.destroy_node = lambda node: ctypes.PyDLL(None).sleep(60)
sys.exit(recorder_node.main())
"""


def test_a_recorder_that_the_middleware_holds_has_completed_its_bag(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag', program=('-c', HELD))
    ring.publish_all(messages)
    code, output = recorder.end()
    assert code == 0, output
    assert shutdown.TRACEBACK_START in output
    assert counts(tmp_path / 'bag') == expected(messages)
    assert repair.repair_bag(tmp_path / 'bag').intact


def test_existing_folder_is_refused_in_one_line(tmp_path, start_recorder, bag_folder):
    before = (bag_folder / 'mpcc_0.mcap').read_bytes()
    code, output = start_recorder(bag_folder).wait()
    assert code != 0
    assert f'out: {bag_folder}: exists already' in output
    assert 'Traceback' not in output
    assert (bag_folder / 'mpcc_0.mcap').read_bytes() == before


@pytest.mark.parametrize(
    ('text', 'why'),
    [('[1, 2]', 'must be one JSON object'), ('{', 'Expecting property name')],
)
def test_facts_that_are_no_json_object_are_refused(tmp_path, start_recorder, text, why):
    (tmp_path / 'run.json').write_text(text)
    code, output = start_recorder(tmp_path / 'bag', run_info=tmp_path / 'run.json').wait()
    assert code != 0
    assert why in output
    assert 'Traceback' not in output


def test_full_disk_ends_the_recorder_with_an_error_and_keeps_the_beginning(
    tmp_path, start_pair, messages
):
    recorder, ring = start_pair(tmp_path / 'bag')
    ring.publish('/clock', messages['/clock'][0])
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (60_000, 60_000))
    publish_until_it_ends(ring, recorder, messages)
    code, output = recorder.wait()
    assert code == 1, output
    assert 'File too large' in output
    assert '`bags repair' in output
    assert repair.repair_bag(tmp_path / 'bag').messages['/clock'] == 1


def test_clock_that_jumps_back_ends_the_recorder_with_a_complete_bag(
    tmp_path, start_pair, messages
):
    recorder, ring = start_pair(tmp_path / 'bag')
    last = '/diagnostics'
    ring.publish_all({topic: sent for topic, sent in messages.items() if topic != last})
    wait_until(lambda: recorder.hears('/clock'), ENDS_S, recorder.said)
    # a stamp by the wall clock; a plant that is started again: its first state, then its clock
    late = messages['/controller/command'][0]._replace(stamp_ns=1_700_000_000 * 10**9)
    ring.publish_all(
        {'/controller/command': [late], '/vehicle/odometry': messages['/vehicle/odometry'][:1]}
    )
    ring.publish_all({last: messages[last]})
    wait_until(lambda: recorder.hears(last), ENDS_S, recorder.said)
    ring.publish('/clock', messages['/clock'][0])
    code, output = recorder.wait()
    assert code == 1
    last_s, first_s = (messages['/clock'][i] / 1e9 for i in (-1, 0))
    assert f'/clock: the clock jumped backwards from {last_s:.9f} s to {first_s:.9f} s' in output
    assert '1 messages are left out whose stamp fell back before /clock did' in output
    assert 'Traceback' not in output
    sent = expected(messages)
    sent['/controller/command'] += 1
    assert counts(tmp_path / 'bag') == sent
    assert repair.repair_bag(tmp_path / 'bag').intact


def test_a_message_with_a_stamp_of_another_time_ends_nothing_and_moves_no_other(
    tmp_path, start_pair, messages
):
    recorder, ring = start_pair(tmp_path / 'bag')
    stray = {
        '/controller/command': 1_700_000_000 * 10**9,  # by the wall clock
        '/vehicle/odometry': 0,
    }
    half = {topic: values[: len(values) // 2] for topic, values in messages.items()}
    rest = {topic: values[len(half[topic]) :] for topic, values in messages.items()}
    ring.publish_all(half)
    for topic, stamp_ns in stray.items():
        ring.publish(topic, messages[topic][0]._replace(stamp_ns=stamp_ns))
    ring.publish_all(rest)
    code, output = recorder.end()
    assert code == 0, output
    recordings = read.load(tmp_path / 'bag').recordings
    for topic, stamp_ns in stray.items():
        assert output.count(f'{topic}: a message has the stamp {stamp_ns / 1e9:.9f} s') == 1
        assert f'{topic}: 1 messages are filed under another time' in output
        log_ns = recordings[topic].log_ns.tolist()
        sent = [value.stamp_ns for value in messages[topic]]
        assert sorted(log_ns)[0] == sent[0]
        assert sorted(log_ns)[-1] <= max(sent[-1], recordings['/clock'].log_ns[-1])
        assert len(log_ns) == len(sent) + 1
        assert set(sent) <= set(log_ns)


def test_folder_that_cannot_be_written_is_refused_in_one_line(start_recorder):
    # nobody may make a folder there, not even root
    code, output = start_recorder(Path('/sys/bag')).wait()
    assert code != 0
    assert 'out: /sys/bag: cannot be created' in output
    assert 'Traceback' not in output


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 300 kB."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    result = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', 'size=300k', 'tmpfs', disk], capture_output=True
    )
    if result.returncode:
        report_missing('mounts', 'a limit of file size is tested instead')
    yield disk
    subprocess.run(['umount', '-l', disk], check=True)


def test_disk_that_fills_up_ends_the_recorder_and_every_chunk_on_it_is_recovered(
    small_disk, tmp_path, start_pair, messages
):
    recorder, ring = start_pair(small_disk / 'bag', chunk_s=0.05)
    publish_until_it_ends(ring, recorder, messages)
    code, output = recorder.wait()
    assert code == 1, output
    assert 'No space left on device' in output
    assert 'Traceback' not in output
    with pytest.warns(DamagedBagWarning):
        state = read.load(small_disk / 'bag').recordings['/vehicle/odometry']
    assert len(state.payloads) > 100
    assert (np.diff(state.log_ns) == 1_000_000).all()
    # there is no room to repair it there; elsewhere there is
    with pytest.raises(BagError, match=r'cannot be repaired: .*No space left'):
        repair.repair_bag(small_disk / 'bag')
    copy = shutil.copytree(small_disk / 'bag', tmp_path / 'bag')
    assert repair.repair_bag(copy).messages['/vehicle/odometry'] == len(state.payloads)
