"""`experiments paper`: which runs it makes, what must agree, and the claims in a page.

The runs in process and through the node graph are tested elsewhere; here both are replaced.
"""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from bags.errors import BagError
from experiments import page_block
from experiments.paper import operating_point, reproduction
from experiments.study import claims
from experiments.study.claims import CLAIMS, CONVERGENCE

BEGIN, END = page_block.marks(reproduction.BLOCK)
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


class Graph:
    """The node graph, which comes out like `metrics` wherever it drives."""

    def __init__(self, metrics):
        self.metrics, self.chosen, self.circles = metrics, [], 0

    def run_double_lane_change(self, chosen, out, bags, console):
        self.chosen = list(chosen)
        runs = {one.controller: self.metrics for one in chosen}
        return reproduction.NodeGraphRuns(runs, [out / 'sheet.png', out / 'sheet.svg'])

    def run_circle(self, out, bags, console):
        self.circles += 1


@pytest.fixture
def paper(monkeypatch, tmp_path, make_record, alike_runs):
    """Make the paper quickly into tmp_path; `metrics` are those of the node graph."""

    def made(**metrics):
        drives = alike_runs()
        through = Graph({**make_record().metrics, **metrics})
        monkeypatch.setattr(reproduction, 'Runner', lambda jobs, show: drives)
        monkeypatch.setattr(reproduction, 'run_double_lane_change', through.run_double_lane_change)
        monkeypatch.setattr(reproduction, 'run_circle', through.run_circle)
        monkeypatch.setattr(operating_point, 'write', lambda out: None)
        console = Console(file=io.StringIO(), width=120)
        return reproduction.reproduce(tmp_path, True, 2, console), drives, through, console

    return made


def test_the_tuned_controllers_are_compared_and_the_node_graph_repeats_the_median_run(
    paper, tmp_path
):
    made, drives, through, _ = paper()
    assert [spec.controller for spec in through.chosen] == [
        'mpcc_no_ca_tuned',
        'mpcc_tuned',
        'frenet_tuned',
    ]
    assert len({(s.speed_kph, s.grip, s.tolerance) for s in through.chosen}) == 1, (
        'one draw for all'
    )
    assert set(through.chosen) <= set(drives.specs)
    assert through.circles == 1
    assert json.loads(made.claims.read_text()) == made.rows
    assert made.claims == tmp_path / 'claims.json'
    noted = json.loads((tmp_path / 'claims_provenance.json').read_text())
    assert noted['command'] == 'experiments paper --quick'


def test_a_deviation_of_the_node_graph_is_an_error_that_names_the_number(paper):
    with pytest.raises(BagError, match=r'min_v2o_per_obstacle_m\.1 is 0\.60+, tracked 0\.530+,'):
        paper(min_v2o_per_obstacle_m={'1': 0.6, '2': 0.57})


def test_the_screen_shows_every_claim_with_its_brackets(paper):
    made, _, _, console = paper()
    reproduction.show(made, console)
    text = ' '.join(console.file.getvalue().split())
    assert '4/4 experiment 1' in text
    assert text.count('paper ') >= len(made.rows)
    assert '[' in made.rows[0]['interval']
    assert made.rows[0]['interval'].split()[-1] in text
    assert 'sheet.png' in text
    for row in made.rows:
        for key, reason in row['reasons'].items():
            assert f'({key}) {reason}' in text


@pytest.fixture
def claims_file(tmp_path):
    path = tmp_path / 'claims.json'
    path.write_text(json.dumps([ROW]))
    return path


def test_the_page_shows_the_claims_as_they_were_generated():
    _, between, _ = page_block.split(ROOT / 'docs/one_point.md', reproduction.BLOCK)
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
    file.write_text(f'before\n{BEGIN}\nold\n{END}\nafter\n')
    reproduction.rewrite_claims_block(file, claims_file)
    before, between, after = page_block.split(file, reproduction.BLOCK)
    assert before == f'before\n{BEGIN}'
    assert after == f'{END}\nafter\n'
    assert between == reproduction.build_claims_block(claims_file)
    assert r'| min V2O [m]: mpcc_no_ca -0.04 \| mpcc 0.53 |' in between
    assert '75 km/h, 60 paired runs' in between


@pytest.mark.parametrize(
    'text',
    [
        'nothing',
        f'{BEGIN}',
        f'{END} {BEGIN}',
        2 * BEGIN,
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
