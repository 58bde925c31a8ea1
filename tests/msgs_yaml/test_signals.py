"""Signals interrupt while a node is made, and only ask while it runs."""

import signal

import pytest

from msgs_yaml import signals

both = pytest.mark.parametrize('number', signals.SIGNALS)


@both
def test_at_first_a_signal_interrupts(number):
    with signals.caught(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


@both
def test_later_it_asks_as_often_as_it_comes(number):
    asked = []
    with signals.caught():
        signals.ask_instead(lambda: asked.append(number))
        signal.raise_signal(number)
        signal.raise_signal(number)
    assert asked == [number, number]


@both
def test_the_handlers_from_before_come_back(number):
    before = signal.getsignal(number)
    with signals.caught():
        assert signal.getsignal(number) is not before
    assert signal.getsignal(number) is before


def test_a_node_may_have_its_own_handler():
    heard, asked = [], []
    with signals.caught():
        signal.signal(signal.SIGTERM, lambda *_: heard.append('own'))
        signals.ask_instead(lambda: asked.append('asked'))
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert (heard, asked) == (['own'], ['asked'])


def test_an_ignored_signal_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with signals.caught():
            signal.raise_signal(signal.SIGINT)
            signals.ask_instead(lambda: pytest.fail('asked'))
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
