"""The result in a few sentences, from claims.json of decided runs."""

import copy
import dataclasses
import json

import pytest
from synthetic_study import make_study

from bags.errors import BagError
from experiments.settings_analysis import decide, decision_report, result_text


@pytest.fixture(scope='module')
def decided(tmp_path_factory):
    """The contents of claims.json of a study that is the confirmatory run of its plan."""
    study = make_study(120, factorial=0)
    run = dataclasses.replace(study.plan.runs.levels, seed=1, count=120, screened=False)
    runs = dataclasses.replace(study.plan.runs, confirmatory=run)
    study = study._replace(plan=dataclasses.replace(study.plan, runs=runs))
    folder = tmp_path_factory.mktemp('decided')
    decision_report.write(study, decide.decide(study, explained=[]), folder)
    return json.loads((folder / 'claims.json').read_text())


def test_the_text_has_the_numbers_and_verdicts_of_the_confirmatory_baseline(decided):
    text = result_text.build(decided, None)
    assert '120 settings were drawn' in text
    assert 'in 120 of them its own preconditions hold' in text
    row = (
        '| the baseline slides with at least 6 deg and the MPCC with at most 4 deg | 120 of 120 | '
    )
    assert row in text
    assert text.count('**reproduced**') == 2
    assert text.count('**not reproduced**') == 2
    assert 'repetition' not in text


def test_a_repetition_that_agrees_is_said_to_agree_and_one_that_does_not_is_named(decided):
    same = result_text.build(decided, decided)
    assert 'A repetition with 120 settings of another seed gives the same verdicts.' in same
    other = copy.deepcopy(decided)
    for one in other['claims']:
        if one['key'] == 'sideslip':
            one['verdict'] = 'open'
    text = result_text.build(decided, other)
    assert 'another verdict on sideslip (open instead of reproduced).' in text


def test_a_run_that_is_not_as_preregistered_is_no_result(decided):
    other = copy.deepcopy(decided)
    for one in other['claims']:
        one['confirmatory'] = False
    with pytest.raises(BagError, match='not as preregistered'):
        result_text.build(other, None)


def test_the_block_of_the_page_is_replaced_alone(decided, tmp_path):
    folder = tmp_path / 'confirmatory'
    folder.mkdir()
    (folder / 'claims.json').write_text(json.dumps(decided))
    page = tmp_path / 'README.md'
    page.write_text('a\n<!-- result -->\nold\n<!-- /result -->\nz\n')
    text = result_text.write(tmp_path, page)
    assert page.read_text() == f'a\n<!-- result -->\n{text}<!-- /result -->\nz\n'


def test_without_a_decided_run_the_file_is_named(tmp_path):
    with pytest.raises(BagError, match=r'confirmatory/claims\.json'):
        result_text.write(tmp_path, None)
