"""`bags study` end to end: real drives, real files."""

import csv
import json

import pytest

from bags import cli
from bags.study import claims, distributions, tables
from bags.study.variants import CONTROLLERS, SWITCHES


@pytest.fixture(scope='module')
def written(cache, tmp_path_factory):
    """Return the folder with the quick study of one draw, claims first, and what was said."""
    out = tmp_path_factory.mktemp('study')
    common = ['--quick', '--runs', '1', '--jobs', '2', '--out', str(out), '--cache', str(cache)]
    for part in ('claims', 'distributions'):
        assert cli.main(['study', part, *common]) == 0
    return out


def test_every_claim_of_the_paper_has_a_verdict_an_interval_and_a_cause(written):
    rows = json.loads((written / 'claims.json').read_text())
    assert isinstance(rows, list)
    assert len(rows) == 16
    for row in rows:
        assert {'claim', 'paper', 'ours', 'verdict', 'cause', 'interval'} <= set(row)
        assert row['verdict'] in ('reproduced', 'partly', 'not')
        assert row['ours']
        assert row['cause']
    by_key = {row['key']: row for row in rows}
    assert by_key['no_ca_collides']['strict']['holds'] == 1
    assert by_key['both_avoid']['strict']['holds'] == 1
    assert len(by_key['sideslip']['cause_data']) == len(SWITCHES)


def test_the_table_that_people_read_is_made_from_the_list(written):
    rows = json.loads((written / 'claims.json').read_text())
    assert claims.told(rows) in (written / 'claims.md').read_text()


def test_every_number_of_the_distributions_is_in_the_csv_and_the_json(written):
    with open(written / 'distributions.csv', newline='') as file:
        flat = list(csv.DictReader(file))
    document = json.loads((written / 'distributions.json').read_text())
    assert [float(row['median'] or 'nan') for row in flat] == pytest.approx(
        [float('nan') if row['median'] is None else row['median'] for row in document['rows']],
        nan_ok=True,
    )
    assert {row['controller'] for row in flat} == set(CONTROLLERS)
    found = document['provenance']
    assert found['runs'] == 1
    assert found['seed'] == 1
    assert found['median_runs']['75']['number'] == 1
    assert set(found['versions']) >= {'python', 'casadi', 'numpy', 'scipy'}


@pytest.mark.parametrize('ending', ['png', 'svg'])
def test_the_figure_is_there(written, ending):
    assert (written / f'{distributions.STEM}.{ending}').stat().st_size > 10_000


def test_a_role_without_a_controller_shows_the_form(tmp_path, capsys):
    assert cli.main(['study', 'claims', '--role', 'mpcc', '--out', str(tmp_path)]) == 1
    assert 'must be ROLE=CONTROLLER' in capsys.readouterr().err


def test_nested_rows_are_flat_in_the_csv(tmp_path):
    found = {'command': 'c', 'commit': '', 'seed': 1, 'machine': {'processor': 'p', 'cores': 2}}
    tables.write(tmp_path, 'one', 'One', [{'a': {'b': 1.5}, 'c': [1, 2]}], 'text', found)
    with open(tmp_path / 'one.csv', newline='') as file:
        assert list(csv.reader(file)) == [['a.b', 'c'], ['1.5', '1 2']]
