"""A real recorder over Fast DDS: it loses nothing, and notes what was lost before it."""

import itertools
import json
import platform
import signal
import time

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from one_second import counts, endless, expected, of_contract
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import String
from wait_until import wait_until

from bags.evaluation import bag_summary, tick_timing
from bags.storage import read, repair
from node_runtime import ros

pytestmark = pytest.mark.usefixtures('domain')
TIMEOUT_S = 90
FULL_RATE_HZ = 2400  # messages of all topics of the contract together


@pytest.fixture
def recorder(tmp_path, start_pair, messages):
    """Return a recorder to which everything was sent."""
    recorder, ring = start_pair(tmp_path / 'bag')
    ring.publish_all(messages)
    return recorder


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signal_completes_the_bag_with_everything_delivered(tmp_path, recorder, messages, number):
    code, output = recorder.end(number)
    assert code == 0, output
    assert counts(tmp_path / 'bag') == expected(messages)
    assert repair.repair_bag(tmp_path / 'bag').intact


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_more_signals_until_the_process_has_ended_change_nothing(
    tmp_path, recorder, messages, number
):
    ended = recorder.process.poll

    def insist():
        recorder.process.send_signal(number)
        time.sleep(0.002)

    wait_until(lambda: ended() is not None, TIMEOUT_S, recorder.said, pause=insist)
    code, output = recorder.wait()
    assert code == 0, output
    assert counts(tmp_path / 'bag') == expected(messages)


def request(ring, transition):
    """Ask the recorder for a transition of its life cycle."""
    client = ring.node.create_client(ChangeState, '/recorder/change_state')
    assert client.wait_for_service(TIMEOUT_S)
    wish = ChangeState.Request(transition=Transition(label=transition))
    executor = SingleThreadedExecutor(context=ring.context)
    future = client.call_async(wish)
    rclpy.spin_until_future_complete(ring.node, future, executor, TIMEOUT_S)
    assert future.result().success


