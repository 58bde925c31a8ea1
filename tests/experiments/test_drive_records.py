"""Records of finished drives outlive their program, and what tore them."""

import subprocess
import sys

import pytest

from bags.errors import BagError
from experiments.drive_records import DriveRecords

FILLING = """
import resource, signal, sys
from pathlib import Path
from experiments.drive_records import DriveRecords
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
with DriveRecords(Path(sys.argv[1])) as records:
    for key in 'abcdefgh':
        records.add(key, '{"ticks": 1}')
"""


def test_records_are_kept(tmp_path):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{"min_v2o_m": 0.1}')
    with DriveRecords(tmp_path) as records:
        assert 'a' in records
        assert records['a'] == '{"min_v2o_m": 0.1}'
        assert 'b' not in records


@pytest.mark.parametrize('kept', range(1, 20, 6))
def test_a_torn_last_record_is_left_out_and_costs_no_other(tmp_path, kept):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{"ticks": 1}')
        whole = records.path.stat().st_size
        records.add('b', '{"ticks": 2}')
        path = records.path
    path.write_bytes(path.read_bytes()[: whole + kept])
    with DriveRecords(tmp_path) as records:
        assert records.damaged == 1
        assert 'a' in records
        assert 'b' not in records
        records.add('c', '{"ticks": 3}')
    with DriveRecords(tmp_path) as records:
        assert records.damaged == 0
        assert 'a' in records
        assert 'c' in records


@pytest.mark.parametrize('line', [b'{"key": "x"}\n', b'\0\0\0\n', b'[]\n', b'{"key": "x", "resu\n'])
def test_a_damaged_record_is_left_out(tmp_path, line):
    with DriveRecords(tmp_path) as records:
        records.add('a', '{}')
        path = records.path
    path.write_bytes(line + path.read_bytes())
    with DriveRecords(tmp_path) as records:
        assert records.damaged == 1
        assert 'a' in records
        assert 'x' not in records


def test_a_file_that_cannot_grow_is_an_error_and_keeps_the_records_before(tmp_path):
    """A limit of the size of files stands for a full disk."""
    filled = subprocess.run(
        [sys.executable, '-c', FILLING, tmp_path], capture_output=True, text=True, timeout=240
    )
    assert 'drives.jsonl: no space left; the drives before this one are kept' in filled.stderr
    with DriveRecords(tmp_path) as records:
        assert [key for key in 'abcdefgh' if key in records] == ['a', 'b']
        assert records.damaged == 1
        assert records.path.stat().st_size < 100


def test_two_batches_do_not_write_one_folder(tmp_path):
    with DriveRecords(tmp_path), pytest.raises(BagError, match='another program'):
        DriveRecords(tmp_path).__enter__()
