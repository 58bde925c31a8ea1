"""`experiments batch --dask` makes the table of a local batch, whatever ends on the way."""

import signal
import subprocess
import sys

import pytest
from dask_cluster import Cluster
from test_run_batch import read_rows, records
from wait_until import wait_until

from experiments import cli

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
TIMEOUT_S = 240.0


def start(study, folder, address):
    command = ['-m', 'experiments.cli', 'batch', study, '--out', folder, '--dask', address]
    return subprocess.Popen(
        [sys.executable, *map(str, command)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_killed_workers_and_schedulers_do_not_change_the_table(write_study, tmp_path):
    study = write_study(
        draw={'controller.tolerances.lag_m': {'log_uniform': [0.2, 0.6]}}, draws=4, runs=2
    )
    whole, far = tmp_path / 'whole', tmp_path / 'far'
    assert cli.main(['batch', str(study), '--out', str(whole), '--jobs', '2']) == 0
    rows = read_rows(whole)
    assert len(rows) == 2 * 4 * 2

    with Cluster(tmp_path / 'one') as cluster:
        first, _ = cluster.start_worker(), cluster.start_worker()
        with start(study, far, cluster.address) as batch:
            wait_until(lambda: records(far) >= 3, TIMEOUT_S, 'no drive was kept')
            first.send_signal(signal.SIGKILL)
            kept = records(far)
            wait_until(lambda: records(far) >= kept + 3, TIMEOUT_S, 'the other worker is idle')
            cluster.scheduler.send_signal(signal.SIGKILL)
            said, _ = batch.communicate(timeout=TIMEOUT_S)
    kept = records(far)
    assert 6 <= kept <= len(rows)
    if kept < len(rows):
        assert batch.returncode == 1, said
        assert 'error: --dask tcp://127.0.0.1' in said
        assert 'the scheduler is gone; what has ended is kept' in said

    with Cluster(tmp_path / 'another') as cluster:
        cluster.start_worker()
        with start(study, far, cluster.address) as batch:
            said, _ = batch.communicate(timeout=TIMEOUT_S)
    assert batch.returncode == 0, said
    assert f'{len(rows)} drives: {kept} were kept, 0 failed' in said
    assert read_rows(far) == rows