def test_what_arrives_during_a_pause_is_neither_recorded_nor_lost(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag')
    states = messages['/vehicle/odometry'][:40]
    for transition, part in (
        ('deactivate', slice(0, 10)),
        ('activate', slice(10, 20)),
        ('deactivate', slice(20, 30)),
    ):
        ring.publish_all({'/vehicle/odometry': states[part]})
        time.sleep(0.3)  # the recorder takes them
        request(ring, transition)
    for transition in ('cleanup', 'configure', 'activate'):  # into another bag
        request(ring, transition)
    ring.wait_for_recorder()
    ring.publish_all({'/vehicle/odometry': states[30:]})
    code, output = recorder.end()
    assert code == 0, output
    assert 'lost' not in output
    for folder, count in (('bag', 20), ('bag_2', 10)):
        bag = read.load(tmp_path / folder)
        assert len(bag.recordings['/vehicle/odometry'].payloads) == count
        topic = bag_summary.summarize_bag(bag)['topics']['/vehicle/odometry']
        assert topic['lost'] == json.loads(bag.records['losses']['/vehicle/odometry'])['lost'] == 0


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_logs_transitions_and_the_description_of_the_car_are_recorded(
    mode, tmp_path, start_pair, messages
):
    recorder, ring = start_pair(tmp_path / 'bag', mode=mode)
    description = ros.publisher(ring.node, '/robot_description')
    description.publish(String(data='<robot/>'))
    if mode == 'lockstep':
        ring.publish_all({'/clock': messages['/clock']})
    for transition in ('deactivate', 'activate'):
        request(ring, transition)
    assert description.wait_for_all_acked(Duration(seconds=TIMEOUT_S))
    assert recorder.end()[0] == 0
    bag = read.load(tmp_path / 'bag')
    names = {'/rosout', '/recorder/transition_event', '/robot_description'}
    assert {name for name in names if bag.recordings[name].payloads} == names
    if mode == 'lockstep':
        times_ns = bag.recordings['/clock'].log_ns
        for name in names:
            log_ns = bag.recordings[name].log_ns
            assert times_ns[0] <= log_ns.min() <= log_ns.max() <= times_ns[-1]
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(tmp_path / 'bag') as reader:
        (message,) = (
            store.deserialize_cdr(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == '/robot_description'
        )
    assert message.data == '<robot/>'


def test_lockstep_files_every_message_under_its_stamp(bag_folder):
    recordings = read.load(bag_folder).recordings
    for topic, table in read.columns(bag_folder).items():
        assert recordings[topic].log_ns.tolist() == table.stamp_ns.tolist(), topic


def test_publisher_is_counted_and_its_clock_is_kept(bag_folder):
    for topic, recorded in of_contract(bag_folder).items():
        assert recorded.sequence.tolist() == list(range(1, len(recorded.payloads) + 1)), topic
        age_s = time.time() - recorded.publish_ns / 1e9
        assert ((age_s > 0.0) & (age_s < 3600.0)).all(), topic


@pytest.mark.alone
def test_realtime_files_messages_under_their_arrival(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag', mode='realtime')
    before_ns, end, wanted = time.time_ns(), time.monotonic() + TIMEOUT_S, None
    for sent, value in enumerate(endless(messages['/vehicle/odometry']), start=1):
        ring.publish('/vehicle/odometry', value)
        time.sleep(0.001)
        if wanted is None and recorder.hears('/vehicle/odometry'):
            wanted = sent + 200
        if sent == wanted or (wanted is None and time.monotonic() > end):
            break
    assert wanted is not None, recorder.said()
    after_ns = time.time_ns()
    time.sleep(0.3)  # best effort: nothing tells when the last one has arrived
    assert recorder.end()[0] == 0
    state = read.load(tmp_path / 'bag').recordings['/vehicle/odometry']
    # best effort, five deep: it takes more than that at a time, and misses none once it listens
    first = int(state.sequence[0])
    assert state.sequence.tolist() == list(range(first, wanted + 1))
    assert first <= wanted - 200
    assert (state.publish_ns >= before_ns).all()
    assert (state.log_ns >= state.publish_ns).all()
    assert (state.log_ns <= after_ns + 10**8).all()


def test_several_publishers_of_one_topic_are_no_loss(tmp_path, start_recorder, make_ring, messages):
    recorder, rings = start_recorder(tmp_path / 'bag'), [make_ring('lockstep') for _ in range(2)]
    for ring in rings:
        ring.wait_for_recorder()
    (health,) = messages['/diagnostics']
    for publisher in (0, 0, 0, 1, 0):
        rings[publisher].publish('/diagnostics', health)
        time.sleep(0.1)
    for ring in rings:
        ring.wait_until_received()
    code, output = recorder.end()
    assert code == 0
    assert 'lost' not in output


def test_recording_at_full_rate_takes_a_third_of_a_core_at_most(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag')
    # a second has 20 ticks; /clock is sent as a stamp of its own
    streams = {t: endless(v) for t, v in messages.items() if t != '/clock' and len(v) > 1}

    def second():
        """Send for a second; return how many, and the processor time of the recorder for them."""
        cpu_s, began, sent = recorder.cpu_s(), time.monotonic(), 0
        for tick in range(20):
            for topic, stream in streams.items():
                for value in itertools.islice(stream, -(-len(messages[topic]) // 20)):
                    ring.publish(topic, value)
                    sent += 1
            time.sleep(max(0.0, began + 0.05 * (tick + 1) - time.monotonic()))
        ring.wait_until_received()
        return sent, recorder.cpu_s() - cpu_s

    second()  # the first: it has just started
    seconds = [second() for _ in range(4)]
    assert recorder.end()[0] == 0
    assert sum(counts(tmp_path / 'bag').values()) == 5 * seconds[0][0]
    # what else the machine does makes work dearer, never cheaper
    assert min(cpu_s / sent for sent, cpu_s in seconds) * FULL_RATE_HZ <= 0.35


def test_latency_joins_command_and_state_by_their_stamp(bag_folder, messages):
    bag = read.load(bag_folder)
    joined = tick_timing.command_latency(bag)
    assert joined.stamp_ns.tolist() == [sent.stamp_ns for sent in messages['/controller/command']]
    state, command = (bag.recordings[name] for name in (tick_timing.STATE, tick_timing.COMMAND))
    assert joined.latency_s[3] == (command.publish_ns[3] - state.publish_ns[150]) / 1e9


def test_losses_of_each_topic_are_noted_in_the_bag(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag', mode='realtime')
    for value in itertools.islice(endless(messages['/vehicle/odometry']), 100):
        ring.publish('/vehicle/odometry', value)  # the first is received: what follows is a loss
        time.sleep(0.01)
    recorder.process.send_signal(signal.SIGSTOP)
    # more than the middleware holds for a reader that does not look: the rest is lost
    for value in itertools.islice(endless(messages['/vehicle/odometry']), 8000):
        ring.publish('/vehicle/odometry', value)
    recorder.process.send_signal(signal.SIGCONT)
    for value in itertools.islice(endless(messages['/vehicle/odometry']), 100):
        ring.publish('/vehicle/odometry', value)
        time.sleep(0.01)
    code, output = recorder.end()
    assert code == 0, output
    bag = read.load(tmp_path / 'bag')
    entries = {topic: json.loads(text) for topic, text in bag.records['losses'].items()}
    sequence = bag.recordings['/vehicle/odometry'].sequence
    lost = int(sequence[-1] - sequence[0] + 1 - len(sequence))
    assert lost > 0
    assert entries['/vehicle/odometry']['received'] == len(sequence)
    assert entries['/vehicle/odometry']['lost'] == lost
    assert entries['/vehicle/odometry']['before'] == sequence[0] - 1
    assert entries['/clock'] == dict.fromkeys(('lost', 'gaps', 'longest', 'before'), None) | {
        'received': 0
    }
    assert f'/vehicle/odometry: {lost} messages lost' in output


def test_recorder_splits_on_request_and_loses_nothing(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag', split_s=0.4)
    ring.publish_all(messages)
    code, output = recorder.end()
    assert code == 0, output
    assert len(list((tmp_path / 'bag').glob('bag_*.mcap'))) >= 3
    assert counts(tmp_path / 'bag') == expected(messages)
    assert repair.repair_bag(tmp_path / 'bag').intact


def test_bag_that_was_recorded_by_hand_says_by_what_and_where(tmp_path, start_pair, messages):
    recorder, ring = start_pair(tmp_path / 'bag', mode='realtime')
    ring.publish_all({'/scenario/reference': messages['/scenario/reference']})
    assert recorder.end()[0] == 0
    known = read.run_info(tmp_path / 'bag')
    assert known['mode'] == 'realtime'
    assert json.loads(known['versions'])['python'] == platform.python_version()
    assert json.loads(known['machine'])['kernel'] == platform.release().split('-')[0]
    assert 'git_commit' in known
