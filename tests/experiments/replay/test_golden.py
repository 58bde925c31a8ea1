"""Every controller still answers its golden recording as it was recorded."""

import json

import pytest

from bags.errors import BagError
from bags.storage import read
from experiments import cli
from experiments.replay import check
from experiments.replay import golden as goldens

from .conftest import FOLDERS, GOLDEN

RECORDED = [name for name, folder in FOLDERS.items() if folder.is_dir()]
compiler = pytest.mark.needs('compiler')  # without one another solver answers


def test_the_controllers_of_the_paper_have_a_golden_recording():
    assert {'mpcc', 'mpcc_no_ca', 'frenet'} <= set(RECORDED)


@compiler
@pytest.mark.parametrize('name', RECORDED)
def test_a_golden_recording_is_answered_as_it_was_recorded(golden, name):
    report = check.check(golden(name), {})
    assert len(report.ticks) > 100
    assert not [(one.tick.number, one.differing) for one in report.failures]
    assert report.repeatable == len(report.ticks)


@compiler
@pytest.mark.parametrize('parameter', ['lag_m', 'steer_rate_radps'])
def test_a_weight_that_is_one_percent_larger_is_detected(golden, parameter):
    noted = json.loads(golden('mpcc').run_info['parameters'])['controller']
    tolerance = noted[f'tolerances.{parameter}'] / 1.01**0.5
    report = check.check(golden('mpcc'), {f'tolerances.{parameter}': tolerance})
    commands = [
        [pair for pair in one.differing if pair.field.startswith('command.')]
        for one in report.failures
    ]
    assert sum(map(bool, commands)) > 100


@compiler
def test_the_command_shows_the_first_tick_that_differs_and_fails(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    bag = str(GOLDEN / 'mpcc')
    assert cli.main(['replay-check', bag, bag]) == 0
    assert capsys.readouterr().out.count('the same in 162 ticks') == 2
    assert cli.main(['replay-check', bag, '--set', 'controller.tolerances.lag_m=0.4975']) == 1
    text = capsys.readouterr().out
    assert 'first in tick 0 at 0.00 s' in text
    assert 'weight.lag' in text
    assert max(map(len, text.splitlines()[1:])) <= 80


@pytest.mark.parametrize('name', RECORDED)
def test_a_golden_recording_is_small_complete_and_free_of_local_paths(golden, name):
    files = list(FOLDERS[name].iterdir())
    assert sum(file.stat().st_size for file in files) < goldens.LARGEST_BYTES
    bag = golden(name)
    assert bag.damage is None
    assert set(json.loads(bag.run_info['parameters'])) == set(goldens.ROLES)
    assert not [value for value in bag.run_info.values() if '/home' in value or '/tmp' in value]


def test_cutting_a_golden_recording_once_more_changes_nothing(golden, tmp_path):
    bag = golden('frenet')
    again = read.load(goldens.cut(bag, tmp_path / 'frenet'))
    assert again.run_info == bag.run_info
    for topic, recorded in bag.recordings.items():
        assert again.recordings[topic].payloads == recorded.payloads


def test_a_recording_that_is_too_large_is_refused(golden, tmp_path, monkeypatch):
    monkeypatch.setattr(goldens, 'LARGEST_BYTES', 1000)
    with pytest.raises(BagError, match='at most 1000'):
        goldens.cut(golden('mpcc'), tmp_path / 'mpcc')
