"""`experiments batch` end to end: real drives of a second; interrupted, crashed, hanging ones."""

import json
import signal
import subprocess
import sys
from functools import partial

import faulty_drives
import pytest
from pyarrow import parquet
from rich.console import Console
from wait_until import wait_until

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.flattening import flatten
from experiments import cli, code_version, simulation
from experiments.batch import drive_plan, run_batch
from experiments.batch.drive_plan import Combination
from experiments.configuration import node_config

TIMEOUT_S = 240.0
RUNS = 10
# wall and processor times differ from drive to drive
TIMES = ('wall_s', 'cpu_s', 'solve_ms.', 'solve_cpu_ms.', 'solver.time_')
LIMIT_S = 3.0  # of a drive that hangs


def read_rows(folder):
    """Return the rows of the table without what differs between two equal drives."""
    rows = parquet.read_table(folder / 'results.parquet').to_pylist()
    return [{n: value for n, value in row.items() if not n.startswith(TIMES)} for row in rows]


def records(folder):
    path = folder / 'drives.jsonl'
    return path.read_bytes().count(b'\n') if path.exists() else 0


def start_batch(study, folder):
    command = [sys.executable, '-m', 'experiments.cli', 'batch', study, '--out', folder]
    return subprocess.Popen(
        [*map(str, command), '--jobs', '1'],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def interrupt(study, folder, number, after):
    """End a batch by a signal when it has kept `after` drives; return its exit code and output."""
    with start_batch(study, folder) as batch:
        wait_until(lambda: records(folder) >= after, TIMEOUT_S, 'no drive was kept')
        batch.send_signal(number)
        output, _ = batch.communicate(timeout=TIMEOUT_S)
    return batch.returncode, output


def test_an_interrupted_batch_goes_on_to_the_same_table(write_study, tmp_path, capsys):
    study, whole, torn = write_study(runs=RUNS), tmp_path / 'whole', tmp_path / 'torn'
    assert cli.main(['batch', str(study), '--out', str(whole), '--jobs', '2']) == 0
    rows = read_rows(whole)
    assert len(rows) == 2 * RUNS

    code, output = interrupt(study, torn, signal.SIGINT, after=2)
    assert code == 130
    part = read_rows(torn)
    assert 2 <= len(part) < 2 * RUNS
    assert f'{len(part)} of {2 * RUNS} drives are kept; the same command goes on' in output
    assert all(row in rows for row in part)

    code, output = interrupt(study, torn, signal.SIGKILL, after=len(part) + 2)
    assert code == -signal.SIGKILL
    kept = records(torn)
    assert kept < 2 * RUNS
    capsys.readouterr()
    assert cli.main(['batch', str(study), '--out', str(torn), '--jobs', '1']) == 0
    assert f'20 drives: {kept} were kept, 0 failed' in capsys.readouterr().out
    assert read_rows(torn) == rows


def test_the_table_has_a_column_for_all_that_a_drive_is_and_gives(write_study, tmp_path):
    study = write_study(set={'scenario.speed_mps': [14.5, 15.0]})
    assert cli.main(['batch', str(study), '--out', str(tmp_path), '--jobs', '1']) == 0
    table = parquet.read_table(tmp_path / 'results.parquet')
    rows = table.to_pylist()
    assert [(row['scenario.speed_mps'], row['run']) for row in rows] == [
        (14.5, 1),
        (14.5, 2),
        (15.0, 1),
        (15.0, 2),
    ]
    assert {(row['scenario'], row['controller'], row['seed'], row['error']) for row in rows} == {
        ('short_road', 'mpcc_no_ca', 1, '')
    }
    assert {row['code_version'] for row in rows} == {code_version.digest()}
    for name in ('perturbation.speed_kph', 'perturbation.grip'):
        assert rows[0][name] != rows[1][name] == rows[3][name]
    assert all(row['wall_s'] > 0.0 and row['cpu_s'] > 0.0 for row in rows)
    assert {'solver.failed', 'solver.iterations_mean', 'solve_ms.p99'} <= set(table.column_names)
    road = str(tmp_path / 'short_road.yaml')
    one = drive_plan.prepare(Combination(road, 'mpcc_no_ca', (('scenario.speed_mps', 15.0),)))
    wanted = flatten(metrics.compute_metrics(simulation.drive(one)))
    assert wanted['verdict'] == 'reached the finish line at 15 m; no collision'
    differ = [name for name, value in wanted.items() if rows[2][name] != value]
    assert all(name.startswith(TIMES) for name in differ)
    assert json.loads(table.schema.metadata[b'versions'])['numpy']


def test_draws_and_families_have_a_row_each_and_columns_of_what_is_drawn(write_study, tmp_path):
    given = {
        'set': {},
        'families': ['pop_up'],
        'draw': {'scenario.friction': {'uniform': [0.8, 1.0]}},
        'draws': 2,
        'runs': 1,
    }
    study = write_study(**given)
    assert cli.main(['batch', str(study), '--out', str(tmp_path), '--jobs', '1']) == 0
    rows = parquet.read_table(tmp_path / 'results.parquet').to_pylist()
    assert [(row['scenario'], row['family'], row['draw']) for row in rows] == [
        ('short_road', None, 0),
        ('short_road', None, 1),
        ('pop_up_nominal_s1_0', 'pop_up', 0),
        ('pop_up_nominal_s1_1', 'pop_up', 1),
    ]
    friction = [row['scenario.friction'] for row in rows]
    assert friction[:2] == friction[2:]
    assert all(0.8 <= value <= 1.0 for value in friction)
    assert all(row['survived'] is not None for row in rows)
    # later draws of the same study keep those before
    write_study(**given | {'draws': 3})
    assert cli.main(['batch', str(study), '--out', str(tmp_path), '--jobs', '1']) == 0
    assert records(tmp_path) == 6
    assert read_rows(tmp_path)[:2] == [
        {name: value for name, value in row.items() if not name.startswith(TIMES)}
        for row in rows[:2]
    ]


def test_a_drive_that_hangs_costs_its_row(write_study, tmp_path):
    # alone: what a drive that does not hang may take depends on what else the machine does
    study = write_study(set={'plant.friction': [faulty_drives.HANGS]}, runs=1)
    request = run_batch.Request(study, tmp_path, jobs=1, limit_s=LIMIT_S)
    console = Console(quiet=True)
    assert run_batch.run(request, console, faulty_drives.simulate_or_fail) == 1
    assert [row['error'] for row in read_rows(tmp_path)] == ['its process was ended after 3 s']
    # it is tried again
    assert run_batch.run(request._replace(limit_s=TIMEOUT_S), console) == 0
    assert [row['completed'] for row in read_rows(tmp_path)] == [True]


def test_a_drive_that_crashes_or_raises_costs_its_row(write_study, tmp_path):
    faults = [faulty_drives.CRASHES, faulty_drives.ENDS, faulty_drives.RAISES]
    study = write_study(set={'plant.friction': [*faults, 0.9]})
    request = run_batch.Request(study, tmp_path, jobs=1, limit_s=TIMEOUT_S)
    console = Console(quiet=True)
    # as perturbed, no further run has the friction of a fault
    assert run_batch.run(request, console, faulty_drives.simulate_or_fail) == 1
    rows = read_rows(tmp_path)
    assert [row['error'] for row in rows[::2]] == [
        'its process was ended by SIGSEGV',
        'its process ended with exit code 7',
        'ZeroDivisionError: nothing to divide by',
        '',
    ]
    good = [row for row in rows if not row['error']]
    assert len(good) == 5
    assert all(row['completed'] for row in good)
    # they are tried again, the others are not
    kept = records(tmp_path)
    assert run_batch.run(request, console) == 0
    assert records(tmp_path) == kept + len(faults)
    assert all(row['completed'] for row in read_rows(tmp_path))


def test_a_file_that_changes_while_a_batch_runs_costs_the_drives_after_it(write_study, tmp_path):
    own = tmp_path / 'own.yaml'
    own.write_text(node_config.find_controller('mpcc').config.read_text())
    study = write_study(
        controllers=['./own.yaml'],
        set={},
        draw={'plant.friction': {'uniform': [0.8, 1.0]}},
        draws=3,
        runs=1,
    )
    edit = partial(
        faulty_drives.simulate_and_edit, file=str(own), old='_search_m: 10', new='_search_m: 11'
    )
    request = run_batch.Request(study, tmp_path, jobs=1, limit_s=TIMEOUT_S)
    assert run_batch.run(request, Console(quiet=True), edit) == 1
    first, *others = read_rows(tmp_path)
    assert first['completed']
    assert len(others) == 2
    assert all('a file of its inputs has changed since' in row['error'] for row in others)
    assert records(tmp_path) == 1


def test_drives_with_one_key_are_simulated_once(write_study, tmp_path):
    name = 'controller.safety.obstacle_m'
    study = write_study(set={name: [0.5, 0.5]}, runs=1)
    assert cli.main(['batch', str(study), '--out', str(tmp_path), '--jobs', '2']) == 0
    assert records(tmp_path) == 1
    first, second = read_rows(tmp_path)
    assert first == second


def test_unusable_studies_are_one_line_with_the_place(write_study, tmp_path, capsys):
    study = write_study(set={'plant.friction': [1.0, 9.0]})
    assert cli.main(['batch', str(study), '--out', str(tmp_path / 'out'), '--jobs', '1']) == 1
    error = capsys.readouterr().err
    assert f'{study}:9: set.plant.friction[1]: ' in error
    assert 'allowed 0.05 to 1.5' in error


@pytest.mark.parametrize(
    ('given', 'what'),
    [
        ({'scenarios': ['strait']}, "scenarios: no scenario 'strait'; available: .*'straight'"),
        ({'scenarios': ['./no_road.yaml']}, 'scenarios: no file .*no_road.yaml'),
        ({'controllers': ['mpc']}, "controllers: no controller 'mpc'; there are"),
        ({'controllers': ['./mine.yaml']}, 'controllers: no controller .*mine.yaml.*no such file'),
        ({'controllers': ['./bad.yaml']}, r'controllers: .*bad.yaml.*safety.obstacle_m.*allowed'),
    ],
)
def test_unusable_scenarios_and_controllers_are_named(write_study, tmp_path, given, what):
    (tmp_path / 'bad.yaml').write_text(
        '/**: {ros__parameters: {base: mpcc.yaml, safety: {obstacle_m: -1.0}}}'
    )
    request = run_batch.Request(write_study(**given), tmp_path / 'out', jobs=1, limit_s=TIMEOUT_S)
    with pytest.raises(BagError, match=f'study.yaml: {what}'):
        run_batch.run(request, Console(quiet=True))


def test_two_scenarios_of_one_name_are_refused(write_study, short_road, tmp_path):
    short_road.with_name('copy.yaml').write_text(short_road.read_text())
    study = write_study(scenarios=['./short_road.yaml', './copy.yaml'])
    request = run_batch.Request(study, tmp_path / 'out', jobs=1, limit_s=TIMEOUT_S)
    with pytest.raises(BagError, match=r"copy\.yaml have one name, 'short_road'"):
        run_batch.run(request, Console(quiet=True))


def test_a_plant_that_the_controller_does_not_know_is_driven_with_one_warning(
    write_study, tmp_path, capsys
):
    cars = {
        'plant.plant_params': ['bmw_545i.yaml', 'bmw_330i.yaml'],
        'plant.car.body.mass_kg': [1850.0, 2400.0],
    }
    study = write_study(set=cars, runs=1)
    assert cli.main(['batch', str(study), '--out', str(tmp_path / 'cars'), '--jobs', '1']) == 0
    printed = ' '.join(''.join(capsys.readouterr()).split())
    assert printed.count('warning: plant.plant_params=bmw_330i.yaml is driven although') == 1
    assert 'car_file car.yaml of mpcc_no_ca does not fit it: mass ' in printed
    assert 'bmw_545i.yaml is driven' not in printed
    assert len(read_rows(tmp_path / 'cars')) == 4
