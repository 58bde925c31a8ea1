"""`experiments batch` end to end: real drives of a second; interrupted and crashed ones."""

import contextlib
import json
import resource
import signal
import subprocess
import sys
from argparse import Namespace

import faulty_drives
import pytest
from pyarrow import parquet
from rich.console import Console
from wait_until import wait_until

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.metrics.registry import flatten
from experiments import cli, code_version, drive_row, simulation
from experiments.batch import run_batch
from experiments.drive_row import Row
from experiments.row_runner import DriveRecords

TIMEOUT_S = 240.0
LIMIT_S = 3.0  # of a drive that hangs
# wall and processor times differ from drive to drive
TIMES = ('wall_s', 'cpu_s', 'solve_ms.', 'solve_cpu_ms.', 'solver.time_')


def read_rows(folder):
    """Return the rows of the table without what differs between two equal drives."""
    rows = parquet.read_table(folder / 'results.parquet').to_pylist()
    return [{n: value for n, value in row.items() if not n.startswith(TIMES)} for row in rows]


def run(study, folder, limit_s=TIMEOUT_S, **more):
    options = {'study': study, 'out': folder, 'jobs': 1, 'dask': '', 'settings': []}
    options |= {'time_limit_s': limit_s}
    return run_batch.run(Namespace(**options), Console(quiet=True), **more)


def records(folder):
    path = folder / 'drives.jsonl'
    return path.read_bytes().count(b'\n') if path.exists() else 0


