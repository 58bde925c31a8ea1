"""Draws follow their distributions, are evenly spread, and depend on seed and number alone."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from experiments.batch import distributions
from experiments.batch.distributions import Choice, LogUniform, Normal, Uniform
from msgs_yaml.strict_yaml import YamlError, read

FOUR = {
    'a': Uniform(-1.0, 3.0),
    'b': LogUniform(0.1, 10.0),
    'c': Normal(1.0, 0.5, 0.0, 1.5),
    'd': Choice(('x', 'y')),
}


@pytest.fixture
def parse(tmp_path):
    def parse_one(text):
        path = tmp_path / 'one.yaml'
        path.write_text(f'\n{text}\n')
        return distributions.parse(read(path))

    return parse_one


def test_draws_follow_their_distributions():
    """By the test of Kolmogorov and Smirnov against scipy; points of Sobol pass it by far."""
    draws = distributions.sample(FOUR, 1024, seed=3)
    expected = {
        'a': stats.uniform(-1.0, 4.0),
        'b': stats.loguniform(0.1, 10.0),
        'c': stats.truncnorm(-2.0, 1.0, 1.0, 0.5),
    }
    for name, distribution in expected.items():
        values = [draw[name] for draw in draws]
        assert stats.kstest(values, distribution.cdf).statistic < 0.01


def test_a_power_of_two_has_as_many_draws_in_every_part():
    draws = distributions.sample(FOUR, 64, seed=9)
    for part in range(8):
        low = -1.0 + 4.0 * part / 8
        assert sum(low <= draw['a'] < low + 0.5 for draw in draws) == 8
    assert sum(draw['d'] == 'x' for draw in draws) == 32


@given(st.integers(0, 60), st.integers(0, 60), st.integers(0, 2**32 - 1))
def test_a_part_of_a_sample_is_that_part_of_a_longer_one(first, count, seed):
    longer = distributions.sample(FOUR, 128, seed)
    assert distributions.sample(FOUR, count, seed, first) == longer[first : first + count]


def test_another_seed_gives_other_draws():
    one, other = (distributions.sample(FOUR, 8, seed) for seed in (1, 2))
    assert not {draw['a'] for draw in one} & {draw['a'] for draw in other}


@given(
    st.floats(-1e3, 1e3),
    st.floats(1e-3, 1e3),
    st.floats(0.0, 1.0),
    st.floats(-3.0, 3.0),
    st.floats(0.01, 3.0),
)
def test_no_value_leaves_its_interval(low, width, share, offset_sds, sd):
    high = low + width
    assert low <= Uniform(low, high).value(share) <= high
    assert low <= Normal(low + offset_sds * sd, sd, low, high).value(share) <= high
    assert width <= LogUniform(width, 7.0 * width).value(share) <= 7.0 * width
    assert Choice((1, 2, 3)).value(share) in (1, 2, 3)


def test_distributions_are_read(parse):
    assert parse('{uniform: [1, 2e0]}') == Uniform(1.0, 2.0)
    assert parse('{log_uniform: [1e-3, 1]}') == LogUniform(0.001, 1.0)
    assert parse('{normal: [0, 1], within: [-1, 2]}') == Normal(0.0, 1.0, -1.0, 2.0)
    assert parse('{choice: [free, 2, true]}') == Choice(('free', 2, True))
    assert math.isclose(parse('{log_uniform: [0.01, 100]}').value(0.5), 1.0)


@pytest.mark.parametrize(
    ('text', 'what'),
    [
        ('{unifrom: [0, 1]}', "unifrom: is no distribution; did you mean 'uniform'"),
        ('{uniform: [1, 0]}', 'uniform: is from 1 to 0; allowed .* low < high'),
        ('{uniform: [1]}', 'uniform: has 1 elements; allowed exactly 2'),
        ('{uniform: [0, .inf]}', r'uniform\[1\]: must be finite, is .inf'),
        ('{uniform: 3}', 'uniform: must be a list'),
        ('{log_uniform: [0, 1]}', 'log_uniform: begins at 0; allowed above 0'),
        ('{normal: [0, 1]}', 'within is missing'),
        ('{normal: [0, 0], within: [0, 1]}', 'standard deviation 0; allowed above 0'),
        ('{normal: [0, 1], within: [9, 10]}', 'within: is from 9 to 10; allowed .* 8 standard'),
        ('{choice: []}', 'choice: is empty'),
        ('{uniform: [0, 1], choice: [1]}', 'exactly one of uniform'),
        ('{uniform: [0, 1], within: [0, 1]}', 'within: is no distribution'),
        ('[1, 2]', 'must be a mapping'),
    ],
)
def test_an_error_names_the_line_and_what_is_allowed(parse, text, what):
    with pytest.raises(YamlError, match=rf'one.yaml:2: .*{what}'):
        parse(text)


def test_draws_out_of_range_are_refused():
    with pytest.raises(ValueError, match='allowed 0 to 1073741823'):
        distributions.sample(FOUR, 1, seed=1, first=distributions.MAX_DRAWS)
