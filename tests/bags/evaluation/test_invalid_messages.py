"""A message that breaks the contract costs itself, not the comparison: left out and counted."""

import io
import json
import math

import pytest
from nav_msgs.msg import Path as PathMessage
from rclpy.serialization import serialize_message
from rich.console import Console

from bags import cli
from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.bag_summary import summarize_bag
from bags.report.comparison import compare_bags, show_comparison
from bags.run import load_quietly
from bags.storage import read
from bags.storage.invalid_messages import count_invalid, drop_invalid
from msgs_yaml import encode
from msgs_yaml.types import Actuators, Imu, VehicleState, Why

STATE, REFERENCE, WHY = '/vehicle/odometry', '/scenario/reference', '/controller/why'
ACTUATORS, IMU = '/vehicle/actuators', '/vehicle/imu'
LATER_NS = 9_000_000_000


def foreign_messages():
    """Return what other publishers may send on our topics: (topic, ns, CDR)."""
    lost = encode.odometry(VehicleState(LATER_NS, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    lost.twist.twist.linear.x = math.nan
    far = encode.odometry(VehicleState(LATER_NS + 1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    far.pose.pose.position.x = 1e9
    words = {'rung': 'solved', 'reason': 'converged', 'time.solve_ms': 'long'}
    return [
        (REFERENCE, LATER_NS, serialize_message(PathMessage())),
        (STATE, LATER_NS, serialize_message(lost)),
        (STATE, LATER_NS, serialize_message(far)),
        (WHY, LATER_NS, serialize_message(encode.why(Why(1_000_000_000, 0, '', words)))[:60]),
        (WHY, LATER_NS, serialize_message(encode.why(Why(1_000_000_000, 0, '', words)))),
    ]


@pytest.fixture
def bag(make_drive, write_bag):
    return write_bag(make_drive(), extra=foreign_messages())


def test_the_verdict_is_that_of_the_valid_messages(make_drive, write_bag, bag):
    clean = write_bag(make_drive(), 'clean')
    result, expected = (dict(load_quietly(item).metrics) for item in (bag, clean))
    assert result == expected
    assert result['completed'] is True
    assert result['min_v2e_m'] == pytest.approx(1.9)


def test_what_was_left_out_is_counted_by_topic_with_the_first_reason(bag, tmp_path):
    compared = compare_bags([bag], tmp_path / 'out')
    result = json.loads(compared.file.read_text())['invalid_messages']['mpcc']
    assert {topic: item['count'] for topic, item in result.items()} == {
        REFERENCE: 1,
        STATE: 2,
        WHY: 1,
    }
    assert result[REFERENCE]['first'] == 'message 1: poses is 0 long; allowed 2 to 40000 elements'
    assert 'twist.twist.linear.x (vx) is nan' in result[STATE]['first']
    assert 'do not fit its definition' in result[WHY]['first']
    console = Console(file=io.StringIO(), width=200)
    show_comparison(compared, console)
    assert f'mpcc: 2 invalid messages of {STATE} were left out; message ' in console.file.getvalue()
    assert f'2 invalid messages of {STATE} were' in ' '.join(compared.report.read_text().split())


def test_a_clean_bag_has_no_word_about_invalid_messages(make_drive, write_bag):
    assert 'invalid_messages' not in summarize_bag(read.load(write_bag(make_drive())))


@pytest.mark.parametrize('stamp_ns', [1, 1_700_000_000 * 10**9])
@pytest.mark.parametrize('topic', [STATE, ACTUATORS, IMU])
def test_a_sample_with_a_stamp_of_another_time_is_left_out_and_counted(
    make_drive, write_bag, topic, stamp_ns
):
    built = {
        STATE: encode.odometry(VehicleState(stamp_ns, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        ACTUATORS: encode.actuators(Actuators(stamp_ns, 0.3, 0.0, -9e3, 0.0, (0.0,) * 4)),
        IMU: encode.imu(Imu(stamp_ns, -20.0, 20.0, 0.0)),
    }
    drive = make_drive()
    clean = write_bag(drive, 'clean')
    folder = write_bag(drive, extra=[(topic, LATER_NS, serialize_message(built[topic]))])
    result, expected = (dict(load_quietly(item).metrics) for item in (folder, clean))
    assert result == expected
    left_out = count_invalid(drop_invalid(read.load(folder)))['invalid_messages']
    assert left_out[topic]['count'] == 1
    assert 'header.stamp is ' in left_out[topic]['first']
    assert summarize_bag(read.load(folder))['ticks'] == summarize_bag(read.load(clean))['ticks']


def test_a_second_state_of_a_stamp_is_still_that_of_a_second_ring(make_drive, write_bag):
    drive = make_drive()
    twin = VehicleState(int(drive.motion.stamp_ns[50]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    extra = [(STATE, LATER_NS, serialize_message(encode.odometry(twin)))]
    with pytest.raises(BagError, match=r'two different messages of one stamp.*shared a ROS domain'):
        load_quietly(write_bag(drive, extra=extra)).metrics[metrics.VERDICT]


@pytest.mark.parametrize('table', ['motion', 'accelerations', 'inputs'])
def test_a_drive_longer_than_a_day_is_refused_before_it_fills_the_memory(make_drive, table):
    drive = make_drive()
    columns = getattr(drive, table)
    stamp_ns = columns.stamp_ns.copy()
    stamp_ns[-1] = 1_700_000_000 * 10**9
    longer = drive._replace(**{table: columns._replace(stamp_ns=stamp_ns)})
    with pytest.raises(BagError, match=r'span 1699999999 s; allowed up to 86400 s'):
        metrics.compute_metrics(longer)


@pytest.mark.parametrize('command', ['info', 'timing'])
def test_the_other_readers_go_on_and_count_too(bag, command, capsys):
    assert cli.main([command, str(bag), '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['invalid_messages'][STATE]['count'] == 2
    assert cli.main([command, str(bag)]) == 0
    output = ' '.join(capsys.readouterr().out.split())
    assert f'1 invalid messages of {REFERENCE} were left out; message 1: poses is 0 long' in output


def test_a_bag_with_nothing_valid_of_a_topic_cannot_be_judged_and_says_why(make_drive, write_bag):
    drive = make_drive()
    folder = write_bag(drive, extra=foreign_messages()[:1])
    bag = read.load(folder)
    item = bag.recordings[REFERENCE]
    only = item._replace(
        log_ns=item.log_ns[1:],
        publish_ns=item.publish_ns[1:],
        sequence=item.sequence[1:],
        payloads=item.payloads[1:],
    )
    only = drop_invalid(bag._replace(recordings=bag.recordings | {REFERENCE: only}))
    with pytest.raises(BagError, match=r'no valid message of /scenario/reference .* poses is 0'):
        read.columns(only, [REFERENCE])


def test_reports_and_ticks_agree_in_what_info_says(make_drive, write_bag, capsys):
    drive = make_drive()
    # the state that ends the run is answered, too
    ticks = drive.ticks._replace(answered_ns=drive.motion.stamp_ns[::50])
    assert cli.main(['info', str(write_bag(drive._replace(ticks=ticks)))]) == 0
    output = capsys.readouterr().out
    assert '100 ticks' in output
    assert '101 reports of the controller, 1 of them on the last state, which is no tick' in output
    assert 'rungs: solved 101' in output


def test_braking_without_a_state_is_no_answer_to_the_last_state(make_drive, write_bag, capsys):
    drive = make_drive()
    last_ns = int(drive.motion.stamp_ns[-1])
    ticks = drive.ticks._replace(answered_ns=drive.motion.stamp_ns[::50])
    blind = {'rung': 'braking', 'reason': 'state_stale'}
    stamps_ns = [last_ns + k * 50_000_000 for k in range(5)]
    extra = [(WHY, ns, serialize_message(encode.why(Why(ns, 0, '', blind)))) for ns in stamps_ns]
    folder = write_bag(drive._replace(ticks=ticks), extra=extra)
    assert cli.main(['info', str(folder)]) == 0
    output = capsys.readouterr().out
    assert '106 reports of the controller, 1 of them on the last state, which is no tick' in output
