"""Signals interrupt while a node is made, and only ask while it runs."""

import signal

import pytest

from node_runtime import signals

both = pytest.mark.parametrize('number', signals.SIGNALS)


@pytest.fixture(autouse=True)
def handlers_of_the_tests():
    """This process goes on: it gets its handlers back."""
    before = {number: signal.getsignal(number) for number in signals.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


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
def test_afterwards_nothing_interrupts_the_end_of_the_process(number):
    with signals.caught():
        assert signal.getsignal(number) is not signal.SIG_IGN
    assert signal.getsignal(number) is signal.SIG_IGN


def test_a_node_may_have_its_own_handler():
    heard, asked = [], []
    with signals.caught():
        signal.signal(signal.SIGTERM, lambda *_: heard.append('own'))
        signals.ask_instead(lambda: asked.append('asked'))
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert (heard, asked) == (['own'], ['asked'])


@both
def test_a_signal_that_the_parent_ignores_is_handled(number):
    asked = []
    signal.signal(number, signal.SIG_IGN)
    with signals.caught():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        signals.ask_instead(lambda: asked.append(number))
        signal.raise_signal(number)
    assert asked == [number]
