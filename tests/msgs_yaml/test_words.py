"""What a node tells as text comes back as what it was."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml import words


@settings(derandomize=True, deadline=None)
@given(st.one_of(st.booleans(), st.integers(), st.floats(allow_nan=False)))
def test_numbers_and_truths_survive_to_the_last_bit(value):
    back = words.read(words.write(value))
    assert type(back) is type(value)
    assert back == value


@settings(derandomize=True, deadline=None)
@given(st.text('abc dé_', max_size=10))
def test_words_survive(text):
    assert words.read(words.write(text)) == text


def test_a_number_beyond_all_floats_is_infinite():
    assert words.read('1' * 400) == math.inf
    assert words.read('-' + '1' * 400) == -math.inf


def test_numpy_numbers_are_written_as_plain_numbers():
    assert words.write(np.float64(0.5)) == '0.5'
    assert words.write(np.int32(3)) == '3'
    assert words.write(np.bool_(True)) == 'True'
    assert words.write(np.str_('solved')) == 'solved'


@pytest.mark.parametrize('word', ['1', '1_000', ' 2', 'False', 'infinity', 'NaN'])
def test_a_word_that_reads_as_something_else_is_refused(word):
    with pytest.raises(ValueError, match='would be read as'):
        words.write(word)
