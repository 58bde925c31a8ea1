"""A node process starts, runs and ends as a person and a supervisor expect."""

import os
import signal
import time

import pytest

pytestmark = pytest.mark.ros


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_node_cleanly(run, number):
    node = run()
    node.until('tick')
    begin = time.monotonic()
    node.popen.send_signal(number)
    code, _, err = node.result()
    assert (code, err) == (0, '')
    assert time.monotonic() - begin < 5.0


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_does_not_tear_a_callback(run, number):
    node = run(tick="__import__('time').sleep(1.0); print('whole', flush=True)")
    node.until('tick')
    node.popen.send_signal(number)
    node.popen.send_signal(number)  # a terminal and a supervisor may both send it
    code, out, err = node.result()
    assert (code, err) == (0, '')
    assert 'whole' in out


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_interrupts_the_making_of_a_node(run, number):
    node = run(start="__import__('time').sleep(60)")
    node.until('gain')
    begin = time.monotonic()
    node.popen.send_signal(number)
    code, out, err = node.result()
    assert (code, err) == (0, '')
    assert 'tick' not in out
    assert time.monotonic() - begin < 5.0


def test_a_signal_keeps_the_exit_code_that_the_node_has_set(run):
    node = run(tick='self.exit_code = 5')
    node.until('tick')
    node.popen.send_signal(signal.SIGTERM)
    assert node.result()[0] == 5


def test_a_node_that_finishes_ends_with_its_code_and_at_once(run):
    node = run(tick='spin_node.finish(self, 3)')
    code, out, err = node.result()
    assert (code, err) == (3, '')
    assert out.count('tick') == 1


def test_a_node_may_finish_before_it_spins(run):
    code, out, _ = run(start='spin_node.finish(self, 4)').result()
    assert code == 4
    assert 'tick' not in out


def test_an_error_in_a_callback_ends_the_node_and_is_shown(run):
    code, _, err = run(tick='1 / 0').result()
    assert code == 1
    assert 'ZeroDivisionError' in err


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (['-p', 'gian:=1.0'], "gian: this node has no such parameter; did you mean 'gain'?"),
        (['-p', 'gain:=10'], 'gain: is out of range with 10; allowed 0 to 9 N'),
        (['-p', 'gain:=many'], "gain: must be a number, is 'many'; allowed 0 to 9 N"),
        (['-p', 'mode:=fast'], "mode: is 'fast'; allowed lockstep or realtime"),
        (['-p', 'gain'], "Couldn't parse parameter override rule"),
        (['--params-file', '/nowhere.yaml'], "Couldn't parse params file"),
    ],
)
def test_a_wrong_command_line_is_one_clear_message_and_no_start(run, arguments, says):
    code, out, err = run('--ros-args', *arguments).result()
    assert code == os.EX_CONFIG
    assert says in err
    assert 'Traceback' not in err
    assert 'gain' not in out


def test_a_typo_in_a_parameter_file_stops_the_node(run, tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('test_node:\n  ros__parameters:\n    gainn: 3.0\n')
    code, _, err = run('--ros-args', '--params-file', str(file)).result()
    assert code == os.EX_CONFIG
    assert "gainn: this node has no such parameter; did you mean 'gain'?" in err


def test_parameters_come_from_the_command_line(run):
    node = run('--ros-args', '-p', 'gain:=1', '-p', 'use_sim_time:=true')
    assert node.until('gain') == 'gain 1.0'


def test_discovery_stays_on_this_machine_unless_the_user_says_otherwise(run):
    assert run().until('range') == 'range LOCALHOST'
    other = run(ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET')
    assert other.until('range') == 'range SUBNET'
