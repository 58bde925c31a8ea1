"""The machine is named, and one core of it is used."""

import os
import platform
import time

import machine
import pytest


@pytest.fixture
def cores():
    before = os.sched_getaffinity(0)
    yield before
    os.sched_setaffinity(0, before)


def test_the_machine_is_named():
    facts = machine.named()
    assert all(str(value).strip() for value in facts.values())
    assert facts['cores'] >= 1
    assert facts['casadi'][0].isdigit()


def test_the_kernel_is_named_without_its_builder(monkeypatch):
    monkeypatch.setattr(platform, 'release', lambda: '6.1.44-somebody-2')
    assert machine.named()['system'].split() == [platform.system(), '6.1.44']


def test_the_time_of_the_processors_adds_up():
    began = time.monotonic()
    before, end = machine.cpu_times(), began + 0.3
    while time.monotonic() < end:
        pass
    spent, passed_s = machine.cpu_times().since(before), time.monotonic() - began
    # jiffies of 10 ms, of each processor on its own
    assert 0.0 <= spent.stolen_s <= os.cpu_count() * (passed_s + 0.05)
    assert spent.busy_s + spent.stolen_s >= 0.2
    assert spent.busy_s <= os.cpu_count() * (passed_s + 0.05)


def test_pinning_leaves_one_core(cores):
    core = machine.pin()
    assert os.sched_getaffinity(0) == {max(cores)}
    assert core == f'core {max(cores)}'


def test_a_machine_that_does_not_pin_says_so(monkeypatch):
    def refuse(*_):
        raise PermissionError('not allowed')

    monkeypatch.setattr(os, 'sched_setaffinity', refuse)
    assert machine.pin() == 'not pinned (not allowed)'


def test_what_cannot_be_read_is_said_to_be_so(monkeypatch, tmp_path):
    monkeypatch.setattr(machine, 'GOVERNOR', tmp_path / 'none')
    assert machine.named()['governor'] == machine.UNKNOWN
