"""Exceptions are counted by kind: type and line. Each kind is told once."""

from mpcc_controller.driving.internal_errors import InternalErrors


def caught(function):
    try:
        function()
    except Exception as error:
        return error


def fail():
    raise ValueError('once')


def fail_deeper():
    fail()


def fail_elsewhere():
    raise ValueError('once')


def test_a_kind_is_its_type_and_the_line_that_raised_it_whoever_called():
    errors = InternalErrors()
    assert errors.take_new() == []
    for function in (fail, fail_deeper, fail, fail_elsewhere):
        errors.add(caught(function))
    first, second = errors.take_new()
    assert first.startswith('ValueError in test_internal_errors.py, line ')
    assert first.endswith(', fail: once')
    assert second.endswith(', fail_elsewhere: once')
    assert list(errors.counts.values()) == [3, 1]
    assert errors.latest == second


def test_a_kind_that_was_told_is_not_told_again():
    errors = InternalErrors()
    errors.add(caught(fail))
    errors.take_new()
    errors.add(caught(fail))
    assert errors.take_new() == []


def test_an_exception_that_was_never_raised_has_its_type_only():
    errors = InternalErrors()
    errors.add(ValueError('built'))
    assert errors.latest == 'ValueError: built'
