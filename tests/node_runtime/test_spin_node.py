"""A node process starts, runs and ends as a person and a supervisor expect."""

import os
import signal
import time

import pytest

from node_runtime import shutdown


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
def test_a_signal_does_not_interrupt_a_callback(run, number):
    node = run(tick="__import__('time').sleep(1.0); print('whole', flush=True)")
    node.until('tick')
    node.popen.send_signal(number)
    node.popen.send_signal(number)  # a terminal and a supervisor may both send it
    code, out, err = node.result()
    assert (code, err) == (0, '')
    assert 'whole' in out


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_interrupts_the_construction_of_a_node(run, number):
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


HELD = "__import__('ctypes').PyDLL(None).sleep(60)"


@pytest.mark.parametrize(
    ('tick', 'code'), [('spin_node.finish(self, 3)', 3), ('1 / 0', 1), ('self.exit_code = 5', 5)]
)
def test_a_node_ends_with_its_code_even_if_the_middleware_hangs(run, tick, code):
    node = run(tick=tick, destroy=HELD)
    node.until('tick')
    begin = time.monotonic()
    node.popen.send_signal(signal.SIGINT)
    exit_code, out, err = node.result()
    assert exit_code == code
    assert 'close' in out
    assert shutdown.TRACEBACK_START in err
    assert 'in destroy_node' in err
    assert time.monotonic() - begin < 12.0


def test_closing_a_node_has_no_time_limit(run):
    node = run(close="__import__('time').sleep(4.0); self.exit_code = 6")
    node.until('tick')
    node.popen.send_signal(signal.SIGINT)
    code, out, err = node.result()
    assert (code, err) == (6, '')
    assert out.count('close') == 1


@pytest.mark.parametrize('destroy', ['pass', HELD])
def test_an_error_in_close_ends_the_node_with_an_error(run, destroy):
    node = run(close='1 / 0', destroy=f"print('leaves', flush=True); {destroy}")
    node.until('tick')
    node.popen.send_signal(signal.SIGINT)
    code, out, err = node.result()
    assert code == 1
    assert 'ZeroDivisionError' in err
    assert 'leaves' in out


HALF_MADE = f"""
        class Held:
            def __del__(self):
                print('freed', flush=True)
                {HELD}
        self.held = Held()
        print('half', flush=True)
        """


@pytest.mark.parametrize(
    ('start', 'code', 'error'),
    [
        ('1 / 0', 1, 'ZeroDivisionError'),
        (
            "raise __import__('node_runtime.parameters').parameters.ParameterError('gain: no')",
            os.EX_CONFIG,
            'gain: no',
        ),
        ("__import__('time').sleep(60)", 0, ''),
    ],
)
def test_a_half_constructed_node_ends_with_its_code(run, start, code, error):
    node = run(start=HALF_MADE + start)
    node.until('half')
    if not error:
        node.popen.send_signal(signal.SIGINT)
    exit_code, out, err = node.result()
    assert exit_code == code
    assert error in err
    assert shutdown.TRACEBACK_START in err
    assert 'freed' in out


EARS = """
import os, socket
filters = []
for name in os.listdir('/proc/self/fd'):
    try:
        ear = socket.socket(fileno=int(name))
    except OSError:
        continue
    if ear.type == socket.SOCK_DGRAM and ear.family == socket.AF_INET:
        filters.append(len(ear.getsockopt(socket.SOL_SOCKET, 26, 64)))  # how many instructions
    ear.detach()
print('filters', *filters, flush=True)
"""


def test_a_node_receives_nothing_while_it_shuts_down(run, tmp_path):
    """Fast DDS may wait for ever for the end of what it hears meanwhile."""
    (tmp_path / 'ears.py').write_text(EARS)
    node = run(tick='import ears', destroy='import importlib, ears; importlib.reload(ears)')
    hears = node.until('filters').split()[1:]
    node.popen.send_signal(signal.SIGINT)
    code, out, err = node.result()
    assert (code, err) == (0, '')
    assert len(hears) >= 3  # multicast, unicast, user data
    assert set(hears) == {'0'}
    assert out.split('filters')[1].split() == ['1'] * len(hears)


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        (['-p', 'gian:=1.0'], "gian: this node has no such parameter; did you mean 'gain'?"),
        (['-p', 'gain:=10'], 'gain: is 10; allowed 0 to 9 N'),
        (['-p', 'gain:=many'], "gain: must be a number, is 'many'; allowed 0 to 9 N"),
        (['-p', 'mode:=fast'], "mode: is 'fast'; allowed lockstep or realtime"),
        (['-p', 'gain'], "Couldn't parse parameter override rule"),
        (['--params-file', '/nowhere.yaml'], "Couldn't parse params file"),
    ],
)
def test_a_wrong_command_line_is_one_clear_message_and_no_start(run, arguments, error):
    code, out, err = run('--ros-args', *arguments).result()
    assert code == os.EX_CONFIG
    assert error in err
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
