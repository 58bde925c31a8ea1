"""Exceptions around the steps of a controller node: a command leaves, or the plant brakes.

The node is a real one in this process, driven tick by tick. In realtime its clock is set.
"""

import node_bench
import pytest
from controller_driver import FALLBACK, SILENT, SOLVE, Driver

from mpcc_controller.driving.last_resort import INTERNAL_ERROR
from msgs_yaml import encode

pytestmark = pytest.mark.ros
LINE = 'internal error, counted from now on: '
TICKS = 5  # that fail
ANY = ''  # outcome of a tick


@pytest.fixture(scope='module', params=['lockstep', 'realtime'])
def driver(request):
    with node_bench.running('controller', request.param) as bench:
        yield Driver(bench)


@pytest.fixture
def driving(driver):
    driver.recover()
    driver.node.controller.errors.counts.clear()
    return driver


def failing(*_, **__):
    raise RuntimeError('injected')


def tick(driver):
    """Send every input of a tick; return stamp and answer."""
    stamp_ns = driver.next_tick()
    driver.send_valid()
    return stamp_ns, driver.look()


def logged(capfd):
    """Return the lines of the log about internal errors since the last call."""
    out, err = capfd.readouterr()
    return [line for line in (out + err).splitlines() if LINE in line]


# what raises, and the outcome of such a tick: braking, silence where nothing can be sent, or any
CALLS = {
    **dict.fromkeys(
        (
            'node.inputs.decode_state',
            'node.watchdog.fault',
            'node.trigger.age_s',
            'node.missing_subscribers',
            'node.trigger.due',
            'node.controller.step',
            'node.controller.reset',  # at a restart
        ),
        FALLBACK,
    ),
    **dict.fromkeys(('encode.command', 'node.command_pub.publish'), SILENT),
    **{
        f'node.watchdog.{name}': ANY
        for name in ('on_timer', 'on_step', 'offer', 'check', 'is_state_lost')
    },
}


@pytest.mark.parametrize(('called', 'outcome'), CALLS.items())
def test_the_car_brakes_if_it_can_while_a_call_of_the_node_raises_and_drives_on(
    driving, monkeypatch, capfd, called, outcome
):
    first, *between, name = called.split('.')
    owner = {'node': driving.node, 'encode': encode}[first]
    for attribute in between:
        owner = getattr(owner, attribute)
    if name == 'reset':
        driving.restart()
        logged(capfd)
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, failing)
        for _ in range(TICKS):
            stamp_ns, answer = tick(driving)
            assert answer.outcome == outcome or not outcome
            if outcome == FALLBACK:
                assert answer.stamp_ns == driving.last.stamp_ns == stamp_ns
                assert INTERNAL_ERROR in answer.reason
    if outcome == FALLBACK and name != 'reset':
        assert driving.last.Fxf + driving.last.Fxr < -5000.0
    assert driving.recover().outcome == SOLVE
    lines = logged(capfd)
    assert len(lines) <= 1
    if outcome:
        assert f'RuntimeError in {__file__.rpartition("/")[2]}' in lines[0]
        assert sum(driving.node.controller.errors.counts.values()) >= TICKS


def test_a_command_that_cannot_be_sent_is_replaced_by_a_braking_one(driving, monkeypatch):
    wanted, sent = [], driving.last

    def encode_braking_only(command):
        wanted.append(command)
        if len(wanted) == 1:
            raise ValueError('no such command')
        return kept(command)

    kept = encode.command
    with monkeypatch.context() as patch:
        patch.setattr(encode, 'command', encode_braking_only)
        stamp_ns, answer = tick(driving)
    assert (answer.outcome, answer.stamp_ns) == (FALLBACK, stamp_ns)
    assert [command.stamp_ns for command in wanted] == [stamp_ns] * 2
    assert driving.last == wanted[1]
    # from what was sent, not from what was to be sent
    limits, push = driving.node.params.limits, wanted[1].Fxf + wanted[1].Fxr - sent.Fxf - sent.Fxr
    assert abs(push) <= limits.force_rate_nps * 0.05 * (1 + 1e-6)
    assert abs(wanted[1].delta - sent.delta) <= limits.steer_rate_radps * 0.05 * (1 + 1e-6)
    assert driving.recover().outcome == SOLVE


# in lockstep time waits for the state
@pytest.mark.parametrize('driver', ['realtime'], indirect=True)
def test_a_car_without_a_state_brakes_also_where_nothing_tells_how_old_it_is(driving, monkeypatch):
    monkeypatch.setattr(driving.node.watchdog, 'is_state_lost', failing)
    for _ in range(driving.node.params.fallback.max_plan_age + 2):
        before = driving.last
        driving.next_tick()
        driving.look()
        assert driving.last.stamp_ns > before.stamp_ns
    assert driving.last.Fxf + driving.last.Fxr < 0


def test_a_node_whose_warm_up_raises_drives(driving, monkeypatch, capfd):
    driving.node.is_warm = False
    with monkeypatch.context() as patch:
        patch.setattr(encode, 'prediction', failing)
        assert tick(driving)[1].outcome == SILENT
    assert driving.node.is_warm
    assert len(logged(capfd)) == 1
    assert driving.recover().outcome == SOLVE
