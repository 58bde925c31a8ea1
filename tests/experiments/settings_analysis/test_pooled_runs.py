"""Two runs of different seeds decided as one."""

import pytest
from synthetic_study import make_study

from bags.errors import BagError
from experiments.settings_analysis import decide, study_tables

SETTINGS = 120


@pytest.fixture(scope='module')
def studies():
    return [make_study(SETTINGS, seed=seed, factorial=0) for seed in (1, 2)]


def test_a_counterexample_of_pooled_runs_is_a_setting_of_its_seed(studies):
    both = study_tables.pool(studies)
    assert both.seeds == (1, 2)
    entries = decide.claim_entries(both, decide.decide(both, explained=[]))
    examples = [one['counterexample'] for one in entries if one['counterexample']]
    assert examples
    for example in examples:
        assert example['setting'] < study_tables.NEXT_STUDY
        assert f'--number {example["setting"]} --seed ' in example['command']
    second = int(studies[1].drives['setting'].max()) + study_tables.NEXT_STUDY
    assert study_tables.origin(both, second) == (2, second - study_tables.NEXT_STUDY)


def test_studies_of_one_seed_are_not_pooled(studies):
    with pytest.raises(BagError, match='different seeds'):
        study_tables.pool([studies[0]] * 2)
