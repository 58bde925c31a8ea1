"""The surrogate against functions whose Sobol' indices are known in closed form."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import qmc

from experiments.settings_analysis import surrogate

NAMES = ('a', 'b', 'c', 'd')


def draw(count=256, seed=1):
    points = qmc.Sobol(len(NAMES), seed=seed).random(count)
    return pd.DataFrame(points, columns=NAMES)


def test_the_indices_of_a_linear_function():
    """y = 2 a + b has first-order indices of 4/5 and 1/5, equal to the total ones."""
    settings = draw()
    outcome = (2.0 * settings['a'] + settings['b']).rename('y')
    found = surrogate.fit(surrogate.unit_features(settings, NAMES), outcome)
    assert found.score > 0.9
    by_name = {driver.dimension: driver for driver in found.drivers}
    assert by_name['a'].first == pytest.approx(0.8, abs=0.06)
    assert by_name['b'].first == pytest.approx(0.2, abs=0.06)
    assert by_name['a'].total == pytest.approx(by_name['a'].first, abs=0.05)
    assert by_name['c'].total < 0.05
    assert found.drivers[0].dimension == 'a'
    assert by_name['a'].permutation > by_name['b'].permutation > by_name['c'].permutation


def test_a_pure_interaction_has_no_first_order_index():
    settings = draw(512)
    outcome = ((settings['a'] - 0.5) * (settings['b'] - 0.5)).rename('y')
    found = surrogate.fit(surrogate.unit_features(settings, NAMES), outcome)
    by_name = {driver.dimension: driver for driver in found.drivers}
    assert by_name['a'].first < 0.15
    assert by_name['a'].total > 0.8


def test_noise_has_no_surrogate():
    rng = np.random.default_rng(9)
    settings = draw()
    noise = pd.Series(rng.standard_normal(len(settings)), name='y')
    found = surrogate.fit(surrogate.unit_features(settings, NAMES), noise)
    assert not found.is_usable
    assert found.score < surrogate.LEAST_SCORE


def test_few_settings_have_no_surrogate():
    settings = draw(32)
    found = surrogate.fit(surrogate.unit_features(settings, NAMES), settings['a'].rename('y'))
    assert not found.is_usable
    assert found.score is None


def test_missing_outcomes_are_left_out():
    settings = draw()
    outcome = settings['a'].rename('y').where(settings['b'] < 0.5)
    found = surrogate.fit(surrogate.unit_features(settings, NAMES), outcome)
    assert found.settings == 128
    assert found.drivers[0].dimension == 'a'


def test_features_are_quantiles_whatever_the_scale():
    settings = pd.DataFrame({'wide': 10.0 ** np.arange(5), 'text': list('bbaab')})
    features = surrogate.unit_features(settings, ('wide', 'text'))
    assert features['wide'].tolist() == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9])
    assert features['text'].nunique() == 2
    assert features['text'][2] < features['text'][0]
