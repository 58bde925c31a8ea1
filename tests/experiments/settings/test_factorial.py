"""Effects of a factorial against responses whose effects are known."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from experiments.settings import factorial

FACTORS = ('frame', 'lag', 'shape', 'size', 'heading')


def make_drives(response, settings=30, factors=FACTORS):
    """Return a row per setting and combination; `response(setting, codes)` of the codes -1, +1."""
    rows = []
    for setting in range(settings):
        for chosen in product((False, True), repeat=len(factors)):
            codes = dict(zip(factors, np.where(chosen, 1.0, -1.0)))
            row = {'setting': setting, **dict(zip(factors, chosen))}
            rows.append(row | {'response': response(setting, codes)})
    return pd.DataFrame(rows)


def effects_of(drives, factors=FACTORS):
    return {effect.term: effect for effect in factorial.analyse(drives, factors, 'response')}


def test_a_linear_response_has_its_own_effects_and_no_others():
    def response(setting, codes):
        return setting + 1.5 * codes['lag'] - 0.5 * codes['size'] * codes['frame']

    effects = effects_of(make_drives(response))
    assert len(effects) == 31
    assert effects['lag'].mean == pytest.approx(3.0)  # from -1.5 to 1.5
    assert effects['frame x size'].mean == pytest.approx(-1.0)
    others = [e.mean for t, e in effects.items() if t not in ('lag', 'frame x size')]
    assert others == pytest.approx([0.0] * 29, abs=1e-9)


def test_one_factor_gives_the_paired_difference():
    rng = np.random.default_rng(7)
    on = rng.normal(2.0, 1.0, 30)
    drives = make_drives(lambda k, codes: on[k] if codes['lag'] > 0 else 0.0, factors=('lag',))
    (effect,) = factorial.analyse(drives, ('lag',), 'response')
    assert effect.mean == pytest.approx(on.mean())
    low, high = effect.interval
    assert low < on.mean() < high


def test_noise_is_no_effect_and_a_real_one_is_found():
    rng = np.random.default_rng(8)
    drives = make_drives(lambda _, codes: codes['heading'] + rng.normal(0.0, 1.0), settings=40)
    effects = effects_of(drives)
    found = {term for term, effect in effects.items() if effect.p_adjusted <= 0.05}
    assert found == {'heading'}
    low, high = effects['heading'].interval
    assert low < 2.0 < high


def test_a_setting_without_every_combination_is_left_out():
    drives = make_drives(lambda k, codes: codes['lag'] * (1 + k))
    drives.loc[drives['setting'].eq(3) & drives['lag'], 'response'] = np.nan
    drives = drives.drop(drives.index[drives['setting'].eq(5)][0])
    effects = effects_of(drives)
    assert effects['lag'].settings == 28


def test_perturbations_of_a_combination_count_once():
    drives = make_drives(lambda _, codes: codes['lag'])
    repeated = pd.concat([drives, drives, drives.assign(response=drives['response'] + 99.0)])
    assert effects_of(repeated)['lag'].mean == pytest.approx(2.0)
    assert effects_of(repeated)['lag'].settings == 30


def test_no_complete_setting_gives_no_effect():
    drives = make_drives(lambda _, codes: np.nan)
    assert factorial.analyse(drives, FACTORS, 'response') == []
