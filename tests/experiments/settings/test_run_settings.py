"""`experiments study settings` end to end on a small study of easy settings."""

import json

import pytest
import yaml
from drawn_values import VALUES
from pyarrow import parquet
from rich.console import Console

from bags.errors import BagError
from experiments import cli
from experiments.settings import arms, drive, preregistration, run_settings, setting
from experiments.settings.run_settings import Request
from msgs_yaml import share

TIMES = ('wall_s', 'cpu_s')
CONSOLE = Console(quiet=True)


@pytest.fixture(scope='module')
def study_file(tmp_path_factory):
    """Return the study with one course and plant, that the car without avoidance hits."""
    document = yaml.safe_load(share.path('experiments', *preregistration.FILE).read_text())
    chosen = VALUES | {'clearance_1_m': -0.2, 'S': 0.2}
    document['dimensions'] = {name: {'choice': [chosen[name]]} for name in preregistration.NAMES}
    document['dimensions']['velocity_tolerance_mps'] = {'uniform': [2.0, 4.0]}
    # whoever drives at all is accepted, by two perturbed starts, by none of the combinations
    document['preconditions']['P3']['least_limit_share'] = 0.1
    document['perturbations'] = document['perturbations'][:2]
    document['arms']['factorial_settings'] = 0
    document['arms']['lineage']['circles'] = 1  # a problem that other tests have compiled
    path = tmp_path_factory.mktemp('study') / 'study.yaml'
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


@pytest.fixture(scope='module')
def folder(study_file, tmp_path_factory):
    """Return the folder of two settings that were driven."""
    folder = tmp_path_factory.mktemp('driven')
    assert run_settings.run(Request(folder, 2, 3, 2, 300.0, study_file), CONSOLE) == 0
    return folder


def read(folder, name=run_settings.TABLE):
    rows = parquet.read_table(folder / name).to_pylist()
    return [{key: value for key, value in row.items() if key not in TIMES} for row in rows]


@pytest.mark.timeout(300)
def test_the_table_has_a_row_per_drive(folder):
    rows = read(folder)
    compared = (arms.LINEAGE, arms.MATCHED, arms.MPCC)  # by name
    expected = [(arm, start) for arm in compared for start in (0, 1)] + [(arms.NO_CA, 0)]
    for number in (0, 1):
        own = [row for row in rows if row['setting'] == number]
        assert [(row['arm'], row['perturbation']) for row in own] == expected
        assert not any(row['error'] for row in own)
        assert len({row['speed_mps'] for row in own}) == 1
        (no_ca,) = (row for row in own if row['arm'] == arms.NO_CA)
        assert no_ca['v2o_1_m'] < 0.0
    assert len({row['velocity_tolerance_mps'] for row in rows}) == 2
    notes = parquet.read_schema(folder / run_settings.TABLE).metadata
    assert json.loads(notes[b'rejected']) == {}
    assert yaml.safe_load(notes[b'preregistration'])['schema'] == 1


def test_the_outcomes_pair_the_drives(folder):
    drives, found = read(folder), read(folder, run_settings.OUTCOMES)
    assert {row['baseline'] for row in found} == {arms.MATCHED, arms.LINEAGE}
    assert all(row['P1'] for row in found)

    def peak(number, arm, start):
        (row,) = (
            row
            for row in drives
            if (row['setting'], row['arm'], row['perturbation']) == (number, arm, start)
        )
        return row['peak_sideslip_deg']

    for row in found:
        where = row['setting'], row['perturbation']
        baseline, mpcc = (peak(where[0], arm, where[1]) for arm in (row['baseline'], arms.MPCC))
        assert row['sideslip.difference'] == pytest.approx(baseline - mpcc)


