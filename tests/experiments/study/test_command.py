"""`experiments study` end to end: real drives, real files."""

import csv
import json

import pytest

from experiments import cli
from experiments.study import ablation, claim_evaluation, metric_distributions, tables
from experiments.study.claims import Shown
from experiments.study.variants import CONTROLLERS, SWITCHES, Switch, Variant


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    """Return the folder with the distributions of one draw, driven for this."""
    out = tmp_path_factory.mktemp('study')
    cache = tmp_path_factory.mktemp('drives')
    common = ['--quick', '--runs', '1', '--jobs', '2', '--out', str(out), '--cache', str(cache)]
    assert cli.main(['study', 'distributions', *common]) == 0
    return out


@pytest.fixture(scope='module')
def judged(alike_runs, tmp_path_factory):
    """Return what the claims come to when every controller drives alike."""
    return claim_evaluation.run(alike_runs(), tmp_path_factory.mktemp('claims'), runs=20)


def test_every_claim_of_the_paper_has_a_verdict_an_interval_and_a_cause(judged):
    (file,) = (path for path in judged.files if path.name == 'claims.json')
    rows = json.loads(file.read_text())
    assert rows == judged.rows
    assert len(rows) == 16
    for row in rows:
        assert {'claim', 'paper', 'ours', 'verdict', 'cause', 'interval'} <= set(row)
        assert row['rule_outcome'] in ('reproduced', 'partly', 'not')
        assert row['verdict'] == row['rule_outcome'] or row['verdict'].startswith('not decided')
        assert row['ours']
        assert row['cause']
    outcomes = {row['key']: row['rule_outcome'] for row in rows}
    assert outcomes['mpcc_safe'] == outcomes['both_avoid'] == 'reproduced'
    assert outcomes['sideslip'] == outcomes['no_ca_collides'] == outcomes['convergence'] == 'not'
    by_key = {row['key']: row for row in rows}
    assert set(by_key['mpcc_safe']['elsewhere']) == {'70 km/h', '80 km/h'}
    assert len(by_key['sideslip']['cause_data']) == len(SWITCHES)


def test_the_markdown_table_is_generated_from_the_list(judged):
    (file,) = (path for path in judged.files if path.name == 'claims.md')
    assert claim_evaluation.claims_table(judged.rows) in file.read_text()


def test_the_files_name_their_command_and_controllers(alike_runs, tmp_path):
    roles = {name: f'{name}_tuned' for name in CONTROLLERS}
    claim_evaluation.run(alike_runs(), tmp_path, 2, roles=roles, command='experiments paper')
    origin = json.loads((tmp_path / 'claims_provenance.json').read_text())
    assert origin['command'] == 'experiments paper'
    assert origin['roles'] == roles
    assert origin['cause_runs'] == 2
    last = (tmp_path / 'claims.md').read_text().splitlines()[-1]
    assert last.startswith(
        '`experiments paper` with mpcc = mpcc_tuned, mpcc_no_ca = mpcc_no_ca_tuned'
    )


def test_the_folder_of_a_controller_is_not_recorded():
    driven = [Variant('mpcc', 'mpcc'), Variant('mine', '/home/somebody/mine.yaml')]
    found = tables.build_provenance('experiments study limit', driven)
    assert found['roles'] == {'mpcc': 'mpcc', 'mine': 'mine.yaml'}


def test_a_number_that_most_runs_do_not_have_is_shown_as_range_and_count(make_record):
    some, none = make_record(brake_onset_at_m=36.0), make_record()
    draws = [{'mpcc': none, 'frenet': one} for one in (some, none, none)]
    shown = [Shown(role, 'brake_onset_at_m') for role in ('mpcc', 'frenet')]
    text = claim_evaluation.summarise_claim(shown, draws, {'mpcc': 'mpcc', 'frenet': 'frenet'})
    assert text == 'brake onset, -500 N [m]: mpcc none, frenet 36.0 to 36.0 in 1 of 3 runs'


def test_an_ablation_without_any_effect_turns_nothing(alike_runs, tmp_path):
    found = ablation.run(alike_runs(), tmp_path, 4, 1, (65.0, 75.0), (0.5,))
    assert not [row for row in found.switches if row['turned_on'] or row['turned_off']]
    assert len(found.switches) == 2 * len(SWITCHES) * len(ablation.VERDICTS)
    assert {row['cleared'] for row in found.rows} == {1.0}
    assert len(found.rows) == 3 * len({row['row'] for row in found.rows})
    for name in ('ablation.md', 'ablation_switches.csv', 'ablation_50cm.png', 'ablation_50cm.svg'):
        assert (tmp_path / name).stat().st_size > 1000


def test_a_switch_that_turns_a_verdict_names_the_drives(make_record):
    switch = Switch('factor', 'one', 'other')
    records = {
        'one': [make_record(), make_record(peak_sideslip_deg=5.0)],
        'other': [make_record(peak_sideslip_deg=5.0), make_record()],
    }
    rows = {row['verdict']: row for row in ablation.find_flips(switch, {'75 km/h': records})}
    turned = rows['sideslip > 4 deg']
    assert (turned['turned_on'], turned['turned_off']) == (['75 km/h #1'], ['75 km/h #2'])
    assert rows['cleared']['turned_on'] == rows['cleared']['turned_off'] == []


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
    assert found['command'] == 'experiments study distributions'
    assert found['roles'] == {name: name for name in CONTROLLERS}
    assert found['runs'] == 1
    assert found['seed'] == 1
    assert found['median_runs']['75']['number'] == 1
    assert set(found['versions']) >= {'python', 'casadi', 'numpy', 'scipy'}


@pytest.mark.parametrize('ending', ['png', 'svg'])
def test_the_figure_is_there(written, ending):
    assert (written / f'{metric_distributions.STEM}.{ending}').stat().st_size > 10_000


def test_a_role_without_a_controller_shows_the_form(tmp_path, capsys):
    assert cli.main(['study', 'claims', '--role', 'mpcc', '--out', str(tmp_path)]) == 1
    assert 'must be ROLE=CONTROLLER' in capsys.readouterr().err


def test_nested_rows_are_flat_in_the_csv(tmp_path):
    machine = {'processor': 'p', 'cores': 2}
    found = {'command': 'c', 'commit': '', 'seed': 1, 'machine': machine, 'roles': {}}
    tables.write_tables(tmp_path, 'one', 'One', [{'a': {'b': 1.5}, 'c': [1, 2]}], 'text', found)
    with open(tmp_path / 'one.csv', newline='') as file:
        assert list(csv.reader(file)) == [['a.b', 'c'], ['1.5', '1 2']]
