"""Mistakes in commands and nodes: one line that says what is wrong and what would be right."""

import signal
from pathlib import Path

import pytest
import rclpy

from bags import cli
from bags.player_node import PlayerNode
from bags.recorder_node import RecorderNode
from node_runtime.parameters import ParameterError

GOLDEN = Path(__file__).parents[2] / 'bags/reference/double_lane_change/mpcc'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the working folder: an empty bag, a bag of noise, and what is no bag."""
    monkeypatch.chdir(tmp_path)
    for name, data in (('mpcc_road', b''), ('noise', b'not a recording')):
        (tmp_path / 'runs' / name).mkdir(parents=True)
        (tmp_path / 'runs' / name / f'{name}_0.mcap').write_bytes(data)
    (tmp_path / 'runs' / 'notes').mkdir()
    for name in ('a_0.mcap', 'b_0.mcap'):
        (tmp_path / 'runs' / 'notes' / name).touch()
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'report.html').touch()
    (tmp_path / 'list.json').write_text('[1, 2]')
    (tmp_path / 'torn.json').write_text('{')
    return tmp_path


@pytest.mark.parametrize('command', ['info', 'timing', 'repair', 'distances', 'compare'])
@pytest.mark.parametrize(
    ('path', 'why'),
    [
        ('nothing', 'nothing: there is no such bag; '),
        ('runs/mpc_road', "holds mpcc_road, noise, notes; did you mean 'runs/mpcc_road'"),
        ('empty', 'empty: not a bag: it must hold one file *.mcap, or the numbered ones of one '),
        ('runs/notes', 'it holds a_0.mcap, b_0.mcap'),
        ('runs', 'is no bag, but holds some; give one of them: mpcc_road, noise, notes'),
        ('runs/mpcc_road', 'mpcc_road_0.mcap: the file is empty'),
        ('runs/noise', 'noise_0.mcap: '),
    ],
)
def test_what_is_no_bag_is_refused_by_name(folder, capsys, command, path, why):
    assert cli.main([command, path]) == 1
    error = capsys.readouterr().err
    assert why in error
    assert error.startswith('error: ')
    assert error.count('\n') == 1


@pytest.mark.parametrize(
    ('words', 'code', 'why'),
    [
        (['compare', 'report.html', 'runs/mpcc_road'], 1, 'since they are no bags: report.html\n'),
        (['compare', 'runs/noise', 'runs/noise/'], 1, 'does not begin as an MCAP file'),
        (['film', 'runs/noise', '--out', 'film.avi'], 1, 'a film ends with .gif or .mp4'),
        (['compair'], 2, "did you mean 'compare'"),
        (['compare', 'x', '--forse'], 2, "did you mean '--force'"),
        (['compare'], 2, 'BAG'),
    ],
)
def test_a_mistake_is_said(folder, capsys, words, code, why):
    try:
        result = cli.main(words)
    except SystemExit as ended:
        result = ended.code
    assert result == code
    assert why in capsys.readouterr().err


@pytest.mark.parametrize(
    ('node', 'parameters', 'why'),
    [
        (PlayerNode, {}, 'bag: is missing'),
        (PlayerNode, {'bag': 'nowhere'}, 'bag: nowhere: there is no such bag'),
        (PlayerNode, {'bag': GOLDEN, 'rate': 0.0}, 'rate: is 0'),
        (PlayerNode, {'bag': GOLDEN, 'paused': 'true'}, 'paused: is true, but no keyboard'),
        (RecorderNode, {}, 'out: is missing'),
        (RecorderNode, {'out': 'empty'}, 'out: .*empty: exists already'),
        # nobody may make a folder there, not even root
        (RecorderNode, {'out': '/sys/bag'}, 'out: /sys/bag: cannot be created'),
        (RecorderNode, {'out': 'a', 'run_info': 'list.json'}, 'must be one JSON object'),
        (RecorderNode, {'out': 'b', 'run_info': 'torn.json'}, 'Expecting property name'),
    ],
)
def test_a_node_that_cannot_begin_names_the_parameter(folder, domain, node, parameters, why):
    """What a process makes of the error: tests/node_runtime/test_spin_node.py."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    before = sorted(folder.rglob('*'))
    words = (word for item in parameters.items() for word in ('-p', '{}:={}'.format(*item)))
    rclpy.init(args=['--ros-args', *words])
    try:
        with pytest.raises(ParameterError, match=why):
            node().start()
    finally:
        rclpy.shutdown()
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert sorted(folder.rglob('*')) == before