@pytest.mark.parametrize(('least_share', 'S', 'drives'), [(0.1, 0.2, 7), (1.0, 0.12, 1)])
@pytest.mark.timeout(300)
def test_a_screened_study_stops_where_no_setting_can_be_accepted(
    study_file, tmp_path, least_share, S, drives
):
    """All seven drives of a setting, or that of the car that never reaches the limit alone."""
    document = yaml.safe_load(study_file.read_text())
    document['preconditions']['P3']['least_limit_share'] = least_share
    document['dimensions']['S'] = {'choice': [S]}
    (tmp_path / 'study.yaml').write_text(yaml.safe_dump(document, sort_keys=False))
    request = Request(tmp_path, 1, 3, 2, 300.0, tmp_path / 'study.yaml', is_screened=True)
    assert run_settings.run(request, CONSOLE) == 0
    assert len(read(tmp_path)) == drives


@pytest.mark.timeout(300)
def test_a_longer_study_drives_what_is_missing_and_repeats_the_rest(folder, study_file):
    before, records = read(folder), (folder / 'drives.jsonl').read_bytes()
    request = Request(folder, 3, 3, 1, 300.0, study_file)
    assert run_settings.run(request, CONSOLE) == 0
    assert (folder / 'drives.jsonl').read_bytes().startswith(records)
    assert [row for row in read(folder) if row['setting'] < 2] == before
    kept = (folder / 'drives.jsonl').read_bytes()
    assert run_settings.run(request, CONSOLE) == 0
    assert (folder / 'drives.jsonl').read_bytes() == kept


def test_the_file_and_the_seed_reproduce_a_drive_bit_for_bit(folder, study_file):
    """In another process than that of the study."""
    plan = preregistration.load(study_file)
    (values,) = setting.draw(plan, 3, 1, 1)
    task = drive.plan_drive(plan, setting.build(plan, 1, values), arms.MPCC, 1)
    again = json.loads(drive.run(task))
    (row,) = (
        row
        for row in read(folder)
        if (row['setting'], row['arm'], row['perturbation']) == (1, arms.MPCC, 1)
    )
    assert {name: row[name] for name in again if name not in TIMES} == {
        name: value for name, value in again.items() if name not in TIMES
    }


def test_ranges_that_give_no_settings_are_refused(study_file, tmp_path):
    document = yaml.safe_load(study_file.read_text())
    document['dimensions']['room_right_m'] = {'choice': [0.1]}
    (tmp_path / 'study.yaml').write_text(yaml.safe_dump(document, sort_keys=False))
    request = Request(tmp_path / 'out', 1, 3, 1, 60.0, tmp_path / 'study.yaml')
    with pytest.raises(BagError, match='points gave 0 settings'):
        run_settings.run(request, CONSOLE)


def test_tuned_parameters_are_read_by_setting(tmp_path):
    file = tmp_path / 'tuned.csv'
    file.write_text('setting,tolerances.contouring_m\n3,0.25\n7,0.5\n')
    assert run_settings.read_tuned(file) == {
        3: {'tolerances.contouring_m': 0.25},
        7: {'tolerances.contouring_m': 0.5},
    }
    file.write_text('number,tolerances.contouring_m\n3,0.25\n')
    with pytest.raises(BagError, match='is no table of tuned parameters'):
        run_settings.read_tuned(file)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ([], 'needs --out DIR'),
        (['--out', 'x', '--seed', '-1'], '--seed: is -1; allowed 0 or more'),
        (['--out', 'x', '--preregistered', 'first'], "is 'first'; allowed confirmatory,"),
        (['--out', 'x', '--tuned', 'a.csv', '--tuned', 'b.csv'], 'takes one --tuned FILE'),
    ],
)
def test_the_command_refuses_what_it_cannot_use(arguments, message, capsys):
    assert cli.main(['study', 'settings', *arguments]) != 0
    assert message in ' '.join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ('name', 'numbers'),
    [
        ('confirmatory', (20261123, 12_000, True)),
        ('repetition', (20261124, 12_000, True)),
        ('levels', (20261125, 3_000, False)),
    ],
)
def test_a_preregistered_run_has_the_numbers_of_the_file(tmp_path, name, numbers):
    request = run_settings.preregistered(Request(tmp_path, 12, 1, 2, 300.0), name)
    assert (request.seed, request.count, request.is_screened) == numbers
