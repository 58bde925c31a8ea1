"""A short soak; the documented run is `python bench/soak.py`."""

import subprocess
import sys
from pathlib import Path

import pytest
import soak

BENCH = Path(__file__).parents[2] / 'bench'

HOUR, SHORT = 60.0, 0.4  # minutes
RESTARTED = ('recorder', 'scenario', 'plant')
LOOK = soak.Look(100.0, 20, 15)
# looks: warm from the sixth tenth on at the latest, so that the two medians share none
ENOUGH = 10


def test_what_stays_as_it_is_did_not_grow():
    assert soak.growth('plant', [LOOK] * 100, HOUR).grew == []


def test_more_memory_files_and_threads_in_the_end_are_growth():
    for change in ({'memory_mb': 104.0}, {'files': 21}, {'threads': 16}):
        looks = [LOOK] * 60 + [LOOK._replace(**change)] * 40
        assert soak.growth('plant', looks, HOUR).grew == list(change)


def test_a_short_soak_is_held_to_less_memory_and_to_the_same_files_and_threads():
    for change in ({'memory_mb': 102.5}, {'files': 21}, {'threads': 16}):
        looks = [LOOK] * 60 + [LOOK._replace(**change)] * 40
        assert soak.growth('plant', looks, SHORT).grew == list(change)
    looks = [LOOK] * 60 + [LOOK._replace(memory_mb=102.5)] * 40
    assert soak.growth('plant', looks, HOUR).grew == []


def test_the_backlog_of_the_recorder_is_no_growth_in_a_short_soak():
    looks = [LOOK] * 60 + [LOOK._replace(memory_mb=146.0)] * 40
    for node in ('recorder', 'recorder.2'):
        assert soak.growth(node, looks, SHORT).grew == []
        assert soak.growth(node, looks, HOUR).grew == ['memory_mb']
        more = [LOOK] * 60 + [LOOK._replace(memory_mb=148.0)] * 40
        assert soak.growth(node, more, SHORT).grew == ['memory_mb']


def test_memory_that_is_held_for_a_moment_is_no_growth():
    peak = LOOK._replace(memory_mb=105.0)
    assert soak.growth('plant', [LOOK, LOOK, LOOK, peak] * 40, SHORT).grew == []


def test_a_short_soak_waits_until_the_histories_are_full():
    filling = [LOOK._replace(memory_mb=float(min(k, 50))) for k in range(100)]
    assert soak.growth('scenario', filling, SHORT).grew == []
    assert soak.growth('scenario', filling, HOUR).grew == ['memory_mb']


def test_what_grows_while_it_starts_is_none():
    looks = [LOOK._replace(memory_mb=5.0 * k) for k in range(20)] + [LOOK] * 80
    assert soak.growth('plant', looks, HOUR).grew == []


@pytest.mark.parametrize('minutes', ['601', '0', 'nan'])
def test_a_soak_that_cannot_be_driven_is_refused(minutes):
    command = [sys.executable, BENCH / 'soak.py', '--minutes', minutes]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 2
    assert '0.1 to 600' in result.stderr


@pytest.mark.usefixtures('dds')
def test_a_short_drive_does_not_make_the_nodes_grow():
    result = subprocess.run(
        [sys.executable, BENCH / 'soak.py', '--minutes', '0.4'],
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert 'nothing grew' in result.stdout
    looks = [int(line.split()[1]) for line in result.stdout.splitlines()[1:5]]
    # an idle machine takes 95 looks, one with three workers and other programs 35
    assert min(looks) >= ENOUGH


def test_a_soak_of_several_drives_is_one_life_of_the_controller(monkeypatch, tmp_path, domain):
    monkeypatch.setattr(soak, 'LONGEST_DRIVE_MIN', 0.1)
    found = soak.soak('lockstep', 0.2, tmp_path, domain)
    lives = [one.node for one in found]
    restarted = [f'{role}.{number}' for number in (1, 2) for role in RESTARTED]
    assert sorted(lives) == sorted([*restarted, 'controller'])
    looks = {one.node: one.looks for one in found}
    assert looks['controller'] > looks['plant.1'] + looks['plant.2'] - 4
    assert min(looks.values()) >= ENOUGH


def test_a_soak_on_the_wall_clock_drives_to_its_end(tmp_path, domain, wall_clock):
    with wall_clock.own_drive():
        found = soak.soak('realtime', soak.LEAST_MIN, tmp_path, domain)
    assert {one.node for one in found} == {'controller', *RESTARTED}
    assert min(one.looks for one in found) >= ENOUGH