def start_batch(study, folder, *options):
    command = [sys.executable, '-m', 'experiments.cli', 'batch', study, '--out', folder, *options]
    return subprocess.Popen(
        [*map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def interrupt(study, folder, number, after):
    """End a batch by a signal when it has kept `after` drives; return its exit code and output."""
    with start_batch(study, folder, '--jobs', '1') as batch:
        wait_until(lambda: records(folder) >= after, TIMEOUT_S, 'no drive was kept')
        batch.send_signal(number)
        output, _ = batch.communicate(timeout=TIMEOUT_S)
    return batch.returncode, output


@pytest.mark.usefixtures('tasks_here')  # of what goes on, not of what is interrupted
def test_an_interrupted_batch_goes_on_to_the_same_table(write_study, tmp_path, capsys):
    study, whole, torn = write_study(runs=4), tmp_path / 'whole', tmp_path / 'torn'
    code, output = interrupt(study, torn, signal.SIGINT, after=1)
    assert code == 130
    part = read_rows(torn)
    assert 1 <= len(part) < 8
    assert f'{len(part)} of 8 drives are kept; the same command goes on' in output
    code, _ = interrupt(study, torn, signal.SIGKILL, after=len(part) + 1)
    assert code == -signal.SIGKILL
    kept = records(torn)
    assert kept < 8
    assert cli.main(['batch', str(study), '--out', str(torn), '--jobs', '1']) == 0
    assert f'8 drives: {kept} were kept, 0 failed' in capsys.readouterr().out
    assert cli.main(['batch', str(study), '--out', str(whole), '--jobs', '1']) == 0
    rows = read_rows(whole)
    assert len(rows) == 8
    assert read_rows(torn) == rows
    assert all(row in rows for row in part)


def test_a_batch_asks_the_cluster_that_is_named(write_study, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr('experiments.pool.CONNECT_S', 0.2)
    command = ['batch', str(write_study()), '--out', str(tmp_path / 'out')]
    assert cli.main([*command, '--dask', 'tcp://127.0.0.1:9']) == 1
    assert '--dask tcp://127.0.0.1:9: no scheduler answers' in capsys.readouterr().err


@pytest.mark.usefixtures('tasks_here')
def test_the_table_has_a_column_for_all_that_a_drive_is_and_gives(write_study, tmp_path):
    study = write_study(set={'scenario.speed_mps': [14.5, 15.0]})
    assert cli.main(['batch', str(study), '--out', str(tmp_path), '--jobs', '1']) == 0
    table = parquet.read_table(tmp_path / 'results.parquet')
    rows = table.to_pylist()
    assert [(row['scenario.speed_mps'], row['run']) for row in rows] == [
        (speed, number) for speed in (14.5, 15.0) for number in (1, 2)
    ]
    same = {(row['scenario'], row['controller'], row['seed'], row['error']) for row in rows}
    assert same == {('short_road', 'mpcc_no_ca', 1, '')}
    assert {row['code_version'] for row in rows} == {code_version.digest()}
    for name in ('offset.speed_kph', 'offset.grip'):
        assert rows[0][name] != rows[1][name] == rows[3][name]
    assert all(row['wall_s'] > 0.0 and row['cpu_s'] > 0.0 for row in rows)
    assert {'solver.failed', 'solver.iterations_mean', 'solve_ms.p99'} <= set(table.column_names)
    road = str(tmp_path / 'short_road.yaml')
    one = drive_row.prepare(Row(road, 'mpcc_no_ca', (('scenario.speed_mps', 15.0),)))
    wanted = flatten(metrics.compute_metrics(simulation.drive(one)))
    assert wanted['verdict'] == 'reached the finish line at 15 m; no collision'
    differ = [name for name, value in wanted.items() if rows[2][name] != value]
    assert all(name.startswith(TIMES) for name in differ)
    assert json.loads(table.schema.metadata[b'versions'])['numpy']


@pytest.mark.usefixtures('tasks_here')
def test_draws_and_families_have_a_row_each_and_columns_of_what_is_drawn(write_study, tmp_path):
    given = {
        'set': {},
        'families': ['pop_up'],
        'draw': {'scenario.friction': {'uniform': [0.8, 1.0]}},
        'draws': 1,
        'runs': 1,
    }
    assert run(write_study(**given), tmp_path) == 0
    rows = read_rows(tmp_path)
    # later draws of the same study keep those before
    assert run(write_study(**given | {'draws': 2}), tmp_path) == 0
    assert records(tmp_path) == 4
    more = read_rows(tmp_path)
    assert [more[0], more[2]] == rows
    assert [(row['scenario'], row['family'], row['draw']) for row in more] == [
        ('short_road', None, 0),
        ('short_road', None, 1),
        ('pop_up:0', 'pop_up', 0),
        ('pop_up:1', 'pop_up', 1),
    ]
    friction = [row['scenario.friction'] for row in more]
    assert friction[:2] == friction[2:]
    assert all(0.8 <= value <= 1.0 for value in friction)
    assert all(row['survived'] is not None for row in more)


def test_a_drive_that_crashes_or_raises_costs_its_row_and_is_tried_again(
    write_study, tmp_path, request
):
    faults = [faulty_drives.CRASHES, faulty_drives.RAISES]
    study = write_study(set={'plant.friction': [*faults, 0.9]}, runs=1)
    assert run(study, tmp_path, drive=faulty_drives.drive_or_fail) == 1
    rows = read_rows(tmp_path)
    assert [row['error'] for row in rows] == [
        'its process was ended by SIGSEGV',
        'ZeroDivisionError: nothing to divide by',
        '',
    ]
    assert [row['completed'] for row in rows] == [None, None, True]
    assert records(tmp_path) == 1
    # they are tried again
    request.getfixturevalue('tasks_here')
    assert run(study, tmp_path) == 0
    assert [row['completed'] for row in read_rows(tmp_path)] == [True] * 3


@pytest.mark.usefixtures('tasks_here')
def test_a_plant_that_the_controller_does_not_know_is_driven_once_with_one_warning(
    write_study, tmp_path, capsys
):
    cars = ['bmw_545i.yaml', 'bmw_330i.yaml', 'bmw_330i.yaml']
    study = write_study(set={'plant.plant_params': cars}, runs=1)
    assert cli.main(['batch', str(study), '--out', str(tmp_path / 'cars'), '--jobs', '1']) == 0
    printed = ' '.join(''.join(capsys.readouterr()).split())
    assert printed.count('warning: plant.plant_params=bmw_330i.yaml is driven although') == 1
    assert 'car_file car.yaml of mpcc_no_ca does not fit it: mass ' in printed
    assert 'bmw_545i.yaml is driven' not in printed
    assert records(tmp_path / 'cars') == 2
    first, second, again = read_rows(tmp_path / 'cars')
    assert first != second == again


@pytest.mark.parametrize('kept', [1, 19])
def test_a_torn_last_record_is_left_out_and_costs_no_other(tmp_path, kept):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{"ticks": 1}')
        whole = records.path.stat().st_size
        records.add('b', '{"ticks": 2}')
        path = records.path
    path.write_bytes(path.read_bytes()[: whole + kept])
    with DriveRecords(tmp_path) as records:
        assert (records.damaged, 'a' in records, 'b' in records) == (1, True, False)
        records.add('c', '{"ticks": 3}')
    with DriveRecords(tmp_path) as records:
        assert (records.damaged, records['a'], records['c']) == (0, '{"ticks": 1}', '{"ticks": 3}')


@pytest.mark.parametrize('line', [b'{"key": "x"}\n', b'\0\0\0\n', b'[]\n', b'{"key": "x", "resu\n'])
def test_a_damaged_record_is_left_out(tmp_path, line):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{}')
        path = records.path
    path.write_bytes(line + path.read_bytes())
    with DriveRecords(tmp_path) as records:
        assert (records.damaged, 'a' in records, 'x' in records) == (1, True, False)
        # nor does another batch write into the folder of one that runs
        with pytest.raises(BagError, match='another program'):
            DriveRecords(tmp_path).__enter__()


@contextlib.contextmanager
def files_of_100_bytes():
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_file_that_cannot_grow_is_an_error_and_keeps_the_records_before(tmp_path):
    """A limit of the size of files stands for a full disk."""
    message = 'drives.jsonl: no space left; the drives before this one are kept'
    with DriveRecords(tmp_path) as records, files_of_100_bytes():
        records.add('a', '{"ticks": 1}')
        records.add('b', '{"ticks": 1}')
        with pytest.raises(BagError, match=message):
            records.add('c', '{"ticks": 1}')
    with DriveRecords(tmp_path) as records:
        assert [*records] == ['a', 'b']
        assert records.damaged == 1
        assert records.path.stat().st_size < 100


def test_a_drive_that_hangs_costs_its_row(write_study, tmp_path):
    # alone: what a drive that does not hang may take depends on what else the machine does
    study = write_study(set={'plant.friction': [faulty_drives.HANGS]}, runs=1)
    assert run(study, tmp_path, LIMIT_S, drive=faulty_drives.drive_or_fail) == 1
    assert [row['error'] for row in read_rows(tmp_path)] == ['its process was ended after 3 s']
