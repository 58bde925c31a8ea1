"""The helper that every test waits with."""

import pytest
from until import until


def test_what_becomes_true_is_returned():
    values = iter([None, 0, '', 'there'])
    assert until(lambda: next(values), 30.0, 'never') == 'there'


def test_what_never_becomes_true_fails_with_its_message():
    with pytest.raises(AssertionError, match=r'waited for 0\.05 s: the log says nothing'):
        until(lambda: False, 0.05, lambda: 'the log says nothing')


def test_the_pause_lets_somebody_work_between_two_looks():
    work = []
    assert until(lambda: len(work) == 3, 30.0, 'never', pause=lambda: work.append(1))
    assert work == [1, 1, 1]
