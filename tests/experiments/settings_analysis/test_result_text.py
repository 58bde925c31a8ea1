"""The result in a few sentences, from claims.json of decided runs."""

import dataclasses
import json
import shutil

import pytest
from synthetic_study import make_study

from bags.errors import BagError
from experiments.settings_analysis import (
    decide,
    decision_report,
    published,
    result_text,
    study_tables,
)
from experiments.settings_analysis.study_tables import POOLED

SETTINGS = 120
CONFIRMATORY, REPETITION = 'confirmatory', 'repetition'


@pytest.fixture(scope='module')
def studies():
    """A confirmatory run with a drive that has no result, and its repetition."""
    found = {
        name: make_study(SETTINGS, seed=seed, factorial=0)
        for name, seed in ((CONFIRMATORY, 1), (REPETITION, 2))
    }
    plan = found[CONFIRMATORY].plan
    runs = {
        name: dataclasses.replace(plan.runs.levels, seed=one.seed, count=SETTINGS)
        for name, one in found.items()
    }
    plan = dataclasses.replace(plan, runs=dataclasses.replace(plan.runs, **runs))
    found = {name: one._replace(plan=plan) for name, one in found.items()}
    found[CONFIRMATORY].drives.loc[3, 'error'] = 'killed'
    return found


@pytest.fixture(scope='module')
def decided(studies, tmp_path_factory):
    """A folder with the decided runs, and both as one."""
    folder = tmp_path_factory.mktemp('decided') / 'paper' / 'settings'
    both = study_tables.pool(list(studies.values()))
    for name, study in (*studies.items(), (POOLED, both)):
        results = decide.decide(study, explained=[])
        decision_report.write_claims(study, results, folder / name)
    return folder


@pytest.fixture
def runs(decided, tmp_path):
    """Return a copy of the decided runs; `edit` changes the contents of a claims.json."""

    def copied(*names, edit=lambda content: None, of=REPETITION):
        for name in names:
            content = json.loads((decided / name / 'claims.json').read_text())
            if name == of:
                edit(content)
            (tmp_path / name).mkdir()
            (tmp_path / name / 'claims.json').write_text(json.dumps(content))
        return tmp_path

    return copied


def test_the_text_has_numbers_and_verdicts_and_states_the_drive_without_a_result(runs):
    text = ' '.join(result_text.build(runs(CONFIRMATORY)).split())
    assert '120 settings of them were drawn at random' in text
    assert 'preconditions hold in 120 of them' in text
    assert 'By most of its starts the baseline enters' in text
    assert 'the MPCC by 4 deg or less in 120 of 120' in text
    assert 'reproduced: the unsafe area and the sideslip' in text
    assert 'not reproduced: the least speed and all of these at once' in text
    assert '1 of 1,920 drives has no result; the repetition from another seed is not' in text
    assert '![Share of the settings' in text
    assert '(paper/settings/confirmatory/shares.png)' in text


def test_with_the_repetition_the_counts_are_those_of_both_seeds(runs):
    text = ' '.join(result_text.build(runs(CONFIRMATORY, REPETITION, POOLED), '..').split())
    assert 'fixed beforehand, and 120 of another seed to repeat it' in text
    assert 'preconditions hold in 120 and 120 of them' in text
    assert 'Over both runs (pooling was not preregistered) the baseline' in text
    assert 'in 240 of 240' in text
    assert '1 of 3,840 drives has no result' in text
    assert 'the repetition gives the same verdicts, and so do both seeds together' in text
    assert '(../paper/settings/pooled/shares.png)' in text


def test_a_repetition_with_another_verdict_is_named(runs):
    def edit(content):
        for one in content['claims']:
            if one['key'] == 'sideslip':
                one['verdict'] = 'open'

    text = ' '.join(result_text.build(runs(CONFIRMATORY, REPETITION, edit=edit)).split())
    assert 'another verdict on the sideslip (open instead of reproduced)' in text


@pytest.mark.parametrize(
    ('field', 'value', 'error'),
    [
        ('otherwise_driven', ['settings: 12, preregistered 120'], 'not as preregistered: settings'),
        ('run', 'levels', 'of the run levels; allowed confirmatory'),
    ],
)
def test_a_run_of_another_design_is_no_result(runs, field, value, error):
    def edit(content):
        content['provenance'][field] = value

    with pytest.raises(BagError, match=error):
        result_text.build(runs(CONFIRMATORY, edit=edit, of=CONFIRMATORY))


def test_an_open_claim_says_how_often_starts_disagree(runs):
    def edit(content):
        for one in content['claims']:
            one.update(verdict='open', undetermined=0.125)

    text = ' '.join(result_text.build(runs(CONFIRMATORY, edit=edit, of=CONFIRMATORY)).split())
    assert 'every claim is open**: neither reproduced (in more than 50 % of the settings)' in text
    assert 'starts that differ by 0.05 m/s or less: in 12 % of the first 120, by claim' in text


def test_pooled_numbers_of_other_runs_are_refused(runs):
    def edit(content):
        content['provenance']['drives'] += 1

    folder = runs(CONFIRMATORY, REPETITION, POOLED, edit=edit)
    with pytest.raises(BagError, match=r'pooled.*is not of the decided runs beside it'):
        result_text.build(folder)
    shutil.rmtree(folder / REPETITION)
    with pytest.raises(BagError, match=r'pooled.*is not of the decided runs beside it'):
        result_text.build(folder)


def test_without_a_decided_run_the_file_is_named(tmp_path):
    with pytest.raises(BagError, match=r'confirmatory/claims\.json'):
        result_text.build(tmp_path)


def test_a_counterexample_of_pooled_runs_is_a_setting_of_its_seed(decided, studies):
    content = json.loads((decided / POOLED / 'claims.json').read_text())
    assert content['provenance']['seeds'] == [1, 2]
    examples = [one['counterexample'] for one in content['claims'] if one['counterexample']]
    assert examples
    for example in examples:
        assert example['setting'] < study_tables.NEXT_STUDY
        assert f'--number {example["setting"]} --seed ' in example['command']
    second = int(studies[REPETITION].drives['setting'].max()) + study_tables.NEXT_STUDY
    both = study_tables.pool(list(studies.values()))
    assert study_tables.origin(both, second) == (2, second - study_tables.NEXT_STUDY)


def test_studies_of_one_seed_are_not_pooled(studies):
    with pytest.raises(BagError, match='different seeds'):
        study_tables.pool([studies[CONFIRMATORY]] * 2)


def test_the_block_of_a_page_is_replaced_alone_and_links_lead_from_it(decided):
    page = decided.parent.parent / 'docs' / 'page.md'
    page.parent.mkdir()
    page.write_text('a\n<!-- result -->\nold\n<!-- /result -->\nz\n')
    assert published.write(decided, [page]) == [page]
    text = result_text.build(decided, '..')
    assert page.read_text() == f'a\n<!-- result -->\n{text}<!-- /result -->\nz\n'


def test_a_page_without_a_block_is_refused(decided, tmp_path):
    page = tmp_path / 'page.md'
    page.write_text('nothing\n')
    with pytest.raises(BagError, match='has no block about the study; allowed <!-- result -->'):
        published.write(decided, [page])
