"""The helper that waits for a condition."""

import pytest
from wait_until import wait_until


def test_the_first_true_value_is_returned():
    values = iter([None, 0, '', 'there'])
    assert wait_until(lambda: next(values), 30.0, 'never') == 'there'


def test_a_timeout_fails_with_the_message():
    with pytest.raises(AssertionError, match=r'waited for 0\.05 s: the log says nothing'):
        wait_until(lambda: False, 0.05, lambda: 'the log says nothing')


def test_the_pause_is_called_between_two_polls():
    work = []
    assert wait_until(lambda: len(work) == 3, 30.0, 'never', pause=lambda: work.append(1))
    assert work == [1, 1, 1]
