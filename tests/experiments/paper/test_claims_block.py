"""The claims in README are those of claims.json."""

import json
from pathlib import Path

import pytest

from bags.errors import BagError
from experiments.paper import reproduction
from experiments.study import claims
from experiments.study.claims import CLAIMS, CONVERGENCE

ROOT = Path(__file__).parents[3]
CLAIMS_FILE = ROOT / 'paper/claims.json'
ROW = {
    'claim': 'no CA collides',
    'paper': 'V2O < 0',
    'ours': 'min V2O [m]: mpcc_no_ca -0.04 [-0.05, -0.03] | mpcc 0.53 [0.53, 0.54]',
    'operating_point': '75 km/h, 60 paired runs',
    'verdict': 'reproduced',
    'interval': '60/60 [0.94, 1.00]',
    'cause': 'priority',
}


@pytest.fixture
def claims_file(tmp_path):
    path = tmp_path / 'claims.json'
    path.write_text(json.dumps([ROW]))
    return path


def test_the_readme_shows_the_claims_as_they_were_generated():
    _, between, _ = reproduction.split_at_block(ROOT / 'README.md')
    assert between == reproduction.build_claims_block(CLAIMS_FILE)


def test_reasons_of_undecided_claims_follow_the_table(tmp_path):
    path = tmp_path / 'claims.json'
    path.write_text(json.dumps([{**ROW, 'verdict': 'not decided here (a)'}]))
    text = reproduction.build_claims_block(path)
    assert '| not decided here (a) |' in text
    assert text.count('- (') == 1
    assert f'- (a) {claims.REASONS["a"]}' in text


def test_every_verdict_of_the_tracked_claims_follows_from_their_rules():
    undecided = {one.key: one.undecided for one in (*CLAIMS, CONVERGENCE)}
    for row in json.loads(CLAIMS_FILE.read_text()):
        reasons = undecided.get(row['key'], '')
        assert row['verdict'] == claims.verdict(reasons, row['rule_outcome'])
        assert row['reasons'] == claims.find_reasons([row['verdict']])


def test_only_the_text_between_the_comments_changes(tmp_path, claims_file):
    file = tmp_path / 'page.md'
    file.write_text(f'before\n{reproduction.BEGIN}\nold\n{reproduction.END}\nafter\n')
    reproduction.rewrite_claims_block(file, claims_file)
    before, between, after = reproduction.split_at_block(file)
    assert before == f'before\n{reproduction.BEGIN}'
    assert after == f'{reproduction.END}\nafter\n'
    assert between == reproduction.build_claims_block(claims_file)
    assert r'| min V2O [m]: mpcc_no_ca -0.04 \| mpcc 0.53 |' in between
    assert '75 km/h, 60 paired runs' in between


@pytest.mark.parametrize(
    'text',
    [
        'nothing',
        f'{reproduction.BEGIN}',
        f'{reproduction.END} {reproduction.BEGIN}',
        2 * reproduction.BEGIN,
    ],
)
def test_a_file_without_the_comments_is_refused(tmp_path, claims_file, text):
    file = tmp_path / 'page.md'
    file.write_text(text)
    with pytest.raises(BagError, match='once each'):
        reproduction.rewrite_claims_block(file, claims_file)
    assert file.read_text() == text


@pytest.mark.parametrize('text', ['', '{', '[{"claim": "half"}]', '[1]', '[]'])
def test_a_file_that_holds_no_claims_is_refused(tmp_path, text):
    path = tmp_path / 'claims.json'
    path.write_text(text)
    with pytest.raises(BagError, match='holds no claims'):
        reproduction.build_claims_block(path)
